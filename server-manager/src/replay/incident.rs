//! An incident: a stretch of a recording, kept as text for a test.
//!
//! The first line says where the core stood, each other line what it was told. Text, since it
//! outlives the program that wrote it: fields may be added by hand, and a change is read in a
//! diff. A core that was changed on purpose decides in another way; what [`Incident::check`]
//! demands of it are the invariants only.

use std::fmt::Write as _;
use std::path::Path;

use polyptych_core::{Checkpoint, ClientRequest, Cluster, Effect, Input, Micros};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::invariants::Invariants;
use super::tell;
use crate::recorder::ring::{RingReader, VALUES_BYTES_MAX};
use crate::recorder::{InitialState, Record};

/// The version of the text's format.
const FORMAT: u32 = 1;

/// Maximum bytes of a file that is written or read: what is kept for a test is a few seconds of a
/// wall.
const INCIDENT_BYTES_MAX: u64 = 64 << 20;

/// Maximum time for the core to finish what is still open after the last input, in manager time: 64
/// changes wait for two minutes each at most.
const SETTLE_TIME_MAX: Micros = 3 * 3600 * 1_000_000;

/// Timeouts in a row at one moment, after which a core never comes to rest.
const TIMEOUTS_AT_ONCE_MAX: u32 = 10_000;

/// The first line.
#[derive(Debug, Serialize, Deserialize)]
struct IncidentHeader {
    incident: u32,
    /// For the person whose test has failed.
    about: String,
    program: String,
    beginning: InitialState,
}

/// Every other line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct IncidentEntry {
    /// Manager time in microseconds.
    pub now: Micros,
    /// The input of the core.
    pub input: Input,
}

/// The inputs of a core, from some state on.
#[derive(Debug)]
pub struct Incident {
    head: IncidentHeader,
    lines: Vec<IncidentEntry>,
    /// Segments of its recording that make no sense to this program; 0 for a kept one.
    unreadable_segments: u64,
}

/// A stretch of a recording.
#[derive(Clone, Debug, Default)]
pub struct TimeRange {
    /// The number of the part, from 1; `None` for the last one.
    pub part: Option<usize>,
    /// From this manager time on, in seconds.
    pub from_s: Option<f64>,
    /// Up to this manager time, in seconds.
    pub to_s: Option<f64>,
}

impl TimeRange {
    /// Returns whether a manager time in seconds lies in it. The part is not looked at.
    pub(super) fn holds(&self, at_s: f64) -> bool {
        self.from_s.is_none_or(|from| at_s >= from) && self.to_s.is_none_or(|to| at_s <= to)
    }
}

/// The work of a core that was given an incident, in numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Checked {
    /// Inputs that it was told.
    pub inputs: u64,
    /// Frames that it swapped.
    pub frames: u64,
    /// Requests that it was asked.
    pub requests: u64,
}

impl Incident {
    /// Takes a stretch out of a recording.
    ///
    /// # Errors
    /// The recording can't be read, or has no such stretch.
    pub fn extract(reader: &RingReader, cut: &TimeRange, about: &str) -> Result<Self, String> {
        let mut parts = RunSelector::default();
        let read = reader.read_all(|records| match records {
            Some(records) => records.into_iter().for_each(|record| parts.read(record, cut)),
            // Parts have the numbers of the timeline: the next segment begins another one.
            None => parts.has_ended = true,
        });
        let unreadable_segments = read.map_err(|error| error.to_string())?;
        let count = parts.number;
        let (program, beginning, lines) =
            parts.kept.ok_or_else(|| format!("there is no such part; it has {count}"))?;
        if lines.is_empty() {
            return Err("there is nothing in that time; the timeline shows what there is".into());
        }
        let head = IncidentHeader { incident: FORMAT, about: about.into(), program, beginning };
        Ok(Self { head, lines, unreadable_segments })
    }

    /// Returns the incident as text, and the number of inputs that text cannot hold, such as those
    /// with NaN; the core refuses those anyway.
    ///
    /// # Errors
    /// The beginning can't be written as text, or the text is longer than [`Incident::load`] reads.
    pub fn to_text(&self) -> Result<(String, u64), String> {
        let mut text = serde_json::to_string(&self.head).map_err(|error| error.to_string())?;
        text.push('\n');
        let mut left_out = 0;
        for line in &self.lines {
            let json = serde_json::to_string(line).unwrap_or_default();
            if serde_json::from_str::<IncidentEntry>(&json).is_ok() {
                // Writing into a string cannot fail.
                let _ = writeln!(text, "{json}");
            } else {
                left_out += 1;
            }
            if text.len() as u64 > INCIDENT_BYTES_MAX {
                return Err(format!(
                    "an incident has at most {INCIDENT_BYTES_MAX} bytes of text, and this one has \
                     more; give --from and --to for a shorter time"
                ));
            }
        }
        Ok((text, left_out))
    }

    /// Reads a kept incident.
    ///
    /// # Errors
    /// File, line and what is wrong there.
    pub fn load(path: &Path) -> Result<Self, String> {
        let name = path.display();
        let failed = |error: std::io::Error| format!("{name}: {error}");
        if std::fs::metadata(path).map_err(failed)?.len() > INCIDENT_BYTES_MAX {
            return Err(format!("{name}: larger than {INCIDENT_BYTES_MAX} bytes; cut it shorter"));
        }
        Self::parse(&std::fs::read_to_string(path).map_err(failed)?)
            .map_err(|(line, reason)| format!("{name}:{line}: {reason}"))
    }

    /// Reads the text of an incident. An error has its line.
    fn parse(text: &str) -> Result<Self, (usize, String)> {
        let mut lines = (1..).zip(text.lines()).filter(|(_, line)| !line.trim().is_empty());
        let (_, first) = lines.next().ok_or((1, "it is empty".to_owned()))?;
        let head: IncidentHeader =
            serde_json::from_str(first).map_err(|error| (1, error.to_string()))?;
        if head.incident != FORMAT {
            return Err((1, format!("format {}, where {FORMAT} is read", head.incident)));
        }
        let lines = lines.map(|(number, line)| {
            serde_json::from_str(line).map_err(|error| (number, error.to_string()))
        });
        Ok(Self { lines: lines.collect::<Result<_, _>>()?, head, unreadable_segments: 0 })
    }

    /// Returns its description.
    pub fn description(&self) -> &str {
        &self.head.about
    }

    /// Returns the number of segments of its recording that make no sense to this program.
    pub fn unreadable_segments(&self) -> u64 {
        self.unreadable_segments
    }

    /// Tells it to a core, with that core's own timeouts in between, and then lets time pass
    /// until nothing is open.
    ///
    /// Demands the [`Invariants`], that a frame is swapped within the wall's longest deadline and
    /// its swap lead, and that every request of a client that stays is answered.
    ///
    /// # Errors
    /// Says what does not hold, when, and on which input.
    pub fn check(self) -> Result<Checked, String> {
        let is_from_start = matches!(self.head.beginning, InitialState::Fresh(_));
        let cluster = self.head.beginning.into_cluster();
        // Servers draw nothing before the instant at which they show the frame before.
        let (wait, sync) = (&cluster.wall().deadline, &cluster.wall().sync);
        let deadline = (Micros::from(wait.max_ms) + Micros::from(sync.swap_lead_ms)) * 1000;
        let invariants = Invariants::new(&cluster, is_from_start, "the incident".into());
        let checked = Checked::default();
        let (imports, sessions) = (Vec::new(), Vec::new());
        // A checkpoint was taken just before the first line.
        let first = self.lines.first().map_or(0, |line| line.now);
        let now = if is_from_start { 0 } else { first };
        let mut check = Check { cluster, now, invariants, deadline, checked, imports, sessions };
        for IncidentEntry { now, input } in self.lines {
            check.pass_time(now)?;
            // The core that is tested sets its own.
            if input != Input::Timeout {
                check.tell(now, &input)?;
            }
        }
        check.settle()
    }
}

/// The parts of a recording, of which one is kept.
#[derive(Default)]
struct RunSelector {
    number: usize,
    epoch: Option<polyptych_protocol::ids::Epoch>,
    has_ended: bool,
    /// The core before the first kept input, where that is not the part's first.
    before: Option<Cluster>,
    kept: Option<(String, InitialState, Vec<IncidentEntry>)>,
}

impl RunSelector {
    fn read(&mut self, record: Record, cut: &TimeRange) {
        let is_wanted = |number: usize| cut.part.is_none_or(|part| part == number);
        match record {
            Record::Begin(segment) => {
                let goes_on = segment.is_contiguous && self.epoch == Some(segment.epoch);
                if goes_on && !self.has_ended && self.number > 0 {
                    return;
                }
                self.number += 1;
                (self.epoch, self.has_ended, self.before) = (Some(segment.epoch), false, None);
                if !is_wanted(self.number) {
                    return;
                }
                if cut.from_s.is_some() {
                    // Written down again once the time has come.
                    let copy = copy_of(&segment.beginning);
                    self.before = copy.map(InitialState::into_cluster);
                }
                self.kept = Some((segment.program, segment.beginning, Vec::new()));
            }
            Record::Input { now, input } if is_wanted(self.number) => {
                let at_s = now as f64 / 1e6;
                let Some((_, beginning, lines)) = &mut self.kept else { return };
                if cut.from_s.is_some_and(|from| at_s < from) {
                    if let Some(cluster) = &mut self.before {
                        tell(cluster, now, input);
                    }
                } else if cut.to_s.is_none_or(|to| at_s <= to) {
                    if let Some(checkpoint) = self.before.take().as_ref().and_then(written_down) {
                        *beginning = InitialState::Checkpoint(checkpoint);
                    }
                    lines.push(IncidentEntry { now, input });
                }
            }
            Record::End => self.has_ended = true,
            Record::Input { .. } | Record::Decided(_) => {}
        }
    }
}

/// A core as it stands.
fn written_down(cluster: &Cluster) -> Option<Checkpoint> {
    copy_of(&cluster.checkpoint())
}

fn copy_of<T: DeserializeOwned>(value: &impl Serialize) -> Option<T> {
    polyptych_codec::decode_within::<T, VALUES_BYTES_MAX>(&polyptych_codec::encode(value)).ok()
}

/// A core that is told an incident.
struct Check {
    cluster: Cluster,
    now: Micros,
    invariants: Invariants,
    deadline: Micros,
    checked: Checked,
    /// Bakes that have not ended.
    imports: Vec<ClientRequest>,
    /// Sessions that are being read.
    sessions: Vec<ClientRequest>,
}

impl Check {
    fn tell(&mut self, now: Micros, input: &Input) -> Result<(), String> {
        self.checked.inputs += 1;
        self.now = now;
        match input {
            Input::Request { .. } => self.checked.requests += 1,
            Input::Import { job, .. } => self.imports.retain(|other| other != job),
            Input::Session { job, .. } => self.sessions.retain(|other| other != job),
            _ => {}
        }
        let began = self.invariants.frame_began();
        let (outputs, _) = tell(&mut self.cluster, now, input.clone());
        self.invariants.observe(now, input, &outputs, &self.cluster)?;
        if let Some((frame, at)) = began
            && self.invariants.frame_began().map(|(frame, _)| frame) != Some(frame)
        {
            self.checked.frames += 1;
            if now > at + self.deadline {
                let waited_ms = (now - at) / 1000;
                return Err(format!("frame {frame} was swapped only after {waited_ms} ms"));
            }
        }
        for output in outputs {
            match output {
                Effect::Import { job, .. } => self.imports.push(job),
                Effect::OpenSession { job, .. } => self.sessions.push(job),
                _ => {}
            }
        }
        Ok(())
    }

    /// The core's own timeouts up to `now`.
    fn pass_time(&mut self, now: Micros) -> Result<(), String> {
        let mut in_a_row = 0;
        while let Some(due) = self.cluster.poll_timeout().filter(|due| *due <= now) {
            in_a_row = if due > self.now { 0 } else { in_a_row + 1 };
            if in_a_row > TIMEOUTS_AT_ONCE_MAX {
                return Err(format!("the core does not come to rest at {} us", self.now));
            }
            self.tell(due.max(self.now), &Input::Timeout)?;
        }
        self.now = self.now.max(now);
        Ok(())
    }

    fn settle(mut self) -> Result<Checked, String> {
        for job in std::mem::take(&mut self.imports) {
            let imported = Err("the incident ends here".into());
            self.tell(self.now, &Input::Import { job, imported })?;
        }
        for job in std::mem::take(&mut self.sessions) {
            let session = Err("the incident ends here".into());
            self.tell(self.now, &Input::Session { job, session })?;
        }
        let end = self.now + SETTLE_TIME_MAX;
        while !self.invariants.open().is_empty() && self.now < end {
            let Some(due) = self.cluster.poll_timeout() else { break };
            self.pass_time(self.now.max(due))?;
        }
        match self.invariants.open().first() {
            None => Ok(self.checked),
            Some(job) => {
                Err(format!("request {} of session {} is never answered", job.id, job.client.0))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec2, DVec3, UVec2};
    use polyptych_core::SessionId;
    use polyptych_protocol::command::Command;
    use polyptych_protocol::handshake::{Adapter, ServerHello};
    use polyptych_protocol::ids::{Digest, Epoch, RequestId};
    use polyptych_protocol::request::Request;
    use polyptych_protocol::server_message::{Prepared, ServerMessage};
    use polyptych_protocol::state_log::Replica;
    use polyptych_wall::surface::Plane;
    use polyptych_wall::{Channel, DeadlinePolicy, Screen, Surface, Wall};

    use super::*;
    use crate::recorder::ClusterConfig;

    const SERVER: SessionId = SessionId(2);

    /// A wall of one channel, whose frames wait for a second and are shown 3 ms after their swap.
    fn wall() -> Wall {
        let side = UVec2::splat(64);
        let plane = Plane::upright(DVec3::NEG_Z, DVec2::splat(2.0));
        let screens = vec![Screen::new("front", Surface::Plane(plane), side)];
        let channels = vec![Channel::tile("c0", 0, UVec2::ZERO, side)];
        let mut wall = Wall { near_m: 0.1, ..Wall::new("lead", screens, channels) };
        wall.deadline = DeadlinePolicy { factor: 4.0, min_ms: 50, max_ms: 1000 };
        wall.sync.swap_lead_ms = 3;
        wall
    }

    fn fresh() -> ClusterConfig {
        ClusterConfig {
            wall: wall(),
            epoch: Epoch(7),
            memory: None,
            outline: None,
            is_navigable: false,
        }
    }

    fn incident(about: &str, fresh: ClusterConfig, lines: Vec<IncidentEntry>) -> Incident {
        let head = IncidentHeader {
            incident: FORMAT,
            about: about.into(),
            program: "0.1.0".into(),
            beginning: InitialState::Fresh(Box::new(fresh)),
        };
        Incident { head, lines, unreadable_segments: 0 }
    }

    #[test]
    fn a_text_that_is_too_long_to_be_read_again_is_refused() {
        const LINES: usize = 4;
        let name = "x".repeat(INCIDENT_BYTES_MAX as usize / LINES);
        let input = Input::Client { session: SessionId(1), name };
        let line = IncidentEntry { now: 1000, input };
        let mut long = incident("a long name", fresh(), vec![line; LINES]);
        let error = long.to_text().expect_err("longer by what is around the names");
        assert!(error.contains("give --from and --to"), "{error}");
        long.lines.pop();
        assert_eq!(long.to_text().expect("short enough").1, 0);
    }

    /// A server that has what the manager gives it first.
    fn prepared(fresh: &ClusterConfig, joins: &Input) -> Prepared {
        let mut prepared = None;
        for output in tell(&mut fresh.to_cluster(), 1000, joins.clone()).0 {
            let Effect::Command { command, .. } = output else { continue };
            let Command::Prepare(prepare) = *command else { continue };
            let (epoch, revision) = (prepare.epoch, prepare.revision);
            let digest: Digest = Replica::from_snapshot(revision, prepare.operations).digest();
            let (features, scene_bytes, detail_reach) = (Vec::new(), 0, None);
            prepared =
                Some(Prepared { epoch, revision, digest, features, scene_bytes, detail_reach });
        }
        prepared.expect("the server is given the state")
    }

    #[test]
    fn a_frame_that_is_not_drawn_may_wait_for_the_swap_lead_too() {
        let fresh = fresh();
        let hello = ServerHello {
            name: "c0".into(),
            channels: vec!["c0".into()],
            pid: 100,
            adapter: Adapter { texture_side_max: 8192, ..Adapter::default() },
        };
        let joins = Input::Server { session: SERVER, hello, address: "127.0.0.1:9".into() };
        let status = ServerMessage::Prepared(prepared(&fresh, &joins));
        let client = SessionId(1);
        let request = Request::RenderFrame { camera: None, time_s: None };
        let inputs = [
            Input::Client { session: client, name: "test".into() },
            joins,
            Input::Status { from: SERVER, status },
            Input::Request { client, id: RequestId(1), request },
        ];
        let lines = (1..).zip(inputs).map(|(at, input)| IncidentEntry { now: at * 1000, input });
        let incident = incident("a server that never draws", fresh, lines.collect());
        let checked = incident.check().expect("all holds");
        assert!(checked.frames > 0 && checked.requests == 1, "{checked:?}");
    }
}
