//! The time from a reading to the swap of the first frame that uses it.
//!
//! A frame that began after the answer to a head uses it. The bridge knows when a frame began from
//! its feedback, which names the time from there to the swap; the way of the feedback back to the
//! bridge counts as latency too, so that the number is an upper bound.

use std::collections::VecDeque;

use polyptych_protocol::feedback::Quantiles;

use crate::Micros;

/// Number of latencies that quantiles are of: eight seconds at 120 frames per second.
const LATENCIES_MAX: usize = 1024;

/// Maximum number of heads that wait for their frame; a paused wall shows none of them.
const WAITING_MAX: usize = 16;

/// Latencies of the last heads.
#[derive(Clone, Debug, Default)]
pub(crate) struct LatencyMeter {
    /// The times of readings in heads that the manager has, and of its answers, oldest first.
    waiting: VecDeque<(Micros, Micros)>,
    latencies: VecDeque<Micros>,
}

impl LatencyMeter {
    /// Records that the manager has the head of a reading since `now` at the latest.
    pub fn handle_answer(&mut self, now: Micros, reading: Micros) {
        if self.waiting.len() == WAITING_MAX {
            self.waiting.pop_front();
        }
        self.waiting.push_back((reading, now));
    }

    /// Records the swap of a frame that began `frame_us` microseconds before.
    pub fn handle_swap(&mut self, now: Micros, frame_us: Micros) {
        let began = now.saturating_sub(frame_us);
        let mut used = None;
        while let Some((reading, _)) = self.waiting.pop_front_if(|(_, had)| *had <= began) {
            used = Some(reading);
        }
        if let Some(reading) = used {
            if self.latencies.len() == LATENCIES_MAX {
                self.latencies.pop_front();
            }
            self.latencies.push_back(now.saturating_sub(reading));
        }
    }

    /// Forgets heads whose frames will not come, after a reconnection.
    pub fn forget_waiting(&mut self) {
        self.waiting.clear();
    }

    /// Returns the quantiles in milliseconds.
    pub fn quantiles(&self) -> Quantiles {
        Quantiles::from_samples(self.latencies.iter().map(|of| *of as f64 / 1e3))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_latency_ends_with_the_first_frame_that_began_after_the_answer() {
        let mut meter = LatencyMeter::default();
        meter.handle_answer(1_000, 400);
        meter.handle_swap(11_000, 10_500);
        assert_eq!(meter.quantiles().count, 0, "it had begun before");
        meter.handle_answer(12_000, 11_500);
        meter.handle_swap(22_400, 10_000);
        assert_eq!((meter.quantiles().count, meter.quantiles().max), (1, 10.9));
        meter.handle_swap(32_400, 10_000);
        assert_eq!(meter.quantiles().count, 1, "it is used up");
        for reading in 0..100 {
            meter.handle_answer(40_000, reading);
        }
        assert_eq!(meter.waiting.len(), WAITING_MAX);
        meter.forget_waiting();
        meter.handle_swap(60_000, 1);
        assert_eq!(meter.quantiles().count, 1);
    }
}
