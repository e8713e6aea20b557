//! Frames that were sent and not swapped yet: one, or two where the wall file asks for it.
//!
//! ```text
//! depth 0   frame 1 ──> drawn ──> swap 1, frame 2 ──> drawn ──> swap 2, frame 3
//! depth 1   frame 1, frame 2 ──> drawn ──> swap 1, frame 3
//!                             ──> drawn ──> swap 2, frame 4
//! ```
//!
//! They are drawn and swapped in their order. Only the oldest has a deadline; that of the next one
//! counts from the swap before it, since servers draw one frame after the other.

use std::collections::VecDeque;

use polyptych_protocol::ids::FrameId;
use polyptych_wall::ChannelId;
use serde::{Deserialize, Serialize};

use super::barrier::Barrier;
use super::{Cluster, Micros, SessionId};

/// The frames on their way, oldest first.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct Pipeline(VecDeque<Barrier>);

impl Pipeline {
    /// The frame that is swapped next.
    pub fn oldest(&self) -> Option<&Barrier> {
        self.0.front()
    }

    /// The frame that was sent last.
    pub fn newest(&self) -> Option<&Barrier> {
        self.0.back()
    }

    pub fn iter(&self) -> impl Iterator<Item = &Barrier> {
        self.0.iter()
    }

    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub fn frame(&self, frame: FrameId) -> Option<&Barrier> {
        self.0.iter().find(|barrier| barrier.frame == frame)
    }

    pub fn frame_mut(&mut self, frame: FrameId) -> Option<&mut Barrier> {
        self.0.iter_mut().find(|barrier| barrier.frame == frame)
    }

    pub fn push(&mut self, barrier: Barrier) {
        self.0.push_back(barrier);
    }

    /// Takes the oldest frame out. The deadline of the next one counts from `now`. Channels that
    /// the oldest waited for in vain are late, and the next one does not wait for them either:
    /// they cost the wall one deadline and not two.
    pub fn take_oldest(&mut self, now: Micros) -> Option<Barrier> {
        let barrier = self.0.pop_front()?;
        for other in &mut self.0 {
            other.give_up(&barrier.waited);
        }
        if let Some(next) = self.0.front_mut() {
            next.turn = now;
        }
        Some(barrier)
    }

    /// No frame waits for these channels any more.
    pub fn stop_waiting_for(&mut self, channels: &[ChannelId]) {
        for barrier in &mut self.0 {
            barrier.waited.retain(|id| !channels.contains(id));
        }
    }

    /// Another scene is shown from the next frame on.
    pub fn end_scene(&mut self) {
        for barrier in &mut self.0 {
            barrier.is_past = true;
        }
    }

    /// This server is to show none of the frames.
    pub fn exclude(&mut self, session: SessionId) {
        for barrier in &mut self.0 {
            barrier.exclude(session);
        }
    }
}

impl Cluster {
    /// Returns whether a frame may begin now.
    ///
    /// Beside another one it may if the pipeline is deep enough and both are ordinary. A capture
    /// has the wall for itself, before and behind: reading pictures back holds up the render
    /// threads, and a frame that waits so long would make the next one late. So has a frame that
    /// warms channels up, and one of a wall that is late as a whole: what they are to find out is
    /// how long one frame takes. One whose camera is not known yet waits until it is.
    pub(super) fn may_begin(&self) -> bool {
        if self.awaits_place() {
            return false;
        }
        let Some(newest) = self.pipeline.newest() else { return true };
        let is_capture = self.orders.front().is_some_and(|order| order.capture.is_some());
        let room = self.wall.sync.pipeline_depth as usize >= self.pipeline.0.len();
        room && !is_capture && newest.is_ordinary()
    }

    /// Returns whether a frame must begin before its beat. Previews wait for the beat.
    pub(super) fn is_asked_for_a_frame(&self) -> bool {
        let is_quick = self.pacer.is_quick();
        self.wants_frame || self.orders.iter().any(|order| !(order.is_preview && is_quick))
    }
}
