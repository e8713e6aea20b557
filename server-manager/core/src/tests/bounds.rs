//! Bounds of error and rate: one decision in every frame, which follows the slowest channel.

use polyptych_protocol::feedback::{FrameFeedback, ResolutionScales};
use polyptych_protocol::pattern::TestPattern;
use polyptych_protocol::quality_bounds::{DetailBound, ERROR_PX_MAX, QualityBounds};
use polyptych_wall::view::View;

use super::*;

const RATE: QualityBounds = QualityBounds { error_px: 0.0, rate_fps: Some(20.0) };

impl ClusterFixture {
    fn bound(&mut self, bounds: QualityBounds) {
        self.replies.clear();
        self.request(Request::SetBounds(bounds));
        assert_eq!(self.replies.pop().map(|(_, reply)| reply), Some(Ok(Response::Done)));
    }

    /// One frame, which both channels draw in the times that they take with its bound.
    fn bounded_frame(&mut self, draw_us: impl Fn(f64) -> [u32; 2]) -> FrameFeedback {
        self.frames.clear();
        self.replies.clear();
        self.order_frame();
        let error_px = self.frames.last().expect("a frame").1.detail.error_px;
        assert!(self.frames.iter().all(|(_, frame)| frame.detail == self.frames[0].1.detail));
        let times = draw_us(error_px);
        self.wait(Micros::from(times[0].max(times[1])));
        for (channel, draw_us) in (0u32..).zip(times) {
            let drawn = FrameRendered { draw_us, error_fraction: 0.5, ..self.drawn(channel) };
            self.say(SessionId(u64::from(channel)), ServerMessage::Drawn(drawn));
        }
        match self.replies.pop() {
            Some((_, Ok(Response::Frame(feedback)))) => feedback,
            other => panic!("{other:?}"),
        }
    }

    fn detail(&mut self) -> DetailBound {
        self.bounded_frame(|_| [1_000; 2]);
        self.frames[0].1.detail.clone()
    }
}

/// A wall whose second channel takes 300 ms at its finest.
fn city(error_px: f64) -> [u32; 2] {
    [8_000, 8_000 + (292_000.0 / (1.0 + 4.0 * error_px)) as u32]
}

#[test]
fn frames_carry_the_error_bound_and_what_it_is_in_the_scene() {
    let mut stage = ClusterFixture::new(2);
    assert_eq!(stage.detail(), DetailBound::default());
    stage.bound(QualityBounds { error_px: 0.5, rate_fps: None });
    let detail = stage.detail();
    let density = |stage: &ClusterFixture| {
        let head = stage.cluster.presentation.head;
        stage.cluster.wall.pixel_density(&View::of_wall(Camera::IDENTITY), &head)
    };
    let densities = vec![density(&stage)];
    assert_eq!(detail, DetailBound { error_px: 0.5, densities, ..DetailBound::default() });
    // A head that moves sees pixels of another size, and a view has its own.
    stage.request(Request::SetHead(DVec3::new(0.3, 0.0, 0.5).into()));
    stage.request(Request::SetViews(vec![View::of_wall(Camera::IDENTITY)]));
    let moved = stage.detail();
    assert_eq!(moved.densities, [density(&stage); 2]);
    assert_ne!(moved.densities[0], detail.densities[0]);
}

#[test]
fn bounds_outlive_the_manager() {
    let mut stage = ClusterFixture::new(2);
    let bounds = QualityBounds { error_px: 0.25, rate_fps: Some(30.0) };
    stage.bound(bounds);
    let memory = stage.memories.last().expect("kept").clone();
    let restored = Cluster::restore(wall(2), Epoch(8), &memory);
    assert_eq!(restored.presentation.bounds, bounds);
    let mut damaged = memory;
    damaged.presentation.bounds.error_px = f64::NAN;
    let restored = Cluster::restore(wall(2), Epoch(8), &damaged);
    assert_eq!(restored.presentation.bounds, QualityBounds::FINEST);
}

#[test]
fn bounds_out_of_range_are_refused_with_their_range_and_change_nothing() {
    let mut stage = ClusterFixture::new(2);
    let kept = QualityBounds { error_px: 0.25, rate_fps: Some(30.0) };
    stage.bound(kept);
    let errors = [f64::NAN, -1.0, f64::INFINITY, 1e30].map(|error_px| {
        let words = format!("an error bound is 0 to 64 pixels, not {error_px}");
        (QualityBounds { error_px, ..kept }, words)
    });
    let rates = [f64::NAN, 0.0, -1.0, f64::INFINITY, 1e9].map(|rate| {
        let words = format!("a rate bound is 1 to 1000 frames per second, not {rate}");
        (QualityBounds { rate_fps: Some(rate), ..kept }, words)
    });
    for (bounds, words) in errors.into_iter().chain(rates) {
        stage.request(Request::SetBounds(bounds));
        let refused = stage.replies.pop().map(|(_, reply)| reply);
        assert_eq!(refused, Some(Err(RequestError::new(words))));
        assert_eq!(stage.cluster.presentation.bounds, kept, "after {bounds:?}");
    }
}

#[test]
fn the_bound_in_force_follows_the_slowest_channel_and_is_reported() {
    let mut stage = ClusterFixture::new(2);
    stage.bound(RATE);
    stage.request(Request::Statistics { reset: true });
    let mut late = 0;
    let mut last = None;
    for _ in 0..200 {
        let feedback = stage.bounded_frame(city);
        late += u32::from(feedback.frame_us > 50_000);
        last = Some(feedback.detail);
    }
    assert!(late <= 6, "{late} of 200 frames were late");
    let detail = last.expect("a frame");
    // 50 ms are kept from 1.49 pixels on.
    assert!((1.49..1.49 * 1.3).contains(&detail.error_in_force_px), "{detail:?}");
    assert_eq!(detail.largest_error_px, detail.error_in_force_px * 0.5);
    assert_eq!(detail.limiting_channel.as_deref(), Some("c1"));
    stage.request(Request::Statistics { reset: false });
    let Some((_, Ok(Response::Statistics(all)))) = stage.replies.pop() else { panic!("none") };
    assert_eq!(all.error_bound_px, 0.0);
    assert!(all.error_in_force_px.p50 > 1.4 && all.error_in_force_px.max < 8.0, "{all:?}");
    assert!(all.largest_error_px > 0.7);
    assert_eq!(all.draws_occluded, 40 * all.channels.len() as u64);
    assert_eq!(all.limiting_channel.as_deref(), Some("c1"));
    let status = stage.cluster.status(stage.now);
    assert_eq!(status.error_in_force_px, detail.error_in_force_px);
    assert!(status.warnings.is_empty(), "{:?}", status.warnings);
}

#[test]
fn a_rate_that_no_detail_keeps_is_told_with_the_channel() {
    let mut stage = ClusterFixture::new(2);
    stage.bound(RATE);
    for _ in 0..11 {
        stage.bounded_frame(|_| [60_000, 10_000]);
    }
    // Before it is said, resolution is tried, and that is said.
    let status = stage.cluster.status(stage.now);
    let detail = stage.frames[0].1.detail.clone();
    assert_eq!((detail.error_px, status.error_in_force_px), (8.0, 8.0));
    assert!(detail.resolution_steps > 1 && status.resolution_scale < 0.8, "{detail:?}");
    let percent = format!("{:.0} % of its pixels", 100.0 * status.resolution_scale);
    let told = status.warnings.iter().find(|warning| warning.contains(&percent));
    assert!(told.is_some_and(|told| told.contains("20 frames per second")), "{status:?}");
    stage.request(Request::Statistics { reset: true });
    for _ in 0..30 {
        stage.bounded_frame(|_| [60_000, 10_000]);
    }
    stage.request(Request::Statistics { reset: false });
    let Some((_, Ok(Response::Statistics(all)))) = stage.replies.pop() else { panic!("none") };
    assert_eq!(all.resolution_scale, ResolutionScales { p50: 0.25, min: 0.25 });
    let status = stage.cluster.status(stage.now);
    assert_eq!((status.error_in_force_px, status.resolution_scale), (ERROR_PX_MAX, 0.25));
    let told = status.warnings.iter().find(|warning| warning.contains("20 frames per second"));
    assert!(told.is_some_and(|told| told.contains("channel c0 draws 60.0 ms")), "{status:?}");
    stage.bound(QualityBounds::FINEST);
    assert!(stage.cluster.status(stage.now).warnings.is_empty());
    assert_eq!(stage.detail(), DetailBound::default());
}

/// A wall that is paused draws no frame that would bring its detail back.
#[test]
fn a_lower_rate_brings_detail_back_before_the_next_frame() {
    let rate = |rate_fps| QualityBounds { error_px: 0.0, rate_fps };
    for lower in [&[Some(10.0)][..], &[None, Some(10.0)]] {
        let mut stage = ClusterFixture::new(2);
        stage.bound(rate(Some(1000.0)));
        for _ in 0..40 {
            stage.bounded_frame(|_| [30_000; 2]);
        }
        let status = stage.cluster.status(stage.now);
        assert_eq!((status.error_in_force_px, status.resolution_scale), (ERROR_PX_MAX, 0.25));
        assert_eq!(status.warnings.len(), 1, "{:?}", status.warnings);
        for &rate_fps in lower {
            stage.bound(rate(rate_fps));
        }
        let status = stage.cluster.status(stage.now);
        assert_eq!((status.error_in_force_px, status.resolution_scale), (0.0, 1.0), "{lower:?}");
        assert!(status.warnings.is_empty(), "{:?}", status.warnings);
    }
}

#[test]
fn a_lower_rate_of_a_wall_that_runs_brings_detail_back_by_steps() {
    let rate = |rate_fps| QualityBounds { error_px: 0.0, rate_fps };
    let mut stage = ClusterFixture::new(2);
    stage.bound(rate(Some(1000.0)));
    for _ in 0..40 {
        stage.bounded_frame(|_| [30_000; 2]);
    }
    stage.request(Request::Run(Pacing::Rate(20.0)));
    stage.bound(rate(Some(900.0)));
    assert!(stage.cluster.status(stage.now).error_in_force_px > 1.0, "all would be late at once");
}

/// That a rate is not kept is known of that rate, after frames with it.
#[test]
fn a_higher_rate_is_not_said_to_be_missed_before_a_frame() {
    let mut stage = ClusterFixture::new(2);
    stage.bound(RATE);
    for _ in 0..60 {
        stage.bounded_frame(|_| [60_000, 10_000]);
    }
    let is_missed = |stage: &ClusterFixture| {
        let warnings = stage.cluster.status(stage.now).warnings;
        warnings.iter().any(|told| told.contains("is not kept"))
    };
    assert!(is_missed(&stage));
    stage.bound(QualityBounds { error_px: 1.0, ..RATE });
    assert!(is_missed(&stage), "the same rate");
    stage.bound(QualityBounds { rate_fps: Some(25.0), ..RATE });
    assert!(!is_missed(&stage));
    assert_eq!(stage.cluster.status(stage.now).resolution_scale, 0.25, "it needs no more detail");
}

/// A server draws its channels one after another: the longest of them all is not what limits.
#[test]
fn a_server_of_several_channels_limits_with_the_time_of_all_of_them() {
    let mut stage = ClusterFixture::of(wall(5));
    for (session, of) in [(0, 0..1), (1, 1..5)] {
        let channels: Vec<String> = of.map(|channel| format!("c{channel}")).collect();
        let adapter = Adapter { texture_side_max: 8192, ..Adapter::default() };
        let hello = ServerHello { name: channels[0].clone(), channels, pid: 100, adapter };
        let (from, now) = (SessionId(session), stage.now);
        stage.cluster.handle_server(now, from, hello, "127.0.0.1:9".into()).expect("joined");
        stage.read();
    }
    stage.prepare_all();
    stage.bound(RATE);
    stage.request(Request::Statistics { reset: true });
    for _ in 0..60 {
        stage.replies.clear();
        stage.order_frame();
        stage.wait(60_000);
        for (channel, draw_us) in (0u32..).zip([40_000, 13_000, 14_000, 16_000, 13_000]) {
            let drawn = FrameRendered { draw_us, ..stage.drawn(channel) };
            stage.say(SessionId(u64::from(channel.min(1))), ServerMessage::Drawn(drawn));
        }
    }
    let Some((_, Ok(Response::Frame(feedback)))) = stage.replies.pop() else { panic!("none") };
    assert_eq!(feedback.detail.limiting_channel.as_deref(), Some("c3"));
    stage.request(Request::Statistics { reset: false });
    let Some((_, Ok(Response::Statistics(all)))) = stage.replies.pop() else { panic!("none") };
    assert_eq!(all.limiting_channel.as_deref(), Some("c3"));
    let warnings = stage.cluster.status(stage.now).warnings;
    let told = "the server of channel c3 draws 56.0 ms for all its channels even with";
    assert!(warnings.iter().any(|warning| warning.contains(told)), "{warnings:?}");
}

#[test]
fn servers_that_wait_for_a_swap_lead_have_less_time_to_draw() {
    // Leads, depths of the pipeline and drawing times in milliseconds, of a period of 50.
    for (swap_lead_ms, pipeline_depth, draw_ms, is_kept) in [
        (0, 0, 44, true),
        (0, 0, 46, false),
        (25, 0, 22, true),
        (25, 0, 23, false),
        (25, 1, 33, true),
        (25, 1, 34, false),
        (45, 0, 4, true),
        (45, 0, 5, false),
        (50, 0, 30, true),
    ] {
        let mut stage = ClusterFixture::new(2);
        stage.cluster.wall.sync.swap_lead_ms = swap_lead_ms;
        stage.cluster.wall.sync.pipeline_depth = pipeline_depth;
        stage.bound(RATE);
        for _ in 0..20 {
            stage.bounded_frame(|_| [draw_ms * 1000; 2]);
        }
        let status = stage.cluster.status(stage.now);
        let px = status.error_in_force_px;
        assert_eq!(px == 0.0, is_kept, "{px} px, {draw_ms} ms with a lead of {swap_lead_ms} ms");
        let told = status.warnings.iter().any(|told| told.contains("the swap lead of 50 ms"));
        assert_eq!(told, swap_lead_ms == 50, "{:?}", status.warnings);
    }
}

/// A server compares two ways of drawing every 256 frames: what that costs is no reason to draw
/// less.
#[test]
fn frames_that_are_slow_for_comparison_change_no_bound() {
    for (is_trial, other_us) in [(true, 10_000), (false, 10_000), (true, 60_000)] {
        let mut stage = ClusterFixture::new(2);
        stage.bound(RATE);
        for frame in 0..12 {
            stage.order_frame();
            let is_slow = frame % 4 == 0;
            let draw_us = if is_slow { 70_000 } else { 20_000 };
            stage.wait(Micros::from(draw_us.max(other_us)));
            for channel in 0..2 {
                let draw_us = if channel == 0 { draw_us } else { other_us };
                let is_trial = is_trial && is_slow && channel == 0;
                let drawn = FrameRendered { draw_us, is_trial, ..stage.drawn(channel) };
                stage.say(SessionId(u64::from(channel)), ServerMessage::Drawn(drawn));
            }
        }
        let error_px = stage.cluster.status(stage.now).error_in_force_px;
        // Another server's time counts whatever this one tries.
        let is_kept = is_trial && other_us == 10_000;
        assert_eq!(error_px == 0.0, is_kept, "{error_px} px, {is_trial}, {other_us} us");
    }
}

#[test]
fn a_test_pattern_changes_no_bound() {
    let mut stage = ClusterFixture::new(2);
    stage.bound(RATE);
    (0..64).for_each(|_| drop(stage.bounded_frame(city)));
    let error_px = |stage: &ClusterFixture| stage.cluster.status(stage.now).error_in_force_px;
    let before = error_px(&stage);
    assert!(before > 1.0, "{before} px");
    stage.request(Request::SetPattern(Some(TestPattern::Checker)));
    stage.draw(&[0, 1], 1_000);
    (0..64).for_each(|_| drop(stage.bounded_frame(|_| [1_000; 2])));
    stage.request(Request::SetPattern(None));
    assert_eq!(error_px(&stage), before);
}

#[test]
fn a_pattern_that_is_late_changes_no_bound() {
    let mut stage = ClusterFixture::new(2);
    stage.bound(RATE);
    stage.request(Request::SetPattern(Some(TestPattern::Checker)));
    stage.draw(&[0], 1_000);
    stage.wait(1_000_000);
    assert_eq!((stage.state(1), stage.swaps.len()), (ChannelState::Late, 1));
    let slow = FrameRendered { draw_us: 1_000_000, ..stage.drawn(1) };
    stage.say(SessionId(1), ServerMessage::Drawn(slow));
    assert_eq!(stage.cluster.status(stage.now).error_in_force_px, 0.0);
}

#[test]
fn a_frame_of_the_scene_before_is_forgotten_with_it() {
    let mut stage = ClusterFixture::new(1);
    stage.bound(RATE);
    stage.order_frame();
    let drawn = FrameRendered { draw_us: 70_000, ..stage.drawn(0) };
    stage.request(Request::CloseScene);
    stage.prepare_all();
    stage.wait(70_000);
    stage.swaps.clear();
    stage.say(SessionId(0), ServerMessage::Drawn(drawn));
    assert_eq!(stage.swaps, [drawn.frame], "it is shown");
    assert_eq!(stage.cluster.status(stage.now).error_in_force_px, 0.0);
    let deadline = &stage.cluster.deadline;
    assert_eq!(deadline.length(), deadline.longest());
}

#[test]
fn what_a_server_makes_up_about_its_error_stays_within_the_bound() {
    let mut stage = ClusterFixture::new(1);
    stage.bound(QualityBounds { error_px: 2.0, rate_fps: None });
    for (said, counted) in [(f32::NAN, 0.0), (f32::INFINITY, 2.0), (-1.0, 0.0), (7.0, 2.0)] {
        stage.order_frame();
        let drawn = FrameRendered { error_fraction: said, ..stage.drawn(0) };
        stage.say(SessionId(0), ServerMessage::Drawn(drawn));
        let Some((_, Ok(Response::Frame(feedback)))) = stage.replies.pop() else { panic!("none") };
        assert_eq!(feedback.detail.largest_error_px, counted, "of {said}");
    }
}

#[test]
fn detail_that_the_budget_does_not_hold_is_told_in_pixels() {
    let mut stage = ClusterFixture::new(1);
    stage.cluster.wall.budget.gpu_mib = Some(7);
    let frame = |stage: &mut ClusterFixture, error_px, said| {
        stage.bound(QualityBounds { error_px, rate_fps: None });
        stage.order_frame();
        let drawn = FrameRendered { error_fraction: said, ..stage.drawn(0) };
        stage.say(SessionId(0), ServerMessage::Drawn(drawn));
        let Some((_, Ok(Response::Frame(feedback)))) = stage.replies.pop() else { panic!("none") };
        (feedback.detail.largest_error_px, stage.cluster.status(stage.now).warnings)
    };
    // Without a bound in pixels, with one as a multiple of it.
    for (error_px, said, counted) in
        [(0.0, 3.0, 3.0), (2.0, 1.5, 3.0), (0.0, f32::INFINITY, 65_536.0)]
    {
        let (largest, warnings) = frame(&mut stage, error_px, said);
        assert_eq!(largest, counted);
        let told =
            format!("the budget of 7 MiB (budget.gpu_mib) holds detail of {counted:.1} pixels");
        assert!(warnings.iter().any(|warning| warning.starts_with(&told)), "{warnings:?}");
    }
    for (error_px, said) in [(0.0, 0.0), (2.0, 1.0), (0.0, f32::NAN)] {
        let (largest, warnings) = frame(&mut stage, error_px, said);
        assert!(largest == error_px && warnings.is_empty(), "{warnings:?}");
    }
}

#[test]
fn a_channel_that_is_late_for_good_costs_the_others_detail_for_a_while_only() {
    let mut stage = ClusterFixture::new(2);
    stage.bound(RATE);
    // The second channel takes a second for everything; the first is as fast as can be.
    let mut bounds = Vec::new();
    for _ in 0..3_000 {
        stage.frames.clear();
        stage.order_frame();
        bounds.push(stage.frames.last().expect("a frame").1.detail.error_px);
        let slow = FrameRendered { draw_us: 1_000_000, ..stage.drawn(1) };
        stage.draw(&[0], 1_000);
        stage.wait(100_000);
        stage.say(SessionId(1), ServerMessage::Drawn(slow));
    }
    assert_eq!(stage.state(1), ChannelState::Late);
    let blurred = bounds.iter().filter(|&&px| px > 0.0).count();
    assert!(bounds.contains(&ERROR_PX_MAX) && blurred < 1_500, "{blurred}");
    assert_eq!(bounds.last(), Some(&0.0));
}
