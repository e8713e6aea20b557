//! Timelines and lanes, of parts that begin with a checkpoint and of long ones.

use glam::{DVec2, DVec3, UVec2};
use polyptych_core::SessionId;
use polyptych_protocol::handshake::{Adapter, ServerHello};
use polyptych_protocol::ids::Epoch;
use polyptych_wall::surface::Plane;
use polyptych_wall::{Channel, Screen, Surface, Wall};

use super::*;

const SERVER: SessionId = SessionId(1);
const CLIENT: SessionId = SessionId(2);

/// The core of a wall of one channel, `left`, which a server and a client have joined.
fn joined() -> Cluster {
    let size = UVec2::splat(64);
    let plane = Plane::upright(DVec3::NEG_Z, DVec2::splat(2.0));
    let screens = vec![Screen::new("front", Surface::Plane(plane), size)];
    let channel = Channel::tile("left", 0, UVec2::ZERO, size);
    let wall = Wall { near_m: 0.1, ..Wall::new("recorded", screens, vec![channel]) };
    let mut cluster = Cluster::new(wall, Epoch(1));
    let hello = ServerHello {
        name: "pc-1".into(),
        channels: vec!["left".into()],
        pid: 7,
        adapter: Adapter { texture_side_max: 8192, ..Adapter::default() },
    };
    let address = "127.0.0.1:9".to_owned();
    let inputs = [
        Input::Server { session: SERVER, hello, address },
        Input::Client { session: CLIENT, name: "demo".into() },
    ];
    for input in inputs {
        let (_, refusal) = tell(&mut cluster, 1000, input);
        assert_eq!(refusal, None);
    }
    cluster
}

#[test]
fn peers_that_came_before_a_part_have_names_and_lanes() {
    let mut cluster = joined();
    let lanes = LaneRecorder::new(&cluster, 1, &TimeRange::default()).finish();
    assert_eq!(lanes.channels[0].server.as_deref(), Some("pc-1"));
    let clients: Vec<_> = lanes.clients.iter().map(|lane| lane.name.as_str()).collect();
    assert_eq!(clients, ["demo"]);
    let mut timeline = Timeline::new(&cluster, None);
    for input in [
        Input::ServerGone { session: SERVER, reason: "unplugged".into() },
        Input::ClientGone { session: CLIENT },
    ] {
        let (outputs, refusal) = tell(&mut cluster, 2000, input.clone());
        timeline.observe(2000, &input, &outputs, refusal.as_deref(), &cluster);
    }
    let events = timeline.finish(&cluster).events;
    let says = |text: &str| events.iter().any(|event| event.text == text);
    assert!(says("server pc-1 is gone: unplugged") && says("client demo leaves"), "{events:?}");
}

#[test]
fn events_of_a_drawn_range_are_kept_however_many_came_before() {
    const COUNT: u64 = 12_000;
    let cluster = joined();
    let range = TimeRange { part: None, from_s: Some(11_000.0), to_s: Some(11_009.0) };
    let mut timeline = Timeline::new(&cluster, Some(&range));
    // A client that nobody knows leaves, once in a second.
    for second in 0..COUNT {
        let (now, input) = (second * 1_000_000, Input::ClientGone { session: SessionId(99) });
        timeline.observe(now, &input, &[], None, &cluster);
    }
    let (events, more) = timeline.take_drawn();
    let times: Vec<f64> = events.iter().map(|event| event.at_s).collect();
    let due: Vec<f64> = (0..10).map(|second| 11_000.0 + f64::from(second)).collect();
    assert_eq!((times, more), (due, 0));
    let summary = timeline.finish(&cluster);
    assert_eq!(summary.events.len() as u64 + summary.events_more, COUNT);
    assert!(summary.events_more > 0, "all are kept");
}
