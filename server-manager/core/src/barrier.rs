//! The frame barrier: begin, wait for the drawings, swap. One for the whole wall.

use std::collections::{BTreeMap, BTreeSet};
use std::num::NonZeroU32;

use polyptych_protocol::command::{Command, Frame, Swap};
use polyptych_protocol::feedback::ChannelState;
use polyptych_protocol::ids::{Digest, FrameId, Revision};
use polyptych_protocol::presentation::Presentation;
use polyptych_protocol::quality_bounds::DetailBound;
use polyptych_protocol::request::Response;
use polyptych_protocol::server_message::FrameRendered;
use polyptych_wall::ChannelId;
use serde::{Deserialize, Serialize};

use super::frame_request::{FrameRequest, OutputChange};
use super::reduction::Reduction;
use super::registry::Registry;
use super::statistics::FrameFacts;
use super::{ClientRequest, Cluster, Effect, Micros, SessionId, span};

/// Frames after joining or a change in which a channel warms up: a first draw still compiles and
/// fills caches. While all do, a frame waits as long as any may.
const WARM_UP_FRAMES: u32 = 3;

/// By how much one server may draw longer than the median server before the rest of its time does
/// not count for the deadline: tiles of a wall differ by less. One of three servers or more so
/// raises the deadline to this multiple at most, whatever it says and however slow it is.
const OUTLIER_FACTOR: u32 = 4;

/// A frame on its way.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Barrier {
    pub frame: FrameId,
    /// The revision that it draws. The wall's state may go on meanwhile; this frame does not.
    pub revision: Revision,
    digest: Digest,
    /// The error bound that it is drawn with, in pixels.
    pub error_px: f64,
    /// The error and the resolution that it is drawn with, as the rate bound has them.
    pub reduction: Reduction,
    /// A channel that it waits for has just come, or its pictures are read back: its time says
    /// nothing of the next frames.
    pub is_untypical: bool,
    /// Another scene was opened since, of which its times say nothing.
    #[serde(default)]
    pub is_past: bool,
    /// It shows a test pattern: its times say nothing of the scene's.
    #[serde(default)]
    pub is_pattern: bool,
    pub time_s: f64,
    pub began: Micros,
    /// The time at which its wait starts: its own beginning or the swap of the frame before,
    /// whichever is later.
    pub turn: Micros,
    /// The time for which it waits from its turn on.
    wait: Micros,
    /// The time for which it waits while no channel has drawn: longer if all channels are late,
    /// since some of them may hang.
    patience: Micros,
    /// It was sent while another frame was on its way.
    pub is_ahead: bool,
    /// `true` if all channels were late when it began. A channel that draws it within the longest
    /// wait then counts as in time, and the deadline learns from it.
    is_all_late: bool,
    order: Option<FrameRequest>,
    /// Every server that was sent the frame.
    sent: Vec<SessionId>,
    /// Number of channels on which the servers in `sent` draw it.
    sent_channels: usize,
    /// The channels that the frame waits for, until they have drawn, failed or gone.
    pub waited: Vec<ChannelId>,
    /// The channels of `waited` when the frame began, without those given up: late channels that
    /// draw in time don't slow it.
    awaited: Vec<ChannelId>,
    /// Drawing time of each server for the channels in `awaited`, in microseconds, summed up: a
    /// server draws its channels one after another.
    busy_us: BTreeMap<SessionId, u32>,
    /// Servers of which a channel was drawn in another way for comparison.
    tried: BTreeSet<SessionId>,
    pub drawn: BTreeMap<ChannelId, FrameRendered>,
}

/// The servers and channels that draw a frame.
#[derive(Debug, Default)]
struct Participants {
    sent: Vec<SessionId>,
    /// Live channels.
    waited: Vec<ChannelId>,
    late: Vec<ChannelId>,
    /// A live channel has warmed up.
    is_warm: bool,
    /// A live channel has not.
    is_cold: bool,
}

impl Barrier {
    /// Returns the time for which it waits from its turn on, as far as is known now.
    pub fn length(&self) -> Micros {
        if self.drawn.is_empty() { self.patience } else { self.wait }
    }

    /// Returns the time at which it ends at the latest, as far as is known now. Only the oldest
    /// frame has a deadline.
    pub fn deadline(&self) -> Micros {
        self.turn + self.length()
    }

    /// Returns whether another frame may be sent behind it.
    pub fn is_ordinary(&self) -> bool {
        !self.is_untypical && !self.is_all_late
    }

    /// It waits for these channels no longer, and their times do not count for it.
    pub fn give_up(&mut self, channels: &[ChannelId]) {
        self.waited.retain(|id| !channels.contains(id));
        self.awaited.retain(|id| !channels.contains(id));
    }

    /// The longest that a server drew for the channels that the frame waited for, where one has.
    pub fn slowest_us(&self) -> Option<u32> {
        self.busy_us.values().copied().max()
    }

    /// The longest that a server drew as it draws most frames: without a trial.
    pub fn slowest_untried_us(&self) -> Option<u32> {
        let untried = self.busy_us.iter().filter(|(server, _)| !self.tried.contains(server));
        untried.map(|(_, us)| *us).max()
    }

    /// The channel that took longest to draw on the server that drew longest, of those that the
    /// frame waited for.
    pub fn limiting_channel(&self, registry: &Registry) -> Option<ChannelId> {
        let awaited = self.drawn.values().filter(|drawn| self.awaited.contains(&drawn.channel));
        let busy_us = |id: ChannelId| self.busy_us.get(&registry.channel(id)?.server?);
        let longest = awaited.max_by_key(|drawn| (busy_us(drawn.channel), drawn.draw_us));
        longest.map(|drawn| drawn.channel)
    }

    /// Returns the time that the deadline learns from, in microseconds: the slowest server's, but
    /// at most [`OUTLIER_FACTOR`] times the median server's, since one server alone must not move
    /// the deadline. `None` if no awaited channel has drawn.
    pub fn typical_slowest_us(&self) -> Option<u32> {
        let mut all: Vec<u32> = self.busy_us.values().copied().collect();
        all.sort_unstable();
        let median = *all.get(all.len() / 2)?;
        all.last().map(|slowest| median.saturating_mul(OUTLIER_FACTOR).min(*slowest))
    }

    /// Returns whether the frame waited for this drawing.
    fn awaits(&self, drawn: &FrameRendered) -> bool {
        self.frame == drawn.frame && self.awaited.contains(&drawn.channel)
    }

    /// This server is not to show the frame.
    pub fn exclude(&mut self, session: SessionId) {
        self.sent.retain(|&id| id != session);
    }

    /// Whom the frame waits for still.
    #[cfg(test)]
    pub fn pending(&self) -> &[ChannelId] {
        &self.waited
    }

    /// Whom it waited for as it began.
    #[cfg(test)]
    pub fn participants(&self) -> &[ChannelId] {
        &self.awaited
    }

    pub fn is_complete(&self) -> bool {
        self.waited.is_empty()
    }
}

impl Cluster {
    pub(super) fn begin_frame(&mut self, now: Micros) {
        let order = self.orders.pop_front();
        let capture = order.as_ref().and_then(|order| order.capture);
        self.take_over(order.as_ref());
        let next = FrameId(self.frame.0 + 1);
        self.registry.admit_ready(now, next);
        self.registry.admit_late(now, next);
        let Participants { sent, mut waited, late, is_warm, is_cold } = self.participants();
        let sent_channels = waited.len() + late.len();
        // Where all are late, not to wait would count frames that nobody draws. Those that drew
        // the last one are given time, and must not be held up by those that hang.
        let is_all_late = waited.is_empty();
        let mut is_catching_up = false;
        if is_all_late {
            let has_drawn = |id: &ChannelId| self.registry.is_catching_up(*id);
            waited = late.iter().copied().filter(has_drawn).collect();
            is_catching_up = !waited.is_empty();
            if waited.is_empty() {
                waited = late;
            }
        }
        self.frame.0 += 1;
        let time_s = self.time_of(order.as_ref(), now);
        self.advance_clips(order.as_ref(), time_s);
        self.follow_tour(order.as_ref(), time_s, now);
        self.follow_node(order.as_ref(), time_s, now);
        // A picture that someone asked for is worth the longest wait; a channel that joins a wall
        // that moves is not, as it would hold up those who have warmed up long ago.
        let (length, longest) = self.frame_waits();
        let is_warming = !is_all_late && !is_warm;
        let is_new = self.begins_part();
        let is_patient =
            is_new || capture.is_some() && !order.as_ref().is_some_and(|of| of.is_preview);
        let wait = if is_warming || is_catching_up || is_patient { longest } else { length };
        let patience = if is_all_late { longest } else { wait };
        self.pacer.frame_started(now, !waited.is_empty());
        let is_metered = self.expose(now, &waited);
        if let Some(FrameRequest { job, capture: Some(side), .. }) = &order {
            self.collect(*job, *side, &sent);
        }
        let detail = self.detail_bound();
        self.note_places(&detail.densities);
        let error_px = detail.error_px;
        let reduction = self.rate_bound.in_force(&self.presentation.bounds);
        self.beginnings.add(now, self.presentation.pattern.is_none().then_some(reduction));
        let frame = Frame { is_metered, ..self.describe_frame(time_s, capture, detail) };
        self.command(sent.clone(), Command::Frame(frame));
        self.pipeline.push(Barrier {
            frame: self.frame,
            revision: self.shown.revision,
            digest: self.shown_digest,
            error_px,
            reduction,
            is_untypical: is_cold || capture.is_some() || is_new,
            is_past: false,
            is_pattern: self.presentation.pattern.is_some(),
            time_s,
            began: now,
            turn: now,
            wait,
            patience,
            is_ahead: !self.pipeline.is_empty(),
            is_all_late,
            order,
            sent,
            sent_channels,
            awaited: waited.clone(),
            waited,
            busy_us: BTreeMap::new(),
            tried: BTreeSet::new(),
            drawn: BTreeMap::new(),
        });
        if self.pipeline.oldest().is_some_and(Barrier::is_complete) {
            self.finish_frame(now);
        }
    }

    /// Those that draw the frame that begins.
    fn participants(&self) -> Participants {
        let mut all = Participants::default();
        for (id, channel) in self.registry.channels() {
            let is_late = channel.state == ChannelState::Late;
            let Some(session) = channel.server else { continue };
            if channel.state != ChannelState::Live && !is_late {
                continue;
            }
            if !all.sent.contains(&session) {
                all.sent.push(session);
            }
            if is_late {
                all.late.push(id);
            } else {
                all.waited.push(id);
                let is_warm = channel.frames_drawn >= WARM_UP_FRAMES;
                all.is_warm |= is_warm;
                all.is_cold |= !is_warm;
            }
        }
        all
    }

    /// Returns whether a channel has drawn more than its first frames, which take longer.
    fn is_warm(&self, id: ChannelId) -> bool {
        self.registry.channel(id).is_some_and(|channel| channel.frames_drawn > WARM_UP_FRAMES)
    }

    /// Applies the camera, output mode and test pattern that an order asks for, from this frame on.
    fn take_over(&mut self, order: Option<&FrameRequest>) {
        if let Some(camera) = order.and_then(|order| order.camera) {
            self.place_camera(camera);
        }
        match order.and_then(|order| order.wish) {
            Some(OutputChange::Displays(displays)) => self.presentation.output_mode = displays,
            Some(OutputChange::Pattern(pattern)) => self.presentation.pattern = pattern,
            None => {}
        }
        self.is_going_on &= order.is_none();
        self.wants_frame = false;
    }

    fn describe_frame(
        &self,
        time_s: f64,
        capture: Option<NonZeroU32>,
        detail: DetailBound,
    ) -> Frame {
        let output_mode = self.rest.output_mode(self.presentation.output_mode);
        Frame {
            epoch: self.epoch,
            frame: self.frame,
            time_s,
            revision: self.shown.revision,
            presentation: Presentation { output_mode, ..self.presentation.clone() },
            capture,
            detail,
            clips: self.clips.times(),
            is_metered: false,
        }
    }

    pub(super) fn handle_drawn(&mut self, now: Micros, from: SessionId, drawn: &FrameRendered) {
        if drawn.epoch != self.epoch || !self.registry.owns_channel(from, drawn.channel) {
            return;
        }
        // A frame on its way may be of the state before the one that is shown from the next on.
        let present = self.pipeline.iter().find(|b| b.revision == drawn.revision);
        let shown = (self.shown.revision == drawn.revision).then_some(self.shown_digest);
        let is_past = present.is_some_and(|b| b.is_past);
        let Some(digest) = present.map(|b| b.digest).or(shown) else {
            return self.record_past_draw(now, drawn);
        };
        if drawn.digest != digest {
            self.handle_divergence(now, from, "its state has another digest than the manager's");
            return;
        }
        // A late channel is measured by the deadline, not by the others: one that is slower than
        // they are, but not too slow, would else be late for ever.
        let awaiting = self.pipeline.iter().find(|b| b.awaits(drawn));
        let (length, longest) = self.frame_waits();
        let allowed = if self.pipeline.iter().any(|b| b.is_all_late) {
            longest
        } else {
            awaiting.map_or(length, Barrier::length)
        };
        let is_awaited = awaiting.is_some();
        let beginning = self.beginnings.of(drawn.frame, self.frame);
        let began = beginning.map(|(began, _)| began);
        let reduction = beginning.and_then(|(_, reduction)| reduction);
        self.registry.record_draw(drawn.channel, drawn.draw_us, now, began, allowed);
        if is_awaited {
            self.rate_bound.record_awaited(drawn.channel);
        } else if let Some(reduction) =
            reduction.filter(|_| self.is_warm(drawn.channel) && !drawn.is_trial && !is_past)
        {
            let (draw_us, undrawn_us) = (Micros::from(drawn.draw_us), self.undrawn_time());
            let bounds = &self.presentation.bounds;
            self.rate_bound.add_late(bounds, drawn.channel, draw_us, undrawn_us, reduction);
        }
        let is_its = |b: &&mut Barrier| b.revision == drawn.revision;
        let Some(barrier) = self.pipeline.frame_mut(drawn.frame).filter(is_its) else {
            if let Some(began) = began {
                self.gathered.add_drawn(drawn, now.saturating_sub(began));
            }
            return;
        };
        barrier.waited.retain(|&id| id != drawn.channel);
        if barrier.awaits(drawn) {
            // A server may say what it wants, but it has not drawn since before the frame began.
            let elapsed_us = u32::try_from(now.saturating_sub(barrier.began)).unwrap_or(u32::MAX);
            let busy_us = barrier.busy_us.entry(from).or_default();
            *busy_us = busy_us.saturating_add(drawn.draw_us).min(elapsed_us);
            if drawn.is_trial {
                barrier.tried.insert(from);
            }
        }
        barrier.drawn.insert(drawn.channel, *drawn);
        let frame_us = now.saturating_sub(barrier.began);
        self.gathered.add_drawn(drawn, frame_us);
        self.advance_frame(now);
    }

    pub(super) fn handle_draw_failed(
        &mut self,
        now: Micros,
        from: SessionId,
        channel: ChannelId,
        frame: FrameId,
        reason: String,
    ) {
        if !self.registry.owns_channel(from, channel) {
            return;
        }
        let what = format!("channel {channel}: {reason}");
        if let Some(times) = self.repetitions.should_log(now, &what) {
            let _frame = span::frame_span(frame).entered();
            let _server = self.registry.session_span(from).entered();
            let channel = self.wall.channel(channel).map_or("?", |channel| channel.name.as_str());
            tracing::warn!(channel, reason, times, "a channel could not draw");
        }
        if self.pipeline.frame(frame).is_some() {
            span::frame_span(frame).in_scope(|| self.registry.record_miss(channel, now, reason));
            self.stop_waiting_for(&[channel], now);
            // A change does not wait for late channels.
            self.advance_change(now);
        }
    }

    /// The frames on their way go on without these channels.
    pub(super) fn stop_waiting_for(&mut self, channels: &[ChannelId], now: Micros) {
        if !self.pipeline.is_empty() {
            self.pipeline.stop_waiting_for(channels);
            self.advance_frame(now);
        }
    }

    /// Swaps the oldest frame: all it waited for have drawn, or its deadline has passed.
    pub(super) fn finish_frame(&mut self, now: Micros) {
        let Some(barrier) = self.pipeline.take_oldest(now) else { return };
        for &id in &barrier.waited {
            let waited_ms = barrier.length() / 1000;
            let reason = format!("frame {} was not drawn within {waited_ms} ms", barrier.frame);
            let miss = || self.registry.record_miss(id, now, reason);
            span::frame_span(barrier.frame).in_scope(miss);
        }
        if self.pipeline.is_empty() {
            self.registry.admit_late(now, self.frame);
        }
        let lead_us = self.swap_lead();
        // A server that hangs longer than a frame may take must not show this one any more.
        let swap = Swap {
            epoch: self.epoch,
            frame: barrier.frame,
            not_after_us: now + lead_us + self.deadline.length(),
            present_at_us: (lead_us > 0).then_some(now + lead_us),
        };
        self.command(barrier.sent.clone(), Command::Swap(swap));
        self.swapped = barrier.frame;
        self.end_part_frame(now, barrier.frame);
        let slowest_us = barrier.slowest_us();
        self.learn_from(&barrier, now);
        let feedback = self.aggregate(&barrier, now);
        let is_awaited = !barrier.awaited.is_empty();
        let has_missed = !barrier.waited.is_empty();
        let is_complete = feedback.is_complete();
        let limiting = barrier.limiting_channel(&self.registry);
        let is_ahead = barrier.is_ahead;
        let resolution_steps = barrier.reduction.resolution_steps();
        let facts = FrameFacts {
            is_awaited,
            is_complete,
            is_ahead,
            slowest_us,
            limiting,
            resolution_steps,
        };
        self.gathered.add_frame(&feedback, facts, now);
        let (frame, sent) = (barrier.frame, barrier.sent_channels);
        if let Some(compared) = self.present_calls.swapped(frame, sent, now) {
            self.gathered.add_skews(&compared);
        }
        self.publish(&feedback);
        self.persist_camera(now);
        self.answer_waiters(&feedback);
        match barrier.order {
            Some(FrameRequest { job, wish: Some(_), .. }) => {
                self.persist();
                self.reply(job, Ok(Response::Frame(feedback)));
            }
            Some(FrameRequest { job, capture: None, .. }) => {
                self.reply(job, Ok(Response::Frame(feedback)));
            }
            // A capture is answered with its pictures.
            Some(_) | None => {}
        }
        if has_missed {
            // A change does not wait for late channels.
            self.advance_change(now);
        }
    }

    /// Pictures come as soon as they are drawn, so the collection begins with the frame. A late
    /// channel's picture is collected too: the wall goes on, the picture waits.
    fn collect(&mut self, job: ClientRequest, side: NonZeroU32, sent: &[SessionId]) {
        let was_sent = |server: Option<SessionId>| server.is_some_and(|s| sent.contains(&s));
        let (mut channels, mut missing) = (Vec::new(), Vec::new());
        for (id, channel) in self.registry.channels() {
            let takes_part = matches!(channel.state, ChannelState::Live | ChannelState::Late);
            if takes_part && was_sent(channel.server) {
                channels.push(id);
            } else {
                let reason = channel.reason.clone();
                let reason = reason.unwrap_or_else(|| format!("it is {}", channel.state));
                missing.push((channel.name.clone(), reason));
            }
        }
        self.outputs.push_back(Effect::Collect { job, frame: self.frame, side, channels, missing });
    }
}
