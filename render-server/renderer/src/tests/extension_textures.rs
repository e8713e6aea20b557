//! Textures of extensions against the same numbers as factors.

use std::f64::consts::PI;

use glam::{Affine2, DQuat, DVec3, Vec2, Vec3};
use polyptych_scene::{
    AlphaMode, Clearcoat, Material, MaterialExtensions, Sheen, Specular, TextureFormat, TextureRef,
};

use super::extensions::{coat_albedo, facets, schlick, with};
use super::furnace::{MIDDLE, aslant, material, radiance, radiance_of};
use super::harness::SceneFixture;

/// A texture with one texel on its left half and another on its right, at whose border the
/// measured place lies; `at` moves it into a half.
struct Halves {
    stage: SceneFixture,
    texture: u32,
}

impl Halves {
    fn new(format: TextureFormat, [left, right]: [[u8; 4]; 2]) -> Self {
        let mut stage = SceneFixture::new();
        let texel = |u: f64, _| if u < 0.5 { left } else { right };
        let texture = stage.picture((64, format), texel);
        Self { stage, texture }
    }

    fn at(&self, offset: f32) -> TextureRef {
        let uv_transform = Affine2::from_translation(Vec2::X * offset);
        TextureRef { texture: self.texture, uv_set: 0, uv_transform }
    }
}

const POSE: (DVec3, f64) = (DVec3::new(-0.6, 0.0, 0.8), 0.7);

fn measured(stage: SceneFixture, extensions: MaterialExtensions, irradiance: f64) -> f64 {
    let of = with(material(0.5, 0.0, 0.6), extensions);
    radiance_of((stage, of), POSE.1, (0.0, None), &[(POSE.0, irradiance)])
}

#[test]
fn red_of_a_texture_is_the_part_of_a_clear_coat_and_green_its_roughness() {
    let coat = |coat| MaterialExtensions { clearcoat: Some(coat), ..MaterialExtensions::default() };
    let whole = Clearcoat { factor: 0.8, roughness: 0.9, ..Clearcoat::default() };
    for (part, rough) in [(0.25, 0.25), (-0.25, 0.25), (-0.25, -0.25)] {
        let half = Halves::new(TextureFormat::Rgba8Linear, [[51, 204, 0, 0], [204, 102, 9, 9]]);
        let textured = Clearcoat {
            texture: Some(half.at(part)),
            roughness_texture: Some(half.at(rough)),
            ..whole.clone()
        };
        let factor = whole.factor * if part > 0.0 { 0.8 } else { 0.2 };
        let roughness = whole.roughness * if rough > 0.0 { 0.4 } else { 0.8 };
        let plain = coat(Clearcoat { factor, roughness, ..Clearcoat::default() });
        let wanted = measured(SceneFixture::new(), plain, 2.0);
        let got = measured(half.stage, coat(textured), 2.0);
        assert!((got / wanted - 1.0).abs() < 0.003, "{got} instead of {wanted}: {part} {rough}");
    }
}

#[test]
fn a_clear_coat_has_normals_of_its_own() {
    let texels = [[163, 102, 247, 255], [128, 128, 255, 255]];
    let scale = 0.5;
    for (offset, texel) in [(-0.25, texels[0]), (0.25, texels[1])] {
        let [x, y, z] = [0, 1, 2].map(|at| f64::from(texel[at]) / 127.5 - 1.0);
        let normal = DVec3::new(x * scale, y * scale, z).normalize();
        let half = Halves::new(TextureFormat::Rgba8Linear, texels);
        let coat = Clearcoat {
            factor: 1.0,
            roughness: 0.5,
            normal_scale: scale as f32,
            normal_texture: Some(half.at(offset)),
            ..Clearcoat::default()
        };
        // Nothing is reflected below the coat.
        let specular = Some(Specular { factor: 0.0, ..Specular::default() });
        let of = with(
            material(0.0, 0.0, 1.0),
            MaterialExtensions { specular, clearcoat: Some(coat), ..MaterialExtensions::default() },
        );
        // The layer's formula where its normal is +z and the eye lies in the plane of x and z.
        let (toward, eye) = (aslant(0.9), aslant(0.8));
        let turn = DQuat::from_rotation_arc(normal, DVec3::Z);
        let (toward_here, eye_here) = (turn * toward, turn * eye);
        let around = DQuat::from_rotation_z(-eye_here.y.atan2(eye_here.x));
        let (light, mu) = (around * toward_here, eye_here.z);
        let brdf = coat_albedo(mu, 0.5).1 * schlick(0.04, mu, light) * facets(0.5, mu, light);
        let wanted = brdf * light.z / PI;
        let lights = [(toward, MIDDLE / wanted)];
        let got = radiance_of((half.stage, of), 0.8, (0.0, None), &lights);
        assert!((got / MIDDLE - 1.0).abs() < 0.01, "{got} instead of {MIDDLE} at {offset}");
    }
}

#[test]
fn a_normal_map_of_the_material_does_not_bend_a_clear_coat() {
    let coat = Clearcoat { factor: 1.0, roughness: 0.3, ..Clearcoat::default() };
    let specular = Some(Specular { factor: 0.0, ..Specular::default() });
    let coated =
        MaterialExtensions { specular, clearcoat: Some(coat), ..MaterialExtensions::default() };
    let black = with(material(0.0, 0.0, 1.0), coated);
    let brdf = schlick(0.04, POSE.1, POSE.0) * facets(0.3, POSE.1, POSE.0);
    let lights = [(POSE.0, MIDDLE * PI / (brdf * POSE.0.z))];
    let wanted = radiance(black.clone(), POSE.1, 0.0, &lights);
    let half = Halves::new(TextureFormat::Rgba8Linear, [[200, 90, 220, 255]; 2]);
    let mut bent = black;
    bent.normal_texture = Some(half.at(0.0));
    let got = radiance_of((half.stage, bent), POSE.1, (0.0, None), &lights);
    assert!((got / wanted - 1.0).abs() < 0.003, "{got} instead of {wanted}");
}

#[test]
fn a_texture_is_the_colour_of_a_sheen_and_its_alpha_the_roughness() {
    let sheen = |sheen| MaterialExtensions { sheen: Some(sheen), ..MaterialExtensions::default() };
    let whole = Sheen { color: Vec3::splat(0.9), roughness: 0.9, ..Sheen::default() };
    for (color, rough) in [(0.25, 0.25), (-0.25, 0.25), (-0.25, -0.25)] {
        // 188 is 0.503 of the light, 255 all of it.
        let half =
            Halves::new(TextureFormat::Rgba8Srgb, [[188, 188, 188, 204], [255, 255, 255, 102]]);
        let textured = Sheen {
            color_texture: Some(half.at(color)),
            roughness_texture: Some(half.at(rough)),
            ..whole.clone()
        };
        let color = whole.color * if color > 0.0 { 1.0 } else { 0.5029 };
        let roughness = whole.roughness * if rough > 0.0 { 0.4 } else { 0.8 };
        let plain = sheen(Sheen { color, roughness, ..Sheen::default() });
        let wanted = measured(SceneFixture::new(), plain, 2.0);
        let got = measured(half.stage, sheen(textured), 2.0);
        assert!((got / wanted - 1.0).abs() < 0.003, "{got} instead of {wanted}: {rough}");
    }
}

#[test]
fn a_texture_of_a_clear_coat_weighs_the_same_under_a_mask_and_cuts_nothing() {
    for part in [0.25, -0.25] {
        let lit = |alpha_mode: AlphaMode| {
            // Its alpha is below the cutoff.
            let half = Halves::new(TextureFormat::Rgba8Linear, [[51, 204, 0, 0], [204, 102, 9, 9]]);
            let coat = Clearcoat {
                factor: 0.8,
                roughness: 0.9,
                texture: Some(half.at(part)),
                roughness_texture: Some(half.at(part)),
                ..Clearcoat::default()
            };
            let coated =
                MaterialExtensions { clearcoat: Some(coat), ..MaterialExtensions::default() };
            let of = Material { alpha_mode, ..with(material(0.5, 0.0, 0.6), coated) };
            radiance_of((half.stage, of), POSE.1, (0.0, None), &[(POSE.0, 2.0)])
        };
        let [whole, masked] = [AlphaMode::Opaque, AlphaMode::Mask(0.5)].map(lit);
        assert!((masked / whole - 1.0).abs() < 0.003, "{masked} instead of {whole}: {part}");
    }
}
