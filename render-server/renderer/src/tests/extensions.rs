//! The light of materials with extensions against integrals and formulas in f64.

use std::f64::consts::PI;
use std::sync::Arc;

use glam::{DVec3, Vec3};
use polyptych_scene::{Material, MaterialExtensions, Specular};

use super::environment::uniform;
use super::furnace::{MIDDLE, aslant, material, radiance, radiance_in};
use super::harness::gpu;
use crate::Environment;
use crate::albedo::tests::integrated;

fn with(material: Material, extensions: MaterialExtensions) -> Material {
    Material { extensions: Some(Box::new(extensions)), ..material }
}

fn specular(ior: f32, factor: f32, color: f32) -> MaterialExtensions {
    let specular = Specular { ior, factor, color: Vec3::splat(color), ..Specular::default() };
    MaterialExtensions { specular: Some(specular) }
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
fn facets(roughness: f64, mu: f64, light: DVec3) -> f64 {
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

fn schlick(f0: f64, mu: f64, light: DVec3) -> f64 {
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
