//! Tours reach their stops exactly, go on without jumps, and have no bad numbers.

use glam::DQuat;
use proptest::prelude::*;

use super::*;

const EYE: DVec3 = DVec3::new(0.2, 1.6, 0.5);

fn camera(x: f64, y: f64, heading: f64, scale: f64) -> Camera {
    let rotation = DQuat::from_rotation_y(heading);
    Camera { position: DVec3::new(x, y, x - y), rotation, scale }
}

fn tour(is_loop: bool) -> Tour {
    let stops = vec![
        TourStop::new(camera(10.0, 0.0, 0.5, 1.0), 2.0),
        TourStop::new(camera(20.0, 8.0, 2.5, 10.0), 3.0),
        TourStop::new(camera(25.0, -3.0, -2.5, 0.1), 1.0).with_stay(0.5),
        TourStop::new(camera(0.0, 1.0, 0.0, 0.1), 4.0).with_easing(Easing::Linear),
    ];
    Tour { stops, is_loop }
}

fn eye_of(camera: &Camera) -> DVec3 {
    camera.world_from_display(EYE)
}

#[test]
fn a_stop_is_reached_bit_for_bit_and_kept_for_its_stay() {
    let from = Camera::IDENTITY;
    for is_loop in [false, true] {
        let tour = tour(is_loop);
        let at = |time_s: f64| tour.camera_at(&from, EYE, time_s);
        assert_eq!((at(0.0), at(-1.0), at(f64::NAN)), (from, from, from));
        for (time_s, stop) in [(2.0, 0), (5.0, 1), (6.0, 2), (6.25, 2), (6.5, 2)] {
            assert_eq!(at(time_s), tour.stops[stop].camera, "at {time_s} s");
        }
        let last = tour.stops[3].camera;
        assert_eq!(at(10.5), last);
        assert_eq!(tour.round_s(), 10.5);
        if is_loop {
            assert_eq!((at(12.5), at(23.0)), (tour.stops[0].camera, tour.stops[0].camera));
            assert!(at(1e300).fault().is_none() && !tour.is_over(1e300));
            assert_ne!(at(11.0), at(0.5), "the second round begins at the last stop");
            assert_eq!(at(21.5), at(32.0), "the third is as the second, and those after it");
        } else {
            assert_eq!((at(11.0), at(f64::INFINITY)), (last, last));
            assert!(tour.is_over(10.5) && !tour.is_over(10.4));
        }
    }
}

#[test]
fn a_linear_travel_is_straight_and_even_for_the_eye() {
    let from = camera(1.0, 2.0, 0.0, 1.0);
    let to = camera(-7.0, 4.0, 3.0, 4.0);
    let stop = TourStop::new(to, 8.0).with_easing(Easing::Linear);
    let tour = Tour { stops: vec![stop], is_loop: false };
    for quarter in 0..=4 {
        let camera = tour.camera_at(&from, EYE, f64::from(quarter) * 2.0);
        let expected = eye_of(&from).lerp(eye_of(&to), f64::from(quarter) / 4.0);
        assert!(eye_of(&camera).distance(expected) < 1e-12, "after {quarter} quarters");
    }
    let half = tour.camera_at(&from, EYE, 4.0);
    assert!((half.scale - 2.0).abs() < 1e-12, "the scale goes in its logarithm: {}", half.scale);
    assert!(half.rotation.angle_between(DQuat::from_rotation_y(1.5)) < 1e-7);
}

#[test]
fn the_shortest_way_is_turned() {
    let from = camera(0.0, 0.0, 0.1, 1.0);
    let mut to = camera(0.0, 0.0, -0.1, 1.0);
    to.rotation = -to.rotation;
    let tour = Tour { stops: vec![TourStop::new(to, 1.0)], is_loop: false };
    for step in 0..=10 {
        let camera = tour.camera_at(&from, DVec3::ZERO, f64::from(step) / 10.0);
        let away = camera.rotation.angle_between(DQuat::IDENTITY);
        assert!(away < 0.1001, "{away} rad off the way");
    }
}

#[test]
fn the_view_turns_through_a_stop_without_a_jerk_and_the_shortest_way_to_it() {
    let rotations = [[0.0, 0.0, 0.0], [0.9, 0.2, 0.0], [1.2, -0.7, 0.4], [3.0, 0.1, -0.3]];
    let stops = rotations.iter().zip([0.0, 4.0, 11.0, 13.0]).map(|([y, x, z], at)| {
        let rotation = DQuat::from_euler(glam::EulerRot::YXZ, *y, *x, *z);
        TourStop::new(Camera { rotation, ..camera(at, at * 0.5, 0.0, 1.0) }, 2.0)
    });
    let tour = Tour { stops: stops.collect(), is_loop: true };
    let at = |time_s: f64| tour.camera_at(&Camera::IDENTITY, EYE, time_s).rotation;
    let step = 1e-5;
    // About the axes of the world, in radians a second.
    let speed = |time_s: f64| {
        let turn = at(time_s + step) * at(time_s - step).inverse();
        let turn = if turn.w < 0.0 { -turn } else { turn };
        turn.to_scaled_axis() / (2.0 * step)
    };
    for stop in [12.0, 14.0, 16.0, 18.0] {
        let (before, after) = (speed(stop - 2.0 * step), speed(stop + 2.0 * step));
        assert!(before.length() > 0.1, "it goes on turning at {stop} s: {before}");
        assert!(before.distance(after) < 0.01, "no jerk at {stop} s: {before}, {after}");
    }
    // Between stops it stays near the straight turn from the one to the other.
    for (from, to) in [(12.0, 14.0), (14.0, 16.0), (16.0, 18.0)] {
        let whole = at(from).angle_between(at(to));
        for tenth in 1..10 {
            let now = at(from + (to - from) * f64::from(tenth) / 10.0);
            let way = at(from).angle_between(now) + now.angle_between(at(to));
            assert!(way < 1.3 * whole, "{way} rad where {whole} are needed");
        }
    }
}

#[test]
fn the_eye_passes_a_stop_without_a_stay_at_one_speed_and_rests_at_others() {
    let (tour, from) = (tour(true), Camera::IDENTITY);
    let speed = |time_s: f64| {
        let step = 1e-5;
        let [before, after] = [time_s - step, time_s + step].map(|time_s| {
            let eyes = [time_s - step, time_s + step];
            let eyes = eyes.map(|time_s| eye_of(&tour.camera_at(&from, EYE, time_s)));
            (eyes[1] - eyes[0]) / (2.0 * step)
        });
        (before, after)
    };
    for time_s in [2.0, 5.0] {
        let (before, after) = speed(time_s);
        assert!(before.length() > 1.0, "it goes on at {time_s} s: {before}");
        assert!(before.distance(after) < 0.01, "no jerk at {time_s} s: {before}, {after}");
    }
    for time_s in [0.0, 6.0, 6.5] {
        let (before, after) = speed(time_s);
        let slower = before.length().min(after.length());
        assert!(slower < 0.01, "rest at {time_s} s: {before}, {after}");
    }
}

#[test]
fn a_travel_without_time_is_a_cut() {
    let stops = vec![
        TourStop::new(camera(5.0, 5.0, 1.0, 2.0), 0.0).with_stay(1.0),
        TourStop::new(camera(9.0, 5.0, 1.0, 2.0), 0.0),
        TourStop::new(camera(12.0, 5.0, 1.0, 2.0), 2.0),
    ];
    let tour = Tour { stops, is_loop: false };
    let at = |time_s| tour.camera_at(&Camera::IDENTITY, EYE, time_s);
    assert_eq!((at(0.0), at(0.999)), (tour.stops[0].camera, tour.stops[0].camera));
    assert_eq!((at(1.0), at(3.0)), (tour.stops[1].camera, tour.stops[2].camera));
}

#[test]
fn what_is_no_tour_is_refused_by_its_stop() {
    let refused = |change: &dyn Fn(&mut Tour)| {
        let mut tour = tour(false);
        change(&mut tour);
        tour.validate().expect_err("refused").to_string()
    };
    assert_eq!(tour(false).validate(), Ok(()));
    assert_eq!(refused(&|tour| tour.stops.clear()), "a tour has 1 to 4096 stops, not 0");
    let many = |tour: &mut Tour| tour.stops = vec![tour.stops[0]; TOUR_STOPS_MAX + 1];
    assert!(refused(&many).contains("not 4097"));
    for bad in [f64::NAN, f64::INFINITY, -0.5, 1e9] {
        let said = refused(&|tour| tour.stops[1].travel_s = bad);
        assert!(said.starts_with("stop 1: the seconds of its travel"), "{said}");
        let said = refused(&|tour| tour.stops[2].stay_s = bad);
        assert!(said.starts_with("stop 2: the seconds of its stay"), "{said}");
    }
    for bad in [f64::NAN, 0.0, -1.0, 1e200] {
        let said = refused(&|tour| tour.stops[3].camera.scale = bad);
        assert!(said.starts_with("stop 3: camera scale"), "{said}");
    }
    let said = refused(&|tour| tour.stops[0].camera.position.y = 1e200);
    assert!(said.starts_with("stop 0: camera position"), "{said}");
    let still = |tour: &mut Tour| {
        tour.stops = vec![TourStop::new(Camera::IDENTITY, 0.0)];
        tour.is_loop = true;
    };
    assert!(refused(&still).contains("takes 0 seconds"));
}

fn any_camera() -> impl Strategy<Value = Camera> {
    let place = prop_oneof![-10.0..10.0_f64, Just(0.0), -1e7..1e7_f64, Just(REACH_MAX)];
    let angles = (-4.0..4.0_f64, -1.6..1.6_f64);
    (place.clone(), place, angles, -12.0..12.0_f64).prop_map(|(x, y, (heading, pitch), scale)| {
        let mut camera = camera(x, y, heading, 10.0_f64.powf(scale));
        camera.position.z = x.min(1e50) * 0.5;
        camera.rotation *= DQuat::from_rotation_x(pitch);
        camera
    })
}

fn any_tour() -> impl Strategy<Value = Tour> {
    let seconds = prop_oneof![Just(0.0), 0.01..5.0_f64, Just(TOUR_SECONDS_MAX)];
    let easing = prop_oneof![Just(Easing::Smooth), Just(Easing::Linear)];
    let stop = (any_camera(), seconds.clone(), seconds, easing);
    let stop = stop.prop_map(|(camera, travel_s, stay_s, easing)| TourStop {
        camera,
        travel_s,
        stay_s,
        easing,
    });
    let tour = (prop::collection::vec(stop, 1..6), any::<bool>());
    tour.prop_map(|(stops, is_loop)| Tour { stops, is_loop })
}

proptest! {
    #[test]
    fn every_camera_of_a_valid_tour_is_valid(
        tour in any_tour(),
        from in any_camera(),
        share in prop_oneof![-0.5..4.0_f64, Just(f64::MAX)],
    ) {
        prop_assume!(tour.validate().is_ok());
        let camera = tour.camera_at(&from, EYE, share * tour.round_s().max(1.0));
        prop_assert_eq!(camera.fault(), None);
    }

    #[test]
    fn every_stop_is_reached_at_its_time(tour in any_tour(), from in any_camera()) {
        let mut time_s = 0.0;
        for (index, stop) in tour.stops.iter().enumerate() {
            time_s += stop.travel_s;
            let next = tour.stops.get(index + 1);
            let is_seen = stop.stay_s > 0.0 || next.is_none_or(|next| next.travel_s > 0.0);
            // A loop has no end at which its last stop would be seen.
            if is_seen && !(tour.is_loop && time_s >= tour.round_s()) {
                prop_assert_eq!(tour.camera_at(&from, EYE, time_s), stop.camera);
            }
            time_s += stop.stay_s;
        }
    }

    #[test]
    fn a_small_step_of_time_is_a_small_step_of_the_eye(
        places in prop::collection::vec((-9.0..9.0_f64, -9.0..9.0_f64, -3.0..3.0_f64), 2..6),
        time_s in 0.0..12.0_f64,
        is_loop: bool,
    ) {
        let place = |&(x, y, heading): &(f64, f64, f64)| camera(x, y, heading, 1.0);
        let stops = places.iter().map(place).map(|camera| TourStop::new(camera, 1.5));
        let tour = Tour { stops: stops.collect(), is_loop };
        let from = tour.stops[0].camera;
        let [now, then] = [time_s, time_s + 1e-6].map(|time_s| tour.camera_at(&from, EYE, time_s));
        // Stops are at most 40 away from each other, in 1.5 s, and no easing is 8 times as fast.
        prop_assert!(eye_of(&now).distance(eye_of(&then)) < 1e-6 * 8.0 * 40.0 / 1.5 + 1e-9);
        prop_assert!(now.rotation.angle_between(then.rotation) < 1e-4);
    }

    #[test]
    fn a_travel_never_goes_back(x in 0.1..9.0_f64, seconds in 0.1..9.0_f64, next in 0.1..9.0_f64) {
        let place = |x: f64| Camera { position: DVec3::X * x, ..Camera::IDENTITY };
        let stops = vec![TourStop::new(place(x), seconds), TourStop::new(place(x + 5.0), next)];
        let tour = Tour { stops, is_loop: false };
        let mut last = 0.0;
        for step in 0..=200 {
            let time_s = f64::from(step) / 200.0 * tour.round_s();
            let now = tour.camera_at(&Camera::IDENTITY, EYE, time_s).position.x;
            prop_assert!(now >= last - 1e-9, "back from {} to {}", last, now);
            last = now;
        }
        prop_assert!((last - x - 5.0).abs() < 1e-9);
    }
}
