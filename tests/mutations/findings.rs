//! Inputs that mutations once found to fail, made as small as possible.

use allocation_counter::measure;
use polyptych_protocol::command::{Command, Pong};
use polyptych_protocol::handshake::Introduction;
use polyptych_protocol::ids::{Digest, FrameId, RequestId, Revision};
use polyptych_protocol::request::{Request, RequestMessage};
use polyptych_protocol::server_message::{FrameRendered, ServerMessage};
use polyptych_wall::ChannelId;
use polyptych_wall::limits::CANVAS_SIDE_MAX;

use crate::message::{Kind, Message};
use crate::receiver::Receiver;
use crate::scene_file::with_place;
use crate::seeds::{messages, scenes};
use crate::server::Server;

/// More than the manager keeps of one kind of measurement.
const SATURATED: usize = 70_000;

/// Ten bytes of a stranger made room for four mebibytes before the token was looked at, and of a
/// manifest for half a gibibyte.
#[test]
fn a_length_field_makes_no_room() {
    let hello = [0, 252, 0xf0, 0xff, 0x3f, 0];
    let info =
        measure(|| assert!(polyptych_protocol::framing::decode::<Introduction>(&hello).is_err()));
    assert!(info.bytes_max < 128 << 10, "{info:?}");
    let scene = [252, 0xf0, 0xff, 0xff, 0x1f];
    let info = measure(|| assert!(polyptych_scene::decode(&scene).is_err()));
    assert!(info.bytes_max < 128 << 10, "{info:?}");
}

/// Two channels that each say that they drew all triangles there are: the sum overflowed.
#[test]
fn counts_that_a_server_makes_up_are_added_up() {
    let mut receiver = Receiver::new();
    for channel in 0..3 {
        let drawn = FrameRendered {
            epoch: messages::EPOCH,
            frame: FrameId(0),
            channel: ChannelId(channel),
            revision: Revision(1),
            digest: Digest(0),
            draw_us: u32::MAX,
            triangles: u64::MAX,
            draw_calls: u32::MAX,
            error_fraction: 0.0,
            draws_occluded: u32::MAX,
            is_trial: false,
            passes: polyptych_scene::PassTimes::default(),
        };
        receiver.take_for_each_frame(ServerMessage::Drawn(drawn));
    }
    let request = Request::Statistics { reset: false };
    receiver.take(Message::Call(RequestMessage::new(RequestId(1), request)), 1);
}

/// A server that repeats itself filled the manager's memory: reports of one frame were all kept.
#[test]
fn who_repeats_itself_fills_no_memory() {
    for (kind, bytes) in messages::all() {
        if kind != Kind::Status {
            continue;
        }
        let message = Message::decode(kind, &bytes).expect("a seed");
        let mut receiver = Receiver::new();
        let mut repeat = || {
            for _ in 0..SATURATED {
                // From the first server, whose channel the seeds name.
                receiver.take(message.clone(), 2);
            }
        };
        repeat();
        let info = measure(repeat);
        assert!(info.bytes_current < 256 << 10, "{message:?}: {info:?}");
    }
}

/// A reason of the JPEG decoder had two lines, and names of a file may have more.
#[test]
fn a_refusal_is_one_line_whatever_the_file_says() {
    let mut parts = scenes::everything();
    parts.json["nodes"][1]["name"] = serde_json::json!("two\nlines\u{1b}[2J");
    parts.json["nodes"][0]["children"] = serde_json::json!([1, 1]);
    assert!(!with_place(|place| place.check(&parts.glb())));
    let mut parts = scenes::everything();
    // The last view is the JPEG's; it ends in the middle.
    let views = parts.json["bufferViews"].as_array_mut().expect("a list");
    let last = views.last_mut().expect("a view");
    last["byteLength"] = serde_json::json!(last["byteLength"].as_u64().expect("a length") / 2);
    with_place(|place| place.check(&parts.glb()));
}

/// The difference of two clocks overflowed where a manager's was beyond all years.
#[test]
fn a_pong_of_any_time_is_taken() {
    let mut server = Server::new();
    for received_us in [1 << 63, u64::MAX, 0] {
        let pong = Pong { sent_us: 1000, received_us, answered_us: received_us };
        server.obey(Command::Pong(pong));
    }
}

/// A canvas beyond all measure passed the check, and its channels' ends overflowed.
#[test]
fn a_wall_beyond_all_measure_is_refused() {
    let mut wall = messages::wall();
    wall.screens[0].canvas.x = u32::MAX;
    wall.channels[0].origin.x = u32::MAX - 1;
    let fault = wall.fault().unwrap_or_default();
    assert!(fault.contains(&CANVAS_SIDE_MAX.to_string()), "{fault}");
}

/// A client that opens scenes faster than they are baked started a baker for each; and where it
/// gave all the same number, the first one that ended made room for all.
#[test]
fn a_client_opens_a_few_scenes_at_a_time() {
    for same in [false, true] {
        let open = |receiver: &mut Receiver, id: u64| {
            let request = Request::OpenScene { path: "town.glb".into(), scene: None };
            let id = RequestId(if same { 7 } else { id });
            receiver.take(Message::Call(RequestMessage::new(id, request)), 1);
            receiver.imports_held()
        };
        let mut receiver = Receiver::new();
        receiver.hold_imports();
        let held = (1..1000).map(|id| open(&mut receiver, id)).last().expect("many");
        assert!(held < 100, "{held} at once");
        receiver.finish_import();
        let again = (1001..2000).map(|id| open(&mut receiver, id)).last().expect("many");
        assert_eq!(again, held, "one ended, so one more may begin");
    }
}
