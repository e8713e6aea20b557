//! Ways through scenes of which every triangle is looked at by itself.

use std::time::Duration;

use glam::{DAffine3, Vec3};
use polyptych_scene::SceneEdits;
use polyptych_wall::triangle_distance::nearest_on_triangle;
use proptest::prelude::*;

use super::*;
use crate::scene_fixture::{Stage, corner, soup};
use crate::triangle_cache::TriangleCache;

/// One place, so that the scene of the fixture has its mesh there and twice by instances.
const PLACE: DAffine3 = DAffine3::IDENTITY;

fn ask(stage: &Stage, query: &WalkQuery) -> Result<WalkedWay, String> {
    let cache = TriangleCache::default();
    let meshes = MeshWalk::new(&stage.index, &cache, &stage.store, Duration::from_mins(1));
    walk(&(&meshes, Revision(3)), query, Revision(3))
}

/// A rectangle of two triangles.
fn rectangle(corners: [[f32; 3]; 4]) -> [[Vec3; 3]; 2] {
    let [a, b, c, d] = corners.map(corner);
    [[a, b, c], [a, c, d]]
}

fn level(low: [f32; 2], high: [f32; 2], y: f32) -> [[Vec3; 3]; 2] {
    let ([x0, z0], [x1, z1]) = (low, high);
    rectangle([[x0, y, z0], [x0, y, z1], [x1, y, z1], [x1, y, z0]])
}

fn upright(x: f32, z: [f32; 2], y: [f32; 2]) -> [[Vec3; 3]; 2] {
    let ([z0, z1], [y0, y1]) = (z, y);
    rectangle([[x, y0, z0], [x, y0, z1], [x, y1, z1], [x, y1, z0]])
}

/// The fixture's mesh stands at 10, 0, 0, and copies of it where the walkers here do not come.
fn stage(parts: &[[[Vec3; 3]; 2]]) -> Stage {
    let away = DAffine3::from_translation(DVec3::Y * 1e5);
    Stage::new(&parts.concat(), &[PLACE, away], SceneEdits::default())
}

fn at(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(10.0 + x, y, z)
}

const PERSON: Walker = Walker { eye_height: Some(1.7), radius: Some(0.3), step_height: 0.4 };
const BIRD: Walker = Walker { eye_height: None, radius: Some(0.3), step_height: 0.0 };

fn way(stage: &Stage, walker: Walker, way: &[DVec3]) -> WalkedWay {
    ask(stage, &WalkQuery { way: way.to_vec(), walker }).expect("asked")
}

#[test]
fn a_person_keeps_the_height_and_stops_before_a_wall() {
    let ground = level([-20.0, -20.0], [20.0, 20.0], 2.0);
    let stage = stage(&[ground, upright(5.0, [-9.0, 9.0], [0.0, 9.0])]);
    let walked = way(&stage, PERSON, &[at(0.0, 8.0, 0.0), at(9.0, 0.0, 0.0)]);
    let [first, last] = walked.points[..] else { panic!("a straight way: {walked:?}") };
    assert!(first.distance(at(0.0, 3.7, 0.0)) < 1e-9, "{first}");
    assert!(last.distance(at(4.7, 3.7, 0.0)) < 1e-3, "{last}");
    let WalkEnd::Obstacle(touched) = walked.end else { panic!("{:?}", walked.end) };
    assert!((touched.position.x - 15.0).abs() < 1e-9, "{touched:?}");
    // Along the wall the way is free, and away from it.
    let along = way(&stage, PERSON, &[last, at(4.7, 0.0, 5.0), at(0.0, 0.0, 5.0)]);
    assert_eq!(along.end, WalkEnd::Arrived);
    // Who passes through walls does.
    let ghost = Walker { radius: None, ..PERSON };
    let through = way(&stage, ghost, &[at(0.0, 8.0, 0.0), at(9.0, 0.0, 0.0)]);
    assert_eq!((through.end, through.points.len()), (WalkEnd::Arrived, 2));
}

#[test]
fn steps_and_a_slope_are_walked_and_what_is_higher_is_not() {
    let low = level([-9.0, -9.0], [0.0, 9.0], 0.0);
    let high = level([0.0, -9.0], [5.0, 9.0], 0.35);
    let slope = rectangle([[5.0, 0.35, -9.0], [5.0, 0.35, 9.0], [9.0, 3.0, 9.0], [9.0, 3.0, -9.0]]);
    let riser = upright(0.0, [-9.0, 9.0], [0.0, 0.35]);
    let stage = stage(&[low, high, slope, riser]);
    let up = way(&stage, PERSON, &[at(-5.0, 4.0, 0.0), at(8.5, 0.0, 1.0)]);
    assert_eq!(up.end, WalkEnd::Arrived, "{up:?}");
    let due = 0.35 + 3.5 / 4.0 * 2.65 + 1.7;
    assert!((up.points.last().expect("some").y - due).abs() < 1e-6, "{up:?}");
    // Beyond the ground there is none.
    let off = way(&stage, PERSON, &[at(-5.0, 4.0, 0.0), at(-12.0, 0.0, 0.0)]);
    assert_eq!(off.end, WalkEnd::NoGround);
    assert!((off.points.last().expect("some").x - 1.0).abs() < 0.11, "{off:?}");
    // What can be stepped on can be stepped down from, and not by one who takes lower steps.
    let down = [at(3.0, 4.0, 0.0), at(-5.0, 0.0, 0.0)];
    assert_eq!(way(&stage, PERSON, &down).end, WalkEnd::Arrived);
    let careful = Walker { step_height: 0.2, ..PERSON };
    assert!(matches!(way(&stage, careful, &down).end, WalkEnd::Fall(_)));
    let back = [down[1] + DVec3::Y * 4.0, down[0]];
    let end = way(&stage, Walker { radius: None, ..careful }, &back).end;
    assert!(matches!(end, WalkEnd::Rise(_)), "{end:?}");
}

#[test]
fn a_low_fence_and_a_low_ceiling_stop_a_person() {
    let ground = level([-20.0, -20.0], [20.0, 20.0], 0.0);
    // Thinner than a step, and below the eye.
    let fence = upright(3.001, [-9.0, 9.0], [0.0, 1.0]);
    let fenced = stage(&[ground, fence]);
    let to = [at(0.0, 1.0, 0.0), at(9.0, 0.0, 0.0)];
    let walked = way(&fenced, PERSON, &to);
    let WalkEnd::Obstacle(touched) = &walked.end else { panic!("{:?}", walked.end) };
    assert!((touched.position.x - 13.001).abs() < 1e-6);
    let ceiled = stage(&[ground, level([3.0, -9.0], [9.0, 9.0], 1.8)]);
    let walked = way(&ceiled, PERSON, &to);
    assert!(matches!(walked.end, WalkEnd::Obstacle(_)), "{:?}", walked.end);
    assert!(walked.points.last().expect("some").x < 13.0);
}

#[test]
fn what_is_no_way_is_refused() {
    let stage = stage(&[level([-1.0, -1.0], [1.0, 1.0], 0.0)]);
    let to = vec![at(0.0, 1.0, 0.0), at(0.5, 0.0, 0.0)];
    let refused = |way: &[DVec3], walker| {
        ask(&stage, &WalkQuery { way: way.to_vec(), walker }).expect_err("refused")
    };
    let nobody = Walker { eye_height: None, radius: None, step_height: 0.0 };
    assert!(refused(&to, nobody).contains("stopped by nothing"));
    assert!(refused(&to[..1], PERSON).contains("2 to 4096 points, not 1"));
    assert!(refused(&vec![to[0]; WAY_POINTS_MAX + 1], PERSON).contains("not 4097"));
    assert!(refused(&[to[0], DVec3::NAN], PERSON).contains("NaN"));
    assert!(refused(&[to[0], DVec3::INFINITY], PERSON).contains("finite"));
    for wrong in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let said = refused(&to, Walker { eye_height: Some(wrong), ..PERSON });
        assert!(said.contains("height is above 0"), "{said}");
        let said = refused(&to, Walker { radius: Some(wrong), ..PERSON });
        assert!(said.contains("radius is above 0"), "{said}");
    }
    assert!(refused(&to, Walker { radius: Some(2.0), ..PERSON }).contains("below the eye"));
    assert!(refused(&to, Walker { step_height: 2.0, ..PERSON }).contains("highest step"));
    assert!(refused(&to, Walker { step_height: f64::NAN, ..PERSON }).contains("highest step"));
    // Nothing below: it is said, and no error.
    let off = way(&stage, PERSON, &[at(5.0, 1.0, 0.0), at(0.0, 0.0, 0.0)]);
    assert_eq!((off.end, off.points.len()), (WalkEnd::NoGround, 1));
}

proptest! {
    #[test]
    fn nobody_passes_through_a_triangle_or_comes_nearer_than_allowed(
        soup in soup(),
        goals in prop::collection::vec(prop::array::uniform3(-3.0..3.0f64), 1..4),
    ) {
        let stage = Stage::new(&soup, &[PLACE], SceneEdits::default());
        let triangles = stage.triangles();
        let distance = |point: DVec3| {
            let of = |(_, corners): &(_, [DVec3; 3])| {
                nearest_on_triangle(point, corners).distance(point)
            };
            triangles.iter().map(of).fold(f64::INFINITY, f64::min)
        };
        let mut asked = vec![at(0.0, 6.0, 0.0)];
        asked.extend(goals.iter().map(|goal| at(goal[0], goal[1], goal[2])));
        let walked = way(&stage, BIRD, &asked);
        // Straight lines may cut corners by a tenth of the radius, and steps by a thirtieth.
        let least = distance(asked[0]).min(0.3) - 0.04;
        for pair in walked.points.windows(2) {
            for part in 0..=20 {
                let point = pair[0].lerp(pair[1], f64::from(part) / 20.0);
                prop_assert!(distance(point) >= least, "{point} is {} away", distance(point));
            }
        }
        let last = *walked.points.last().expect("a point");
        match walked.end {
            WalkEnd::Arrived => prop_assert!(last.distance(asked[asked.len() - 1]) < 1e-6),
            WalkEnd::Obstacle(touched) => {
                // Nearer only where it began nearer.
                prop_assert!(touched.position.distance(last) < 0.301);
            }
            end => prop_assert!(false, "{end:?}"),
        }
    }
}
