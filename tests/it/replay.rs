//! Recordings of a manager's input, and replays that decide in the same way.

use std::fs;

use polyptych_client::ChannelState;
use rustix::process::Signal;
use serde_json::Value;

use crate::harness::local_wall::{await_states, small};
use crate::harness::place::TestDir;
use crate::harness::scenes::town;
use crate::harness::simulation::Simulation;
use crate::harness::{signals, wait};

#[test]
fn an_incident_is_recorded_replayed_and_kept() {
    let place = TestDir::new();
    let record = place.path("wall.rec");
    let text = record.to_str().expect("text").to_owned();
    let arguments = ["--orbit", "--rate", "30", "--seconds", "600", "--record", &text];
    let mut simulation = Simulation::start(place, &small(2, 1), town(), &arguments);
    simulation.process.await_line(&["scene town"]);
    let client = simulation.client();
    await_states(&client, &[ChannelState::Live]);
    let victim = client.status().expect("status").channels.swap_remove(0);
    signals::send(victim.pid.expect("a process"), Signal::KILL);
    let feedbacks = client.feedback().expect("a stream");
    wait::within("its loss and its return", move || {
        let states = feedbacks.map(|feedback| feedback.channels[0].state);
        let mut states = states.skip_while(|state| *state != ChannelState::Lost);
        states.find(|state| *state == ChannelState::Live)
    });
    let place = &simulation.place;
    // It can be read while it is written; what came last is in it a moment later.
    let back = format!("{} live", victim.name);
    let has_all =
        |told: &str| told.split(" lost: ").nth(1).is_some_and(|rest| rest.contains(&back));
    wait::until("all of it is recorded", || {
        has_all(&place.run(["replay", &text]).succeeded()).then_some(())
    });
    // As a power failure would end it: what is on the disk must do.
    simulation.process.kill();

    let told = place.run(["replay", &text]).succeeded();
    for part in ["from its start", "it breaks off", "joins", "all the same"] {
        assert!(told.contains(part), "{part:?}: {told}");
    }
    // The clock of the wall, and plain words.
    let joined = told.lines().find(|line| line.contains(" joins")).expect("a server joins");
    let shape: String =
        joined.chars().take(12).map(|c| if c.is_ascii_digit() { '0' } else { c }).collect();
    assert_eq!(shape, "00:00:00.000", "{joined}");
    assert!(told.contains("render a frame ") && told.contains(" asks: open the scene /"), "{told}");
    for mark in ["RenderFrame", "OpenScene", " { ", "Some(", "None"] {
        assert!(!told.contains(mark), "{mark:?}: {told}");
    }
    check_lanes(place, &text, &victim.name);
    let json = place.run(["replay", &text, "--json"]).json();
    assert_eq!((&json["differences"], &json["violation"]), (&0.into(), &Value::Null));
    let [part] = &json["parts"].as_array().expect("parts")[..] else { panic!("{json}") };
    let started = part["started_unix_us"].as_u64().expect("microseconds since 1970");
    let now = std::time::SystemTime::UNIX_EPOCH.elapsed().expect("after 1970").as_micros() as u64;
    assert!((now - 600_000_000..now).contains(&started), "{started} and {now}");
    assert!(part["frames"].as_u64() > Some(10) && json["decisions"].as_u64() > Some(50));
    let events = part["events"].as_array().expect("events").iter();
    let texts: Vec<&str> = events.filter_map(|event| event["text"].as_str()).collect();
    let [lost, back] = [format!("{} lost: ", victim.name), back]
        .map(|words| texts.iter().rposition(|text| text.starts_with(&words)));
    assert!(lost.is_some() && lost < back, "{texts:#?}");

    let kept = place.path("kept.incident");
    let arguments = ["replay", &text, "--about", "a killed server", "--keep"];
    let said = place.run(arguments.iter().copied().chain(kept.to_str())).succeeded();
    assert!(said.contains("the invariants hold"), "{said}");
    place.run(["replay", kept.to_str().expect("text")]).succeeded();
    // The same with a frame that is reported by nobody any more holds, too; with a line of
    // another wall it is not read.
    let lines = fs::read_to_string(&kept).expect("text");
    assert!(lines.contains("a killed server"));
    fs::write(&kept, lines.replace("\"Drawn\"", "\"Dreamt\"")).expect("written");
    place.run(["replay", kept.to_str().expect("text")]).failed(&["kept.incident:", "Dreamt"]);
    fs::write(&record, b"something else").expect("written");
    place.run(["replay", &text]).failed(&["wall.rec: not a recording"]);
    let wall = place.path("wall.toml");
    let wall = wall.to_str().expect("text");
    place.run(["manager", wall, "--record", &text]).failed(&["not a recording"]);
}

/// Checks that a recording is drawn as lanes, in which the channel that was lost was lost.
fn check_lanes(place: &TestDir, record: &str, lost: &str) {
    place.run(["replay", record, "--svg", "lanes.svg", "--html", "lanes.html"]).succeeded();
    let svg = fs::read_to_string(place.path("lanes.svg")).expect("lanes");
    let document = roxmltree::Document::parse(&svg).expect("XML");
    let of_class = |class: &str| {
        document.descendants().filter(|node| node.attribute("class") == Some(class)).count()
    };
    assert!(of_class("l-lost") > 1, "and the legend: {svg}");
    // The manager's and the legend's; those of both channels, of the client and of the legend.
    assert_eq!(of_class("l-frames"), 2);
    assert!(of_class("l-busy") >= 4 && of_class("l-shown") >= 4, "{svg}");
    assert!(svg.contains(&format!(">{lost}</text>")) && svg.contains("lost: "), "{svg}");
    let page = fs::read_to_string(place.path("lanes.html")).expect("a page");
    let page = roxmltree::Document::parse(page.split_once('\n').expect("lines").1).expect("XML");
    assert!(page.descendants().any(|node| node.text() == Some("Events")));
    let late = ["replay", record, "--svg", "none.svg", "--part", "99"];
    place.run(late).failed(&["there is no such part", "--part"]);
    let late = ["replay", record, "--html", "none.html", "--from", "1e6"];
    place.run(late).failed(&["there is nothing in that time"]);
    assert!(!place.path("none.html").exists(), "no empty page");
    assert_eq!(place.run(["replay", record, "--from", "1"]).code(), 2, "of what?");
    let both = ["replay", record, "--json", "--keep", "./both.incident"];
    assert_eq!(place.run(both).code(), 2, "what is kept is not told as JSON");
}
