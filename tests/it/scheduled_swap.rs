//! Swaps that state an instant: displays show a frame together though commands reach them at
//! different times, and whatever their clocks say.

use polyptych_client::{ChannelState, Pacing};
use serde_json::Value;

use crate::harness::local_wall::{ANY_PORT, LocalWall, await_states, small};
use crate::harness::place::TestDir;
use crate::harness::scenes::town;
use crate::harness::simulation::Simulation;
use crate::harness::wait;

/// A run in which every message to and from one of two servers takes 8 ms longer.
fn simulated(swap_lead_ms: u32) -> Value {
    let mut wall = small(2, 1);
    wall.sync.swap_lead_ms = swap_lead_ms;
    let arguments = ["--frames", "100", "--fault", "at 1 delay 8ms front-2-1"];
    let mut simulation = Simulation::start(TestDir::new(), &wall, town(), &arguments);
    simulation.process.finish(wait::LIMIT).succeeded();
    let text = std::fs::read(simulation.place.path("out/report.json")).expect("a report");
    serde_json::from_slice(&text).expect("JSON")
}

/// Medians of 100 frames, so that single stalls of a busy machine do not count; it may be busy for
/// seconds, so there are up to three pairs of runs.
#[test]
fn a_display_behind_a_slow_line_shows_frames_with_the_others_if_swaps_state_an_instant() {
    let skew_us = |report: &Value| report["swap_skew_us"]["p50"].as_f64().expect("a number");
    let unscheduled = |report: &Value, at: usize| report["channels"][at]["unscheduled"].as_u64();
    let mut pairs = Vec::new();
    let is_better = (0..3).any(|_| {
        let (at_once, together) = (simulated(0), simulated(20));
        assert_eq!((unscheduled(&at_once, 0), unscheduled(&at_once, 1)), (Some(0), Some(0)));
        let pair = [skew_us(&at_once), skew_us(&together)];
        pairs.push(pair);
        pair[0] > 6_000.0 && pair[1] < 3_000.0
    });
    assert!(is_better, "{pairs:?}");
    // A way that is longer than the lead is said.
    let too_late = simulated(4);
    assert!(unscheduled(&too_late, 1) > Some(50), "{too_late}");
}

#[test]
fn servers_whose_clocks_are_more_than_a_second_apart_show_frames_together() {
    let mut wall = small(2, 1);
    wall.sync.swap_lead_ms = 5;
    let mut local = LocalWall::manager(TestDir::new(), &wall, &[], ANY_PORT);
    let client = local.client();
    // A server's clock counts from its start.
    local.start_server(&wall.channels[0].server);
    wait::until("a server that is a second old", || {
        let status = client.status().expect("status");
        let first = &status.channels[0];
        (first.state != ChannelState::Lost && first.since_ms > 1_000).then_some(())
    });
    local.start_server(&wall.channels[1].server);
    client.start_rendering(Pacing::Rate(60.0)).expect("running");
    await_states(&client, &[ChannelState::Live]);
    let mut read = Vec::new();
    for _ in 0..5 {
        client.statistics(true).expect("statistics");
        let statistics = wait::until("200 frames that both have shown", || {
            let statistics = client.statistics(false).expect("statistics");
            (statistics.swap_skew_us.count >= 200).then_some(statistics)
        });
        let unscheduled: u64 = statistics.channels.iter().map(|channel| channel.unscheduled).sum();
        let errors = [0, 1].map(|at: usize| statistics.channels[at].clock_error_us);
        let skew = statistics.swap_skew_us;
        read.push((skew.p50, skew.p99, unscheduled, errors));
        if skew.p50 <= 1_000.0 && unscheduled < 200 {
            break;
        }
    }
    println!("skew p50 and p99 in us, frames not at their instant, clock errors in us: {read:?}");
    let (p50, _, unscheduled, errors) = read.last().expect("a window");
    assert!(*p50 <= 1_000.0 && *unscheduled < 200, "{read:?}");
    assert!(errors.iter().all(|error| *error != u32::MAX), "the clocks are known: {read:?}");
}
