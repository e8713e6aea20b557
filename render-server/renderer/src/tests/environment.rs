//! Light from all around: as the sky where it is uniform, in its place where it is not, without a
//! seam; and tone mappers.

use std::sync::Arc;

use glam::{DAffine3, DVec3, Vec3};
use polyptych_scene::{AlphaMode, EnvironmentMap, Material, NodeTraits, ToneMapper};

use super::harness::{
    MeshFixture, SceneFixture, differences, draw, draw_sampled, gpu, look, matt, pixel,
};
use crate::tone::{f16_bits, linear_from_srgb, tone_map};
use crate::{Environment, GpuScene, ViewDesc};

const SIZE: [u32; 2] = [192, 128];
const SIDE: u32 = 64;

/// A map without a sun whose texels are the same on each level; by direction.
pub(super) fn map(radiance: impl Fn(DVec3) -> [f64; 3], diffuse: [[f32; 3]; 9]) -> EnvironmentMap {
    let mut texels = Vec::with_capacity(EnvironmentMap::texel_bytes_of(SIDE));
    for level in 0..EnvironmentMap::levels_of(SIDE) {
        let side = SIDE >> level;
        let at = |index: u32| (f64::from(index) * 2.0 + 1.0) / f64::from(side) - 1.0;
        let place = |face: u32, x: f64, y: f64| match face {
            0 => DVec3::new(1.0, -y, -x),
            1 => DVec3::new(-1.0, -y, x),
            2 => DVec3::new(x, 1.0, y),
            3 => DVec3::new(x, -1.0, -y),
            4 => DVec3::new(x, -y, 1.0),
            _ => DVec3::new(-x, -y, -1.0),
        };
        for index in 0..6 * side * side {
            let (face, row, column) = (index / (side * side), index / side % side, index % side);
            let [r, g, b] = radiance(place(face, at(column), at(row)).normalize());
            texels.extend([r, g, b, 1.0].into_iter().flat_map(|of| f16_bits(of).to_le_bytes()));
        }
    }
    EnvironmentMap { side: SIDE, diffuse, texels, has_sun: false }
}

/// An environment with this radiance from all directions.
pub(super) fn uniform(radiance: [f64; 3]) -> EnvironmentMap {
    let mut diffuse = [[0.0; 3]; 9];
    diffuse[0] = radiance.map(|number| number as f32);
    map(|_| radiance, diffuse)
}

/// Red from +X, green from above, blue from +Z; a little of all from everywhere.
fn coloured() -> EnvironmentMap {
    let mut diffuse = [[0.0; 3]; 9];
    diffuse[0] = [0.3; 3];
    map(|from| (from * 0.3 + 0.35).to_array(), diffuse)
}

fn surrounded(scene: &GpuScene, map: &EnvironmentMap) -> GpuScene {
    scene.with_environment(Some(Arc::new(Environment::new(gpu(), map))))
}

/// Balls of several materials, with a pane in front of one of them.
fn balls(alpha_mode: AlphaMode, sky: Vec3) -> SceneFixture {
    let mut stage = SceneFixture::new();
    stage.desc.sky = sky;
    stage.ground = Some(sky);
    for (column, metallic) in [0.0, 0.5, 1.0].into_iter().enumerate() {
        for (row, roughness) in [0.1, 0.5, 1.0].into_iter().enumerate() {
            let of = Material { roughness, metallic, ..matt(0.8, 0.5, 0.3) };
            let material = stage.material(of);
            let ball = stage.mesh(&MeshFixture::sphere(24), Some(material));
            let at = DVec3::new(column as f64 - 1.0, row as f64 - 1.0, 0.0) * 2.2;
            stage.node(ball, DAffine3::from_translation(at));
        }
    }
    let pane = Material {
        base_color: glam::Vec4::new(0.9, 0.3, 0.2, 0.4),
        alpha_mode,
        ..matt(1.0, 1.0, 1.0)
    };
    let pane = stage.material(pane);
    let pane = stage.mesh(&MeshFixture::rectangle(1.0, 1.0), Some(pane));
    stage.node(pane, DAffine3::from_translation(DVec3::new(1.0, 0.5, 2.0)));
    stage
}

fn view() -> ViewDesc {
    look(DVec3::new(1.0, 0.5, 9.0), DVec3::ZERO, SIZE)
}

#[test]
fn uniform_surroundings_are_as_a_uniform_sky() {
    let light = Vec3::new(0.3, 0.4, 0.55);
    for alpha_mode in [AlphaMode::Opaque, AlphaMode::Blend] {
        let scene = balls(alpha_mode, light).build();
        let around = uniform(light.to_array().map(f64::from));
        for samples in [1, 4] {
            let draw = |of: &GpuScene| draw_sampled(of, SIZE, samples, &[view()]).0;
            let (sky, environment) = (draw(&scene), draw(&surrounded(&scene, &around)));
            let [_, above_1, _] = differences(&sky, &environment);
            assert_eq!(above_1, 0, "{alpha_mode:?}, {samples} samples");
        }
    }
}

#[test]
fn the_sun_of_scenes_without_lights_does_not_shine_in_surroundings_with_one() {
    let light = Vec3::splat(0.3);
    let sunless = uniform(light.to_array().map(f64::from));
    let sunny = EnvironmentMap { has_sun: true, ..sunless.clone() };
    let mut stage = balls(AlphaMode::Opaque, light);
    let shown =
        |scene: &GpuScene, map: &EnvironmentMap| draw(&surrounded(scene, map), SIZE, &view());
    let scene = stage.build();
    let [with_sun, without] = [&sunless, &sunny].map(|map| shown(&scene, map));
    assert!(differences(&with_sun, &without)[2] > 300, "there is no sun");
    // A scene whose own light is dark has no other light, either.
    let dark = polyptych_scene::Light {
        kind: polyptych_scene::LightKind::Directional,
        color: Vec3::ONE,
        intensity: 0.0,
        range: None,
    };
    stage.light(dark, DAffine3::IDENTITY);
    let own = stage.build();
    for map in [&sunless, &sunny] {
        assert_eq!(differences(&shown(&own, map), &without), [0; 3]);
    }
    // One whose lights are all hidden is as one without.
    let nodes = stage.desc.nodes.len();
    let mut layer_of = vec![None; nodes];
    layer_of[nodes - 1] = Some(0);
    let layers = vec![("lamps".to_owned(), true)];
    let traits = NodeTraits { layers, layer_of, ..NodeTraits::of_file(nodes) };
    let hidden = stage.build_with(&traits);
    assert_eq!(differences(&shown(&hidden, &sunny), &without), [0; 3]);
    assert_eq!(differences(&shown(&hidden, &sunless), &with_sun)[1], 0);
}

#[test]
fn a_scene_without_its_environment_is_as_it_was() {
    let scene = balls(AlphaMode::Blend, Vec3::splat(0.3)).build();
    let before = draw(&scene, SIZE, &view());
    let within = surrounded(&scene, &coloured());
    assert_ne!(draw(&within, SIZE, &view()), before);
    assert_eq!(draw(&within.with_environment(None), SIZE, &view()), before);
}

#[test]
fn each_pixel_behind_a_scene_shows_its_direction() {
    let scene = surrounded(&SceneFixture::new().build(), &coloured());
    for at in [DVec3::NEG_Z, DVec3::X, DVec3::new(0.3, 0.9, 0.1), DVec3::new(-0.5, -0.7, 0.2)] {
        let view = ViewDesc { tone: ToneMapper::None, ..look(DVec3::ZERO, at, SIZE) };
        let pixels = draw(&scene, SIZE, &view);
        for [x, y] in [[0, 0], [96, 64], [191, 3], [40, 127]] {
            // By hand: 60° of field, as `look` has it.
            let half = 30f64.to_radians().tan();
            let up = (1.0 - (f64::from(y) + 0.5) / 64.0) * half;
            let right = ((f64::from(x) + 0.5) / 96.0 - 1.0) * half * 1.5;
            let ray = view.view_from_world.transpose() * DVec3::new(right, up, -1.0);
            let expected = ray.normalize() * 0.3 + 0.35;
            let got = pixel(&pixels, SIZE, x, y);
            for (code, light) in got.into_iter().zip(expected.to_array()) {
                let got = linear_from_srgb(code);
                assert!((got - light).abs() < 0.008, "{at} at {x}, {y}: {got}, not {light}");
            }
        }
    }
}

#[test]
fn tiles_show_the_surroundings_as_one_camera_does() {
    let [width, height] = SIZE.map(|side| side / 2);
    for (alpha_mode, samples) in [(AlphaMode::Opaque, 1), (AlphaMode::Blend, 4)] {
        let scene = balls(alpha_mode, Vec3::splat(0.3)).build();
        let scene = surrounded(&scene, &coloured());
        let whole = draw_sampled(&scene, SIZE, samples, &[view()]).0;
        for [x, y] in [[0, 0], [width, 0], [0, height], [width, height]] {
            let mut tile = view();
            tile.viewport[0] -= f64::from(x);
            tile.viewport[1] -= f64::from(y);
            let tile = draw_sampled(&scene, [width, height], samples, &[tile]).0;
            let of_whole: Vec<_> = (0..height)
                .flat_map(|row| (0..width).map(move |column| (x + column, y + row)))
                .map(|(x, y)| pixel(&whole, SIZE, x, y))
                .collect();
            // Varyings of surfaces are rounded from where a tile begins: a code may tip over.
            let [differing, above_1, _] = differences(&tile, &of_whole);
            assert_eq!(above_1, 0, "{alpha_mode:?} at {x}, {y}");
            let share = differing as f64 / of_whole.len() as f64;
            assert!(share <= 0.005, "{alpha_mode:?} at {x}, {y}: {share}");
        }
    }
}

#[test]
fn surroundings_are_as_bright_beside_lights_in_real_units() {
    let mut stage = balls(AlphaMode::Blend, Vec3::splat(0.3));
    let dark = polyptych_scene::Light {
        kind: polyptych_scene::LightKind::Directional,
        color: Vec3::ONE,
        intensity: 0.0,
        range: None,
    };
    stage.light(dark, DAffine3::IDENTITY);
    let [plain, lux] = [None, Some(1.0 / 512.0)].map(|exposure| {
        stage.desc.exposure = exposure;
        let view = ViewDesc { exposure: exposure.unwrap_or(1.0), ..view() };
        draw(&surrounded(&stage.build(), &coloured()), SIZE, &view)
    });
    assert_eq!(differences(&plain, &lux), [0; 3]);
}

#[test]
fn a_mirror_shows_what_is_behind_the_eye() {
    let mut stage = SceneFixture::new();
    let mirror = Material { roughness: 0.0, metallic: 1.0, ..matt(1.0, 1.0, 1.0) };
    let mirror = stage.material(mirror);
    let plate = stage.mesh(&MeshFixture::rectangle(9.0, 9.0), Some(mirror));
    stage.node(plate, DAffine3::IDENTITY);
    let dark = polyptych_scene::Light {
        kind: polyptych_scene::LightKind::Directional,
        color: Vec3::ONE,
        intensity: 0.0,
        range: None,
    };
    stage.light(dark, DAffine3::IDENTITY);
    let scene = surrounded(&stage.build(), &coloured());
    let eye = DVec3::new(2.0, 1.0, 3.0);
    let view = ViewDesc { tone: ToneMapper::None, ..look(eye, DVec3::ZERO, SIZE) };
    let [r, g, b, _] = pixel(&draw(&scene, SIZE, &view), SIZE, 96, 64);
    let mirrored = DVec3::new(-2.0, -1.0, 3.0).normalize() * 0.3 + 0.35;
    for (code, light) in [r, g, b].into_iter().zip(mirrored.to_array()) {
        let got = linear_from_srgb(code);
        assert!((got - light).abs() < 0.02, "{got}, not {light} of {mirrored}");
    }
}

#[test]
fn each_tone_mapper_shows_what_its_twin_says() {
    let light = Vec3::new(0.2, 0.9, 1.7);
    for alpha_mode in [AlphaMode::Opaque, AlphaMode::Blend] {
        let stage = balls(alpha_mode, light);
        let scene = stage.build();
        let around = surrounded(&scene, &uniform(light.to_array().map(f64::from)));
        for tone in ToneMapper::ALL {
            let expected = tone_map(tone, light);
            for scene in [&scene, &around] {
                let shown = draw(scene, SIZE, &ViewDesc { tone, ..view() });
                let corner = pixel(&shown, SIZE, 0, 0);
                for (code, light) in corner.into_iter().zip(expected.to_array()) {
                    let got = linear_from_srgb(code);
                    assert!((got - f64::from(light)).abs() < 0.006, "{tone:?}: {got}, {light}");
                }
            }
        }
    }
}
