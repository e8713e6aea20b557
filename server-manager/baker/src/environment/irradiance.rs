//! Diffuse light from all around, as spherical harmonics of the second order.
//!
//! R. Ramamoorthi and P. Hanrahan, "An Efficient Representation for Irradiance Environment Maps"
//! (2001): nine coefficients hold what a matt surface is given to 1 % on average, since the cosine
//! of Lambert's law blurs all that is finer. The worst case, a single point of light, is off by a
//! tenth of its brightest irradiance.

use std::f64::consts::PI;

use glam::DVec3;
use polyptych_scene::environment_map::HARMONICS;

use super::equirect::Equirect;

/// Real spherical harmonics of a unit vector, as [`HARMONICS`] and polynomials.
fn harmonics(n: DVec3) -> [(f64, f64); 9] {
    let DVec3 { x, y, z } = n;
    let polynomials = [1.0, y, z, x, x * y, y * z, 3.0 * z * z - 1.0, x * z, x * x - y * y];
    std::array::from_fn(|term| (HARMONICS[term], polynomials[term]))
}

/// The cosine's own coefficients over π, by band: Ramamoorthi and Hanrahan, equation 8.
const BANDS: [f64; 9] = [1.0, 2.0 / 3.0, 2.0 / 3.0, 2.0 / 3.0, 0.25, 0.25, 0.25, 0.25, 0.25];

/// Returns what factors of the spherical harmonics stand for in a direction.
pub(super) fn evaluate(terms: &[DVec3; 9], n: DVec3) -> DVec3 {
    let harmonics = terms.iter().zip(harmonics(n));
    harmonics.map(|(term, (factor, polynomial))| *term * (factor * polynomial)).sum()
}

/// Returns a function of the second order as factors of the polynomials of
/// [`diffuse`](polyptych_scene::EnvironmentMap::diffuse). Gauss' three heights times six meridians
/// integrate its products with them exactly.
pub(super) fn expand(of: impl Fn(DVec3) -> DVec3) -> [DVec3; 9] {
    let outer = 0.6f64.sqrt();
    let mut sums = [DVec3::ZERO; 9];
    for (z, weight) in [(-outer, 5.0 / 9.0), (0.0, 8.0 / 9.0), (outer, 5.0 / 9.0)] {
        for meridian in 0..6 {
            let (sin, cos) = (f64::from(meridian) * PI / 3.0).sin_cos();
            let level = (1.0 - z * z).sqrt();
            let n = DVec3::new(level * cos, level * sin, z);
            let value = of(n) * (weight * PI / 3.0);
            for (sum, (factor, polynomial)) in sums.iter_mut().zip(harmonics(n)) {
                *sum += value * (factor * factor * polynomial);
            }
        }
    }
    sums
}

/// Returns irradiance over π as factors of the polynomials of
/// [`diffuse`](polyptych_scene::EnvironmentMap::diffuse), integrated over all pixels in f64.
pub(super) fn diffuse(picture: &Equirect) -> [DVec3; 9] {
    let (width, height) = (f64::from(picture.width), f64::from(picture.height));
    let mut sums = [DVec3::ZERO; 9];
    let mut whole = 0.0;
    for (y, row) in picture.pixels.chunks_exact(picture.width as usize).enumerate() {
        // The exact solid angle of a pixel.
        let edge = |at: usize| (at as f64 / height * PI).cos();
        let weight = (edge(y) - edge(y + 1)) * 2.0 * PI / width;
        for (x, pixel) in row.iter().enumerate() {
            let u = (x as f64 + 0.5) / width;
            let direction = Equirect::direction(u, (y as f64 + 0.5) / height);
            let light = pixel.as_dvec3() * weight;
            for (sum, (factor, polynomial)) in sums.iter_mut().zip(harmonics(direction)) {
                *sum += light * (factor * polynomial);
            }
            whole += weight;
        }
    }
    // The factor of the harmonic itself goes in too, so that shaders need only the polynomials.
    let sphere = 4.0 * PI / whole;
    std::array::from_fn(|term| sums[term] * (HARMONICS[term] * BANDS[term] * sphere))
}
