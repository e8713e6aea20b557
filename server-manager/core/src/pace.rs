//! The wall's own pace: when the next frame begins, if the wall draws by itself.

use polyptych_protocol::request::Pacing;
use serde::{Deserialize, Serialize};

use super::frame_request::FrameRequest;
use super::{Cluster, Micros};

/// Maximum time that a request waits for a frame of the wall's own pace. Where that is slower, the
/// request gets a frame of its own.
pub(super) const BEAT_WAIT_MAX: Micros = 1_000_000;

/// The wall's own pace.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct Pacer {
    pace: Option<Pacing>,
    next: Micros,
    /// Scene time in seconds of the last frame on the wall's own clock, for which no client gave a
    /// time.
    pub own_s: f64,
}

impl Pacer {
    pub fn set(&mut self, pace: Option<Pacing>, now: Micros) {
        self.pace = pace;
        self.next = now;
    }

    pub fn pace(&self) -> Option<Pacing> {
        self.pace
    }

    pub fn next_start(&self) -> Option<Micros> {
        self.pace.map(|_| self.next)
    }

    /// Returns whether a frame begins by itself within [`BEAT_WAIT_MAX`].
    pub fn is_soon(&self, now: Micros) -> bool {
        self.next_start().is_some_and(|next| next <= now.saturating_add(BEAT_WAIT_MAX))
    }

    /// Returns whether frames begin by themselves at least once in [`BEAT_WAIT_MAX`].
    pub fn is_quick(&self) -> bool {
        match self.pace {
            None => false,
            Some(Pacing::Free) => true,
            Some(Pacing::Rate(rate)) => 1e6 / rate <= BEAT_WAIT_MAX as f64,
        }
    }

    pub fn is_due(&self, now: Micros) -> bool {
        self.pace.is_some() && now >= self.next
    }

    /// A frame began at `now`. `is_awaited` says whether any channel is: without one, a free
    /// pace would spin.
    pub fn frame_started(&mut self, now: Micros, is_awaited: bool) {
        /// The period of a free pace while no channel is waited for.
        const IDLE_PERIOD: Micros = 20_000;
        let period = match self.pace {
            None => return,
            Some(Pacing::Free) if is_awaited => 0,
            Some(Pacing::Free) => IDLE_PERIOD,
            Some(Pacing::Rate(rate)) => (1e6 / rate) as Micros,
        };
        // A frame that was ordered long before its beat does not stand for it.
        // Nor does one more than a beat before: of many frames at once only one stands for it.
        if !self.is_soon(now) || self.next > now.saturating_add(period) {
            return;
        }
        // A wall that cannot keep the rate drops beats; it does not hurry afterwards.
        self.next = if self.next + 2 * period > now { self.next + period } else { now + period };
        self.next = self.next.max(now.saturating_sub(period));
    }
}

impl Cluster {
    /// Scene time of the frame that begins: of one that nobody has ordered, that of the last one.
    pub(super) fn time_of(&mut self, order: Option<&FrameRequest>, now: Micros) -> f64 {
        if self.is_timed(order) || self.frame.0 <= 1 {
            let given_s = order.and_then(|order| order.time_s);
            if given_s.is_none() {
                self.pacer.own_s = now as f64 * 1e-6;
            }
            self.time_s = given_s.unwrap_or(self.pacer.own_s);
        }
        self.time_s
    }

    /// Returns whether scene time goes on with a frame: it is asked for, or comes by itself. What a
    /// paused wall shows in another output mode or light, or with a pattern, stays as it was.
    pub(super) fn is_timed(&self, order: Option<&FrameRequest>) -> bool {
        order.is_some_and(|order| !order.keeps_time) || self.pacer.pace().is_some()
    }

    /// Lets the wall draw by itself, or not. A pause moves nothing: tours and clips go on from the
    /// last frame on the wall's own clock, which a client may have asked for meanwhile.
    pub(super) fn set_pace(&mut self, pace: Option<Pacing>, now: Micros) {
        self.is_going_on = false;
        if self.pacer.pace().is_none() && pace.is_some() {
            self.tour = self.remembered_tour();
            self.clips = self.remembered_clips();
            self.resume_following();
        }
        self.pacer.set(pace, now);
        // The frame that a tuning waits for would have come by itself.
        let drawing = self.pipeline.newest().map(|barrier| barrier.revision);
        self.wants_frame |= !self.pacer.is_soon(now)
            && (self.tuners.wait_beyond(drawing) || self.editing.wait_beyond(drawing));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_keeps_its_beat_and_drops_what_it_missed() {
        let mut pacer = Pacer::default();
        assert!(!pacer.is_due(5));
        pacer.set(Some(Pacing::Rate(100.0)), 1_000);
        assert!(pacer.is_due(1_000));
        pacer.frame_started(1_500, true);
        assert_eq!(pacer.next_start(), Some(11_000));
        pacer.frame_started(500_000, true);
        assert_eq!(pacer.next_start(), Some(510_000));
        pacer.set(None, 0);
        assert_eq!(pacer.next_start(), None);
    }

    #[test]
    fn a_frame_long_before_a_slow_beat_does_not_move_it() {
        let mut pacer = Pacer::default();
        pacer.set(Some(Pacing::Rate(0.02)), 0);
        pacer.frame_started(0, true);
        assert_eq!((pacer.next_start(), pacer.is_soon(0)), (Some(50_000_000), false));
        pacer.frame_started(10_000_000, true);
        assert_eq!(pacer.next_start(), Some(50_000_000));
        assert!(pacer.is_soon(49_000_000));
        pacer.frame_started(49_500_000, true);
        assert_eq!(pacer.next_start(), Some(100_000_000), "this one stands for it");
    }

    #[test]
    fn of_many_frames_at_once_one_stands_for_the_next_beat() {
        let mut pacer = Pacer::default();
        pacer.set(Some(Pacing::Rate(10.0)), 0);
        for now in 0..40 {
            pacer.frame_started(now * 1_000, true);
        }
        assert_eq!(pacer.next_start(), Some(200_000));
        pacer.frame_started(200_000, true);
        assert_eq!(pacer.next_start(), Some(300_000));
    }
}
