//! Two managers of one wall: one leads, and the other takes over when the first is killed or
//! stopped, with all that was acknowledged; and clients go over to it.
//!
//! `POLYPTYCH_KILLS=200 cargo test --release --test it standby -- --nocapture` kills a leader 200
//! times and prints how much was acknowledged, and how long the wall stood still.

use std::ffi::OsString;
use std::fs;
use std::net::TcpListener;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use polyptych_client::blocking::Client;
use polyptych_client::{
    Camera, ChannelState, ClientError, ConnectOptions, Pacing, Quantiles, ReconnectPolicy, Request,
    Wall,
};
use polyptych_protocol::limits::{CLIENT_HEARTBEAT_PERIOD, MANAGER_SILENCE_MAX};
use rustix::process::Signal;

use crate::harness::local_wall::{ANY_PORT, await_states, screen_of, small, start_server, tiled};
use crate::harness::place::TestDir;
use crate::harness::process::Process;
use crate::harness::scenes::Gltf;
use crate::harness::{signals, wait};
use crate::manager_kills::{Driver, SCENES, Shown, await_moving, pictures_of_all, random_below};

/// Kills in an ordinary run, each some seconds.
const KILLS: usize = 4;

/// The lease time of these managers, in seconds.
const LEASE_S: &str = "1";

/// Maximum time from the death of a leader until the wall moves again: the lease time and two
/// seconds, since machines that also build something are slow.
const MOVING_TIME_MAX: Duration = Duration::from_secs(3);

/// Longest time from the first request to a leader to its death.
const LIFE_MAX: Duration = Duration::from_millis(400);

/// Two managers that share a wall, and its servers.
struct Pair {
    place: TestDir,
    addresses: [String; 2],
    managers: [Process; 2],
    /// The number of the manager that leads.
    leader: usize,
    servers: Vec<Process>,
}

/// A port that was free just now.
fn free_address() -> String {
    let listener = TcpListener::bind(ANY_PORT).expect("a port");
    listener.local_addr().expect("an address").to_string()
}

fn start_manager(place: &TestDir, address: &str) -> Process {
    let mut arguments: Vec<OsString> =
        ["manager", "--standby", "--lease-time", LEASE_S, "--listen", address]
            .map(OsString::from)
            .to_vec();
    let given: [(&str, PathBuf); 3] = [
        ("--state", place.path("shared/wall.state")),
        ("--scenes", place.path("scenes")),
        ("--record", place.path("wall.rec")),
    ];
    arguments.extend(given.into_iter().flat_map(|(name, path)| [name.into(), path.into()]));
    arguments.push(place.path("wall.toml").into());
    place.start(&format!("manager {address}"), arguments)
}

impl Pair {
    fn start(wall: &Wall) -> Self {
        let place = TestDir::new();
        place.write("scenes/left.glb", Gltf::triangle().glb());
        let moved =
            Gltf::triangle().with(|g| g.json["nodes"][0]["translation"] = [0.5, 0.2, 0.0].into());
        place.write("scenes/right.glb", moved.glb());
        place.write("wall.toml", polyptych_wall_file::to_toml(wall));
        let addresses = [0, 1].map(|_| free_address());
        let mut first = start_manager(&place, &addresses[0]);
        first.await_line(&["manager listens"]);
        let second = start_manager(&place, &addresses[1]);
        let mut pair =
            Self { place, addresses, managers: [first, second], leader: 0, servers: Vec::new() };
        pair.await_standby();
        let all = pair.addresses.join(",");
        let start = |server: &str| start_server(&pair.place, wall, server, &all);
        pair.servers = wall.channels.iter().map(|channel| start(&channel.server)).collect();
        await_states(&pair.client(), &[ChannelState::Ready, ChannelState::Live]);
        pair
    }

    /// Waits until the manager that does not lead waits for the other one.
    fn await_standby(&mut self) {
        let waits_for = format!("waiting: {}", self.addresses[self.leader]);
        self.managers[1 - self.leader].await_line(&[&waits_for, "holds the lease"]);
    }

    /// Returns the addresses of both, and the identity with which a client connects once.
    fn options(&self) -> ConnectOptions {
        let mut options = ConnectOptions::new(self.addresses.join(","));
        options.token_file = Some(self.place.token_file());
        options.name = "test".into();
        options.reconnect = None;
        options
    }

    /// A client of the manager that leads, as soon as there is one.
    fn client(&self) -> Client {
        let options = self.options();
        wait::until("a manager that leads", || Client::connect_with(options.clone()).ok())
    }

    /// Kills the leader and waits until the wall moves by the other manager; returns a client of
    /// that, and the time.
    fn kill_leader(&mut self) -> (Client, Duration) {
        self.managers[self.leader].kill();
        let killed = Instant::now();
        let client = self.client();
        await_moving(&client);
        self.leader = 1 - self.leader;
        (client, killed.elapsed())
    }
}

#[test]
fn nothing_acknowledged_is_lost_when_a_standby_takes_over() {
    let mut pair = Pair::start(&small(2, 1));
    let mut client = pair.client();
    let pictures = pictures_of_all(&client);
    client.start_rendering(Pacing::Rate(60.0)).expect("running");
    let mut possible = vec![Shown { scene: SCENES[2], camera: 1 }];
    let mut revision = client.status().expect("status").revision;
    let kills = std::env::var("POLYPTYCH_KILLS").ok().and_then(|count| count.parse().ok());
    let (mut still_ms, mut acknowledged) = (Vec::new(), 0);
    for kill in 0..kills.unwrap_or(KILLS) {
        let driver = Driver::start(client, possible, [5, 1000][kill % 2]);
        driver.began.recv().expect("it asks");
        // A moment that nobody has chosen.
        let life = LIFE_MAX.mul_f64(random_below(1000) as f64 / 1000.0);
        let _ = wait::look_for(life, || None::<()>);
        let killed;
        (client, killed) = pair.kill_leader();
        let driven = wait::within("the driver's end", || driver.thread.join()).expect("it ends");
        acknowledged += driven.acknowledged;
        still_ms.push(killed.as_secs_f64() * 1e3);
        let status = client.status().expect("status");
        assert!(status.revision >= revision, "{kill}: {status:?} after revision {revision}");
        revision = status.revision;
        let picture = screen_of(&client.capture().expect("a picture"));
        let is_shown = |shown: &Shown| {
            shown.scene == status.scene.as_deref() && pictures.of(*shown) == &picture
        };
        let found: Vec<Shown> = driven.possible.iter().copied().filter(is_shown).collect();
        let (scene, possible_then) = (&status.scene, &driven.possible);
        assert!(!found.is_empty(), "{kill}: {scene:?} and its picture: none of {possible_then:?}");
        possible = found;
        // The dead one comes back as the standby of the other.
        let dead = 1 - pair.leader;
        pair.managers[dead] = start_manager(&pair.place, &pair.addresses[dead]);
        pair.await_standby();
    }
    let spread = Quantiles::from_samples(still_ms.iter().copied());
    println!(
        "{acknowledged} requests acknowledged, {} kills; from death to moving, ms: {spread:?}",
        still_ms.len()
    );
    assert!(spread.p50 < MOVING_TIME_MAX.as_secs_f64() * 1e3, "{spread:?}");
}

#[test]
fn a_leader_that_was_stopped_for_a_while_commands_no_server_any_more() {
    // Servers notice within the heartbeat of a wall file that names none that it says nothing.
    let mut pair = Pair::start(&tiled([2, 1], [480, 272]));
    let client = pair.client();
    client.open_scene("left.glb").expect("opened");
    client.set_camera(Camera { scale: 2.0, ..Camera::IDENTITY }).expect("set");
    let before = client.status().expect("status");
    client.start_rendering(Pacing::Rate(60.0)).expect("running");
    pair.managers[0].signal(Signal::STOP);
    let stopped = Instant::now();
    pair.managers[1].await_line(&["took over", "without a sign of", &pair.addresses[0]]);
    println!("took over {} ms after the leader was stopped", stopped.elapsed().as_millis());
    let mut options = ConnectOptions::new(&*pair.addresses[1]);
    options.token_file = Some(pair.place.token_file());
    let client = Client::connect_with(options).expect("it leads");
    for server in &mut pair.servers {
        server.await_line(&["connected", &pair.addresses[1], "term=2"]);
    }
    await_moving(&client);
    println!("moved again {} ms after the leader was stopped", stopped.elapsed().as_millis());
    let now = client.status().expect("status");
    assert_eq!((now.revision, &now.scene), (before.revision, &before.scene));
    // The leader that stands still has the recording open.
    let is_told = |warnings: &[String]| {
        warnings.iter().any(|warning| warning.contains("another manager records there"))
    };
    assert_eq!([&before, &now].map(|status| is_told(&status.warnings)), [false, true], "{now:?}");
    let [old, new] = [before.leader, now.leader].map(|leader| leader.expect("a lease"));
    assert_eq!([old.term.0, new.term.0], [1, 2]);
    assert!(new.holder.starts_with(&pair.addresses[1]), "{new:?}");
    pair.managers[0].signal(Signal::CONT);
    let [first, mut second] = pair.managers;
    first_ends(first, &pair.addresses[1]);
    client.set_camera(Camera::IDENTITY).expect("the second goes on");
    await_moving(&client);
    assert!(!second.has_ended());
    for server in &pair.servers {
        let output = server.output();
        let last = output.lines().rfind(|line| line.contains("term=")).expect("it was connected");
        assert!(last.contains("term=2"), "{output}");
    }
}

/// Checks that a manager ends by itself since the one at this address leads.
fn first_ends(mut first: Process, leader: &str) {
    let said = first.finish(wait::LIMIT).failed(&["this manager leads no more", leader]);
    assert!(said.contains("term 2"), "{said}");
}

#[test]
fn a_connected_client_leaves_a_leader_that_hangs_and_none_that_is_quiet() {
    // A wall file with a longer heartbeat limit has clients wait for longer.
    let pair = Pair::start(&tiled([2, 1], [480, 272]));
    let reconnect = ReconnectPolicy { wait: wait::LIMIT, ..ReconnectPolicy::default() };
    let options = ConnectOptions { reconnect: Some(reconnect), ..pair.options() };
    let client = Client::connect_with(options).expect("it leads");
    client.open_scene("left.glb").expect("opened");
    let mut feedbacks = client.feedback().expect("a stream");
    let epoch = client.epoch();
    // A wall at rest that nobody asks sends heartbeats alone.
    let quiet = MANAGER_SILENCE_MAX + CLIENT_HEARTBEAT_PERIOD;
    assert_eq!(wait::look_for(quiet, || client.close_reason()), None, "the manager works");

    pair.managers[0].signal(Signal::STOP);
    let pid = pair.managers[0].pid();
    wait::until("the leader stands still", || signals::is_stopped(pid).then_some(()));
    let stopped = Instant::now();
    let larger = Camera { scale: 2.0, ..Camera::IDENTITY };
    let unanswered = client.submit(Request::SetCamera(larger)).expect("sent");
    let error = wait::within("the end of the silence", || unanswered.wait()).expect_err("it hangs");
    assert!(matches!(error, ClientError::ConnectionLost { .. }), "{error}");
    assert!(error.to_string().contains("it has sent nothing for 5 s"), "{error}");
    let status = client.status().expect("the other one answers");
    println!("answered {} ms after the leader was stopped", stopped.elapsed().as_millis());
    assert_eq!(status.leader.expect("a lease").term.0, 2);
    assert_eq!(status.scene.as_deref(), Some("left"));
    client.start_rendering(Pacing::Rate(60.0)).expect("running");
    let reconnects = wait::within("a frame of the other one", move || {
        while feedbacks.epoch() == epoch {
            feedbacks.next().expect("the stream goes on");
        }
        feedbacks.reconnects()
    });
    assert_eq!(reconnects, 1, "it was left once");

    pair.managers[0].signal(Signal::CONT);
    let [first, mut second] = pair.managers;
    first_ends(first, &pair.addresses[1]);
    client.set_camera(larger).expect("the second goes on");
    await_moving(&client);
    assert!(!second.has_ended());
}

#[test]
fn a_leader_that_ends_in_order_is_followed_at_once_and_a_stopped_wall_by_nobody() {
    let mut pair = Pair::start(&small(2, 1));
    pair.managers[0].signal(Signal::TERM);
    pair.managers[1].await_line(&["took over from", &pair.addresses[0], "which has ended"]);
    pair.leader = 1;
    pair.managers[0] = start_manager(&pair.place, &pair.addresses[0]);
    pair.await_standby();
    pair.client().stop().expect("stopped");
    for mut manager in pair.managers {
        manager.finish(wait::LIMIT).succeeded();
    }
}

#[test]
fn a_standby_that_cannot_listen_gives_its_lease_up() {
    let mut pair = Pair::start(&small(2, 1));
    // While it waits, it listens nowhere. If somebody else has its port by now, that will do too.
    let in_its_place = TcpListener::bind(&pair.addresses[1]);
    pair.managers[0].signal(Signal::TERM);
    pair.managers[0].finish(wait::LIMIT).succeeded();
    pair.managers[1].finish(wait::LIMIT).failed(&[&pair.addresses[1], "is in use"]);
    drop(in_its_place);
    pair.managers[0] = start_manager(&pair.place, &pair.addresses[0]);
    pair.managers[0].await_line(&["took over from", &pair.addresses[1], "which has ended"]);
}

#[test]
fn a_standby_does_not_take_over_without_the_state_that_the_leader_has_written() {
    let mut pair = Pair::start(&small(2, 1));
    pair.client().open_scene("right.glb").expect("opened");
    let before = pair.client().status().expect("status");
    // The storage of both fails. Nothing changes any more, so that the leader writes nothing.
    let [state, away] = ["shared/wall.state", "away.state"].map(|name| pair.place.path(name));
    fs::rename(&state, &away).expect("moved");
    pair.managers[0].kill();
    let ended = pair.managers[1].finish(wait::LIMIT);
    ended.failed(&["wall.state", "is missing", "mount its storage or put it back"]);
    assert!(!state.exists(), "an empty state would be taken for the wall's");
    // Once it is there again, the wall is what it was.
    fs::rename(&away, &state).expect("put back");
    pair.managers[1] = start_manager(&pair.place, &pair.addresses[1]);
    let now = pair.client().status().expect("status");
    assert_eq!((now.revision, now.scene.as_deref()), (before.revision, Some("right")));
}
