//! Devices of the wall file, as bridges report them.

use glam::DQuat;
use polyptych_protocol::device_status::{DeviceState, DeviceStatus};
use polyptych_protocol::feedback::Quantiles;
use polyptych_protocol::head_update::HeadUpdate;
use polyptych_protocol::navigation::Flight;
use polyptych_wall::device::{Device, DeviceSource, HeadInput, HeadTracking, TrackerFrame};

use super::*;
use crate::devices::Devices;

const OTHER: SessionId = SessionId(1001);

fn device(name: &str) -> Device {
    Device {
        name: name.into(),
        source: DeviceSource::Osc { listen: format!("127.0.0.1:{name}") },
        lost_ms: 500,
        frame: TrackerFrame::IDENTITY,
        head: None,
        fly: None,
    }
}

fn live(name: &str) -> DeviceStatus {
    DeviceStatus { state: DeviceState::Live, rate_hz: 120.0, ..DeviceStatus::waiting(name, "") }
}

fn stage() -> ClusterFixture {
    let mut stage = ClusterFixture::empty(1);
    let wall = Wall { devices: vec![device("1"), device("2")], ..wall(1) };
    stage.cluster = Cluster::new(wall, Epoch(7));
    for client in [CLIENT, OTHER] {
        stage.cluster.handle_client(client, "bridge".into());
    }
    stage
}

fn report(stage: &mut ClusterFixture, client: SessionId, of: &[DeviceStatus]) -> Option<String> {
    let now = stage.now;
    stage.cluster.handle_request(now, client, RequestId(9), Request::ReportDevices(of.to_vec()));
    stage.read();
    let (_, reply) = stage.replies.pop().expect("an answer");
    reply.err().map(|error| error.reason)
}

#[test]
fn devices_are_named_until_a_bridge_reads_them_and_after_it_has_left() {
    let mut stage = stage();
    let states = |stage: &ClusterFixture| {
        let status = stage.cluster.status(stage.now);
        let state = |of: &DeviceStatus| (of.name.clone(), of.state);
        (status.devices.iter().map(state).collect::<Vec<_>>(), status.warnings)
    };
    let (all, warnings) = states(&stage);
    assert_eq!(all, [("1".into(), DeviceState::Waiting), ("2".into(), DeviceState::Waiting)]);
    assert!(warnings[0].contains("device 1 is waiting: no bridge"), "{warnings:?}");
    assert_eq!(report(&mut stage, CLIENT, &[live("2")]), None);
    assert_eq!(states(&stage).1.len(), 1, "one is live");
    stage.now += 3_000_000;
    assert_eq!(stage.cluster.status(stage.now).devices[1].since_ms, 3_000);
    stage.cluster.handle_client_gone(stage.now, CLIENT);
    let (all, warnings) = states(&stage);
    assert_eq!(all[1].1, DeviceState::Lost);
    assert!(warnings[1].contains("device 2 is lost: its bridge has left"), "{warnings:?}");
    assert_eq!(report(&mut stage, OTHER, &[live("2")]), None, "another may read it now");
}

#[test]
fn reports_of_others_devices_and_of_unknown_ones_change_nothing() {
    let mut stage = stage();
    assert_eq!(report(&mut stage, CLIENT, &[live("1")]), None);
    let before = stage.cluster.status(stage.now).devices;
    let taken = report(&mut stage, OTHER, &[live("2"), live("1")]).expect("refused");
    assert!(taken.contains("another bridge reads device 1"), "{taken}");
    let unknown = report(&mut stage, CLIENT, &[live("2"), live("3")]).expect("refused");
    assert!(unknown.contains("\"3\"") && unknown.contains("1, 2"), "{unknown}");
    assert!(report(&mut stage, CLIENT, &vec![live("1"); 17]).is_some());
    assert_eq!(stage.cluster.status(stage.now).devices, before);
    let hostile = DeviceStatus {
        reason: Some("\u{1b}[2J".repeat(1000)),
        rate_hz: f64::NAN,
        since_ms: u64::MAX,
        latency_ms: Quantiles { max: f64::INFINITY, ..Quantiles::default() },
        state: DeviceState::Lost,
        ..live("1")
    };
    assert_eq!(report(&mut stage, CLIENT, &[hostile]), None);
    stage.now += 2_000_000;
    let told = &stage.cluster.status(stage.now).devices[0];
    assert_eq!((told.since_ms, told.latency_ms.max), (u64::MAX, 0.0));
    let reason = told.reason.as_deref().unwrap_or_default();
    assert!(told.rate_hz == 0.0 && reason.len() <= 4096 && !reason.contains('\u{1b}'), "{told:?}");
}

#[test]
fn a_flight_moves_the_camera_of_the_next_frame_about_the_tracked_head() {
    let mut stage = ClusterFixture::new(1);
    let eye = DVec3::new(0.2, 0.1, 0.5);
    stage.request(Request::SetHead(HeadUpdate::from(eye)));
    let turn = Flight { turn_rad: DVec2::new(0.5, 0.0), ..Flight::NONE };
    stage.request(Request::Fly(turn));
    let camera = stage.cluster.status(stage.now).presentation.camera;
    assert!(camera.world_from_display(eye).abs_diff_eq(eye, 1e-12), "{camera:?}");
    assert!((camera.rotation * DVec3::NEG_Z).x > 0.4, "{camera:?}");
    stage.clear();
    stage.request(Request::Fly(Flight { offset_m: DVec3::splat(f64::INFINITY), ..turn }));
    assert!(stage.replies[0].1.is_err());
    assert_eq!(stage.cluster.status(stage.now).presentation.camera, camera);
}

/// A wall whose device "1" tracks the head.
fn tracked() -> ClusterFixture {
    let head = HeadTracking {
        input: HeadInput::Osc { position: "/head".into(), rotation: None, form: None },
        mount: DQuat::IDENTITY,
        eyes: DVec3::ZERO,
        prediction_ms: 0,
        speed_max: 5.0,
        jump_m: 0.3,
        hold_ms: 2000,
        ease_ms: 1000,
        bounds: None,
    };
    let mut stage = ClusterFixture::new(1);
    let devices = vec![Device { head: Some(head), ..device("1") }, device("2")];
    stage.cluster.wall.devices = devices;
    stage.cluster.devices = Devices::new(&stage.cluster.wall);
    stage
}

/// The bridge of the head has it at a place and leaves.
fn leave(stage: &mut ClusterFixture, place: DVec3) {
    stage.cluster.handle_client(CLIENT, "bridge".into());
    assert_eq!(report(stage, CLIENT, &[live("1")]), None);
    let rotation = Some(DQuat::from_rotation_y(0.8));
    stage.request(Request::SetHead(HeadUpdate { rotation, ..HeadUpdate::from(place) }));
    stage.clear();
    stage.cluster.handle_client_gone(stage.now, CLIENT);
}

#[test]
fn a_head_whose_bridge_has_left_is_held_and_eased_to_its_place_by_frames_of_its_own() {
    let mut stage = tracked();
    let rest = stage.cluster.wall.head();
    let place = rest.position + DVec3::new(0.4, 0.0, 0.2);
    leave(&mut stage, place);
    let head = |stage: &ClusterFixture| stage.cluster.presentation.head;
    stage.wait(1_999_000);
    assert_eq!((head(&stage).position, stage.frames.len()), (place, 0), "it is held");
    let (mut before, mut longest) = (place, 0.0_f64);
    while stage.cluster.poll_timeout().is_some() && head(&stage) != rest {
        stage.wait(16_667);
        let now = head(&stage).position;
        longest = longest.max(now.distance(before));
        before = now;
        stage.draw(&[0], 1_000);
    }
    stage.wait(1_000);
    stage.draw(&[0], 1_000);
    // One and a half times the mean speed of the way, for one step of about 17 to 34 ms.
    assert!(longest < 0.45 * 1.5 * 0.036, "{longest} m at once");
    assert_eq!(head(&stage), rest);
    assert!(stage.now < 2_000_000 + 3_100_000 && stage.frames.len() > 20, "{}", stage.now);
    assert_eq!(stage.frames.last().expect("a frame").1.presentation.head, rest);
    let memory = stage.memories.last().expect("it is persisted");
    assert_eq!(memory.presentation.head, rest);
    let count = stage.frames.len();
    stage.wait(5_000_000);
    assert!(stage.frames.len() <= count + 1, "it draws on");
}

#[test]
fn a_head_that_is_set_does_not_return_and_one_of_another_device_stays() {
    let mut stage = tracked();
    let place = stage.cluster.wall.head().position + DVec3::X * 0.3;
    leave(&mut stage, place);
    stage.wait(2_500_000);
    let on_the_way = stage.cluster.presentation.head.position;
    assert!(on_the_way != place, "it returns");
    stage.request(Request::SetHead(HeadUpdate::from(place)));
    stage.wait(9_000_000);
    assert_eq!(stage.cluster.presentation.head.position, place);
    // A wand's bridge says nothing of the head, nor does a tracker's that has not placed it.
    for name in ["2", "1"] {
        stage.cluster.handle_client(OTHER, "bridge".into());
        assert_eq!(report(&mut stage, OTHER, &[live(name)]), None);
        stage.cluster.handle_client_gone(stage.now, OTHER);
        stage.wait(9_000_000);
        assert_eq!(stage.cluster.presentation.head.position, place, "device {name}");
    }
}

#[test]
fn a_long_way_back_is_no_faster_than_a_head() {
    let mut stage = tracked();
    let rest = stage.cluster.wall.head().position;
    leave(&mut stage, rest + DVec3::Z * 20.0);
    // 20 m at 5 m/s, one and a half times as fast in the middle: 6 s.
    stage.wait(2_000_000 + 5_900_000);
    assert!(stage.cluster.presentation.head.position != rest);
    stage.wait(200_000);
    assert_eq!(stage.cluster.presentation.head.position, rest);
}

#[test]
fn a_tracked_head_returns_after_a_restart_unless_it_is_placed_anew() {
    let mut stage = tracked();
    let rest = stage.cluster.wall.head().position;
    let place = rest + DVec3::X * 0.3;
    assert_eq!(report(&mut stage, CLIENT, &[live("1")]), None);
    stage.request(Request::SetHead(HeadUpdate::from(place)));
    let wall = stage.cluster.wall.clone();
    let restarted = |wall: &Wall, memory: &PersistentState| {
        let mut next = ClusterFixture::empty(1);
        next.cluster = Cluster::restore(wall.clone(), Epoch(8), memory);
        next.cluster.handle_client(CLIENT, "test".into());
        next.now = 0;
        next
    };
    let head = |stage: &ClusterFixture| stage.cluster.presentation.head.position;
    let memory = stage.memories.pop().expect("it is persisted");
    let mut next = restarted(&wall, &memory);
    next.wait(1_999_000);
    assert_eq!(head(&next), place, "it is held");
    // Yet another manager holds it too.
    next = restarted(&wall, &next.cluster.persistent_state());
    next.wait(4_000_000);
    assert_eq!(head(&next), rest);
    let last = next.memories.pop().expect("it is persisted");
    assert!(!last.is_head_tracked && !last.differs_in_work(&memory), "{last:?}");
    // A head that is placed without a device stays, over further restarts too.
    next = restarted(&wall, &memory);
    next.request(Request::SetHead(HeadUpdate::from(place)));
    next = restarted(&wall, &next.memories.pop().expect("it is persisted"));
    next.wait(9_000_000);
    assert_eq!(head(&next), place);
    // Without the tracker in the wall file there is nothing to wait for.
    assert_eq!(head(&restarted(&Wall { devices: Vec::new(), ..wall }, &memory)), rest);
}

#[test]
fn the_head_of_a_session_that_is_opened_does_not_return() {
    let mut stage = tracked();
    let place = stage.cluster.wall.head().position + DVec3::X * 0.3;
    leave(&mut stage, place);
    let session = stage.cluster.persistent_state();
    stage.wait(2_500_000);
    assert_eq!(stage.cluster.resume(&session, stage.now), <[String; 0]>::default());
    stage.wait(9_000_000);
    assert_eq!(stage.cluster.presentation.head.position, place);
}
