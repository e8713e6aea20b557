//! The time that a frame waits: a multiple of the usual drawing time of the wall's channels.

use std::collections::VecDeque;

use polyptych_protocol::server_message::FrameRendered;
use polyptych_wall::DeadlinePolicy;
use serde::{Deserialize, Serialize};

use super::barrier::Barrier;
use super::{Cluster, Micros};

/// Frames that the median is taken over: about two seconds of a fast wall.
const FRAMES_REMEMBERED: usize = 64;

/// The wall's adaptive deadline.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Deadline {
    rule: DeadlinePolicy,
    draws_us: VecDeque<u32>,
}

impl Deadline {
    pub fn new(rule: DeadlinePolicy) -> Self {
        Self { rule, draws_us: VecDeque::new() }
    }

    /// Notes the slowest waited-for channel's time of a frame.
    pub fn add(&mut self, draw_us: u32) {
        if self.draws_us.len() == FRAMES_REMEMBERED {
            self.draws_us.pop_front();
        }
        self.draws_us.push_back(draw_us);
    }

    /// Forgets: another scene takes another time.
    pub fn restart(&mut self) {
        self.draws_us.clear();
    }

    /// The longest that any frame waits.
    pub fn longest(&self) -> Micros {
        Micros::from(self.rule.max_ms) * 1000
    }

    /// Returns the time that the next frame waits; the longest allowed if nothing was measured yet.
    pub fn length(&self) -> Micros {
        let mut sorted: Vec<u32> = self.draws_us.iter().copied().collect();
        if sorted.is_empty() {
            return self.longest();
        }
        sorted.sort_unstable();
        let median = f64::from(sorted[sorted.len() / 2]);
        let wanted = (median * self.rule.factor) as Micros;
        wanted.clamp(Micros::from(self.rule.min_ms) * 1000, self.longest())
    }
}

impl Cluster {
    /// Returns the time from a swap command to the instant at which servers show its frame.
    pub(super) fn swap_lead(&self) -> Micros {
        Micros::from(self.wall.sync.swap_lead_ms) * 1000
    }

    /// Returns the part of each frame's period in which servers draw nothing, in microseconds: they
    /// hold a drawn frame until its instant. At a pipeline depth of 1 they draw two frames one
    /// after the other before the first one's instant, so that both wait for one lead.
    pub(super) fn undrawn_time(&self) -> Micros {
        self.swap_lead() / (1 + Micros::from(self.wall.sync.pipeline_depth))
    }

    /// Returns the time that the next frame waits, and the longest that any does. Servers draw
    /// nothing before the instant at which they show the frame before, so both count from there.
    pub(super) fn frame_waits(&self) -> (Micros, Micros) {
        let lead = self.swap_lead();
        (self.deadline.length() + lead, self.deadline.longest() + lead)
    }

    /// A channel has drawn a frame of a state before the one that is shown. It was in time all the
    /// same: where a program edits at each frame, a late channel would never be so otherwise.
    pub(super) fn record_past_draw(&mut self, now: Micros, drawn: &FrameRendered) {
        let began = self.beginnings.of(drawn.frame, self.frame).map(|(began, _)| began);
        if began.is_some() && drawn.revision < self.shown.revision {
            let (length, _) = self.frame_waits();
            self.registry.record_draw(drawn.channel, drawn.draw_us, now, began, length);
        }
    }

    /// Takes the times of a frame that ends, for the deadline and the rate bound. A test pattern
    /// only lengthens the deadline, where it takes longer than that: most are drawn in no time,
    /// and the first frames of the scene behind them would all be late.
    pub(super) fn learn_from(&mut self, barrier: &Barrier, now: Micros) {
        if barrier.is_past {
            return;
        }
        let least_us = if barrier.is_pattern { self.deadline.length() } else { 0 };
        let typical_us = barrier.typical_slowest_us();
        if let Some(us) = typical_us.filter(|us| Micros::from(*us) >= least_us) {
            self.deadline.add(us);
        }
        if barrier.is_untypical || barrier.is_pattern {
            return;
        }
        // One that was not waited for any longer took as long as that.
        let missed_us = now.saturating_sub(barrier.turn + self.swap_lead());
        let missed_us = (!barrier.waited.is_empty()).then_some(missed_us);
        if let Some(us) = barrier.slowest_untried_us().map(Micros::from).max(missed_us) {
            let (bounds, undrawn_us) = (&self.presentation.bounds, self.undrawn_time());
            self.rate_bound.add(bounds, us, undrawn_us, barrier.reduction);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_follows_the_median_within_its_bounds() {
        let mut deadline = Deadline::new(DeadlinePolicy { factor: 4.0, min_ms: 50, max_ms: 2000 });
        assert_eq!(deadline.length(), 2_000_000);
        for draw_us in [20_000, 21_000, 900_000] {
            deadline.add(draw_us);
        }
        assert_eq!(deadline.length(), 84_000);
        for _ in 0..64 {
            deadline.add(1_000);
        }
        assert_eq!(deadline.length(), 50_000);
        for _ in 0..64 {
            deadline.add(1_000_000);
        }
        assert_eq!(deadline.length(), 2_000_000);
    }
}
