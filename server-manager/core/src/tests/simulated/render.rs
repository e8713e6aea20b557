//! The render thread of a simulated server: as `render_thread.rs` of the render server, with its
//! very own `frame_scheduler.rs`, but for the pictures.

use std::time::Duration;

use polyptych_protocol::command::{Frame, Swap};
use polyptych_protocol::server_message::{FramePresented, FrameRendered, ServerMessage};

use super::super::Micros;
use super::playback::{FrameAction, FrameKey, SLOW_GRACE_MAX};
use super::server::{DrawnImage, JOBS_MAX, State};
use super::world::{Check, SimEvent, Simulation};

/// `STATES_MAX` of the render server.
const STATES_MAX: usize = 4;

/// A job that another thread gives this one.
#[derive(Debug)]
pub enum Job {
    Frame(Box<Frame>),
    Swap(Swap),
    Disconnected,
}

/// The present work of the thread.
#[derive(Debug)]
pub enum Drawing {
    /// A frame, one channel after the other; `is_drawn` once one of them has drawn it.
    Frame { frame: Box<Frame>, channel: usize, began: Micros, is_drawn: bool },
    /// A new state, where nobody sees it.
    WarmUp(Box<State>),
}

impl Simulation {
    pub fn push_job(&mut self, index: usize, job: Job) {
        if self.servers[index].jobs.len() < JOBS_MAX {
            self.servers[index].jobs.push_back(job);
            self.wake_render(index);
        } else {
            self.coverage.count("job dropped by a render thread that hangs");
        }
    }

    /// A thread that waits runs a moment after it was woken; more may have come by then.
    pub fn wake_render(&mut self, index: usize) {
        let server = &mut self.servers[index];
        if !server.is_waking && server.drawing.is_none() {
            server.is_waking = true;
            let life = server.life;
            let moment = self.dice.between(5, 60);
            self.at(self.now + moment, SimEvent::Render(index, life));
        }
    }

    /// The thread's loop, until it draws or waits.
    pub fn render(&mut self, index: usize) -> Check {
        self.servers[index].is_waking = false;
        while self.servers[index].drawing.is_none() {
            while let Some(job) = self.servers[index].jobs.pop_front() {
                let manager_us = self.servers[index].manager_us(self.now);
                let playback = &mut self.servers[index].playback;
                match job {
                    Job::Frame(frame) => playback.handle_frame(frame),
                    Job::Swap(swap) => {
                        let act = playback.handle_swap(swap, manager_us);
                        self.show(index, act.as_ref())?;
                    }
                    Job::Disconnected => playback.reset(),
                }
            }
            let manager_us = self.servers[index].manager_us(self.now);
            match self.servers[index].playback.poll(manager_us) {
                show @ Some(FrameAction::Show { .. }) => self.show(index, show.as_ref())?,
                Some(FrameAction::Draw { frame, keep }) => {
                    if let Some(key) = keep {
                        self.keep_aside(index, key);
                    }
                    self.begin_drawing(index, frame);
                }
                None => {
                    if !self.begin_warm_up(index) {
                        self.wake_for_show(index);
                        break;
                    }
                }
            }
        }
        Ok(())
    }

    /// A thread that waits for the instant of a swap runs then.
    fn wake_for_show(&mut self, index: usize) {
        let server = &self.servers[index];
        let due = server.playback.next_show_us().zip(server.manager_us(self.now));
        let life = server.life;
        if let Some((due, manager_us)) = due {
            let wait_us = due.saturating_sub(manager_us).max(1);
            self.at(self.now + wait_us, SimEvent::Render(index, life));
        }
    }

    /// Makes the state drawable that waits for that, if any.
    fn begin_warm_up(&mut self, index: usize) -> bool {
        let Some(state) = self.servers[index].finish.take() else { return false };
        let warm_up_us = self.dice.between(200, 5_000);
        self.draw_until(index, Drawing::WarmUp(state.into()), warm_up_us);
        true
    }

    fn draw_until(&mut self, index: usize, drawing: Drawing, takes_us: u64) {
        let server = &mut self.servers[index];
        server.drawing = Some(drawing);
        let life = server.life;
        self.at(self.now + takes_us, SimEvent::DrawingEnds(index, life));
    }

    /// The counterpart of `keep_aside` of the render server's outputs.
    fn keep_aside(&mut self, index: usize, key: FrameKey) {
        let server = &mut self.servers[index];
        for &channel in &server.channels {
            let is_kept = server.aside.get(&channel).is_some_and(|of| (of.epoch, of.frame) == key);
            if !is_kept && let Some(drawn) = server.targets.remove(&channel) {
                server.aside.insert(channel, drawn);
                self.coverage.count("picture kept aside");
            }
        }
    }

    fn begin_drawing(&mut self, index: usize, frame: Box<Frame>) {
        let states = &mut self.servers[index].states;
        let is_it = |s: &State| s.epoch == frame.epoch && s.revision() == frame.revision;
        // The newest: a server that was resynchronised holds a wrong one of the same number.
        let Some(at) = states.iter().rposition(is_it) else {
            self.coverage.count("frame of a state that is not here");
            return;
        };
        states.drain(..at);
        let takes_us = self.drawing_time(index);
        let began = self.now;
        self.servers[index].frame_began = began;
        self.draw_until(
            index,
            Drawing::Frame { frame, channel: 0, began, is_drawn: false },
            takes_us,
        );
    }

    fn drawing_time(&mut self, index: usize) -> u64 {
        let server = &self.servers[index];
        let slow_by = if self.now < server.trouble.slow_until { server.trouble.slow_by } else { 1 };
        let usual = server.draw_us * slow_by;
        self.dice.between(usual * 8 / 10, usual * 12 / 10)
    }

    pub fn end_drawing(&mut self, index: usize) -> Check {
        match self.servers[index].drawing.take() {
            None => {}
            Some(Drawing::WarmUp(state)) => {
                let states = &mut self.servers[index].states;
                if states.len() == STATES_MAX {
                    states.remove(1);
                }
                states.push_back((*state).clone());
                self.finished(index, &state)?;
            }
            Some(Drawing::Frame { frame, channel, began, is_drawn }) => {
                let is_drawn = self.drew_channel(index, &frame, channel, began) || is_drawn;
                if channel + 1 < self.servers[index].channels.len() {
                    let takes_us = self.drawing_time(index);
                    let began = self.now;
                    let channel = channel + 1;
                    let drawing = Drawing::Frame { frame, channel, began, is_drawn };
                    self.draw_until(index, drawing, takes_us);
                    return Ok(());
                }
                if is_drawn {
                    let server = &mut self.servers[index];
                    let manager_us = server.manager_us(self.now);
                    let took = Duration::from_micros(self.now - server.frame_began);
                    let grace_us = took.min(SLOW_GRACE_MAX).as_micros() as Micros;
                    server.graces_us.push_back(((frame.epoch, frame.frame), grace_us));
                    // The last one, and the one that was kept aside.
                    while server.graces_us.len() > 2 {
                        server.graces_us.pop_front();
                    }
                    let act = server.playback.frame_drawn(&frame, took, manager_us);
                    self.show(index, act.as_ref())?;
                }
                if self.begin_warm_up(index) {
                    return Ok(());
                }
            }
        }
        self.render(index)
    }

    fn drew_channel(&mut self, index: usize, frame: &Frame, at: usize, began: Micros) -> bool {
        let draw_us = (self.now - began) as u32;
        let server = &mut self.servers[index];
        let channel = server.channels[at];
        let Some(state) = server.states.front() else { return false };
        let (revision, digest) = (state.revision(), state.digest);
        let (epoch, number) = (frame.epoch, frame.frame);
        if self.now < server.trouble.draws_fail_until {
            server.targets.remove(&channel);
            let reason = "the device is busy".to_owned();
            self.report(index, ServerMessage::DrawFailed { channel, frame: number, reason });
            return false;
        }
        server.drawn.entry(channel).or_default().add((epoch, number));
        server.targets.insert(channel, DrawnImage { epoch, frame: number, revision, digest });
        let drawn = FrameRendered {
            epoch,
            frame: number,
            channel,
            revision,
            digest,
            draw_us,
            triangles: 1,
            draw_calls: 1,
            error_fraction: 0.0,
            draws_occluded: 0,
            is_trial: false,
            passes: polyptych_scene::PassTimes::default(),
        };
        self.report(index, ServerMessage::Drawn(drawn));
        true
    }

    fn show(&mut self, index: usize, act: Option<&FrameAction>) -> Check {
        let Some(&FrameAction::Show { epoch, frame, at_us: stated_us, is_unscheduled, .. }) = act
        else {
            return Ok(());
        };
        let server = &self.servers[index];
        if server.states.front().is_none_or(|state| state.epoch != epoch) {
            return Ok(());
        }
        let clock_error_us = server.offset.map_or(u32::MAX, |(_, error)| error);
        let grace_us = server.graces_us.iter().find(|(key, _)| *key == (epoch, frame));
        let grace_us = grace_us.map_or(0, |(_, grace_us)| *grace_us);
        let slack_us = Micros::from(clock_error_us) + grace_us;
        let manager_us = server.manager_us(self.now).unwrap_or(0);
        // It looks at the clock until then.
        let at_us = stated_us.unwrap_or(manager_us);
        let now = self.now + at_us.saturating_sub(manager_us);
        if let Some(stated_us) = stated_us {
            self.watch.shown_at(now, epoch, stated_us, clock_error_us)?;
            self.coverage.count("shown at its instant");
        } else if is_unscheduled {
            self.coverage.count("shown behind its instant");
        }
        for channel in server.channels.clone() {
            let server = &self.servers[index];
            if !server.drawn.get(&channel).is_some_and(|drawn| drawn.has((epoch, frame))) {
                self.coverage.count("frame shown but on a channel that could not draw it");
                continue;
            }
            let aside = server.aside.get(&channel);
            let aside = aside.filter(|of| (of.epoch, of.frame) == (epoch, frame));
            let picture = aside.or_else(|| server.targets.get(&channel)).copied();
            self.watch.shown(now, channel, (epoch, frame), picture, slack_us)?;
            let shown =
                FramePresented { epoch, frame, channel, at_us, clock_error_us, is_unscheduled };
            self.report(index, ServerMessage::Shown(shown));
        }
        Ok(())
    }
}
