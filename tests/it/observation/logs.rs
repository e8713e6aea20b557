//! `--log json`: every line an object that says who wrote it and what it is about.

use std::collections::BTreeSet;

use polyptych_client::ChannelState;
use serde_json::Value;

use crate::harness::local_wall::{ANY_PORT, LocalWall, await_states, small};
use crate::harness::place::TestDir;
use crate::harness::scenes::town;
use crate::harness::stub_server::StubServer;

/// All lines, each of which must be an object with what every line has.
fn objects(text: &[u8]) -> Vec<Value> {
    let text = std::str::from_utf8(text).expect("UTF-8");
    let object = |line: &str| -> Value {
        let object: Value =
            serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line}"));
        for key in ["process", "level", "target"] {
            assert!(object[key].is_string(), "{key} is not in {line}");
        }
        let spans = object["spans"].as_array().into_iter().flatten();
        spans.chain([&object["fields"]]).for_each(|fields| check_types(fields, line));
        assert!(object["pid"].is_u64() && object["fields"]["message"].is_string(), "{line}");
        object
    };
    text.lines().map(object).collect()
}

/// Numbers are numbers of JSON, and true and false are its own too.
fn check_types(fields: &Value, line: &str) {
    for (key, value) in fields.as_object().into_iter().flatten() {
        // Sixteen hexadecimal digits, which may by chance all be decimal ones.
        let Some(text) = value.as_str().filter(|_| key != "epoch") else { continue };
        let is_value = text.parse::<f64>().is_ok() || text.parse::<bool>().is_ok();
        assert!(!is_value, "{key} is a text: {line}");
    }
}

/// Returns the value of this key in the spans around a line.
fn of_spans<'a>(line: &'a Value, key: &str) -> Option<&'a Value> {
    line["spans"].as_array()?.iter().find_map(|span| span.get(key))
}

#[test]
fn every_line_of_a_simulated_wall_says_who_wrote_it_and_about_what() {
    let place = TestDir::new();
    let wall = polyptych_wall_file::to_toml(&small(2, 1));
    let wall = place.write("wall.toml", wall).display().to_string();
    let scene = town().display().to_string();
    // All that this program says, and of others what matters.
    let ours = ["", "_client", "_core", "_manager", "_render", "_renderer"];
    let log = ours.map(|name| format!("polyptych{name}=debug")).join(",");
    let log = format!("json,info,{log}");
    let arguments = ["simulate", &wall, &scene, "--frames", "3", "--log", &log];
    let output = place.command(arguments).output().expect("it ran");
    let said = String::from_utf8(output.stdout).expect("UTF-8");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(said.contains("wall small: 2 channels") && !said.contains('{'), "{said}");
    let lines = objects(&output.stderr);
    let with = |process: &str, message: &str| -> Vec<&Value> {
        let is_one =
            |line: &&Value| line["process"] == process && line["fields"]["message"] == message;
        lines.iter().filter(is_one).collect()
    };
    // The children have the log of their parent.
    let connected = with("server", "connected");
    let pids: BTreeSet<u64> = connected.iter().filter_map(|line| line["pid"].as_u64()).collect();
    assert_eq!(pids.len(), 2, "{connected:?}");
    for (line, name) in connected.iter().zip(["front-1-1", "front-2-1"]) {
        assert_eq!(of_spans(line, "server"), of_spans(line, "channel"), "{line}");
        let is_known = connected.iter().any(|l| of_spans(l, "channel") == Some(&name.into()));
        assert!(is_known, "no line of {name}");
    }
    // The manager's lines carry connection, frame and request.
    let joined = with("simulate", "server joins");
    assert_eq!(joined.len(), 2);
    assert!(joined.iter().all(|line| of_spans(line, "session").is_some_and(Value::is_u64)));
    let live: Vec<&Value> = with("simulate", "channel changes state")
        .into_iter()
        .filter(|line| line["fields"]["state"] == "Live")
        .collect();
    assert_eq!(live.len(), 2, "{lines:?}");
    for line in live {
        assert_eq!(of_spans(line, "frame"), Some(&1.into()), "{line}");
        assert_eq!(of_spans(line, "server"), Some(&line["fields"]["channel"]), "{line}");
    }
    let revisions = with("simulate", "the wall shows a new revision");
    assert_eq!(revisions.len(), 1);
    assert!(revisions[0]["fields"]["revision"].is_u64(), "{revisions:?}");
    assert_eq!(of_spans(revisions[0], "client"), Some(&"simulate".into()));
    assert!(of_spans(revisions[0], "request").is_some_and(Value::is_u64), "{revisions:?}");
}

#[test]
fn a_command_that_fails_says_so_in_the_same_form() {
    let place = TestDir::new();
    let output = place.command(["status", "--manager", "127.0.0.1:1", "--log", "json"]).output();
    let output = output.expect("it ran");
    assert_eq!(output.status.code(), Some(1));
    let lines = objects(&output.stderr);
    let [line] = &lines[..] else { panic!("{lines:?}") };
    let message = line["fields"]["message"].as_str().expect("text");
    assert!(message.starts_with("error: ") && message.contains("no manager at"), "{message}");
    let output = place.command(["status", "--log", "json,a=b=c"]).output().expect("it ran");
    assert_eq!(output.status.code(), Some(2), "a filter that is none");
}

#[test]
fn nothing_of_a_server_reaches_a_terminal_raw() {
    let mut local = LocalWall::manager(TestDir::new(), &small(1, 1), &[], ANY_PORT);
    let _stub = StubServer::start(&local, "front");
    let status = await_states(&local.client(), &[ChannelState::Ready]);
    let escaped = "stub\\u{1b}[2J\\r\\n ERROR forged\\u{9b}31m\\u{202e}";
    let adapter = status.channels[0].adapter.as_deref().expect("an adapter");
    assert!(adapter.contains(escaped), "{adapter:?}");
    let line = local.manager.await_line(&["server joins", "forged"]);
    let said = local.run(&["status"]).succeeded();
    let is_raw = |c: char| (c.is_control() && c != '\n') || c == '\u{202e}';
    for text in [&line, &said, &local.manager.output()] {
        assert!(!text.contains(is_raw), "{text:?}");
    }
}
