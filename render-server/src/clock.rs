//! The manager's clock, as a server knows it.
//!
//! Estimated as NTP does (RFC 5905 §8): from the four timestamps of a ping and its pong, offset
//! `((t1 − t0) + (t2 − t3)) / 2`; of the newest samples the one with the shortest round trip is
//! believed, since its error is at most half of that.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicI64, AtomicU32, Ordering};
use std::time::Instant;

use polyptych_protocol::command::Pong;

/// Samples of which the best is believed: short enough to follow the drift of a quartz (20 ppm:
/// 80 µs in 4 s), long enough to find an undisturbed round trip.
const SAMPLES: usize = 8;

/// Picks the best of the newest samples.
#[derive(Debug, Default)]
pub struct ClockEstimate {
    samples: VecDeque<Sample>,
}

#[derive(Clone, Copy, Debug)]
struct Sample {
    offset_us: i64,
    round_trip_us: u64,
}

impl ClockEstimate {
    /// A pong arrived at `arrived_us` of this server's clock.
    pub fn add(&mut self, pong: &Pong, arrived_us: u64) {
        let [t0, t1, t2, t3] = [pong.sent_us, pong.received_us, pong.answered_us, arrived_us];
        let Some(round_trip_us) =
            t3.checked_sub(t0).and_then(|trip| trip.checked_sub(t2.checked_sub(t1)?))
        else {
            return;
        };
        let offset_us = i64::midpoint(t1 as i64 - t0 as i64, t2 as i64 - t3 as i64);
        if self.samples.len() == SAMPLES {
            self.samples.pop_front();
        }
        self.samples.push_back(Sample { offset_us, round_trip_us });
    }

    /// Manager time minus this server's, and how far off that may be, both in microseconds.
    pub fn best(&self) -> Option<(i64, u32)> {
        let best = self.samples.iter().min_by_key(|sample| sample.round_trip_us)?;
        let error_us = u32::try_from(best.round_trip_us.div_ceil(2)).unwrap_or(u32::MAX);
        Some((best.offset_us, error_us))
    }
}

/// This server's clock, and through it the manager's; shared by its threads.
#[derive(Debug)]
pub struct Clock {
    started: Instant,
    offset_us: AtomicI64,
    error_us: AtomicU32,
}

impl Default for Clock {
    fn default() -> Self {
        Self {
            started: Instant::now(),
            offset_us: AtomicI64::new(0),
            error_us: AtomicU32::new(u32::MAX),
        }
    }
}

impl Clock {
    /// Microseconds since this server started.
    pub fn local_us(&self) -> u64 {
        self.started.elapsed().as_micros() as u64
    }

    /// Microseconds of manager time, as far as it is known.
    pub fn manager_us(&self) -> u64 {
        let offset_us = self.offset_us.load(Ordering::Relaxed);
        (self.local_us() as i64).saturating_add(offset_us).max(0) as u64
    }

    /// How far off [`Clock::manager_us`] may be; `u32::MAX` where the manager's time is unknown.
    pub fn error_us(&self) -> u32 {
        self.error_us.load(Ordering::Relaxed)
    }

    /// A new estimate, or none: another manager has another clock.
    pub fn set(&self, estimate: Option<(i64, u32)>) {
        let (offset_us, error_us) = estimate.unwrap_or((0, u32::MAX));
        self.offset_us.store(offset_us, Ordering::Relaxed);
        self.error_us.store(error_us, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pong(offset_us: i64, out_us: u64, back_us: u64, at_us: u64) -> (Pong, u64) {
        let received_us = (at_us + out_us).wrapping_add_signed(offset_us);
        let answered_us = received_us + 10;
        let pong = Pong { sent_us: at_us, received_us, answered_us };
        (pong, at_us + out_us + 10 + back_us)
    }

    #[test]
    fn the_shortest_round_trip_is_believed() {
        let mut estimate = ClockEstimate::default();
        assert_eq!(estimate.best(), None);
        for (out_us, back_us) in [(5_000, 100), (60, 40), (100, 9_000)] {
            let (pong, arrived_us) = pong(1_000_000, out_us, back_us, 77);
            estimate.add(&pong, arrived_us);
        }
        assert_eq!(estimate.best(), Some((1_000_010, 50)));
    }

    #[test]
    fn impossible_timestamps_are_not_taken() {
        let mut estimate = ClockEstimate::default();
        estimate.add(&Pong { sent_us: 10, received_us: 9, answered_us: 5 }, 20);
        estimate.add(&Pong { sent_us: 10, received_us: 5, answered_us: 500 }, 20);
        assert_eq!(estimate.best(), None);
    }
}
