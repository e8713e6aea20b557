//! Previews: pictures for people who watch, which change nothing of what the wall shows.

use std::num::NonZeroU32;

use polyptych_wall::tour::{Tour, TourStop};

use super::*;

/// The frames of the first server since the last call.
fn frames(stage: &mut ClusterFixture) -> Vec<Frame> {
    let all = std::mem::take(&mut stage.frames);
    all.into_iter().filter(|(to, _)| *to == SessionId(0)).map(|(_, frame)| frame).collect()
}

#[test]
fn a_preview_of_a_paused_wall_repeats_the_last_frame() {
    let mut stage = ClusterFixture::new(2);
    let far = Camera { position: DVec3::new(9.0, 0.0, 0.0), ..Camera::IDENTITY };
    let stops = vec![TourStop::new(far, 30.0)];
    stage.request(Request::PlayTour(Tour { stops, is_loop: false }));
    for time_s in [3.0, 20.0, 40.0] {
        stage.request(Request::RenderFrame { camera: None, time_s: Some(time_s) });
        stage.draw(&[0, 1], 1_000);
    }
    let last = frames(&mut stage).pop().expect("a frame");
    assert!(last.presentation.camera.position.x > 1.0, "the tour has moved it");
    stage.wait(1_000_000);
    stage.request(Request::Preview { width: 0 });
    stage.draw(&[0, 1], 1_000);
    let [preview] = &frames(&mut stage)[..] else { panic!("one frame more") };
    assert_eq!(preview.capture, Some(NonZeroU32::MIN));
    assert_eq!((preview.time_s, &preview.presentation), (last.time_s, &last.presentation));
    assert_eq!(stage.collects, [[0, 1].map(ChannelId)]);
    let is_played = stage.cluster.tour_status().tour.is_some();
    assert!(is_played, "a client that gives times may go back from beyond the end");
}

#[test]
fn a_preview_of_a_wall_that_runs_waits_for_the_next_beat() {
    let mut stage = ClusterFixture::new(1);
    stage.request(Request::Run(Pacing::Rate(10.0)));
    stage.draw(&[0], 1_000);
    frames(&mut stage);
    stage.request(Request::Preview { width: 0 });
    stage.wait(50_000);
    assert_eq!(frames(&mut stage).len(), 0, "the beat is 100 ms long");
    stage.wait(60_000);
    let [frame] = &frames(&mut stage)[..] else { panic!("the beat brings one frame") };
    assert!(frame.capture.is_some());
    stage.draw(&[0], 1_000);
    // Other requests for frames do not wait for it.
    stage.request(Request::Preview { width: 0 });
    stage.order_frame();
    assert_eq!(frames(&mut stage).len(), 1);
}

#[test]
fn a_preview_has_as_few_pixels_as_it_may() {
    let mut stage = ClusterFixture::new(2);
    let all: u32 = stage.cluster.wall().screens.iter().map(|screen| screen.canvas.x).sum();
    for (width, side) in [(0, 1), (all, 1), (all - 1, 1), (all / 4, 4), (1, all), (2 * all, 1)] {
        stage.request(Request::Preview { width });
        stage.draw(&[0, 1], 1_000);
        let [preview] = &frames(&mut stage)[..] else { panic!("one frame more") };
        assert_eq!(preview.capture, NonZeroU32::new(side), "{width} of {all}");
    }
}

#[test]
fn a_preview_waits_for_a_channel_no_longer_than_other_frames() {
    let mut stage = ClusterFixture::new(2);
    for _ in 0..20 {
        stage.order_frame();
        stage.draw(&[0, 1], 1_000);
    }
    let swapped = stage.swaps.len();
    stage.request(Request::Preview { width: 0 });
    stage.draw(&[0], 1_000);
    stage.wait(100_000);
    assert_eq!((stage.swaps.len(), stage.state(1)), (swapped + 1, ChannelState::Late));
}
