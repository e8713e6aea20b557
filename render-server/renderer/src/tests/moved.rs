//! Nodes that were moved: what is drawn is as after a new layout, in the same order, bit for bit.

use std::sync::{Arc, OnceLock};

use glam::{DAffine3, DQuat, DVec2, DVec3, Quat, Vec3, Vec4};
use polyptych_scene::{
    AlphaMode, Instance, Light, LightKind, Material, Node, NodeId, NodeTraits, SceneSubset,
};
use proptest::prelude::*;

use super::harness::{MeshFixture, SceneFixture, differences, draw, gpu, look};
use super::terrain::Terrain;
use crate::draw_list::{DrawList, Scratch, VisibleItems};
use crate::scene::Bounds;
use crate::{AllowedError, GpuScene, MovedItems, MovedNode, ViewDesc};

const SIZE: [u32; 2] = [96, 64];

/// A node's place: its position, the angle of its turn, and its size, which may be mirrored.
#[derive(Clone, Copy, Debug)]
struct Place {
    at: [f64; 3],
    turn: f64,
    is_mirrored: bool,
}

impl Place {
    fn local(self) -> DAffine3 {
        let scale = DVec3::new(if self.is_mirrored { -0.6 } else { 0.6 }, 0.5, 0.7);
        let turn = DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), self.turn);
        DAffine3::from_scale_rotation_translation(scale, turn, DVec3::from(self.at))
    }
}

/// A node: its parent among those before it, its mesh, its copies and its place.
type Described = (Option<u8>, Option<u8>, u8, Place);

fn place(mirrored: f64) -> impl Strategy<Value = Place> {
    // Whole numbers, so that distances tie and boxes touch.
    let number = || (-4i8..5).prop_map(f64::from);
    ([number(), number(), number()], 0..6, prop::bool::weighted(mirrored))
        .prop_map(|(at, turn, is_mirrored)| Place { at, turn: f64::from(turn) * 0.5, is_mirrored })
}

fn described() -> impl Strategy<Value = Described> {
    (
        prop::option::weighted(0.5, any::<u8>()),
        prop::option::weighted(0.8, 0u8..4),
        0u8..3,
        place(0.3),
    )
}

/// Meshes of which one has meshlets of several levels, and materials that are opaque, blended and
/// two-sided.
fn scene(nodes: &[Described], lamps: &[([i8; 3], u8)]) -> SceneFixture {
    let mut stage = SceneFixture::new();
    let plain = stage.material(Material { metallic: 0.0, ..Material::default() });
    let glass = |double_sided| Material {
        base_color: Vec4::new(0.9, 0.5, 0.2, 0.4),
        alpha_mode: AlphaMode::Blend,
        double_sided,
        ..Material::default()
    };
    let [pane, both] = [false, true].map(|both| stage.material(glass(both)));
    static LARGE: OnceLock<MeshFixture> = OnceLock::new();
    let hills = |at: DVec2| (at.x * 7.0).sin() * (at.y * 5.0).cos() * 0.2;
    let (small, large) = (MeshFixture::sphere(4), LARGE.get_or_init(|| Terrain::mesh(3, hills)));
    let pane_shape = MeshFixture::rectangle(1.0, 0.7);
    stage.mesh(&small, Some(plain));
    stage.mesh(large, Some(plain));
    stage.mesh(&pane_shape, Some(pane));
    stage.mesh(&pane_shape, Some(both));
    for (index, (parent, mesh, copies, place)) in (0u32..).zip(nodes) {
        let copy = |of: u8| Instance {
            translation: Vec3::X * f32::from(of),
            rotation: Quat::IDENTITY,
            scale: Vec3::ONE,
            crowd: 0.0,
        };
        stage.desc.nodes.push(Node {
            parent: parent.filter(|_| index > 0).map(|parent| u32::from(parent) % index.max(1)),
            local: place.local(),
            mesh: mesh.map(u32::from),
            instances: (0..*copies).map(copy).collect(),
            ..Node::default()
        });
    }
    for (at, range) in lamps {
        let at = DVec3::from(at.map(f64::from));
        let (color, intensity, range) = (Vec3::ONE, 30.0, Some(f32::from(*range) + 0.5));
        let light = Light { kind: LightKind::Point, color, intensity, range };
        stage.light(light, DAffine3::from_translation(at));
    }
    stage
}

/// All that two scenes draw of a view, but for where the lists of lamps stand.
fn expect_same_draws(a: &GpuScene, b: &GpuScene, view: &ViewDesc) {
    let listed = |scene: &GpuScene| {
        let (mut scratch, mut records) = (Scratch::default(), Vec::new());
        let whole = [0, 0, SIZE[0], SIZE[1]];
        let visible = VisibleItems::new(scene, view, whole);
        let shown = (&visible, &visible.items[..]);
        let list = DrawList::new(scene, view, shown, &mut scratch, &mut records);
        let counts: Vec<u32> = records.iter().map(|record| record.lamps[1]).collect();
        for record in &mut records {
            record.lamps = [0; 2];
        }
        let bytes = bytemuck::cast_slice::<_, u8>(&records).to_vec();
        (list.opaque, list.transparent, list.triangles, list.visible, list.touched, counts, bytes)
    };
    assert_eq!(listed(a), listed(b), "seen from {}", view.eye_in_world);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, ..ProptestConfig::default() })]

    #[test]
    fn moved_nodes_are_drawn_as_laid_out_anew(
        nodes in prop::collection::vec(described(), 12..40),
        lamps in prop::collection::vec(([-4i8..5, -4i8..5, -4i8..5], 0u8..6), 0..3),
        moves in prop::collection::vec((any::<u8>(), place(0.02)), 1..4),
        eyes in prop::collection::vec([-7i8..8, -7i8..8, 4i8..9], 2),
    ) {
        let mut stage = scene(&nodes, &lamps);
        let built = stage.build();
        let world_before = stage.desc.world_from_nodes();
        for (node, place) in moves {
            stage.desc.nodes[usize::from(node) % nodes.len()].local = place.local();
        }
        let worlds = stage.desc.world_from_nodes();
        let all = (0u32..).zip(&stage.desc.nodes).zip(worlds.iter().zip(&world_before));
        let moved = all.filter(|(_, (now, before))| now != before).map(|((node, of), (now, _))| {
            MovedNode::new(node, *now, &of.instances)
        });
        let moved = MovedItems::new(&built.layout, moved);
        // Too many such cases would fail.
        prop_assume!(moved.as_ref().is_some_and(|moved| !moved.is_empty()));
        let moved = moved.expect("few were moved");
        let layout = Arc::clone(&built.layout);
        let patched = built.with_layout(gpu(), layout, Some(Arc::new(moved))).expect("the same");
        let anew = stage.build();
        prop_assert_eq!(patched.layout.batches.len(), anew.layout.batches.len());
        for batch in 0..anew.layout.batches.len() as u32 {
            prop_assert_eq!(patched.batch_bounds(batch), anew.batch_bounds(batch));
        }
        let lamps_of = |scene: &GpuScene, item: u32| {
            let [start, count] = scene.item(item).0.lamps.map(|number| number as usize);
            scene.lamp_list(start..start + count)
        };
        for item in 0..anew.item_count() as u32 {
            let (own, its) = (patched.item(item), anew.item(item));
            prop_assert_eq!((own.0.origin, own.0.batch), (its.0.origin, its.0.batch));
            prop_assert_eq!(own.1.linear, its.1.linear);
            prop_assert_eq!(own.1.normal_rows, its.1.normal_rows);
            prop_assert_eq!(own.2, its.2);
            prop_assert_eq!(lamps_of(&patched, item), lamps_of(&anew, item));
        }
        for eye in &eyes {
            let view = look(DVec3::from(eye.map(f64::from)), DVec3::ZERO, SIZE);
            for angle_rad in [0.0, 0.01, 0.1] {
                let allowed_error = AllowedError { angle_rad, length: 0.0, ..AllowedError::NONE };
                expect_same_draws(&patched, &anew, &ViewDesc { allowed_error, ..view.clone() });
            }
        }
        let view = look(DVec3::from(eyes[0].map(f64::from)), DVec3::ZERO, SIZE);
        let (own, its) = (draw(&patched, SIZE, &view), draw(&anew, SIZE, &view));
        prop_assert_eq!(differences(&own, &its), [0; 3]);
    }
}

#[test]
fn a_material_that_nothing_had_is_drawn_once_a_node_has_it() {
    let mut stage = SceneFixture::new();
    let mut paint = |red: f32, green: f32| {
        let base_color = Vec4::new(red, green, 0.1, 1.0);
        stage.material(Material { base_color, unlit: true, ..Material::default() })
    };
    let (red, green) = (paint(0.9, 0.1), paint(0.1, 0.9));
    let shape = MeshFixture::rectangle(0.4, 0.4);
    let [shown, later] = [red, green].map(|material| stage.mesh(&shape, Some(material)));
    stage.node(shown, DAffine3::from_translation(DVec3::NEG_X * 0.5));
    let before = stage.build();
    assert!(before.materials.get(red).is_some() && before.materials.get(green).is_none());
    stage.node(later, DAffine3::from_translation(DVec3::X * 0.5));
    let layout = crate::SceneLayout::new(stage.desc.clone(), &|| false).expect("sound");
    let after = before.with_layout(gpu(), Arc::new(layout), None).expect("the same");
    let view = look(DVec3::Z * 3.0, DVec3::ZERO, SIZE);
    let [own, its] = [&after, &stage.build()].map(|scene| draw(scene, SIZE, &view));
    assert_eq!(differences(&own, &its), [0; 3]);
    assert!(differences(&own, &draw(&before, SIZE, &view))[2] > 100);
}

/// A row of spheres, of which some are moved.
fn row(moved: &[(u32, DAffine3)]) -> Option<MovedItems> {
    let mut stage = SceneFixture::new();
    let mesh = stage.mesh(&MeshFixture::sphere(4), None);
    (0..1000).for_each(|at| {
        stage.node(mesh, DAffine3::from_translation(DVec3::X * f64::from(at)));
    });
    let layout = crate::SceneLayout::new(stage.desc, &|| false).expect("sound");
    let nodes = moved.iter().map(|&(node, world)| MovedNode::new(node, world, &[]));
    MovedItems::new(&layout, nodes)
}

#[test]
fn too_many_moves_and_items_turned_inside_out_ask_for_a_new_layout() {
    let up = DAffine3::from_translation(DVec3::Y);
    let all: Vec<_> = (0..501).map(|node| (node, up)).collect();
    assert_eq!(row(&all[..500]).map(|moved| moved.len()), Some(500));
    assert!(row(&all).is_none(), "more than half");
    let mirrored = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    assert!(row(&[(3, mirrored)]).is_none(), "it belongs to another batch");
    // Scaled to nothing, or nearly, by transforms that mirror or not: there is no winding.
    let turn = DAffine3::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 1.1);
    for scale in [DVec3::ZERO, DVec3::new(0.0, -1.0, 1.0), DVec3::new(-1.0, 0.0, 0.0)] {
        let flat = turn * DAffine3::from_scale(scale) * turn;
        assert!(row(&[(3, flat)]).is_some(), "{scale}");
    }
    assert!(row(&[(1000, up)]).is_none(), "there is no such node");
    assert!(row(&[]).is_some_and(|moved| moved.is_empty()));
}

/// The boxes of all batches, and of what maps of shadows are for: of all, and of either node.
fn boxes(scene: &GpuScene) -> (Vec<Bounds>, [Bounds; 3]) {
    let batches = 0..scene.layout.batches.len() as u32;
    let roots = [None, Some(NodeId(0)), Some(NodeId(1))];
    let extent = |root| scene.shadowed_extent(scene.part(&SceneSubset { root, layers: None }));
    (batches.map(|batch| scene.batch_bounds(batch)).collect(), roots.map(extent))
}

#[test]
fn boxes_at_a_moment_do_not_tell_when_the_scene_was_laid_out() {
    let mut stage = SceneFixture::new();
    let ball = stage.mesh(&MeshFixture::sphere(4), None);
    let rest = DAffine3::from_translation(DVec3::X * 40.0);
    let mover = stage.node(ball, rest);
    stage.node(ball, DAffine3::IDENTITY);
    let place = DAffine3::from_translation(DVec3::new(-20.0, 3.0, 0.0));
    let mirrored = place * DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    let flat = place * DAffine3::from_scale(DVec3::new(0.0, 1.0, 1.0));
    let cases = [
        (false, place, place, true),
        (true, mirrored, flat, false),
        (true, place, place, false),
        (true, place, mirrored, false),
        (true, mirrored, place, false),
        (true, mirrored, mirrored, true),
    ];
    for (may_mirror, edited, now, is_hidden) in cases {
        let case = format!("{may_mirror}, {edited:?}, {now:?}, {is_hidden}");
        let traits = NodeTraits { moving: vec![mover], may_mirror, ..NodeTraits::of_file(2) };
        let before = stage.build_with(&traits);
        let edit = [MovedNode::new(mover, edited, &[])];
        let moved = MovedItems::new(&before.layout, edit.into_iter()).map(Arc::new);
        assert!(moved.is_some(), "the layout is kept: {case}");
        let kept = before.with_layout(gpu(), Arc::clone(&before.layout), moved).expect("the same");
        stage.desc.nodes[mover as usize].local = edited;
        let anew = stage.build_with(&traits);
        stage.desc.nodes[mover as usize].local = rest;
        assert_eq!(boxes(&kept), boxes(&anew), "at rest: {case}");
        let [kept, anew] = [kept, anew].map(|scene| {
            let node = MovedNode { is_hidden, ..MovedNode::new(mover, now, &[]) };
            scene.at_moment(gpu(), &[node], &[], &[]).expect("it moves")
        });
        assert_eq!(boxes(&kept), boxes(&anew), "{case}");
    }
}
