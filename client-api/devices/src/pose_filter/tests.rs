//! The head over time, by a clock of the test.

use fastrand::Rng;
use glam::{DQuat, DVec3};
use polyptych_wall::device::HeadInput;

use super::*;

/// Readings of a tracker at 120 Hz.
const PERIOD: Micros = 8_333;

fn tracking() -> HeadTracking {
    HeadTracking {
        input: HeadInput::Vrpn { tracker: "t".into(), sensor: 0 },
        mount: DQuat::IDENTITY,
        eyes: DVec3::ZERO,
        prediction_ms: 0,
        speed_max: 5.0,
        jump_m: 0.3,
        hold_ms: 2000,
        ease_ms: 1000,
        bounds: None,
    }
}

fn at(x: f64) -> HeadSample {
    HeadSample { position: DVec3::new(x, 1.6, 0.0), rotation: DQuat::IDENTITY }
}

fn filter(tracking: HeadTracking) -> PoseFilter {
    PoseFilter::new(tracking, 500, at(0.0))
}

/// Feeds `place` for so long; gives the time after it.
fn feed(filter: &mut PoseFilter, from: Micros, length: Micros, place: HeadSample) -> Micros {
    let mut now = from;
    while now < from + length {
        filter.add(now, place);
        now += PERIOD;
    }
    now
}

fn seen(filter: &mut PoseFilter, now: Micros) -> f64 {
    filter.advance(now);
    filter.pose(now).position.x
}

#[test]
fn a_reading_moves_the_head_at_once_when_it_is_tracked_and_eased_before() {
    let mut filter = filter(tracking());
    assert!(filter.add(0, at(0.5)));
    assert_eq!(filter.take_events(), [FilterEvent::Tracked]);
    assert_eq!(seen(&mut filter, 0), 0.0, "it begins where the head was");
    let now = feed(&mut filter, PERIOD, 1_100_000, at(0.5));
    assert_eq!(seen(&mut filter, now), 0.5);
    assert!(filter.add(now, at(0.52)));
    assert_eq!(seen(&mut filter, now), 0.52);
}

#[test]
fn constant_velocities_are_predicted_as_far_as_asked_and_not_faster_than_heads() {
    let mut filter = filter(HeadTracking { prediction_ms: 40, ..tracking() });
    let turn = |now: Micros| DQuat::from_rotation_y(2.0 * seconds(now));
    let mut now = 0;
    while now < 2_000_000 {
        filter.add(now, HeadSample { rotation: turn(now), ..at(1.5 * seconds(now)) });
        now += PERIOD;
    }
    let ahead = now + 40_000;
    filter.advance(now);
    let pose = filter.pose(now);
    assert!((pose.position.x - 1.5 * seconds(ahead)).abs() < 1e-9, "{pose:?}");
    assert!(pose.rotation.dot(turn(ahead)).abs() > 1.0 - 1e-12, "{pose:?}");
    // Noise of 0.2 m within a span would be 4 m/s and more.
    filter.add(now, at(3.2));
    let far = filter.pose(now).position.x;
    assert!(far <= 3.2 + 5.0 * 0.04 + 1e-9, "{far}");
    // A gap is bridged for a while only.
    let stopped = [now + 60_000, now + 400_000].map(|now| filter.pose(now).position.x);
    assert_eq!(stopped[0], stopped[1]);
}

#[test]
fn a_moving_head_that_is_lost_or_jumps_does_not_leap_ahead() {
    for is_lost in [true, false] {
        let mut filter = filter(HeadTracking { prediction_ms: 20, ..tracking() });
        let (mut now, mut shown) = (0, 0.0);
        while now < 1_500_000 {
            filter.add(now, at(seconds(now)));
            shown = seen(&mut filter, now);
            now += PERIOD;
        }
        assert!((shown - seconds(now - PERIOD) - 0.02).abs() < 1e-9, "{shown}");
        while !is_lost && !filter.add(now, at(50.0)) {
            now += PERIOD;
        }
        now += if is_lost { 500_000 } else { 0 };
        assert!((seen(&mut filter, now) - shown).abs() < 1e-9, "lost: {is_lost}");
        assert!(filter.is_moving());
    }
}

#[test]
fn a_jump_of_a_hundred_metres_is_refused_until_it_is_steady_and_then_eased() {
    let mut filter = filter(tracking());
    let mut now = feed(&mut filter, 0, 1_500_000, at(0.5));
    filter.take_events();
    assert!(!filter.add(now, at(100.0)));
    assert_eq!(filter.take_events(), [FilterEvent::Jumped { distance_m: 99.5 }]);
    assert_eq!(seen(&mut filter, now), 0.5);
    // A single reflection is forgotten.
    now = feed(&mut filter, now + PERIOD, 600_000, at(0.5));
    assert!(filter.take_events().is_empty() && seen(&mut filter, now) == 0.5);
    // Reflections all over the place are never followed, and told once.
    let mut rng = Rng::with_seed(5);
    for _ in 0..20 {
        now += PERIOD;
        assert!(!filter.add(now, at(100.0 + 1000.0 * rng.f64())));
    }
    assert_eq!(filter.take_events().len(), 1);
    assert_eq!(seen(&mut filter, now), 0.5);
    let began = now + PERIOD;
    now = feed(&mut filter, began, STEADY_TIME + 2 * PERIOD, at(10.0));
    assert_eq!(filter.take_events(), [FilterEvent::Steady]);
    // Ten metres take two seconds at least.
    let soon = feed(&mut filter, now, 1_000_000, at(10.0));
    assert!(seen(&mut filter, soon) < 5.5, "{}", seen(&mut filter, soon));
    let there = feed(&mut filter, soon, 2_000_000, at(10.0));
    assert_eq!(seen(&mut filter, there), 10.0);
}

#[test]
fn two_reflections_with_a_silence_between_them_are_not_steady() {
    let mut filter = filter(tracking());
    let now = feed(&mut filter, 0, 1_500_000, at(0.5));
    assert!(!filter.add(now + 600_000, at(20.0)));
    assert!(!filter.add(now + 1_200_000, at(20.0)));
    assert_eq!(seen(&mut filter, now + 1_200_000), 0.5, "its last pose is held");
}

#[test]
fn a_lost_head_is_held_then_eased_back_and_one_that_is_back_is_eased_in() {
    let mut filter = filter(tracking());
    let now = feed(&mut filter, 0, 1_500_000, at(0.8));
    filter.take_events();
    assert_eq!(filter.poll_timeout(), Some(now - PERIOD + 500_000));
    let lost = now - PERIOD + 500_000;
    assert_eq!(seen(&mut filter, lost - 1), 0.8);
    assert!(filter.take_events().is_empty());
    assert_eq!(seen(&mut filter, lost), 0.8);
    assert_eq!(filter.take_events(), [FilterEvent::Lost]);
    assert_eq!(filter.poll_timeout(), Some(lost + 2_000_000));
    assert_eq!(seen(&mut filter, lost + 1_999_999), 0.8, "held");
    assert_eq!(seen(&mut filter, lost + 2_000_000), 0.8);
    assert_eq!(filter.take_events(), [FilterEvent::Released]);
    let half = seen(&mut filter, lost + 2_500_000);
    assert!((half - 0.4).abs() < 1e-9, "{half}");
    // Back on the way, elsewhere.
    assert!(filter.add(lost + 2_500_000, at(-0.8)));
    assert!((seen(&mut filter, lost + 2_500_000) - half).abs() < 1e-9, "no jump");
    let now = feed(&mut filter, lost + 2_500_000, 1_100_000, at(-0.8));
    assert_eq!(seen(&mut filter, now), -0.8);
}

/// Whatever comes, the head is finite, within its bounds, and moves no faster than it may.
#[test]
fn no_readings_make_a_head_jump_or_leave_its_bounds() {
    let bounds = [DVec3::new(-2.0, 1.0, -2.0), DVec3::new(2.0, 2.0, 2.0)];
    for seed in 0..40 {
        let mut rng = Rng::with_seed(seed);
        let prediction_ms = rng.u32(0..=100);
        let tracking = HeadTracking { prediction_ms, bounds: Some(bounds), ..tracking() };
        let mut filter = filter(tracking.clone());
        let mut place = at(0.0);
        let (mut now, mut last, mut read_at) = (0, filter.pose(0), 0);
        for _ in 0..2000 {
            let step = match rng.u8(0..40) {
                0 => rng.u64(0..4_000_000),
                1 => 0,
                _ => rng.u64(500..20_000),
            };
            now += step;
            let wander = DVec3::new(rng.f64() - 0.5, rng.f64() - 0.5, rng.f64() - 0.5) * 0.05;
            place.position += wander;
            place.rotation = DQuat::from_scaled_axis(wander * 4.0) * place.rotation;
            let reading = match rng.u8(0..12) {
                0 => HeadSample { position: DVec3::splat(f64::NAN), ..place },
                1 => {
                    HeadSample { rotation: DQuat::from_xyzw(f64::INFINITY, 0.0, 0.0, 0.0), ..place }
                }
                2 => HeadSample { position: place.position * 1e5 * rng.f64(), ..place },
                _ => place,
            };
            // A device that is lost now and then.
            let since_reading = now - read_at;
            if now % 7_000_000 < 5_000_000 && filter.add(now, reading) {
                read_at = now;
            }
            filter.advance(now);
            let pose = filter.pose(now);
            assert!(pose.is_finite() && (pose.rotation.length() - 1.0).abs() < 1e-9, "{pose:?}");
            assert_eq!(pose.position, pose.position.clamp(bounds[0], bounds[1]));
            let moved_m = pose.position.distance(last.position);
            // A reading, and what it changes of the prediction.
            let ahead_s = f64::from(prediction_ms) / 1e3 + 0.05;
            let elapsed_s = seconds(since_reading.min(1_000_000)) + 2.0 * ahead_s;
            let most_m = 0.3 + 5.0 * (elapsed_s + seconds(step));
            assert!(moved_m <= most_m, "seed {seed}: {moved_m} m in {step} µs at {now}");
            last = pose;
        }
    }
}
