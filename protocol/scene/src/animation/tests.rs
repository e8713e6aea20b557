//! Clips against glTF's own words, and blends.

use proptest::prelude::*;

use super::*;

fn channel(path: AnimatedPath, interpolation: Interpolation, keys: &[(f32, &[f32])]) -> Channel {
    Channel {
        target: 0,
        path,
        interpolation,
        times: keys.iter().map(|(time, _)| *time).collect(),
        values: keys.iter().flat_map(|(_, values)| values.iter().copied()).collect(),
    }
}

fn at(channel: &Channel, time_s: f64) -> Vec<f64> {
    let mut value = Vec::new();
    channel.sample(time_s, &mut value);
    value
}

fn clip(channels: Vec<Channel>) -> Clip {
    Clip { name: String::new(), channels }
}

fn node(weights: usize) -> AnimatedNode {
    let (rotation, scale) = (DQuat::IDENTITY, DVec3::ONE);
    AnimatedNode { node: 0, translation: DVec3::X, rotation, scale, weights: vec![0.0; weights] }
}

fn played(clip: u32, time_s: f64, weight: f32) -> ClipTime {
    ClipTime { clip, time_s, weight }
}

#[test]
fn each_interpolation_is_as_gltf_says() {
    use AnimatedPath::{Translation, Weights};
    let (a, b) = ([1.0f32, 2.0, 3.0], [3.0f32, 2.0, 7.0]);
    let keys: [(f32, &[f32]); 2] = [(1.0, &a), (3.0, &b)];
    let step = channel(Translation, Interpolation::Step, &keys);
    let linear = channel(Translation, Interpolation::Linear, &keys);
    for (time, stepped, lined) in [
        (0.0, [1.0, 2.0, 3.0], [1.0, 2.0, 3.0]),
        (1.5, [1.0, 2.0, 3.0], [1.5, 2.0, 4.0]),
        (3.0, [3.0, 2.0, 7.0], [3.0, 2.0, 7.0]),
        (9.0, [3.0, 2.0, 7.0], [3.0, 2.0, 7.0]),
    ] {
        assert_eq!((at(&step, time), at(&linear, time)), (stepped.to_vec(), lined.to_vec()));
    }
    // In-tangent, value, out-tangent: from 0 to 1 with slopes of 1 and 2 over two seconds.
    let spline: [(f32, &[f32]); 2] = [(0.0, &[9.0, 0.0, 1.0]), (2.0, &[2.0, 1.0, 9.0])];
    let spline = channel(Weights, Interpolation::CubicSpline, &spline);
    for t in [0.0f64, 0.25, 0.5, 0.75, 1.0] {
        // Hermite's polynomial by its four conditions: p(0)=0, p'(0)=2, p(1)=1, p'(1)=4.
        let wanted = 2.0 * t - 5.0 * t * t + 4.0 * t * t * t;
        assert!((at(&spline, 2.0 * t)[0] - wanted).abs() < 1e-15, "{t}");
    }
}

#[test]
fn of_keys_at_one_time_the_last_counts() {
    let keys: [(f32, &[f32]); 4] =
        [(0.0, &[0.0; 3]), (1.0, &[1.0; 3]), (1.0, &[5.0; 3]), (2.0, &[6.0; 3])];
    let jump = channel(AnimatedPath::Scale, Interpolation::Linear, &keys);
    assert_eq!([at(&jump, 0.5)[0], at(&jump, 1.0)[0], at(&jump, 1.5)[0]], [0.5, 5.0, 5.5]);
    assert_eq!(jump.fault(0), None);
}

#[test]
fn clips_that_lie_are_refused() {
    let good: [(f32, &[f32]); 2] = [(0.0, &[0.0; 3]), (1.0, &[1.0; 3])];
    let good = channel(AnimatedPath::Scale, Interpolation::Linear, &good);
    let with = |change: &dyn Fn(&mut Channel)| {
        let mut channel = good.clone();
        change(&mut channel);
        Animations {
            clips: vec![clip(vec![channel])],
            nodes: vec![node(0)],
            ..Animations::default()
        }
        .fault(1)
    };
    assert_eq!(with(&|_| ()), None);
    assert!(with(&|of| of.times[1] = -1.0).is_some());
    assert!(with(&|of| of.times[1] = f32::NAN).is_some());
    assert!(with(&|of| of.values[2] = f32::INFINITY).is_some());
    assert!(with(&|of| of.values.truncate(2)).is_some());
    assert!(with(&|of| of.target = 1).is_some());
    assert!(with(&|of| (of.times, of.values) = (Vec::new(), Vec::new())).is_some());
    let animations =
        Animations { clips: Vec::new(), nodes: vec![node(0)], ..Animations::default() };
    assert!(animations.fault(0).is_some(), "a node that is not there");
}

#[test]
fn clips_blend_by_their_parts_and_the_rest_is_as_without() {
    let to = |x: f32| {
        let value = [x, 0.0, 0.0];
        let keys: [(f32, &[f32]); 1] = [(0.0, &value)];
        clip(vec![channel(AnimatedPath::Translation, Interpolation::Step, &keys)])
    };
    let scene =
        Animations { clips: vec![to(5.0), to(9.0)], nodes: vec![node(0)], ..Animations::default() };
    let x = |clips: &[ClipTime]| scene.pose(clips)[0].local().translation.x;
    assert_eq!(x(&[]), 1.0, "at rest");
    assert_eq!(x(&[played(0, 0.0, 1.0)]), 5.0);
    assert_eq!(x(&[played(0, 0.0, 0.25)]), 2.0);
    assert_eq!(x(&[played(0, 0.0, 1.0), played(1, 0.0, 1.0)]), 7.0);
    assert_eq!(x(&[played(0, 0.0, 0.5), played(1, 0.0, 0.25)]), 0.5 * 5.0 + 0.25 * 9.0 + 0.25);
    assert_eq!(x(&[played(7, 0.0, 1.0)]), 1.0, "no such clip");
    assert!(!scene.pose(&[])[0].is_moved && scene.pose(&[played(0, 0.0, 1.0)])[0].is_moved);
}

#[test]
fn motions_of_one_figure_are_not_played_together_unasked() {
    let of = |target: u32, path: AnimatedPath| {
        let keys: [(f32, &[f32]); 1] = [(0.0, &[0.0; 3])];
        Channel { target, ..channel(path, Interpolation::Step, &keys) }
    };
    let (walk, run) = (AnimatedPath::Translation, AnimatedPath::Translation);
    let clips = vec![
        clip(vec![]),
        clip(vec![of(0, walk)]),
        clip(vec![of(0, run), of(1, run)]),
        clip(vec![of(1, walk)]),
        clip(vec![of(0, AnimatedPath::Scale)]),
    ];
    let scene = Animations { clips, nodes: Vec::new(), ..Animations::default() };
    assert_eq!(scene.played_unasked(), [1, 3, 4]);
}

/// The rotation by an angle about an axis that is not one of the coordinates'.
fn turn(angle: f64) -> DQuat {
    DQuat::from_axis_angle(DVec3::new(0.36, 0.48, 0.8), angle)
}

proptest! {
    #[test]
    fn slerp_turns_evenly_by_the_shorter_way(
        from in -3.0..3.0f64,
        by in -3.1..3.1f64,
        t in 0.0..1.0f64,
    ) {
        let (a, b) = (turn(from), turn(from + by));
        for end in [b, -b] {
            let got = slerp(a, end, t);
            // Either sign stands for the same rotation.
            prop_assert!((got.dot(turn(from + by * t)).abs() - 1.0).abs() < 1e-14);
        }
    }

    #[test]
    fn slerp_of_nearly_equal_rotations_is_exact(angle in 0.0..1e-5f64, t in 0.0..1.0f64) {
        let got = slerp(turn(0.7), turn(0.7 + angle), t);
        let wanted = turn(0.7 + angle * t);
        prop_assert!((DVec4::from(got) - DVec4::from(wanted)).length() < 1e-15);
    }
}
