//! The behaviour of a wall when things fail, each row of the table with real processes and a time.
//!
//! The times are the requirement's own. A machine that also builds something holds up processes
//! that have nothing to do with a fault. So a time that is exceeded is tried again, and only one
//! that is always exceeded is the product's fault.

mod files;
mod gpu;
mod manager;
mod network;
mod servers;

use polyptych_client::Wall;
use serde_json::Value;

use crate::harness::local_wall::tiled;
use crate::harness::place::TestDir;
use crate::harness::scenes::Gltf;
use crate::harness::simulation::Simulation;
use crate::harness::wait;

/// Maximum number of times that a time is tried.
const TRIES: usize = 3;

/// Frames per second of these walls.
const RATE: f64 = 30.0;

/// Milliseconds by which a busy machine may delay a frame, beyond the delays before anything
/// failed.
const MACHINE_MS: f64 = 40.0;

/// The share of its pace that a wall keeps on a busy machine.
const PACE_KEPT: f64 = 0.95;

/// A fault that does nothing: for a second the wall is watched as it is without any.
const CONTROL: &str = "at 2 slow 1ms for 1s front-1-1";

/// A wall of a few pixels with the deadline and the heartbeat of one whose file names none.
fn brisk(columns: u32, rows: u32) -> Wall {
    tiled([columns, rows], [240, 136])
}

/// Tries until what has a time is in time; all that was wrong is told otherwise.
#[track_caller]
fn in_time(mut attempt: impl FnMut() -> Result<(), String>) {
    let mut wrong = Vec::new();
    for _ in 0..TRIES {
        match attempt() {
            Ok(()) => return,
            Err(reason) => wrong.push(reason),
        }
    }
    panic!("not in time:\n{}", wrong.join("\n"));
}

/// Checks a condition; the error gives the value that was seen instead.
fn hold(holds: bool, what: &str, seen: &impl std::fmt::Debug) -> Result<(), String> {
    if holds { Ok(()) } else { Err(format!("{what}: {seen:?}")) }
}

/// The longest gap and the most misses of [`CONTROL`] that excuse others.
const CONTROL_MS_MAX: f64 = 120.0;
const CONTROL_LATE_MAX: f64 = 2.0;

/// A run of four channels at [`RATE`] in which things went wrong, a second after it began.
struct Run {
    report: Value,
    /// The output of the command, with that of the manager and the servers.
    log: String,
}

impl Run {
    fn new(faults: &[&str], frames: u32) -> Self {
        let frames = frames.to_string();
        let mut arguments = vec!["--rate", "30", "--frames", &frames, "--fault", CONTROL];
        arguments.extend(faults.iter().flat_map(|fault| ["--fault", fault]));
        let logged = [("POLYPTYCH_LOG", "info")];
        let place = TestDir::new();
        let scene = place.write("triangle.glb", Gltf::triangle().glb());
        let mut simulation =
            Simulation::start_with(place, &brisk(2, 2), &scene, &arguments, &logged);
        let log = simulation.process.finish(wait::LIMIT).succeeded();
        let text = std::fs::read(simulation.place.path("out/report.json")).expect("a report");
        Self { report: serde_json::from_slice(&text).expect("JSON"), log }
    }

    /// Returns the record of a fault.
    fn fault(&self, index: usize) -> Fault<'_> {
        let [control, record] = [0, index + 1].map(|index| &self.report["faults"][index]);
        Fault { record, control }
    }

    /// Returns the statistics of a channel.
    fn channel(&self, name: &str) -> &Value {
        let channels = self.report["channels"].as_array().expect("a list");
        channels.iter().find(|channel| channel["name"] == name).expect("a channel of the wall")
    }

    /// Returns whether a line of the output has all these parts.
    fn said(&self, parts: &[&str]) -> bool {
        self.log.lines().any(|line| parts.iter().all(|part| line.contains(part)))
    }

    /// Checks that the wall kept its pace.
    fn kept_its_pace(&self) -> Result<(), String> {
        let seconds = self.report["seconds"].as_f64().expect("a number");
        let frames = self.report["frames"].as_f64().expect("a number");
        let rate = (frames - 1.0) / seconds;
        hold(rate >= RATE * PACE_KEPT, "frames per second", &rate)
    }
}

/// A record of `report.json`.
struct Fault<'a> {
    record: &'a Value,
    /// The record of [`CONTROL`].
    control: &'a Value,
}

impl Fault<'_> {
    /// A time since the fault.
    fn ms(&self, key: &str) -> Result<f64, String> {
        self.record[key].as_f64().ok_or_else(|| format!("{key} is no time: {}", self.record))
    }

    /// From the end of the fault itself to this.
    fn ms_after(&self, key: &str) -> Result<f64, String> {
        Ok(self.ms(key)? - self.ms("over_ms")?)
    }

    /// Checks that the others missed one deadline at most, and lost no more time by it.
    fn spared_the_others(&self) -> Result<(), String> {
        let of_control = |key: &str| self.control[key].as_f64().expect("a number");
        // A control that was late itself was watched into the fault; it excuses no more than this.
        let usual_ms = of_control("others_longest_gap_ms").clamp(1000.0 / RATE, CONTROL_MS_MAX);
        let bound_ms = self.ms("deadline_ms")? + usual_ms + MACHINE_MS;
        let gap_ms = self.ms("others_longest_gap_ms")?;
        hold(gap_ms <= bound_ms, &format!("a gap of others beyond {bound_ms} ms"), &gap_ms)?;
        let late = self.ms("others_late")?;
        hold(
            late <= 1.0 + of_control("others_late").min(CONTROL_LATE_MAX),
            "deadlines missed by others",
            &late,
        )
    }

    /// Checks that the channel was not live for a while, and then was again.
    fn was_away(&self) -> Result<(), String> {
        let seen = self.record["states"].as_array().expect("a list");
        hold(seen.iter().any(|state| state != "live"), "always live", &seen)?;
        self.ms("live_again_ms").map(drop)
    }

    /// Checks that the channel went through these states, in this order, and was live again.
    fn went_through(&self, states: &[&str]) -> Result<(), String> {
        let seen: Vec<&str> = self.record["states"]
            .as_array()
            .expect("a list")
            .iter()
            .filter_map(Value::as_str)
            .collect();
        let mut left = seen.iter();
        let is_in_order = states.iter().all(|state| left.any(|seen| seen == state));
        hold(is_in_order, &format!("not {states:?} but"), &seen)?;
        self.ms("live_again_ms").map(drop)
    }
}
