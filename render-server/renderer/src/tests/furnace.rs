//! The light of materials against integrals in f64: what absorbs nothing is as bright as what is
//! around it, however rough, and a fraction of metal is a mix of two materials.

use std::f64::consts::PI;
use std::sync::Arc;

use glam::{DAffine3, DMat4, DQuat, DVec3, Vec3, Vec4};
use polyptych_scene::{Light, LightKind, Material, ToneMapper};

use super::environment::uniform;
use super::harness::{MeshFixture, SceneFixture, draw, gpu, look, pixel};
use crate::albedo::tests::integrated;
use crate::tone::f16_from_bits;
use crate::{Environment, ImageEncoding, Renderer, Target, ViewDesc, read_pixels};

const F0: f64 = 0.04;

/// Radiance at which measured surfaces are kept: the tone mapper only shifts it.
pub(super) const MIDDLE: f64 = 0.4;

pub(super) fn material(base: f64, metallic: f64, roughness: f64) -> Material {
    Material {
        base_color: Vec3::splat(base as f32).extend(1.0),
        metallic: metallic as f32,
        roughness: roughness as f32,
        ..Material::default()
    }
}

/// The direction of an angle from +z, whose cosine is given, towards +x.
pub(super) fn aslant(cos: f64) -> DVec3 {
    DVec3::new((1.0 - cos * cos).sqrt(), 0.0, cos)
}

fn shine(stage: &mut SceneFixture, toward: DVec3, irradiance: f64) {
    let light = Light {
        kind: LightKind::Directional,
        color: Vec3::ONE,
        intensity: irradiance as f32,
        range: None,
    };
    let along = DQuat::from_rotation_arc(DVec3::NEG_Z, -toward);
    stage.light(light, DAffine3::from_quat(along));
}

/// Radiance of a plate that faces +z, in one pixel, seen at an angle of this cosine. It hangs in
/// uniform surroundings, under lights given by the direction towards them and their irradiance.
pub(super) fn radiance(material: Material, mu: f64, around: f64, lights: &[(DVec3, f64)]) -> f64 {
    radiance_in(material, mu, (around, None), lights)
}

/// Radiance of a plate in these surroundings: as [`radiance`] has it, but with a map if given.
pub(super) fn radiance_in(
    material: Material,
    mu: f64,
    around: (f64, Option<Arc<Environment>>),
    lights: &[(DVec3, f64)],
) -> f64 {
    radiance_of((SceneFixture::new(), material), mu, around, lights)
}

/// Radiance of a plate with a material whose textures the scene has.
pub(super) fn radiance_of(
    (mut stage, material): (SceneFixture, Material),
    mu: f64,
    around: (f64, Option<Arc<Environment>>),
    lights: &[(DVec3, f64)],
) -> f64 {
    let material = stage.material(material);
    radiance_of_mesh(stage, (&MeshFixture::rectangle(50.0, 50.0), material), mu, around, lights)
}

/// Radiance of another plate, with a material of the scene.
pub(super) fn radiance_of_mesh(
    stage: SceneFixture,
    plate: (&MeshFixture, u32),
    mu: f64,
    around: (f64, Option<Arc<Environment>>),
    lights: &[(DVec3, f64)],
) -> f64 {
    let shown = shown(stage, plate, mu, around, (lights, ToneMapper::default())).x;
    assert!((0.05..0.75).contains(&shown), "{shown} is not in the middle of the tone mapper");
    // Khronos PBR Neutral there.
    shown + 0.04
}

/// Radiance of a plate in three colours, each less than 1.
pub(super) fn color_of(
    (mut stage, material): (SceneFixture, Material),
    mu: f64,
    around: (f64, Option<Arc<Environment>>),
    lights: &[(DVec3, f64)],
) -> DVec3 {
    let material = stage.material(material);
    color_of_mesh(stage, (&MeshFixture::rectangle(50.0, 50.0), material), mu, around, lights)
}

/// Radiance of another plate in three colours, with a material of the scene.
pub(super) fn color_of_mesh(
    stage: SceneFixture,
    plate: (&MeshFixture, u32),
    mu: f64,
    around: (f64, Option<Arc<Environment>>),
    lights: &[(DVec3, f64)],
) -> DVec3 {
    let shown = shown(stage, plate, mu, around, (lights, ToneMapper::None));
    assert!(shown.max_element() < 1.0, "{shown} is cut by the tone mapper");
    shown
}

fn shown(
    mut stage: SceneFixture,
    (shape, material): (&MeshFixture, u32),
    mu: f64,
    (around, environment): (f64, Option<Arc<Environment>>),
    (lights, tone): (&[(DVec3, f64)], ToneMapper),
) -> DVec3 {
    stage.desc.sky = Vec3::splat(around as f32);
    stage.ground = Some(stage.desc.sky);
    let mesh = stage.mesh(shape, Some(material));
    stage.node(mesh, DAffine3::IDENTITY);
    // Without any light there would be the default sun.
    shine(&mut stage, DVec3::Z, 0.0);
    for (toward, irradiance) in lights {
        shine(&mut stage, *toward, *irradiance);
    }
    let scene = stage.build().with_environment(environment);
    let mut renderer = Renderer::new(gpu(), 1).unwrap();
    let view = look(aslant(mu) * 3.0, DVec3::ZERO, [1, 1]);
    // GPUs place vertices to 1/256 of a pixel, which is to be a small angle.
    let narrow = DMat4::from_scale(DVec3::new(50.0, 50.0, 1.0));
    let view = ViewDesc { tone, clip_from_view: narrow * view.clip_from_view, ..view };
    renderer.prepare_for(gpu(), &scene, ImageEncoding::Light);
    let mut target =
        Target::with_encoding(gpu(), [1, 1], 1, scene.has_transparency(), ImageEncoding::Light)
            .unwrap();
    renderer.draw(gpu(), &scene, &mut target, &[view]).unwrap();
    let bytes = read_pixels(gpu(), &target).unwrap();
    let channel = |at: usize| f16_from_bits(u16::from_le_bytes([bytes[2 * at], bytes[2 * at + 1]]));
    DVec3::new(channel(0), channel(1), channel(2))
}

/// Part of uniform surroundings that a layer of this f0 reflects, many times included.
fn layer([e, b]: [f64; 2], f0: f64) -> f64 {
    (f0 * e + (1.0 - f0) * b) * (1.0 + f0 * (1.0 / e - 1.0))
}

#[test]
fn a_white_furnace_stays_white_for_every_roughness_and_metal() {
    for roughness in [0.0, 0.1, 0.3, 0.6, 0.8, 1.0] {
        for metallic in [0.0, 0.3, 0.5, 1.0] {
            for mu in [1.0, 0.6, 0.2, 0.05] {
                let white = material(1.0, metallic, roughness);
                let part = radiance(white, mu, MIDDLE, &[]) / MIDDLE;
                let name = format!("roughness {roughness}, metal {metallic}, cosine {mu}");
                assert!((part - 1.0).abs() < 0.01, "{part} of the light: {name}");
            }
        }
    }
}

#[test]
fn a_white_furnace_of_an_environment_stays_white_for_every_roughness_and_metal() {
    let map = uniform([MIDDLE; 3]);
    let environment = Arc::new(Environment::new(gpu(), &map));
    for roughness in [0.0, 0.1, 0.3, 0.6, 0.8, 1.0] {
        for metallic in [0.0, 0.5, 1.0] {
            for mu in [1.0, 0.6, 0.2, 0.05] {
                let white = material(1.0, metallic, roughness);
                // The sky itself is dark: all light is the environment's.
                let around = (0.0, Some(Arc::clone(&environment)));
                let part = radiance_in(white, mu, around, &[]) / MIDDLE;
                let name = format!("roughness {roughness}, metal {metallic}, cosine {mu}");
                assert!((part - 1.0).abs() < 0.01, "{part} of the light: {name}");
            }
        }
    }
}

#[test]
fn surroundings_are_reflected_as_much_as_the_integral_says() {
    for roughness in [0.3, 0.6, 1.0] {
        for mu in [1.0, 0.5, 0.2] {
            let sums = integrated(mu, roughness);
            for (base, metallic) in [(0.0, 0.0), (0.5, 0.0), (0.5, 1.0), (0.5, 0.5)] {
                let dielectric = layer(sums, F0) + base * (1.0 - layer(sums, F0));
                let wanted = dielectric + metallic * (layer(sums, base) - dielectric);
                let got = radiance(material(base, metallic, roughness), mu, MIDDLE / wanted, &[]);
                let ratio = got / MIDDLE;
                let name = format!("base {base}, metal {metallic}, roughness {roughness}, {mu}");
                assert!((ratio - 1.0).abs() < 0.015, "{ratio} of {wanted}: {name}");
                assert!(ratio * wanted < 1.001, "{name}: more light than there is");
            }
        }
    }
}

/// Lights around a plate that stand for a radiance of `around` from everywhere, close where the
/// plate mirrors: facets are spaced by GGX, and light comes from where they mirror the eye.
pub(super) fn furnace_of_lights(mu: f64, roughness: f64, around: f64) -> Vec<(DVec3, f64)> {
    const STEPS: usize = 64;
    let alpha2 = roughness.powi(4);
    let eye = aslant(mu);
    let mut lights = Vec::new();
    for (i, j) in (0..STEPS).flat_map(|i| (0..STEPS).map(move |j| (i, j))) {
        let u = (i as f64 + 0.5) / STEPS as f64;
        let h_z2 = (1.0 - u) / (1.0 + (alpha2 - 1.0) * u);
        let angle = PI * (j as f64 + 0.5) / STEPS as f64;
        let (sin, cos) = angle.sin_cos();
        let h = DVec3::new((1.0 - h_z2).sqrt() * cos, (1.0 - h_z2).sqrt() * sin, h_z2.sqrt());
        let toward = h * 2.0 * eye.dot(h) - eye;
        let density = alpha2 / (PI * ((alpha2 - 1.0) * h_z2 + 1.0).powi(2)) * h.z;
        let solid_angle = 4.0 * eye.dot(h) / (density * (STEPS * STEPS) as f64);
        if solid_angle > 0.0 && toward.z > 0.0 {
            lights.push((toward, around * solid_angle));
        }
    }
    lights
}

#[test]
fn a_white_furnace_of_lights_stays_white() {
    for roughness in [0.3, 0.6, 1.0] {
        for mu in [0.9, 0.4] {
            let lights = furnace_of_lights(mu, roughness, MIDDLE);
            assert!(lights.len() > 400, "{}", lights.len());
            let part = radiance(material(1.0, 1.0, roughness), mu, 0.0, &lights) / MIDDLE;
            assert!((part - 1.0).abs() < 0.01, "{part} of the light: {roughness}, {mu}");
        }
    }
}

/// Appendix B of glTF 2.0 for one light, times π: `mix(dielectric_brdf, metal_brdf, metallic)`,
/// each layer compensated.
fn brdf([base, metallic, roughness]: [f64; 3], mu: f64, light: DVec3) -> f64 {
    let (eye, alpha2) = (aslant(mu), roughness.powi(4));
    let h = (eye + light).normalize();
    let d = alpha2 / ((alpha2 - 1.0) * h.z * h.z + 1.0).powi(2);
    let lit = light.z * (mu * mu * (1.0 - alpha2) + alpha2).sqrt();
    let seen = mu * (light.z * light.z * (1.0 - alpha2) + alpha2).sqrt();
    let specular = d * 0.5 / (lit + seen);
    let c5 = (1.0 - eye.dot(h)).powi(5);
    let fresnel = |f0: f64| f0 + (1.0 - f0) * c5;
    let many = |f0: f64| 1.0 + f0 * (1.0 / integrated(mu, roughness)[0] - 1.0);
    let dielectric = base * (1.0 - fresnel(F0)) + fresnel(F0) * specular * many(F0);
    let metal = fresnel(base) * specular * many(base);
    dielectric + metallic * (metal - dielectric)
}

#[test]
fn light_on_a_fraction_of_metal_is_a_mix_of_both_materials() {
    let opposite = DVec3::new(-0.8, 0.3, 0.5).normalize();
    for (toward, mu) in [(DVec3::Z, 1.0), (aslant(0.7), 0.4), (opposite, 0.3)] {
        for metallic in [0.0, 0.25, 0.5, 0.9, 1.0] {
            for (base, roughness) in [(0.9, 0.7), (0.3, 0.5), (1.0, 1.0)] {
                let part = brdf([base, metallic, roughness], mu, toward) * toward.z / PI;
                let lights = [(toward, MIDDLE / part)];
                let got = radiance(material(base, metallic, roughness), mu, 0.0, &lights);
                let name = format!("base {base}, metal {metallic}, roughness {roughness}, {mu}");
                assert!((got / MIDDLE - 1.0).abs() < 0.01, "{got} instead of {MIDDLE}: {name}");
            }
        }
    }
}

#[test]
fn a_normal_that_turns_away_from_the_eye_reflects_as_at_a_grazing_angle() {
    let brightness = |away: f32| {
        let mut stage = SceneFixture::new();
        stage.desc.sky = Vec3::splat(0.3);
        stage.ground = Some(stage.desc.sky);
        let black = stage.material(material(0.0, 0.0, 0.0));
        let corners = [Vec3::new(-9.0, -9.0, 0.0), Vec3::X * 9.0, Vec3::Y * 9.0];
        let normal = Vec3::new((1.0 - away * away).sqrt(), 0.0, -away);
        let mesh = stage.mesh(&MeshFixture::triangle(corners, normal), Some(black));
        stage.node(mesh, DAffine3::IDENTITY);
        shine(&mut stage, DVec3::Z, 0.0);
        let view = look(DVec3::Z * 3.0, DVec3::ZERO, [8, 8]);
        pixel(&draw(&stage.build(), [8, 8], &view), [8, 8], 4, 4)[0]
    };
    let sky = brightness(0.0);
    assert!(sky > 120, "{sky}");
    for away in [0.1, 0.5, 0.9] {
        assert!(brightness(away).abs_diff(sky) <= 1, "{} of {sky} at {away}", brightness(away));
    }
    assert!(brightness(-0.9) < sky / 2, "seen from the front it hardly reflects");
}

#[test]
fn small_smooth_metal_has_its_highlight_wherever_it_stands() {
    let size = [32, 32];
    for shift in 0..16 {
        let mut stage = SceneFixture::new();
        stage.desc.sky = Vec3::splat(0.02);
        let smooth = Material { roughness: 0.05, ..Material::default() };
        let smooth = stage.material(Material { base_color: Vec4::ONE, ..smooth });
        let ball = stage.mesh(&MeshFixture::sphere(32), Some(smooth));
        // Four pixels of radius, moved by parts of one.
        let moved = DVec3::new(f64::from(shift % 4), f64::from(shift / 4), 0.0) * 0.25;
        let pixel_m = 0.25;
        stage.node(ball, DAffine3::from_translation(moved * pixel_m));
        shine(&mut stage, DVec3::new(0.4, 0.5, 0.8).normalize(), 3.0);
        let view = ViewDesc { exposure: 1.0, ..look(DVec3::Z * 6.93, DVec3::ZERO, size) };
        let pixels = draw(&stage.build(), size, &view);
        let brightest = pixels.iter().map(|p| p[0]).max();
        assert!(brightest > Some(150), "{brightest:?} at {moved}");
        let lit = pixels.iter().filter(|p| p[0] > 150).count();
        assert!(lit < 30, "the highlight is as large as the ball: {lit}");
        assert!(pixel(&pixels, size, 0, 0)[0] < 60);
    }
}
