//! Stored views and tours: every channel gets the same camera, in this life of the manager and in
//! the next.

use polyptych_protocol::navigation::Navigation;
use polyptych_protocol::pattern::TestPattern;
use polyptych_protocol::stored_view::StoredView;
use polyptych_wall::limits::{NAME_BYTES_MAX, STORED_VIEWS_MAX};
use polyptych_wall::tour::{Tour, TourStop};

use super::*;

fn place(x: f64) -> Camera {
    Camera { position: DVec3::new(x, 1.0, -x), ..Camera::IDENTITY }
}

/// Ten seconds from the present camera through two stops.
fn tour() -> Tour {
    let stops = vec![TourStop::new(place(4.0), 4.0), TourStop::new(place(9.0), 6.0)];
    Tour { stops, is_loop: false }
}

/// Draws a frame at this time of the manager; returns its scene time and camera, which all
/// channels have.
fn frame_at(stage: &mut ClusterFixture, now: Micros, time_s: Option<f64>) -> (f64, Camera) {
    stage.now = now;
    stage.frames.clear();
    stage.request(Request::RenderFrame { camera: None, time_s });
    stage.draw(&[0, 1], 0);
    let [(_, first), (_, second)] = &stage.frames[..] else { panic!("a frame for two servers") };
    assert_eq!(first.presentation, second.presentation);
    (first.time_s, first.presentation.camera)
}

/// The wall in another life of the manager, with both servers there again.
fn restarted(stage: &ClusterFixture) -> ClusterFixture {
    let memory = stage.memories.last().expect("remembered");
    let mut next = ClusterFixture::empty(2);
    // The servers of the test are of this life.
    next.cluster = Cluster::restore(wall(2), Epoch(7), memory);
    next.cluster.handle_client(CLIENT, "test".into());
    for index in 0..2 {
        next.join(SessionId(u64::from(index)), index).expect("joined");
    }
    next.prepare_all();
    next.wait(10_000);
    next.draw(&[0, 1], 1_000);
    next
}

fn is_played(stage: &ClusterFixture) -> bool {
    stage.cluster.tour_status().tour.is_some()
}

#[test]
fn a_tour_is_a_function_of_scene_time_that_begins_with_the_first_frame_after_it() {
    let mut stage = ClusterFixture::new(2);
    let from = stage.cluster.presentation.camera;
    stage.request(Request::PlayTour(tour()));
    assert_eq!(frame_at(&mut stage, 5_000_000, None), (5.0, from));
    for now_s in [6, 7, 9, 12] {
        let (time_s, camera) = frame_at(&mut stage, now_s * 1_000_000, None);
        assert_eq!(camera, tour().camera_at(&from, DVec3::ZERO, time_s - 5.0));
    }
    assert_eq!(frame_at(&mut stage, 9_000_000, None).1, place(4.0), "at the first stop");
    let status = stage.cluster.tour_status();
    assert_eq!((status.tour, status.began_s, status.time_s), (Some(tour()), Some(5.0), 9.0));
    // At its end the camera stays, and the tour is forgotten.
    assert_eq!(frame_at(&mut stage, 15_000_000, None).1, place(9.0));
    assert!(!is_played(&stage));
    assert_eq!(frame_at(&mut stage, 16_000_000, None).1, place(9.0));
    stage.wait(600_000);
    let memory = stage.memories.last().expect("remembered");
    assert_eq!((memory.presentation.camera, &memory.tour), (place(9.0), &None));
}

#[test]
fn a_client_that_gives_times_sees_the_same_cameras_again() {
    let mut stage = ClusterFixture::new(2);
    stage.request(Request::PlayTour(tour()));
    let times = [0.0, 0.1, 3.3, 4.0, 9.99, 10.0, 12.0];
    let film =
        |stage: &mut ClusterFixture| times.map(|time_s| frame_at(stage, stage.now, Some(time_s)).1);
    let first = film(&mut stage);
    assert_eq!((first[3], first[6]), (place(4.0), place(9.0)));
    assert_eq!(film(&mut stage), first, "the end was no end for one who may go back");
    // The manager is started again: the cameras are the same bit for bit.
    stage.wait(1_100_000);
    let now = stage.now;
    frame_at(&mut stage, now, Some(3.3));
    assert_eq!(film(&mut restarted(&stage)), first);
    // The wall's own clock goes on from there, to beyond the end.
    assert_eq!(frame_at(&mut stage, 20_000_000, None).1, first[2]);
    frame_at(&mut stage, 27_000_000, None);
    assert!(!is_played(&stage));
}

#[test]
fn a_film_of_a_tour_that_the_wall_has_begun_is_the_same_after_a_restart() {
    let mut stage = ClusterFixture::new(2);
    let from = stage.cluster.presentation.camera;
    stage.request(Request::PlayTour(tour()));
    frame_at(&mut stage, 5_000_000, None);
    frame_at(&mut stage, 6_500_000, None);
    let times = [5.0, 8.5, 9.0, 0.0];
    let film =
        |stage: &mut ClusterFixture| times.map(|time_s| frame_at(stage, stage.now, Some(time_s)).1);
    let first = film(&mut stage);
    assert_eq!((first[0], first[2], first[3]), (from, place(4.0), from));
    let held = tour().camera_at(&from, DVec3::ZERO, 1.5);
    // Its beginning is remembered with its first frame, and is the same with its last.
    for _ in 0..2 {
        let mut next = restarted(&stage);
        assert_eq!(film(&mut next), first);
        assert_eq!(frame_at(&mut next, 9_000_000, None).1, held, "the wall's own clock is kept");
        stage.request(Request::Status);
    }
}

#[test]
fn a_loop_on_the_clock_of_a_client_goes_on_by_itself_where_it_was() {
    let mut stage = ClusterFixture::new(2);
    let from = stage.cluster.presentation.camera;
    let looped = Tour { is_loop: true, ..tour() };
    stage.request(Request::PlayTour(looped.clone()));
    // Times since 1970.
    for time_s in [1.75e9, 1.75e9 + 2.5] {
        frame_at(&mut stage, 5_000_000, Some(time_s));
    }
    for (now, tour_s) in [(6_000_000, 2.5), (8_000_000, 4.5)] {
        let camera = looped.camera_at(&from, DVec3::ZERO, tour_s);
        assert_eq!(frame_at(&mut stage, now, None).1, camera, "at {tour_s} s");
    }
}

#[test]
fn a_tour_on_the_walls_own_clock_goes_on_where_it_was_after_a_restart() {
    let mut stage = ClusterFixture::new(2);
    stage.request(Request::PlayTour(tour()));
    // Halves of seconds are exact, so the times of both lives are.
    frame_at(&mut stage, 8_000_000, None);
    frame_at(&mut stage, 10_500_000, None);
    stage.request(Request::Status);
    let mut next = restarted(&stage);
    assert_eq!(next.cluster.presentation.camera, stage.cluster.presentation.camera);
    // A film begins with the tour, and leaves the wall's own clock alone.
    let film = [0.0, 4.0].map(|time_s| frame_at(&mut next, 2_000_000, Some(time_s)).1);
    assert_eq!(film[1], place(4.0));
    let (now, then) = (3_000_000, 10_500_000);
    for step in [0, 500_000, 1_500_000, 4_000_000, 7_500_000] {
        let camera = frame_at(&mut next, now + step, None).1;
        assert_eq!(camera, frame_at(&mut stage, then + step, None).1, "{step} us later");
    }
    assert!(!is_played(&next) && !is_played(&stage));
}

#[test]
fn a_paused_wall_does_not_move_and_a_server_that_joins_begins_no_tour() {
    let mut stage = ClusterFixture::new(2);
    let from = stage.cluster.presentation.camera;
    stage.request(Request::PlayTour(tour()));
    stage.cluster.handle_server_gone(stage.now, SessionId(1), "killed");
    stage.join(SessionId(1), 1).expect("joined");
    stage.prepare_all();
    stage.draw(&[0, 1], 1_000_000);
    assert!(!stage.frames.is_empty(), "the one that joined is given a frame");
    assert!(stage.frames.iter().all(|(_, frame)| frame.presentation.camera == from));
    assert_eq!(stage.cluster.tour_status().began_s, None);
    assert_eq!(frame_at(&mut stage, 20_000_000, None), (20.0, from));
}

#[test]
fn a_pause_holds_a_tour_on_the_walls_own_clock() {
    let mut stage = ClusterFixture::new(2);
    let from = stage.cluster.presentation.camera;
    stage.request(Request::PlayTour(tour()));
    frame_at(&mut stage, 5_000_000, None);
    frame_at(&mut stage, 6_500_000, None);
    // A film in the pause has its own times.
    frame_at(&mut stage, 7_000_000, Some(9.0));
    // What is shown with a pattern or in another light has none.
    stage.now = 30_000_000;
    stage.request(Request::SetPattern(Some(TestPattern::Grid)));
    stage.draw(&[0, 1], 0);
    stage.now = 45_000_000;
    stage.frames.clear();
    stage.request(Request::Redraw(None));
    stage.draw(&[0, 1], 0);
    assert!(stage.frames.iter().all(|(_, frame)| frame.time_s == 9.0));
    stage.now = 60_000_000;
    stage.frames.clear();
    stage.request(Request::Run(Pacing::Rate(1.0)));
    stage.draw(&[0, 1], 0);
    stage.wait(1_000_000);
    let [(_, first), _, (_, second), _] = &stage.frames[..] else { panic!("two frames each") };
    for (frame, tour_s) in [(first, 1.5), (second, 2.5)] {
        let camera = tour().camera_at(&from, DVec3::ZERO, tour_s);
        assert_eq!(frame.presentation.camera, camera, "at {tour_s} s");
    }
}

#[test]
fn what_sets_the_camera_otherwise_or_opens_a_scene_ends_a_tour() {
    let set = |stage: &mut ClusterFixture| {
        stage.request(Request::SetCamera(place(77.0)));
    };
    let with_frame = |stage: &mut ClusterFixture| {
        stage.request(Request::RenderFrame { camera: Some(place(77.0)), time_s: None });
        stage.draw(&[0, 1], 0);
    };
    let mouse = |stage: &mut ClusterFixture| {
        let turn = Navigation { orbit_rad: DVec2::splat(0.3), ..Navigation::none("c0") };
        stage.say(SessionId(0), ServerMessage::Navigate(turn));
        stage.draw(&[0, 1], 1_000);
    };
    let open = |stage: &mut ClusterFixture| {
        let job = ClientRequest { client: CLIENT, id: RequestId(99) };
        stage.cluster.handle_import(stage.now, job, Ok(ClusterFixture::imported()));
        stage.read();
        stage.prepare_all();
    };
    let stop = |stage: &mut ClusterFixture| {
        stage.request(Request::StopTour);
    };
    let ends: [&dyn Fn(&mut ClusterFixture); 5] = [&set, &with_frame, &mouse, &open, &stop];
    for (index, end) in ends.iter().enumerate() {
        let mut stage = ClusterFixture::new(2);
        open(&mut stage);
        stage.request(Request::PlayTour(tour()));
        frame_at(&mut stage, 8_000_000, None);
        frame_at(&mut stage, 9_000_000, None);
        end(&mut stage);
        assert!(!is_played(&stage), "end {index}");
        let camera = stage.cluster.presentation.camera;
        assert_eq!(frame_at(&mut stage, 10_000_000, None).1, camera, "end {index}");
        assert_eq!(stage.memories.last().expect("remembered").tour, None, "end {index}");
    }
}

#[test]
fn what_is_no_tour_is_refused_and_the_last_one_goes_on() {
    let mut stage = ClusterFixture::new(2);
    stage.request(Request::PlayTour(tour()));
    stage.clear();
    let mut bad = tour();
    bad.stops[1].travel_s = f64::NAN;
    stage.request(Request::PlayTour(bad));
    let (_, Err(refused)) = &stage.replies[0] else { panic!("refused") };
    assert!(refused.reason.starts_with("stop 1: the seconds of its travel"), "{refused}");
    assert_eq!(stage.cluster.tour_status().tour, Some(tour()));
    stage.request(Request::Capture { time_s: Some(f64::NAN) });
    assert!(stage.replies[1].1.as_ref().is_err_and(|e| e.reason.contains("finite")));
}

#[test]
fn views_are_kept_by_name_over_a_restart() {
    let mut stage = ClusterFixture::new(2);
    stage.request(Request::SetCamera(place(3.0)));
    let store = |name: &str, camera| Request::StoreView { name: name.into(), camera };
    stage.request(store("quay", None));
    stage.request(store("lighthouse", Some(place(7.0))));
    stage.request(store("quay", Some(place(5.0))));
    stage.request(store("gone", None));
    stage.request(Request::RemoveView { name: "gone".into() });
    stage.clear();
    let mut next = restarted(&stage);
    next.clear();
    next.request(Request::ListStoredViews);
    let view = |name: &str, camera| StoredView { name: name.into(), camera };
    let expected = vec![view("lighthouse", place(7.0)), view("quay", place(5.0))];
    assert_eq!(next.replies[0].1, Ok(Response::StoredViews(expected)));
    for (request, said) in [
        (Request::RemoveView { name: "gone".into() }, "there are lighthouse, quay"),
        (store("", None), "1 to 64 bytes"),
        (store("a\nb", None), "without control characters"),
        (store(&"ä".repeat(NAME_BYTES_MAX), None), "128 bytes"),
        (store("nan", Some(place(f64::NAN))), "not finite"),
    ] {
        next.clear();
        next.request(request);
        let reply = &next.replies[0].1;
        assert!(reply.as_ref().is_err_and(|e| e.reason.contains(said)), "{reply:?}");
    }
    for index in 0..STORED_VIEWS_MAX {
        next.clear();
        next.request(store(&format!("view {index}"), None));
        assert_eq!(next.replies[0].1.is_err(), index + 2 >= STORED_VIEWS_MAX, "view {index}");
    }
    next.clear();
    next.request(store("quay", None));
    assert_eq!(next.replies[0].1, Ok(Response::Done), "one that is there may be set anew");
}
