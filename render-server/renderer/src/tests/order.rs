//! Depth, blending, instances: what is in front, what is one, and what is drawn first.

use std::sync::Arc;

use glam::{DAffine3, DVec3, Quat, Vec3, Vec4};
use polyptych_scene::{AlphaMode, Instance, Material, Node, NodeId, SceneSubset, Topology};

use super::harness::{
    MeshFixture, SceneFixture, differences, draw, draw_sampled, drawn, gpu, look, matt, pixel,
};
use crate::draw_list::{DrawList, Scratch, VisibleItems};
use crate::scene::Bounds;
use crate::{GpuScene, MovedItems, MovedNode, Renderer, Target, ViewDesc, read_pixels};

const SIZE: [u32; 2] = [128, 128];

fn flat(r: f32, g: f32, b: f32, a: f32) -> Material {
    Material {
        base_color: Vec4::new(r, g, b, a),
        unlit: true,
        alpha_mode: if a < 1.0 { AlphaMode::Blend } else { AlphaMode::Opaque },
        ..Material::default()
    }
}

#[test]
fn a_centimetre_is_resolved_at_ten_kilometres() {
    if gpu().info().backend == "gl" {
        // GL's depth goes from −1 to 1, which costs reversed depth its precision.
        return;
    }
    let mut stage = SceneFixture::new();
    let green = stage.material(flat(0.0, 1.0, 0.0, 1.0));
    let red = stage.material(flat(1.0, 0.0, 0.0, 1.0));
    let front = stage.mesh(&MeshFixture::rectangle(4000.0, 4000.0), Some(green));
    let back = stage.mesh(&MeshFixture::rectangle(3600.0, 3600.0), Some(red));
    // The far one first, so that order alone does not decide.
    stage.node(back, DAffine3::from_translation(DVec3::Z * -10_000.01));
    stage.node(front, DAffine3::from_translation(DVec3::Z * -10_000.0));
    let scene = stage.build();
    for step in 0..8 {
        let eye = DVec3::new(f64::from(step) * 3.7, f64::from(step) * 1.3, 0.0);
        let pixels = draw(&scene, SIZE, &look(eye, DVec3::new(0.0, 0.0, -1e4), SIZE));
        let far = pixels.iter().filter(|p| p[0] > p[1] && p[0] > p[2]).count();
        assert_eq!(far, 0, "the far plane shows");
        assert!(drawn(&pixels) > 3000);
    }
}

#[test]
fn points_and_lines_of_the_same_bytes_are_both_drawn() {
    let mut stage = SceneFixture::new();
    for topology in [Topology::Points, Topology::Lines] {
        let mesh = stage.mesh(&MeshFixture::rectangle(2.0, 2.0), None);
        stage.desc.meshes[mesh as usize].primitives[0].topology = topology;
        stage.node(mesh, DAffine3::IDENTITY);
    }
    let scene = stage.build();
    let view = look(DVec3::Z * 4.0, DVec3::ZERO, SIZE);
    let both = drawn(&draw(&scene, SIZE, &view));
    assert!(both > 100, "{both} pixels of four points and three lines");
}

#[test]
fn blended_panes_are_sorted_from_both_sides() {
    let mut stage = SceneFixture::new();
    let red = stage.material(Material { double_sided: true, ..flat(1.0, 0.0, 0.0, 0.5) });
    let blue = stage.material(Material { double_sided: true, ..flat(0.0, 0.0, 1.0, 0.5) });
    let first = stage.mesh(&MeshFixture::rectangle(1.0, 1.0), Some(red));
    let second = stage.mesh(&MeshFixture::rectangle(1.0, 1.0), Some(blue));
    stage.node(first, DAffine3::IDENTITY);
    stage.node(second, DAffine3::from_translation(DVec3::Z * -0.5));
    let scene = stage.build();
    assert!(scene.has_transparency());
    let middle = |z: f64| {
        let view = look(DVec3::Z * z, DVec3::Z * -0.25, SIZE);
        pixel(&draw(&scene, SIZE, &view), SIZE, 64, 64)
    };
    let (before, behind) = (middle(2.0), middle(-2.5));
    assert!(before[0] > before[2] + 20, "red is in front: {before:?}");
    assert!(behind[2] > behind[0] + 20, "blue is in front: {behind:?}");
}

#[test]
fn a_blended_pane_behind_an_opaque_one_does_not_show() {
    let mut stage = SceneFixture::new();
    let red = stage.material(flat(1.0, 0.0, 0.0, 0.5));
    let green = stage.material(flat(0.0, 1.0, 0.0, 1.0));
    let pane = stage.mesh(&MeshFixture::rectangle(1.0, 1.0), Some(red));
    let wall = stage.mesh(&MeshFixture::rectangle(1.0, 1.0), Some(green));
    stage.node(pane, DAffine3::from_translation(DVec3::Z * -1.0));
    stage.node(wall, DAffine3::IDENTITY);
    let pixels = draw(&stage.build(), SIZE, &look(DVec3::Z * 2.0, DVec3::ZERO, SIZE));
    let middle = pixel(&pixels, SIZE, 64, 64);
    assert!(middle[1] > 200 && middle[0] == middle[2], "{middle:?}");
}

#[test]
fn instances_equal_separate_nodes() {
    let places = (0..40).map(|i| {
        let i = i as f32;
        Instance {
            translation: Vec3::new((i * 0.7).sin() * 3.0, (i * 1.3).cos() * 2.0, -i * 0.3),
            rotation: Quat::from_rotation_y(i),
            scale: Vec3::new(0.3, if i % 3.0 == 0.0 { -0.4 } else { 0.2 }, 0.3),
            crowd: 0.0,
        }
    });
    let places: Vec<Instance> = places.collect();
    let shape = MeshFixture::sphere(8);
    let mut together = SceneFixture::new();
    let material = together.material(matt(0.8, 0.5, 0.2));
    let mesh = together.mesh(&shape, Some(material));
    let (mesh, instances) = (Some(mesh), places.clone());
    together.desc.nodes.push(Node { mesh, instances, ..Node::default() });
    let mut apart = SceneFixture::new();
    let material = apart.material(matt(0.8, 0.5, 0.2));
    let mesh = apart.mesh(&shape, Some(material));
    for place in &places {
        let (scale, rotation) = (place.scale.as_dvec3(), place.rotation.as_dquat());
        let translation = place.translation.as_dvec3();
        apart.node(mesh, DAffine3::from_scale_rotation_translation(scale, rotation, translation));
    }
    let view = look(DVec3::Z * 4.0, DVec3::Z * -4.0, SIZE);
    let (a, stats) = draw_sampled(&together.build(), SIZE, 1, std::slice::from_ref(&view));
    let (b, _) = draw_sampled(&apart.build(), SIZE, 1, &[view]);
    assert_eq!(differences(&a, &b), [0; 3]);
    assert_eq!(stats.draw_calls, 2, "one for each winding");
    assert!(drawn(&a) > 500);
}

#[test]
fn pictures_do_not_depend_on_what_was_drawn_before() {
    let mut stage = SceneFixture::new();
    let material = stage.material(matt(0.8, 0.5, 0.2));
    let mesh = stage.mesh(&MeshFixture::sphere(16), Some(material));
    for i in 0..20 {
        let i = f64::from(i);
        stage.node(mesh, DAffine3::from_translation(DVec3::new(i.sin() * 4.0, i.cos(), -i)));
    }
    let scene = stage.build();
    let view = |i: i32| look(DVec3::new(f64::from(i), 1.0, 5.0), DVec3::ZERO, SIZE);
    let mut renderer = Renderer::new(gpu(), 1).unwrap();
    renderer.prepare(gpu(), &scene);
    let mut target = Target::new(gpu(), SIZE, 1, false).unwrap();
    for i in [3, -2, 0, 1] {
        renderer.draw(gpu(), &scene, &mut target, &[view(i)]).unwrap();
    }
    let pixels = read_pixels(gpu(), &target).unwrap();
    let fresh = draw(&scene, SIZE, &view(1));
    assert_eq!(differences(pixels.as_chunks::<4>().0, &fresh), [0; 3]);
}

#[test]
fn what_is_outside_is_culled() {
    let mut stage = SceneFixture::new();
    let mesh = stage.mesh(&MeshFixture::sphere(6), None);
    for i in 0..1000 {
        let angle = f64::from(i) * 0.01 * std::f64::consts::TAU;
        let ring = 20.0 + f64::from(i / 100) * 3.0;
        let place = DVec3::new(angle.sin() * ring, 0.0, angle.cos() * ring);
        stage.node(mesh, DAffine3::from_translation(place));
    }
    let view = look(DVec3::ZERO, -DVec3::Z, SIZE);
    let (_, stats) = draw_sampled(&stage.build(), SIZE, 1, &[view]);
    assert_eq!(stats.visible + stats.culled, 1000);
    assert!((150..260).contains(&stats.visible), "{stats:?}");
}

/// The draws of a scene of rectangles that face an eye at the origin, which looks along -z, and how
/// far from it each of their records stands.
fn drawn_in_order(scene: &GpuScene) -> (DrawList, Vec<f64>) {
    let view = look(DVec3::ZERO, DVec3::NEG_Z, SIZE);
    let (mut scratch, mut records) = (Scratch::default(), Vec::new());
    let visible = VisibleItems::new(scene, &view, [0, 0, SIZE[0], SIZE[1]]);
    let items = (&visible, &visible.items[..]);
    let list = DrawList::new(scene, &view, items, &mut scratch, &mut records);
    let distances = records.iter().map(|record| -f64::from(record.rows[2][3])).collect();
    (list, distances)
}

/// A scene of meshes, each in its material at some distances.
fn at_distances(materials: &[Material], meshes: &[(usize, [f64; 2])]) -> GpuScene {
    let mut stage = SceneFixture::new();
    let materials: Vec<u32> = materials.iter().map(|of| stage.material(of.clone())).collect();
    for (index, (material, distances)) in (0u16..).zip(meshes) {
        // No two alike, which would be one batch.
        let side = 0.1 + f32::from(index) * 1e-4;
        let mesh = stage.mesh(&MeshFixture::rectangle(side, side), Some(materials[*material]));
        for distance in distances {
            stage.node(mesh, DAffine3::from_translation(DVec3::NEG_Z * *distance));
        }
    }
    stage.build()
}

#[test]
fn few_batches_are_drawn_nearest_first_and_so_are_the_items_of_each() {
    let plain = [matt(0.8, 0.5, 0.2), matt(0.1, 0.2, 0.3)];
    let scene = at_distances(&plain, &[(0, [9.0, 3.0]), (1, [5.0, 1.0]), (0, [2.0, 7.0])]);
    let (list, distances) = drawn_in_order(&scene);
    assert_eq!(distances, [1.0, 5.0, 2.0, 7.0, 3.0, 9.0]);
    let draws: Vec<[u32; 2]> = list.opaque.iter().map(|draw| [draw.first, draw.count]).collect();
    assert_eq!(draws, [[0, 2], [2, 2], [4, 2]], "one draw for each batch");
    assert!(list.transparent.is_empty());
    // Panes go by themselves, whatever their batch is.
    let panes = [flat(1.0, 0.0, 0.0, 0.5), flat(0.0, 0.0, 1.0, 0.5)];
    let scene = at_distances(&panes, &[(0, [9.0, 3.0]), (1, [5.0, 1.0]), (0, [2.0, 7.0])]);
    let (list, distances) = drawn_in_order(&scene);
    assert_eq!(distances, [9.0, 7.0, 5.0, 3.0, 2.0, 1.0]);
    assert!(list.opaque.is_empty() && !list.transparent.is_empty());
    let firsts: Vec<u32> = list.transparent.iter().map(|draw| draw.first).collect();
    assert!(firsts.is_sorted(), "{firsts:?}");
}

#[test]
fn many_batches_are_drawn_by_shell_then_pipeline_then_material_then_distance() {
    /// Each is twice as far as the one before.
    const SHELLS: usize = 3;
    // The third has a pipeline of its own.
    let both = Material { double_sided: true, ..matt(0.3, 0.3, 0.3) };
    let materials = [matt(0.8, 0.5, 0.2), matt(0.1, 0.2, 0.3), both];
    let meshes = (0..300).map(|index: usize| {
        let (material, shell) = (index % 3, index / 3 % SHELLS);
        let within = 1.5 + 0.012 * (index * 37 % 100) as f64;
        let near = within * (shell as f64).exp2();
        (material, [near + 0.3, near])
    });
    let scene = at_distances(&materials, &meshes.collect::<Vec<_>>());
    assert_eq!(scene.layout.batches.len(), 300);
    let (list, distances) = drawn_in_order(&scene);
    assert_eq!(list.opaque.len(), 300);
    let keys = list.opaque.iter().map(|draw| {
        let of = &scene.layout.batches[draw.batch as usize];
        let items = &distances[draw.first as usize..][..draw.count as usize];
        assert!(items.len() == 2 && items[0] < items[1], "{items:?}");
        // Shells end where none of the distances is: at 1.41, 2.83, 5.66 and 11.3.
        let shell = (items[0] / 1.45).log2().floor() as i32;
        (shell, of.pipeline, of.material, items[0])
    });
    let keys: Vec<(i32, u32, u32, f64)> = keys.collect();
    assert!(keys.is_sorted(), "{keys:?}");
    let changes = keys.windows(2).filter(|two| (two[0].1, two[0].2) != (two[1].1, two[1].2));
    assert_eq!(changes.count(), 3 * SHELLS - 1, "each material once in each shell");
    assert!(!keys.is_sorted_by_key(|key| key.3), "nearer ones of another material wait");
}

#[test]
fn boxes_of_what_hangs_from_a_root_are_found_once_and_for_no_empty_list() {
    let mut stage = SceneFixture::new();
    let meshes = [4, 5].map(|rings| stage.mesh(&MeshFixture::sphere(rings), None));
    for at in 0..12 {
        let place = DAffine3::from_translation(DVec3::X * (at % 3) as f64);
        let node = stage.node(meshes[at % 2], place);
        stage.desc.nodes[node as usize].parent = node.checked_sub(1).map(|before| before / 2);
    }
    let scene = stage.build();
    let subset = |root: u64| SceneSubset { root: Some(NodeId(root)), layers: None };
    let visible_of = |scene: &GpuScene, is_empty: bool| {
        let view = look(DVec3::Z * 30.0, DVec3::ZERO, SIZE);
        let view = ViewDesc { subset: subset(1), ..view };
        let visible = VisibleItems::new(scene, &view, [0, 0, SIZE[0], SIZE[1]]);
        let shown = (&visible, if is_empty { &[][..] } else { &visible.items[..] });
        let (mut scratch, mut records) = (Scratch::default(), Vec::new());
        DrawList::new(scene, &view, shown, &mut scratch, &mut records).visible
    };
    assert_eq!((visible_of(&scene, true), scene.known_parts()), (0, 0));
    for _ in 0..2 {
        assert!(visible_of(&scene, false) > 1);
        assert_eq!(scene.known_parts(), 1);
    }

    let check = |scene: &GpuScene| {
        for root in (0..12).chain(0..12) {
            let part = scene.part(&subset(root));
            let mut wanted = vec![Bounds::EMPTY; scene.layout.batches.len()];
            for index in 0..scene.item_count() as u32 {
                let (item, _, bounds) = scene.item(index);
                if part.has_place(item.place) {
                    let of_batch = &mut wanted[item.batch as usize];
                    *of_batch = of_batch.union(*bounds);
                }
            }
            let [found, again] = [0, 1].map(|_| scene.batch_bounds_of(part).expect("a root"));
            assert_eq!(found[..], wanted[..], "root {root}");
            assert!(Arc::ptr_eq(&found, &again), "root {root}");
        }
    };
    check(&scene);
    let up = DAffine3::from_translation(DVec3::Y * 7.0);
    let moved = MovedItems::new(&scene.layout, [MovedNode::new(11, up, &[])].into_iter());
    let moved = Some(Arc::new(moved.expect("few were moved")));
    let moved = scene.with_layout(gpu(), Arc::clone(&scene.layout), moved).expect("the same");
    assert_eq!(moved.known_parts(), 0, "another state of the scene");
    check(&moved);
}
