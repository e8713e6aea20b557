//! Light that passes surfaces and is scattered evenly, against formulas in f64.

use std::f64::consts::PI;
use std::sync::Arc;

use glam::{Affine2, DAffine3, DVec3, Vec2, Vec3};
use polyptych_scene::{
    DiffuseTransmission, Material, MaterialExtensions, Sheen, Specular, TextureFormat, TextureRef,
    Transmission, Volume,
};

use super::environment::{map, uniform};
use super::extensions::{schlick, with};
use super::furnace::{MIDDLE, aslant, color_of, material, radiance, radiance_in, radiance_of};
use super::harness::{MeshFixture, SceneFixture, gpu};
use crate::Environment;
use crate::albedo::tests::integrated;

fn translucent(material: Material, factor: f64, color: Vec3) -> Material {
    let diffuse_transmission = Some(DiffuseTransmission {
        factor: factor as f32,
        color,
        ..DiffuseTransmission::default()
    });
    with(material, MaterialExtensions { diffuse_transmission, ..MaterialExtensions::default() })
}

/// A direction on the other side of the plate.
fn behind(of: DVec3) -> DVec3 {
    of * DVec3::new(1.0, 1.0, -1.0)
}

/// The extension's `diffuse_btdf` below the layer, times π: the part that passes that is what it is
/// for a light at the mirrored place.
fn through([metallic, factor]: [f64; 2], f0: f64, (mu, light): (f64, DVec3)) -> f64 {
    factor * (1.0 - metallic) * (1.0 - schlick(f0, mu, behind(light)))
}

#[test]
fn a_light_behind_a_surface_shines_through() {
    let slanted = DVec3::new(-0.8, 0.3, 0.5).normalize();
    for (toward, mu) in [(DVec3::Z, 1.0), (aslant(0.7), 0.4), (slanted, 0.3), (slanted, 0.6)] {
        for (base, metallic, factor) in [(0.9, 0.0, 1.0), (0.2, 0.0, 0.3), (0.5, 0.4, 0.8)] {
            let toward = behind(toward);
            let part = through([metallic, factor], 0.04, (mu, toward)) * -toward.z / PI;
            let color = Vec3::new(1.0, 0.5, 0.25);
            let leaf = translucent(material(base, metallic, 0.5), factor, color);
            let lights = [(toward, MIDDLE / part)];
            let got = color_of((SceneFixture::new(), leaf), mu, (0.0, None), &lights);
            let wanted = color.as_dvec3() * MIDDLE;
            let name = format!("{base}, {metallic}, {factor} at {mu}");
            assert!((got / wanted - 1.0).abs().max_element() < 0.01, "{got}, {wanted}: {name}");
        }
    }
}

#[test]
fn index_of_refraction_changes_what_shines_through() {
    let toward = behind(aslant(0.6));
    for ior in [1.0f32, 2.4] {
        let f0 = f64::from((ior - 1.0) / (ior + 1.0)).powi(2);
        let mut leaf = translucent(material(0.9, 0.0, 0.5), 1.0, Vec3::ONE);
        leaf.extensions.as_mut().expect("some").specular =
            Some(Specular { ior, ..Specular::default() });
        let part = through([0.0, 1.0], f0, (0.5, toward)) * -toward.z / PI;
        let got = radiance(leaf, 0.5, 0.0, &[(toward, MIDDLE / part)]);
        assert!((got / MIDDLE - 1.0).abs() < 0.01, "{got} instead of {MIDDLE}: {ior}");
    }
}

#[test]
fn a_light_before_a_surface_is_reflected_by_the_rest() {
    let (toward, mu) = (aslant(0.7), 0.5);
    // Rough, so that most of it is Lambert's.
    let lit = |of| color_of((SceneFixture::new(), of), mu, (0.0, None), &[(toward, 1.5)]).x;
    let black = lit(material(0.0, 0.0, 1.0));
    let whole = lit(material(0.9, 0.0, 1.0)) - black;
    for factor in [0.25, 0.6, 1.0] {
        let rest = lit(translucent(material(0.9, 0.0, 1.0), factor, Vec3::ONE)) - black;
        assert!((rest - whole * (1.0 - factor)).abs() < 0.004, "{rest} of {whole}: {factor}");
    }
}

#[test]
fn surroundings_behind_a_surface_shine_through() {
    // More light from +z than from -z.
    let mut diffuse = [[0.0; 3]; 9];
    (diffuse[0], diffuse[2]) = ([0.4; 3], [0.2; 3]);
    let environment = Arc::new(Environment::new(gpu(), &map(|_| [0.0; 3], diffuse)));
    for (factor, roughness, mu) in [(1.0, 0.4, 0.8), (0.5, 0.9, 0.4), (0.0, 0.5, 0.6)] {
        let [e, b] = integrated(mu, roughness);
        let layer = (0.04 * e + 0.96 * b) * (1.0 + 0.04 * (1.0 / e - 1.0));
        let wanted = (0.9 * (1.0 - factor) * 0.6 + factor * 0.2) * (1.0 - layer);
        let leaf = translucent(material(0.9, 0.0, roughness), factor, Vec3::ONE);
        let got = radiance_in(leaf, mu, (0.0, Some(Arc::clone(&environment))), &[]);
        assert!((got / wanted - 1.0).abs() < 0.01, "{got} instead of {wanted}: {factor}");
    }
}

#[test]
fn a_white_furnace_stays_white() {
    let environment = Arc::new(Environment::new(gpu(), &uniform([MIDDLE; 3])));
    for (factor, metallic, roughness, mu) in
        [(1.0, 0.0, 0.3, 0.9), (0.5, 0.0, 1.0, 0.2), (0.3, 0.5, 0.6, 0.5)]
    {
        for has_sheen in [false, true] {
            let mut leaf = translucent(material(1.0, metallic, roughness), factor, Vec3::ONE);
            let sheen = Sheen { color: Vec3::ONE, roughness: 0.5, ..Sheen::default() };
            leaf.extensions.as_mut().expect("some").sheen = has_sheen.then_some(sheen);
            let part = radiance(leaf.clone(), mu, MIDDLE, &[]) / MIDDLE;
            assert!((part - 1.0).abs() < 0.01, "{part} of the light: {factor}, {metallic}");
            let around = (0.0, Some(Arc::clone(&environment)));
            let part = radiance_in(leaf, mu, around, &[]) / MIDDLE;
            assert!((part - 1.0).abs() < 0.01, "{part} of the map's light: {factor}, {metallic}");
        }
    }
}

#[test]
fn a_volume_absorbs_along_its_thickness() {
    let toward = behind(aslant(0.8));
    let part = through([0.0, 1.0], 0.04, (0.7, toward)) * -toward.z / PI;
    let attenuation_color = Vec3::new(0.9, 0.5, 0.25);
    for thickness in [0.5f32, 1.0, 3.0] {
        let mut leaf = translucent(material(0.9, 0.0, 0.5), 1.0, Vec3::ONE);
        let volume =
            Volume { thickness, attenuation_distance: 1.5, attenuation_color, ..Volume::default() };
        leaf.extensions.as_mut().expect("some").volume = Some(volume);
        let lights = [(toward, 0.8 / part)];
        let got = color_of((SceneFixture::new(), leaf), 0.7, (0.0, None), &lights);
        let wanted = attenuation_color.powf(thickness / 1.5).as_dvec3() * 0.8;
        let off = (got - wanted).abs().max_element();
        assert!(off < 0.005, "{got} instead of {wanted}: {thickness}");
    }
}

#[test]
fn a_body_with_a_volume_is_lit_on_its_other_side() {
    let toward = behind(aslant(0.9));
    for (thickness, is_lit) in [(1.0, true), (0.4, false)] {
        let mut stage = SceneFixture::new();
        let mut body = translucent(material(0.9, 0.0, 0.5), 1.0, Vec3::ONE);
        body.extensions.as_mut().expect("some").volume =
            Some(Volume { thickness, ..Volume::default() });
        // Its back; the plate that is measured is its front.
        let back = stage.material(body.clone());
        let back = stage.mesh(&MeshFixture::rectangle(50.0, 50.0), Some(back));
        let away = DAffine3::from_translation(DVec3::NEG_Z) * DAffine3::from_rotation_y(PI);
        stage.node(back, away);
        let part = through([0.0, 1.0], 0.04, (0.7, toward)) * -toward.z / PI;
        let lights = [(toward, MIDDLE / part)];
        let got = color_of((stage, body), 0.7, (0.0, None), &lights).x;
        let wanted = if is_lit { MIDDLE } else { 0.0 };
        assert!((got - wanted).abs() < 0.005, "{got} instead of {wanted}: {thickness}");
    }
}

#[test]
fn what_transmits_light_as_glass_does_so_before() {
    let toward = behind(aslant(0.8));
    let mut leaf = translucent(material(0.9, 0.0, 0.5), 1.0, Vec3::ONE);
    leaf.extensions.as_mut().expect("some").transmission =
        Some(Transmission { factor: 0.75, texture: None });
    let part = 0.25 * through([0.0, 1.0], 0.04, (0.7, toward)) * -toward.z / PI;
    let got = radiance(leaf, 0.7, 0.0, &[(toward, MIDDLE / part)]);
    assert!((got / MIDDLE - 1.0).abs() < 0.01, "{got} instead of {MIDDLE}");
}

#[test]
fn alpha_of_a_texture_is_the_part_and_another_texture_the_colour() {
    let lights = [(behind(aslant(0.8)), 2.5)];
    // 188 is 0.503 of the light, 255 all of it.
    let texel = |u: f64, _| if u < 0.5 { [188, 188, 188, 204] } else { [255, 255, 255, 102] };
    for (part, color) in [(0.25f32, 0.25f32), (-0.25, 0.25), (-0.25, -0.25)] {
        let mut stage = SceneFixture::new();
        let texture = stage.picture((64, TextureFormat::Rgba8Srgb), texel);
        let at = |offset: f32| {
            let uv_transform = Affine2::from_translation(Vec2::X * offset);
            Some(TextureRef { texture, uv_set: 0, uv_transform })
        };
        let factor = 0.9 * if part > 0.0 { 0.4 } else { 0.8 };
        let shade = 0.8 * if color > 0.0 { 1.0 } else { 0.5029 };
        let plain = translucent(material(0.5, 0.0, 0.6), factor, Vec3::splat(shade));
        let wanted = radiance(plain, 0.7, 0.0, &lights);
        let mut textured = translucent(material(0.5, 0.0, 0.6), 0.9, Vec3::splat(0.8));
        let extensions = textured.extensions.as_mut().expect("some");
        let through = extensions.diffuse_transmission.as_mut().expect("some");
        (through.texture, through.color_texture) = (at(part), at(color));
        let got = radiance_of((stage, textured), 0.7, (0.0, None), &lights);
        assert!((got / wanted - 1.0).abs() < 0.004, "{got} instead of {wanted}: {part} {color}");
    }
}
