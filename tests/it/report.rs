//! What a simulated wall writes: pictures and a report.

use image::imageops;
use serde_json::Value;

use crate::harness::local_wall::small;
use crate::harness::pictures::{IDENTICAL, check, color_count, read};
use crate::harness::place::Place;
use crate::harness::scenes::town;
use crate::harness::simulation::Simulation;
use crate::harness::wait;

const FRAMES: u64 = 20;

fn simulated() -> (Simulation, Value) {
    let arguments = ["--orbit", "--frames", "20"];
    let mut simulation = Simulation::start(Place::new(), &small(2, 2), town(), &arguments);
    let said = simulation.process.finish(wait::LIMIT).succeeded();
    assert!(said.contains("wall small: 4 channels on 1 screen"), "{said}");
    assert!(said.contains("pictures and report: "), "{said}");
    let text = std::fs::read(simulation.place.path("out/report.json")).expect("a report");
    let report = serde_json::from_slice(&text).expect("JSON");
    (simulation, report)
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
    files.retain(|file| file.file_name() != "wall.png" && file.file_name() != "report.json");
    assert_eq!(files.len(), names.len(), "{files:?}");
}
