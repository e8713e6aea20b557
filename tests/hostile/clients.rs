//! Clients that ask too much and clients that do not read, all at once, on a wall of stub servers:
//! no server is lost, frames go on, and whoever reads its answers gets them in order.

use std::io::Write;
use std::net::TcpStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};

use polyptych_client::blocking::Client;
use polyptych_client::{Camera, ChannelState, Pacing, Request};
use polyptych_protocol::handshake::{ClientHello, Hello, Role, Secret};
use polyptych_protocol::handshake_io::send_hello;
use polyptych_protocol::ids::RequestId;
use polyptych_protocol::request::RequestMessage;
use polyptych_protocol::token;
use polyptych_wall::calibration_change::{CalibrationChange, Offset};

use crate::harness::local_wall::{ANY_PORT, LocalWall, await_states, tiled};
use crate::harness::place::TestDir;
use crate::harness::stub_server::StubServer;
use crate::harness::wait;

/// Names another number of stub servers: 64 are those of the long form.
const SERVERS_VARIABLE: &str = "POLYPTYCH_HOSTILE_SERVERS";

/// Stub servers of the short form.
const SERVERS: u32 = 8;

/// Frames per second that the wall is asked for.
const RATE: f64 = 60.0;

/// Frames over which the wall is looked at.
const FRAMES: u64 = 120;

/// Maximum resident memory of a manager under hostile clients, in bytes.
const MEMORY_BYTES_MAX: u64 = 256 << 20;

/// Least share of the frames of a quiet wall. It is low since a test's machine is busy; the share
/// that is reached is printed.
const SHARE_MIN: f64 = 0.5;

/// Threads that ask until it is dropped.
#[derive(Default)]
struct Hostile {
    is_over: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Hostile {
    fn run(&mut self, name: &str, mut step: impl FnMut() + Send + 'static) {
        let is_over = Arc::clone(&self.is_over);
        let work = move || {
            while !is_over.load(Ordering::Relaxed) {
                step();
            }
        };
        let thread = Builder::new().name(name.into()).spawn(work).expect("a thread");
        self.threads.push(thread);
    }
}

impl Drop for Hostile {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

/// A client's connection without a client library, which would read.
fn connect(local: &LocalWall, name: &str) -> TcpStream {
    let token = token::read(&local.place.token_file()).expect("a token");
    let hello = Hello::Client(ClientHello { name: name.into() });
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let stream = runtime.expect("a runtime").block_on(async {
        let stream = tokio::net::TcpStream::connect(&local.address).await.expect("connected");
        let introduced = send_hello(stream, Role::Client, &hello, &Secret(token)).await;
        introduced.expect("let in").0.into_inner().into_std().expect("a socket")
    });
    stream.set_nonblocking(false).expect("blocking");
    stream.set_write_timeout(Some(Duration::from_millis(200))).expect("a limit");
    stream
}

fn call(id: u64, request: Request) -> Vec<u8> {
    polyptych_codec::framed(&polyptych_codec::encode(&RequestMessage::new(RequestId(id), request)))
        .to_vec()
}

fn servers() -> u32 {
    std::env::var(SERVERS_VARIABLE).ok().and_then(|n| n.parse().ok()).unwrap_or(SERVERS)
}

/// Frames per second of the next [`FRAMES`] frames.
fn frame_rate(client: &Client) -> f64 {
    let frame = || client.status().expect("a status").frame.0;
    let (first, began) = (frame(), Instant::now());
    let last = wait::until("frames", || Some(frame()).filter(|frame| *frame >= first + FRAMES));
    (last - first) as f64 / began.elapsed().as_secs_f64()
}

#[test]
fn greedy_clients_starve_neither_servers_nor_each_other() {
    let mut wall = tiled([servers(), 1], [64 * servers(), 64]);
    // The machine is busy with the clients themselves: late is not what is asked here.
    (wall.deadline.min_ms, wall.deadline.max_ms) = (5000, 5000);
    let local = LocalWall::manager(TestDir::new(), &wall, &[], ANY_PORT);
    let names: Vec<String> = wall.channels.iter().map(|channel| channel.name.clone()).collect();
    let _stubs: Vec<_> = names.iter().map(|name| StubServer::start(&local, name)).collect();
    let client = local.client();
    client.start_rendering(Pacing::Rate(RATE)).expect("running");
    await_states(&client, &[ChannelState::Live]);
    let grid = vec![CalibrationChange::Grid(Some(glam::UVec2::splat(32)))];
    client.calibrate(&names[0], grid).expect("a bend");
    let quiet = frame_rate(&client);

    let mut hostile = Hostile::default();
    let dragged = Arc::<AtomicU64>::default();
    drag(&mut hostile, &local, &names[0], &dragged);
    let mut cameras = connect(&local, "cameras");
    let camera = call(1, Request::SetCamera(Camera::IDENTITY)).repeat(100);
    hostile.run("cameras", move || {
        // Nobody reads the answers, so that it stands still some time, and is let go at last.
        let _ = cameras.write_all(&camera);
    });
    for index in 0..10 {
        let mut deaf = connect(&local, &format!("deaf-{index}"));
        let statuses = call(1, Request::Status).repeat(100);
        hostile.run("deaf", move || {
            let _ = deaf.write_all(&statuses);
        });
    }
    for _ in 0..8 {
        let scraper = local.client();
        hostile.run("scraper", move || {
            scraper.status().expect("answered, for it reads");
        });
    }
    // The best of three: what else this machine does meanwhile is no client of the wall.
    let busy = (0..3).map(|_| frame_rate(&client)).fold(0.0, f64::max);
    drop(hostile);

    let status = client.status().expect("a status");
    let (tuned, memory) = (dragged.load(Ordering::Relaxed), status.memory_bytes);
    let share = busy / quiet;
    println!(
        "{} servers: {quiet:.1} frames per second alone, {busy:.1} among 20 clients ({share:.2}); \
         {tuned} drags shown; manager {} MiB",
        names.len(),
        memory >> 20
    );
    let all_live = status.channels.iter().all(|channel| channel.state == ChannelState::Live);
    assert!(all_live, "{:?}", status.channels);
    assert!(share > SHARE_MIN, "{share:.2} of the frames are left");
    assert!(memory < MEMORY_BYTES_MAX, "the manager takes {} MiB", memory >> 20);
    assert!(tuned > 0, "no drag was shown");
}

/// Drags a point of a bend as a mouse of 1 kHz does, and reads every answer in order.
fn drag(hostile: &mut Hostile, local: &LocalWall, channel: &str, dragged: &Arc<AtomicU64>) {
    let client = local.client();
    let (channel, dragged) = (channel.to_owned(), Arc::clone(dragged));
    let mut step = 0.0;
    hostile.run("mouse", move || {
        let pending: Vec<_> = (0..50)
            .map(|_| {
                step += 0.001;
                let to = Offset::To(glam::DVec2::splat(step));
                let changes = vec![CalibrationChange::Bend { column: 5, row: 5, to }];
                let channel = channel.clone();
                client.submit(Request::Tune { channel, changes }).expect("asked")
            })
            .collect();
        let mut last = None;
        for answer in pending {
            let revision = match answer.wait().expect("tuned") {
                polyptych_client::Response::Tuned(tuned) => tuned.revision,
                other => panic!("{other:?}"),
            };
            assert!(Some(revision) >= last, "answers in order");
            last = Some(revision);
            dragged.fetch_add(1, Ordering::Relaxed);
        }
    });
}

/// The number of clients that the manager accepts beside one on its own machine.
const HOSTILE_CLIENTS: u64 = 256;

#[test]
fn many_clients_that_do_not_read_hold_little_memory() {
    let wall = tiled([4, 1], [256, 64]);
    let local = LocalWall::manager(TestDir::new(), &wall, &[], ANY_PORT);
    let stubs: Vec<_> =
        wall.channels.iter().map(|channel| StubServer::start(&local, &channel.name)).collect();
    let client = local.client();
    client.start_rendering(Pacing::Rate(RATE)).expect("running");
    await_states(&client, &[ChannelState::Live]);
    let long = Request::OpenScene { path: "x".repeat(4000), scene: None };
    let mut held = Vec::new();
    for index in 0..HOSTILE_CLIENTS {
        let mut deaf = connect(&local, &format!("deaf-{index}"));
        let mut said = call(0, Request::Subscribe(true));
        said.extend(call(1, Request::Status).repeat(200));
        said.extend(call(2, long.clone()).repeat(100));
        // It takes what it can.
        let _ = deaf.write_all(&said);
        held.push(deaf);
    }
    let rate = frame_rate(&client);
    let status = client.status().expect("a status");
    println!(
        "{HOSTILE_CLIENTS} deaf clients: manager {} MiB, {rate:.1} fps",
        status.memory_bytes >> 20
    );
    assert!(status.memory_bytes < MEMORY_BYTES_MAX, "{} MiB", status.memory_bytes >> 20);
    assert!(status.channels.iter().all(|channel| channel.state == ChannelState::Live));
    drop((held, stubs));
}
