//! Walls that live for a while and are recorded: what is read back decides the same.

use std::collections::{BTreeMap, VecDeque};
use std::fs;
use std::path::Path;
use std::sync::Arc;

use glam::{DVec2, DVec3, UVec2};
use polyptych_core::{ClientRequest, Effect, ImportedScene, SessionId};
use polyptych_files::blob::BlobHash;
use polyptych_protocol::command::Command;
use polyptych_protocol::feedback::ChannelState;
use polyptych_protocol::handshake::{Adapter, ServerHello};
use polyptych_protocol::ids::{RequestId, Revision};
use polyptych_protocol::request::{Request, SceneSummary};
use polyptych_protocol::server_message::{FrameRendered, Ping, Prepared, ServerMessage};
use polyptych_protocol::state_log::{Replica, SceneRef};
use polyptych_scene::{PassTimes, SceneFeatures};
use polyptych_wall::surface::Plane;
use polyptych_wall::{Channel, ChannelId, Screen, Surface};

use super::ring::RingReader;
use super::*;
use crate::recorded_cluster::RecordedCluster;
use crate::replay::incident::{Incident, TimeRange};
use crate::replay::{ReplayReport, replay};

const CHANNELS: u16 = 3;
const CLIENT: SessionId = SessionId(1);

/// Small, so that a ring is full soon.
const SMALL_SEGMENT: u64 = 512 << 10;

fn wall() -> Wall {
    let channel = |index: u16| {
        let origin = UVec2::new(u32::from(index) * 64, 0);
        Channel::tile(&format!("c{index}"), 0, origin, UVec2::splat(64))
    };
    let plane = Plane::upright(DVec3::NEG_Z, DVec2::splat(2.0));
    let canvas = UVec2::new(64 * u32::from(CHANNELS), 64);
    let screens = vec![Screen::new("front", Surface::Plane(plane), canvas)];
    Wall { near_m: 0.1, ..Wall::new("recorded", screens, (0..CHANNELS).map(channel).collect()) }
}

/// A wall whose servers and client do something at random, from a seed.
struct RandomRun {
    core: RecordedCluster,
    random: u64,
    now: Micros,
    sessions: u64,
    requests: u64,
    servers: BTreeMap<SessionId, (u16, Replica)>,
    statuses: VecDeque<(SessionId, ServerMessage)>,
    imports: Vec<ClientRequest>,
}

impl RandomRun {
    fn new(recorder: Recorder, seed: u64) -> Self {
        let fresh = ClusterConfig {
            wall: wall(),
            epoch: Epoch(seed),
            memory: None,
            outline: None,
            is_navigable: true,
        };
        let mut life = Self {
            core: RecordedCluster::new(fresh, Some(recorder)),
            random: seed,
            now: 1000,
            sessions: 10,
            requests: 0,
            servers: BTreeMap::new(),
            statuses: VecDeque::new(),
            imports: Vec::new(),
        };
        life.tell(Input::Client { session: CLIENT, name: "test".into() });
        life
    }

    /// A number below `end`.
    fn pick(&mut self, end: u64) -> u64 {
        self.random =
            self.random.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.random >> 33) % end
    }

    fn tell(&mut self, input: Input) {
        self.core.handle(self.now, input).expect("it may");
        while let Some(output) = self.core.poll_effect() {
            match output {
                Effect::Command { to, command } => {
                    for session in to {
                        self.obey(session, &command);
                    }
                }
                Effect::Import { job, .. } => self.imports.push(job),
                Effect::Close { session, .. } => drop(self.servers.remove(&session)),
                _ => {}
            }
        }
    }

    fn obey(&mut self, session: SessionId, command: &Command) {
        let Some((channel, replica)) = self.servers.get_mut(&session) else { return };
        let status = match command {
            Command::Prepare(prepare) => {
                if prepare.base.is_none() {
                    let operations = prepare.operations.clone();
                    *replica = Replica::from_snapshot(prepare.revision, operations);
                } else {
                    prepare.operations.iter().cloned().for_each(|o| replica.apply(o));
                }
                ServerMessage::Prepared(Prepared {
                    epoch: prepare.epoch,
                    revision: prepare.revision,
                    digest: replica.digest(),
                    features: Vec::new(),
                    scene_bytes: 0,
                    detail_reach: None,
                })
            }
            Command::Frame(frame) => ServerMessage::Drawn(FrameRendered {
                epoch: frame.epoch,
                frame: frame.frame,
                channel: ChannelId(*channel),
                revision: replica.revision,
                digest: replica.digest(),
                draw_us: 9000,
                triangles: 7,
                draw_calls: 1,
                error_fraction: 0.0,
                draws_occluded: 0,
                is_trial: false,
                passes: PassTimes::default(),
            }),
            _ => return,
        };
        self.statuses.push_back((session, status));
    }

    fn ask(&mut self, request: Request) {
        self.requests += 1;
        self.tell(Input::Request { client: CLIENT, id: RequestId(self.requests), request });
    }

    fn join(&mut self) {
        let free = (0..CHANNELS).find(|c| self.servers.values().all(|(other, _)| other != c));
        let Some(channel) = free else { return };
        self.sessions += 1;
        let session = SessionId(self.sessions);
        self.servers.insert(session, (channel, Replica::default()));
        let hello = ServerHello {
            name: format!("c{channel}"),
            channels: vec![format!("c{channel}")],
            pid: self.sessions as u32,
            adapter: Adapter { texture_side_max: 8192, ..Adapter::default() },
        };
        self.tell(Input::Server { session, hello, address: "127.0.0.1:9".into() });
    }

    fn step(&mut self) {
        self.now += self.pick(8000);
        while self.core.poll_timeout().is_some_and(|due| due <= self.now) {
            self.tell(Input::Timeout);
        }
        let first = self.servers.keys().next().copied();
        match self.pick(200) {
            0 => self.join(),
            1..4 => self.ask(Request::RenderFrame { camera: None, time_s: Some(0.5) }),
            4 => self.ask(Request::OpenScene { path: "town.glb".into(), scene: None }),
            5 => self.ask(Request::CloseScene),
            6 => self.ask(Request::SetExposure(-1.0)),
            7 if self.pick(4) == 0 => {
                if let Some(session) = first {
                    self.servers.remove(&session);
                    let reason = "a cable was pulled".to_owned();
                    self.tell(Input::ServerGone { session, reason });
                }
            }
            8 => {
                if let Some(job) = self.imports.pop() {
                    let imported = Ok(imported());
                    self.tell(Input::Import { job, imported });
                }
            }
            // A server that says nothing about a frame is late.
            9 if matches!(self.statuses.front(), Some((_, ServerMessage::Drawn(_)))) => {
                self.statuses.pop_front();
            }
            10..20 => {
                if let Some(from) = first {
                    let status = ServerMessage::Ping(Ping { sent_us: 1, memory_bytes: 5 });
                    self.tell(Input::Status { from, status });
                }
            }
            _ => {
                if let Some((from, status)) = self.statuses.pop_front() {
                    self.tell(Input::Status { from, status });
                }
            }
        }
    }
}

fn imported() -> ImportedScene {
    let scene = SceneRef { name: "town".into(), manifest: BlobHash([3; 32]) };
    let summary = SceneSummary {
        name: "town".into(),
        revision: Revision(0),
        bounds: None,
        triangles: 9,
        features: SceneFeatures::default(),
        notes: Vec::new(),
        exposure: 1.0,
        clips: Vec::new(),
    };
    ImportedScene::of_file(scene, summary, Arc::default())
}

/// Records the life of a wall that is asked for frames all the time.
fn live(path: &Path, segment_bytes: u64, seed: u64, steps: u32) {
    let ring = Ring::open_with(path, segment_bytes).expect("a file");
    let mut life = RandomRun::new(Recorder::write_to(ring, path).expect("a thread"), seed);
    (0..CHANNELS).for_each(|_| life.join());
    life.ask(Request::Run(polyptych_protocol::request::Pacing::Rate(60.0)));
    (0..steps).for_each(|_| life.step());
}

fn replayed(path: &Path) -> ReplayReport {
    replay(&RingReader::open(path).expect("a recording")).expect("readable")
}

/// Returns the deadlines that each channel had missed before the first input of a recording and
/// after its last, by name.
fn late(reader: &RingReader) -> [BTreeMap<String, u64>; 2] {
    let all = |cluster: &Cluster| -> BTreeMap<String, u64> {
        cluster.channel_states().map(|(name, .., late)| (name.to_owned(), late)).collect()
    };
    let (mut told, mut before): (Option<Cluster>, _) = (None, BTreeMap::new());
    for &number in reader.segments() {
        for record in reader.read(number).expect("readable") {
            match record {
                Record::Begin(segment) if told.is_none() => {
                    let cluster = segment.beginning.into_cluster();
                    before = all(&cluster);
                    told = Some(cluster);
                }
                Record::Input { now, input } => {
                    let cluster = told.as_mut().expect("a beginning");
                    cluster.handle(now, input).expect("it may");
                    while cluster.poll_effect().is_some() {}
                }
                _ => {}
            }
        }
    }
    [before, all(&told.expect("a beginning"))]
}

#[test]
fn a_recorded_life_decides_the_same_and_tells_what_happened() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("wall.rec");
    live(&path, SMALL_SEGMENT, 1, 3000);
    let replayed = replayed(&path);
    assert_eq!(replayed.first_difference, None);
    assert_eq!(replayed.violation, None);
    let [part] = &replayed.parts[..] else { panic!("{replayed:?}") };
    assert!(part.is_from_start && part.has_end);
    assert!(replayed.inputs > 2000 && replayed.decisions > 500, "{replayed:?}");
    assert!(part.summary.frames > 100 && part.summary.answers > 10);
    assert!(part.summary.requests["render a frame"] > 10);
    let says = |text: &str| part.summary.events.iter().any(|event| event.text.contains(text));
    for text in [
        "server c0 at 127.0.0.1:9 () joins",
        "c0 lost: a cable was pulled",
        "was not drawn within",
        "live",
        "an exposure is 0 or more, not -1",
        "scene town is baked",
    ] {
        assert!(says(text), "{text}: {:#?}", part.summary.events);
    }
}

#[test]
fn the_ring_is_bounded_and_its_last_segments_replay_from_a_checkpoint() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("wall.rec");
    live(&path, SMALL_SEGMENT, 2, 60_000);
    let length = fs::metadata(&path).expect("a file").len();
    assert!(length <= 4 * SMALL_SEGMENT + 32, "{length} bytes");
    let reader = RingReader::open(&path).expect("a recording");
    assert!(reader.segments()[0] > 0, "the first segments are overwritten: {reader:?}");
    let replayed = replay(&reader).expect("readable");
    assert_eq!((replayed.first_difference, replayed.violation), (None, None));
    let [part] = &replayed.parts[..] else { panic!("{:?}", replayed.parts) };
    assert!(!part.is_from_start && part.has_end && part.summary.from_s > 1.0);
    assert!(replayed.inputs > 10_000, "{} inputs", replayed.inputs);
    let [before, after] = late(&reader);
    assert!(before.values().any(|late| *late > 0), "{before:?}");
    let missed = after.into_iter().map(|(name, late)| (name.clone(), late - before[&name]));
    let missed: BTreeMap<_, _> = missed.filter(|(_, late)| *late > 0).collect();
    assert_eq!(part.summary.late, missed);

    // The lives of other managers go on behind it.
    live(&path, SMALL_SEGMENT, 3, 100);
    let replayed = tests::replayed(&path);
    assert_eq!(replayed.first_difference, None);
    assert_eq!(replayed.parts.len(), 2);
    assert_eq!(replayed.parts[1].epoch, Epoch(3).to_string());
}

#[test]
fn a_large_input_at_the_end_of_a_segment_begins_the_next() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("wall.rec");
    let ring = Ring::open_with(&path, SMALL_SEGMENT).expect("a file");
    let mut life = RandomRun::new(Recorder::write_to(ring, &path).expect("a thread"), 7);
    (0..CHANNELS).for_each(|_| life.join());
    // The first leaves room for inputs as they are, and not for the second.
    for kib in [200, 400] {
        let (session, reason) = (SessionId(999), "?".repeat(kib << 10));
        life.tell(Input::ServerGone { session, reason });
    }
    life.ask(Request::SetExposure(1.0));
    drop(life);
    let replayed = replayed(&path);
    assert_eq!((replayed.first_difference, replayed.violation), (None, None));
    // A client, servers, both of these, and a request.
    assert_eq!((replayed.parts.len(), replayed.inputs), (1, 1 + u64::from(CHANNELS) + 2 + 1));
    assert!(replayed.parts[0].is_from_start && replayed.parts[0].has_end);
}

#[test]
fn a_torn_recording_is_read_up_to_the_tear() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("wall.rec");
    // Several pieces, however quickly they are made.
    live(&path, SMALL_SEGMENT, 4, 10_000);
    let whole = fs::read(&path).expect("read");
    let all = replayed(&path).inputs;
    let mut last = 0;
    for cut in (0..whole.len()).step_by(whole.len() / 50) {
        fs::write(&path, &whole[..cut]).expect("written");
        let Ok(reader) = RingReader::open(&path) else {
            assert!(cut < 32, "cut to {cut} bytes");
            continue;
        };
        let torn = replay(&reader).expect("readable");
        assert_eq!(torn.first_difference, None, "cut to {cut} bytes");
        // The last piece may hold the end alone.
        assert!(torn.inputs >= last && torn.inputs <= all);
        assert!(torn.parts.iter().all(|part| !part.has_end));
        last = torn.inputs;
    }
    assert!(last > 0);
    // A damaged byte is as good as a tear.
    let mut bytes = whole.clone();
    bytes[100] ^= 1;
    fs::write(&path, &bytes).expect("written");
    assert_eq!(replayed(&path).inputs, 0);
}

#[test]
fn a_segment_of_another_program_is_left_out_and_ends_a_part() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("wall.rec");
    // One whole record, of a kind that no program has.
    let add_other = || {
        let mut ring = Ring::open_with(&path, SMALL_SEGMENT).expect("a file");
        ring.write(ring.next_segment(), &[1, 0, 0, 0, 0xff]).expect("written");
    };
    add_other();
    let open = || RingReader::open(&path).expect("a recording");
    assert!(matches!(replay(&open()), Err(RingError::Malformed { segment: 0, .. })));
    assert!(Incident::extract(&open(), &TimeRange::default(), "").is_err());
    live(&path, SMALL_SEGMENT, 9, 300);
    add_other();
    let reader = open();
    let replayed = replay(&reader).expect("the part between is readable");
    assert_eq!((replayed.parts.len(), replayed.unreadable_segments), (1, 2));
    assert_eq!((replayed.first_difference, replayed.violation), (None, None));
    assert!(replayed.inputs > 50, "{} inputs", replayed.inputs);
    let incident = Incident::extract(&reader, &TimeRange::default(), "").expect("cut");
    assert_eq!(incident.unreadable_segments(), 2);
    let (text, _) = incident.to_text().expect("text");
    // One line is the beginning.
    assert_eq!(text.lines().count() as u64, 1 + replayed.inputs);
}

#[test]
fn another_decision_is_found() {
    let folder = tempfile::tempdir().expect("a folder");
    let (path, other) = (folder.path().join("a.rec"), folder.path().join("b.rec"));
    live(&path, SMALL_SEGMENT, 5, 500);
    let records = RingReader::open(&path).and_then(|reader| reader.read(0)).expect("readable");
    let changed = |change: &dyn Fn(usize, Record) -> Option<Record>| {
        let _ = fs::remove_file(&other);
        let mut ring = Ring::open(&other).expect("a file");
        let kept = records.iter().cloned_by_codec().enumerate();
        let mut body = Vec::new();
        for record in kept.filter_map(|(index, record)| change(index, record)) {
            body.extend_from_slice(&polyptych_codec::framed(&polyptych_codec::encode(&record)));
        }
        ring.write(0, &body).expect("written");
        replayed(&other)
    };
    assert_eq!(changed(&|_, record| Some(record)).differences, 0);
    let at = records.iter().rposition(|r| matches!(r, Record::Decided(_))).expect("one");
    // Decided in another way.
    let difference = changed(&|index, record| match record {
        Record::Decided(decision) if index == at => {
            Some(Record::Decided(EffectDigest { digest: 1, ..decision }))
        }
        other => Some(other),
    });
    assert_eq!(difference.differences, 1);
    let first = difference.first_difference.expect("one");
    assert!(first.replayed.contains("of another content"), "{first:?}");
    // Decided nothing then.
    let difference = changed(&|index, record| (index != at).then_some(record));
    assert_eq!(difference.differences, 1);
    assert_eq!(difference.first_difference.expect("one").recorded, "nothing");
}

trait ClonedByCodec<'a>: Iterator<Item = &'a Record> + Sized {
    /// A checkpoint has no other way.
    fn cloned_by_codec(self) -> impl Iterator<Item = Record> {
        self.map(|record| {
            polyptych_protocol::framing::decode(&polyptych_codec::encode(record)).expect("the same")
        })
    }
}

impl<'a, I: Iterator<Item = &'a Record>> ClonedByCodec<'a> for I {}

#[test]
fn what_is_no_recording_is_refused_in_one_line() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("wall.rec");
    let refused = |bytes: &[u8]| {
        fs::write(&path, bytes).expect("written");
        let error = RingReader::open(&path).expect_err("no recording").to_string();
        assert!(error.starts_with(&path.display().to_string()) && !error.contains('\n'));
        error
    };
    assert!(refused(b"").contains("not a recording"));
    assert!(refused(&[7; 4096]).contains("not a recording"));
    assert!(matches!(Ring::open(&path), Err(RingError::Foreign { .. })), "it is left alone");
    assert_eq!(fs::read(&path).expect("still there"), [7; 4096]);
    let mut other = b"PLYPREC\0\x63\0\x01\0".to_vec();
    other.resize(64, 0);
    assert!(refused(&other).contains("recorded in format 99"));
    // One of another version is set aside, since a manager must be able to start.
    let ring = Ring::open(&path).expect("a new file");
    assert_eq!(ring.next_segment(), 0);
    assert_eq!(fs::read(folder.path().join("wall.rec.old")).expect("set aside"), other);
    assert!(matches!(Ring::open(&path), Err(RingError::Busy { .. })), "one writer at a time");
}

#[test]
fn a_kept_incident_holds_the_invariants_from_wherever_it_is_cut() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("wall.rec");
    live(&path, SMALL_SEGMENT, 6, 4000);
    let reader = RingReader::open(&path).expect("a recording");
    for (from_s, to_s) in [(None, None), (Some(3.0), None), (Some(2.0), Some(4.0))] {
        let cut = TimeRange { part: None, from_s, to_s };
        let incident = Incident::extract(&reader, &cut, "a test").expect("cut");
        let (text, left_out) = incident.to_text().expect("text");
        assert_eq!(left_out, 0);
        let kept = folder.path().join("kept.incident");
        fs::write(&kept, text).expect("written");
        let again = Incident::load(&kept).expect("loaded");
        assert_eq!(again.description(), "a test");
        let [a, b] = [incident, again].map(|incident| incident.check().expect("they hold"));
        assert_eq!(a, b);
        assert!(a.frames > 20 && a.inputs > 100, "{a:?}");
    }
    let nothing = TimeRange { from_s: Some(1e6), ..TimeRange::default() };
    assert!(Incident::extract(&reader, &nothing, "").is_err());
    assert!(
        Incident::extract(&reader, &TimeRange { part: Some(2), ..TimeRange::default() }, "")
            .is_err()
    );
}

#[test]
fn an_incident_may_end_while_a_scene_is_baked_and_a_session_is_read() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("wall.rec");
    let ring = Ring::open_with(&path, SMALL_SEGMENT).expect("a file");
    let mut life = RandomRun::new(Recorder::write_to(ring, &path).expect("a thread"), 8);
    life.ask(Request::OpenScene { path: "town.glb".into(), scene: None });
    life.ask(Request::OpenSession { name: "evening".into() });
    drop(life);
    let reader = RingReader::open(&path).expect("a recording");
    let incident = Incident::extract(&reader, &TimeRange::default(), "a test").expect("cut");
    let checked = incident.check().expect("both requests are answered");
    assert_eq!(checked.requests, 2);
}

#[test]
fn a_disk_that_stands_still_does_not_hold_the_end_of_a_recorder() {
    let (thaw, thawed) = sync_channel::<()>(0);
    let frozen = move |_: &RecordBatch| thawed.recv().map_err(io::Error::other);
    let buffer = Buffer::new(0, SMALL_SEGMENT);
    let recorder = Recorder::start(buffer, Path::new("wall.rec"), frozen).expect("a thread");
    let (end, ended) = sync_channel(1);
    let drops = move || {
        drop(recorder);
        end.send(()).expect("the test listens");
    };
    std::thread::Builder::new().name("end".into()).spawn(drops).expect("a thread");
    ended.recv_timeout(Duration::from_mins(1)).expect("the disk is not waited for");
    drop(thaw);
}

#[test]
fn channel_states_are_named_in_order() {
    let cluster = Cluster::new(wall(), Epoch(1));
    let states: Vec<_> = cluster.channel_states().map(|(name, state, ..)| (name, state)).collect();
    let expected = ["c0", "c1", "c2"].map(|name| (name, ChannelState::Lost));
    assert_eq!(states, expected);
}
