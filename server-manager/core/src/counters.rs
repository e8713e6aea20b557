//! Totals since the manager started: they only grow, so that whoever looks from time to time sees
//! rates.
//!
//! The statistics of [`super::statistics`] are for one who measures: exact, and forgotten when a
//! client says so. These are for one who watches, and cost a few additions a frame.

use super::statistics::FrameFacts;

/// Upper bounds of frame times and drawing times, in seconds: the periods of 120, 80, 60, 48, 40,
/// 30, 24, 20 and 15 frames per second, a little above each, so that a wall that holds its rate
/// stays below it; then what people see as a stall, up to the longest deadline of most walls.
const FRAME_BOUNDS_S: &[f64] = &[
    0.001, 0.002, 0.004, 0.0085, 0.0125, 0.017, 0.021, 0.0255, 0.034, 0.042, 0.051, 0.068, 0.1,
    0.2, 0.5, 1.0, 2.0,
];

/// Upper bounds of the barrier's cost and of skew, in seconds: from what loopback takes to what
/// every eye sees.
const BARRIER_BOUNDS_S: &[f64] =
    &[0.00005, 0.0001, 0.0002, 0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.5];

/// A histogram of measurements, with an upper bound for each bucket.
#[derive(Clone, Debug, PartialEq)]
pub struct Histogram {
    bounds: &'static [f64],
    /// One for each bound, and the last for all above.
    counts: Vec<u64>,
    sum: f64,
}

impl Histogram {
    fn new(bounds: &'static [f64]) -> Self {
        Self { bounds, counts: vec![0; bounds.len() + 1], sum: 0.0 }
    }

    fn add(&mut self, value: f64) {
        let at = self.bounds.partition_point(|&bound| bound < value);
        self.counts[at] += 1;
        self.sum += value;
    }

    /// Upper bounds and what lies between each and the one before; the last bound is infinite.
    pub fn buckets(&self) -> impl Iterator<Item = (f64, u64)> {
        let bounds = self.bounds.iter().copied().chain([f64::INFINITY]);
        bounds.zip(self.counts.iter().copied())
    }

    /// All measurements together.
    pub fn sum(&self) -> f64 {
        self.sum
    }

    /// Returns the number of measurements.
    pub fn count(&self) -> u64 {
        self.counts.iter().sum()
    }
}

/// Totals of one channel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ChannelCounters {
    /// Frames shown.
    pub frames: u64,
    /// Frames drawn, those that came after the swap too.
    pub drawn: u64,
    /// Spent on drawing those, in seconds.
    pub draw_s: f64,
    /// Frames whose present call was compared with the other channels'.
    pub compared: u64,
    /// By how much it presented those after the first channel, in seconds.
    pub skew_s: f64,
}

/// Totals of the wall.
#[derive(Clone, Debug, PartialEq)]
pub struct Counters {
    /// Frames swapped.
    pub frames: u64,
    /// Frames that every channel of the wall had drawn when they were swapped.
    pub complete: u64,
    /// From frame command to swap command, in seconds.
    pub frame_s: Histogram,
    /// The part of a frame's time in which its slowest channel did not draw, in seconds.
    pub barrier_s: Histogram,
    /// The slowest waited-for channel's own drawing time, in seconds.
    pub draw_s: Histogram,
    /// From the first to the last channel's present call of a frame, in seconds.
    pub skew_s: Histogram,
    /// In the wall's order.
    pub channels: Vec<ChannelCounters>,
}

impl Default for Counters {
    fn default() -> Self {
        Self::new(0)
    }
}

impl Counters {
    pub(super) fn new(channels: usize) -> Self {
        Self {
            frames: 0,
            complete: 0,
            frame_s: Histogram::new(FRAME_BOUNDS_S),
            barrier_s: Histogram::new(BARRIER_BOUNDS_S),
            draw_s: Histogram::new(FRAME_BOUNDS_S),
            skew_s: Histogram::new(BARRIER_BOUNDS_S),
            channels: vec![ChannelCounters::default(); channels],
        }
    }

    pub(super) fn add_frame(&mut self, frame_us: u64, barrier_us: u64, facts: FrameFacts) {
        self.frames += 1;
        self.complete += u64::from(facts.is_complete);
        // As in the statistics: a deadline that passed counts, a frame without channels does not.
        if facts.is_awaited {
            self.frame_s.add(frame_us as f64 * 1e-6);
        }
        if let Some(draw_us) = facts.slowest_us {
            self.barrier_s.add(barrier_us as f64 * 1e-6);
            self.draw_s.add(f64::from(draw_us) * 1e-6);
        }
    }

    pub(super) fn add_drawn(&mut self, channel: usize, draw_us: u32) {
        if let Some(channel) = self.channels.get_mut(channel) {
            channel.drawn += 1;
            channel.draw_s += f64::from(draw_us) * 1e-6;
        }
    }

    pub(super) fn add_shown(&mut self, channel: usize) {
        if let Some(channel) = self.channels.get_mut(channel) {
            channel.frames += 1;
        }
    }

    pub(super) fn add_skew(&mut self, channel: usize, skew_us: u64) {
        if let Some(channel) = self.channels.get_mut(channel) {
            channel.compared += 1;
            channel.skew_s += skew_us as f64 * 1e-6;
        }
    }

    pub(super) fn add_widest_skew(&mut self, skew_us: u64) {
        self.skew_s.add(skew_us as f64 * 1e-6);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_lies_in_the_first_bucket_that_is_not_below_it() {
        let mut histogram = Histogram::new(&[1.0, 2.0, 4.0]);
        for value in [0.0, 1.0, 1.5, 2.0, 4.0, 5.0, 1e9] {
            histogram.add(value);
        }
        let buckets: Vec<_> = histogram.buckets().collect();
        assert_eq!(buckets, [(1.0, 2), (2.0, 2), (4.0, 1), (f64::INFINITY, 2)]);
        assert_eq!(histogram.count(), 7);
        assert!((histogram.sum() - 1_000_000_013.5).abs() < 1e-3);
    }

    #[test]
    fn bounds_are_in_order() {
        for bounds in [FRAME_BOUNDS_S, BARRIER_BOUNDS_S] {
            assert!(bounds.is_sorted_by(|a, b| a < b), "{bounds:?}");
        }
    }
}
