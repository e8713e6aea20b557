//! Frames per second, from frame numbers that are looked at again and again.

use std::collections::VecDeque;

use polyptych_client::WallStatus;

/// What a rate is taken over, in seconds: long enough for a steady number, short enough to see a
/// stall.
const WINDOW_S: f64 = 2.0;

/// What was looked at within the window, and the newest before it.
#[derive(Clone, Debug, Default)]
pub(super) struct Rates {
    looks: VecDeque<RateSample>,
}

#[derive(Clone, Debug)]
struct RateSample {
    at_s: f64,
    frame: u64,
    channels: Vec<u64>,
}

impl Rates {
    /// Notes a status; `at_s` is in seconds of any clock that does not jump.
    pub fn add(&mut self, at_s: f64, status: &WallStatus) {
        let look = RateSample {
            at_s,
            frame: status.frame.0,
            channels: status.channels.iter().map(|channel| channel.frame.0).collect(),
        };
        // A manager that began anew counts anew; so does another wall at the same address.
        let is_other = |last: &RateSample| {
            last.frame > look.frame || last.channels.len() != look.channels.len()
        };
        if self.looks.back().is_some_and(is_other) {
            self.looks.clear();
        }
        self.looks.push_back(look);
        while self.looks.get(1).is_some_and(|second| second.at_s <= at_s - WINDOW_S) {
            self.looks.pop_front();
        }
    }

    /// Of the wall, in frames per second; `None` before there is a second look.
    pub fn wall(&self) -> Option<f64> {
        self.rate(|look| look.frame)
    }

    /// Of the channel with this index.
    pub fn channel(&self, index: usize) -> Option<f64> {
        self.rate(|look| look.channels.get(index).copied().unwrap_or(0))
    }

    fn rate(&self, frame: impl Fn(&RateSample) -> u64) -> Option<f64> {
        let (first, last) = (self.looks.front()?, self.looks.back()?);
        let seconds = last.at_s - first.at_s;
        (seconds > 0.0).then(|| frame(last).saturating_sub(frame(first)) as f64 / seconds)
    }
}

#[cfg(test)]
mod tests {
    use super::super::table::tests::wall;
    use super::*;

    #[test]
    fn a_rate_is_over_the_last_two_seconds_and_begins_anew_with_the_manager() {
        let mut rates = Rates::default();
        let mut status = wall(1);
        let mut look = |at_s: f64, frame: u64, shown: u64| {
            status.frame.0 = frame;
            status.channels[0].frame.0 = shown;
            rates.add(at_s, &status);
            (rates.wall(), rates.channel(0))
        };
        assert_eq!(look(0.0, 100, 100), (None, None));
        assert_eq!(look(1.0, 130, 115), (Some(30.0), Some(15.0)));
        for quarter in 5..=12 {
            look(f64::from(quarter) / 4.0, 130, 115);
        }
        assert_eq!(look(3.25, 130, 115), (Some(0.0), Some(0.0)), "it stands still");
        assert_eq!(look(3.5, 1, 0), (None, None), "another manager");
    }
}
