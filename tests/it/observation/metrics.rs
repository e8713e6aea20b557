//! `polyptych manager --metrics`, scraped while the wall runs.

use std::io::{Read, Write};
use std::net::TcpStream;

use polyptych_client::blocking::Client;
use polyptych_client::{ChannelState, Pacing};

use super::exposition::Exposition;
use crate::harness::local_wall::{ANY_PORT, LocalWall, await_states, small};
use crate::harness::place::TestDir;
use crate::harness::scenes::town;
use crate::harness::wait;

/// More connections than the manager serves at once.
const SILENT: usize = 12;

#[test]
fn metrics_agree_with_the_status_of_a_wall_that_runs() {
    let wall = small(2, 1);
    let folder = town().parent().expect("a folder");
    let extra = ["--metrics", ANY_PORT];
    let mut local = LocalWall::manager_with(TestDir::new(), &wall, &[folder], ANY_PORT, &extra);
    let line = local.manager.await_line(&["metrics are offered", "url=http://"]);
    let address = line.split("url=http://").nth(1).and_then(|rest| rest.split('/').next());
    let address = address.expect("an address").to_owned();
    let names: Vec<&str> = wall.channels.iter().map(|channel| channel.name.as_str()).collect();
    let before = scrape(&address);
    assert_eq!(state_of(&before, names[0]), "lost");
    assert_eq!(before.value("polyptych_frames_total"), 0.0);
    local.start_server(&wall.channels[0].server.clone());
    local.start_server(&wall.channels[1].server.clone());
    let client = local.client();
    await_states(&client, &[ChannelState::Ready]);
    client.open_scene("town.glb").expect("opened");
    check_while_it_runs(&client, &address);
    check_numbers(&client, &address, &names);

    let server = wall.channels[1].server.clone();
    local.servers.remove(&server);
    local.await_lost(&client, &server);
    let after = scrape(&address);
    assert_eq!(state_of(&after, names[1]), "lost");
    assert_eq!(after.labelled("channel_lost_total", "channel", names[1]), 1.0);
    assert_eq!(after.labelled("channel_lost_total", "channel", names[0]), 0.0);
    check_strangers(&address);
    client.render_frame().expect("the wall goes on");
}

/// Scrapes are answered at full speed, and what only grows does so.
fn check_while_it_runs(client: &Client, address: &str) {
    client.start_rendering(Pacing::Free).expect("runs");
    let mut last = scrape(address);
    for frames in [10.0, 20.0, 30.0] {
        let next = wait::until("more frames", || {
            let next = scrape(address);
            (next.value("polyptych_frames_total") >= frames).then_some(next)
        });
        for (name, value) in last.growing() {
            assert!(next.growing()[&name] >= value, "{name} shrinks");
        }
        last = next;
    }
    client.pause().expect("pauses");
}

fn check_numbers(client: &Client, address: &str, names: &[&str]) {
    // Servers report what they have shown after the swap, nobody waits for that, and a frame that
    // was on its way when the wall was paused is swapped all the same: so the numbers are compared
    // once the manager said the same before and after they were scraped.
    let (metrics, status, statistics) = wait::until("all reports", || {
        let told = || {
            let statistics = client.statistics(false).expect("statistics");
            (client.status().expect("a status"), statistics)
        };
        let (status, statistics) = told();
        let metrics = scrape(address);
        let (status_after, statistics_after) = told();
        let all = statistics.channels.iter().all(|channel| channel.frames == status.frame.0);
        let is_still = status.frame == status_after.frame && statistics == statistics_after;
        (all && is_still).then_some((metrics, status, statistics))
    });
    assert_eq!(metrics.value("polyptych_frames_total"), status.frame.0 as f64);
    assert_eq!(metrics.value("polyptych_last_frame"), status.frame.0 as f64);
    assert_eq!(metrics.value("polyptych_revision"), status.revision.0 as f64);
    assert_eq!(metrics.value("polyptych_clients"), 1.0);
    let complete = metrics.value("polyptych_complete_frames_total");
    assert_eq!(complete, statistics.complete as f64);
    let close = |name: &str, expected: f64| {
        let value = metrics.value(name);
        assert!((value - expected).abs() <= expected * 1e-6, "{name}: {value}, not {expected}");
    };
    close("polyptych_deadline_seconds", status.deadline_ms / 1000.0);
    for (name, count) in [
        ("frame", statistics.frame_ms.count),
        ("barrier", statistics.barrier_us.count),
        ("draw", statistics.draw_ms.count),
        ("swap_skew", statistics.swap_skew_us.count),
    ] {
        assert_eq!(metrics.value(&format!("polyptych_{name}_seconds_count")), count as f64);
    }
    // A mean lies below the largest, and above a half of the frames times the median.
    let frame_s = metrics.value("polyptych_frame_seconds_sum");
    let frames = status.frame.0 as f64;
    assert!(frame_s <= statistics.frame_ms.max / 1000.0 * frames, "{frame_s}");
    assert!(frame_s >= statistics.frame_ms.p50 / 1000.0 * frames / 2.0, "{frame_s}");
    for (name, (of, channel)) in names.iter().zip(statistics.channels.iter().zip(&status.channels))
    {
        assert_eq!(state_of(&metrics, name), "live");
        let number = |what: &str| metrics.labelled(&format!("channel_{what}"), "channel", name);
        assert_eq!(number("frames_total"), of.frames as f64);
        assert_eq!(number("drawn_total"), of.draw_ms.count as f64);
        assert_eq!(number("compared_total"), of.swap_skew_us.count as f64);
        assert_eq!(number("late_total"), channel.late as f64);
        assert!(number("draw_seconds_total") > 0.0 && channel.draw_us > Some(0));
        // Memory comes by heartbeat, so the two may be some pings apart.
        let memory = metrics.labelled("server_memory_bytes", "server", name);
        assert!(memory > 1e6, "{memory}");
    }
    let bytes = |connection: &str, direction: &str| {
        let labels = format!("connection=\"{connection}\",direction=\"{direction}\"");
        metrics.value(&format!("polyptych_server_connection_bytes_total{{{labels}}}"))
    };
    assert!(bytes("control", "sent") > frames * 100.0 && bytes("control", "received") > frames);
    assert!(bytes("bulk", "sent") > 100_000.0, "the town went to two servers");
    assert_eq!(metrics.labelled("queue_length", "queue", "orders"), 0.0);
    assert_eq!(metrics.labelled("queue_limit", "queue", "events"), 1024.0);
    assert!(metrics.value("process_resident_memory_bytes") > 1e6);
}

/// Checks that other requests to the address are refused, and hold nothing.
fn check_strangers(address: &str) {
    let head = |said: &str| {
        let answer = exchange(address, said);
        answer.lines().next().unwrap_or_default().to_owned()
    };
    assert!(head("GET / HTTP/1.1\r\nHost: a\r\n\r\n").starts_with("HTTP/1.1 404"));
    assert!(head("GET /metricsx HTTP/1.1\r\nHost: a\r\n\r\n").starts_with("HTTP/1.1 404"));
    let posted = exchange(address, "POST /metrics HTTP/1.1\r\nContent-Length: 9\r\n\r\n");
    assert!(posted.starts_with("HTTP/1.1 405") && posted.contains("allow: GET"), "{posted}");
    assert!(head("noise\r\n\r\n").starts_with("HTTP/1.1 400"));
    let long = format!("GET /metrics HTTP/1.1\r\nA: {}\r\n\r\n", "x".repeat(20_000));
    assert!(!head(&long).starts_with("HTTP/1.1 200"), "a head without end");
    let silent: Vec<TcpStream> =
        (0..SILENT).map(|_| TcpStream::connect(address).expect("connected")).collect();
    scrape(address);
    drop(silent);
}

/// The state that a channel is in, by the series that is 1.
fn state_of(metrics: &Exposition, channel: &str) -> &'static str {
    let states = ["lost", "joining", "preparing", "ready", "live", "late"];
    let is_in = |state: &&&str| {
        let labels = format!("channel=\"{channel}\",state=\"{state}\"");
        metrics.value(&format!("polyptych_channel_state{{{labels}}}")) == 1.0
    };
    let found: Vec<&&str> = states.iter().filter(is_in).collect();
    assert_eq!(found.len(), 1, "{channel} is {found:?}");
    found[0]
}

pub fn scrape(address: &str) -> Exposition {
    let answer = exchange(address, "GET /metrics HTTP/1.1\r\nHost: wall\r\n\r\n");
    let (head, body) = answer.split_once("\r\n\r\n").expect("a head and a body");
    assert!(head.starts_with("HTTP/1.1 200"), "{head}");
    assert!(head.contains("content-type: application/openmetrics-text; version=1.0.0"), "{head}");
    Exposition::read(body)
}

/// Says this and reads until the connection ends, which it must.
fn exchange(address: &str, said: &str) -> String {
    let (address, said) = (address.to_owned(), said.to_owned());
    wait::within("an answer over HTTP", move || {
        let mut stream = TcpStream::connect(address).expect("connected");
        // It may be closed before all is said, and with what was not read.
        let _ = stream.write_all(said.as_bytes());
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        String::from_utf8(answer).expect("UTF-8")
    })
}

#[test]
fn metrics_are_for_this_machine_unless_told_otherwise() {
    let place = TestDir::new();
    let wall = polyptych_wall_file::to_toml(&small(1, 1));
    let wall = place.write("wall.toml", wall).display().to_string();
    let at =
        |metrics: &str| place.run(["manager", &wall, "--listen", ANY_PORT, "--metrics", metrics]);
    at("0.0.0.0:0").failed(&["--metrics 0.0.0.0:0", "other machines", "--insecure"]);
    at("nonsense").failed(&["--metrics nonsense", "HOST:PORT"]);
    let taken = std::net::TcpListener::bind(ANY_PORT).expect("a port");
    let address = taken.local_addr().expect("an address").to_string();
    at(&address).failed(&["--metrics", "cannot listen there"]);
}
