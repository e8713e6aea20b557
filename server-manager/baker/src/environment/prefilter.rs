//! Reflections of rough surfaces, prefiltered: for each level the mean of what a lobe of GGX sees,
//! weighted by the cosine.
//!
//! B. Karis, "Real Shading in Unreal Engine 4" (2013): the surface is seen from the front, so that
//! one direction is enough. Directions are chosen by the lobe, and each reads the mean of as large
//! a part of the sphere as it stands for: J. Křivánek and M. Colbert, "Real-time Shading with
//! Filtered Importance Sampling" (2008).

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Vec3};

use super::cube_map::{CubeMap, fill};

/// Directions of a lobe. With four times as many, no texel of the tests' surroundings differs by
/// more than 1 % of the largest.
const SAMPLES: u32 = 256;

/// A direction around the mirrored one, for a surface that is seen from the front.
#[derive(Clone, Copy, Debug)]
struct Sample {
    /// Around +Z, of length 1.
    toward: DVec3,
    weight: f64,
    /// The level of the source whose texels are as large as what it stands for.
    level: f64,
}

/// The levels of a map, the largest first; level l is for the roughness l / (levels − 1).
pub(super) fn levels(cube: &CubeMap, count: u32) -> Vec<Vec<Vec3>> {
    let level = |level: u32| {
        if level == 0 {
            return cube.texels().to_vec();
        }
        let roughness = f64::from(level) / f64::from(count - 1);
        let samples = samples(roughness, cube.side);
        fill(cube.side >> level, |toward| filtered(cube, toward, &samples))
    };
    (0..count).map(level).collect()
}

/// The lobe of a perceptual roughness above 0, over a cube map with faces of this side.
fn samples(roughness: f64, side: u32) -> Vec<Sample> {
    let alpha_squared = roughness.powi(4);
    let texel = 4.0 * PI / (6.0 * f64::from(side).powi(2));
    let sample = |index: u32| {
        // Hammersley's points.
        let u = (f64::from(index) + 0.5) / f64::from(SAMPLES);
        let around = f64::from(index.reverse_bits()) / 32f64.exp2() * TAU;
        let cos_squared = (1.0 - u) / (1.0 + (alpha_squared - 1.0) * u);
        let (cos, sin) = (cos_squared.sqrt(), (1.0 - cos_squared).max(0.0).sqrt());
        let weight = 2.0 * cos_squared - 1.0;
        let toward =
            DVec3::new(2.0 * cos * sin * around.cos(), 2.0 * cos * sin * around.sin(), weight);
        // D of GGX over 4: n·h and v·h are the same here.
        let d = alpha_squared / (PI * (cos_squared * (alpha_squared - 1.0) + 1.0).powi(2));
        let solid_angle = 4.0 / (f64::from(SAMPLES) * d);
        Sample { toward, weight, level: 0.5 * (solid_angle / texel).log2() }
    };
    (0..SAMPLES).map(sample).filter(|sample| sample.weight > 0.0).collect()
}

fn filtered(cube: &CubeMap, normal: DVec3, samples: &[Sample]) -> Vec3 {
    let across = normal.any_orthonormal_vector();
    let other = normal.cross(across);
    let (mut sum, mut weights) = (DVec3::ZERO, 0.0);
    for Sample { toward, weight, level } in samples {
        let from = across * toward.x + other * toward.y + normal * toward.z;
        sum += cube.radiance(from, *level).as_dvec3() * *weight;
        weights += weight;
    }
    (sum / weights).as_vec3()
}
