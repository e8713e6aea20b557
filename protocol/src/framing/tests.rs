//! The wire: what goes out comes back, its bytes stay what they are, rubbish is refused.

use std::fmt::Debug;
use std::num::NonZeroU32;

use bytes::Bytes;
use glam::{DAffine3, DQuat, DVec3};
use polyptych_codec::{append_framed, encode, framed};
use polyptych_files::blob::BlobHash;
use polyptych_scene::NodeId;
use polyptych_scene::Scene;
use polyptych_wall::ChannelId;
use polyptych_wall::calibration_change::{CalibrationChange, Corner, Offset};
use polyptych_wall::camera::Camera;
use polyptych_wall::head::HeadPose;
use polyptych_wall::region::{Region, Relation};
use polyptych_wall::tour::{Tour, TourStop};
use polyptych_wall::view::{Area, View, ViewProjection};
use proptest::prelude::*;
use serde::Serialize;

use super::*;
use crate::bulk::{BlobChunk, BulkToManager, BulkToServer, CaptureChunk};
use crate::command::{Command, Frame, Pong, Prepare, Swap};
use crate::delivery::Delivery;
use crate::exported_scene::ExportedScene;
use crate::handshake::{Adapter, ClientHello, Hello, HelloReply, Rejection, ServerHello};
use crate::ids::{Digest, Epoch, FrameId, RequestId, Revision};
use crate::node_query::{NearestPoint, NearestQuery, NodeQuery, RegionQuery};
use crate::output_mode::OutputMode;
use crate::pattern::TestPattern;
use crate::presentation::Presentation;
use crate::quality_bounds::DetailBound;
use crate::request::{self, Pacing, Request, RequestError, RequestMessage, Response};
use crate::server_message::{FramePresented, FrameRendered, Ping, Prepared, ServerMessage};
use crate::state_log::{Operation, SceneRef};
use crate::transaction::Transaction;

fn camera() -> Camera {
    Camera { position: DVec3::new(1.0, -2.0, 1e7), rotation: DQuat::IDENTITY, scale: 0.5 }
}

fn frame() -> Frame {
    Frame {
        epoch: Epoch(0x0102_0304_0506_0708),
        frame: FrameId(300),
        time_s: 1.5,
        revision: Revision(2),
        presentation: Presentation {
            camera: camera(),
            views: vec![View::of_wall(camera())],
            output_mode: OutputMode::Blank,
            pattern: Some(TestPattern::Density),
            ..Presentation::new(HeadPose::facing_forward(DVec3::new(0.0, 1.6, 0.0), 0.064))
        },
        capture: Some(NonZeroU32::MIN),
        detail: DetailBound {
            error_px: 0.5,
            densities: vec![2000.0],
            resolution_steps: 3,
            follows_rate: true,
        },
        clips: Vec::new(),
        is_metered: false,
    }
}

fn drawn() -> FrameRendered {
    FrameRendered {
        epoch: Epoch(1),
        frame: FrameId(300),
        channel: ChannelId(3),
        revision: Revision(2),
        digest: Digest(u64::MAX),
        draw_us: 20_000,
        triangles: 100_000,
        draw_calls: 6,
        error_fraction: 0.0,
        draws_occluded: 40,
        is_trial: false,
        passes: polyptych_scene::PassTimes::default(),
    }
}

/// One message of each kind, with the hexadecimal digits that it has on the wire.
///
/// A change here is a change of the protocol: raise `PROTOCOL_VERSION` with it.
#[expect(clippy::too_many_lines, reason = "a list of messages, one after the other")]
fn golden() -> Vec<(Bytes, &'static str)> {
    let client = ClientHello { name: "ann".into() };
    let server = ServerHello {
        name: "a".into(),
        channels: vec!["left".into()],
        pid: 4242,
        adapter: Adapter::default(),
    };
    let scene = SceneRef { name: "t".into(), manifest: BlobHash([0xab; 32]) };
    let prepare = Prepare {
        epoch: Epoch(1),
        base: Some(Revision(1)),
        revision: Revision(2),
        shown: Revision(1),
        operations: vec![Operation::OpenScene(scene), Operation::CloseScene],
    };
    let prepared = Prepared {
        epoch: Epoch(1),
        revision: Revision(2),
        digest: Digest(3),
        features: vec!["blend".into()],
        scene_bytes: 1000,
        detail_reach: None,
    };
    let shown = FramePresented {
        epoch: Epoch(1),
        frame: FrameId(300),
        channel: ChannelId(3),
        at_us: 70_000,
        clock_error_us: 40,
        is_unscheduled: true,
    };
    let chunk = CaptureChunk {
        channel: ChannelId(1),
        frame: FrameId(2),
        width: 1,
        height: 1,
        offset: 0,
        bytes: Bytes::from_static(&[1, 2, 3, 4]),
    };
    let piece = BlobChunk { hash: BlobHash([1; 32]), total: 2, offset: 0 };
    let failure =
        request::MessageToClient::Reply { id: RequestId(5), reply: Err(RequestError::new("no")) };
    let done = request::MessageToClient::Reply { id: RequestId(5), reply: Ok(Response::Done) };
    let run = RequestMessage::new(RequestId(5), Request::Run(Pacing::Rate(60.0)));
    let freeze = RequestMessage::new(RequestId(7), Request::SetDisplays(OutputMode::Freeze));
    let pattern =
        RequestMessage::new(RequestId(8), Request::SetPattern(Some(TestPattern::Weights)));
    let to = Offset::By(glam::DVec2::new(1.5, -0.5));
    let changes = vec![CalibrationChange::Pin { corner: Corner::UpperRight, to }];
    let tune = Request::Tune { channel: "a".into(), changes };
    let tune = RequestMessage::new(RequestId(9), tune);
    let mut moving = Transaction::based_on(Revision(3));
    moving.set_transform(NodeId(300), DAffine3::IDENTITY);
    let edit = RequestMessage::new(RequestId(6), Request::Edit(moving));
    let open = RequestMessage::new(
        RequestId(6),
        Request::OpenScene { path: "a.glb".into(), scene: Some("night".into()) },
    );
    let head =
        RequestMessage::new(RequestId(8), Request::SetHead(frame().presentation.head.into()));
    let plan = View {
        area: Area::Screen { screen: 1, rect: [0, 2, 300, 4] },
        projection: ViewProjection::Orthographic { height_m: 1.5 },
        ..View::of_wall(Camera::IDENTITY)
    };
    let views = RequestMessage::new(RequestId(9), Request::SetViews(vec![plan]));
    let call = |request| RequestMessage::new(RequestId(8), request);
    let delivery = Delivery::Queued { priority: 7 };
    let queued = RequestMessage { delivery, ..call(Request::ExportScene { saved: None }) };
    let exported = ExportedScene { name: "a".into(), bytes: 300, nodes: 2, ..Default::default() };
    let exported = Ok(Response::Exported(exported));
    let exported = request::MessageToClient::Reply { id: RequestId(9), reply: exported };
    let film = call(Request::Capture { time_s: Some(2.5) });
    let store = call(Request::StoreView { name: "quay".into(), camera: None });
    let stop = TourStop::new(Camera::IDENTITY, 2.0);
    let play = call(Request::PlayTour(Tour { stops: vec![stop], is_loop: true }));
    let region = RegionQuery {
        region: Region::Sphere { center: DVec3::X, radius: 0.5 },
        relation: Relation::Contains,
        nodes: NodeQuery { skip: 1, count: 300, ..NodeQuery::default() },
    };
    let region = RequestMessage::new(RequestId(9), Request::FindInRegion(region));
    let near = NearestQuery { point: DVec3::Y, within: Some(0.5) };
    let near = RequestMessage::new(RequestId(9), Request::NearestPoint(near));
    let nearest = NearestPoint {
        revision: Revision(3),
        node: NodeId(300),
        name: "a".into(),
        position: DVec3::Z,
        distance: 0.5,
    };
    let nearest = Ok(Response::Nearest(Some(nearest)));
    let nearest = request::MessageToClient::Reply { id: RequestId(9), reply: nearest };
    vec![
        (encode(&Hello::Client(client)), "0003616e6e"),
        (encode(&Hello::Server(server)), "01016101046c656674fb921000000000"),
        (encode(&HelloReply::Refused(Rejection { reason: "no".into() })), "00026e6f"),
        (
            encode(&Command::Prepare(prepare)),
            concat!(
                "00010101020102030174",
                "abababababababababababababababababababababababababababababababab",
                "04"
            ),
        ),
        (
            encode(&Command::Frame(frame())),
            "01fd0807060504030201fb2c01000000000000f83f02000000000000f03f00000000000000c000000000\
             d0126341000000000000000000000000000000000000000000000000000000000000f03f000000000000\
             e03f00000000000000009a9999999999f93f000000000000000000000000000000000000000000000000\
             0000000000000000000000000000f03ffca9f1d24d62b03f01000000000000f03f00000000000000c000\
             000000d0126341000000000000000000000000000000000000000000000000000000000000f03f000000\
             000000e03f000000000000803f020105000000000000000000000000000000000101000000000000e03f01\
             0000000000409f4003010000",
        ),
        (
            encode(&Command::Swap(Swap {
                epoch: Epoch(1),
                frame: FrameId(300),
                not_after_us: 9,
                present_at_us: Some(7),
            })),
            "0201fb2c01090107",
        ),
        (encode(&Command::Pong(Pong { sent_us: 1, received_us: 2, answered_us: 3 })), "03010203"),
        (encode(&ServerMessage::Prepared(prepared)), "000102030105626c656e64fbe80300"),
        (
            encode(&ServerMessage::Drawn(drawn())),
            "0201fb2c010302fdfffffffffffffffffb204efca086010006000000002800000000000000000000",
        ),
        (encode(&ServerMessage::Shown(shown)), "0401fb2c0103fc701101002801"),
        (encode(&ServerMessage::Ping(Ping { sent_us: 1, memory_bytes: 2 })), "050102"),
        (encode(&ServerMessage::Goodbye { reason: "end".into() }), "0703656e64"),
        (encode(&ServerMessage::StateLost { reason: "end".into() }), "0903656e64"),
        (encode(&ServerMessage::Storage { warning: Some("end".into()) }), "0a0103656e64"),
        (encode(&BulkToManager::Picture(chunk)), "0101020101000401020304"),
        (encode(&BulkToManager::Stop), "03"),
        (encode(&BulkToServer::Stopped), "02"),
        (
            encode(&BulkToServer::Chunk(piece)),
            "0001010101010101010101010101010101010101010101010101010101010101010200",
        ),
        (encode(&run), "0505010000000000004e4000"),
        (encode(&open), "060005612e676c6201056e6967687400"),
        (
            encode(&edit),
            "061201030103fb2c01000000000000f03f00000000000000000000000000000000000000000000000000\
             0000000000f03f000000000000000000000000000000000000000000000000000000000000f03f000000\
             000000000000000000000000000000000000000000000000",
        ),
        (encode(&freeze), "070d0300"),
        (
            encode(&head),
            "080e00000000000000009a9999999999f93f000000000000000001000000000000000000000000000000\
             000000000000000000000000000000f03f01fca9f1d24d62b03f00",
        ),
        (
            encode(&views),
            "090f0100000000000000000000000000000000000000000000000000000000000000000000000000000000\
             0000000000000000000000000000f03f000000000000f03f01010002fb2c010402000000000000f83f00\
             0000",
        ),
        (
            encode(&region),
            "091701000000000000f03f00000000000000000000000000000000000000000000e03f02000000000001fb\
             2c0100",
        ),
        (encode(&near), "09180000000000000000000000000000f03f000000000000000001000000000000e03f00"),
        (
            encode(&nearest),
            "0009000c0103fb2c01016100000000000000000000000000000000000000000000f03f000000000000e0\
             3f",
        ),
        (encode(&pattern), "0810010300"),
        (encode(&tune), "0911016101000101000000000000f83f000000000000e0bf00"),
        (encode(&queued), "0824000107"),
        (encode(&exported), "000900110161fb2c0102000000"),
        (encode(&film), "080701000000000000044000"),
        (encode(&store), "081904717561790000"),
        (
            encode(&play),
            "081c01000000000000000000000000000000000000000000000000000000000000000000000000000000\
             000000000000000000000000000000f03f000000000000f03f0000000000000040000000000000000000\
             0100",
        ),
        (encode(&failure), "000501026e6f"),
        (encode(&done), "00050000"),
        (encode(&request::MessageToClient::Heartbeat), "06"),
    ]
}

fn hex(bytes: &[u8]) -> String {
    use std::fmt::Write;
    bytes.iter().fold(String::new(), |mut text, byte| {
        write!(text, "{byte:02x}").expect("a String takes everything");
        text
    })
}

#[test]
fn the_bytes_stay_what_they_are() {
    let differing: Vec<String> = golden()
        .into_iter()
        .filter(|(bytes, expected)| hex(bytes) != expected.replace(char::is_whitespace, ""))
        .map(|(bytes, expected)| format!("expected {expected}\n     got {}", hex(&bytes)))
        .collect();
    assert!(differing.is_empty(), "{}", differing.join("\n"));
}

fn comes_back<T: Serialize + DeserializeOwned + PartialEq + Debug>(message: &T) {
    assert_eq!(decode::<T>(&encode(message)).as_ref(), Ok(message));
}

#[test]
fn what_goes_out_comes_back() {
    comes_back(&Command::Frame(frame()));
    comes_back(&ServerMessage::Drawn(drawn()));
    comes_back(&Scene::default());
    comes_back(&Request::SetCamera(camera()));
    let rect = [1, 2, 3, u32::MAX];
    comes_back(&View {
        root: Some(300),
        layers: Some(vec!["day".into()]),
        camera: camera(),
        area: Area::Screen { screen: 2, rect },
        projection: ViewProjection::Perspective { fov_y_rad: 0.5 },
    });
}

#[test]
fn a_length_that_lies_allocates_nothing() {
    // A status whose list of features claims 2^60 entries.
    let mut bytes = encode(&ServerMessage::Prepared(Prepared {
        epoch: Epoch(1),
        revision: Revision(2),
        digest: Digest(3),
        features: Vec::new(),
        scene_bytes: 0,
        detail_reach: None,
    }))
    .to_vec();
    let at = bytes.len() - 3;
    bytes.splice(at..=at, [0xfd, 0, 0, 0, 0, 0, 0, 0, 0x10]);
    assert!(decode::<ServerMessage>(&bytes).is_err());
    assert!(
        polyptych_scene::decode(&[0xfd, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x7f]).is_err()
    );
}

#[test]
fn bytes_behind_a_message_are_refused() {
    let mut bytes = encode(&Request::Status).to_vec();
    bytes.push(0);
    assert_eq!(decode::<Request>(&bytes), Err(DecodeError::Trailing { what: "Request", extra: 1 }));
}

fn decode_all(bytes: &[u8]) {
    // Whether they are messages doesn't matter; that it is found out in peace does.
    let _ = decode::<Hello>(bytes);
    let _ = decode::<HelloReply>(bytes);
    let _ = decode::<Command>(bytes);
    let _ = decode::<ServerMessage>(bytes);
    let _ = decode::<RequestMessage>(bytes);
    let _ = decode::<request::MessageToClient>(bytes);
    let _ = decode::<BulkToManager>(bytes);
    let _ = decode::<BulkToServer>(bytes);
    let _ = polyptych_scene::decode(bytes).map(|scene| scene.fault());
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 20_000, ..ProptestConfig::default() })]

    #[test]
    fn rubbish_never_panics(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
        decode_all(&bytes);
    }

    #[test]
    fn damaged_messages_never_panic(
        which in any::<prop::sample::Index>(),
        changes in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4),
        cut in any::<prop::sample::Index>(),
    ) {
        let golden = golden();
        let (bytes, _) = which.get(&golden);
        let mut bytes = bytes.to_vec();
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        decode_all(&bytes);
        bytes.truncate(cut.index(bytes.len()));
        decode_all(&bytes);
    }
}

#[test]
fn a_frame_behind_others_is_the_frame_alone() {
    let mut frames = vec![9];
    for message in ["a", "", "longer"] {
        let start = frames.len();
        append_framed(&message, &mut frames);
        assert_eq!(frames[start..], framed(&encode(&message))[..]);
    }
}
