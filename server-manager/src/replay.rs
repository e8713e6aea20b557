//! Replays a recording: tells a core the same, and compares what it decides.

pub mod incident;
pub mod invariants;
pub mod lanes;
#[cfg(test)]
mod tests;
mod timeline;
mod words;

use incident::TimeRange;
use invariants::Invariants;
use lanes::{LaneRecorder, Lanes};
use polyptych_core::{Cluster, Effect, Input, Micros};
use serde::Serialize;
use timeline::Timeline;

use crate::recorder::effect_digest::EffectDigest;
use crate::recorder::ring::{RingError, RingReader};
use crate::recorder::{InitialState, Record, Segment};
pub use timeline::{Event, Summary};

/// The result of a replay.
#[derive(Debug, Default, Serialize)]
pub struct ReplayReport {
    /// Each stretch of inputs without a gap, in order: the life of a manager, or a part of one.
    pub parts: Vec<ReplayRun>,
    /// Segments that make no sense to this program, such as those of an older one. Each ends a
    /// part.
    pub unreadable_segments: u64,
    /// Inputs that were told again.
    pub inputs: u64,
    /// Inputs on which something was decided, and compared.
    pub decisions: u64,
    /// Decisions and states that differ from the recorded ones.
    pub differences: u64,
    /// The first of those.
    pub first_difference: Option<Divergence>,
    /// The first invariant that was broken, then as now.
    pub violation: Option<String>,
}

/// A stretch of inputs without a gap.
#[derive(Debug, Serialize)]
pub struct ReplayRun {
    /// The version of the program that recorded it.
    pub program: String,
    /// The life of the manager, as in status and logs.
    pub epoch: String,
    /// The start of the manager, when its time is 0, in microseconds since 1970, UTC.
    pub started_unix_us: u64,
    /// `true` if it begins with the manager; otherwise it begins with a checkpoint.
    pub is_from_start: bool,
    /// `true` if the manager ended in order; otherwise the recording breaks off.
    pub has_end: bool,
    /// The summary of its inputs.
    #[serde(flatten)]
    pub summary: Summary,
}

/// An input on which this program decides in another way than the one that recorded it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Divergence {
    /// In which part, from 1.
    pub part: usize,
    /// Manager time in seconds.
    pub at_s: f64,
    /// The number of the input in the part, from 1.
    pub number: u64,
    /// The input, in words.
    pub input: String,
    /// The recorded decision, in words.
    pub recorded: String,
    /// The decision of this program, in words.
    pub replayed: String,
}

/// A core on its way through a part.
struct Replayer {
    cluster: Cluster,
    timeline: Timeline,
    invariants: Invariants,
    lanes: Option<LaneRecorder>,
    part: ReplayRun,
    inputs: u64,
    last: Option<PendingCheck>,
}

/// The decision on the last input, until the recording has said what it should be.
struct PendingCheck {
    now: Micros,
    input: Input,
    decision: Option<EffectDigest>,
    is_compared: bool,
}

/// Replays all that a recording holds.
///
/// # Errors
/// [`RingError`] where it can't be read, or no segment of it makes sense to this program.
pub fn replay(reader: &RingReader) -> Result<ReplayReport, RingError> {
    Ok(run(Replay::default(), reader)?.replayed)
}

/// Replays all that a recording holds, and returns what happened in a range of it, too: `None`
/// where there is no such part.
///
/// # Errors
/// Has the errors of [`replay`].
pub fn replay_lanes(
    reader: &RingReader,
    range: &TimeRange,
) -> Result<(ReplayReport, Option<Lanes>), RingError> {
    let all = Replay { range: Some(range.clone()), ..Replay::default() };
    let Replay { replayed, lanes, .. } = run(all, reader)?;
    Ok((replayed, lanes))
}

fn run(mut all: Replay, reader: &RingReader) -> Result<Replay, RingError> {
    let unreadable_segments = reader.read_all(|records| match records {
        Some(records) => records.into_iter().for_each(|record| all.read(record)),
        None => all.end_part(),
    })?;
    all.end_part();
    all.replayed.unreadable_segments = unreadable_segments;
    Ok(all)
}

#[derive(Default)]
struct Replay {
    replayed: ReplayReport,
    player: Option<Replayer>,
    /// The part of the recording whose lanes are wanted, if any.
    range: Option<TimeRange>,
    lanes: Option<Lanes>,
}

impl Replay {
    fn read(&mut self, record: Record) {
        match record {
            Record::Begin(segment) => self.begin(segment),
            Record::Input { now, input } => {
                self.settle(false);
                if let Some(player) = &mut self.player {
                    self.replayed.inputs += 1;
                    let violation = player.tell(now, input);
                    self.replayed.violation = self.replayed.violation.take().or(violation);
                }
            }
            Record::Decided(recorded) => self.compare(&recorded),
            Record::End => {
                self.settle(false);
                if let Some(player) = &mut self.player {
                    player.part.has_end = true;
                }
                self.end_part();
            }
        }
    }

    fn begin(&mut self, segment: Segment) {
        let Segment { program, epoch, started_unix_us, is_contiguous, beginning } = segment;
        let is_from_start = matches!(beginning, InitialState::Fresh(_));
        let goes_on =
            is_contiguous && self.player.as_ref().is_some_and(|p| p.cluster.epoch() == epoch);
        if goes_on {
            self.settle(false);
        } else {
            self.end_part();
        }
        let cluster = beginning.into_cluster();
        let Some(player) = &mut self.player else {
            let number = self.replayed.parts.len() + 1;
            let epoch = epoch.to_string();
            let summary = Summary::default();
            let part = ReplayRun {
                program,
                epoch,
                started_unix_us,
                is_from_start,
                has_end: false,
                summary,
            };
            let is_wanted = |range: &&TimeRange| range.part.is_none_or(|part| part == number);
            let range = self.range.as_ref().filter(is_wanted);
            self.player = Some(Replayer::new(cluster, part, number, range));
            return;
        };
        // The same inputs have led to the same state, or something else than inputs did.
        let [ours, theirs] =
            [&player.cluster, &cluster].map(|c| polyptych_codec::encode(&c.checkpoint()));
        if ours != theirs {
            let difference = Divergence {
                part: self.replayed.parts.len() + 1,
                at_s: player.timeline.now_s(),
                number: player.inputs,
                input: "all inputs so far".into(),
                recorded: "a state, in the segment's checkpoint".into(),
                replayed: "another state".into(),
            };
            self.replayed.note(difference);
            // Otherwise every decision from here on would be another one, too.
            player.cluster = cluster;
        }
    }

    /// The recording says what came of the last input.
    fn compare(&mut self, recorded: &EffectDigest) {
        let Some(player) = &mut self.player else { return };
        let Some(told) = &mut player.last else { return };
        self.replayed.decisions += 1;
        told.is_compared = true;
        if told.decision.as_ref() != Some(recorded) {
            let difference = player.difference(self.replayed.parts.len() + 1, Some(recorded));
            self.replayed.note(difference);
        }
    }

    /// The recording has nothing to say about the last input: nothing came of it, or, at a tear,
    /// nobody knows.
    fn settle(&mut self, is_torn: bool) {
        let Some(player) = &mut self.player else { return };
        let is_silent = |told: &PendingCheck| !told.is_compared && told.decision.is_some();
        if player.last.as_ref().is_some_and(is_silent) && !is_torn {
            let difference = player.difference(self.replayed.parts.len() + 1, None);
            self.replayed.note(difference);
        }
        player.last = None;
    }

    fn end_part(&mut self) {
        self.settle(true);
        if let Some(mut player) = self.player.take() {
            if let Some(recorder) = player.lanes {
                let (events, events_more) = player.timeline.take_drawn();
                self.lanes = Some(Lanes { events, events_more, ..recorder.finish() });
            }
            let summary = player.timeline.finish(&player.cluster);
            self.replayed.parts.push(ReplayRun { summary, ..player.part });
        }
    }
}

impl ReplayReport {
    fn note(&mut self, difference: Divergence) {
        self.differences += 1;
        self.first_difference.get_or_insert(difference);
    }
}

impl Replayer {
    fn new(cluster: Cluster, part: ReplayRun, number: usize, drawn: Option<&TimeRange>) -> Self {
        let timeline = Timeline::new(&cluster, drawn);
        let lanes = drawn.map(|range| LaneRecorder::new(&cluster, number, range));
        let invariants = Invariants::new(&cluster, part.is_from_start, format!("part {number}"));
        Self { cluster, timeline, invariants, lanes, part, inputs: 0, last: None }
    }

    /// Tells the core; gives the invariant that this has broken, if one.
    fn tell(&mut self, now: Micros, input: Input) -> Option<String> {
        self.inputs += 1;
        let (outputs, refusal) = tell(&mut self.cluster, now, input.clone());
        self.timeline.observe(now, &input, &outputs, refusal.as_deref(), &self.cluster);
        if let Some(lanes) = &mut self.lanes {
            lanes.observe(now, &input, &outputs, &self.cluster);
        }
        let broken = self.invariants.observe(now, &input, &outputs, &self.cluster).err();
        let decision = EffectDigest::from_effects(outputs.iter(), refusal.as_deref());
        self.last = Some(PendingCheck { now, input, decision, is_compared: false });
        broken
    }

    fn difference(&self, part: usize, recorded: Option<&EffectDigest>) -> Divergence {
        let told = self.last.as_ref();
        let words = |decision: Option<&EffectDigest>| {
            decision.map_or("nothing".into(), EffectDigest::describe)
        };
        let replayed = told.and_then(|told| told.decision.as_ref());
        let (recorded, mut replayed) = (words(recorded), words(replayed));
        if recorded == replayed {
            replayed.push_str(" (of another content)");
        }
        Divergence {
            part,
            at_s: told.map_or(0, |told| told.now) as f64 / 1e6,
            number: self.inputs,
            input: told.map_or_else(String::new, |told| words::of_input(&told.input)),
            recorded,
            replayed,
        }
    }
}

/// Tells a core something; gives what came of it.
fn tell(cluster: &mut Cluster, now: Micros, input: Input) -> (Vec<Effect>, Option<String>) {
    let refusal = cluster.handle(now, input).err();
    (std::iter::from_fn(|| cluster.poll_effect()).collect(), refusal)
}
