//! Rays against every triangle of a scene, one by one in the world.

use std::time::Duration;

use polyptych_scene::{Edit, NodeId, SceneEdits};
use proptest::prelude::*;

use super::*;
use crate::scene_fixture::{Stage, corner, places, soup};
use crate::triangle_cache::TriangleCache;

fn cast_twice(stage: &Stage, ray: Ray) -> Option<RayHit> {
    let cache = TriangleCache::default();
    let query = RayQuery::new(ray);
    let walk = MeshWalk::new(&stage.index, &cache, &stage.store, Duration::from_mins(1));
    let hit = cast(&walk, &query, Revision(3)).expect("a scene");
    let again = cast(&walk, &query, Revision(3)).expect("a scene");
    assert_eq!(hit, again, "what is kept answers alike");
    hit
}

/// Returns the distance along a ray to the nearest triangle, by looking at each.
fn nearest(stage: &Stage, ray: &Ray) -> Option<f64> {
    let along = |(_, [a, b, c]): (NodeId, [DVec3; 3])| {
        let normal = (b - a).cross(c - a);
        let along = (a - ray.origin).dot(normal) / ray.direction.dot(normal);
        let at = ray.at(along);
        let inside = [(a, b), (b, c), (c, a)]
            .iter()
            .all(|(from, to)| (*to - *from).cross(at - *from).dot(normal) >= 0.0);
        (along > 0.0 && inside).then_some(along)
    };
    stage.triangles().into_iter().filter_map(along).reduce(f64::min)
}

proptest! {
    #[test]
    fn rays_meet_what_every_triangle_by_itself_says(
        soup in soup(),
        places in places(),
        aims in prop::collection::vec(
            (any::<prop::sample::Index>(), prop::array::uniform3(-1.0..1.0f64)),
            20,
        ),
    ) {
        let mut edits = SceneEdits::default();
        edits.apply(Edit::SetVisible { node: NodeId(0), visible: places.len() == 1 });
        let stage = Stage::new(&soup, &places, edits);
        let triangles = stage.triangles();
        for (at, off) in aims {
            // Towards a triangle, from somewhere near it.
            let (_, [a, b, c]) = triangles[at.index(triangles.len())];
            let off = DVec3::from(off);
            let origin = a + off * 40.0;
            let ray = Ray { origin, direction: ((a + b + c) / 3.0 - origin) * 0.01 };
            let (found, due) = (cast_twice(&stage, ray), nearest(&stage, &ray));
            let length = ray.direction.length();
            let (got, due) = (found.map(|hit| hit.distance), due.map(|along| along * length));
            // On the very edge of a triangle either answer is right.
            let is_same = match (got, due) {
                (Some(got), Some(due)) => (got - due).abs() < 1e-6 * (1.0 + due),
                (got, due) => got.is_none() == due.is_none(),
            };
            let moved = Ray { origin: origin + DVec3::splat(1e-7), ..ray };
            let is_edge = || nearest(&stage, &moved).is_some() != due.is_some();
            prop_assert!(is_same || is_edge(), "{got:?} instead of {due:?}");
        }
    }
}

#[test]
fn a_hit_says_what_it_is_and_rays_that_are_none_are_refused() {
    let triangle = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]].map(corner);
    let mirrored = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    for (place, x) in [(DAffine3::IDENTITY, 10.0), (mirrored, -10.0)] {
        let far = DAffine3::from_translation(DVec3::Y * 1e6);
        let stage = Stage::new(&[triangle], &[place, far], SceneEdits::default());
        let ray = Ray { origin: DVec3::new(x, 0.0, 5.0), direction: DVec3::NEG_Z * 2.0 };
        let hit = cast_twice(&stage, ray).expect("met");
        assert_eq!((hit.node, hit.distance, hit.is_front), (NodeId(0), 5.0, true), "{place}");
        assert_eq!((hit.position, hit.normal), (DVec3::new(x, 0.0, 0.0), DVec3::Z));
        let behind = Ray { origin: DVec3::new(x, 0.0, -5.0), direction: DVec3::Z };
        assert!(!cast_twice(&stage, behind).expect("met").is_front);
        let (cache, revision) = (TriangleCache::default(), Revision(1));
        let walk = MeshWalk::new(&stage.index, &cache, &stage.store, Duration::from_mins(1));
        let ask = |ray, max_distance| {
            cast(&walk, &RayQuery { max_distance, ..RayQuery::new(ray) }, revision)
        };
        assert_eq!(ask(ray, Some(4.9)), Ok(None));
        assert!(ask(ray, Some(5.0)).expect("a ray").is_some());
        let nan = DVec3::splat(f64::NAN);
        for (ray, max) in [
            (Ray { origin: nan, ..ray }, None),
            (Ray { direction: nan, ..ray }, None),
            (Ray { direction: DVec3::ZERO, ..ray }, None),
            (ray, Some(-1.0)),
            (ray, Some(f64::NAN)),
        ] {
            assert!(ask(ray, max).is_err(), "{ray:?} {max:?}");
        }
    }
}

#[test]
fn a_ray_along_the_sides_of_boxes_meets_what_is_in_them() {
    let [a, b, c, d] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let flat = |[x, z]: [f32; 2]| corner([x, 0.0, z]);
    let square = [[a, b, c].map(flat), [a, c, d].map(flat)];
    let places = [0.0, -1.0, 1e6].map(|x| DAffine3::from_translation(DVec3::X * x));
    let stage = Stage::new(&square, &places, SceneEdits::default());
    // Two squares that meet at 10: their sides, corners and the seam between them.
    for x in [9.0, 9.5, 10.0, 10.5, 11.0] {
        for z in [0.0, 0.5, 1.0] {
            for (y, direction) in [(5.0, DVec3::NEG_Y), (-5.0, DVec3::Y)] {
                let ray = Ray { origin: DVec3::new(x, y, z), direction };
                let hit = cast_twice(&stage, ray);
                assert_eq!(hit.map(|hit| hit.distance), Some(5.0), "{ray:?}");
            }
        }
    }
    let beside = Ray { origin: DVec3::new(11.001, 5.0, 0.5), direction: DVec3::NEG_Y };
    assert_eq!(cast_twice(&stage, beside), None);
}

#[test]
fn gives_up_a_ray_that_takes_longer_than_a_question_may() {
    let triangle = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]].map(corner);
    let far = DAffine3::from_translation(DVec3::Y * 1e6);
    let stage = Stage::new(&[triangle], &[DAffine3::IDENTITY, far], SceneEdits::default());
    let cache = TriangleCache::default();
    let walk = MeshWalk::new(&stage.index, &cache, &stage.store, Duration::ZERO);
    let ray = Ray { origin: DVec3::new(10.0, 0.0, 5.0), direction: DVec3::NEG_Z };
    let late = cast(&walk, &RayQuery::new(ray), Revision(1)).expect_err("late");
    assert!(late.contains("given up after 0 s"), "{late}");
}
