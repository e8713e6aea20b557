//! `polyptych bench`: speed against error of scenes, as a page and as JSON.

use std::fs::{self, Permissions};
use std::os::unix::fs::PermissionsExt;

use rustix::process::Signal;
use serde_json::{Value, json};

use crate::harness::place::TestDir;
use crate::harness::scenes::{Gltf, town};
use crate::harness::{signals, wait};

/// A report of few small frames.
const SMALL: &str = "bench --size 160x96 --error-bounds 0.5,4 --channels 2 --rounds 1 --poses 2 \
                     --out report --frames";

fn arguments<'a>(frames: &'a str, scenes: &[&'a str]) -> Vec<&'a str> {
    SMALL.split(' ').chain([frames]).chain(scenes.iter().copied()).collect()
}

fn json_of(place: &TestDir) -> Value {
    let text = fs::read(place.path("report/report.json")).expect("a report");
    serde_json::from_slice(&text).expect("JSON")
}

/// The page as XML, which it is below its first line.
fn page_of(place: &TestDir) -> String {
    let page = fs::read_to_string(place.path("report/report.html")).expect("a page");
    let (doctype, rest) = page.split_once('\n').expect("lines");
    assert_eq!(doctype, "<!doctype html>");
    rest.to_owned()
}

fn number(value: &Value, key: &str) -> f64 {
    value[key].as_f64().unwrap_or_else(|| panic!("{key} is no number: {value}"))
}

#[test]
fn a_report_has_time_detail_and_measured_error_for_every_bound() {
    let place = TestDir::new();
    let town = town().display().to_string();
    // Thirty walls, one after the other.
    let mut bench = place.start("bench", arguments("3", &[&town]));
    let said = bench.finish(4 * wait::LIMIT).succeeded();
    assert!(said.contains("town: bound 0.5 px: ") && said.contains("report.html"), "{said}");
    let report = json_of(&place);
    let [scene] = &report.as_array().expect("a list of scenes")[..] else { panic!("{report}") };
    assert_eq!((&scene["scene"], &scene["error"]), (&"town".into(), &Value::Null));
    assert!(scene["adapter"].as_str().is_some_and(|adapter| !adapter.is_empty()), "{scene}");
    assert!(scene["run"]["command"].as_str().is_some_and(|c| c.contains("--rounds 1")), "{scene}");
    let bounds = scene["bounds"].as_array().expect("a list of bounds");
    let asked: Vec<f64> = bounds.iter().map(|bound| number(bound, "error_bound_px")).collect();
    assert_eq!(asked, [0.0, 0.5, 4.0]);
    for bound in bounds {
        assert_eq!(bound["frame_ms_spread"]["count"], 3, "{bound}");
        assert!(number(bound, "frame_ms") > 0.0, "{bound}");
        assert!(number(bound, "triangles") > 100.0 && number(bound, "draw_calls") > 1.0, "{bound}");
        assert!(number(bound, "gpu_bytes") > 1e4 && number(bound, "server_bytes") > 1e6);
        let asked_px = number(bound, "error_bound_px");
        assert_eq!(number(&bound["error_in_force_px"], "max"), asked_px, "{bound}");
        assert!(number(bound, "largest_error_px") <= asked_px, "{bound}");
        let poses = ["poses_outlined", "poses_within"].map(|key| number(bound, key));
        assert_eq!(poses, [2.0; 2], "{bound}");
        // Outlines are compared in half pixels, in which an edge may round either way.
        assert!(number(bound, "silhouette_px") <= asked_px + 0.75, "{bound}");
        assert!((0.0..=1.0).contains(&number(bound, "flip")), "{bound}");
        assert!(number(bound, "flip") <= number(bound, "flip_p99"), "{bound}");
    }
    let full = &bounds[0];
    assert_eq!((number(full, "silhouette_px"), number(full, "flip")), (0.0, 0.0));
    let empty = &scene["empty_frame"];
    assert_eq!((number(empty, "triangles"), number(empty, "draw_calls")), (0.0, 0.0), "{empty}");
    assert!(number(empty, "frame_ms") < number(full, "frame_ms"), "{empty}, {full}");
    let flat = &scene["flat_frame"];
    // What was transparent hides others now.
    let of_full = number(flat, "triangles") / number(full, "triangles");
    assert!((0.8..=1.05).contains(&of_full), "{flat}, {full}");
    assert_eq!(scene["flat_error"], Value::Null);
    let step = &scene["load_step"];
    assert!(number(step, "rate_bound_fps") >= 1.0, "{step}");
    let phases = step["phases"].as_array().expect("a list");
    let cameras: Vec<f64> = phases.iter().map(|phase| number(phase, "cameras")).collect();
    assert_eq!(cameras, [1.0, 2.0, 1.0]);
    for phase in phases {
        assert_eq!(number(phase, "frames"), 9.0, "{phase}");
        assert!(number(phase, "in_time") <= 9.0 && number(phase, "triangles") > 10.0, "{phase}");
        let (scale, least) =
            (number(phase, "resolution_scale"), number(phase, "resolution_scale_min"));
        assert!(0.25 <= least && least <= scale && scale <= 1.0, "{phase}");
    }
    for (list, key, expected) in [("channels", "channels", [1, 2]), ("samples", "samples", [1, 4])]
    {
        let entries = scene[list].as_array().expect("a list");
        assert_eq!(entries.iter().map(|e| e[key].clone()).collect::<Vec<_>>(), expected);
        for entry in entries {
            assert!(number(entry, "frame_ms") > 0.0 && number(entry, "draw_ms") > 0.0, "{entry}");
        }
    }
    let kinds = scene["shadows"].as_array().expect("a list").iter().map(|of| {
        assert!(number(of, "frame_ms") > 0.0, "{of}");
        &of["shadows"]
    });
    assert!(kinds.eq(["soft", "off", "hard", "contact-hardening"]), "{}", scene["shadows"]);
    check_page(&page_of(&place));
}

fn check_page(page: &str) {
    let document = roxmltree::Document::parse(page).unwrap_or_else(|error| panic!("{error}"));
    let count = |name: &str| document.descendants().filter(|n| n.has_tag_name(name)).count();
    assert_eq!((count("svg"), count("section"), count("script")), (4, 1, 0));
    // Times, triangles, silhouettes, stated errors at three bounds; frames and drawing on one and
    // two channels.
    assert_eq!(count("circle"), 4 * 3 + 2 * 2);
    for outside in ["http://", "https://", "src=", "@import"] {
        assert!(!page.contains(outside), "the page is one file: {outside}");
    }
}

#[test]
fn a_scene_that_cannot_be_opened_is_named_and_the_others_are_reported() {
    let place = TestDir::new();
    place.write("one.glb", Gltf::triangle().glb());
    place.write("<broken>.glb", b"not a scene");
    let finished = place.run(arguments("3", &["no-such.glb", "one.glb", "<broken>.glb"]));
    finished.failed(&["2 of 3 scenes", "no-such.glb", "<broken>.glb"]);
    let report = json_of(&place);
    let errors: Vec<bool> =
        report.as_array().expect("a list").iter().map(|scene| scene["error"].is_string()).collect();
    assert_eq!(errors, [true, false, true]);
    assert!(report[0]["bounds"].as_array().is_some_and(Vec::is_empty), "{report}");
    assert_eq!(report[1]["bounds"][0]["triangles"], 1);
    let page = page_of(&place);
    let document = roxmltree::Document::parse(&page).unwrap_or_else(|error| panic!("{error}"));
    let failures = document.descendants().filter(|n| n.attribute("class") == Some("failure"));
    assert_eq!(failures.count(), 2);
}

/// A kit that is asked to time a scene, and knows a renderer that is fast and one that fails.
const KIT: &str = r#"#!/bin/sh
set -eu
test -x "$POLYPTYCH" && test -f "$1" && test "$2 $3 $4 $5 $6 $7 $8" = \
    "--frames 3 --rounds 1 --size 160x96 -o"
echo '{"name": "three", "median_ms": 1.5, "round": 1}' >"$9/runs.jsonl"
echo '{"name": "vtk", "error": "no <display>", "round": 1}' >>"$9/runs.jsonl"
"#;

/// A triangle below a ceiling, which is a background: bounds leave it out.
fn below_ceiling() -> Gltf {
    Gltf::triangle().with(|file| {
        let corners = [-40.0, 20.0, -40.0, 40.0, 20.0, -40.0, 0.0, 20.0, 40.0];
        let positions = file.floats("VEC3", &corners);
        let ceiling = json!({ "primitives": [{ "attributes": { "POSITION": positions } }] });
        file.json["meshes"].as_array_mut().expect("a list").push(ceiling);
        file.json["nodes"] = json!([{ "mesh": 0 }, { "mesh": 1 }]);
        file.json["scenes"] = json!([{ "nodes": [0, 1] }]);
    })
}

#[test]
fn other_renderers_are_timed_by_the_kit_that_the_user_names() {
    let place = TestDir::new();
    place.write("one.glb", below_ceiling().glb());
    let kit = place.write("kit/time.sh", KIT);
    fs::set_permissions(&kit, Permissions::from_mode(0o700)).expect("a program");
    place.run(arguments("3", &["one.glb", "--peers", "kit"])).succeeded();
    let scene = &json_of(&place)[0];
    // Above the scene, a camera that looks up would see the ceiling.
    assert_eq!(number(&scene["empty_frame"], "triangles"), 0.0, "{scene}");
    let peers = &scene["peers"];
    assert_eq!((&peers[0]["name"], &peers[0]["frame_ms"]), (&"three".into(), &1.5.into()));
    assert_eq!((&peers[1]["name"], &peers[1]["frame_ms"]), (&"vtk".into(), &Value::Null));
    let page = page_of(&place);
    assert!(page.contains("no &lt;display&gt;"), "{page}");
    roxmltree::Document::parse(&page).unwrap_or_else(|error| panic!("{error}"));

    place.write("kit/time.sh", "#!/bin/sh\necho broken; exit 3\n");
    fs::set_permissions(&kit, Permissions::from_mode(0o700)).expect("a program");
    let finished = place.run(arguments("3", &["one.glb", "--peers", "kit"]));
    finished.failed(&["other renderers", "messages.log"]);
    assert!(json_of(&place)[0]["bounds"][0]["frame_ms"].is_number());
    let none = place.run(arguments("3", &["one.glb", "--peers", "no-kit"]));
    assert!(!none.output.contains("step 1"), "{}", none.output);
    none.failed(&["--peers", "no-kit"]);
}

#[test]
fn a_folder_or_size_that_cannot_be_is_refused_before_any_work() {
    let place = TestDir::new();
    place.write("report", b"a file");
    place.run(arguments("3", &["no-such.glb"])).failed(&["report"]);
    for (wrong, reasons) in [
        (["--size", "161x96"], ["161x96", "4 columns"]),
        (["--size", "8000x96"], ["8000x96", "--supersampling"]),
        (["--channels", "3"], ["3", "power of two"]),
        (["--error-bounds", "nan"], ["NaN", "0 to 64 pixels"]),
        (["--error-bounds", "40"], ["40", "at most 32 pixels"]),
        (["--error-bounds", "0,65"], ["65", "0 to 64 pixels"]),
    ] {
        let arguments = ["bench", "--out", "other"].iter().chain(&wrong);
        let finished = place.run(arguments);
        // 2 is the code of wrong arguments.
        assert!([1, 2].contains(&finished.code()), "{}", finished.output);
        let is_said = reasons.iter().all(|reason| finished.output.contains(reason));
        assert!(is_said && !finished.output.contains("step 1"), "{reasons:?}: {}", finished.output);
        assert!(!place.path("other").exists(), "{wrong:?}");
    }
}

#[test]
fn an_interrupted_report_ends_its_processes() {
    let place = TestDir::new();
    let town = town().display().to_string();
    let mut process = place.start("bench", arguments("100000", &[&town]));
    process.await_line(&["all bounds"]);
    wait::until("a server", || {
        let all = signals::processes_of(place.folder());
        (all.len() > 1).then_some(())
    });
    process.signal(Signal::INT);
    let finished = process.finish(wait::SOON);
    assert_eq!(finished.code(), 130, "{}", finished.output);
    assert!(finished.output.contains("interrupted"), "{}", finished.output);
    let left = wait::look_for(wait::SOON, || {
        signals::processes_of(place.folder()).is_empty().then_some(())
    });
    assert!(left.is_some(), "processes are left");
    assert!(!place.path("report/report.json").exists());
}
