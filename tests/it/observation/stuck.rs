//! Standard error that nobody reads: the wall goes on, and what could not be written is counted.

use std::io::Read;
use std::process::{Child, Stdio};
use std::thread::Builder;
use std::time::Instant;

use polyptych_client::blocking::Client;
use polyptych_client::{ChannelState, ConnectOptions, Pacing};
use rustix::process::Signal;

use crate::harness::local_wall::{ANY_PORT, await_states, small, start_server};
use crate::harness::place::TestDir;
use crate::harness::scenes::town;
use crate::harness::{signals, wait};

/// Connections that log more than a pipe of 64 KiB and the queue of 256 KiB take: two lines of
/// more than 100 bytes each.
const CONNECTIONS: usize = 2000;

/// A manager whose standard error is a pipe that the test reads when it wants to.
struct Unread {
    child: Child,
    options: ConnectOptions,
}

impl Drop for Unread {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Starts it, with a port that is free now.
fn start(place: &TestDir) -> Unread {
    let free = std::net::TcpListener::bind(ANY_PORT).and_then(|l| l.local_addr());
    let address = free.expect("a port").to_string();
    place.write("wall.toml", polyptych_wall_file::to_toml(&small(1, 1)));
    let scenes = town().parent().expect("a folder").display().to_string();
    let arguments = ["manager", "wall.toml", "--listen", &address, "--scenes", &scenes];
    let mut command = place.command(arguments);
    let child = command.stderr(Stdio::piped()).stdout(Stdio::null()).stdin(Stdio::null()).spawn();
    let mut options = ConnectOptions::new(address.as_str());
    options.token_file = Some(place.token_file());
    // Long lines, for fewer of them.
    options.name = "n".repeat(60);
    options.reconnect = None;
    Unread { child: child.expect("started"), options }
}

#[test]
fn an_unread_standard_error_stops_no_frame_and_dropped_lines_are_counted() {
    let place = TestDir::new();
    let mut unread = start(&place);
    let connect = || Client::connect_with(unread.options.clone());
    let client = wait::until("the manager listens", || connect().ok());
    let wall = small(1, 1);
    let name = wall.channels[0].server.clone();
    let _server = start_server(&place, &wall, &name, &unread.options.address);
    await_states(&client, &[ChannelState::Ready]);
    client.open_scene(town().display().to_string()).expect("opened");
    client.start_rendering(Pacing::Rate(30.0)).expect("running");
    await_states(&client, &[ChannelState::Live]);
    let frames = || client.status().expect("an answer").frame.0;
    let before = frames();
    let begin = Instant::now();
    for _ in 0..CONNECTIONS {
        connect().expect("the manager still lets clients in");
    }
    let drawn = frames() - before;
    let took = begin.elapsed();
    assert!(drawn > 0, "no frame in {took:?}");
    let mut output = unread.child.stderr.take().expect("a pipe");
    let now = frames();
    wait::until("frames go on", || (frames() > now + 3).then_some(()));

    // Read at last.
    let read = Builder::new().name("reader".into()).spawn(move || {
        let mut text = String::new();
        output.read_to_string(&mut text).map(|_| text)
    });
    let read = read.expect("a thread");
    connect().expect("an answer");
    signals::send(unread.child.id(), Signal::TERM);
    let ended = wait::until("its end", || unread.child.try_wait().expect("can be asked"));
    assert!(ended.success(), "{ended}");
    let text = read.join().expect("no panic").expect("text");
    let dropped = text.lines().find(|line| line.contains("log lines were dropped"));
    let dropped = dropped.unwrap_or_else(|| panic!("nothing was dropped: {} bytes", text.len()));
    let count = dropped.rsplit("dropped=").next().and_then(|count| count.parse::<usize>().ok());
    assert!(count.is_some_and(|count| count > 0), "{dropped}");
    println!("{drawn} frames in {took:?} with {CONNECTIONS} connections; {dropped}");
}

#[test]
fn a_manager_whose_standard_error_is_stuck_ends_in_time() {
    let place = TestDir::new();
    let mut unread = start(&place);
    let connect = || Client::connect_with(unread.options.clone());
    wait::until("the manager listens", || connect().ok());
    for _ in 0..CONNECTIONS {
        connect().expect("the manager still lets clients in");
    }
    signals::send(unread.child.id(), Signal::TERM);
    let ended = wait::until("its end", || unread.child.try_wait().expect("can be asked"));
    assert!(ended.success(), "{ended}");
}
