//! Regions against every triangle of a scene, one by one in the world.

use std::time::Duration;

use glam::{DQuat, DVec2, DVec3};
use polyptych_protocol::node_query::{NODES_MAX, NodeQuery};
use polyptych_scene::{Edit, NewNode, NodeId, SceneEdits};
use polyptych_wall::region::{HalfSpace, Region};
use proptest::prelude::*;

use super::*;
use crate::scene_fixture::{Stage, corner, places, soup};
use crate::triangle_cache::TriangleCache;

const RELATIONS: [Relation; 4] =
    [Relation::Inside, Relation::Touches, Relation::Contains, Relation::Disjoint];

fn find(stage: &Stage, region: &Region, relation: Relation) -> Result<Vec<NodeId>, String> {
    let cache = TriangleCache::default();
    let walk = MeshWalk::new(&stage.index, &cache, &stage.store, Duration::from_mins(1));
    let nodes = NodeQuery { count: NODES_MAX, ..NodeQuery::default() };
    let query = RegionQuery { region: region.clone(), relation, nodes };
    let page = find_in_region(&walk, &query, Revision(3))?;
    assert_eq!((page.revision, page.found), (Revision(3), page.nodes.len() as u64));
    Ok(page.nodes.iter().map(|node| node.id).collect())
}

/// The nodes that lie so to a region, by looking at each triangle.
fn find_by_each(stage: &Stage, region: &Region, relation: Relation) -> Vec<NodeId> {
    let test = RegionTest::new(region).expect("a region");
    let triangles = stage.triangles();
    let mut ids: Vec<NodeId> = triangles.iter().map(|(id, _)| *id).collect();
    ids.dedup();
    let query = NodeQuery { count: NODES_MAX, ..NodeQuery::default() };
    let all = stage.index.find(&query, Revision(3), |_| Ok(true)).expect("nodes").nodes;
    ids.retain(|id| {
        let mut own = triangles.iter().filter(|(of, _)| of == id).map(|(_, corners)| corners);
        match relation {
            Relation::Inside => own.all(|corners| test.holds(corners)),
            Relation::Touches => own.any(|corners| test.touches(corners)),
            Relation::Disjoint => !own.any(|corners| test.touches(corners)),
            Relation::Contains => {
                let bounds = all.iter().find(|node| node.id == *id).and_then(|node| node.bounds);
                bounds.is_some_and(|bounds| test.is_within(bounds.min, bounds.max))
            }
        }
    });
    ids
}

/// A region of each kind around a point, and a pyramid that begins there.
fn regions(at: DVec3, size: f64) -> [Region; 5] {
    let polygon = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [0.1, 0.2], [-1.0, 1.0]];
    let polygon = polygon.map(|corner| DVec2::new(at.x, at.z) + DVec2::from(corner) * size).into();
    let half = |normal: [f64; 3], reach: f64| {
        let normal = DVec3::from(normal);
        HalfSpace { normal, offset: normal.dot(at) + reach }
    };
    let around = [[1.0, 1.0, 1.0], [-1.0, -1.0, 1.0], [-1.0, 1.0, -1.0], [1.0, -1.0, -1.0]];
    let pyramid = [[1.0, 0.3, 1.0], [-1.0, 0.3, 1.0], [0.0, 1.0, 0.5], [0.0, -1.0, 0.5]];
    [
        Region::Box { min: at - size, max: at + size * 0.5 },
        Region::Sphere { center: at, radius: size },
        Region::Prism { polygon, low: at.y - size * 0.7, high: at.y + size },
        Region::Convex(around.map(|normal| half(normal, size)).into()),
        Region::Convex(pyramid.map(|normal| half(normal, 0.0)).into()),
    ]
}

/// Edits that hide a node, move one and make one, where there are several.
fn edits(count: usize) -> SceneEdits {
    let mut edits = SceneEdits::default();
    if count > 2 {
        edits.apply(Edit::SetVisible { node: NodeId(0), visible: false });
        let local = DAffine3::from_rotation_translation(DQuat::from_rotation_x(1.0), DVec3::ONE);
        edits.apply(Edit::SetTransform { node: NodeId(1), local });
        edits.apply(Edit::Remove(NodeId(2)));
        let new = NewNode { mesh: Some(0), ..NewNode::default() };
        edits.apply(Edit::Create { node: NodeId(count as u64), new: Box::new(new) });
    }
    edits
}

proptest! {
    #[test]
    fn regions_hold_what_every_triangle_by_itself_says(
        soup in soup(),
        places in places(),
        aims in prop::collection::vec(
            (any::<prop::sample::Index>(), prop::array::uniform3(-4.0..4.0f64), -2.0..9.0f64),
            8,
        ),
    ) {
        let mut soup = soup;
        // Triangles that are lines and points, too.
        let [a, b, _] = soup[0];
        soup.extend([[a, b, a], [b, b, b]]);
        let stage = Stage::new(&soup, &places, edits(places.len()));
        let triangles = stage.triangles();
        for (at, off, size) in aims {
            let (_, [corner, ..]) = triangles[at.index(triangles.len())];
            // Some begin in the corner itself.
            let at = corner + DVec3::from(off).map(|off| off.max(0.0));
            for region in regions(at, size.exp2()) {
                for relation in RELATIONS {
                    let found = find(&stage, &region, relation).expect("found");
                    let due = find_by_each(&stage, &region, relation);
                    prop_assert_eq!(found, due, "{:?} {:?}", relation, region);
                }
            }
        }
    }
}

/// A triangle of the nodes 0 and 1, from (10, 0, 0), at x = 0 and 100.
fn stage() -> Stage {
    let triangle = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]].map(corner);
    let place = |x| DAffine3::from_translation(DVec3::X * x);
    Stage::new(&[triangle], &[place(0.0), place(100.0), place(1e6)], SceneEdits::default())
}

#[test]
fn borders_touch_and_hold() {
    let stage = stage();
    let at = DVec3::new(10.0, 0.0, 0.0);
    let polygon = |z: f64| vec![at.truncate(), DVec2::new(14.0, 0.0), DVec2::new(12.0, z)];
    let above = |region: &Region, relation| {
        find(&stage, region, relation).expect("found").contains(&NodeId(0))
    };
    for (region, touches, holds) in [
        (Region::Box { min: at, max: at + DVec3::new(4.0, 4.0, 0.0) }, true, true),
        (Region::Box { min: at, max: at + DVec3::new(4.0, 4.0_f64.next_down(), 0.0) }, true, false),
        (Region::Box { min: at - 1.0, max: at }, true, false),
        (Region::Box { min: at - 1.0, max: at - 1e-12 }, false, false),
        (Region::Box { min: at + DVec3::new(2.0, 2.0, -1.0), max: at + 9.0 }, true, false),
        (Region::Box { min: at + DVec3::new(2.0, 2.0 + 1e-12, -1.0), max: at + 9.0 }, false, false),
        (Region::Sphere { center: at + DVec3::Z * 5.0, radius: 5.0 }, true, false),
        (Region::Sphere { center: at + DVec3::Z * 5.0, radius: 5.0 - 1e-12 }, false, false),
        (Region::Sphere { center: at + DVec3::Y * 2.0, radius: 20f64.sqrt() }, true, true),
        (Region::Prism { polygon: polygon(3.0), low: 0.0, high: 4.0 }, true, true),
        (Region::Prism { polygon: polygon(3.0), low: 0.0, high: 4.0 - 1e-12 }, true, false),
        (Region::Prism { polygon: polygon(-3.0), low: 4.0, high: 5.0 }, true, false),
        (Region::Prism { polygon: polygon(-3.0), low: 4.0 + 1e-12, high: 5.0 }, false, false),
    ] {
        let is = [above(&region, Relation::Touches), above(&region, Relation::Inside)];
        assert_eq!(is, [touches, holds], "{region:?}");
        assert_eq!(above(&region, Relation::Disjoint), !touches, "{region:?}");
    }
    let inner = Region::Sphere { center: at + DVec3::new(1.0, 1.0, 0.0), radius: 0.0 };
    assert_eq!(find(&stage, &inner, Relation::Contains), Ok(vec![NodeId(0)]));
    let whole = Region::Box { min: at, max: at + DVec3::new(4.0, 4.0, 0.0) };
    assert_eq!(find(&stage, &whole, Relation::Contains), Ok(vec![NodeId(0)]));
}

#[test]
fn pages_names_and_limits_are_those_of_other_questions() {
    let stage = stage();
    let cache = TriangleCache::default();
    let ask = |region: Region, nodes: NodeQuery, time_max| {
        let walk = MeshWalk::new(&stage.index, &cache, &stage.store, time_max);
        find_in_region(
            &walk,
            &RegionQuery { region, relation: Relation::Touches, nodes },
            Revision(1),
        )
    };
    let (all, long) = (Region::Sphere { center: DVec3::ZERO, radius: 1e3 }, Duration::from_mins(1));
    let nodes = NodeQuery { skip: 1, count: 5, ..NodeQuery::default() };
    let page = ask(all.clone(), nodes.clone(), long).expect("a page");
    assert_eq!((page.found, page.nodes.len(), page.nodes[0].id), (2, 1, NodeId(1)));
    let below = NodeQuery { below: Some(NodeId(0)), skip: 0, ..nodes.clone() };
    assert_eq!(ask(all.clone(), below, long).expect("a page").found, 1);
    let gone = NodeQuery { below: Some(NodeId(9)), ..nodes.clone() };
    assert!(ask(all, gone, long).expect_err("no node").contains("there is no node 9"));
    let none = Region::Sphere { center: DVec3::NAN, radius: 1.0 };
    assert!(ask(none, nodes.clone(), long).expect_err("NaN").contains("is NaN; give a finite"));
    let cut = Region::Sphere { center: DVec3::X * 10.0, radius: 1.0 };
    let late = ask(cut, nodes, Duration::ZERO).expect_err("late");
    assert!(late.contains("given up after 0 s"), "{late}");
}
