//! Moves against the scene placed from nothing.

use glam::DVec3;
use proptest::prelude::*;

use super::*;
use crate::{AssetManifests, Edit, Light, LightKind, NewNode};

/// Thirty nodes, each of which hangs from one before it, or from the scene.
fn base(parents: &[Option<u8>]) -> Scene {
    let nodes = parents.iter().zip(0u32..).map(|(parent, index)| Node {
        parent: parent.map(|parent| u32::from(parent) % index.max(1)).filter(|_| index > 0),
        local: DAffine3::from_rotation_y(f64::from(index))
            * DAffine3::from_translation(DVec3::new(1.0, 0.1, f64::from(index))),
        ..Node::default()
    });
    Scene { nodes: nodes.collect(), ..Scene::default() }
}

#[derive(Clone, Debug)]
enum Step {
    Move(u64, f64),
    Rename(u64),
    Hide(u64, bool),
    Hang(u64, u64),
    Make(u64),
}

fn step() -> impl Strategy<Value = Step> {
    let node = 0u64..34;
    prop_oneof![
        8 => (node.clone(), -9.0..9.0).prop_map(|(node, by)| Step::Move(node, by)),
        1 => node.clone().prop_map(Step::Rename),
        1 => (node.clone(), any::<bool>()).prop_map(|(node, hide)| Step::Hide(node, hide)),
        1 => (node.clone(), node.clone()).prop_map(|(node, from)| Step::Hang(node, from)),
        1 => node.prop_map(Step::Make),
    ]
}

fn apply(edits: &mut SceneEdits, step: &Step) {
    let id = NodeId;
    edits.apply(match *step {
        Step::Move(node, by) => {
            let local = DAffine3::from_rotation_x(by) * DAffine3::from_translation(DVec3::X * by);
            Edit::SetTransform { node: id(node), local }
        }
        Step::Rename(node) => Edit::SetName { node: id(node), name: "new".into() },
        Step::Hide(node, hide) => Edit::SetVisible { node: id(node), visible: !hide },
        Step::Hang(node, from) => Edit::SetParent { node: id(node), parent: Some(id(from)) },
        Step::Make(from) => {
            let new = NewNode { parent: Some(id(from % 30)), ..NewNode::default() };
            Edit::Create { node: id(30 + from % 4), new: new.into() }
        }
    });
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 512, ..ProptestConfig::default() })]

    #[test]
    fn places_are_those_of_a_scene_placed_anew_bit_for_bit(
        parents in prop::collection::vec(prop::option::weighted(0.8, any::<u8>()), 30),
        before in prop::collection::vec(step(), 0..12),
        moves in prop::collection::vec((0u64..34, -9.0..9.0), 0..12),
        renamed in prop::option::of(0u64..30),
    ) {
        let base = base(&parents);
        let mut edits = SceneEdits::default();
        for step in &before {
            apply(&mut edits, step);
        }
        let (scene, ids) = edits.apply_to(&base, &AssetManifests::new());
        let placed = PlacedNodes::new(&scene.nodes, ids.clone(), edits.clone());
        let exists = |edits: &SceneEdits, node: u64| {
            node < 30 || edits.node(NodeId(node)).is_some_and(|of| of.created.is_some())
        };
        for (node, by) in moves {
            if exists(&edits, node) {
                apply(&mut edits, &Step::Move(node, by));
            }
        }
        if let Some(node) = renamed {
            apply(&mut edits, &Step::Rename(node));
        }
        let (now, now_ids) = edits.apply_to(&base, &AssetManifests::new());
        prop_assert_eq!(&ids, &now_ids);
        let moved = placed.moved(&base, &edits).expect("nothing but moves");
        let (mut worlds, expected) = (scene.world_from_nodes(), now.world_from_nodes());
        prop_assert!(moved.windows(2).all(|pair| pair[0].index < pair[1].index));
        for MovedPlace { index, node, local, world } in moved {
            prop_assert_eq!((node, local), (ids[index as usize], now.nodes[index as usize].local));
            worlds[index as usize] = world;
        }
        prop_assert_eq!(worlds, expected);
    }

    #[test]
    fn more_than_moves_is_never_taken_for_moves(
        before in prop::collection::vec(step(), 0..8),
        after in prop::collection::vec(step(), 0..8),
    ) {
        let base = base(&[Some(1); 30]);
        let mut edits = SceneEdits::default();
        for step in &before {
            apply(&mut edits, step);
        }
        let (scene, ids) = edits.apply_to(&base, &AssetManifests::new());
        let placed = PlacedNodes::new(&scene.nodes, ids.clone(), edits.clone());
        for step in &after {
            apply(&mut edits, step);
        }
        let Some(moved) = placed.moved(&base, &edits) else { return Ok(()) };
        let (now, now_ids) = edits.apply_to(&base, &AssetManifests::new());
        prop_assert_eq!(ids, now_ids);
        let (mut worlds, expected) = (scene.world_from_nodes(), now.world_from_nodes());
        for moved in moved {
            worlds[moved.index as usize] = moved.world;
        }
        prop_assert_eq!(worlds, expected);
        for (a, b) in scene.nodes.iter().zip(&now.nodes) {
            prop_assert_eq!((a.parent, a.mesh, a.light), (b.parent, b.mesh, b.light));
        }
    }
}

#[test]
fn a_light_that_moves_is_told() {
    let mut base = base(&[None, Some(0), Some(0)]);
    base.lights =
        vec![Light { kind: LightKind::Point, color: glam::Vec3::ONE, intensity: 1.0, range: None }];
    base.nodes[1].light = Some(0);
    let none = SceneEdits::default();
    let (scene, ids) = none.apply_to(&base, &AssetManifests::new());
    let placed = PlacedNodes::new(&scene.nodes, ids, none.clone());
    let moved = |node: u64| {
        let mut edits = none.clone();
        apply(&mut edits, &Step::Move(node, 1.0));
        let moved = placed.moved(&base, &edits).expect("nothing but moves");
        (moved.len(), placed.has_light(&moved))
    };
    assert_eq!([moved(0), moved(1), moved(2)], [(3, true), (1, true), (1, false)]);
}
