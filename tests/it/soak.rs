//! A wall that is hurt all the time, for a long time: it neither grows nor leaks.
//!
//! `POLYPTYCH_SOAK=1440000 cargo test --release --test it soak -- --nocapture` goes on for so many
//! frames and prints what it saw.

use std::time::Duration;

use serde_json::Value;

use crate::harness::local_wall::tiled;
use crate::harness::place::TestDir;
use crate::harness::scenes::Gltf;
use crate::harness::simulation::Simulation;
use crate::harness::{signals, wait};

/// Frames of an ordinary run.
const FRAMES: u64 = 3_000;

/// Frames from one fault to the next: a kill, then a stop.
const FRAMES_PER_FAULT: u64 = 500;

/// Memory at the end over memory before, at most. A short run is a young process, whose
/// allocator still finds its size.
const GROWTH_MAX: f64 = 1.02;
const GROWTH_OF_YOUTH_MAX: f64 = 1.15;

/// Frames from which on a run is a long one.
const LONG: u64 = 50_000;

/// Maximum bytes that all processes write to the terminal: the output of 2 h is a file that a
/// person can read.
const LOG_BYTES_MAX: usize = 10_000_000;

/// Between two looks.
const PERIOD: Duration = Duration::from_millis(250);

/// The process that simulates, at one time.
#[derive(Clone, Copy, Debug)]
struct Look {
    frame: u64,
    memory_bytes: u64,
    descriptors: usize,
    /// Memory of the server that has the most.
    server_bytes: u64,
}

#[test]
fn kills_and_stops_leave_nothing_behind() {
    let wish = std::env::var("POLYPTYCH_SOAK").ok().and_then(|frames| frames.parse().ok());
    let frames: u64 = wish.unwrap_or(FRAMES);
    let place = TestDir::new();
    let scene = place.write("triangle.glb", Gltf::triangle().glb());
    let twice = 2 * FRAMES_PER_FAULT;
    let faults = [
        format!("every {twice} kill any"),
        format!("every {twice} from {FRAMES_PER_FAULT} stop 1s any"),
    ];
    let count = frames.to_string();
    let mut arguments = vec!["--rate", "200", "--frames", &count];
    arguments.extend(faults.iter().flat_map(|fault| ["--fault", fault]));
    let wall = tiled([2, 2], [64, 36]);
    let mut simulation = Simulation::start(place, &wall, &scene, &arguments);
    simulation.process.await_line(&["scene triangle"]);
    let looks = watch(&mut simulation);
    let finished = simulation.process.finish(wait::SOON);
    // The last server that was killed may not be in the last picture yet: 3.
    assert!([0, 3].contains(&finished.code()), "{}", finished.output);
    let said = finished.output;
    println!("log: {:.3} MB", said.len() as f64 * 1e-6);
    assert!(said.len() < LOG_BYTES_MAX, "a log of {} bytes", said.len());
    simulation.await_no_orphans("after the last frame");
    let text = std::fs::read(simulation.place.path("out/report.json")).expect("a report");
    let report: Value = serde_json::from_slice(&text).expect("JSON");
    check_report(&report, frames, &said);
    check_growth(&looks, frames);
}

/// Looks until the simulation ends.
fn watch(simulation: &mut Simulation) -> Vec<Look> {
    let client = simulation.client();
    let pid = simulation.process.pid();
    let mut looks = Vec::new();
    while !simulation.process.has_ended() {
        let servers = simulation.children("server");
        // It may end at any moment.
        if let (Ok(status), Some(memory_bytes)) = (client.status(), signals::memory_bytes_of(pid)) {
            let fds = std::fs::read_dir(format!("/proc/{pid}/fd"));
            let server_bytes =
                servers.iter().filter_map(|&pid| signals::memory_bytes_of(pid)).max();
            looks.push(Look {
                frame: status.frame.0,
                memory_bytes,
                descriptors: fds.map_or(0, Iterator::count),
                server_bytes: server_bytes.unwrap_or(0),
            });
        }
        let _ = wait::look_for(PERIOD, || None::<()>);
    }
    looks
}

fn check_report(report: &Value, frames: u64, said: &str) {
    assert!(report["frames"].as_u64() >= Some(frames), "{report}");
    let faults = report["faults"].as_array().expect("a list");
    assert!(faults.len() as u64 >= frames / FRAMES_PER_FAULT - 1, "{} faults", faults.len());
    let happened = faults.iter().filter(|fault| fault["skipped"].is_null());
    let healed: Vec<f64> = happened.filter_map(|f| f["live_again_ms"].as_f64()).collect();
    let slowest = healed.iter().copied().fold(0.0, f64::max);
    println!("{} faults, {} live again within {slowest:.0} ms", faults.len(), healed.len());
    // The last two may be younger than the time that a restart takes.
    assert!(healed.len() + 2 >= faults.len() * 9 / 10, "{said}");
}

fn check_growth(looks: &[Look], frames: u64) {
    let within = |from: f64, to: f64| -> Vec<Look> {
        let share = |look: &Look| look.frame as f64 / frames as f64;
        looks.iter().copied().filter(|look| (from..to).contains(&share(look))).collect()
    };
    let (before, after) = (within(0.5, 0.75), within(0.75, 1.1));
    assert!(!before.is_empty() && !after.is_empty(), "{} looks", looks.len());
    let mean = |looks: &[Look], of: fn(&Look) -> u64| {
        looks.iter().map(of).sum::<u64>() as f64 / looks.len() as f64
    };
    let most = |looks: &[Look]| looks.iter().map(|look| look.descriptors).max();
    let growth_max = if frames < LONG { GROWTH_OF_YOUTH_MAX } else { GROWTH_MAX };
    type Measure = fn(&Look) -> u64;
    let measures: [(&str, Measure); 2] =
        [("manager", |look| look.memory_bytes), ("largest server", |look| look.server_bytes)];
    for (what, of) in measures {
        let [third, last] = [mean(&before, of), mean(&after, of)];
        println!("{what}: {:.1} MB, then {:.1} MB", third * 1e-6, last * 1e-6);
        assert!(last <= third * growth_max, "{what} grows: {third} bytes, then {last}");
    }
    println!("descriptors: {:?}, then {:?}", most(&before), most(&after));
    // A server that comes at the moment of a look has two connections more.
    assert!(most(&after) <= most(&before).map(|most| most + 4), "descriptors leak");
}
