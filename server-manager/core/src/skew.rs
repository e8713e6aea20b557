//! Present-call skew: the present calls of each frame, compared channel by channel.

use std::collections::VecDeque;

use polyptych_protocol::feedback::Skew;
use polyptych_protocol::ids::FrameId;
use polyptych_protocol::server_message::FramePresented;
use polyptych_wall::ChannelId;

use super::Micros;

/// Frames whose present calls are awaited; a report that comes later is not compared.
const FRAMES_COMPARED: usize = 32;

/// Frames over which a channel's skew is given: 17 s at 60 frames per second, so that ten of
/// them are above the 99th percentile.
const SKEW_FRAMES: usize = 1024;

/// By how much a present call may seem to lie before its swap or behind its report, in
/// microseconds: a server's clock is that far off at most, whatever error it claims.
const CLOCK_SLACK_MAX_US: u32 = 20_000;

/// Maximum age of a channel's skew in feedback, as far as [`REFRESHED_AT_ONCE`] allows.
const REFRESH_PERIOD: Micros = 1_000_000;

/// Channels whose quantiles are found anew after one frame, about 5 µs each: a wall of 64 at 60
/// frames per second is through in a quarter of a second, and no frame waits for all of them.
const REFRESHED_AT_ONCE: usize = 4;

/// The present calls of the last frames.
#[derive(Debug, Default)]
pub(super) struct SkewTracker {
    frames: VecDeque<Presented>,
    channels: Vec<SkewWindow>,
    /// Index of the channel that was considered for a refresh last.
    next: usize,
}

/// A frame that was swapped.
#[derive(Debug)]
struct Presented {
    frame: FrameId,
    /// Number of channels that were sent it.
    sent: usize,
    /// The time at which the swap was sent, in manager time.
    at: Micros,
    reports: Vec<FramePresented>,
}

/// The last frames of one channel.
#[derive(Debug, Default)]
struct SkewWindow {
    skews_us: VecDeque<u32>,
    clock_error_us: Option<u32>,
    refreshed: Skew,
    refreshed_at: Option<Micros>,
}

/// The time by which each channel's present call lies behind the first one, in microseconds.
#[derive(Debug, Default, PartialEq)]
pub(super) struct FrameSkew {
    pub skews_us: Vec<(ChannelId, u64)>,
}

impl FrameSkew {
    /// The present calls of one frame, each against the first. Calls that a server could not
    /// date in manager time are left out: they are later or earlier by anything.
    fn of(reports: &[FramePresented]) -> Self {
        let dated = || reports.iter().filter(|shown| shown.clock_error_us != u32::MAX);
        let first = dated().map(|shown| shown.at_us).min().unwrap_or(0);
        Self { skews_us: dated().map(|shown| (shown.channel, shown.at_us - first)).collect() }
    }

    /// From the first to the last present call, where there are two.
    pub fn widest_us(&self) -> Option<u64> {
        let widest = self.skews_us.iter().map(|(_, skew)| *skew).max();
        widest.filter(|_| self.skews_us.len() > 1)
    }
}

impl SkewTracker {
    pub fn new(channels: usize) -> Self {
        let channels = (0..channels).map(|_| SkewWindow::default()).collect();
        Self { frames: VecDeque::new(), channels, next: 0 }
    }

    /// A frame was swapped that so many channels were sent. Gives an older one that is not
    /// waited for any more.
    pub fn swapped(&mut self, frame: FrameId, sent: usize, now: Micros) -> Option<FrameSkew> {
        self.frames.push_back(Presented {
            frame,
            sent,
            at: now,
            reports: Vec::with_capacity(sent),
        });
        let over = (self.frames.len() > FRAMES_COMPARED).then(|| self.frames.pop_front());
        let compared = over.flatten().map(|presented| self.compare(&presented.reports));
        self.refresh(now);
        compared
    }

    /// A channel has shown a frame. Gives the frame's skews once all of its channels have.
    ///
    /// A present call lies between the swap and its report: one that a server dates otherwise is
    /// not compared, since all others would be compared with it.
    pub fn add(&mut self, shown: &FramePresented, now: Micros) -> Option<FrameSkew> {
        let window = self.channels.get_mut(usize::from(shown.channel.0))?;
        window.clock_error_us = Some(shown.clock_error_us).filter(|&error| error != u32::MAX);
        // A report on a frame that has been compared says nothing any more.
        let at = self.frames.iter().rposition(|presented| presented.frame == shown.frame)?;
        let presented = &mut self.frames[at];
        // One report of each channel: who repeats itself speaks for nobody else.
        if presented.reports.iter().any(|report| report.channel == shown.channel) {
            return None;
        }
        let slack = Micros::from(shown.clock_error_us.min(CLOCK_SLACK_MAX_US));
        let possible = presented.at.saturating_sub(slack)..=now + slack;
        let is_dated = possible.contains(&shown.at_us);
        let clock_error_us = if is_dated { shown.clock_error_us } else { u32::MAX };
        presented.reports.push(FramePresented { clock_error_us, ..*shown });
        if presented.reports.len() < presented.sent {
            return None;
        }
        let presented = self.frames.remove(at)?;
        Some(self.compare(&presented.reports))
    }

    /// The frames that wait for reports, but for the newest, whose reports are on their way.
    pub fn settle(&mut self) -> Vec<FrameSkew> {
        let settled = self.frames.len().saturating_sub(1);
        let settled: Vec<Presented> = self.frames.drain(..settled).collect();
        settled.iter().map(|presented| self.compare(&presented.reports)).collect()
    }

    /// Other servers drive these channels from now on, with other clocks.
    pub fn forget(&mut self, channels: &[ChannelId]) {
        for &id in channels {
            if let Some(window) = self.channels.get_mut(usize::from(id.0)) {
                *window = SkewWindow::default();
            }
        }
    }

    /// A channel's skew as it stands, found anew.
    pub fn skew(&self, id: ChannelId) -> Skew {
        self.channels.get(usize::from(id.0)).map_or_else(Skew::default, SkewWindow::skew)
    }

    /// A channel's skew as it was found last.
    pub fn skew_refreshed(&self, id: ChannelId) -> Skew {
        self.channels.get(usize::from(id.0)).map_or_else(Skew::default, |window| window.refreshed)
    }

    fn compare(&mut self, reports: &[FramePresented]) -> FrameSkew {
        let compared = FrameSkew::of(reports);
        for &(id, skew_us) in &compared.skews_us {
            if let Some(window) = self.channels.get_mut(usize::from(id.0)) {
                window.add(u32::try_from(skew_us).unwrap_or(u32::MAX));
            }
        }
        compared
    }

    /// Finds the quantiles of a few channels anew, where they are old.
    fn refresh(&mut self, now: Micros) {
        for _ in 0..REFRESHED_AT_ONCE.min(self.channels.len()) {
            self.next = (self.next + 1) % self.channels.len();
            let window = &mut self.channels[self.next];
            let is_old = |at: Micros| now.saturating_sub(at) >= REFRESH_PERIOD;
            if !window.skews_us.is_empty() && window.refreshed_at.is_none_or(is_old) {
                window.refreshed = window.skew();
                window.refreshed_at = Some(now);
            }
        }
    }
}

impl SkewWindow {
    fn add(&mut self, skew_us: u32) {
        if self.skews_us.len() == SKEW_FRAMES {
            self.skews_us.pop_front();
        }
        self.skews_us.push_back(skew_us);
    }

    fn skew(&self) -> Skew {
        let mut values: Vec<u32> = self.skews_us.iter().copied().collect();
        let max_us = values.iter().copied().max().unwrap_or(0);
        // As `Quantiles::from_samples`: the least value that so many of all do not exceed. Not
        // sorted: this runs between two frames.
        let mut at = |share: f64| {
            let rank = (share * values.len() as f64).ceil() as usize;
            if values.is_empty() { 0 } else { *values.select_nth_unstable(rank.max(1) - 1).1 }
        };
        let (p50_us, p99_us) = (at(0.5), at(0.99));
        let frames = self.skews_us.len() as u32;
        Skew { frames, p50_us, p99_us, max_us, clock_error_us: self.clock_error_us }
    }
}

#[cfg(test)]
mod tests {
    use polyptych_protocol::feedback::Quantiles;
    use polyptych_protocol::ids::Epoch;

    use super::*;

    /// The arrival time of reports in tests where it does not matter.
    const LATER: Micros = 1 << 40;

    fn shown(frame: u64, channel: u16, at_us: u64, clock_error_us: u32) -> FramePresented {
        let (frame, channel) = (FrameId(frame), ChannelId(channel));
        let is_unscheduled = false;
        FramePresented { epoch: Epoch(1), frame, channel, at_us, clock_error_us, is_unscheduled }
    }

    #[test]
    fn quantiles_are_those_of_a_spread_over_the_last_frames() {
        let mut calls = SkewTracker::new(2);
        let mut expected = VecDeque::new();
        for n in 0..1500_u64 {
            let skew = (n * 7919) % 1009;
            expected.push_back(skew as f64);
            calls.swapped(FrameId(n), 2, n * 1000);
            assert_eq!(calls.add(&shown(n, 0, 50_000 * n, 30), LATER), None);
            let compared =
                calls.add(&shown(n, 1, 50_000 * n + skew, 40), LATER).expect("both are here");
            assert_eq!(compared.widest_us(), Some(skew));
        }
        expected.drain(..expected.len() - SKEW_FRAMES);
        let spread = Quantiles::from_samples(expected);
        let skew = calls.skew(ChannelId(1));
        assert_eq!(
            [f64::from(skew.p50_us), f64::from(skew.p99_us), f64::from(skew.max_us)],
            [spread.p50, spread.p99, spread.max]
        );
        assert_eq!((skew.frames, skew.clock_error_us), (SKEW_FRAMES as u32, Some(40)));
        assert_eq!(calls.skew(ChannelId(0)).max_us, 0);
        calls.forget(&[ChannelId(1)]);
        assert_eq!(calls.skew(ChannelId(1)), Skew::default());
    }

    #[test]
    fn a_frame_that_one_channel_never_shows_is_compared_without_it() {
        let mut calls = SkewTracker::new(3);
        calls.swapped(FrameId(1), 3, 0);
        calls.add(&shown(1, 0, 100, 1), LATER);
        calls.add(&shown(1, 2, 350, 1), LATER);
        for n in 2..=FRAMES_COMPARED as u64 {
            assert_eq!(calls.swapped(FrameId(n), 3, 0), None);
        }
        let compared = calls.swapped(FrameId(99), 3, 0).expect("too old");
        assert_eq!(compared.skews_us, [(ChannelId(0), 0), (ChannelId(2), 250)]);
        assert_eq!(calls.add(&shown(1, 1, 9_999, 1), LATER), None, "it was compared already");
        assert_eq!(calls.skew(ChannelId(1)).frames, 0);
    }

    #[test]
    fn a_call_that_is_not_in_manager_time_is_not_compared() {
        let mut calls = SkewTracker::new(2);
        calls.swapped(FrameId(1), 2, 0);
        calls.add(&shown(1, 0, 7, u32::MAX), LATER);
        let compared = calls.add(&shown(1, 1, 1_000_000, 5), LATER).expect("both are here");
        assert_eq!((compared.widest_us(), calls.skew(ChannelId(1)).max_us), (None, 0));
        assert_eq!(calls.skew(ChannelId(0)).clock_error_us, None);
    }

    #[test]
    fn ignores_present_calls_before_their_swap_or_behind_their_report() {
        let mut calls = SkewTracker::new(3);
        for n in 0..100 {
            let swapped = 1_000_000 + n * 20_000;
            calls.swapped(FrameId(n), 3, swapped);
            let lie = if n % 2 == 0 { 0 } else { u64::MAX };
            calls.add(&shown(n, 0, lie, 10), swapped + 3_000);
            calls.add(&shown(n, 1, swapped + 1_000, 10), swapped + 3_000);
            let last = calls.add(&shown(n, 2, swapped + 1_500, u32::MAX - 1), swapped + 3_000);
            assert_eq!(last.and_then(|compared| compared.widest_us()), Some(500));
        }
        assert_eq!(calls.skew(ChannelId(0)).frames, 0, "not compared");
        assert_eq!(calls.skew(ChannelId(1)).max_us, 0);
        assert_eq!(calls.skew(ChannelId(2)).max_us, 500);
    }

    #[test]
    fn quantiles_are_refreshed_once_a_second_and_not_for_all_channels_at_once() {
        let mut calls = SkewTracker::new(64);
        let mut refreshes = 0;
        let mut before: Vec<Option<Micros>> = vec![None; 64];
        for n in 0..180 {
            calls.swapped(FrameId(n), 64, n * 16_667);
            (0..64).for_each(|c| drop(calls.add(&shown(n, c, n * 16_667, 1), LATER)));
            let after: Vec<_> = calls.channels.iter().map(|c| c.refreshed_at).collect();
            let changed = after.iter().zip(&before).filter(|(after, before)| after != before);
            let changed = changed.count();
            assert!(changed <= REFRESHED_AT_ONCE, "{changed} at once");
            refreshes += changed;
            before = after;
        }
        // Three seconds.
        assert!((64 * 2..=64 * 3).contains(&refreshes), "{refreshes} in three seconds");
        assert!((0..64).all(|c| calls.skew_refreshed(ChannelId(c)).frames > 60));
    }
}
