//! Pictures reach a display: each channel in a window of its own, all together the wall.

use image::imageops;
use polyptych_client::ChannelState;
use rustix::process::Signal;
use serde_json::Value;

use crate::harness::display::Display;
use crate::harness::local_wall::{await_states, screen_of, small};
use crate::harness::pictures::{Difference, IDENTICAL, check, color_count};
use crate::harness::place::TestDir;
use crate::harness::scenes::town;
use crate::harness::simulation::Simulation;
use crate::harness::wait;

#[test]
fn windows_show_the_wall_as_it_hangs() {
    let display = Display::start();
    let wall = small(2, 2);
    let environment = [("DISPLAY", display.name.as_str())];
    let start = |arguments: &[&str]| {
        Simulation::start_with(TestDir::new(), &wall, town(), arguments, &environment)
    };
    // The camera stands still, so that what is seen is what a capture shows.
    let mut simulation = start(&["--windows", "--rate", "20", "--seconds", "600"]);
    simulation.process.await_line(&["scene town"]);
    let client = simulation.client();
    await_states(&client, &[ChannelState::Live]);
    let names = wall.channels.iter().map(|channel| format!("polyptych {}", channel.name));
    let mut names: Vec<String> = names.collect();
    names.sort();
    let titles = display.titles();
    assert!(names.iter().all(|name| titles.contains(name)), "{titles:?}");
    let expected = screen_of(&client.capture().expect("a picture"));
    assert!(color_count(&expected) > 100);
    let seen = || {
        let all = display.screenshot();
        imageops::crop_imm(&all, 0, 0, expected.width(), expected.height()).to_image()
    };
    // Frames come and go; what is seen settles, and must then be the wall.
    let settled = || Difference::of(&seen(), &expected).holds(&IDENTICAL).then_some(());
    if wait::look_for(wait::SOON, settled).is_none() {
        check("windows", &seen(), &expected, &IDENTICAL);
    }
    simulation.interrupt(Signal::INT, "with windows");
    assert_eq!(display.titles().iter().filter(|title| names.contains(title)).count(), 0);

    let mut simulation = start(&["--windows", "--orbit", "--frames", "10"]);
    simulation.process.finish(wait::LIMIT).succeeded();
    let text = std::fs::read(simulation.place.path("out/report.json")).expect("a report");
    let report: Value = serde_json::from_slice(&text).expect("JSON");
    for channel in report["channels"].as_array().expect("a list") {
        assert_eq!(channel["state"], "live", "{channel}");
        assert!(channel["frames"].as_u64() >= Some(9), "{channel}");
    }
}

#[test]
fn without_a_display_a_window_is_refused_with_what_would_be_right() {
    let place = TestDir::new();
    let arguments = ["server", "--once", "--window", "--channel", "a", "--manager", "127.0.0.1:9"];
    place.run(arguments).failed(&["no window can be opened", "--headless"]);
}
