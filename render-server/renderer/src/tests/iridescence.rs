//! Films so thin that light interferes in them, against the formula of the extension in f64, and
//! against a spectrum.

use std::f64::consts::PI;
use std::sync::Arc;

use glam::{Affine2, DMat3, DVec3, Vec2, Vec3};
use polyptych_scene::{
    Iridescence, Material, MaterialExtensions, Specular, TextureFormat, TextureRef,
};

use super::environment::uniform;
use super::extensions::{facets, with};
use super::furnace::{MIDDLE, aslant, color_of, material};
use super::harness::{SceneFixture, gpu};
use crate::Environment;
use crate::albedo::tests::integrated;

/// From CIE XYZ to linear Rec. 709.
fn rgb(xyz: DVec3) -> DVec3 {
    DMat3::from_cols(
        DVec3::new(3.2404542, -0.9692660, 0.0556434),
        DVec3::new(-1.5371385, 1.8760108, -0.2040259),
        DVec3::new(-0.4985314, 0.0415560, 1.0572252),
    ) * xyz
}

/// `evalSensitivity` of the extension, for a path in metres.
fn sensitivity(path: f64) -> DVec3 {
    let phase = 2.0 * PI * path;
    let lobe = |value: f64, position: f64, variance: f64| {
        value * (2.0 * PI * variance).sqrt() * (position * phase).cos()
            / (phase * phase * variance).exp()
    };
    let x = lobe(5.4856e-13, 1.6810e6, 4.3278e9) + lobe(9.7470e-14, 2.2399e6, 4.5282e9);
    let y = lobe(4.4201e-13, 1.7953e6, 9.3046e9);
    let z = lobe(5.2481e-13, 2.2084e6, 6.6121e9);
    rgb(DVec3::new(x, y, z) / 1.0685e-7)
}

/// Reflectances of the upper and the lower face of a film, and the cosine within it.
fn faces(f0: f64, mu: f64, ior: f64) -> ([f64; 2], f64, f64) {
    let within = (1.0 - (1.0 - mu * mu) / (ior * ior)).sqrt();
    let schlick = |f0: f64, cos: f64| f0 + (1.0 - f0) * (1.0 - cos).powi(5);
    let root = (f0 + 1e-4).min(0.9999).sqrt();
    let below = (1.0 + root) / (1.0 - root);
    let ratio = |a: f64, b: f64| ((a - b) / (a + b)).powi(2);
    ([schlick(ratio(ior, 1.0), mu), schlick(ratio(below, ior), within)], within, below)
}

/// `iridescent_fresnel` of the extension for air outside, with the path of the paper.
fn film(f0: f64, mu: f64, (ior, nanometres): (f64, f64)) -> DVec3 {
    let ([upper, lower], within, below) = faces(f0, mu, ior);
    let path = 2.0 * ior * nanometres * 1e-9 * within;
    let passed = 1.0 - upper;
    let both = (upper * lower).clamp(1e-5, 0.9999);
    let inner = passed * passed * lower / (1.0 - both);
    let turned: f64 = if below < ior { 2.0 * PI } else { PI };
    let mut light = DVec3::splat(upper + inner);
    for order in [1.0, 2.0f64] {
        let part = (inner - passed) * both.sqrt().powf(order) * 2.0;
        light += sensitivity(order * path) * part * (order * turned).cos();
    }
    light.clamp(DVec3::ZERO, DVec3::ONE)
}

/// The reflectance of a film as a sum over wavelengths (Airy), seen by the CIE 1931 observer as
/// fitted by Wyman, Sloan and Shirley (2013), in light of equal energy, which is white.
fn film_of_spectrum(f0: f64, mu: f64, (ior, nanometres): (f64, f64)) -> DVec3 {
    let ([upper, lower], within, below) = faces(f0, mu, ior);
    let path = 2.0 * ior * nanometres * within;
    let (mut sum, mut white) = (DVec3::ZERO, DVec3::ZERO);
    for step in 0..450 {
        let length = 370.0 + f64::from(step);
        let bell = |of: [f64; 4]| {
            let width = if length < of[1] { of[2] } else { of[3] };
            of[0] * (-0.5 * ((length - of[1]) * width).powi(2)).exp()
        };
        let x = bell([0.362, 442.0, 0.0624, 0.0374])
            + bell([1.056, 599.8, 0.0264, 0.0323])
            + bell([-0.065, 501.1, 0.0490, 0.0382]);
        let y = bell([0.821, 568.8, 0.0213, 0.0247]) + bell([0.286, 530.9, 0.0613, 0.0322]);
        let z = bell([1.217, 437.0, 0.0845, 0.0278]) + bell([0.681, 459.0, 0.0385, 0.0725]);
        // Amplitudes r + t r' t e^iφ / (1 - r r' ...): the upper face turns the wave, the lower one
        // does where the index rises again.
        let sign = if below < ior { 1.0 } else { -1.0 };
        let phase = 2.0 * PI * path / length;
        let [a, b] = [-upper.sqrt(), sign * lower.sqrt()];
        let cos = 2.0 * a * b * phase.cos();
        let reflected = (a * a + b * b + cos) / (1.0 + a * a * b * b + cos);
        sum += DVec3::new(x, y, z) * reflected;
        white += DVec3::new(x, y, z);
    }
    rgb(sum) / rgb(white)
}

#[test]
fn the_formula_is_near_what_a_spectrum_gives() {
    let (mut worst, mut total, mut count) = (0.0f64, 0.0, 0);
    for (f0, mu) in [(0.04, 1.0), (0.04, 0.5), (0.2, 0.8), (0.6, 1.0), (0.9, 0.7)] {
        for (ior, nanometres) in [(1.3, 250.0), (1.3, 400.0), (1.8, 300.0), (2.2, 500.0)] {
            let (got, wanted) =
                (film(f0, mu, (ior, nanometres)), film_of_spectrum(f0, mu, (ior, nanometres)));
            let off = (got - wanted.clamp(DVec3::ZERO, DVec3::ONE)).abs().max_element();
            println!("{f0} {mu} {ior} {nanometres}: {got} {wanted}");
            (worst, total, count) = (worst.max(off), total + off, count + 1);
        }
    }
    println!("off by {} on average, {worst} at most", total / f64::from(count));
    assert!(worst < 0.12 && total < 0.05 * f64::from(count), "{worst}, {total} of {count}");
}

fn filmy(material: Material, part: f64, (ior, nanometres): (f64, f64)) -> Material {
    let iridescence = Iridescence {
        factor: part as f32,
        ior: ior as f32,
        thickness_max_nm: nanometres as f32,
        ..Iridescence::default()
    };
    with(
        material,
        MaterialExtensions { iridescence: Some(iridescence), ..MaterialExtensions::default() },
    )
}

const FILMS: [(f64, f64); 4] = [(1.3, 400.0), (1.8, 250.0), (1.33, 900.0), (2.0, 320.0)];

/// The extension's `iridescent_dielectric_layer` and `iridescent_conductor_layer`, times π, with
/// the layers compensated for light that meets several facets.
fn brdf(
    [base, metallic, roughness]: [f64; 3],
    (part, of): (f64, (f64, f64)),
    (mu, light): (f64, DVec3),
) -> DVec3 {
    let lost = 1.0 / integrated(mu, roughness)[0] - 1.0;
    let schlick = |f0: f64| super::extensions::schlick(f0, mu, light);
    let layer = |f0: f64| {
        let plain = DVec3::splat(schlick(f0) * (1.0 + f0 * lost));
        let film = film(f0, mu, of);
        plain.lerp(film * (1.0 + film * lost), part) * facets(roughness, mu, light)
    };
    let reflected = DVec3::splat(schlick(0.04)).lerp(film(0.04, mu, of), part);
    let dielectric = layer(0.04) + base * (1.0 - reflected.max_element());
    dielectric.lerp(layer(base), metallic)
}

#[test]
fn a_light_has_the_colours_of_the_film() {
    let opposite = DVec3::new(-0.8, 0.3, 0.5).normalize();
    for (toward, mu) in [(DVec3::Z, 1.0), (aslant(0.7), 0.4), (opposite, 0.3), (opposite, 0.6)] {
        for of in FILMS {
            for (numbers, part) in
                [([0.8, 1.0, 0.5], 1.0), ([0.3, 0.0, 0.4], 1.0), ([0.5, 0.5, 0.7], 0.6)]
            {
                let wanted = brdf(numbers, (part, of), (mu, toward)) * toward.z / PI;
                let irradiance = 0.6 / wanted.max_element();
                let [base, metallic, roughness] = numbers;
                let plate = filmy(material(base, metallic, roughness), part, of);
                let got = color_of(
                    (SceneFixture::new(), plate),
                    mu,
                    (0.0, None),
                    &[(toward, irradiance)],
                );
                let off = (got - wanted * irradiance).abs().max_element();
                assert!(
                    off < 0.006,
                    "{got} instead of {}: {numbers:?} {of:?} {mu}",
                    wanted * irradiance
                );
            }
        }
    }
}

/// Part of uniform surroundings that is reflected.
fn around([base, metallic, roughness]: [f64; 3], (part, of): (f64, (f64, f64)), mu: f64) -> DVec3 {
    let [e, b] = integrated(mu, roughness);
    let lost = 1.0 / e - 1.0;
    let layer = |f0: f64| {
        let plain = DVec3::splat((f0 * e + (1.0 - f0) * b) * (1.0 + f0 * lost));
        let film = film(f0, mu, of);
        plain.lerp(film * (1.0 + film * lost) * e, part)
    };
    let dielectric = layer(0.04) + base * (1.0 - layer(0.04).max_element());
    dielectric.lerp(layer(base), metallic)
}

#[test]
fn surroundings_have_the_colours_of_the_film_and_are_never_more_than_all_light() {
    let environment = Arc::new(Environment::new(gpu(), &uniform([0.8; 3])));
    for of in FILMS {
        for (numbers, part) in [
            ([1.0, 0.0, 0.3], 1.0),
            ([1.0, 0.0, 0.9], 1.0),
            ([0.5, 1.0, 0.4], 1.0),
            ([0.9, 0.5, 0.6], 0.5),
        ] {
            for mu in [1.0, 0.5, 0.2] {
                let wanted = around(numbers, (part, of), mu);
                assert!(wanted.max_element() < 1.0001, "{wanted}");
                let [base, metallic, roughness] = numbers;
                let plate = filmy(material(base, metallic, roughness), part, of);
                for around in [(0.8, None), (0.0, Some(Arc::clone(&environment)))] {
                    let got = color_of((SceneFixture::new(), plate.clone()), mu, around, &[]) / 0.8;
                    let name = format!("{numbers:?} {of:?} {mu}");
                    assert!((got - wanted).abs().max_element() < 0.012, "{got}, {wanted}: {name}");
                    assert!(got.max_element() < 1.002, "{got}: {name}");
                }
            }
        }
    }
}

#[test]
fn a_white_furnace_of_white_metal_stays_white_below_a_film() {
    for of in FILMS {
        for (roughness, mu) in [(0.0, 0.6), (0.3, 1.0), (0.6, 0.2), (1.0, 0.8)] {
            let plate = filmy(material(1.0, 1.0, roughness), 1.0, of);
            let got = color_of((SceneFixture::new(), plate), mu, (MIDDLE, None), &[]) / MIDDLE;
            assert!((got - 1.0).abs().max_element() < 0.01, "{got}: {of:?} {roughness} {mu}");
        }
    }
}

#[test]
fn red_of_a_texture_is_the_part_of_a_film_and_green_its_thickness() {
    let light = [(DVec3::new(-0.6, 0.0, 0.8), 1.5)];
    // 51 is 0.2, 204 is 0.8.
    let texel = |u: f64, _| if u < 0.5 { [51, 204, 0, 0] } else { [255, 51, 9, 9] };
    for (offset, part, full) in [(-0.25f32, 0.2, 0.8), (0.25, 1.0, 0.2)] {
        let mut stage = SceneFixture::new();
        let texture = stage.picture((64, TextureFormat::Rgba8Linear), texel);
        let uv_transform = Affine2::from_translation(Vec2::X * offset);
        let texture = Some(TextureRef { texture, uv_set: 0, uv_transform });
        let textured = Iridescence {
            factor: 0.9,
            ior: 1.6,
            thickness_min_nm: 200.0,
            thickness_max_nm: 600.0,
            texture,
            thickness_texture: texture,
        };
        let nanometres = 200.0 + 400.0 * full;
        let wanted = filmy(material(0.6, 1.0, 0.6), 0.9 * part, (1.6, nanometres));
        let wanted = color_of((SceneFixture::new(), wanted), 0.7, (0.0, None), &light);
        let textured = with(
            material(0.6, 1.0, 0.6),
            MaterialExtensions { iridescence: Some(textured), ..MaterialExtensions::default() },
        );
        let got = color_of((stage, textured), 0.7, (0.0, None), &light);
        assert!((got - wanted).abs().max_element() < 0.004, "{got} instead of {wanted}: {offset}");
    }
}

#[test]
fn a_film_without_thickness_changes_nothing_and_one_on_no_reflection_reflects() {
    let light = [(DVec3::new(-0.6, 0.0, 0.8), 2.0)];
    let color = |of| color_of((SceneFixture::new(), of), 0.7, (0.0, None), &light);
    let plain = color(material(0.6, 0.3, 0.5));
    let none = color(filmy(material(0.6, 0.3, 0.5), 1.0, (1.6, 0.0)));
    assert!((plain - none).abs().max_element() < 0.001, "{none} instead of {plain}");
    // By the extension the part of the reflection is that of what is below the film.
    let mut bare = filmy(material(0.0, 0.0, 0.5), 1.0, (1.6, 400.0));
    let specular = Specular { factor: 0.0, color: Vec3::ONE, ..Specular::default() };
    bare.extensions.as_mut().expect("some").specular = Some(specular);
    let (mu, toward) = (0.7, light[0].0);
    let film = film(0.0, mu, (1.6, 400.0));
    let lost = 1.0 / integrated(mu, 0.5)[0] - 1.0;
    let wanted = film * (1.0 + film * lost) * facets(0.5, mu, toward) * toward.z / PI * 2.0;
    let got = color(bare);
    assert!((got - wanted).abs().max_element() < 0.003, "{got} instead of {wanted}");
}
