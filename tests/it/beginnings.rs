//! Obstacles to a process that starts, and things that could outlive it: another manager on the
//! same state, a state that is not a file, a limit of the system, a clock, a child that was
//! stopped.

use std::fs;
use std::os::unix::fs::symlink;
use std::process::Command;

use polyptych_client::ChannelState;
use rcgen::ExtendedKeyUsagePurpose;
use rustix::process::Signal;

use crate::harness::keys::{self, Forged};
use crate::harness::local_wall::{ANY_PORT, LocalWall, await_states, small};
use crate::harness::place::TestDir;
use crate::harness::process::Process;
use crate::harness::scenes::town;
use crate::harness::simulation::Simulation;
use crate::harness::{signals, wait};

const MANAGER: [&str; 4] = ["manager", "wall.toml", "--listen", ANY_PORT];

#[test]
fn a_state_file_has_one_manager_at_a_time() {
    let state = ["--state", "wall.state"];
    let mut first = LocalWall::manager_with(TestDir::new(), &small(1, 1), &[], ANY_PORT, &state);
    let place = &first.place;
    let pid = first.manager.pid().to_string();
    let second = MANAGER.iter().chain(&state);
    place.run(second.clone()).failed(&["wall.state", &pid, "wall.state.lock", "--state"]);
    // Nor may another one come by a link, whose lock would stand elsewhere.
    first.run(&["view", "save", "kept"]).succeeded();
    symlink(place.path("wall.state"), place.path("link.state")).expect("linked");
    let by_link = MANAGER.iter().chain(&["--state", "link.state"]);
    place.run(by_link).failed(&[&pid, "wall.state.lock"]);
    // A lock that a killed manager has left is no obstacle.
    first.manager.kill();
    let mut third = place.start("manager", second);
    third.await_line(&["manager listens"]);
}

#[test]
fn a_state_that_is_no_file_is_refused_at_once() {
    let place = TestDir::new();
    place.run(["wall", "grid", "-o", "wall.toml"]).succeeded();
    assert!(Command::new("mkfifo").arg(place.path("fifo")).status().expect("mkfifo").success());
    fs::create_dir(place.path("folder")).expect("made");
    for (name, reason) in [
        ("fifo", "it is a FIFO, not a regular file"),
        ("folder", "it is a folder, not a regular file"),
        ("/dev/null", "it is a device, not a regular file"),
    ] {
        let state = ["--state", name];
        place.run(MANAGER.iter().chain(&state)).failed(&["--state", name, reason]);
    }
}

#[test]
fn a_state_that_cannot_be_read_is_not_written_over() {
    let place = TestDir::new();
    place.run(["wall", "grid", "-o", "wall.toml"]).succeeded();
    symlink("loop.state", place.path("loop.state")).expect("linked");
    for name in ["wall.toml/below.state", "loop.state"] {
        let state = ["--state", name];
        place.run(MANAGER.iter().chain(&state)).failed(&["--state", name]);
    }
    let damaged = "PLYPSTA6, and then no state";
    place.write("wall.state", damaged);
    let state = ["--state", "wall.state"];
    let mut manager = place.start("manager", MANAGER.iter().chain(&state));
    manager.await_line(&["the state before was kept", "wall.state.old"]);
    assert_eq!(fs::read_to_string(place.path("wall.state.old")).expect("a copy"), damaged);
}

#[test]
fn a_scene_folder_that_is_missing_is_named_at_the_start() {
    let mut wall = small(1, 1);
    wall.scenes = vec!["no-such-folder".to_owned()];
    let mut local = LocalWall::manager(TestDir::new(), &wall, &[], ANY_PORT);
    local.manager.await_line(&["WARN", "a scene folder", "does not exist", "no-such-folder"]);
}

#[test]
fn a_bake_works_under_a_lower_limit_of_the_system() {
    let place = TestDir::unbaked();
    let scene = town().display();
    let program = place.command([""; 0]).get_program().to_owned();
    let bake = |kib: u32| {
        let script =
            format!("ulimit -v {kib}; exec \"$0\" bake '{scene}' -o baked --memory-mib 8192");
        let mut command = place.command([""; 0]);
        let mut shell = Command::new("sh");
        shell.arg("-c").arg(script).arg(&program).current_dir(place.folder());
        shell.envs(command.env("NO_COLOR", "1").get_envs().filter_map(|(k, v)| Some((k, v?))));
        Process::start("bake", &mut shell).finish(wait::LIMIT)
    };
    let said = bake(2 << 20).succeeded();
    assert!(said.contains("2048 MiB of address space instead of 8192 MiB"), "{said}");
    assert!(said.contains("manifest "), "{said}");
}

#[test]
fn a_server_whose_keys_are_not_valid_yet_waits_for_its_clock() {
    let (place, wall) = (TestDir::new(), small(1, 1));
    keys::make(&place, &wall);
    let mut local = LocalWall::manager(place, &wall, &[], ANY_PORT);
    let name = wall.channels[0].server.clone();
    let folder = keys::of(&local.place, &format!("server-{name}")).expect("keys");
    let forged = |from| Forged {
        names: vec![polyptych_tls::NodeIdentity::Server(name.clone()).dns_name()],
        days: [from, 365],
        purpose: ExtendedKeyUsagePurpose::ClientAuth,
    };
    let authority = local.place.path("keys/authority");
    forged(2).write(&authority, &folder);
    local.start_server(&name);
    let server = local.servers.get_mut(&name).expect("started");
    server.await_line(&["WARN", "waiting for the right time", "has not begun", "set the clocks"]);
    server.await_line(&["WARN", "not connected", "has not begun"]);
    assert!(!server.has_ended(), "it waits");
    // The clock is right now.
    forged(-1).write(&authority, &folder);
    server.await_line(&["connected"]);
    await_states(&local.client(), &[ChannelState::Ready]);
}

#[test]
fn children_that_were_stopped_end_with_a_simulation_however_it_ends() {
    for end in [Signal::TERM, Signal::KILL] {
        let arguments = ["--rate", "10", "--seconds", "600"];
        let mut simulation = Simulation::start(TestDir::new(), &small(2, 1), town(), &arguments);
        simulation.process.await_line(&["scene town"]);
        let children = simulation.children("server");
        assert_eq!(children.len(), 2);
        for child in &children {
            signals::send(*child, Signal::STOP);
        }
        simulation.process.signal(end);
        wait::until("the end of the simulation", || simulation.process.has_ended().then_some(()));
        let is_gone = |pid: &u32| {
            // The last field before the numbers: Z for one that nobody has asked about yet.
            let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
            stat.rsplit(") ").next().is_none_or(|rest| rest.is_empty() || rest.starts_with('Z'))
        };
        wait::until("the end of its children", || children.iter().all(is_gone).then_some(()));
    }
}
