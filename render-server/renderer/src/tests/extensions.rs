//! The light of materials with extensions against integrals and formulas in f64.

use std::f64::consts::PI;
use std::sync::Arc;

use glam::{DVec3, Vec3};
use polyptych_scene::{Clearcoat, Material, MaterialExtensions, Sheen, Specular};

use super::environment::uniform;
use super::furnace::{MIDDLE, aslant, furnace_of_lights, material, radiance, radiance_in};
use super::harness::gpu;
use crate::Environment;
use crate::albedo::tests::integrated;
use crate::sheen_albedo;

pub(super) fn with(material: Material, extensions: MaterialExtensions) -> Material {
    Material { extensions: Some(Box::new(extensions)), ..material }
}

fn specular(ior: f32, factor: f32, color: f32) -> MaterialExtensions {
    let specular = Specular { ior, factor, color: Vec3::splat(color), ..Specular::default() };
    MaterialExtensions { specular: Some(specular), ..MaterialExtensions::default() }
}

/// Reflectance from the front by `KHR_materials_ior` and `KHR_materials_specular`.
fn reflectance(ior: f64, color: f64) -> f64 {
    (((ior - 1.0) / (ior + 1.0)).powi(2) * color).min(1.0)
}

const SPECULARS: [(f32, f32, f32); 7] = [
    (1.5, 1.0, 1.0),
    (1.0, 1.0, 1.0),
    (2.4, 1.0, 1.0),
    (1.5, 0.3, 1.0),
    (1.33, 1.0, 0.2),
    (0.0, 1.0, 0.6),
    (1.8, 0.5, 20.0),
];

#[test]
fn a_white_furnace_stays_white_for_every_index_of_refraction() {
    let map = uniform([MIDDLE; 3]);
    let environment = Arc::new(Environment::new(gpu(), &map));
    for (ior, factor, color) in SPECULARS {
        for (roughness, mu) in [(0.0, 0.6), (0.3, 1.0), (0.6, 0.2), (1.0, 0.05), (1.0, 0.8)] {
            for metallic in [0.0, 0.5] {
                let white = with(material(1.0, metallic, roughness), specular(ior, factor, color));
                let name = format!("{ior} {factor} {color}: {roughness}, {metallic}, {mu}");
                let part = radiance(white.clone(), mu, MIDDLE, &[]) / MIDDLE;
                assert!((part - 1.0).abs() < 0.01, "{part} of the light: {name}");
                let around = (0.0, Some(Arc::clone(&environment)));
                let part = radiance_in(white, mu, around, &[]) / MIDDLE;
                assert!((part - 1.0).abs() < 0.01, "{part} of the map's light: {name}");
            }
        }
    }
}

/// GGX without its Fresnel term, times π.
pub(super) fn facets(roughness: f64, mu: f64, light: DVec3) -> f64 {
    let (eye, alpha2) = (aslant(mu), roughness.powi(4));
    let h = (eye + light).normalize();
    let d = alpha2 / ((alpha2 - 1.0) * h.z * h.z + 1.0).powi(2);
    let lit = light.z * (mu * mu * (1.0 - alpha2) + alpha2).sqrt();
    let seen = mu * (light.z * light.z * (1.0 - alpha2) + alpha2).sqrt();
    d * 0.5 / (lit + seen)
}

/// Lights and eyes of the comparisons with one light.
fn poses() -> [(DVec3, f64); 4] {
    let opposite = DVec3::new(-0.8, 0.3, 0.5).normalize();
    [(DVec3::Z, 1.0), (aslant(0.7), 0.4), (opposite, 0.3), (opposite, 0.5)]
}

pub(super) fn schlick(f0: f64, mu: f64, light: DVec3) -> f64 {
    let eye = aslant(mu);
    f0 + (1.0 - f0) * (1.0 - eye.dot((eye + light).normalize())).powi(5)
}

/// Appendix B of glTF 2.0 with the Fresnel term of `KHR_materials_specular`, times π; the layer
/// compensated for light that meets several facets.
fn specular_brdf(
    [ior, factor, color]: [f64; 3],
    [base, roughness]: [f64; 2],
    mu: f64,
    light: DVec3,
) -> f64 {
    let f0 = if ior == 0.0 { color.min(1.0) } else { reflectance(ior, color) };
    let fresnel = factor * schlick(f0, mu, light);
    let many = 1.0 + f0 * (1.0 / integrated(mu, roughness)[0] - 1.0);
    base * (1.0 - fresnel) + fresnel * facets(roughness, mu, light) * many
}

#[test]
fn a_light_is_reflected_by_index_factor_and_colour() {
    for (ior, factor, color) in SPECULARS {
        for (toward, mu) in poses() {
            for (base, roughness) in [(0.9, 0.7), (0.3, 0.5), (0.0, 0.4)] {
                let numbers = [ior, factor, color].map(f64::from);
                let part = specular_brdf(numbers, [base, roughness], mu, toward) * toward.z / PI;
                if part < 1e-3 {
                    continue;
                }
                let of = with(material(base, 0.0, roughness), specular(ior, factor, color));
                let got = radiance(of, mu, 0.0, &[(toward, MIDDLE / part)]);
                let name = format!("{ior} {factor} {color}: base {base}, {roughness}, {mu}");
                assert!((got / MIDDLE - 1.0).abs() < 0.01, "{got} instead of {MIDDLE}: {name}");
            }
        }
    }
}

/// `KHR_materials_pbrSpecularGlossiness` for one light, times π: the extension's appendix B, with
/// the layer compensated for light that meets several facets.
fn specular_glossiness_brdf(
    [diffuse, specular, glossiness]: [f64; 3],
    mu: f64,
    light: DVec3,
) -> f64 {
    let roughness = 1.0 - glossiness;
    let many = 1.0 + specular * (1.0 / integrated(mu, roughness)[0] - 1.0);
    let fresnel = schlick(specular, mu, light);
    diffuse * (1.0 - fresnel) + fresnel * facets(roughness, mu, light) * many
}

#[test]
fn specular_glossiness_is_drawn_as_its_own_model_has_it() {
    for (diffuse, reflected, glossiness) in
        [(0.8, 0.04, 0.5), (0.3, 0.2, 0.3), (0.0, 0.9, 0.6), (0.7, 0.5, 0.1)]
    {
        for (toward, mu) in poses() {
            let numbers = [diffuse, reflected, glossiness];
            let part = specular_glossiness_brdf(numbers, mu, toward) * toward.z / PI;
            // As the baker converts it.
            let of = with(
                material(diffuse, 0.0, 1.0 - glossiness),
                specular(0.0, 1.0, reflected as f32),
            );
            let got = radiance(of, mu, 0.0, &[(toward, MIDDLE / part)]);
            let name = format!("{numbers:?} at {mu}");
            assert!((got / MIDDLE - 1.0).abs() < 0.01, "{got} instead of {MIDDLE}: {name}");
        }
    }
}

fn coated(material: Material, factor: f32, roughness: f32) -> Material {
    let coat = Clearcoat { factor, roughness, ..Clearcoat::default() };
    with(material, MaterialExtensions { clearcoat: Some(coat), ..MaterialExtensions::default() })
}

#[test]
fn a_white_furnace_stays_white_below_a_clear_coat() {
    let environment = Arc::new(Environment::new(gpu(), &uniform([MIDDLE; 3])));
    for (factor, coat) in [(1.0, 0.0), (1.0, 0.3), (0.5, 0.6), (1.0, 1.0)] {
        for (metallic, roughness, mu) in
            [(0.0, 0.0, 0.6), (1.0, 0.3, 1.0), (0.0, 0.6, 0.2), (1.0, 1.0, 0.05), (0.5, 1.0, 0.8)]
        {
            let white = coated(material(1.0, metallic, roughness), factor, coat);
            let name = format!("{factor} {coat}: {metallic}, {roughness}, {mu}");
            let part = radiance(white.clone(), mu, MIDDLE, &[]) / MIDDLE;
            assert!((part - 1.0).abs() < 0.01, "{part} of the light: {name}");
            let around = (0.0, Some(Arc::clone(&environment)));
            let part = radiance_in(white, mu, around, &[]) / MIDDLE;
            assert!((part - 1.0).abs() < 0.01, "{part} of the map's light: {name}");
        }
    }
}

#[test]
fn a_white_furnace_of_lights_stays_white_below_a_clear_coat() {
    // The coat's own lobe is as wide as that of the metal, around whose facets lights are spaced.
    for roughness in [0.3, 0.6, 1.0] {
        for mu in [0.9, 0.4] {
            let lights = furnace_of_lights(mu, roughness, MIDDLE);
            let white = coated(material(1.0, 1.0, roughness), 1.0, roughness as f32);
            let part = radiance(white, mu, 0.0, &lights) / MIDDLE;
            assert!((part - 1.0).abs() < 0.01, "{part} of the light: {roughness}, {mu}");
        }
    }
}

/// `KHR_materials_clearcoat` for one light, times π, with a layer that is compensated for light
/// that meets several facets; the light from below passes what its integral leaves.
fn coat_brdf([factor, roughness]: [f64; 2], below: f64, mu: f64, light: DVec3) -> f64 {
    let (reflected, many) = coat_albedo(mu, roughness);
    let layer = many * schlick(0.04, mu, light) * facets(roughness, mu, light);
    below * (1.0 - factor * reflected) + factor * layer
}

/// Part of uniform surroundings that a clear coat reflects, and the part of it that is due to light
/// that meets several facets, as a factor.
pub(super) fn coat_albedo(mu: f64, roughness: f64) -> (f64, f64) {
    let [e, b] = integrated(mu, roughness);
    let many = 1.0 + 0.04 * (1.0 / e - 1.0);
    (many * (0.04 * e + 0.96 * b), many)
}

#[test]
fn a_smooth_coat_takes_what_the_fresnel_term_of_the_eye_has() {
    for mu in [1.0f64, 0.6, 0.3] {
        let fresnel = 0.04 + 0.96 * (1.0 - mu).powi(5);
        assert!((coat_albedo(mu, 0.02).0 - fresnel).abs() < 0.002, "{mu}");
    }
}

#[test]
fn a_light_is_reflected_by_a_clear_coat_and_what_is_below() {
    for (factor, coat) in [(1.0, 0.3), (1.0, 0.7), (0.4, 0.5)] {
        for (toward, mu) in poses() {
            for (base, roughness) in [(0.9, 0.7), (0.3, 0.5), (0.0, 0.4)] {
                let below = specular_brdf([1.5, 1.0, 1.0], [base, roughness], mu, toward);
                let part = coat_brdf([factor, coat].map(f64::from), below, mu, toward);
                let part = part * toward.z / PI;
                if part < 1e-3 {
                    continue;
                }
                let of = coated(material(base, 0.0, roughness), factor, coat);
                let got = radiance(of, mu, 0.0, &[(toward, MIDDLE / part)]);
                let name = format!("{factor} {coat}: base {base}, {roughness}, {mu}");
                assert!((got / MIDDLE - 1.0).abs() < 0.01, "{got} instead of {MIDDLE}: {name}");
            }
        }
    }
}

#[test]
fn a_clear_coat_dims_what_glows_below() {
    for mu in [1.0, 0.5, 0.3] {
        let (part, _) = coat_albedo(mu, 0.2);
        let glowing = Material {
            emissive: Vec3::splat((MIDDLE / (1.0 - part)) as f32),
            ..material(0.0, 1.0, 1.0)
        };
        let got = radiance(coated(glowing, 1.0, 0.2), mu, 0.0, &[]);
        assert!((got / MIDDLE - 1.0).abs() < 0.01, "{got} at {mu}");
    }
}

fn furred(material: Material, color: f32, roughness: f32) -> Material {
    let sheen = Sheen { color: Vec3::splat(color), roughness, ..Sheen::default() };
    with(material, MaterialExtensions { sheen: Some(sheen), ..MaterialExtensions::default() })
}

#[test]
fn a_white_furnace_stays_white_below_a_sheen() {
    let environment = Arc::new(Environment::new(gpu(), &uniform([MIDDLE; 3])));
    for (color, sheen) in [(1.0, 0.0), (1.0, 0.2), (0.5, 0.6), (1.0, 1.0)] {
        for (metallic, roughness, mu) in
            [(0.0, 0.0, 0.6), (1.0, 0.3, 1.0), (0.0, 0.6, 0.2), (1.0, 1.0, 0.05), (0.5, 1.0, 0.01)]
        {
            let white = furred(material(1.0, metallic, roughness), color, sheen);
            let name = format!("{color} {sheen}: {metallic}, {roughness}, {mu}");
            let part = radiance(white.clone(), mu, MIDDLE, &[]) / MIDDLE;
            assert!((part - 1.0).abs() < 0.01, "{part} of the light: {name}");
            let around = (0.0, Some(Arc::clone(&environment)));
            let part = radiance_in(white, mu, around, &[]) / MIDDLE;
            assert!((part - 1.0).abs() < 0.01, "{part} of the map's light: {name}");
        }
    }
}

/// Lights all around a plate that stand for a radiance of `around` from everywhere.
fn even_lights(around: f64) -> Vec<(DVec3, f64)> {
    const STEPS: usize = 48;
    let solid_angle = 2.0 * PI / (STEPS * STEPS) as f64;
    let toward = |(i, j): (usize, usize)| {
        let z = (i as f64 + 0.5) / STEPS as f64;
        let (sin, cos) = (2.0 * PI * (j as f64 + 0.5) / STEPS as f64).sin_cos();
        DVec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z)
    };
    let places = (0..STEPS).flat_map(|i| (0..STEPS).map(move |j| (i, j)));
    places.map(|at| (toward(at), around * solid_angle)).collect()
}

#[test]
fn lights_on_a_sheen_are_never_more_than_there_is() {
    for roughness in [0.3, 0.6, 1.0] {
        for mu in [0.9, 0.4, 0.15] {
            let white = furred(material(1.0, 0.0, 1.0), 1.0, roughness);
            let part = radiance(white, mu, 0.0, &even_lights(MIDDLE)) / MIDDLE;
            // The lesser of both directions' shares passes to what is below: at most a fifth of
            // all light is lost so.
            assert!((0.8..1.01).contains(&part), "{part} of the light: {roughness}, {mu}");
        }
    }
}

#[test]
fn a_light_is_reflected_by_a_sheen_and_what_is_below() {
    for (color, rough) in [(1.0, 0.3), (1.0, 0.7), (0.4, 0.5), (0.8, 1.0)] {
        for (toward, mu) in poses() {
            for (base, roughness) in [(0.9, 0.7), (0.3, 0.5), (0.0, 0.4)] {
                let [fur, sheen] = [color, rough].map(f64::from);
                let taken = |cos| fur * sheen_albedo::tests::integrated(cos, sheen);
                let below = specular_brdf([1.5, 1.0, 1.0], [base, roughness], mu, toward);
                let passed = (1.0 - taken(mu)).min(1.0 - taken(toward.z));
                let above = fur * sheen_albedo::tests::fibres(sheen, aslant(mu), toward);
                let part = (below * passed + above) * toward.z / PI;
                if part < 1e-3 {
                    continue;
                }
                let of = furred(material(base, 0.0, roughness), color, rough);
                let got = radiance(of, mu, 0.0, &[(toward, MIDDLE / part)]);
                let name = format!("{color} {rough}: base {base}, {roughness}, {mu}");
                assert!((got / MIDDLE - 1.0).abs() < 0.01, "{got} instead of {MIDDLE}: {name}");
            }
        }
    }
}
