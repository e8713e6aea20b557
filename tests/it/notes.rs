//! Notes on parts of a scene that are not drawn, in every place where they must be: the answer of
//! `open`, the status, the log, the report of `simulate`, and a client.

use serde_json::{Value, json};

use crate::harness::local_wall::{ANY_PORT, LocalWall, small};
use crate::harness::place::TestDir;
use crate::harness::scenes::Gltf;
use crate::harness::simulation::Simulation;
use crate::harness::wait;

/// A triangle beside a scene that is not shown, and an extension whose name would move a cursor.
fn scene() -> Gltf {
    Gltf::triangle().with(|file| {
        file.json["extensionsUsed"] = json!(["ACME_shimmer\u{1b}[2J"]);
        file.json["scenes"] = json!([{ "nodes": [0] }, {}]);
    })
}

/// Checks that these lines state both things that are not drawn, and move no cursor.
#[track_caller]
fn check_notes(notes: &[String]) {
    for part in ["2 scenes: 0, 1; this is 0", "ACME_shimmer\\u{1b}[2J"] {
        assert!(notes.iter().any(|note| note.contains(part)), "{part}: {notes:?}");
    }
    assert!(!notes.iter().any(|note| note.contains('\u{1b}')), "{notes:?}");
}

/// The lines of a text that are notes.
fn noted(text: &str) -> Vec<String> {
    text.lines().filter_map(|line| line.strip_prefix("note: ")).map(str::to_owned).collect()
}

fn listed(json: &Value) -> Vec<String> {
    serde_json::from_value(json["notes"].clone()).expect("a list of texts")
}

#[test]
fn notes_reach_open_status_log_and_client_and_outlive_a_manager() {
    let place = TestDir::new();
    let wall = small(1, 1);
    let file = place.write("scenes/shimmer.glb", scene().glb());
    let folder = file.parent().expect("a folder").to_owned();
    let mut local = LocalWall::manager(place, &wall, &[&folder], ANY_PORT);
    let client = local.client();
    // Twice: a bake that is there already has its notes too.
    for _ in 0..2 {
        check_notes(&client.open_scene("shimmer.glb").expect("opened").notes);
    }
    check_notes(&client.status().expect("a status").notes);
    local.manager.await_line(&["WARN", "2 scenes: 0, 1"]);
    check_notes(&noted(&local.run(&["open", "shimmer.glb"]).output));
    local.manager.kill();
    let LocalWall { place, address, .. } = local;
    let local = LocalWall::manager(place, &wall, &[&folder], &address);
    check_notes(&noted(&local.run(&["status"]).succeeded()));
    check_notes(&listed(&local.run(&["status", "--json"]).json()));
    let mut arguments = vec!["status", "--watch", "--manager", &local.address];
    let mut watch = local.place.start("watch", &arguments);
    assert!(!watch.await_line(&["note: ", "ACME_shimmer"]).contains('\u{1b}'));
    arguments.push("--json");
    let line = local.place.start("watch", &arguments).await_line(&["\"notes\":"]);
    check_notes(&listed(&serde_json::from_str(&line).expect("JSON")));
    local.client().close_scene().expect("closed");
    assert_eq!(local.client().status().expect("a status").notes, [] as [String; 0]);
}

#[test]
fn a_simulation_says_its_notes_and_reports_them() {
    let place = TestDir::new();
    let file = place.write("shimmer.glb", scene().glb());
    let mut simulation = Simulation::start(place, &small(1, 1), &file, &["--frames", "2"]);
    check_notes(&noted(&simulation.process.finish(wait::LIMIT).succeeded()));
    let report = std::fs::read(simulation.place.path("out/report.json"));
    let report: Value = serde_json::from_slice(&report.expect("a report")).expect("JSON");
    check_notes(&listed(&report));
}
