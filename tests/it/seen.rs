//! Exit codes: every command says whether its effect is seen, and names the displays that do not
//! show it.

use polyptych_client::ChannelState;

use crate::harness::local_wall::{ANY_PORT, LocalWall, small};
use crate::harness::place::TestDir;
use crate::harness::process::Finished;
use crate::harness::scenes::{Gltf, town};
use crate::harness::simulation::Simulation;
use crate::harness::stub_server::StubServer;
use crate::harness::wait;

/// Every command whose effect is to be seen, in an order in which all can be done.
const COMMANDS: [&[&str]; 26] = [
    &["camera", "look-at", "-30,40,60", "0,5,-2"],
    &["camera", "pose", "-3,40,70", "0,0,0,1"],
    &["eye", "0,0.1,0.2"],
    &["eye", "--reset"],
    &["view", "add", "0,50,0", "0,0,0", "--up", "0,0,-1", "--ortho", "50"],
    &["view", "clear"],
    &["identify"],
    &["identify", "--off"],
    &["blank"],
    &["blank", "--off"],
    &["freeze"],
    &["freeze", "--off"],
    &["pattern", "grid"],
    &["pattern", "--off"],
    &["tune", "front-1-1", "gain=0.9"],
    &["exposure", "-1"],
    &["tone", "aces"],
    &["fog", "100"],
    &["fog", "200"],
    &["fog", "none"],
    &["depth-of-field", "10"],
    &["depth-of-field", "none"],
    &["bound", "--error", "1"],
    &["bound", "--error", "0"],
    &["shot", "shot.png"],
    &["open", "triangle.glb"],
];

/// Commands that tell and change nothing: who sees it is no question.
const QUESTIONS: [&[&str]; 5] = [
    &["status"],
    &["status", "--json"],
    &["eye"],
    &["view", "list"],
    &["tune", "front-1-1", "--show"],
];

/// Checks that a command was done and not seen by these channels, for these reasons.
#[track_caller]
fn check_unseen(finished: Finished, missing: &[(&str, &str)]) -> String {
    assert_eq!(finished.code(), 3, "{}", finished.output);
    let lines: Vec<&str> = finished.output.lines().filter(|l| l.starts_with("warning: ")).collect();
    assert_eq!(lines.len(), missing.len(), "{}", finished.output);
    for ((channel, why), line) in missing.iter().zip(lines) {
        let begin = format!("warning: channel {channel} ");
        assert!(line.starts_with(&begin) && line.contains(why), "{why:?} of {channel}: {line}");
    }
    finished.output
}

#[test]
fn exit_codes_say_whether_no_some_or_all_displays_show_what_a_command_did() {
    let place = TestDir::new();
    let wall = small(2, 1);
    let file = place.write("scenes/triangle.glb", Gltf::triangle().glb());
    let folder = file.parent().expect("a folder").to_owned();
    let mut local = LocalWall::manager(place, &wall, &[&folder], ANY_PORT);
    let client = local.client();
    let unclaimed = "no server has claimed it yet";
    for command in COMMANDS {
        let missing = [("front-1-1", unclaimed), ("front-2-1", unclaimed)];
        let said = check_unseen(local.run(command), &missing);
        assert!(!said.contains("every display"), "{said}");
        if matches!(command[0], "camera" | "eye" | "view" | "open") {
            assert!(said.contains("was shown by no display"), "{said}");
        }
    }
    for (server, missing) in [("front-1-1", Some("front-2-1")), ("front-2-1", None)] {
        local.start_server(server);
        wait::until("its channel live", || {
            let channels = client.status().expect("a status").channels;
            let states = [ChannelState::Ready, ChannelState::Live];
            channels.iter().find(|c| c.name == server && states.contains(&c.state)).map(drop)
        });
        for command in COMMANDS {
            let finished = local.run(command);
            match missing {
                Some(missing) => {
                    let said = check_unseen(finished, &[(missing, unclaimed)]);
                    if command[0] == "open" {
                        assert!(said.contains("by 1 of 2 displays"), "{said}");
                    }
                }
                None => assert!(!finished.succeeded().contains("warning: "), "{command:?}"),
            }
        }
        for question in QUESTIONS {
            local.run(question).succeeded();
        }
    }
    local.servers.remove("front-2-1").expect("a server").kill();
    local.await_lost(&client, "front-2-1");
    check_unseen(local.run(&["camera", "look-at", "0,0,9", "0,0,0"]), &[("front-2-1", "lost: ")]);
    let json = local.run(&["camera", "look-at", "0,0,9", "0,0,0", "--log", "json"]);
    assert_eq!(json.code(), 3, "{}", json.output);
    let line = json.output.lines().find(|line| line.starts_with('{')).expect("a line of JSON");
    let line: serde_json::Value = serde_json::from_str(line).expect("JSON");
    let message = line["fields"]["message"].as_str().expect("a text");
    assert!(line["level"] == "WARN" && message.starts_with("channel front-2-1 does not"), "{line}");
    local.run(&["open", "missing.glb"]).failed(&["missing.glb", "not found"]);
    local.run(&["eye", "0,0,-3"]).failed(&["behind screen front"]);
    local.run(&["stop"]).succeeded();
    local.run(&["camera", "look-at", "0,0,9", "0,0,0"]).failed(&["no manager"]);
}

#[test]
fn open_waits_for_displays_that_get_ready_and_says_so() {
    let place = TestDir::new();
    let wall = small(2, 1);
    let file = place.write("scenes/triangle.glb", Gltf::triangle().glb());
    let folder = file.parent().expect("a folder").to_owned();
    let mut local = LocalWall::manager(place, &wall, &[&folder], ANY_PORT);
    // A server that is on its way when the command begins.
    local.start_server("front-1-1");
    let arguments =
        ["open", "triangle.glb", "--wait", "50", "--manager", &local.address].map(String::from);
    let mut opening = local.place.start("open", arguments);
    opening.await_line(&["waiting for displays: ", "front-2-1 is lost"]);
    local.start_server("front-2-1");
    assert!(opening.finish(wait::LIMIT).succeeded().contains("shown at frame"));
}

#[test]
fn open_says_how_far_it_is_and_so_does_the_status() {
    let place = TestDir::new();
    let file = place.write("scenes/slow\u{1b}x.glb", Gltf::triangle().glb());
    let folder = file.parent().expect("a folder").to_owned();
    let local = LocalWall::manager(place, &small(1, 1), &[&folder], ANY_PORT);
    let client = local.client();
    let stub = StubServer::start(&local, "front");
    wait::until("the stub", || {
        let channels = client.status().expect("a status").channels;
        channels.iter().all(|c| c.state == ChannelState::Ready).then_some(())
    });
    stub.hold_prepared();
    let arguments = ["open", "slow\u{1b}x.glb", "--manager", &local.address].map(String::from);
    let mut opening = local.place.start("open", arguments);
    let line = opening.await_line(&["opening slow", "preparing 0 %"]);
    assert!(line.contains("slow\\u{1b}x"), "{line:?}");
    let said = local.run(&["status"]).succeeded();
    assert!(said.contains("opening slow\\u{1b}x: preparing 0 %"), "{said}");
    let json = local.run(&["status", "--json"]).json();
    assert_eq!(json["opening"][0]["progress"]["stage"], "preparing");
    stub.release_prepared();
    let said = opening.finish(wait::LIMIT).succeeded();
    assert!(said.contains("shown at frame"), "{said}");
    assert!(!local.run(&["status"]).succeeded().contains("opening"));
}

#[test]
fn a_client_hears_how_far_a_bake_is() {
    let folder = town().parent().expect("a folder");
    let local = LocalWall::manager(TestDir::unbaked(), &small(1, 1), &[folder], ANY_PORT);
    let mut heard = Vec::new();
    local.client().open_scene_with("town.glb", |progress| heard.push(progress)).expect("opened");
    let baking = heard.iter().filter(|p| p.stage == polyptych_client::OpenStage::Baking);
    let percents: Vec<u8> = baking.map(|progress| progress.percent).collect();
    assert!(percents.is_sorted() && percents.iter().any(|p| (1..100).contains(p)), "{heard:?}");
    assert!(heard.is_sorted_by_key(|progress| progress.stage), "{heard:?}");
}

#[test]
fn a_simulation_whose_last_picture_lacks_a_channel_is_done_but_not_seen() {
    let fault = ["--frames", "5", "--fault", "at 5 kill front-2-1"];
    let mut simulation = Simulation::start(TestDir::new(), &small(2, 1), town(), &fault);
    let finished = simulation.process.finish(wait::LIMIT);
    assert_eq!(finished.code(), 3, "{}", finished.output);
    assert!(finished.output.contains("warning: channel front-2-1 is not in the picture"));
    assert!(simulation.place.path("out/report.json").is_file());
}
