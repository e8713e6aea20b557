//! Failures of a wall as short deterministic tests: the clock is the test's own.

mod auto_exposure;
mod bounds;
mod catch_up;
mod clips;
mod devices;
mod displays;
mod editing;
mod environment;
mod failures;
mod follow;
mod found;
mod hostile;
mod light_effects;
mod navigation;
mod pipelining;
mod previews;
mod progress;
mod random;
mod residency;
mod rest;
mod sessions;
mod sight;
mod simulated;
mod tours;
mod tuning;

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{DVec2, DVec3, UVec2};
use polyptych_files::blob::BlobHash;
use polyptych_protocol::command::{Frame, Prepare};
use polyptych_protocol::feedback::ChannelState;
use polyptych_protocol::handshake::{Adapter, ServerHello};
use polyptych_protocol::ids::Revision;
use polyptych_protocol::quality_bounds::QualityBounds;
use polyptych_protocol::request::{Pacing, Request, SceneSummary};
use polyptych_protocol::server_message::{FrameRendered, Ping, Prepared};
use polyptych_protocol::state_log::SceneRef;
use polyptych_scene::{Bounds, PassTimes, SceneFeatures};
use polyptych_wall::surface::Plane;
use polyptych_wall::{Channel, Screen, Surface};

use super::*;
use polyptych_wall::camera::Camera;

const CLIENT: SessionId = SessionId(1000);

fn wall(channels: u32) -> Wall {
    let channel = |index: u32| {
        Channel::tile(&format!("c{index}"), 0, UVec2::new(index * 64, 0), UVec2::splat(64))
    };
    let plane = Plane::upright(DVec3::NEG_Z, DVec2::splat(2.0));
    let canvas = UVec2::new(64 * channels, 64);
    let screens = vec![Screen::new("front", Surface::Plane(plane), canvas)];
    Wall { near_m: 0.1, ..Wall::new("test", screens, (0..channels).map(channel).collect()) }
}

/// A wall whose servers are played by the test.
struct ClusterFixture {
    cluster: Cluster,
    now: Micros,
    next_id: u64,
    replicas: BTreeMap<SessionId, Replica>,
    /// The digests of all states that a server has prepared.
    digests: BTreeMap<(SessionId, Revision), Digest>,
    /// The state that the last frame named, by server.
    asked: BTreeMap<SessionId, Revision>,
    prepares: Vec<(SessionId, Prepare)>,
    frames: Vec<(SessionId, Frame)>,
    swaps: Vec<FrameId>,
    replies: Vec<(RequestId, Result<Response, RequestError>)>,
    progress: Vec<(RequestId, String)>,
    imports: Vec<ClientRequest>,
    collects: Vec<Vec<ChannelId>>,
    closed: Vec<SessionId>,
    memories: Vec<PersistentState>,
    /// What servers say of a scene; see [`Prepared::detail_reach`].
    detail_reach: Option<f64>,
}

impl ClusterFixture {
    /// A wall with `channels` servers that are live, and one client.
    fn new(channels: u32) -> Self {
        Self::live(wall(channels))
    }

    /// A wall whose servers are live, and one client.
    fn live(wall: Wall) -> Self {
        let channels = wall.channels.len() as u32;
        let mut stage = Self::of(wall);
        for index in 0..channels {
            stage.join(SessionId(u64::from(index)), index).expect("joined");
        }
        stage.prepare_all();
        for _ in 0..4 {
            stage.order_frame();
            stage.draw(&(0..channels).collect::<Vec<_>>(), 20_000);
        }
        stage.clear();
        stage
    }

    fn empty(channels: u32) -> Self {
        Self::of(wall(channels))
    }

    fn of(wall: Wall) -> Self {
        let mut cluster = Cluster::new(wall, Epoch(7));
        cluster.set_navigable(true);
        cluster.handle_client(CLIENT, "test".into());
        Self {
            cluster,
            now: 1_000_000,
            next_id: 0,
            replicas: BTreeMap::new(),
            digests: BTreeMap::new(),
            asked: BTreeMap::new(),
            prepares: Vec::new(),
            frames: Vec::new(),
            swaps: Vec::new(),
            replies: Vec::new(),
            progress: Vec::new(),
            imports: Vec::new(),
            collects: Vec::new(),
            closed: Vec::new(),
            memories: Vec::new(),
            detail_reach: None,
        }
    }

    fn clear(&mut self) {
        self.prepares.clear();
        self.frames.clear();
        self.swaps.clear();
        self.replies.clear();
    }

    fn join(&mut self, session: SessionId, index: u32) -> Result<(), String> {
        self.join_as(session, &format!("c{index}"), 100 + index)
    }

    fn join_as(&mut self, session: SessionId, channel: &str, pid: u32) -> Result<(), String> {
        let hello = ServerHello {
            name: channel.into(),
            channels: vec![channel.into()],
            pid,
            adapter: Adapter { texture_side_max: 8192, ..Adapter::default() },
        };
        let joined = self.cluster.handle_server(self.now, session, hello, "127.0.0.1:9".into());
        self.read();
        joined
    }

    /// Sorts what the core wants done.
    fn read(&mut self) {
        while let Some(output) = self.cluster.poll_effect() {
            match output {
                Effect::Command { to, command } => {
                    for session in to {
                        match &*command {
                            Command::Prepare(p) => self.prepares.push((session, p.clone())),
                            Command::Frame(frame) => {
                                let most = 1024 + 80 * frame.presentation.views.len();
                                let bytes = polyptych_codec::encode(&*command).len();
                                assert!(bytes < most, "{bytes} bytes");
                                self.asked.insert(session, frame.revision);
                                self.frames.push((session, frame.clone()));
                            }
                            _ => {}
                        }
                    }
                    if let Command::Swap(swap) = *command {
                        self.swaps.push(swap.frame);
                    }
                }
                Effect::Answer { answer: MessageToClient::Reply { id, reply }, .. } => {
                    self.replies.push((id, reply));
                }
                Effect::Answer { answer: MessageToClient::Progress { id, progress }, .. } => {
                    self.progress.push((id, progress.to_string()));
                }
                Effect::Answer { .. } | Effect::Stop | Effect::StopServers { .. } => {}
                Effect::Remember(memory) => self.memories.push(*memory),
                Effect::Import { job, .. } | Effect::OpenSession { job, .. } => {
                    self.imports.push(job);
                }
                Effect::Collect { channels, .. } => self.collects.push(channels),
                Effect::Close { session, .. } => self.closed.push(session),
            }
        }
    }

    fn request(&mut self, request: Request) -> RequestId {
        self.next_id += 1;
        let id = RequestId(self.next_id);
        self.cluster.handle_request(self.now, CLIENT, id, request);
        self.read();
        id
    }

    fn order_frame(&mut self) -> RequestId {
        self.request(Request::RenderFrame { camera: None, time_s: None })
    }

    fn say(&mut self, from: SessionId, status: ServerMessage) {
        self.cluster.handle_status(self.now, from, status);
        self.read();
    }

    /// The server folds the oldest preparation that it was sent, and says so.
    fn prepare(&mut self, session: SessionId) {
        let Some(at) = self.prepares.iter().position(|(to, _)| *to == session) else { return };
        let (_, prepare) = self.prepares.remove(at);
        let replica = match prepare.base {
            None => Replica::from_snapshot(prepare.revision, prepare.operations),
            Some(base) => {
                let mut replica = self.replicas[&session].clone();
                assert_eq!(replica.revision, base);
                prepare.operations.into_iter().for_each(|o| replica.apply(o));
                replica
            }
        };
        let prepared = Prepared {
            epoch: prepare.epoch,
            revision: prepare.revision,
            digest: replica.digest(),
            features: Vec::new(),
            scene_bytes: 0,
            detail_reach: self.detail_reach.filter(|_| replica.scene.is_some()),
        };
        self.digests.insert((session, replica.revision), prepared.digest);
        self.replicas.insert(session, replica);
        self.say(session, ServerMessage::Prepared(prepared));
    }

    fn prepare_all(&mut self) {
        while let Some((session, _)) = self.prepares.first() {
            self.prepare(*session);
        }
    }

    /// Returns a server's report on a drawing: of the state that its frame names, though a change
    /// may have gone on since.
    fn drawn(&self, channel: u32) -> FrameRendered {
        let id = ChannelId(channel as u16);
        let server = self.cluster.registry.channel(id).and_then(|channel| channel.server);
        let session = server.unwrap_or(SessionId(u64::from(channel)));
        let revision = self.asked.get(&session).copied();
        let revision = revision.unwrap_or(self.cluster.shown.revision);
        FrameRendered {
            epoch: Epoch(7),
            frame: self.cluster.frame,
            channel: id,
            revision,
            digest: self.digests.get(&(session, revision)).copied().unwrap_or(Digest(0)),
            draw_us: 20_000,
            triangles: 1,
            draw_calls: 1,
            error_fraction: 0.0,
            draws_occluded: 40,
            is_trial: false,
            passes: PassTimes::default(),
        }
    }

    /// These channels have drawn the present frame, after a while.
    fn draw(&mut self, channels: &[u32], after: Micros) {
        self.wait(after);
        for &channel in channels {
            let drawn = self.drawn(channel);
            self.say(SessionId(u64::from(channel)), ServerMessage::Drawn(drawn));
        }
    }

    /// Time passes; whoever is there gives signs of life.
    fn wait(&mut self, micros: Micros) {
        let end = self.now + micros;
        let live: Vec<_> = self.replicas.keys().copied().collect();
        for session in live {
            self.say(session, ServerMessage::Ping(Ping { sent_us: 0, memory_bytes: 0 }));
        }
        while let Some(due) = self.cluster.poll_timeout().filter(|due| *due <= end) {
            self.now = self.now.max(due);
            self.cluster.handle_timeout(self.now);
            self.read();
        }
        self.now = end;
    }

    fn state(&self, channel: usize) -> ChannelState {
        self.cluster.status(self.now).channels[channel].state
    }

    /// Returns whether the last answer is to this request, with a frame that every channel showed.
    fn is_answered_by_a_whole_frame(&self, id: RequestId) -> bool {
        let Some((of, Ok(Response::Frame(feedback)))) = self.replies.last() else { return false };
        *of == id && feedback.is_complete() && feedback.frame == self.cluster.swapped
    }

    fn imported() -> ImportedScene {
        let scene = SceneRef { name: "town".into(), manifest: BlobHash::of(b"town") };
        let summary = SceneSummary {
            name: "town".into(),
            revision: Revision(0),
            bounds: Some(Bounds { min: -DVec3::ONE, max: DVec3::ONE }),
            triangles: 3,
            features: SceneFeatures::default(),
            notes: Vec::new(),
            exposure: 1.0,
            clips: Vec::new(),
        };
        ImportedScene::of_file(scene, summary, Arc::default())
    }
}

#[test]
fn a_frame_is_swapped_once_when_all_have_drawn() {
    let mut stage = ClusterFixture::new(3);
    stage.order_frame();
    stage.draw(&[0, 2], 1_000);
    assert!(stage.swaps.is_empty(), "channel 1 has not drawn");
    stage.draw(&[1], 1_000);
    assert_eq!(stage.swaps, [stage.cluster.frame]);
    let [(_, Ok(Response::Frame(feedback)))] = &stage.replies[..] else { panic!("one feedback") };
    assert!(feedback.channels.iter().all(|c| c.draw_us.is_some()));
    assert_eq!(feedback.frame_us, 2_000);
}

#[test]
fn a_channel_that_hangs_holds_the_wall_for_one_deadline_only() {
    let mut stage = ClusterFixture::new(3);
    stage.order_frame();
    // Four times the median of 20 ms.
    stage.draw(&[0, 1], 79_000);
    assert!(stage.swaps.is_empty());
    stage.wait(1_001);
    assert_eq!(stage.swaps.len(), 1);
    assert_eq!(stage.state(2), ChannelState::Late);
    stage.order_frame();
    stage.draw(&[0, 1], 10_000);
    assert_eq!(stage.swaps.len(), 2, "the late channel is not waited for");
    // In time again, it is waited for after eight frames.
    for n in 0..8 {
        assert_eq!(stage.state(2), ChannelState::Late, "after {n} frames in time");
        stage.order_frame();
        stage.draw(&[2, 0, 1], 5_000);
    }
    assert_eq!(stage.state(2), ChannelState::Live);
    // A relapse costs twice as much.
    stage.order_frame();
    stage.draw(&[0, 1], 10_000);
    stage.wait(2_000_000);
    for _ in 0..15 {
        stage.order_frame();
        stage.draw(&[2, 0, 1], 5_000);
    }
    assert_eq!(stage.state(2), ChannelState::Late);
    stage.order_frame();
    stage.draw(&[2, 0, 1], 5_000);
    assert_eq!(stage.state(2), ChannelState::Live);
}

#[test]
fn a_late_channel_that_draws_in_time_counts_neither_as_slow_nor_for_the_deadline() {
    let mut stage = ClusterFixture::new(2);
    stage.order_frame();
    stage.draw(&[0], 1_000);
    stage.wait(100_000);
    assert_eq!(stage.state(1), ChannelState::Late);
    stage.request(Request::Statistics { reset: true });
    let before = stage.cluster.deadline.length();
    for _ in 0..4 {
        stage.order_frame();
        let slow = FrameRendered { draw_us: 900_000, ..stage.drawn(1) };
        stage.say(SessionId(1), ServerMessage::Drawn(slow));
        stage.draw(&[0], 20_000);
    }
    assert_eq!(stage.cluster.deadline.length(), before);
    assert!(stage.cluster.statistics(false).draw_ms.max < 21.0);
}

#[test]
fn a_wall_of_late_channels_waits_for_them() {
    let mut stage = ClusterFixture::new(1);
    stage.order_frame();
    stage.wait(100_000);
    assert_eq!(stage.state(0), ChannelState::Late);
    for n in 2..10 {
        stage.order_frame();
        stage.wait(1_000_000);
        assert_eq!(stage.swaps.len(), n - 1, "nothing is shown that nobody has drawn");
        stage.draw(&[0], 500_000);
        assert_eq!(stage.swaps.len(), n);
    }
    assert_eq!(stage.state(0), ChannelState::Live);
}

#[test]
fn a_late_comer_gets_a_snapshot_and_nobody_waits_for_it() {
    let mut stage = ClusterFixture::empty(2);
    stage.join(SessionId(0), 0).expect("joined");
    stage.prepare_all();
    stage.order_frame();
    stage.draw(&[0], 1_000);
    stage.join(SessionId(1), 1).expect("joined");
    assert_eq!(stage.prepares[0].1.base, None, "a snapshot");
    stage.order_frame();
    stage.draw(&[0], 1_000);
    assert_eq!(stage.swaps.len(), 2);
    assert_eq!(stage.state(1), ChannelState::Preparing);
    let last = stage.frames.last().expect("sent").1.time_s;
    stage.prepare_all();
    // Nobody orders frames: it is given one all the same, of the time that the others show.
    assert_eq!(stage.state(1), ChannelState::Live);
    let (to, frame) = stage.frames.last().expect("sent");
    assert_eq!((*to, frame.time_s), (SessionId(1), last));
}

#[test]
fn a_scene_is_shown_when_all_live_channels_are_prepared() {
    let mut stage = ClusterFixture::new(2);
    let before = stage.cluster.shown.revision;
    let id = stage.request(Request::OpenScene { path: "town.glb".into(), scene: None });
    let job = stage.imports[0];
    let imported = ClusterFixture::imported();
    stage.cluster.handle_import(stage.now, job, Ok(imported));
    stage.read();
    stage.prepare(SessionId(0));
    assert!(stage.replies.is_empty());
    stage.order_frame();
    assert_eq!(stage.frames.last().expect("sent").1.revision, before, "drawn as before");
    stage.draw(&[0, 1], 1_000);
    stage.replies.clear();
    stage.prepare(SessionId(1));
    let (of, Ok(Response::SceneOpened(summary))) = &stage.replies[0] else { panic!("opened") };
    assert_eq!((*of, summary.revision), (id, Revision(before.0 + 1)));
    stage.order_frame();
    assert_eq!(stage.frames.last().expect("sent").1.revision, Revision(before.0 + 1));
}

#[test]
fn a_restored_wall_goes_on_where_it_was() {
    let mut stage = ClusterFixture::new(1);
    let job = ClientRequest { client: CLIENT, id: RequestId(99) };
    stage.cluster.handle_import(stage.now, job, Ok(ClusterFixture::imported()));
    stage.read();
    stage.prepare_all();
    let camera = Camera { scale: 3.0, ..Camera::IDENTITY };
    stage.request(Request::SetCamera(camera));
    let memory = stage.memories.pop().expect("remembered before the answer");
    assert_eq!((memory.revision, memory.presentation.camera), (Revision(2), camera));

    let restored = Cluster::restore(wall(1), Epoch(8), &memory);
    assert_eq!(restored.shown, stage.cluster.shown);
    assert_eq!(restored.shown_digest, stage.cluster.shown_digest);
    assert_eq!(restored.presentation.camera, camera);
    // What another wall cannot take over was dropped before.
    let other = Cluster::restore(wall(2), Epoch(9), &memory);
    assert_eq!((other.shown.revision, other.presentation.camera), (Revision(2), camera));
    assert_eq!(other.shown.scene, stage.cluster.shown.scene);
}

#[test]
fn a_server_that_owes_an_answer_is_sent_nothing_more() {
    let mut stage = ClusterFixture::new(2);
    stage.order_frame();
    stage.draw(&[0], 1_000);
    stage.wait(100_000);
    assert_eq!(stage.state(1), ChannelState::Late);
    // Twenty changes that the late server does not answer; the wall does not wait for it.
    for _ in 0..20 {
        stage.request(Request::CloseScene);
        stage.prepare(SessionId(0));
    }
    assert!(stage.replies.iter().filter(|(_, reply)| *reply == Ok(Response::Done)).count() == 20);
    assert_eq!(stage.prepares.iter().filter(|(to, _)| *to == SessionId(1)).count(), 1);
    // Once it answers it is given the newest state, whole.
    stage.prepare(SessionId(1));
    let (to, prepare) = stage.prepares.last().expect("prompted");
    assert_eq!((*to, prepare.base, prepare.revision), (SessionId(1), None, Revision(21)));
}

#[test]
fn what_cannot_be_imported_or_prepared_changes_nothing() {
    let mut stage = ClusterFixture::new(1);
    stage.request(Request::OpenScene { path: "broken.glb".into(), scene: None });
    let job = stage.imports[0];
    stage.cluster.handle_import(stage.now, job, Err("broken.glb: not glTF".into()));
    stage.read();
    assert!(stage.replies[0].1.as_ref().is_err_and(|f| f.reason.contains("broken.glb")));

    let digest_before = stage.cluster.shown.scene.clone();
    let imported = ClusterFixture::imported();
    stage.cluster.handle_import(stage.now, job, Ok(imported));
    stage.read();
    let (_, prepare) = stage.prepares.remove(0);
    let failed = ServerMessage::PrepareFailed {
        epoch: Epoch(7),
        revision: prepare.revision,
        reason: "out of memory".into(),
    };
    stage.say(SessionId(0), failed);
    assert!(stage.replies[1].1.as_ref().is_err_and(|f| f.reason.contains("out of memory")));
    assert_eq!(stage.cluster.shown.scene, digest_before);
    // The server is brought back to the old scene and goes on.
    stage.prepare_all();
    stage.order_frame();
    stage.draw(&[0], 1_000);
    assert_eq!(stage.swaps.len(), 1);
}

#[test]
fn a_claim_that_cannot_be_is_refused_by_name() {
    let mut stage = ClusterFixture::new(2);
    let unknown = stage.join_as(SessionId(8), "roof", 1).expect_err("refused");
    assert!(unknown.contains("roof") && unknown.contains("c0, c1"), "{unknown}");
    let taken = stage.join_as(SessionId(9), "c1", 55).expect_err("refused");
    assert!(taken.contains("process 101"), "{taken}");
    assert_eq!(stage.state(1), ChannelState::Live);
    // The same process, come back before its old connection was found dead.
    stage.join_as(SessionId(10), "c1", 101).expect("joined");
    assert_eq!(stage.closed, [SessionId(1)]);
}

#[test]
fn a_silent_server_is_lost_and_frames_go_on_at_once() {
    let mut stage = ClusterFixture::new(2);
    stage.replicas.remove(&SessionId(1));
    stage.wait(1_900_000);
    assert_eq!(stage.state(1), ChannelState::Live);
    stage.wait(200_000);
    assert_eq!(stage.state(1), ChannelState::Lost);
    assert_eq!(stage.closed, [SessionId(1)]);
    stage.order_frame();
    stage.draw(&[0], 1_000);
    assert_eq!(stage.swaps.len(), 1);
}

#[test]
fn a_server_that_dies_during_a_frame_does_not_hold_it() {
    let mut stage = ClusterFixture::new(2);
    stage.order_frame();
    stage.draw(&[0], 1_000);
    stage.cluster.handle_server_gone(stage.now, SessionId(1), "killed");
    stage.read();
    assert_eq!(stage.swaps.len(), 1);
}

#[test]
fn a_replica_that_disagrees_is_not_believed() {
    let mut stage = ClusterFixture::new(2);
    stage.order_frame();
    let wrong = FrameRendered { digest: Digest(1), ..stage.drawn(1) };
    stage.say(SessionId(1), ServerMessage::Drawn(wrong));
    assert_eq!(stage.state(1), ChannelState::Preparing);
    assert_eq!(stage.prepares[0].1.base, None, "a snapshot");
    stage.draw(&[0], 1_000);
    assert_eq!(stage.swaps.len(), 1, "nobody waits for it");
}

#[test]
fn a_capture_collects_late_channels_too_but_the_wall_goes_on() {
    let mut stage = ClusterFixture::new(3);
    stage.order_frame();
    stage.draw(&[0, 2], 1_000);
    stage.wait(100_000);
    assert_eq!(stage.state(1), ChannelState::Late);
    stage.request(Request::Capture { time_s: None });
    assert_eq!(stage.collects, [[0, 1, 2].map(ChannelId)]);
    stage.draw(&[0], 300_000);
    assert_eq!(stage.swaps.len(), 1, "a live channel may take as long as any frame waits");
    stage.wait(1_800_000);
    assert_eq!(stage.swaps.len(), 2);
}

#[test]
fn a_flooding_client_is_told_where_the_limit_is() {
    let mut stage = ClusterFixture::new(1);
    let asked = FRAME_ORDERS_MAX + 10;
    for _ in 0..asked {
        stage.order_frame();
    }
    let refused = stage.replies.iter().filter(|(_, reply)| reply.is_err()).count();
    // One frame is on its way already.
    assert_eq!(refused, asked - FRAME_ORDERS_MAX - 1);
}

#[test]
fn a_wall_without_channels_neither_spins_nor_stops() {
    let mut stage = ClusterFixture::empty(2);
    stage.request(Request::Run(Pacing::Free));
    stage.wait(1_000_000);
    let frames = stage.cluster.frame.0;
    assert!((20..200).contains(&frames), "{frames} frames in a second");
}
