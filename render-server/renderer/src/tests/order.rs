//! Depth, blending, instances: what is in front, and what is one.

use glam::{DAffine3, DVec3, Quat, Vec3, Vec4};
use polyptych_scene::{AlphaMode, Instance, Material, Node, Topology};

use super::harness::{
    MeshFixture, SceneFixture, differences, draw, draw_sampled, drawn, gpu, look, matt, pixel,
};
use crate::{Renderer, Target, read_pixels};

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
