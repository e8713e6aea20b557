//! Trackers, wands and pads through `polyptych devices`, as an operator has them: heads reach all
//! channels alike and in order, lost devices are named, and the bridge outlives its manager.

use std::collections::BTreeMap;
use std::fs::OpenOptions;
use std::io::{Read, Write};
use std::net::{TcpListener, UdpSocket};
use std::os::unix::net::UnixListener;
use std::path::PathBuf;
use std::process::Command as Program;
use std::thread::Builder;

use polyptych_client::blocking::Client;
use polyptych_client::glam::{DQuat, DVec3};
use polyptych_client::{DeviceState, DeviceStatus, Pacing, Wall};
use polyptych_protocol::command::Command;

use crate::harness::local_wall::{ANY_PORT, LocalWall, small};
use crate::harness::place::TestDir;
use crate::harness::process::Process;
use crate::harness::stub_server::StubServer;
use crate::harness::wait;

/// Frames per second of the walls here.
const RATE: f64 = 60.0;

/// A small wall of two channels with these devices.
fn wall_with(devices: &str) -> Wall {
    let text = format!("{}\n{devices}", polyptych_wall_file::to_toml(&small(2, 1)));
    polyptych_wall_file::parse(&text, "wall.toml".as_ref()).unwrap_or_else(|e| panic!("{e}"))
}

/// The address of a UDP port that is free.
fn free_port() -> String {
    let socket = UdpSocket::bind("127.0.0.1:0").expect("a port");
    socket.local_addr().expect("an address").to_string()
}

fn bridge(local: &LocalWall) -> Process {
    let wall = local.place.path("wall.toml");
    let arguments: [PathBuf; 4] =
        ["devices".into(), wall, "--manager".into(), local.address.clone().into()];
    local.place.start("devices", arguments)
}

fn device(client: &Client, name: &str) -> DeviceStatus {
    let status = client.status().expect("a status");
    let found = status.devices.into_iter().find(|device| device.name == name);
    found.unwrap_or_else(|| panic!("there is no device {name}"))
}

#[track_caller]
fn await_device(client: &Client, name: &str, is_it: impl Fn(&DeviceStatus) -> bool) {
    wait::until(name, || Some(device(client, name)).filter(&is_it));
}

/// A packet with a pose at `x`; the head looks ahead.
fn pose(x: f32) -> Vec<u8> {
    let mut packet = b"/head\0\0\0,fffffff\0\0\0\0".to_vec();
    let numbers = [x, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0_f32];
    packet.extend(numbers.iter().flat_map(|number| number.to_be_bytes()));
    packet
}

/// The head of every frame that a stub was sent, by the frame's number.
fn heads(stub: &StubServer) -> BTreeMap<u64, DVec3> {
    let head = |command| match command {
        Command::Frame(frame) => Some((frame.frame.0, frame.presentation.head.position)),
        _ => None,
    };
    stub.heard().into_iter().filter_map(head).collect()
}

#[test]
fn osc_poses_reach_all_channels_alike_and_in_order_and_a_lost_tracker_is_named() {
    let port = free_port();
    let wall = wall_with(&format!(
        "[[device]]\nname = \"tracker\"\nkind = \"osc\"\nlisten = \"{port}\"\nlost_ms = 300\n\
         [device.head]\npose = \"/head\"\nease_ms = 10\nhold_ms = 100\n"
    ));
    let local = LocalWall::manager(TestDir::new(), &wall, &[], ANY_PORT);
    let stubs = ["front-1-1", "front-2-1"].map(|name| StubServer::start(&local, name));
    let client = local.client();
    client.start_rendering(Pacing::Rate(RATE)).expect("running");
    assert!(device(&client, "tracker").reason.is_some_and(|why| why.contains("no bridge")));
    let mut process = bridge(&local);
    process.await_line(&["reading 1 device of wall small"]);
    let tracker = UdpSocket::bind("127.0.0.1:0").expect("a port");
    let mut sent = 0_u16;
    let mut send = || {
        sent += 1;
        tracker.send_to(&pose(f32::from(sent) * 1e-4), &port).expect("sent");
    };
    wait::until("frames that show heads", || {
        send();
        (device(&client, "tracker").latency_ms.count >= 60).then_some(())
    });
    // Rubbish between good packets is counted and changes nothing.
    let nan = pose(f32::NAN);
    wait::until("refused packets", || {
        send();
        for packet in [&nan[..], &nan[..20], b"#bundle\0", b"/head\0\0\0"] {
            tracker.send_to(packet, &port).expect("sent");
        }
        Some(device(&client, "tracker")).filter(|of| of.refused >= 40).map(drop)
    });
    process.await_line(&["device tracker", "it is ignored"]);
    let status = device(&client, "tracker");
    assert_eq!((status.state, status.reason), (DeviceState::Live, None));
    let [left, right] = [&stubs[0], &stubs[1]].map(heads);
    let both: Vec<_> = left.iter().filter_map(|(id, at)| Some((*at, *right.get(id)?))).collect();
    assert!(both.len() > 60, "{} frames", both.len());
    assert!(both.iter().all(|(left, right)| left == right), "one head for each frame");
    let xs: Vec<f64> = both.iter().map(|(at, _)| at.x).collect();
    assert!(xs.is_sorted(), "poses out of order: {xs:?}");
    assert!(xs.last() > Some(&0.005), "{xs:?}");
    // How long it takes is held by the bridge's own tests, whose clock no busy machine stops.
    assert!(status.latency_ms.p50 > 0.0, "{:?}", status.latency_ms);

    await_device(&client, "tracker", |of| of.state == DeviceState::Lost);
    let text = local.run(&["status"]).succeeded();
    assert!(text.contains("device tracker is lost: no usable reading for 300 ms"), "{text}");
    wait::until("the head is back at wall.eye", || {
        let head = client.presentation().expect("a presentation").head;
        (head.position == local.wall().eye).then_some(())
    });
    wait::until("the tracker is back", || {
        send();
        Some(device(&client, "tracker")).filter(|of| of.state == DeviceState::Live).map(drop)
    });
    process.kill();
    let gone = |of: &DeviceStatus| of.reason.as_ref().is_some_and(|why| why.contains("has left"));
    await_device(&client, "tracker", gone);
}

#[test]
fn a_pad_flies_and_a_bridge_goes_on_with_the_next_manager() {
    let place = TestDir::new();
    let path = place.path("js0");
    assert!(Program::new("mkfifo").arg(&path).status().expect("mkfifo runs").success());
    let wall = wall_with(&format!(
        "[[device]]\nname = \"pad\"\nkind = \"joystick\"\npath = \"{}\"\n\
         [device.fly]\nforward = \"-axis1\"\nturn = \"axis0\"\nspeed = 0.5\n",
        path.display()
    ));
    let mut local = LocalWall::manager(place, &wall, &[], ANY_PORT);
    let mut process = bridge(&local);
    process.await_line(&["reading 1 device"]);
    let mut second = bridge(&local);
    second.await_line(&["nothing is sent", "another bridge reads device pad"]);
    second.kill();
    let mut pad = OpenOptions::new().write(true).open(&path).expect("its reader is there");
    let mut event = |value: i16, kind: u8, number: u8| {
        let [low, high] = value.to_ne_bytes();
        pad.write_all(&[0, 0, 0, 0, low, high, kind, number]).expect("written");
    };
    event(0, 0x82, 0);
    event(0, 0x82, 1);
    event(i16::MIN, 2, 1);
    let camera = |client: &Client| client.presentation().expect("a presentation").camera;
    let client = local.client();
    wait::until("the camera flies ahead", || (camera(&client).position.z < -0.2).then_some(()));
    assert_eq!(device(&client, "pad").state, DeviceState::Live);

    // The manager is killed and started again: the stick is still held.
    local.manager.kill();
    let address = local.address.clone();
    local = LocalWall::manager(local.place, &wall, &[], &address);
    let client = local.client();
    await_device(&client, "pad", |of| of.state == DeviceState::Live);
    let before = camera(&client).position.z;
    wait::until("it flies on", || (camera(&client).position.z < before - 0.1).then_some(()));
    event(0, 2, 1);
    wait::until("it stands", || {
        let [one, two] = [0; 2].map(|_| {
            client.render_frame().expect("a frame");
            camera(&client)
        });
        (one == two).then_some(())
    });
    drop(pad);
    await_device(&client, "pad", |of| of.state == DeviceState::Lost);
}

#[test]
fn a_3d_mouse_flies_until_it_is_unplugged_and_outlives_its_driver() {
    let place = TestDir::new();
    let path = place.path("spnav.sock");
    let wall = wall_with(&format!(
        "[[device]]\nname = \"mouse\"\nkind = \"spacenav\"\npath = \"{}\"\n\
         [device.fly]\nforward = \"axis2\"\nturn = \"-axis4\"\nspeed = 0.5\n",
        path.display()
    ));
    let local = LocalWall::manager(place, &wall, &[], ANY_PORT);
    let client = local.client();
    let mut process = bridge(&local);
    process.await_line(&["device mouse", "cannot be opened", "start spacenavd"]);
    let driver = UnixListener::bind(&path).expect("a socket");
    let (mut socket, _) = driver.accept().expect("the bridge");
    let mut motion = |axes: [i32; 6]| {
        let numbers = [0].into_iter().chain(axes).chain([16]);
        let bytes: Vec<u8> = numbers.flat_map(i32::to_ne_bytes).collect();
        socket.write_all(&bytes).expect("written");
    };
    await_device(&client, "mouse", |of| of.state == DeviceState::Live);
    let camera = || client.presentation().expect("a presentation").camera;
    let stands = || {
        let [one, two] = [0; 2].map(|_| {
            client.render_frame().expect("a frame");
            camera()
        });
        (one == two).then_some(())
    };
    motion([0, 0, 350, 0, 0, 0]);
    wait::until("the camera flies ahead", || (camera().position.z < -0.2).then_some(()));
    // spacenavd says so of a mouse that is unplugged, too.
    motion([0; 6]);
    wait::until("it stands", stands);
    // A cap that is turned to the left, seen from above.
    motion([0, 0, 0, 0, 350, 0]);
    wait::until("it looks to the left", || {
        ((camera().rotation * DVec3::NEG_Z).x < -0.1).then_some(())
    });
    // The driver is killed with the cap turned, and started again.
    drop(socket);
    await_device(&client, "mouse", |of| of.state == DeviceState::Lost);
    wait::until("it stands", stands);
    let (_socket, _) = driver.accept().expect("the bridge is back");
    await_device(&client, "mouse", |of| of.state == DeviceState::Live);
    process.kill();
}

/// Serves one VRPN client with poses until it leaves, as VRPN's `Format_Of_Protocol.txt` says.
fn serve_vrpn(listener: &TcpListener) {
    let message = |sender: i32, kind: i32, body: &[u8]| {
        let head = [24 + body.len() as i32, 0, 0, sender, kind, 0];
        let mut bytes: Vec<u8> = head.iter().flat_map(|number| number.to_be_bytes()).collect();
        bytes.extend(body);
        bytes.resize(bytes.len().next_multiple_of(8), 0);
        bytes
    };
    let (mut stream, _) = listener.accept().expect("a client");
    let cookie = b"vrpn: ver. 07.35  0\0\0\0\0\0";
    let mut hello = [0; 24];
    stream.read_exact(&mut hello).expect("a cookie");
    assert_eq!(&hello, cookie);
    stream.write_all(cookie).expect("sent");
    stream.write_all(&message(5, -1, b"\0\0\0\x09Tracker0\0")).expect("sent");
    stream.write_all(&message(7, -2, b"\0\0\0\x16vrpn_Tracker Pos_Quat\0")).expect("sent");
    let turn = DQuat::from_rotation_y(0.5);
    let numbers = [0.25, 0.1, 0.2, turn.x, turn.y, turn.z, turn.w];
    let mut report = vec![0, 0, 0, 3, 0, 0, 0, 0];
    report.extend(numbers.iter().flat_map(|number: &f64| number.to_be_bytes()));
    let report = message(5, 7, &report);
    wait::until("the client leaves", || stream.write_all(&report).err());
}

#[test]
fn a_vrpn_tracker_moves_and_turns_the_head() {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let server = listener.local_addr().expect("an address");
    let wall = wall_with(&format!(
        "[[device]]\nname = \"dtrack\"\nkind = \"vrpn\"\nserver = \"{server}\"\n\
         [device.head]\ntracker = \"Tracker0\"\nsensor = 3\nease_ms = 10\n"
    ));
    let serving = Builder::new().name("vrpn".into()).spawn(move || serve_vrpn(&listener));
    let serving = serving.expect("a thread");
    let local = LocalWall::manager(TestDir::new(), &wall, &[], ANY_PORT);
    let client = local.client();
    client.start_rendering(Pacing::Rate(RATE)).expect("running");
    let mut process = bridge(&local);
    process.await_line(&["device dtrack", "answers", "sensor 3 of Tracker0"]);
    wait::until("the head is where the tracker says", || {
        let head = client.presentation().expect("a presentation").head;
        let is_there = head.position.abs_diff_eq(DVec3::new(0.25, 0.1, 0.2), 1e-9);
        let is_turned = head.rotation.abs_diff_eq(DQuat::from_rotation_y(0.5), 1e-9);
        (is_there && is_turned).then_some(())
    });
    process.kill();
    serving.join().expect("a client that leaves");
}

#[test]
fn wall_files_without_devices_and_ports_in_use_are_errors() {
    let place = TestDir::new();
    let none = place.write("none.toml", polyptych_wall_file::to_toml(&small(1, 1)));
    place.run(["devices".as_ref(), none.as_os_str()]).failed(&["none.toml", "[[device]]"]);
    let taken = UdpSocket::bind("127.0.0.1:0").expect("a port");
    let port = taken.local_addr().expect("an address");
    let wall = wall_with(&format!(
        "[[device]]\nname = \"tracker\"\nkind = \"osc\"\nlisten = \"{port}\"\n\
         [device.head]\npose = \"/head\"\n"
    ));
    let path = place.write("wall.toml", polyptych_wall_file::to_toml(&wall));
    let port = port.to_string();
    place.run(["devices".as_ref(), path.as_os_str()]).failed(&["tracker", port.as_str(), "in use"]);
}
