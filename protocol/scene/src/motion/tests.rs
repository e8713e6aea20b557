//! The nodes and joints that clips move in edited scenes.

use super::*;
use crate::animation::{AnimatedNode, Animations, Channel, Clip, Interpolation};
use crate::deformation::Joint;
use crate::{Edit, FilePlace, Node};
use glam::DQuat;

/// A hand that hangs from an arm, which hangs from a body, and a house beside them. The clip lifts
/// the arm by 1 m in a second.
fn scene() -> Arc<Scene> {
    let node = |parent, x: f64| {
        let local = DAffine3::from_translation(DVec3::new(x, 0.0, 0.0));
        Node { parent, local, ..Node::default() }
    };
    let nodes = vec![node(None, 10.0), node(Some(0), 2.0), node(Some(1), 1.0), node(None, -5.0)];
    let translation = DVec3::new(2.0, 0.0, 0.0);
    let rest = AnimatedNode {
        node: 1,
        translation,
        rotation: DQuat::IDENTITY,
        scale: DVec3::ONE,
        weights: Vec::new(),
    };
    let lift = Channel {
        target: 0,
        path: AnimatedPath::Translation,
        interpolation: Interpolation::Linear,
        times: vec![0.0, 1.0],
        values: vec![2.0, 0.0, 0.0, 2.0, 1.0, 0.0],
    };
    let clip = Clip { name: "lift".into(), channels: vec![lift] };
    let animations = Animations { clips: vec![clip], nodes: vec![rest], ..Animations::default() };
    Arc::new(Scene { nodes, animations, ..Scene::default() })
}

fn motion(base: &Arc<Scene>, edits: &SceneEdits) -> Motion {
    let (placed, ids) = edits.apply_to(base, &BTreeMap::default());
    Motion::new(base, &PlacedNodes::new(&placed.nodes, ids, edits.clone()), edits).expect("moves")
}

/// The places of nodes half a second into the clip, by their indices among those that are placed.
fn places(motion: &Motion) -> Vec<(u32, DVec3)> {
    let clip = ClipTime { clip: 0, time_s: 0.5, weight: 1.0 };
    let places = motion.at(&[clip]).places;
    places.into_iter().map(|(index, _, world)| (index, world.translation)).collect()
}

fn edited(edits: impl IntoIterator<Item = Edit>) -> SceneEdits {
    let mut all = SceneEdits::default();
    edits.into_iter().for_each(|edit| all.apply(edit));
    all
}

fn moved(node: u64, x: f64) -> Edit {
    let local = DAffine3::from_translation(DVec3::new(x, 0.0, 0.0));
    Edit::SetTransform { node: NodeId(node), local }
}

#[test]
fn what_hangs_from_an_animated_node_goes_with_it_and_nothing_else_does() {
    let motion = motion(&scene(), &SceneEdits::default());
    assert_eq!(places(&motion), [(1, DVec3::new(12.0, 0.5, 0.0)), (2, DVec3::new(13.0, 0.5, 0.0))]);
    assert_eq!(motion.movers().collect::<Vec<_>>(), [1, 2]);
    assert!(!motion.may_mirror());
}

#[test]
fn a_clip_may_turn_around_what_is_inside_out_at_rest() {
    let mut base = (*scene()).clone();
    base.nodes[1].local = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    let base = Arc::new(base);
    assert!(motion(&base, &SceneEdits::default()).may_mirror());
    let local = DAffine3::from_scale(DVec3::new(1.0, 1.0, -2.0));
    let edits = edited([Edit::SetTransform { node: NodeId(1), local }]);
    assert!(motion(&scene(), &edits).may_mirror());
}

#[test]
fn a_clip_may_turn_inside_out_what_its_splines_scale_below_zero_between_keys() {
    let eased = |leave: f32, arrive: f32| {
        let mut base = (*scene()).clone();
        let key = |value: f32, tangents: [f32; 2]| {
            [[tangents[0]; 3], [value; 3], [tangents[1]; 3]].concat()
        };
        base.animations.clips[0].channels[0] = Channel {
            target: 0,
            path: AnimatedPath::Scale,
            interpolation: Interpolation::CubicSpline,
            times: vec![0.0, 1.0],
            // What leads to the first key and away from the last is of no use.
            values: [key(0.0, [-9.0, leave]), key(1.0, [arrive, -9.0])].concat(),
        };
        let motion = motion(&Arc::new(base), &SceneEdits::default());
        let scales = (0..=100).map(|step| {
            let clip = ClipTime { clip: 0, time_s: f64::from(step) / 100.0, weight: 1.0 };
            motion.at(&[clip]).places[0].2.matrix3.x_axis.x
        });
        (motion.may_mirror(), scales.fold(f64::MAX, f64::min))
    };
    let (may_mirror, least) = eased(0.0, 4.59);
    assert!(may_mirror && least < -0.05, "{least}");
    let (may_mirror, least) = eased(0.0, 2.9);
    assert!(!may_mirror && least == 0.0, "{least}");
}

#[test]
fn all_nodes_that_show_a_mesh_that_bends_are_bent() {
    let mut base = (*scene()).clone();
    let (mesh, node) = (4, 1);
    let (skin, weights, weights_of) = (None, vec![0.5], None);
    base.deformations = vec![Deformation { mesh, node, skin, weights, weights_of }];
    let base = Arc::new(base);
    let of_house = |mesh| edited([Edit::SetMesh { node: NodeId(3), mesh }]);
    let movers = |edits: &SceneEdits| motion(&base, edits).movers().collect::<Vec<_>>();
    assert_eq!(movers(&of_house(Some(4))), [1, 2, 3]);
    assert_eq!(movers(&of_house(Some(5))), [1, 2]);
    let new = crate::NewNode { mesh: Some(4), ..crate::NewNode::default() };
    assert_eq!(movers(&edited([Edit::Create { node: NodeId(9), new: new.into() }])), [1, 2, 4]);
}

#[test]
fn a_node_that_was_put_elsewhere_moves_from_there() {
    let base = scene();
    let edits = edited([moved(1, 7.0)]);
    assert_eq!(places(&motion(&base, &edits))[0], (1, DVec3::new(17.0, 0.5, 0.0)));
    // Placed without the edit: what was edited stands elsewhere, and clips move it from there.
    let (placed, ids) = SceneEdits::default().apply_to(&base, &BTreeMap::default());
    let placed = PlacedNodes::new(&placed.nodes, ids, SceneEdits::default());
    let edits = edited([moved(0, 20.0), moved(3, -6.0)]);
    let motion = Motion::new(&base, &placed, &edits).expect("moves");
    let wanted = [(0, 20.0, 0.0), (1, 22.0, 0.5), (2, 23.0, 0.5), (3, -6.0, 0.0)];
    assert_eq!(places(&motion), wanted.map(|(at, x, y)| (at, DVec3::new(x, y, 0.0))));
}

#[test]
fn a_single_node_stands_where_it_does_among_all() {
    let base = scene();
    let clips = [ClipTime { clip: 0, time_s: 0.25, weight: 0.5 }];
    for edits in [SceneEdits::default(), edited([moved(1, 7.0), moved(2, 3.0)])] {
        let mut world = DAffine3::IDENTITY;
        for node in [0, 1, 2].map(NodeId) {
            let place = FilePlace::of(&base, node).expect("of the file");
            world *= place.local(edits.node(node).and_then(|of| of.local), &clips);
        }
        let moment = motion(&base, &edits).at(&clips);
        let hand = moment.places.iter().find(|(index, ..)| *index == 2).expect("it moves");
        assert_eq!((hand.2, world.translation.y), (world, 0.125));
    }
    assert_eq!(FilePlace::of(&base, NodeId(3)), Some(FilePlace::still(base.nodes[3].local)));
    assert_eq!(FilePlace::of(&base, NodeId(4)), None);
}

#[test]
fn a_scene_without_clips_and_skins_has_no_motion() {
    let base = Arc::new(Scene { animations: Animations::default(), ..(*scene()).clone() });
    let placed = PlacedNodes::new(&base.nodes, (0..4).map(NodeId).collect(), SceneEdits::default());
    assert!(Motion::new(&base, &placed, &SceneEdits::default()).is_none());
}

#[test]
fn joints_are_added_up_below_the_top_near_where_they_are() {
    let mut base = (*scene()).clone();
    // The mesh of the hand and the arm hangs from the body.
    base.nodes.push(Node { parent: Some(0), ..Node::default() });
    let joint = |node, x: f64| Joint {
        node,
        inverse_bind: DAffine3::from_translation(DVec3::new(-x, 0.0, 0.0)),
    };
    let skin = Skin { top: Some(0), joints: vec![joint(1, 2.0), joint(2, 3.0)], rigid: None };
    base.deformations.push(Deformation {
        mesh: 0,
        node: 4,
        skin: Some(skin),
        weights: Vec::new(),
        weights_of: None,
    });
    let base = Arc::new(base);
    // The node that draws the mesh moves from where it was put, too.
    let put = [(None, 0.0), (Some(moved(0, 1e7)), 0.0), (Some(moved(4, 5.0)), 5.0)];
    for (edit, put) in put {
        let edits = edited(edit);
        let motion = motion(&base, &edits);
        let moment = motion.at(&[ClipTime { clip: 0, time_s: 0.5, weight: 1.0 }]);
        let mesh = moment.places.iter().find(|(index, ..)| *index == 4).expect("it is drawn").2;
        let shape = &moment.shapes[0];
        let body = motion.base().nodes[0].local.translation.x;
        let body = edits.local_of(&base, NodeId(0)).map_or(body, |local| local.translation.x);
        for (joint, x) in shape.joints.iter().zip([2.0, 3.0]) {
            let bound = joint.transform_point3(DVec3::new(x, 0.0, 0.0));
            assert!(bound.length() < 4.0, "a small number, wherever the body stands: {bound}");
            let world = mesh.transform_point3(bound);
            assert_eq!(world, DVec3::new(body + put + x, 0.5, 0.0));
        }
    }
    // The edited joint moves what follows it, without any clip.
    let posed = motion(&base, &edited([moved(2, 5.0)])).at(&[]);
    let mesh = posed.places.iter().find(|(index, ..)| *index == 4).expect("it is drawn").2;
    let tip = posed.shapes[0].joints[1].transform_point3(DVec3::new(3.0, 0.0, 0.0));
    assert_eq!(mesh.transform_point3(tip), DVec3::new(17.0, 0.0, 0.0));
}

#[test]
fn a_skin_that_nothing_moves_stands_still_until_an_edit_turns_a_joint() {
    let mut base = (*scene()).clone();
    // A joint, and the node that draws what follows it, which stands where the joint does.
    let local = DAffine3::from_translation(DVec3::X * 30.0);
    base.nodes.extend([0; 2].map(|_| Node { local, ..Node::default() }));
    let joints = vec![Joint { node: 4, inverse_bind: DAffine3::IDENTITY }];
    let skin = Some(Skin { top: None, joints, rigid: None });
    let (mesh, node, weights, weights_of) = (0, 5, Vec::new(), None);
    base.deformations.push(Deformation { mesh, node, skin, weights, weights_of });
    let base = Arc::new(base);
    for (x, movers) in [(30.0, vec![1, 2]), (33.0, vec![1, 2, 5]), (30.0, vec![1, 2])] {
        let motion = motion(&base, &edited([moved(4, x)]));
        assert_eq!(motion.movers().collect::<Vec<_>>(), movers, "{x} m");
        // The scene stays as it was laid out while edits come and go.
        let mut traits = NodeTraits::default();
        motion.add_traits(&mut traits);
        assert_eq!(traits.moving, [1, 2, 5]);
        let moment = motion.at(&[]);
        let place = moment.places.iter().find(|(index, ..)| *index == 5);
        let world = place.map_or(local, |(_, _, world)| *world);
        let bound = moment.shapes[0].joints[0].transform_point3(DVec3::ZERO);
        assert_eq!(world.transform_point3(bound), DVec3::X * x);
    }
}
