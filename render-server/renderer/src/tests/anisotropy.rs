//! Materials whose highlights are longer in one direction, against formulas in f64.

use std::f64::consts::PI;
use std::sync::Arc;

use glam::{Affine2, DAffine3, DQuat, DVec3, Vec2, Vec3};
use polyptych_scene::{
    Anisotropy, Clearcoat, Light, LightKind, Material, MaterialExtensions, TextureFormat,
    TextureRef, Transmission,
};

use super::environment::{map, uniform};
use super::extensions::{coat_albedo, facets, schlick, with};
use super::furnace::{
    MIDDLE, aslant, material, radiance, radiance_in, radiance_of, radiance_of_mesh,
};
use super::harness::{MeshFixture, SceneFixture, gpu};
use crate::grain_albedo::tests::{facets as stretched_facets, integrated, spaced, stretched};
use crate::pipeline::{LayoutKey, PipelineVariant, Pipelines};
use crate::{Environment, ImageEncoding, SceneLayout, bindings};

fn brushed(material: Material, strength: f64, rotation: f64) -> Material {
    let anisotropy = Anisotropy {
        strength: strength as f32,
        rotation_rad: rotation as f32,
        ..Anisotropy::default()
    };
    with(
        material,
        MaterialExtensions { anisotropy: Some(anisotropy), ..MaterialExtensions::default() },
    )
}

/// A direction where highlights are longer along +x, of one where they are so at an angle from the
/// plate's tangent, +x.
fn turned(of: DVec3, rotation: f64) -> DVec3 {
    DQuat::from_rotation_z(-rotation) * of
}

/// Roughness and strength.
const BRUSHED: [(f64, f64); 5] = [(0.3, 0.6), (0.5, 0.9), (0.7, 0.4), (0.4, 1.0), (0.9, 0.7)];

/// Appendix B with the distribution and shadowing of `KHR_materials_anisotropy`, times π; the layer
/// compensated for light that meets several facets.
fn brdf(
    [base, metallic]: [f64; 2],
    (roughness, strength): (f64, f64),
    rotation: f64,
    (mu, light): (f64, DVec3),
) -> f64 {
    let alphas = stretched(roughness, strength);
    let (eye, toward) = (turned(aslant(mu), rotation), turned(light, rotation));
    let lost = 1.0 / integrated(eye, alphas)[0] - 1.0;
    let layer = |f0: f64| {
        schlick(f0, mu, light) * stretched_facets(alphas, eye, toward) * (1.0 + f0 * lost)
    };
    let dielectric = base * (1.0 - schlick(0.04, mu, light)) + layer(0.04);
    dielectric + metallic * (layer(base) - dielectric)
}

#[test]
fn a_light_is_reflected_by_strength_and_direction() {
    let opposite = DVec3::new(-0.8, 0.3, 0.5).normalize();
    for (toward, mu) in [(DVec3::Z, 1.0), (aslant(0.7), 0.4), (opposite, 0.3), (opposite, 0.6)] {
        for of in BRUSHED {
            for (base, metallic, rotation) in
                [(0.9, 1.0, 0.0), (0.9, 1.0, 0.9), (0.3, 0.0, 2.0), (0.6, 0.5, -1.3)]
            {
                let part = brdf([base, metallic], of, rotation, (mu, toward)) * toward.z / PI;
                if part < 1e-3 {
                    continue;
                }
                let plate = brushed(material(base, metallic, of.0), of.1, rotation);
                let got = radiance(plate, mu, 0.0, &[(toward, MIDDLE / part)]);
                let name = format!("{of:?}: {base}, {metallic}, {rotation} at {mu}");
                assert!((got / MIDDLE - 1.0).abs() < 0.01, "{got} instead of {MIDDLE}: {name}");
            }
        }
    }
}

#[test]
fn a_white_furnace_of_lights_stays_white() {
    for (roughness, strength) in BRUSHED {
        for (mu, rotation) in [(0.9, 0.0), (0.4, 0.4), (0.4, PI / 2.0), (0.2, 1.0)] {
            let alphas = stretched(roughness, strength);
            let eye = turned(aslant(mu), rotation);
            let lights: Vec<(DVec3, f64)> = spaced(alphas, 64)
                .map(|(h, solid_angle)| {
                    (h * 2.0 * eye.dot(h) - eye, 4.0 * eye.dot(h) * solid_angle)
                })
                .filter(|(toward, solid_angle)| toward.z > 0.0 && *solid_angle > 0.0)
                .map(|(toward, solid_angle)| (turned(toward, -rotation), MIDDLE * solid_angle))
                .collect();
            assert!(lights.len() > 1000, "{}", lights.len());
            let white = brushed(material(1.0, 1.0, roughness), strength, rotation);
            let part = radiance(white, mu, 0.0, &lights) / MIDDLE;
            let name = format!("{roughness}, {strength}, {mu}, {rotation}");
            println!("{part} of the light: {name}");
            assert!((part - 1.0).abs() < 0.01, "{part} of the light: {name}");
        }
    }
}

#[test]
fn a_white_furnace_of_surroundings_stays_white() {
    let environment = Arc::new(Environment::new(gpu(), &uniform([MIDDLE; 3])));
    for (roughness, strength) in [(0.0, 1.0), (0.2, 0.5), (0.6, 0.8), (1.0, 1.0)] {
        for (metallic, mu, rotation) in [(1.0, 0.9, 0.3), (0.0, 0.4, 1.2), (0.5, 0.1, 0.0)] {
            let white = brushed(material(1.0, metallic, roughness), strength, rotation);
            let name = format!("{roughness}, {strength}, {metallic}, {mu}, {rotation}");
            let part = radiance(white.clone(), mu, MIDDLE, &[]) / MIDDLE;
            assert!((part - 1.0).abs() < 0.01, "{part} of the light: {name}");
            let around = (0.0, Some(Arc::clone(&environment)));
            let part = radiance_in(white, mu, around, &[]) / MIDDLE;
            assert!((part - 1.0).abs() < 0.01, "{part} of the map's light: {name}");
        }
    }
}

#[test]
fn an_environment_is_mirrored_at_the_bent_normal() {
    let slope = DVec3::new(0.2, 0.1, 0.0);
    let light = |from: DVec3| MIDDLE + slope.dot(from.normalize());
    let around = map(|from| [light(from); 3], [[0.0; 3]; 9]);
    let environment = Arc::new(Environment::new(gpu(), &around));
    for (roughness, strength) in [(0.0f64, 1.0f64), (0.1, 0.7), (0.3, 0.5), (0.2, 0.0)] {
        for (mu, rotation) in [(0.6, 0.7), (0.8, -0.4), (0.5, PI / 2.0), (0.7, 0.0)] {
            // By Khronos' sample viewer, but for the lean of rough lobes towards the normal.
            let eye = aslant(mu);
            let across = DQuat::from_rotation_z(rotation) * DVec3::Y;
            let seen = across.cross(eye).cross(across);
            let bend = (1.0 - strength * (1.0 - roughness)).powi(4);
            let bent = (seen + (DVec3::Z - seen) * bend).normalize();
            let mirrored = bent * (2.0 * bent.dot(eye)) - eye;
            let wanted = light(mirrored + (DVec3::Z - mirrored) * roughness.powi(2));
            let plate = brushed(material(1.0, 1.0, roughness), strength, rotation);
            let got = radiance_in(plate, mu, (0.0, Some(Arc::clone(&environment))), &[]);
            let name = format!("{roughness}, {strength}, {mu}, {rotation}");
            assert!((got - wanted).abs() < 0.01, "{got} instead of {wanted}: {name}");
        }
    }
}

#[test]
fn a_texture_holds_direction_and_strength() {
    // (-0.6, 0.8) and 0.6; the other half is the tangent and 1.
    let texel = |u: f64, _| if u < 0.5 { [51, 230, 153, 255] } else { [255, 128, 255, 255] };
    for (offset, rotation, strength) in [(-0.25f32, 0.8f64.atan2(-0.6), 0.6), (0.25, 0.0, 1.0)] {
        let mut stage = SceneFixture::new();
        let texture = stage.picture((64, TextureFormat::Rgba8Linear), texel);
        let uv_transform = Affine2::from_translation(Vec2::X * offset);
        let mut textured = brushed(material(0.9, 1.0, 0.4), 0.9, 0.5);
        let extensions = textured.extensions.as_mut().expect("some");
        extensions.anisotropy.as_mut().expect("some").texture =
            Some(TextureRef { texture, uv_set: 0, uv_transform });
        let plain = brushed(material(0.9, 1.0, 0.4), 0.9 * strength, 0.5 + rotation);
        let lights = [(DVec3::new(-0.5, 0.2, 0.8).normalize(), 0.8)];
        let wanted = radiance(plain, 0.7, 0.0, &lights);
        let got = radiance_of((stage, textured), 0.7, (0.0, None), &lights);
        assert!((got / wanted - 1.0).abs() < 0.01, "{got} instead of {wanted} at {offset}");
    }
}

#[test]
fn a_clear_coat_above_has_no_direction() {
    let coat = Clearcoat { factor: 1.0, roughness: 0.3, ..Clearcoat::default() };
    let (toward, mu) = (DVec3::new(-0.6, 0.1, 0.8).normalize(), 0.7);
    for rotation in [0.0, 0.8, 1.5] {
        let mut plate = brushed(material(0.5, 1.0, 0.5), 0.9, rotation);
        plate.extensions.as_mut().expect("some").clearcoat = Some(coat.clone());
        let (reflected, many) = coat_albedo(mu, 0.3);
        let below = brdf([0.5, 1.0], (0.5, 0.9), rotation, (mu, toward)) * (1.0 - reflected);
        let above = many * schlick(0.04, mu, toward) * facets(0.3, mu, toward);
        let part = (below + above) * toward.z / PI;
        let got = radiance(plate, mu, 0.0, &[(toward, MIDDLE / part)]);
        assert!((got / MIDDLE - 1.0).abs() < 0.01, "{got} instead of {MIDDLE} at {rotation}");
    }
}

#[test]
fn where_tangents_stand_along_the_normal_there_is_no_direction() {
    let lights = [(DVec3::new(-0.5, 0.2, 0.8).normalize(), 0.5)];
    let plain = radiance(material(0.9, 1.0, 0.4), 0.7, 0.0, &lights);
    let mut stage = SceneFixture::new();
    let brushed = stage.material(brushed(material(0.9, 1.0, 0.4), 0.9, 0.5));
    let mut shape = MeshFixture::rectangle(50.0, 50.0);
    shape.vertices.iter_mut().for_each(|vertex| vertex[6..9].copy_from_slice(&[0.0, 0.0, 1.0]));
    let got = radiance_of_mesh(stage, (&shape, brushed), 0.7, (0.0, None), &lights);
    assert!((got / plain - 1.0).abs() < 0.003, "{got} instead of {plain}");
}

/// Returns the number of textures that the fragments of pipelines with these bindings read.
fn texture_count(of: LayoutKey) -> usize {
    let mut entries = bindings::frame_entries(of.frame);
    entries.extend(bindings::material_entries());
    if of.has_shadows {
        entries.extend(bindings::shadow_entries(of.has_lamp_shadows));
    }
    if of.has_extensions {
        entries.extend(bindings::extension_entries(of.has_grain));
    }
    entries.iter().filter(|entry| matches!(entry.ty, wgpu::BindingType::Texture { .. })).count()
}

/// A GL driver has 16 textures for a fragment, and no more.
#[test]
fn glass_with_a_grain_reads_sixteen_textures_where_lamps_have_no_maps() {
    let mut stage = SceneFixture::new();
    let mut glass = brushed(material(0.9, 0.0, 0.4), 0.9, 0.5);
    glass.extensions.as_mut().expect("some").transmission =
        Some(Transmission { factor: 1.0, texture: None });
    let glass = stage.material(glass);
    let mesh = stage.mesh(&MeshFixture::rectangle(1.0, 1.0), Some(glass));
    stage.node(mesh, DAffine3::IDENTITY);
    let (kind, color) = (LightKind::Point, Vec3::ONE);
    let lamp = Light { kind, color, intensity: 60.0, range: None };
    stage.light(lamp, DAffine3::from_translation(DVec3::Z));
    let layout = SceneLayout::new(stage.desc, &|| false).expect("sound");
    let all = PipelineVariant {
        content: ImageEncoding::Srgb,
        environment: true,
        fog: true,
        ambient_occlusion: true,
        is_light: false,
    };
    let mut pipelines = Pipelines::new(gpu(), 1);
    for (has_lamp_maps, wanted) in [(false, 16), (true, 17)] {
        pipelines.has_lamp_maps = has_lamp_maps;
        let counts = layout.keys.iter().map(|key| texture_count(pipelines.layout_key(key, all)));
        assert_eq!(counts.max(), Some(wanted), "maps of lamps: {has_lamp_maps}");
    }
}
