//! Nearest points against every triangle of a scene, one by one in the world.

use std::time::Duration;

use polyptych_scene::{Edit, NodeId, SceneEdits};
use polyptych_wall::region::{Region, RegionTest};
use proptest::prelude::*;

use super::*;
use crate::scene_fixture::{Stage, corner, places, soup};
use crate::triangle_cache::TriangleCache;

fn ask(stage: &Stage, point: DVec3, within: Option<f64>) -> Result<Option<NearestPoint>, String> {
    let cache = TriangleCache::default();
    let walk = MeshWalk::new(&stage.index, &cache, &stage.store, Duration::from_mins(1));
    nearest(&walk, &NearestQuery { point, within }, Revision(3))
}

proptest! {
    #[test]
    fn nearest_points_are_what_every_triangle_by_itself_says(
        soup in soup(),
        places in places(),
        aims in prop::collection::vec(
            (any::<prop::sample::Index>(), prop::array::uniform3(-1.0..1.0f64), -20.0..12.0f64),
            20,
        ),
    ) {
        let mut edits = SceneEdits::default();
        edits.apply(Edit::SetVisible { node: NodeId(0), visible: places.len() == 1 });
        let mut soup = soup;
        let [a, b, _] = soup[0];
        soup.extend([[a, b, a], [b, b, b]]);
        let stage = Stage::new(&soup, &places, edits);
        let triangles = stage.triangles();
        for (at, off, far) in aims {
            let (_, [corner, ..]) = triangles[at.index(triangles.len())];
            let point = corner + DVec3::from(off) * far.exp2();
            let found = ask(&stage, point, None).expect("asked").expect("there are triangles");
            let of = |corners: &[DVec3; 3]| nearest_on_triangle(point, corners).distance(point);
            let due = triangles.iter().map(|(_, corners)| of(corners));
            let due = due.fold(f64::INFINITY, f64::min);
            prop_assert_eq!(found.distance, due);
            prop_assert_eq!(found.position.distance(point), due);
            let here = Region::Sphere { center: found.position, radius: 1e-9 * (1.0 + due) };
            let here = RegionTest::new(&here).expect("a region");
            let mut own = triangles.iter().filter(|(id, _)| *id == found.node);
            let is_own = own.any(|(_, corners)| here.touches(corners));
            prop_assert!(is_own, "on a triangle of its node");
            prop_assert_eq!(ask(&stage, point, Some(due)).expect("asked"), Some(found));
            if due > 0.0 {
                prop_assert_eq!(ask(&stage, point, Some(due.next_down())), Ok(None));
            }
        }
    }
}

#[test]
fn points_that_are_none_are_refused() {
    let triangle = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]].map(corner);
    let far = DAffine3::from_translation(DVec3::Y * 1e6);
    let stage = Stage::new(&[triangle], &[DAffine3::IDENTITY, far], SceneEdits::default());
    let found = ask(&stage, DVec3::new(10.0, 0.0, 5.0), None).expect("asked").expect("near");
    assert_eq!((found.node, found.distance, found.revision), (NodeId(0), 5.0, Revision(3)));
    assert_eq!(found.position, DVec3::new(10.0, 0.0, 0.0));
    assert_eq!(ask(&stage, DVec3::new(10.0, 0.0, 5.0), Some(4.9)), Ok(None));
    for (point, within, said) in [
        (DVec3::NAN, None, "the point is [NaN"),
        (DVec3::new(0.0, f64::NAN, 0.0), None, "the point is [0, NaN, 0]"),
        (DVec3::INFINITY, None, "give three finite numbers"),
        (DVec3::ZERO, Some(-1.0), "may be -1 away"),
        (DVec3::ZERO, Some(f64::NAN), "may be NaN away"),
    ] {
        let refused = ask(&stage, point, within).expect_err("refused");
        assert!(refused.contains(said), "{refused}");
    }
}
