//! Channels that miss frames: they are late, and waited for again once they have caught up.

use polyptych_protocol::feedback::ChannelState;
use polyptych_protocol::ids::FrameId;
use polyptych_wall::ChannelId;

use super::{ChannelEntry, Registry};
use crate::{Micros, span};

/// Frames in time after which a late channel is waited for again, the first time.
pub(super) const REJOIN_FRAMES_MIN: u32 = 8;

/// Maximum number of frames in time after which a late channel is waited for again. It is reached
/// after many relapses: a channel that keeps failing is waited for ever more rarely. A channel that
/// was in time for as many frames begins with [`REJOIN_FRAMES_MIN`] again: on a wall that runs for
/// weeks every hiccup would otherwise cost seconds.
const REJOIN_FRAMES_MAX: u32 = 512;

/// The reason for which a channel is late that has prepared another state since it became so.
const STILL_BEHIND: &str = "it was late before it prepared this state, and has not caught up";

impl Registry {
    /// A channel missed the deadline of a frame.
    pub fn record_miss(&mut self, id: ChannelId, now: Micros, reason: String) {
        let Some(channel) = self.channels.get_mut(usize::from(id.0)) else { return };
        channel.late += 1;
        channel.in_time = 0;
        if channel.state == ChannelState::Live {
            // A first fault is forgiven quickly, a relapse less so.
            channel.rejoin_frames = channel.next_rejoin_frames;
            channel.next_rejoin_frames = (channel.rejoin_frames * 2).min(REJOIN_FRAMES_MAX);
            channel.is_behind = true;
            self.set_state(id, ChannelState::Late, Some(reason), now);
        }
    }

    /// A channel drew a frame that `began` then, where that is remembered.
    pub fn record_draw(
        &mut self,
        id: ChannelId,
        draw_us: u32,
        now: Micros,
        began: Option<Micros>,
        deadline: Micros,
    ) {
        let Some(channel) = self.channels.get_mut(usize::from(id.0)) else { return };
        channel.draw_us = Some(draw_us);
        channel.frames_drawn = channel.frames_drawn.saturating_add(1);
        // It began when it was sent the frame, or when it was done with the one before.
        let free_at = std::mem::replace(&mut channel.drew_at, now);
        let is_in_time = began.is_some_and(|b| now.saturating_sub(b.max(free_at)) <= deadline);
        channel.in_time = if is_in_time { channel.in_time.saturating_add(1) } else { 0 };
        if channel.in_time >= REJOIN_FRAMES_MAX {
            channel.next_rejoin_frames = REJOIN_FRAMES_MIN;
        }
    }

    /// A channel has prepared the shown state. It is ready; or late, as it was before, where it
    /// still has to catch up: else it would cost the wall a deadline after each edit.
    pub fn set_prepared(&mut self, id: ChannelId, now: Micros) {
        if self.channel(id).is_some_and(|channel| channel.is_behind) {
            self.set_state(id, ChannelState::Late, Some(STILL_BEHIND.to_owned()), now);
        } else {
            self.set_state(id, ChannelState::Ready, None, now);
        }
    }

    /// Channels begin anew, as their server does: they were late for what is over.
    pub fn forgive(&mut self, channels: &[ChannelId]) {
        for id in channels {
            if let Some(channel) = self.channels.get_mut(usize::from(id.0)) {
                channel.is_behind = false;
            }
        }
    }

    /// Channels that could draw are waited for from now on. Between two frames only: a frame does
    /// not wait for those that came while it was drawn.
    pub fn admit_ready(&mut self, now: Micros, frame: FrameId) {
        self.turn_live(now, frame, |channel| channel.state == ChannelState::Ready);
    }

    /// Makes late channels live that have caught up. Between two frames only, as
    /// [`Self::admit_ready`].
    pub fn admit_late(&mut self, now: Micros, frame: FrameId) {
        self.turn_live(now, frame, |channel| {
            channel.state == ChannelState::Late && channel.in_time >= channel.rejoin_frames
        });
    }

    fn turn_live(&mut self, now: Micros, frame: FrameId, may_come: impl Fn(&ChannelEntry) -> bool) {
        let coming = self.channels().filter(|(_, channel)| may_come(channel));
        let coming: Vec<_> = coming.map(|(id, _)| id).collect();
        for id in &coming {
            self.channels[usize::from(id.0)].is_behind = false;
        }
        if !coming.is_empty() {
            let admit = || self.set_states(&coming, ChannelState::Live, None, now);
            span::frame_span(frame).in_scope(admit);
        }
    }

    /// Returns whether a late channel drew its last frame in time.
    pub fn is_catching_up(&self, id: ChannelId) -> bool {
        self.channel(id).is_some_and(|channel| channel.in_time > 0)
    }
}
