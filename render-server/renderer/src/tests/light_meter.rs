//! The light of a picture, which neither exposure nor tone mapping changes.

use glam::{DAffine3, DVec3, Vec3, Vec4};
use polyptych_scene::{AlphaMode, Material, ToneMapper};

use super::harness::{MeshFixture, SceneFixture, gpu, look};
use crate::{GpuScene, Renderer, ViewDesc};

const SIZE: [u32; 2] = [40, 20];

/// A wall to the left that glows in this light, and an unlit one to the right; `is_blended` adds
/// a pane that nobody sees.
fn scene(glow: f32, is_blended: bool) -> GpuScene {
    let mut stage = SceneFixture::new();
    let dark = Material { base_color: Vec4::new(0.0, 0.0, 0.0, 1.0), ..Material::default() };
    let specular_free = Material { metallic: 0.0, roughness: 1.0, ..dark };
    let glowing = Material { emissive: Vec3::splat(glow), ..specular_free };
    let unlit = Material { unlit: true, base_color: Vec4::ONE, ..Material::default() };
    let half = MeshFixture::rectangle(2.0, 4.0);
    for (material, x) in [(glowing, -2.0), (unlit, 2.0)] {
        let material = stage.material(material);
        let mesh = stage.mesh(&half, Some(material));
        stage.node(mesh, DAffine3::from_translation(DVec3::new(x, 0.0, 0.0)));
    }
    if is_blended {
        let pane = Material { alpha_mode: AlphaMode::Blend, ..Material::default() };
        let pane = stage.material(pane);
        let mesh = stage.mesh(&MeshFixture::rectangle(1.0, 1.0), Some(pane));
        stage.node(mesh, DAffine3::from_translation(DVec3::Z * 100.0));
    }
    stage.build()
}

#[test]
fn light_is_measured_in_the_scenes_units_where_the_scene_has_any() {
    let gpu = gpu();
    for samples in [1, 4] {
        let mut renderer = Renderer::new(gpu, samples).expect("a renderer");
        for (glow, is_blended) in [(0.004, false), (2.0, true), (900.0, false), (30_000.0, true)] {
            let scene = scene(glow, is_blended);
            renderer.prepare(gpu, &scene);
            for (exposure, tone) in [(1.0, ToneMapper::Neutral), (0.01, ToneMapper::Aces)] {
                let eye = DVec3::Z * 8.0;
                let view = ViewDesc { exposure, tone, ..look(eye, DVec3::ZERO, SIZE) };
                let mut told = renderer.luminances(gpu, &scene, SIZE, &[view]).expect("measured");
                told.sort_by(f32::total_cmp);
                let pixels = (SIZE[0] * SIZE[1]) as usize;
                assert!(told.len() > pixels / 20 && told.len() < pixels / 2, "{}", told.len());
                // The default sun adds a little at most, by reflection of a dark surface.
                let middle = told[told.len() / 2];
                let off = middle / glow - 1.0;
                assert!(off > -0.01 && off < 0.01 + 0.2 / glow, "{glow} at {exposure}: {middle}");
            }
        }
    }
}

#[test]
fn nothing_is_no_light_and_too_much_is_told_as_the_most() {
    let gpu = gpu();
    let mut renderer = Renderer::new(gpu, 1).expect("a renderer");
    let empty = SceneFixture::new().build();
    let view = look(DVec3::Z * 8.0, DVec3::ZERO, SIZE);
    let told = renderer.luminances(gpu, &empty, SIZE, std::slice::from_ref(&view));
    assert_eq!(told.expect("measured"), [0.0f32; 0]);
    let bright = scene(1e9, false);
    let told = renderer.luminances(gpu, &bright, SIZE, &[view]).expect("measured");
    assert!(told.iter().all(|light| *light <= 65_504.0), "{told:?}");
    assert!(told.iter().any(|light| *light > 32_000.0), "{told:?}");
}
