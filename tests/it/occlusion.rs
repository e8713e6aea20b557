//! Items that others hide are left out of frames, and no picture tells.

use serde_json::Value;

use crate::harness::local_wall::small;
use crate::harness::pictures::{IDENTICAL, check, read};
use crate::harness::place::TestDir;
use crate::harness::scenes::town;
use crate::harness::simulation::Simulation;
use crate::harness::wait;

/// A walk up a street between houses of the town: where it begins and ends.
const STREET: [&str; 2] = ["0,7.5,-30", "0,10.5,-42"];

/// A run along the street.
fn walk(more: &[&str]) -> (Simulation, Value) {
    let arguments = [&["--frames", "12", "--walk", STREET[0], STREET[1]], more].concat();
    let mut simulation = Simulation::start(TestDir::new(), &small(2, 1), town(), &arguments);
    simulation.process.finish(wait::LIMIT).succeeded();
    let text = std::fs::read(simulation.place.path("out/report.json")).expect("a report");
    (simulation, serde_json::from_slice(&text).expect("JSON"))
}

#[test]
fn a_street_is_drawn_without_what_its_houses_hide() {
    let (with, report) = walk(&[]);
    let (without, all) = walk(&["--no-occlusion"]);
    let occluded = |of: &Value| of["draws_occluded"].as_u64().expect("a number");
    assert!(occluded(&report) > 20, "{report}");
    assert_eq!(occluded(&all), 0, "{all}");
    for channel in report["channels"].as_array().expect("a list") {
        assert!(occluded(channel) > 0, "{channel}");
    }
    let picture = |of: &Simulation| read(&of.place.path("out/wall.png"));
    check("a street", &picture(&with), &picture(&without), &IDENTICAL);
}

#[test]
fn a_walk_needs_two_points() {
    let place = TestDir::new();
    for (arguments, why) in [
        (&["--walk", "0,1,2"][..], "2 values required"),
        (&["--walk", "0,1,2", "a,b,c"], "invalid value 'a,b,c'"),
        (&["--walk", "0,1,2", "3,4,5", "--orbit"], "cannot be used with"),
    ] {
        let refused = place.run([&["simulate", "wall.toml"], arguments].concat());
        assert!(refused.code() == 2 && refused.output.contains(why), "{}", refused.output);
    }
}
