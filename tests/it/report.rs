//! The output of a simulated wall: pictures and a report.

use image::imageops;
use polyptych_client::Wall;
use rustix::process::Signal;
use serde_json::{Value, json};

use crate::harness::local_wall::small;
use crate::harness::pictures::{IDENTICAL, check, color_count, read};
use crate::harness::place::TestDir;
use crate::harness::scenes::town;
use crate::harness::simulation::Simulation;
use crate::harness::{signals, wait};

const FRAMES: u64 = 20;

fn simulated() -> (Simulation, Value) {
    let arguments = ["--orbit", "--frames", "20"];
    let mut simulation = Simulation::start(TestDir::new(), &small(2, 2), town(), &arguments);
    let said = simulation.process.finish(wait::LIMIT).succeeded();
    assert!(said.contains("wall small: 4 channels on 1 screen"), "{said}");
    assert!(said.contains("pictures and report: "), "{said}");
    assert!(said.contains("20 frames in") && said.contains("all channels: 20 of 20"), "{said}");
    let text = std::fs::read(simulation.place.path("out/report.json")).expect("a report");
    let report = serde_json::from_slice(&text).expect("JSON");
    (simulation, report)
}

/// Checks that the page is one well-formed file with pictures and plots of all channels.
fn check_page(simulation: &Simulation, names: &[&str]) {
    let page = std::fs::read_to_string(simulation.place.path("out/report.html")).expect("a page");
    let xml = page.split_once('\n').expect("lines").1;
    let document = roxmltree::Document::parse(xml).expect("XML");
    let plots = document.descendants().filter_map(|node| node.attribute("aria-label"));
    let plots: Vec<&str> = plots.collect();
    for due in ["the wall's picture", "Drawing time of each channel", "wall small"] {
        assert!(plots.contains(&due), "{due} is not in {plots:?}");
    }
    let texts: Vec<&str> = document.descendants().filter_map(|node| node.text()).collect();
    assert!(names.iter().all(|name| texts.contains(name)), "{texts:?}");
    let links = document.descendants().flat_map(|node| node.attributes());
    let mut links = links.filter(|attribute| ["href", "src"].contains(&attribute.name()));
    assert!(links.all(|link| link.value().starts_with(['#', 'd'])), "no other files");
}

/// The numbers of a spread, which must be in order.
fn spread(value: &Value, key: &str) -> [f64; 3] {
    let numbers = ["p50", "p95", "max"].map(|quantile| {
        let number = value[key][quantile].as_f64();
        number.unwrap_or_else(|| panic!("{key}.{quantile} is no number: {value}"))
    });
    assert!(numbers.is_sorted() && numbers[0] >= 0.0, "{key}: {numbers:?}");
    numbers
}

#[test]
fn a_report_says_what_was_drawn_and_how_long_it_took() {
    let (simulation, report) = simulated();
    assert_eq!((&report["wall"], &report["scene"]), (&"small".into(), &"town".into()));
    assert_eq!(report["frames"], FRAMES);
    assert_eq!((&report["late"], &report["restarts"]), (&0.into(), &0.into()));
    assert_eq!((&report["complete"], &report["ended"]), (&FRAMES.into(), &"done".into()));
    assert_eq!(report["frame_ms"]["count"], FRAMES);
    let [frame_ms, ..] = spread(&report, "frame_ms");
    let [draw_ms, ..] = spread(&report, "draw_ms");
    let [barrier_us, ..] = spread(&report, "barrier_us");
    spread(&report, "swap_skew_us");
    assert!(report["swap_skew_us"]["p99"].is_number(), "{report}");
    assert!(frame_ms > 0.0 && draw_ms > 0.0 && barrier_us > 0.0, "{report}");
    assert!(draw_ms <= frame_ms, "a frame waits for its drawing: {draw_ms} > {frame_ms}");
    let seconds = report["seconds"].as_f64().expect("a number");
    assert!(seconds > 0.0 && seconds < 60.0, "{seconds}");
    let bytes = report["bytes_per_frame"].as_f64().expect("a number");
    assert!(bytes > 0.0 && bytes / 4.0 < 1024.0, "{bytes} bytes for four channels");
    assert!(report["triangles"].as_u64() > Some(1000), "{report}");
    assert!(report["draw_calls"].as_u64() > Some(4), "{report}");
    assert!(report["adapter"].as_str().is_some_and(|adapter| !adapter.is_empty()));
    let features = report["features"].as_array().expect("a list");
    assert!(features.contains(&"textures".into()), "{features:?}");

    let channels = report["channels"].as_array().expect("a list");
    let names: Vec<&str> = channels.iter().filter_map(|channel| channel["name"].as_str()).collect();
    assert_eq!(names, ["front-1-1", "front-2-1", "front-1-2", "front-2-2"]);
    for channel in channels {
        assert_eq!(channel["state"], "live");
        spread(channel, "frame_ms");
        let gap_ms = channel["longest_gap_ms"].as_f64().expect("a number");
        assert!(gap_ms > 0.0 && gap_ms <= seconds * 1000.0 + 1000.0, "{gap_ms}");
        let clock_error_us = channel["clock_error_us"].as_u64();
        assert!(clock_error_us < Some(1_000_000), "{channel}");
        spread(channel, "swap_skew_us");
        assert!(channel["memory_bytes"].as_u64() > Some(1 << 20), "{channel}");
    }
    assert_eq!(report["missing"], Value::Array(Vec::new()));
    check_pictures(&simulation, &names);
    check_page(&simulation, &names);
}

/// A run without an end.
fn endless(wall: &Wall) -> Simulation {
    let arguments = ["--orbit", "--seconds", "600"];
    let mut simulation = Simulation::start(TestDir::new(), wall, town(), &arguments);
    simulation.process.await_line(&["scene town"]);
    simulation
}

/// Waits until at least one measured frame was drawn.
fn await_frames(simulation: &Simulation) {
    let client = simulation.client();
    wait::until("frames", || (client.status().expect("status").frame.0 > 8).then_some(()));
}

fn read_report(simulation: &Simulation) -> Value {
    let text = std::fs::read(simulation.place.path("out/report.json")).expect("a report");
    serde_json::from_slice(&text).expect("JSON")
}

#[test]
fn an_interrupted_run_writes_what_it_has_drawn() {
    for signal in [Signal::INT, Signal::TERM] {
        let mut simulation = endless(&small(2, 1));
        await_frames(&simulation);
        simulation.interrupt(signal, "while it draws");
        let said = simulation.process.output();
        assert!(said.contains("pictures and report: ") && said.contains("interrupted"), "{said}");
        let report = read_report(&simulation);
        assert_eq!(report["ended"], "interrupted");
        let frames = report["frames"].as_u64().expect("a number");
        assert!(frames > 0 && report["complete"].as_u64() > Some(0), "{report}");
        assert_eq!((&report["missing"], &report["restarts"]), (&json!([]), &0.into()));
        assert!(color_count(&read(&simulation.place.path("out/wall.png"))) > 100);
    }
}

#[test]
fn a_run_that_is_interrupted_before_its_first_frame_says_that_there_is_no_report() {
    let arguments = ["--seconds", "600"];
    let mut simulation = Simulation::start(TestDir::new(), &small(1, 1), town(), &arguments);
    simulation.process.await_line(&["wall small"]);
    wait::until("a server", || (!simulation.children("server").is_empty()).then_some(()));
    simulation.interrupt(Signal::INT, "before the first frame");
    let said = simulation.process.output();
    assert!(said.contains("interrupted before the first frame"), "{said}");
    assert!(!simulation.place.path("out/report.json").exists());
}

#[test]
fn a_second_interrupt_ends_a_run_at_once() {
    let mut simulation = endless(&small(1, 1));
    await_frames(&simulation);
    // The last picture is waited for, which a server that hangs never sends.
    let server = simulation.children("server")[0];
    signals::send(server, Signal::STOP);
    let ended = wait::look_for(wait::SOON, || {
        let has_ended = simulation.process.has_ended();
        if !has_ended {
            simulation.process.signal(Signal::INT);
        }
        has_ended.then_some(())
    });
    assert!(ended.is_some(), "{}", simulation.process.output());
    signals::send(server, Signal::CONT);
    let finished = simulation.process.finish(wait::SOON);
    assert_eq!(finished.code(), 130, "{}", finished.output);
    assert!(finished.output.contains("at once"), "{}", finished.output);
    simulation.await_no_orphans("after two interrupts");
}

#[test]
fn late_frames_are_told_as_they_were() {
    let mut wall = small(2, 1);
    (wall.deadline.min_ms, wall.deadline.max_ms) = (300, 300);
    // Both are slowed behind the first frame; each frame from then on ends at its deadline.
    let slow = ["at 1 slow 5s front-1-1", "at 1 slow 5s front-2-1"];
    let arguments = ["--frames", "4", "--fault", slow[0], "--fault", slow[1]];
    let mut simulation = Simulation::start(TestDir::new(), &wall, town(), &arguments);
    let finished = simulation.process.finish(wait::LIMIT);
    let said = finished.output;
    let report = read_report(&simulation);
    let frame_ms = spread(&report, "frame_ms");
    assert!(frame_ms[0] >= 299.0, "three of four frames took 300 ms: {frame_ms:?}");
    assert_eq!((&report["frames"], &report["frame_ms"]["count"]), (&4.into(), &4.into()));
    assert!(report["complete"].as_u64() <= Some(1) && report["late"].as_u64() >= Some(2));
    let seconds = report["seconds"].as_f64().expect("a number");
    assert!(seconds >= 0.9, "{seconds}");
    let complete = &report["complete"];
    assert!(said.contains(&format!("shown by all channels: {complete} of 4")), "{said}");
}

/// The wall's picture is its channels', as they hang.
fn check_pictures(simulation: &Simulation, names: &[&str]) {
    let out = simulation.place.path("out");
    let wall = read(&out.join("wall.png"));
    assert_eq!(wall.dimensions(), (480, 272));
    assert!(color_count(&wall) > 100);
    for (number, name) in (0..).zip(names) {
        let channel = read(&out.join(format!("channel-{name}.png")));
        let (x, y) = (number % 2 * 240, number / 2 * 136);
        let part = imageops::crop_imm(&wall, x, y, 240, 136).to_image();
        check(&format!("report {name}"), &part, &channel, &IDENTICAL);
    }
    let mut files: Vec<_> = std::fs::read_dir(&out).expect("a folder").flatten().collect();
    let others = ["wall.png", "report.json", "report.html"];
    files.retain(|file| others.iter().all(|other| file.file_name() != *other));
    assert_eq!(files.len(), names.len(), "{files:?}");
}
