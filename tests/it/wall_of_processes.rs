//! A wall is started, driven, hurt and ended, all by the command.

use std::net::TcpListener;

use polyptych_client::{ChannelState, FrameFeedback};
use rustix::process::Signal;
use serde_json::Value;

use crate::harness::local_wall::{ANY_PORT, LocalWall, await_states, small, start_server};
use crate::harness::pictures::{color_count, read};
use crate::harness::place::TestDir;
use crate::harness::process::Process;
use crate::harness::scenes::{poses, town};
use crate::harness::simulation::Simulation;
use crate::harness::{signals, wait};

#[test]
fn processes_start_in_any_order_and_the_command_drives_them() {
    let wall = small(2, 1);
    let place = TestDir::new();
    // A port that was free a moment ago: the server must know it before the manager does.
    let address = TcpListener::bind(ANY_PORT).and_then(|listener| listener.local_addr());
    let address = address.expect("a free port").to_string();
    let early = wall.channels[0].server.clone();
    let mut server = start_server(&place, &wall, &early, &address);
    server.await_line(&["not connected; trying again for ever", &address]);
    let folder = town().parent().expect("a folder");
    let mut local = LocalWall::manager(place, &wall, &[folder], &address);
    local.servers.insert(early, server);
    local.start_server(&wall.channels[1].server.clone());
    let client = local.client();
    await_states(&client, &[ChannelState::Ready]);

    let opened = local.run(&["open", "town.glb"]).succeeded();
    assert!(opened.contains("town") && opened.contains("triangles"), "{opened}");
    let status = status_of(&local);
    check_status(&local, &status);
    let frame_before = status["frame"].as_u64();
    let first = local.place.path("first.png");
    let said = local.run(&["shot", first.to_str().expect("text")]).succeeded();
    assert!(said.contains("480 × 272 pixels"), "{said}");
    // Negative numbers are points too.
    local.run(&["camera", "look-at", "-30,40,60", "0,5,-2"]).succeeded();
    local.run(&["camera", "pose", "-3,40,70", "0,0,0,1", "--scale", "2"]).succeeded();
    let second = local.place.path("second.png");
    local.run(&["shot", second.to_str().expect("text")]).succeeded();
    let [first, second] = [first, second].map(|path| read(&path));
    assert_eq!((first.width(), first.height()), (480, 272));
    assert!(color_count(&first) > 100 && color_count(&second) > 100 && first != second);
    assert!(status_of(&local)["frame"].as_u64() >= frame_before.map(|frame| frame + 4));
    let table = local.run(&["status"]).succeeded();
    assert!(table.contains("CHANNEL") && table.contains(&wall.channels[1].name), "{table}");

    let said = local.run(&["stop"]).succeeded();
    assert!(said.contains("small"), "{said}");
    assert_eq!(local.manager.finish(wait::SOON).code(), 0);
    for (name, server) in &mut local.servers {
        server.await_line(&["a client stopped the manager"]);
        assert!(!server.has_ended(), "{name} goes on trying");
        server.signal(Signal::TERM);
        assert_eq!(server.finish(wait::SOON).code(), 0, "{name} was asked to end");
    }
    local.run(&["status"]).failed(&["no manager at", "polyptych manager WALL.toml"]);
}

fn status_of(local: &LocalWall) -> Value {
    local.run(&["status", "--json"]).json()
}

fn check_status(local: &LocalWall, status: &Value) {
    assert_eq!(status["wall"], "small");
    assert_eq!(status["scene"], "town");
    let channels = status["channels"].as_array().expect("a list");
    assert_eq!(channels.len(), 2);
    for channel in channels {
        let name = channel["name"].as_str().expect("a name");
        assert_eq!(channel["state"], "live", "{channel}");
        assert_eq!(channel["pid"], local.servers[name].pid(), "{channel}");
        assert!(channel["address"].as_str().is_some_and(|a| a.starts_with("127.0.0.1:")));
        assert!(channel["frame"].as_u64() >= Some(1), "{channel}");
        assert_eq!(channel["revision"], status["revision"], "{channel}");
    }
}

#[test]
fn a_server_that_is_killed_comes_back_and_the_wall_goes_on() {
    let arguments = ["--orbit", "--rate", "30", "--seconds", "600"];
    let mut simulation = Simulation::start(TestDir::new(), &small(2, 1), town(), &arguments);
    simulation.process.await_line(&["scene town"]);
    let client = simulation.client();
    await_states(&client, &[ChannelState::Live]);
    let mut feedbacks = client.feedback().expect("a stream");
    let victim = client.status().expect("status").channels.swap_remove(0);
    let pid = victim.pid.expect("a process");
    assert!(simulation.children("server").contains(&pid), "the status names a child");
    signals::send(pid, Signal::KILL);
    let (lost, back) = wait::within("lost and back", move || {
        let mut of_state = |state| {
            let is_it = |feedback: &FrameFeedback| feedback.channels[0].state == state;
            feedbacks.find(is_it).expect("the stream goes on")
        };
        (of_state(ChannelState::Lost), of_state(ChannelState::Live))
    });
    assert_eq!(lost.channels[0].name, victim.name);
    assert!(lost.channels[0].draw_us.is_none(), "{lost:?}");
    assert_eq!(lost.channels[1].state, ChannelState::Live, "the other goes on");
    assert!(lost.channels[1].draw_us.is_some(), "{lost:?}");
    assert!(back.frame.0 > lost.frame.0 + 5, "frames came meanwhile: {lost:?} {back:?}");
    assert!(back.channels[1].state == ChannelState::Live && back.revision == lost.revision);
    let status = client.status().expect("status");
    assert_ne!(status.channels[0].pid, Some(pid), "another process");
    assert_eq!(status.channels[1].late, 0);
    simulation.interrupt(Signal::INT, "after a restart");
}

#[test]
fn an_interrupted_simulation_leaves_nothing_behind() {
    let begin = || {
        let arguments = ["--orbit", "--seconds", "600"];
        Simulation::start(TestDir::cold(), &small(2, 1), town(), &arguments)
    };
    let has = |simulation: &Simulation, child: &str| {
        wait::until(child, || (!simulation.children(child).is_empty()).then_some(()));
    };
    type Moment<'a> = (&'a str, Signal, &'a dyn Fn(&mut Simulation));
    let moments: [Moment; 5] = [
        ("before the servers start", Signal::INT, &|s| drop(s.process.await_line(&["wall small"]))),
        ("while servers start", Signal::TERM, &|s| has(s, "server")),
        ("while all are there", Signal::INT, &|s| drop(s.client())),
        ("while the scene is baked", Signal::INT, &|s| has(s, "bake")),
        ("while it draws", Signal::TERM, &|s| drop(s.process.await_line(&["scene town"]))),
    ];
    for (when, signal, wait_for) in moments {
        let mut simulation = begin();
        wait_for(&mut simulation);
        simulation.interrupt(signal, when);
        assert!(!simulation.process.output().contains("error:"), "{when}");
    }
}

#[test]
fn children_end_with_a_simulation_that_is_killed() {
    let begin = |place: TestDir| {
        let arguments = ["--orbit", "--seconds", "600"];
        Simulation::start(place, &small(2, 1), town(), &arguments)
    };
    let mut simulation = begin(TestDir::new());
    simulation.process.await_line(&["scene town"]);
    assert_eq!(simulation.children("server").len(), 2);
    simulation.process.kill();
    simulation.await_no_orphans("killed while it draws");

    let mut simulation = begin(TestDir::cold());
    wait::until("a bake", || simulation.children("bake").pop());
    wait::until("its end", || simulation.children("bake").is_empty().then_some(()));
    simulation.process.kill();
    simulation.await_no_orphans("killed while the driver compiles");
}

#[test]
fn a_manager_that_is_killed_and_started_again_goes_on_with_its_wall() {
    let wall = small(2, 1);
    let folder = town().parent().expect("a folder");
    let mut local = LocalWall::start(&wall, &[folder]);
    let client = local.client();
    let bounds = client.open_scene("town.glb").expect("opened").bounds.expect("bounds");
    client.set_camera(poses(&bounds)[0]).expect("set");
    let before = client.capture().expect("a picture");
    let known = client.status().expect("status");
    let pids: Vec<u32> = local.servers.values().map(Process::pid).collect();
    local.manager.kill();
    assert!(client.render_frame().is_err(), "nobody is there to draw it");
    let LocalWall { place, address, servers, .. } = local;
    let mut local = LocalWall::manager(place, &wall, &[folder], &address);
    local.servers = servers;
    let client = local.client();
    let status = await_states(&client, &[ChannelState::Ready, ChannelState::Live]);
    assert_ne!(status.epoch, known.epoch);
    assert_eq!((status.revision, status.digest), (known.revision, known.digest));
    assert_eq!(status.scene, known.scene);
    assert_eq!(local.servers.values().map(Process::pid).collect::<Vec<_>>(), pids);
    let after = client.capture().expect("a picture");
    assert_eq!(after.missing, []);
    assert!(after.screens == before.screens, "the scene or the camera is another one");
}
