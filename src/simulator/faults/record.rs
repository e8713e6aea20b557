//! Records of the effects of faults on a wall, from the feedback of its frames.

use std::time::{Duration, Instant};

use polyptych_client::{ChannelFeedback, ChannelState, FrameFeedback};
use serde::{Serialize, Serializer};

/// Faults that are recorded; a run of a million frames with one every hundred has as many.
const RECORDED_MAX: usize = 10_000;

/// Minimum time for which the other channels are watched: any effect of a fault on them comes
/// within it.
const WATCH_MIN: Duration = Duration::from_secs(1);

/// The effects of one fault. Times are in milliseconds since it happened, measured where frames are
/// requested: an event is as exact as the frame that reports it.
#[derive(Debug, Serialize)]
pub(crate) struct FaultRecord {
    /// The frame of the run behind which it happened, the first being 1.
    pub frame: u64,
    /// The fault as it was written, without frame and channel.
    pub what: String,
    /// The channel that was hit.
    pub channel: String,
    /// Why it was not done, where it could not be.
    pub skipped: Option<String>,
    /// The time at which it ended by itself: the process was restarted or continued, or its time
    /// was over.
    #[serde(serialize_with = "millis")]
    pub over_ms: Option<Duration>,
    /// The time at which the channel first drew a frame in time again; 0 if it always did.
    #[serde(serialize_with = "millis")]
    pub drew_again_ms: Option<Duration>,
    /// The time at which the channel was live again; 0 if it always was, `null` if it never was, or
    /// if the run ended before that was known.
    #[serde(serialize_with = "millis")]
    pub live_again_ms: Option<Duration>,
    /// The states that the channel went through, as far as frames saw them.
    pub states: Vec<ChannelState>,
    /// The wall's frame deadline when it happened.
    pub deadline_ms: f64,
    /// Deadlines that channels of other servers missed until this one was live again.
    pub others_late: u64,
    /// The longest time between two present calls of another server's channel, meanwhile.
    #[serde(rename = "others_longest_gap_ms", serialize_with = "millis_of")]
    pub others_longest_gap: Duration,
}

impl FaultRecord {
    /// A frame has ended, and this is what a channel of another server did.
    fn note_other(&mut self, channel: &WatchedChannel, of: &ChannelFeedback, now: Instant) {
        let gap = match (channel.shown_at_us, of.shown_at_us) {
            (Some(before), Some(at)) if at > before => Duration::from_micros(at - before),
            // A gap that is still open counts as far as it has come.
            _ => now.saturating_duration_since(channel.heard),
        };
        self.others_longest_gap = self.others_longest_gap.max(gap);
        let is_miss = channel.state == ChannelState::Live && of.state == ChannelState::Late;
        self.others_late += u64::from(is_miss);
    }

    /// For people.
    pub fn line(&self) -> String {
        let Self { frame, what, channel, .. } = self;
        let head = format!("fault at frame {frame}, {what} {channel}");
        if let Some(reason) = &self.skipped {
            return format!("{head}: not done, {reason}");
        }
        let ms = |time: Duration| time.as_secs_f64() * 1000.0;
        let back = match self.live_again_ms {
            None if self.states == [ChannelState::Live] => "live until the run ended".to_owned(),
            None => format!("not live again; it went through {:?}", self.states).to_lowercase(),
            Some(Duration::ZERO) => "live all the time".to_owned(),
            Some(time) => format!("live again after {:.0} ms", ms(time)),
        };
        let (late, gap) = (self.others_late, ms(self.others_longest_gap));
        format!("{head}: {back}; the others: late {late}, longest gap {gap:.0} ms")
    }
}

fn millis_of<S: Serializer>(time: &Duration, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_f64((time.as_secs_f64() * 1e6).round() / 1e3)
}

#[expect(clippy::ref_option, reason = "serde gives a field as a reference")]
fn millis<S: Serializer>(time: &Option<Duration>, to: S) -> Result<S::Ok, S::Error> {
    match time {
        None => to.serialize_none(),
        Some(time) => millis_of(time, to),
    }
}

/// A fault as it happens.
#[derive(Debug)]
pub(crate) struct FaultEvent {
    pub frame: u64,
    pub what: String,
    /// Its place on the wall.
    pub channel: usize,
    pub skipped: Option<String>,
    pub deadline_ms: f64,
    pub end: FaultEnd,
}

/// The end of a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FaultEnd {
    /// At once: what follows is its consequence.
    AtOnce,
    /// After this time.
    After(Duration),
    /// At this restart of the process, counted over the whole run.
    Restart(u64),
    /// Not before the run does.
    Never,
}

/// Watches a wall frame by frame.
#[derive(Debug)]
pub(crate) struct FaultRecorder {
    channels: Vec<WatchedChannel>,
    records: Vec<FaultRecord>,
    watched: Vec<ActiveFault>,
    /// Faults beyond [`RECORDED_MAX`].
    pub unrecorded: u64,
}

#[derive(Debug)]
struct WatchedChannel {
    name: String,
    server: String,
    state: ChannelState,
    /// Its last present call in manager time, and when that was heard of.
    shown_at_us: Option<u64>,
    heard: Instant,
}

/// A fault whose consequences are not over.
#[derive(Debug)]
struct ActiveFault {
    record: usize,
    channel: usize,
    since: Instant,
    end: FaultEnd,
    has_missed: bool,
    has_left: bool,
}

impl FaultRecorder {
    /// For a wall of these channels, each with its server.
    pub fn new(channels: impl Iterator<Item = (String, String)>, now: Instant) -> Self {
        let watched = |(name, server)| WatchedChannel {
            name,
            server,
            state: ChannelState::Live,
            shown_at_us: None,
            heard: now,
        };
        let channels = channels.map(watched).collect();
        Self { channels, records: Vec::new(), watched: Vec::new(), unrecorded: 0 }
    }

    /// A fault has just happened.
    pub fn add(&mut self, happened: FaultEvent, now: Instant) {
        if self.records.len() == RECORDED_MAX {
            self.unrecorded += 1;
            return;
        }
        let FaultEvent { frame, what, channel, skipped, deadline_ms, end } = happened;
        if skipped.is_none() {
            self.watched.push(ActiveFault {
                record: self.records.len(),
                channel,
                since: now,
                end,
                has_missed: false,
                has_left: false,
            });
        }
        self.records.push(FaultRecord {
            frame,
            what,
            channel: self.channels[channel].name.clone(),
            skipped,
            over_ms: None,
            drew_again_ms: None,
            live_again_ms: None,
            states: vec![self.channels[channel].state],
            deadline_ms,
            others_late: 0,
            others_longest_gap: Duration::ZERO,
        });
    }

    /// A frame has ended. `restarts` gives how often a server's process was started again.
    pub fn note(&mut self, feedback: &FrameFeedback, restarts: &dyn Fn(&str) -> u64, now: Instant) {
        let Self { channels, records, watched, .. } = self;
        watched.retain_mut(|fault| {
            let record = &mut records[fault.record];
            let server = channels[fault.channel].server.clone();
            for (channel, of) in channels.iter().zip(&feedback.channels) {
                if channel.server != server {
                    record.note_other(channel, of, now);
                }
            }
            let Some(own) = feedback.channels.get(fault.channel) else { return false };
            fault.note_own(record, own.state, own.draw_us.is_some(), restarts(&server), now)
        });
        for (channel, of) in channels.iter_mut().zip(&feedback.channels) {
            channel.state = of.state;
            if of.shown_at_us > channel.shown_at_us {
                (channel.shown_at_us, channel.heard) = (of.shown_at_us, now);
            }
        }
    }

    /// Returns the records of all faults, once the run is over.
    pub fn finish(self) -> Vec<FaultRecord> {
        self.records
    }
}

impl ActiveFault {
    /// Notes how the channel that was hit does; `false` once there is no more to see.
    fn note_own(
        &mut self,
        record: &mut FaultRecord,
        state: ChannelState,
        has_drawn: bool,
        restarts: u64,
        now: Instant,
    ) -> bool {
        let age = now.saturating_duration_since(self.since);
        let over = match self.end {
            FaultEnd::AtOnce => Some(Duration::ZERO),
            FaultEnd::After(length) => Some(length).filter(|&length| age >= length),
            FaultEnd::Restart(number) => Some(age).filter(|_| restarts >= number),
            FaultEnd::Never => None,
        };
        record.over_ms = record.over_ms.or(over);
        let is_over = record.over_ms.is_some();
        if record.states.last() != Some(&state) && record.states.len() < STATES_MAX {
            record.states.push(state);
        }
        self.has_missed |= !has_drawn;
        self.has_left |= state != ChannelState::Live;
        let is_unhurt = !self.has_left && age >= WATCH_MIN;
        if self.end == FaultEnd::Never {
            // It hurts until the run ends: each frame may be the first that tells.
            let drew = is_unhurt && !self.has_missed;
            record.drew_again_ms = drew.then_some(Duration::ZERO);
            record.live_again_ms = is_unhurt.then_some(Duration::ZERO);
            return true;
        }
        if is_over && self.has_missed && has_drawn {
            record.drew_again_ms = record.drew_again_ms.or(Some(age));
        }
        if is_over && self.has_left && state == ChannelState::Live {
            record.live_again_ms = record.live_again_ms.or(Some(age));
        }
        if is_over && is_unhurt && state == ChannelState::Live {
            record.drew_again_ms = record.drew_again_ms.or(Some(Duration::ZERO));
            record.live_again_ms = record.live_again_ms.or(Some(Duration::ZERO));
        }
        record.live_again_ms.is_none() || age < WATCH_MIN
    }
}

/// States of a channel that are listed for one fault: one that flaps fills no report.
const STATES_MAX: usize = 32;

#[cfg(test)]
mod tests {
    use ChannelState::{Late, Live, Lost, Preparing};
    use polyptych_client::{FrameId, Revision};

    use super::*;

    struct Stage {
        recorder: FaultRecorder,
        start: Instant,
        restarts: u64,
    }

    impl Stage {
        fn new() -> Self {
            let start = Instant::now();
            let names = ["a", "b"].map(|name| (name.to_owned(), name.to_owned()));
            Self { recorder: FaultRecorder::new(names.into_iter(), start), start, restarts: 0 }
        }

        fn at(&self, ms: u64) -> Instant {
            self.start + Duration::from_millis(ms)
        }

        fn fault(&mut self, ms: u64, end: FaultEnd) {
            let what = "what".to_owned();
            let happened =
                FaultEvent { frame: 1, what, channel: 0, skipped: None, deadline_ms: 50.0, end };
            let now = self.at(ms);
            self.recorder.add(happened, now);
        }

        /// A frame at this time: the states of both channels, and whether they had drawn it and
        /// shown the last one.
        fn frame(&mut self, ms: u64, states: [ChannelState; 2], drawn: [bool; 2]) {
            let channel = |index: usize| ChannelFeedback {
                name: ["a", "b"][index].to_owned(),
                state: states[index],
                shown_at_us: drawn[index].then_some(ms * 1000 - 5000),
                draw_us: drawn[index].then_some(10),
                triangles: 0,
                draw_calls: 0,
                since_ms: 0,
                reason: None,
                skew: polyptych_client::Skew::default(),
            };
            let feedback = FrameFeedback {
                frame: FrameId(ms),
                time_s: 0.0,
                revision: Revision(0),
                frame_us: 0,
                barrier_us: 0,
                navigations: 0,
                detail: polyptych_client::DrawnDetail::default(),
                channels: vec![channel(0), channel(1)],
            };
            let (now, restarts) = (self.at(ms), self.restarts);
            self.recorder.note(&feedback, &|_| restarts, now);
        }

        fn record(self) -> FaultRecord {
            self.recorder.finish().swap_remove(0)
        }
    }

    const fn ms(number: u64) -> Duration {
        Duration::from_millis(number)
    }

    #[test]
    fn a_killed_server_is_followed_until_it_is_live_again() {
        let mut stage = Stage::new();
        stage.frame(100, [Live; 2], [true; 2]);
        stage.fault(110, FaultEnd::Restart(1));
        stage.frame(190, [Lost, Late], [false, false]);
        stage.frame(223, [Lost, Late], [false, true]);
        stage.restarts = 1;
        stage.frame(1200, [Preparing, Live], [false, true]);
        stage.frame(1500, [Live; 2], [true; 2]);
        // Nobody watches any more: this gap is another matter.
        stage.frame(9000, [Live, Late], [true, false]);
        let record = stage.record();
        assert_eq!(record.states, [Live, Lost, Preparing, Live]);
        assert_eq!((record.over_ms, record.live_again_ms), (Some(ms(1090)), Some(ms(1390))));
        assert_eq!(record.drew_again_ms, Some(ms(1390)));
        assert_eq!(record.others_late, 1);
        assert_eq!(record.others_longest_gap, ms(977));
    }

    #[test]
    fn what_never_comes_back_is_said_to_be_away() {
        let mut stage = Stage::new();
        stage.frame(20, [Live; 2], [true; 2]);
        stage.fault(30, FaultEnd::Restart(1));
        stage.frame(40, [Lost, Live], [false, true]);
        stage.frame(5000, [Lost, Live], [false, true]);
        let record = stage.record();
        assert_eq!((record.over_ms, record.live_again_ms), (None, None));
        assert_eq!(record.states, [Live, Lost]);
        let json = serde_json::to_value(&record).expect("JSON");
        assert!(json["live_again_ms"].is_null() && json["over_ms"].is_null(), "{json}");
        assert_eq!(json["others_longest_gap_ms"], 4960.0, "{json}");
    }

    #[test]
    fn a_fault_that_does_nothing_is_said_to_have_done_nothing() {
        let mut stage = Stage::new();
        stage.fault(0, FaultEnd::AtOnce);
        for frame in 1..40 {
            stage.frame(frame * 33, [Live; 2], [true; 2]);
        }
        let record = stage.record();
        assert_eq!((record.live_again_ms, record.drew_again_ms), (Some(ms(0)), Some(ms(0))));
        assert_eq!((record.states.as_slice(), record.others_late), (&[Live][..], 0));
    }

    #[test]
    fn a_fault_that_lasts_and_does_nothing_is_said_to_have_done_nothing() {
        let mut stage = Stage::new();
        stage.fault(0, FaultEnd::Never);
        stage.frame(500, [Live; 2], [true; 2]);
        stage.frame(1500, [Live; 2], [true; 2]);
        let record = stage.record();
        assert_eq!((record.live_again_ms, record.drew_again_ms), (Some(ms(0)), Some(ms(0))));
        assert!(record.line().contains("live all the time"), "{}", record.line());
        // What it does at last is seen all the same.
        let mut stage = Stage::new();
        stage.fault(0, FaultEnd::Never);
        stage.frame(1500, [Live; 2], [true; 2]);
        stage.frame(2500, [Late, Live], [false, true]);
        let record = stage.record();
        assert_eq!((record.live_again_ms, record.drew_again_ms), (None, None));
        assert!(record.line().contains("not live again"), "{}", record.line());
    }

    #[test]
    fn a_fault_just_before_the_end_is_not_said_to_have_hurt() {
        for frames in [0, 1] {
            let mut stage = Stage::new();
            stage.fault(0, FaultEnd::AtOnce);
            (0..frames).for_each(|_| stage.frame(40, [Live; 2], [true; 2]));
            let record = stage.record();
            assert_eq!(record.live_again_ms, None);
            assert!(record.line().contains("live until the run ended"), "{}", record.line());
        }
    }

    #[test]
    fn a_time_in_which_it_was_live_by_chance_is_not_the_end() {
        let mut stage = Stage::new();
        stage.fault(0, FaultEnd::After(Duration::from_millis(300)));
        stage.frame(100, [Late, Live], [false, true]);
        stage.frame(200, [Live, Live], [true, true]);
        stage.frame(250, [Late, Live], [false, true]);
        stage.frame(350, [Late, Live], [true, true]);
        stage.frame(450, [Live, Live], [true, true]);
        let record = stage.record();
        assert_eq!((record.over_ms, record.drew_again_ms), (Some(ms(300)), Some(ms(350))));
        assert_eq!(record.live_again_ms, Some(ms(450)));
    }
}
