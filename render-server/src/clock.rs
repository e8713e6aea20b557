//! The manager's clock, as a server knows it.
//!
//! Estimated as NTP does (RFC 5905 §8): from the four timestamps of a ping and its pong, offset
//! `((t1 − t0) + (t2 − t3)) / 2`, whose error is at most half of the round trip: as much as when
//! one of both ways took no time. It grows by what two clocks drift apart (§7.3, dispersion). Of
//! the newest samples the one with the least error is believed, and its error reported.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicI64, AtomicU32, Ordering};
use std::time::Instant;

use polyptych_protocol::command::Pong;

/// Samples of which the best is believed: long enough to find an undisturbed round trip.
const SAMPLES: usize = 8;

/// Maximum drift between two clocks, in microseconds per second: the tolerance of RFC 5905 (PHI).
const DRIFT_PPM: u64 = 15;

/// Picks the best of the newest samples.
#[derive(Debug, Default)]
pub struct ClockEstimate {
    samples: VecDeque<Sample>,
}

#[derive(Clone, Copy, Debug)]
struct Sample {
    offset_us: i64,
    round_trip_us: u64,
    /// In microseconds of this server's clock.
    arrived: u64,
}

impl Sample {
    /// Returns the maximum error of the offset at `now_us`, in microseconds.
    fn error_us(&self, now_us: u64) -> u64 {
        let age_us = now_us.saturating_sub(self.arrived);
        self.round_trip_us.div_ceil(2) + (age_us * DRIFT_PPM).div_ceil(1_000_000)
    }
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
        // A manager may say what it likes; a clock that cannot be reckoned with is no sample.
        let offset = |theirs: u64, ours: u64| i64::try_from(i128::from(theirs) - i128::from(ours));
        let (Ok(there), Ok(back)) = (offset(t1, t0), offset(t2, t3)) else { return };
        let offset_us = i64::midpoint(there, back);
        let sample = Sample { offset_us, round_trip_us, arrived: arrived_us };
        // Where both cannot be right, a clock has jumped since: its machine slept, or was moved.
        let agrees = |old: &Sample| {
            let errors_us = sample.error_us(arrived_us) + old.error_us(arrived_us);
            old.offset_us.abs_diff(offset_us) <= errors_us + 1
        };
        self.samples.retain(agrees);
        if self.samples.len() == SAMPLES {
            self.samples.pop_front();
        }
        self.samples.push_back(sample);
    }

    /// Manager time minus this server's at `now_us` of its clock, and how far off that may be,
    /// both in microseconds.
    pub fn best(&self, now_us: u64) -> Option<(i64, u32)> {
        let best = self.samples.iter().min_by_key(|sample| sample.error_us(now_us))?;
        let error_us = u32::try_from(best.error_us(now_us)).unwrap_or(u32::MAX);
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

    /// Returns the maximum error of [`Clock::manager_us`] in microseconds; `u32::MAX` if the
    /// manager's time is unknown.
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
    use proptest::prelude::*;

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
        assert_eq!(estimate.best(0), None);
        for (out_us, back_us) in [(5_000, 100), (60, 40), (100, 9_000)] {
            let (pong, arrived_us) = pong(1_000_000, out_us, back_us, 77);
            estimate.add(&pong, arrived_us);
        }
        assert_eq!(estimate.best(187), Some((1_000_010, 50)));
        // Ten seconds later it may be off by what the clocks have drifted.
        assert_eq!(estimate.best(10_000_177), Some((1_000_010, 200)));
    }

    #[test]
    fn a_clock_that_jumps_is_believed_at_once() {
        let mut estimate = ClockEstimate::default();
        for (offset_us, trip_us, at_us) in
            [(1_000_000, 50, 0), (1_000_000, 900, 500_000), (700_000, 400, 1_000_000)]
        {
            let (pong, arrived_us) = pong(offset_us, trip_us, trip_us, at_us);
            estimate.add(&pong, arrived_us);
        }
        assert_eq!(estimate.best(1_000_810), Some((700_000, 400)));
    }

    #[test]
    fn impossible_timestamps_are_not_taken() {
        let mut estimate = ClockEstimate::default();
        estimate.add(&Pong { sent_us: 10, received_us: 9, answered_us: 5 }, 20);
        estimate.add(&Pong { sent_us: 10, received_us: 5, answered_us: 500 }, 20);
        assert_eq!(estimate.best(20), None);
    }

    #[test]
    fn jitter_that_is_the_same_on_both_ways_makes_no_error() {
        for delay_us in [1, 40, 900, 20_000] {
            let mut estimate = ClockEstimate::default();
            let (pong, arrived_us) = pong(-5_000, delay_us, delay_us, 1_000_000);
            estimate.add(&pong, arrived_us);
            assert_eq!(estimate.best(arrived_us), Some((-5_000, delay_us as u32)));
        }
    }

    proptest! {
        /// A manager whose clock runs up to 15 ppm faster or slower, behind a network whose ways
        /// take as long as they like: the estimate is off by what it says at most, and its error
        /// is little more than half of the best round trip.
        #[test]
        fn the_estimate_is_never_further_off_than_it_says(
            start_us in 0..1_000_000_000_000_u64,
            drift_ppm in -15..=15_i64,
            base_us in (0..2_000_u64, 0..2_000_u64),
            jitters_us in proptest::collection::vec((0..30_000_u64, 0..30_000_u64), 1..60),
            look_after_us in 0..500_000_u64,
        ) {
            let manager_us = |local_us: u64| {
                let drift_us = local_us as i64 * drift_ppm / 1_000_000;
                (start_us + local_us).saturating_add_signed(drift_us)
            };
            let mut estimate = ClockEstimate::default();
            for (n, (out_us, back_us)) in (0_u64..).zip(jitters_us) {
                let sent_us = n * 500_000;
                let there_us = sent_us + base_us.0 + out_us;
                let answered_us = there_us + 3;
                let arrived_us = answered_us + base_us.1 + back_us;
                estimate.add(
                    &Pong {
                        sent_us,
                        received_us: manager_us(there_us),
                        answered_us: manager_us(answered_us),
                    },
                    arrived_us,
                );
                let now_us = arrived_us + look_after_us;
                let (offset_us, error_us) = estimate.best(now_us).expect("a sample");
                let off_us = (manager_us(now_us) as i64 - now_us as i64).abs_diff(offset_us);
                // Each instant is cut to a whole microsecond.
                prop_assert!(off_us <= u64::from(error_us) + 2, "{off_us} > {error_us}");
                let round_trip_us = arrived_us - sent_us;
                prop_assert!(u64::from(error_us) <= round_trip_us / 2 + 10 + 2 * 8);
            }
        }
    }
}
