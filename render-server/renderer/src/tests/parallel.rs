//! Parallel rays: depth, light, order, culling; and the order that both eyes share.

use glam::{DAffine3, DMat4, DVec3, DVec4, Vec3, Vec4};
use polyptych_scene::{AlphaMode, Light, LightKind, Material};

use super::harness::{
    MeshFixture, SceneFixture, differences, draw, draw_sampled, drawn, look, pixel,
};
use crate::ViewDesc;

const SIZE: [u32; 2] = [96, 64];

/// A plan of this height, from a camera at `eye` that looks at `at`.
fn plan(eye: DVec3, at: DVec3, height: f64) -> ViewDesc {
    let aspect = f64::from(SIZE[0]) / f64::from(SIZE[1]);
    let (near, depth) = (0.05, 1e6);
    let clip_from_view = DMat4::from_cols(
        DVec4::X * (2.0 / (height * aspect)),
        DVec4::Y * (2.0 / height),
        DVec4::Z / depth,
        DVec4::new(0.0, 0.0, (near + depth) / depth, 1.0),
    );
    ViewDesc { clip_from_view, ..look(eye, at, SIZE) }
}

fn flat(color: [f32; 3], alpha: f32) -> Material {
    Material {
        base_color: Vec3::from(color).extend(alpha),
        unlit: true,
        double_sided: true,
        alpha_mode: if alpha < 1.0 { AlphaMode::Blend } else { AlphaMode::Opaque },
        ..Material::default()
    }
}

#[test]
fn a_centimetre_is_resolved_in_a_plan_of_a_kilometre_of_depth() {
    let mut stage = SceneFixture::new();
    let green = stage.material(flat([0.0, 1.0, 0.0], 1.0));
    let red = stage.material(flat([1.0, 0.0, 0.0], 1.0));
    let front = stage.mesh(&MeshFixture::rectangle(40.0, 40.0), Some(green));
    let back = stage.mesh(&MeshFixture::rectangle(30.0, 30.0), Some(red));
    // The far one first, so that order alone does not decide.
    stage.node(back, DAffine3::from_translation(DVec3::Z * -1000.01));
    stage.node(front, DAffine3::from_translation(DVec3::Z * -1000.0));
    // Beside the picture, but in the scene: its depth begins here.
    stage.node(front, DAffine3::from_translation(DVec3::new(500.0, 0.0, 0.0)));
    let scene = stage.build();
    for step in 0..6 {
        let step = f64::from(step);
        // From 1,000 km away, and among the scene.
        let eye = DVec3::new(step * 0.7, step * 0.3, if step < 3.0 { 1e6 } else { -30.0 * step });
        let pixels = draw(&scene, SIZE, &plan(eye, eye - DVec3::Z, 60.0));
        let red = pixels.iter().filter(|p| p[0] > p[1]).count();
        assert_eq!(red, 0, "the far plane shows from {eye}");
        assert!(drawn(&pixels) > SIZE[0] as usize * SIZE[1] as usize / 2, "from {eye}");
    }
}

#[test]
fn what_is_behind_the_camera_of_a_plan_is_cut_away() {
    let mut stage = SceneFixture::new();
    let green = stage.material(flat([0.0, 1.0, 0.0], 1.0));
    let red = stage.material(flat([1.0, 0.0, 0.0], 1.0));
    let floor = stage.mesh(&MeshFixture::rectangle(40.0, 40.0), Some(green));
    let roof = stage.mesh(&MeshFixture::rectangle(40.0, 40.0), Some(red));
    stage.node(floor, DAffine3::IDENTITY);
    stage.node(roof, DAffine3::from_translation(DVec3::Z * 3.0));
    let scene = stage.build();
    let middle = |height: f64| {
        let view = plan(DVec3::Z * height, DVec3::ZERO, 20.0);
        pixel(&draw(&scene, SIZE, &view), SIZE, 48, 32)
    };
    let (above, within) = (middle(5.0), middle(2.0));
    assert!(above[0] > 200 && above[1] < 50, "the roof: {above:?}");
    assert!(within[1] > 200 && within[0] < 50, "the floor: {within:?}");
}

#[test]
fn a_mirror_shows_one_light_to_parallel_rays() {
    let mut stage = SceneFixture::new();
    let metal = stage.material(Material {
        base_color: Vec4::ONE,
        metallic: 1.0,
        roughness: 0.35,
        ..Material::default()
    });
    let mirror = stage.mesh(&MeshFixture::rectangle(50.0, 50.0), Some(metal));
    stage.node(mirror, DAffine3::IDENTITY);
    let sun = Light { kind: LightKind::Directional, color: Vec3::ONE, intensity: 0.5, range: None };
    stage.light(sun, DAffine3::IDENTITY);
    let scene = stage.build();
    let spread = |view: &ViewDesc| {
        let pixels = draw(&scene, SIZE, view);
        let (least, most) =
            pixels.iter().fold((255, 0), |(least, most), p| (p[1].min(least), p[1].max(most)));
        most - least
    };
    let eye = DVec3::new(0.0, 0.0, 12.0);
    let from_a_point = spread(&look(eye, DVec3::ZERO, SIZE));
    assert!(from_a_point > 30, "a highlight falls off to the side: {from_a_point}");
    assert_eq!(spread(&plan(eye, DVec3::ZERO, 10.0)), 0, "every ray is mirrored alike");
}

/// Two panes side by side at one distance, which overlap in the middle.
fn panes() -> SceneFixture {
    let mut stage = SceneFixture::new();
    let red = stage.material(flat([1.0, 0.0, 0.0], 0.5));
    let blue = stage.material(flat([0.0, 0.0, 1.0], 0.5));
    for (x, material) in [(-1.0, red), (1.0, blue)] {
        let pane = stage.mesh(&MeshFixture::rectangle(1.5, 1.0), Some(material));
        stage.node(pane, DAffine3::from_translation(DVec3::new(x, 0.0, -3.0)));
    }
    stage
}

#[test]
fn both_eyes_agree_on_what_lies_over_what() {
    let scene = panes().build();
    let redness = |x: f64, middle: f64| {
        let eye = DVec3::new(x, 0.0, 0.0);
        let view = ViewDesc {
            middle_eye_in_world: DVec3::new(middle, 0.0, 0.0),
            ..look(eye, eye - DVec3::Z, SIZE)
        };
        let [red, _, blue, _] = pixel(&draw(&scene, SIZE, &view), SIZE, 48, 32);
        i32::from(red) - i32::from(blue)
    };
    // Each by itself has its own side in front.
    assert!(redness(-0.1, -0.1) > 20 && redness(0.1, 0.1) < -20);
    for middle in [-0.01, 0.01] {
        let (left, right) = (redness(-0.1, middle), redness(0.1, middle));
        assert_eq!(left, right, "both see what the middle sees");
        assert_eq!(left > 0, middle < 0.0);
    }
}

#[test]
fn panes_of_a_plan_are_sorted_by_depth_and_not_by_distance() {
    let mut stage = SceneFixture::new();
    let red = stage.material(flat([1.0, 0.0, 0.0], 0.5));
    let blue = stage.material(flat([0.0, 0.0, 1.0], 0.5));
    // The red one is nearer along the rays, and its centre farther from the camera.
    let near = stage.mesh(&MeshFixture::rectangle(12.0, 4.0), Some(red));
    let far = stage.mesh(&MeshFixture::rectangle(4.0, 4.0), Some(blue));
    stage.node(near, DAffine3::from_translation(DVec3::new(10.0, 0.0, -5.0)));
    stage.node(far, DAffine3::from_translation(DVec3::Z * -6.0));
    let scene = stage.build();
    let [red, _, blue, _] =
        pixel(&draw(&scene, SIZE, &plan(DVec3::ZERO, -DVec3::Z, 6.0)), SIZE, 48, 32);
    assert!(red > blue + 20, "{red} {blue}");
}

#[test]
fn culling_a_plan_changes_no_pixel() {
    let mut stage = SceneFixture::new();
    let material = stage.material(flat([0.8, 0.5, 0.2], 1.0));
    // Fine enough that its meshlets are culled one by one, and facing one way.
    let single = Material { double_sided: false, ..flat([0.2, 0.7, 0.3], 1.0) };
    let single = stage.material(single);
    let ball = stage.mesh(&MeshFixture::sphere(40).with_meshlets(256), Some(single));
    let tile = stage.mesh(&MeshFixture::rectangle(0.4, 0.4), Some(material));
    for i in 0..60 {
        let t = f64::from(i);
        let place = DVec3::new((t * 0.9).sin() * 9.0, (t * 1.7).cos() * 9.0, -t);
        stage.node(if i % 10 == 0 { ball } else { tile }, DAffine3::from_translation(place));
    }
    let scene = stage.build();
    let view = plan(DVec3::new(0.5, 0.2, 4.0), DVec3::new(-1.0, 0.3, -20.0), 10.0);
    let (whole, stats) = draw_sampled(&scene, SIZE, 1, std::slice::from_ref(&view));
    assert!(drawn(&whole) > 400 && stats.culled > 10 && stats.visible > 10, "{stats:?}");
    // Rectangle by rectangle, each culled on its own.
    let parts = (0..6).map(|i| {
        let scissor = Some([i % 3 * 32, i / 3 * 32, 32, 32]);
        ViewDesc { scissor, ..view.clone() }
    });
    let (parts, _) = draw_sampled(&scene, SIZE, 1, &parts.collect::<Vec<_>>());
    assert_eq!(differences(&whole, &parts), [0; 3]);
}
