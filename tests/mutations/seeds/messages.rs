//! A valid message of every variant, as it stands on the wire.

use std::num::NonZeroU32;

use super::manifest::scene;
use bytes::Bytes;
use glam::{DMat3, DQuat, DVec2, DVec3, UVec2};
use polyptych_codec::encode;
use polyptych_files::blob::BlobHash;
use polyptych_protocol::bulk::{BlobChunk, BulkToManager, BulkToServer, CaptureChunk};
use polyptych_protocol::calibration_marker::{CalibrationMarker, MarkedPoint};
use polyptych_protocol::clip::{ClipAction, ClipChange};
use polyptych_protocol::command::{Command, Frame, Goodbye, Pong, Prepare, Swap};
use polyptych_protocol::device_status::DeviceStatus;
use polyptych_protocol::exported_scene::ExportedScene;
use polyptych_protocol::feedback::{
    ChannelFeedback, ChannelState, ChannelStatus, Edited, FrameFeedback, Skew, Tuned, WallStatus,
};
use polyptych_protocol::handshake::{
    Adapter, BulkHello, ClientHello, Hello, HelloReply, Introduction, Nonces, Rejection, Secret,
    ServerHello, Welcome,
};
use polyptych_protocol::ids::{Digest, Epoch, FrameId, RequestId, Revision, Term};
use polyptych_protocol::leader_status::LeaderStatus;
use polyptych_protocol::navigation::{Flight, Navigation};
use polyptych_protocol::node_query::{NearestQuery, NodeKind, NodeQuery, RayQuery};
use polyptych_protocol::output_mode::OutputMode;
use polyptych_protocol::pattern::TestPattern;
use polyptych_protocol::presentation::Presentation;
use polyptych_protocol::progress::{OpenProgress, Opening};
use polyptych_protocol::quality_bounds::{DetailBound, DrawnDetail, QualityBounds};
use polyptych_protocol::request::{
    self, CaptureInfo, ImageInfo, Pacing, ReplyChunk, Request, RequestError, RequestMessage,
    Response, SceneSummary,
};
use polyptych_protocol::saved_scene::SavedScene;
use polyptych_protocol::saved_session::{OpenedSession, SavedSession};
use polyptych_protocol::scene_file_list::{SceneFileInfo, SceneFileList};
use polyptych_protocol::screen_rest::{LitHours, RestRules, RestStatus};
use polyptych_protocol::server_message::{
    FramePresented, FrameRendered, Ping, Prepared, ServerMessage,
};
use polyptych_protocol::state_log::{Operation, SceneRef};
use polyptych_protocol::stored_view::StoredView;
use polyptych_protocol::tour_status::TourStatus;
use polyptych_protocol::tuned_channel::TunedChannel;
use polyptych_scene::residency::SeenFrom;
use polyptych_scene::{Attribute, Bounds, ClipTime, NodeId, Scene, SceneFeatures, SceneSubset};
use polyptych_wall::calibration_change::{CalibrationChange, Corner, Edge, Offset};
use polyptych_wall::camera::Camera;
use polyptych_wall::head::HeadPose;
use polyptych_wall::pick_ray::Ray;
use polyptych_wall::tour::{Easing, Tour, TourStop};
use polyptych_wall::view::{Area, View, ViewProjection};
use polyptych_wall::{ChannelId, Wall};

use super::editing::{answers_about_space, follow, regions, scene_edits, transaction, walked, way};
use super::light::{light_operations, lights, luminance};
use super::statistics::{passes, statistics};
use crate::message::Kind;

/// The manager's life in all seeds, so that the core takes them for its own.
pub const EPOCH: Epoch = Epoch(7);

/// The token that the manager expects.
pub const TOKEN: &str = "0123456789abcdef";

/// The wall of all seeds: two screens with a name in every list.
pub fn wall() -> Wall {
    polyptych_wall_file::parse(super::walls::SEEDS[0], "seed.toml".as_ref()).expect("a wall")
}

/// One message of every variant.
pub fn all() -> Vec<(Kind, Bytes)> {
    let lists = [
        (Kind::Introduction, introductions().iter().map(encode).collect::<Vec<_>>()),
        (Kind::Greeting, greetings().iter().map(encode).collect()),
        (Kind::Command, commands().iter().map(encode).collect()),
        (Kind::Status, statuses().iter().map(encode).collect()),
        (Kind::Call, calls().iter().map(encode).collect()),
        (Kind::Answer, answers().iter().map(encode).collect()),
        (Kind::BulkUp, bulk_ups().iter().map(encode).collect()),
        (Kind::BulkDown, bulk_downs().iter().map(encode).collect()),
        (Kind::Manifest, vec![encode(&Scene::default()), encode(&scene())]),
    ];
    lists.into_iter().flat_map(|(kind, list)| list.into_iter().map(move |b| (kind, b))).collect()
}

fn nonces() -> Nonces {
    Nonces { manager: [1; 32], peer: [2; 32] }
}

/// The hellos as they travel; none is proven, since the manager's random bytes are others.
fn introductions() -> Vec<Introduction> {
    let introduction = |hello: Hello| {
        let proof = nonces().proof_of_peer(&Secret(TOKEN.into()), &hello);
        Introduction { hello, nonce: nonces().peer, proof }
    };
    hellos().into_iter().map(introduction).collect()
}

pub fn hellos() -> Vec<Hello> {
    let adapter = Adapter {
        name: "llvmpipe".into(),
        driver: "Mesa".into(),
        backend: "Vulkan".into(),
        texture_side_max: 8192,
    };
    let server = |channels: &[&str]| ServerHello {
        name: "left".into(),
        channels: channels.iter().map(|name| (*name).into()).collect(),
        pid: 4242,
        adapter: adapter.clone(),
    };
    vec![
        Hello::Client(ClientHello { name: "ann".into() }),
        Hello::Server(server(&["a-1-1"])),
        Hello::Server(server(&["a-2-1", "b"])),
        Hello::Bulk(BulkHello { session: 2 }),
    ]
}

fn greetings() -> Vec<HelloReply> {
    let (term, wall) = (Term(2), "seed".into());
    vec![
        HelloReply::Refused(Rejection { reason: "no".into() }),
        HelloReply::Welcome(
            Welcome { epoch: EPOCH, term, session: 2, wall, heartbeat_ms: 2000 },
            nonces().proof_of_manager(&Secret(TOKEN.into())),
        ),
    ]
}

fn camera() -> Camera {
    Camera { position: DVec3::new(1.0, -2.0, 1e7), rotation: DQuat::IDENTITY, scale: 0.5 }
}

fn scene_ref() -> SceneRef {
    SceneRef { name: "town".into(), manifest: BlobHash([0xab; 32]) }
}

fn commands() -> Vec<Command> {
    let place = SeenFrom { position: DVec3::X, density: 1000.0, is_parallel: false };
    let mut operations = vec![
        Operation::SetWall(Box::new(wall())),
        Operation::OpenScene(scene_ref()),
        Operation::EditScene(transaction().edits.into()),
        Operation::CloseScene,
        Operation::SetEdits(Box::new(scene_edits())),
        Operation::SetSeenFrom(vec![place]),
    ];
    operations.extend(light_operations());
    let part = Area::Screen { screen: 0, rect: [10, 20, 100, 200] };
    let projection = ViewProjection::Orthographic { height_m: 50.0 };
    let view = |area| View { area, projection, ..View::of_wall(camera()) };
    let frame = Frame {
        epoch: EPOCH,
        frame: FrameId(1),
        time_s: 1.5,
        revision: Revision(1),
        presentation: Presentation {
            camera: camera(),
            views: vec![view(Area::Wall), view(part)],
            output_mode: OutputMode::Identify,
            pattern: Some(TestPattern::Overlap),
            ..Presentation::new(HeadPose::facing_forward(DVec3::new(0.0, 0.1, 0.2), 0.06))
        },
        capture: Some(NonZeroU32::MIN),
        detail: DetailBound {
            error_px: 0.5,
            densities: vec![2000.0, 10.0],
            resolution_steps: 3,
            follows_rate: true,
        },
        clips: vec![ClipTime { clip: 1, time_s: 2.5, weight: 0.5 }],
        is_metered: false,
    };
    let (revision, shown) = (Revision(2), Revision(1));
    let whole = Prepare { epoch: EPOCH, base: None, revision, shown, operations };
    vec![
        Command::Prepare(whole.clone()),
        Command::Prepare(Prepare { base: Some(shown), operations: Vec::new(), ..whole }),
        Command::Frame(frame),
        Command::Swap(Swap {
            epoch: EPOCH,
            frame: FrameId(1),
            not_after_us: 2_000_000,
            present_at_us: Some(1_000_000),
        }),
        Command::Pong(Pong { sent_us: 1, received_us: 2, answered_us: 3 }),
        Command::Goodbye(Goodbye::Stopped),
        Command::Goodbye(Goodbye::closed("the end")),
    ]
}

fn statuses() -> Vec<ServerMessage> {
    let (channel, frame, revision) = (ChannelId(0), FrameId(1), Revision(1));
    let drawn = FrameRendered {
        epoch: EPOCH,
        frame,
        channel,
        revision,
        digest: Digest(9),
        draw_us: 20_000,
        triangles: 100_000,
        draw_calls: 6,
        error_fraction: 0.0,
        draws_occluded: 40,
        is_trial: false,
        passes: passes(),
    };
    let (features, scene_bytes, detail_reach) = (vec!["blend".into()], 1000, Some(2.5));
    let prepared =
        Prepared { epoch: EPOCH, revision, digest: Digest(9), features, scene_bytes, detail_reach };
    vec![
        ServerMessage::Prepared(prepared),
        ServerMessage::PrepareFailed { epoch: EPOCH, revision, reason: "no room".into() },
        ServerMessage::Drawn(drawn),
        ServerMessage::DrawFailed { channel, frame, reason: "no device".into() },
        ServerMessage::Shown(FramePresented {
            epoch: EPOCH,
            frame,
            channel,
            at_us: 70_000,
            clock_error_us: 40,
            is_unscheduled: true,
        }),
        ServerMessage::Ping(Ping { sent_us: 1, memory_bytes: 1 << 28 }),
        ServerMessage::Display { channel, warning: Some("monitor A shows 512x768".into()) },
        ServerMessage::Storage { warning: Some("s3://walls/blobs: no answer".into()) },
        ServerMessage::Navigate(Navigation {
            channel: "a-1-1".into(),
            orbit_rad: DVec2::new(0.1, -0.2),
            pan: DVec2::new(0.0, 0.5),
            zoom: 1.2,
        }),
        ServerMessage::Goodbye { reason: "it sends nonsense".into() },
        ServerMessage::StateLost { reason: "device lost".into() },
        ServerMessage::Luminance(luminance()),
    ]
}

fn plan() -> View {
    let layers = Some(vec!["day".to_owned()]);
    let area = Area::Screen { screen: 0, rect: [10, 20, 100, 200] };
    let projection = ViewProjection::Perspective { fov_y_rad: 0.8 };
    View { area, projection, root: Some(1), layers, ..View::of_wall(camera()) }
}

fn tuning() -> Vec<CalibrationChange> {
    let (to, by) = (Offset::To(DVec2::new(1.0, -2.0)), Offset::By(DVec2::new(0.5, 0.25)));
    vec![
        CalibrationChange::Pin { corner: Corner::LowerRight, to: by },
        CalibrationChange::Grid(Some(UVec2::new(3, 2))),
        CalibrationChange::Bend { column: 1, row: 1, to },
        CalibrationChange::Gain(DVec3::new(1.0, 0.9, 1.0)),
        CalibrationChange::Leak(Some(DVec3::new(0.01, 0.0, 0.2))),
        CalibrationChange::Matrix(DMat3::IDENTITY),
        CalibrationChange::Gamma(Some(DVec3::splat(2.2))),
        CalibrationChange::Edge { side: Edge::Left, width: Some(12.0) },
    ]
}

fn tour() -> Tour {
    let stop = TourStop::new(camera(), 2.0).with_stay(0.5);
    Tour { stops: vec![stop, stop.with_easing(Easing::Linear)], is_loop: true }
}

fn calls() -> Vec<RequestMessage> {
    let requests = [
        Request::OpenScene { path: "town.glb".into(), scene: Some("night".into()) },
        Request::CloseScene,
        Request::SetCamera(camera()),
        Request::SetHead(DVec3::new(0.0, 0.1, 0.2).into()),
        Request::SetExposure(2.0),
        Request::RenderFrame { camera: Some(camera()), time_s: Some(1.0) },
        Request::RenderFrame { camera: None, time_s: None },
        Request::Redraw(Some(camera())),
        Request::Run(Pacing::Free),
        Request::Run(Pacing::Rate(60.0)),
        Request::Pause,
        Request::Capture { time_s: None },
        Request::Preview { width: 1920 },
        Request::Status,
        Request::DescribeWall,
        Request::Statistics { reset: true },
        Request::Subscribe(true),
        Request::Stop,
        Request::StopServers,
        Request::OpenOutcome { session: 7, of: RequestId(9) },
        Request::SetDisplays(OutputMode::Blank),
        Request::SetHead(HeadPose::facing_forward(DVec3::Y, 0.06).into()),
        Request::Fly(Flight { offset_m: DVec3::NEG_Z, turn_rad: DVec2::new(0.1, 0.0) }),
        Request::ReportDevices(vec![DeviceStatus::waiting("tracker", "no reading")]),
        Request::SetViews(vec![View::of_wall(camera()), plan()]),
        Request::SetPattern(Some(TestPattern::Focus)),
        Request::Tune { channel: "a-1-1".into(), changes: tuning() },
        Request::Edit(transaction()),
        Request::CastRay(RayQuery {
            ray: Ray { origin: DVec3::Z, direction: DVec3::NEG_Z },
            max_distance: Some(9.0),
            subset: SceneSubset { root: Some(NodeId(1)), layers: Some(vec!["day".into()]) },
        }),
        Request::FindNodes(NodeQuery {
            name: Some("arm".into()),
            below: Some(NodeId(0)),
            attribute: Some(("kind".into(), Some(Attribute::Number(1.5)))),
            layer: Some("plan-a".into()),
            kind: Some(NodeKind::Mesh),
            skip: 3,
            count: 1000,
        }),
        Request::NearestPoint(NearestQuery { point: DVec3::ONE, within: Some(2.5) }),
        Request::Capture { time_s: Some(2.5) },
        Request::StoreView { name: "quay".into(), camera: Some(camera()) },
        Request::RemoveView { name: "quay".into() },
        Request::ListStoredViews,
        Request::PlayTour(tour()),
        Request::StopTour,
        Request::DescribeTour,
        Request::SaveScene { name: "evening".into() },
        Request::ListSavedScenes,
        Request::ListLayers,
        Request::SetBounds(QualityBounds { error_px: 0.5, rate_fps: Some(30.0) }),
        Request::ChangeClips(ClipChange { clip: Some("walk".into()), action: clip_action() }),
        Request::ListClips,
        Request::ListVariants,
        Request::ListTunings,
        Request::RemoveSavedScene { name: "evening".into() },
        Request::MarkPoint(Some(marker())),
        Request::ListSceneFiles,
        Request::SetRest(rest().rules),
        Request::FollowNode(follow()),
        Request::FindWay(way()),
        Request::ExportScene { saved: Some("evening".into()) },
    ];
    let found = regions().map(Request::FindInRegion);
    let requests = requests.into_iter().chain(found).chain(lights()).chain(sessions());
    requests.zip(1..).map(|(request, id)| RequestMessage::new(RequestId(id), request)).collect()
}

fn sessions() -> [Request; 4] {
    let name = || "evening".to_owned();
    [
        Request::SaveSession { name: name() },
        Request::OpenSession { name: name() },
        Request::ListSessions,
        Request::RemoveSession { name: name() },
    ]
}

fn feedback() -> FrameFeedback {
    let channel = ChannelFeedback {
        name: "a-1-1".into(),
        state: ChannelState::Live,
        draw_us: Some(20_000),
        triangles: 100_000,
        draw_calls: 6,
        since_ms: 10,
        reason: Some("slow".into()),
        shown_at_us: Some(1_000_000),
        skew: skew(),
    };
    FrameFeedback {
        frame: FrameId(1),
        time_s: 1.5,
        revision: Revision(1),
        frame_us: 21_000,
        barrier_us: 1000,
        navigations: 2,
        detail: DrawnDetail {
            error_in_force_px: 0.5,
            largest_error_px: 0.25,
            limiting_channel: Some("a-1-1".into()),
            resolution_scale: 0.5,
            awaits_detail: true,
        },
        channels: vec![channel; 3],
    }
}

fn skew() -> Skew {
    Skew { frames: 9, p50_us: 100, p99_us: 300, max_us: 900, clock_error_us: Some(60) }
}

fn status() -> WallStatus {
    let channel = ChannelStatus {
        name: "a-1-1".into(),
        state: ChannelState::Late,
        since_ms: 10,
        reason: Some("slow".into()),
        pid: Some(42),
        address: Some("127.0.0.1:5".into()),
        adapter: Some("llvmpipe".into()),
        frame: FrameId(1),
        revision: Revision(1),
        late: 3,
        draw_us: Some(20_000),
        skew: skew(),
        memory_bytes: 1 << 28,
        scene_bytes: 1 << 20,
    };
    WallStatus {
        wall: "seed".into(),
        epoch: EPOCH,
        revision: Revision(1),
        digest: Digest(9),
        frame: FrameId(1),
        scene: Some("town".into()),
        deadline_ms: 50.0,
        error_in_force_px: 0.5,
        channels: vec![channel; 3],
        clients: vec!["ann".into()],
        warnings: vec!["mixed".into()],
        notes: vec!["animations: 1 is not played".into()],
        opening: vec![Opening { scene: "town".into(), progress: OpenProgress::NONE }],
        memory_bytes: 81_000_000,
        resolution_scale: 0.5,
        environment: Some("studio.hdr".into()),
        rest: rest(),
        devices: Vec::new(),
        leader: Some(LeaderStatus { term: Term(3), holder: "two:7878".into() }),
        presentation: Presentation {
            marker: Some(marker()),
            output_mode: OutputMode::Freeze,
            pattern: Some(TestPattern::Grid),
            ..Presentation::new(HeadPose::facing_forward(DVec3::Y, 0.06))
        },
    }
}

fn rest() -> RestStatus {
    let hours = Some(LitHours { from_min: 540, until_min: 1080 });
    RestStatus { rules: RestRules { idle_s: Some(600.0), hours }, is_resting: true }
}

fn marker() -> CalibrationMarker {
    CalibrationMarker { channel: "a-1-1".into(), point: MarkedPoint::Bend { column: 1, row: 2 } }
}

fn exported() -> ExportedScene {
    ExportedScene {
        name: "evening".into(),
        bytes: 1 << 20,
        nodes: 300,
        meshes: 20,
        textures: 3,
        notes: vec!["materials: 1 is sheared".into()],
    }
}

fn answers() -> Vec<request::MessageToClient> {
    let summary = SceneSummary {
        name: "town".into(),
        revision: Revision(2),
        bounds: Some(Bounds { min: DVec3::ZERO, max: DVec3::ONE }),
        triangles: 100_000,
        features: SceneFeatures::from_scene(&scene()),
        notes: vec!["animations: 1 is not played".into()],
        exposure: 1.0,
        clips: Vec::new(),
    };
    let info = ImageInfo { name: "front".into(), is_screen: true, width: 1920, height: 1080 };
    let captured = CaptureInfo {
        frame: FrameId(1),
        pictures: vec![info],
        missing: vec![("b".into(), "late".into())],
    };
    let id = RequestId(5);
    let replies = [
        Ok(Response::Done),
        Ok(Response::SceneOpened(summary.clone())),
        Ok(Response::Frame(feedback())),
        Ok(Response::Captured(captured)),
        Ok(Response::Status(Box::new(status()))),
        Ok(Response::Wall(Box::new(wall()))),
        Ok(Response::Statistics(Box::new(statistics()))),
        Ok(Response::Edited(Edited {
            revision: Revision(3),
            created: vec![NodeId(9)],
            assets: None,
            frames: 1,
            feedback: feedback(),
            notes: vec!["animations: 1 is not played".into()],
        })),
        Ok(Response::Exported(exported())),
        Ok(Response::Tuned(Tuned { revision: Revision(3), frames: 1, feedback: feedback() })),
        Ok(Response::Tunings(vec![TunedChannel {
            channel: "a-1-1".into(),
            keys: vec!["pin".into()],
        }])),
        Ok(Response::ServersStopped(request::StoppedServers {
            ended: vec!["left".into()],
            silent: vec![("right".into(), "it said nothing".into())],
            absent: vec!["floor".into()],
        })),
        Ok(Response::StoredViews(vec![StoredView { name: "quay".into(), camera: camera() }])),
        Ok(Response::Tour(Box::new(TourStatus {
            tour: Some(tour()),
            following: Some(NodeId(3)),
            began_s: Some(1.5),
            time_s: 2.0,
            pace: Some(Pacing::Rate(60.0)),
        }))),
        Ok(Response::Way(Box::new(walked()))),
        Err(RequestError::new("no such scene")),
    ];
    let part = ReplyChunk { id, index: 1, bytes: Bytes::from_static(&[7; 64]) };
    let others = [
        request::MessageToClient::Feedback(feedback()),
        request::MessageToClient::Chunk(part),
        request::MessageToClient::Progress { id, progress: OpenProgress::NONE },
        request::MessageToClient::Warning { id, warning: "the disk is full".into() },
        request::MessageToClient::Goodbye(Goodbye::Ended),
        request::MessageToClient::Heartbeat,
    ];
    let replies =
        replies.into_iter().chain(answers_about_space()).chain(answers_about_kept(summary));
    let replies = replies.map(|reply| request::MessageToClient::Reply { id, reply });
    replies.chain(others).collect()
}

/// Answers about what the manager keeps under names, and about its files.
fn answers_about_kept(summary: SceneSummary) -> [Result<Response, RequestError>; 4] {
    [
        Ok(Response::SavedScenes(vec![SavedScene {
            name: "evening".into(),
            scene: "town".into(),
            edited_nodes: 3,
            saved_at_s: 1 << 30,
        }])),
        Ok(Response::SceneFiles(SceneFileList {
            files: vec![SceneFileInfo { path: "town.glb".into(), bytes: 9, changed_at_s: 1 << 30 }],
            is_cut: true,
        })),
        Ok(Response::Sessions(vec![SavedSession {
            name: "evening".into(),
            scene: Some("town".into()),
            views: 2,
            stored_views: 5,
            saved_at_s: 1 << 30,
        }])),
        Ok(Response::SessionOpened(Box::new(OpenedSession {
            scene: Some(summary),
            left_out: vec!["view 1: its screen is not known".into()],
        }))),
    ]
}

fn bulk_ups() -> Vec<BulkToManager> {
    let chunk = CaptureChunk {
        channel: ChannelId(0),
        frame: FrameId(1),
        width: 64,
        height: 64,
        offset: 0,
        bytes: Bytes::from_static(&[3; 256]),
    };
    vec![
        BulkToManager::Want(BlobHash([1; 32])),
        BulkToManager::Picture(chunk),
        BulkToManager::WantRest { hash: BlobHash([1; 32]), offset: 1 << 20 },
        BulkToManager::Stop,
    ]
}

fn bulk_downs() -> Vec<BulkToServer> {
    let hash = BlobHash([1; 32]);
    let chunk = BlobChunk { hash, total: 256, offset: 0 };
    let missing = BulkToServer::Missing { hash, reason: "lost".into() };
    vec![BulkToServer::Chunk(chunk), missing, BulkToServer::Stopped]
}

fn clip_action() -> ClipAction {
    ClipAction::Play { speed: Some(-0.5), weight: Some(0.25), is_looping: Some(true) }
}
