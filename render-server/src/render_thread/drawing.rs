//! A frame on all channels of this server: all of them are begun, then submitted, then waited for.
//!
//! The GPU draws one channel while the next one is culled, and never waits for this thread between
//! two of them. What others hide is searched for on all channels first, so that no search waits
//! for the frame of another channel.

use std::rc::Rc;
use std::sync::Arc;
use std::time::{Duration, Instant};

use polyptych_protocol::command::Frame;
use polyptych_renderer::{
    BegunFrame, DrawStats, Enlargement, GpuScene, Submission, SubmittedFrame,
};
use polyptych_wall::{ChannelId, Wall};

use super::{Correctors, RenderThread};
use crate::correction::{BegunCorrection, SubmittedCorrection};
use crate::frame_views;
use crate::reduced_grid::ReducedGrid;
use crate::render_event;

/// A channel's part of a frame, on its way.
struct ChannelFrame<S> {
    /// The index of its output.
    index: usize,
    id: ChannelId,
    /// The time in which it was begun; for the first one, since the frame began.
    begin: Duration,
    /// The state of its drawing.
    step: S,
}

/// A frame that is begun.
enum Begun {
    /// It is there already.
    Pattern,
    Plain(BegunFrame),
    /// With fewer pixels: their place in the channel's picture, and its size.
    Reduced(BegunFrame, (Enlargement, [u32; 2])),
    Corrected(BegunCorrection),
}

/// A frame that the GPU draws.
enum Submitted {
    Pattern,
    Plain(SubmittedFrame),
    Reduced(SubmittedFrame, Submission),
    Corrected(SubmittedCorrection),
}

impl<S> ChannelFrame<S> {
    /// Returns this channel, a step further.
    fn with<T>(&self, step: T) -> ChannelFrame<T> {
        ChannelFrame { index: self.index, id: self.id, begin: self.begin, step }
    }
}

impl RenderThread {
    /// Draws a frame on all channels, where its state is here. It may be shown on those that could.
    pub(super) fn draw(&mut self, frame: &Frame) {
        let _span = tracing::error_span!("draw", frame = frame.frame.0).entered();
        self.frame_began = Instant::now();
        if !self.promote(frame.epoch, frame.revision) {
            return;
        }
        if frame.presentation.pattern.is_none() {
            self.patterns.clear();
        }
        let Some(drawable) = self.states.front() else { return };
        let state = Arc::clone(&drawable.state);
        let correctors = Rc::clone(&drawable.correctors);
        let scene = Rc::clone(&drawable.scene);
        let scene = self.scene_at(scene, state.motion.as_deref(), &frame.clips);
        let Some(wall) = state.replica.wall.as_deref() else { return };
        // The first channel's time has that of moving the scene, once for all channels.
        let (mut start, mut begun) = (self.frame_began, Vec::with_capacity(self.outputs.len()));
        let (key, mut is_whole) = ((frame.epoch, frame.frame), true);
        let failed = |this: &Self, id, reason| {
            this.send(render_event::draw_failed(frame.frame, id, reason));
            false
        };
        for index in 0..self.outputs.len() {
            let Some((id, _)) = wall.channel_by_name(&self.outputs[index].name) else { continue };
            if let Some(kind) = self.drawing.slowness.wait() {
                self.gpu.give_up(kind, "it was to be so, for a test");
            }
            match self.begin_channel(index, (wall, id), frame, &scene, &correctors) {
                Ok(step) => begun.push(ChannelFrame { index, id, begin: start.elapsed(), step }),
                Err(reason) => is_whole = failed(self, id, reason),
            }
            start = Instant::now();
        }
        let (mut before, mut submitted) = (Instant::now(), Vec::with_capacity(begun.len()));
        for channel in begun {
            let id = channel.id;
            match self.submit_channel(channel, wall, &scene, &correctors) {
                Ok(channel) => submitted.push(channel),
                Err(reason) => is_whole = failed(self, id, reason),
            }
        }
        for channel in submitted {
            let ChannelFrame { index, id, begin, .. } = channel;
            match self.finish_channel(channel) {
                Ok((stats, done)) => {
                    self.outputs[index].drawn.add(key);
                    // Channels are a pipeline: each adds the time from the end of the one before
                    // to its own, and the times of all are that of the frame.
                    let own = begin + done.saturating_duration_since(before);
                    before = before.max(done);
                    let draw_us = own.as_micros() as u64;
                    self.send(render_event::drawn(frame, id, &state, &stats, draw_us));
                    if let Some(side) = frame.capture {
                        self.send_capture(index, (frame.frame, id), side);
                    }
                }
                Err(reason) => is_whole = failed(self, id, reason),
            }
        }
        // A channel that could not draw must not hold up those that did.
        let is_drawn = is_whole || self.outputs.iter().any(|output| output.drawn.has(key));
        // An ordinary frame may be drawn before a metered one is shown, which it leaves in place.
        if frame.is_metered && is_drawn {
            self.to_meter = Some(Box::new(frame.clone()));
        }
        let (took, now) = (self.frame_began.elapsed(), self.manager_us());
        if is_drawn && let Some(act) = self.playback.frame_drawn(frame, took, now) {
            self.perform(act);
        }
    }

    fn begin_channel(
        &mut self,
        index: usize,
        (wall, id): (&Wall, ChannelId),
        frame: &Frame,
        scene: &GpuScene,
        correctors: &Correctors,
    ) -> Result<Begun, String> {
        let is_linear = scene.needs_light(frame.presentation.effects());
        if let Some(pattern) = frame.presentation.pattern {
            self.draw_pattern(index, (wall, id), frame, pattern, is_linear)?;
            return Ok(Begun::Pattern);
        }
        let channel = wall.channel(id).ok_or("the channel is not on the wall any more")?;
        self.use_wall(wall)?;
        let output = &mut self.outputs[index];
        if let Some(corrector) = correctors.borrow_mut().get_mut(&channel.name) {
            let drawing = (&mut self.renderer, scene);
            let begun = corrector.begin(&self.gpu, drawing, wall, frame, output)?;
            return Ok(Begun::Corrected(begun));
        }
        let views = frame_views::views(wall, id, frame)?;
        let (size, like) = (channel.size.to_array(), (wall.samples, is_linear));
        let steps = frame.detail.resolution_steps;
        if let Some(grid) = ReducedGrid::new(channel, wall.screen_of(channel), steps) {
            let target = output.ensure_reduced_target(&self.gpu, grid.size(1), like)?;
            let begun = self.renderer.begin(&self.gpu, scene, target, &grid.views(&views, 1));
            let place = (grid.enlargement(1), size);
            return begun.map(|it| Begun::Reduced(it, place)).map_err(|error| error.to_string());
        }
        let target = output.ensure_target(&self.gpu, size, like)?;
        let begun = self.renderer.begin(&self.gpu, scene, target, &views);
        begun.map(Begun::Plain).map_err(|error| error.to_string())
    }

    fn submit_channel(
        &mut self,
        channel: ChannelFrame<Begun>,
        wall: &Wall,
        scene: &GpuScene,
        correctors: &Correctors,
    ) -> Result<ChannelFrame<Submitted>, String> {
        let next = channel.with(());
        let output = &mut self.outputs[next.index];
        let submitted = match channel.step {
            Begun::Pattern => Submitted::Pattern,
            Begun::Plain(begun) => {
                let frame = self.renderer.submit(&self.gpu, scene, output.target()?, begun);
                Submitted::Plain(frame.map_err(|error| error.to_string())?)
            }
            Begun::Reduced(begun, place) => {
                let frame = self.renderer.submit(&self.gpu, scene, output.target()?, begun);
                let frame = frame.map_err(|error| error.to_string())?;
                Submitted::Reduced(frame, output.enlarge(&self.gpu, &mut self.renderer, place)?)
            }
            Begun::Corrected(begun) => {
                let name = wall.channel(next.id).map_or("", |channel| &channel.name);
                let mut correctors = correctors.borrow_mut();
                let corrector = correctors.get_mut(name).ok_or("the channel has no correction")?;
                let drawing = (&mut self.renderer, scene);
                Submitted::Corrected(corrector.submit(&self.gpu, drawing, output, begun)?)
            }
        };
        Ok(next.with(submitted))
    }

    /// Waits for a channel. Returns when its picture was there, too.
    fn finish_channel(
        &mut self,
        channel: ChannelFrame<Submitted>,
    ) -> Result<(DrawStats, Instant), String> {
        let output = &mut self.outputs[channel.index];
        let stats = match channel.step {
            Submitted::Pattern => return Ok((DrawStats::default(), Instant::now())),
            Submitted::Plain(frame) => {
                let drawn = self.renderer.finish(&self.gpu, output.target()?, frame);
                drawn.map_err(|error| error.to_string())?
            }
            Submitted::Reduced(frame, enlarged) => {
                let drawn = self.renderer.finish(&self.gpu, output.target()?, frame);
                let mut stats = drawn.map_err(|error| error.to_string())?;
                let enlarged = self.renderer.finish_submission(&self.gpu, &enlarged);
                let enlarged = enlarged.map_err(|error| error.to_string())?;
                stats.gpu_us += enlarged.as_micros() as u64;
                stats
            }
            Submitted::Corrected(frames) => frames.finish(&self.gpu, &mut self.renderer, output)?,
        };
        Ok((stats, self.renderer.done().unwrap_or_else(Instant::now)))
    }
}
