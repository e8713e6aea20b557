//! Displays that go dark by themselves, by a clock that the test owns.

use polyptych_protocol::output_mode::OutputMode;
use polyptych_protocol::screen_rest::{LitHours, RestRules};

use super::*;

const MINUTE_US: Micros = 60_000_000;

fn is_dark(stage: &ClusterFixture) -> bool {
    let status = stage.cluster.status(stage.now);
    let (_, frame) = stage.frames.last().expect("a frame");
    assert_eq!(frame.presentation.output_mode == OutputMode::Blank, status.rest.is_resting);
    assert_eq!(status.presentation.output_mode, OutputMode::Normal, "the own mode stays");
    status.rest.is_resting
}

/// Lets time pass, and draws the frame that this may bring.
fn pass(stage: &mut ClusterFixture, micros: Micros) {
    stage.now += micros;
    for server in 0..2 {
        stage.cluster.handle_life(SessionId(server), stage.now);
    }
    stage.wait(0);
    stage.draw(&[0, 1], 20_000);
}

#[test]
fn a_wall_that_is_not_used_goes_dark_and_is_lit_by_use() {
    let mut stage = ClusterFixture::new(2);
    stage.order_frame();
    stage.draw(&[0, 1], 20_000);
    let rules = RestRules { idle_s: Some(60.0), hours: None };
    stage.request(Request::SetRest(rules));
    assert_eq!(stage.memories.last().expect("remembered").rest, rules);
    pass(&mut stage, 59 * 1_000_000);
    assert!(!is_dark(&stage));
    // Those who watch, tracked heads and programs that only draw are no use.
    stage.request(Request::Status);
    stage.request(Request::SetHead(stage.cluster.presentation.head.into()));
    stage.order_frame();
    stage.draw(&[0, 1], 20_000);
    assert!(stage.cluster.poll_timeout().is_some());
    pass(&mut stage, 1_000_000);
    assert!(is_dark(&stage), "a paused wall draws a frame for it");
    stage.request(Request::SetCamera(Camera::IDENTITY));
    stage.wait(0);
    assert!(!is_dark(&stage));
    // The next manager keeps to the rules, and counts anew.
    let memory = stage.memories.last().expect("remembered").clone();
    let restored = Cluster::restore(wall(2), Epoch(9), &memory);
    let status = restored.status(0).rest;
    assert_eq!((status.rules, status.is_resting), (rules, false));
    let wrong = stage.request(Request::SetRest(RestRules { idle_s: Some(-1.0), hours: None }));
    let (_, reply) = stage.replies.iter().find(|(of, _)| *of == wrong).expect("answered");
    assert!(reply.as_ref().expect_err("refused").reason.contains("10 to 604800 seconds"));
    assert_eq!(stage.cluster.status(stage.now).rest.rules, rules);
    stage.draw(&[0, 1], 20_000);
    pass(&mut stage, 60 * 1_000_000);
    assert!(is_dark(&stage));
    stage.request(Request::SetRest(RestRules::default()));
    stage.wait(0);
    assert!(!is_dark(&stage), "a paused wall draws a frame for it");
    stage.draw(&[0, 1], 20_000);
    pass(&mut stage, 600 * MINUTE_US);
    assert!(!is_dark(&stage));
}

#[test]
fn a_frozen_wall_is_lit_again_with_a_picture() {
    let mut stage = ClusterFixture::new(2);
    stage.request(Request::SetDisplays(OutputMode::Freeze));
    stage.draw(&[0, 1], 20_000);
    stage.request(Request::SetRest(RestRules { idle_s: Some(60.0), hours: None }));
    pass(&mut stage, 60 * 1_000_000);
    assert!(is_dark(&stage));
    stage.request(Request::SetCamera(Camera::IDENTITY));
    stage.wait(0);
    assert!(!is_dark(&stage));
    let (_, frame) = stage.frames.last().expect("a frame");
    assert_eq!(frame.presentation.output_mode, OutputMode::Normal, "black is not frozen");
}

#[test]
fn displays_are_dark_outside_hours_but_for_those_who_work() {
    let mut stage = ClusterFixture::new(2);
    let hours = Some(LitHours { from_min: 540, until_min: 1080 });
    stage.request(Request::SetRest(RestRules { idle_s: None, hours }));
    stage.order_frame();
    stage.draw(&[0, 1], 20_000);
    assert!(!is_dark(&stage), "the time is not known yet");
    assert!(stage.cluster.has_hours());
    let tell = |stage: &mut ClusterFixture, minute| {
        stage.now += 1;
        stage.cluster.handle_minute(stage.now, minute);
        stage.read();
        stage.draw(&[0, 1], 20_000);
    };
    tell(&mut stage, 600);
    stage.request(Request::SetCamera(Camera::IDENTITY));
    assert!(!is_dark(&stage));
    tell(&mut stage, 1080);
    assert!(is_dark(&stage), "it closes, though it was just used");
    stage.request(Request::SetExposure(2.0));
    stage.wait(0);
    stage.draw(&[0, 1], 20_000);
    assert!(!is_dark(&stage));
    pass(&mut stage, 9 * MINUTE_US);
    assert!(!is_dark(&stage));
    pass(&mut stage, MINUTE_US);
    assert!(is_dark(&stage));
    tell(&mut stage, 540);
    assert!(!is_dark(&stage), "it opens");
    tell(&mut stage, 1080);
    assert!(is_dark(&stage));
    for rules in [RestRules::default(), RestRules { idle_s: None, hours }] {
        stage.request(Request::SetRest(rules));
        stage.wait(0);
        stage.draw(&[0, 1], 20_000);
        assert!(!is_dark(&stage), "the minute is not known any more");
    }
}
