//! The bridge, its manager and its devices by a clock of the test.

use std::collections::VecDeque;

use glam::{DQuat, DVec2, DVec3, UVec2};
use polyptych_protocol::device_status::DeviceState;
use polyptych_wall::device::{
    Control, ControlInput, Device, DeviceSource, FlyControls, HeadInput, HeadTracking,
    RotationForm, TrackerFrame,
};
use polyptych_wall::surface::Plane;
use polyptych_wall::{Channel, Screen, Surface};

use super::*;

const TRACKER: &str = "127.0.0.1:5000";

fn wall() -> Wall {
    let plane = Plane::upright(DVec3::NEG_Z, DVec2::new(2.0, 1.0));
    let size = UVec2::new(64, 32);
    let screens = vec![Screen::new("front", Surface::Plane(plane), size)];
    let mut wall = Wall::new("w", screens, vec![Channel::tile("a", 0, UVec2::ZERO, size)]);
    let head = HeadTracking {
        input: HeadInput::Osc {
            position: "/head".into(),
            rotation: None,
            form: Some(RotationForm::Quaternion),
        },
        mount: DQuat::IDENTITY,
        eyes: DVec3::ZERO,
        prediction_ms: 0,
        speed_max: 5.0,
        jump_m: 0.3,
        hold_ms: 1000,
        ease_ms: 10,
        bounds: None,
    };
    let input = ControlInput::Osc { address: "/stick".into(), argument: 1 };
    let fly = FlyControls {
        right: None,
        up: None,
        forward: Some(Control { input, is_negative: false }),
        turn: None,
        pitch: None,
        speed: 2.0,
        turn_speed: 1.0,
        dead_zone: 0.1,
    };
    wall.devices = vec![Device {
        name: "tracker".into(),
        source: DeviceSource::Osc { listen: "127.0.0.1:9000".into() },
        lost_ms: 200,
        frame: TrackerFrame::IDENTITY,
        head: Some(head),
        fly: Some(fly),
    }];
    wall
}

fn message(address: &str, numbers: &[f32]) -> Vec<u8> {
    let padded = |text: &str| {
        let mut bytes = text.as_bytes().to_vec();
        bytes.resize((text.len() + 1).next_multiple_of(4), 0);
        bytes
    };
    let types = format!(",{}", "f".repeat(numbers.len()));
    let mut packet = [padded(address), padded(&types)].concat();
    packet.extend(numbers.iter().flat_map(|number| number.to_be_bytes()));
    packet
}

fn pose(x: f64) -> Vec<u8> {
    message("/head", &[x as f32, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0])
}

/// A manager that answers after a while and draws at a steady rate, or as fast as it can.
struct WallFixture {
    bridge: Bridge,
    answers: VecDeque<(Micros, Purpose)>,
    heads: Vec<(Micros, HeadUpdate)>,
    flights: Vec<Request>,
    reports: Vec<Vec<DeviceStatus>>,
    events: Vec<String>,
}

impl WallFixture {
    fn new() -> Self {
        Self::with_wall(&wall())
    }

    fn with_wall(wall: &Wall) -> Self {
        Self {
            bridge: Bridge::new(wall),
            answers: VecDeque::new(),
            heads: Vec::new(),
            flights: Vec::new(),
            reports: Vec::new(),
            events: Vec::new(),
        }
    }

    fn send(&mut self, now: Micros, packet: &[u8]) {
        self.send_from(now, TRACKER, packet);
    }

    fn send_from(&mut self, now: Micros, from: &str, packet: &[u8]) {
        self.bridge.handle_packet(now, 0, from.parse().expect("an address"), packet);
        self.poll(now);
    }

    /// Takes all that is due, and answers what was sent `ROUND_TRIP` ago.
    fn poll(&mut self, now: Micros) {
        const ROUND_TRIP: Micros = 300;
        while self.answers.front().is_some_and(|(at, _)| *at <= now) {
            let (_, purpose) = self.answers.pop_front().expect("an answer");
            self.bridge.handle_answer(now, purpose, Ok(()));
        }
        while let Some((purpose, request)) = self.bridge.poll_request(now) {
            self.answers.push_back((now + ROUND_TRIP, purpose));
            match request {
                Request::SetHead(head) => self.heads.push((now, head)),
                Request::ReportDevices(report) => self.reports.push(report),
                other => self.flights.push(other),
            }
        }
        self.events.extend(self.bridge.take_events());
    }

    /// Readings at 120 Hz that move to the right, and frames of this length, back to back or on a
    /// beat of 60 Hz.
    fn run(&mut self, frame_us: Micros, is_paced: bool) -> usize {
        let (mut swap, mut frames) = (frame_us, 0);
        for now in (0..3_000_000).step_by(100) {
            if now % 8_300 == 0 {
                self.send(now, &pose(now as f64 / 1e7));
            }
            if now >= swap {
                self.bridge.handle_swap(now, frame_us);
                frames += 1;
                swap += if is_paced { 16_700 } else { frame_us };
            }
            self.poll(now);
        }
        frames
    }
}

#[test]
fn each_frame_has_one_head_at_most_in_order_and_two_frames_after_its_packet_at_most() {
    for (frame_us, is_paced) in
        [(16_700, false), (4_000, true), (12_000, true), (30_000, false), (5_000, false)]
    {
        let mut stage = WallFixture::new();
        let frames = stage.run(frame_us, is_paced);
        // The idle heads of the beginning come on top.
        assert!(stage.heads.len() <= frames + 2, "{} of {frames}", stage.heads.len());
        let xs: Vec<f64> = stage.heads.iter().map(|(_, head)| head.position.x).collect();
        assert!(xs.is_sorted(), "{xs:?}");
        let readings = 3_000_000 / 8_300;
        assert!(stage.heads.len() * 10 >= frames.min(readings) * 9, "{}", stage.heads.len());
        let latency = stage.bridge.statuses(3_000_000)[0].latency_ms;
        let period = if is_paced { 16_700 } else { frame_us };
        let most = 2.0 * period as f64 / 1e3;
        // A short frame waits for the next packet, which is not latency of the wall.
        assert!(latency.p99 <= most.max(10.3), "{frame_us}: {latency:?}, {most} ms");
        assert!(latency.count > 90, "{latency:?}");
    }
}

#[test]
fn damaged_packets_and_second_senders_change_nothing_and_are_told_once() {
    let mut stage = WallFixture::new();
    for step in 0..50 {
        stage.send(step * 8_000, &pose(0.1));
    }
    let before = stage.heads.last().map(|(_, head)| *head);
    stage.events.clear();
    let nan = message("/head", &[f32::NAN, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0]);
    let zero = message("/head", &[0.1, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0]);
    let far = message("/head", &[1e30, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0]);
    let short = message("/head", &[0.1, 0.0, 0.5]);
    let now = 400_000;
    for packet in [&nan, &zero, &far, &short, &pose(0.1)[..20].to_vec(), &b"rubbish".to_vec()] {
        for _ in 0..100 {
            stage.send(now, packet);
        }
    }
    for _ in 0..100 {
        stage.send_from(now, "127.0.0.9:5000", &pose(0.2));
        stage.send(now, &message("/other/address", &[1.0]));
    }
    stage.bridge.handle_swap(now, 1000);
    stage.poll(now + 20_000);
    let status = &stage.bridge.statuses(now)[0];
    assert_eq!((status.refused, status.state), (700, DeviceState::Live), "{status:?}");
    assert_eq!(stage.heads.last().map(|(_, head)| *head), before);
    assert_eq!(stage.events.len(), 3, "{:#?}", stage.events);
    assert!(stage.events[2].contains("127.0.0.9:5000"), "{:#?}", stage.events);
}

#[test]
fn a_lost_device_is_reported_at_once_and_again_when_it_is_back() {
    let mut stage = WallFixture::new();
    stage.poll(0);
    assert_eq!(stage.reports[0][0].state, DeviceState::Waiting);
    for step in 0..100 {
        stage.send(500_000 + step * 8_000, &pose(0.1));
    }
    let states = |stage: &WallFixture| -> Vec<DeviceState> {
        let mut states: Vec<_> = stage.reports.iter().map(|report| report[0].state).collect();
        states.dedup();
        states
    };
    assert_eq!(states(&stage), [DeviceState::Waiting, DeviceState::Live]);
    let mut now = 1_300_000;
    // The caller sleeps until something is due.
    while now < 4_000_000 {
        now = stage.bridge.poll_timeout(true).max(now + 1);
        stage.poll(now + 300);
    }
    assert_eq!(states(&stage).last(), Some(&DeviceState::Lost));
    let lost = stage.reports.last().expect("a report")[0].clone();
    assert_eq!(lost.reason.as_deref(), Some("no usable reading for 200 ms"));
    let (_, last) = stage.heads.last().expect("a head");
    assert!(last.position.abs_diff_eq(DVec3::ZERO, 1e-9), "it is back at wall.eye: {last:?}");
    stage.send(now + 1_000_000, &pose(0.2));
    stage.poll(now + 1_100_000);
    assert_eq!(states(&stage).last(), Some(&DeviceState::Live));
}

#[test]
fn another_manager_is_told_all_anew() {
    let mut stage = WallFixture::new();
    stage.run(16_700, true);
    stage.heads.clear();
    stage.reports.clear();
    let now = 3_000_000;
    stage.bridge.handle_reconnect();
    stage.poll(now + 100_000);
    assert_eq!((stage.reports.len(), stage.heads.len()), (1, 0), "its report goes first");
    stage.poll(now + 101_000);
    assert_eq!((stage.reports.len(), stage.heads.len()), (1, 1));
}

#[test]
fn heads_that_cannot_be_are_not_sent() {
    let mut stage = WallFixture::new();
    // Behind the screen, as far as the tracker sees.
    let behind = message("/head", &[0.0, 0.0, -2.5, 0.0, 0.0, 0.0, 1.0]);
    for step in 0..400 {
        stage.send(step * 8_000, &behind);
        stage.bridge.handle_swap(step * 8_000 + 4_000, 1000);
    }
    let depth = |head: &HeadUpdate| head.position.z;
    assert!(stage.heads.iter().all(|(_, head)| depth(head) > -1.0), "{:?}", stage.heads);
    assert!(stage.events.iter().any(|event| event.contains("front")), "{:#?}", stage.events);
}

#[test]
fn a_wand_flies_while_it_is_held_and_stops_when_it_is_lost() {
    let mut stage = WallFixture::new();
    for now in (0..1_000_000).step_by(1000) {
        if now % 50_000 == 0 {
            stage.send(now, &message("/stick", &[0.0, 1.0]));
        }
        stage.poll(now);
    }
    let forward = |request: &Request| match request {
        Request::Fly(flight) => -flight.offset_m.z,
        other => panic!("{other:?}"),
    };
    let way: f64 = stage.flights.iter().map(forward).sum();
    assert!((way - 2.0).abs() < 0.1, "{way} m in a second");
    stage.flights.clear();
    for now in (1_000_000..2_000_000).step_by(1000) {
        stage.poll(now);
    }
    let way: f64 = stage.flights.iter().map(forward).sum();
    assert!(way < 0.45, "{way} m after the last packet");
}

#[test]
fn a_motion_of_a_3d_mouse_is_one_reading_and_one_flight() {
    let mut wall = wall();
    let device = &mut wall.devices[0];
    (device.head, device.source) = (None, DeviceSource::Spacenav { path: "/mouse".into() });
    let fly = device.fly.as_mut().expect("controls");
    let axis = |of| Some(Control { input: ControlInput::Axis(of), is_negative: false });
    (fly.right, fly.forward) = (axis(0), axis(2));
    let mut bridge = Bridge::new(&wall);
    let motion: Vec<_> = (0..6).map(|of| JoystickEvent::Axis(of, 0.5)).collect();
    for now in (0..=1_000_000).step_by(10_000) {
        bridge.handle_joystick(now, 0, &motion);
        bridge.advance(now);
    }
    let rate_hz = bridge.statuses(1_000_000)[0].rate_hz;
    assert!((100.0..=101.0).contains(&rate_hz), "{rate_hz}");
    let (report, _) = bridge.poll_request(1_000_000).expect("a report");
    bridge.handle_answer(1_000_000, report, Ok(()));
    let Some((_, Request::Fly(flight))) = bridge.poll_request(1_000_000) else {
        panic!("no flight");
    };
    assert!(flight.offset_m.x > 0.0 && flight.offset_m.x == -flight.offset_m.z, "{flight:?}");
}

#[test]
fn a_stick_and_a_head_of_one_device_are_lost_each_by_itself() {
    let mut stage = WallFixture::new();
    stage.send(0, &message("/stick", &[0.0, 1.0]));
    for now in (0..1_000_000).step_by(10_000) {
        stage.send(now, &pose(0.1));
    }
    assert_eq!(stage.bridge.statuses(1_000_000)[0].state, DeviceState::Live);
    stage.flights.clear();
    for now in (1_000_000..2_000_000).step_by(10_000) {
        stage.send(now, &pose(0.1));
    }
    assert!(stage.flights.is_empty(), "a stick that is silent is let go");
    for now in (2_000_000..3_000_000).step_by(10_000) {
        stage.send(now, &message("/stick", &[0.0, 1.0]));
    }
    assert_eq!(stage.bridge.statuses(3_000_000)[0].state, DeviceState::Lost);
    assert!(stage.flights.len() > 40, "{}", stage.flights.len());
}

#[test]
fn a_second_bridge_sends_nothing_until_the_first_has_left() {
    let mut bridge = Bridge::new(&wall());
    let from = TRACKER.parse().expect("an address");
    let mut reports = 0;
    for now in (0..3_000_000).step_by(10_000) {
        bridge.handle_packet(now, 0, from, &pose(0.1));
        while let Some((purpose, request)) = bridge.poll_request(now) {
            assert!(matches!(request, Request::ReportDevices(_)), "{request:?}");
            bridge.handle_answer(now, purpose, Err("another bridge reads it".into()));
            reports += 1;
        }
    }
    assert!(reports >= 3, "it asks again");
    let told = bridge.take_events();
    let of_other = told.iter().filter(|event| event.contains("another bridge"));
    assert_eq!(of_other.count(), 1, "{told:?}");
    let (purpose, _) = bridge.poll_request(4_000_000).expect("a report");
    bridge.handle_answer(4_000_000, purpose, Ok(()));
    let (purpose, _) = bridge.poll_request(4_000_000).expect("a head");
    assert_eq!(purpose, Purpose::Head(None), "the tracker is lost: its reading is too old");
}

#[test]
fn flights_that_are_refused_are_told_once_until_one_is_done() {
    let mut bridge = Bridge::new(&wall());
    let refuse = |bridge: &mut Bridge| {
        bridge.handle_answer(0, Purpose::Flight, Err("too far".into()));
        bridge.take_events().len()
    };
    assert_eq!([refuse(&mut bridge), refuse(&mut bridge)], [1, 0]);
    bridge.handle_answer(0, Purpose::Flight, Ok(()));
    assert_eq!(refuse(&mut bridge), 1);
}

#[test]
fn a_head_without_an_answer_is_sent_again_and_measures_no_latency() {
    let mut bridge = Bridge::new(&wall());
    let from = TRACKER.parse().expect("an address");
    for (now, expected) in [(0, Purpose::Head(Some(0))), (150_000, Purpose::Head(None))] {
        let (report, _) = bridge.poll_request(now).expect("a report");
        bridge.handle_answer(now, report, Ok(()));
        if now == 0 {
            bridge.handle_packet(now, 0, from, &pose(0.1));
        }
        let (head, _) = bridge.poll_request(now).expect("a head");
        assert_eq!(head, expected);
        bridge.handle_no_answer(head);
    }
}

#[test]
fn two_devices_that_fly_take_turns_while_answers_are_slow() {
    let mut wall = wall();
    let mut second = Device { name: "wand".into(), head: None, ..wall.devices[0].clone() };
    second.source = DeviceSource::Osc { listen: "127.0.0.1:9001".into() };
    let fly = second.fly.as_mut().expect("controls");
    (fly.right, fly.forward) = (fly.forward.take(), None);
    wall.devices.push(second);
    let mut bridge = Bridge::new(&wall);
    let from = TRACKER.parse().expect("an address");
    let mut ways = DVec2::ZERO;
    // Each answer comes after the next flight of the first device is due.
    for now in (0..2_000_000).step_by(20_000) {
        for device in 0..2 {
            bridge.handle_packet(now, device, from, &message("/stick", &[0.0, 1.0]));
        }
        if let Some((purpose, request)) = bridge.poll_request(now) {
            if let Request::Fly(flight) = &request {
                ways += DVec2::new(flight.offset_m.x, -flight.offset_m.z);
            }
            bridge.handle_answer(now, purpose, Ok(()));
        }
    }
    assert!(ways.x > 3.5 && ways.y > 3.5, "2 m/s each, and {ways} m in 2 s");
}

#[test]
fn halves_of_a_pose_that_lie_far_apart_are_no_pose() {
    let mut wall = wall();
    let head = wall.devices[0].head.as_mut().expect("a head");
    let form = Some(RotationForm::Quaternion);
    head.input =
        HeadInput::Osc { position: "/position".into(), rotation: Some("/rotation".into()), form };
    let mut stage = WallFixture::with_wall(&wall);
    let position = message("/position", &[0.1, 0.0, 0.5]);
    let rotation = message("/rotation", &[0.0, 0.0, 0.0, 1.0]);
    stage.send(0, &rotation);
    for now in (0..1_000_000).step_by(10_000) {
        stage.send(now, &position);
    }
    let status = |stage: &WallFixture, now| stage.bridge.statuses(now)[0].state;
    assert_eq!(status(&stage, 1_000_000), DeviceState::Lost, "no rotation for 200 ms");
    for now in (1_000_000..1_100_000).step_by(10_000) {
        stage.send(now, &position);
        stage.send(now, &rotation);
    }
    assert_eq!(status(&stage, 1_100_000), DeviceState::Live);
}

#[test]
fn a_device_that_comes_and_goes_is_reported_each_time_and_logged_a_few_times() {
    let mut stage = WallFixture::new();
    // It is lost for 100 ms in every 300 ms.
    for now in (0..60_000_000).step_by(10_000) {
        if now % 300_000 == 0 {
            stage.send(now, &pose(0.1));
        }
        stage.poll(now);
    }
    let reported = stage.reports.iter().filter(|report| report[0].state == DeviceState::Lost);
    assert!(reported.count() > 100, "the status follows");
    let logged: Vec<_> = stage.events.iter().filter(|event| event.contains(" is ")).collect();
    assert!((7..=15).contains(&logged.len()), "{} lines: {logged:#?}", logged.len());
    assert!(logged.iter().any(|line| line.contains("its state has changed ")), "{logged:#?}");
}
