//! Directional albedo of the fibres of `KHR_materials_sheen`.
//!
//! They reflect `D V (n·l)`: A. Conty Estevez and C. Kulla, "Production Friendly Microfacet Sheen
//! BRDF" (2017), with α the square of the extension's roughness. At the rim of smooth fibres that
//! is more than 1; the shaders divide by it there.

use std::f64::consts::{FRAC_PI_4, PI};

use super::albedo::MU_MIN;

/// Minimum of roughness: below it all is within a few degrees of the rim, and reflects more light
/// than there is. Twin of `SHEEN_ROUGHNESS_MIN` in `include/sheen.wgsl`.
const ROUGHNESS_MIN: f64 = 0.1;

/// Part of uniform surroundings that white fibres reflect; `nodes` are places from 0 to 1 and
/// weights. Off by less than 0.001.
///
/// Half vectors are covered by their cosine c, and by the angle around the normal from the plane of
/// the eye, up to where the light sets.
pub(super) fn albedo(mu: f64, roughness: f64, nodes: &[[f64; 2]]) -> f64 {
    let alpha = roughness.max(ROUGHNESS_MIN).powi(2);
    let mu = mu.max(MU_MIN);
    let across = (1.0 - mu * mu).max(0.0).sqrt();
    // Below this cosine no half vector has its light above the horizon.
    let least = (FRAC_PI_4 + mu.acos() / 2.0).cos();
    let seen = lambda(mu, alpha);
    let mut sum = 0.0;
    for &[at, weight] in nodes {
        // Denser where most of the fibres are.
        let c = least + (1.0 - least) * at * at;
        let sine = (1.0 - c * c).max(0.0).sqrt();
        let sets = (mu / (2.0 * c) - mu * c) / (across * sine).max(1e-12);
        let end = sets.clamp(-1.0, 1.0).acos();
        let density = (2.0 + 1.0 / alpha) * sine.powf(1.0 / alpha) / (2.0 * PI);
        let step = weight * 2.0 * at * (1.0 - least) * 2.0 * end;
        for &[part, share] in nodes {
            let v_dot_h = across * sine * (end * part).cos() + mu * c;
            let n_dot_l = (2.0 * v_dot_h * c - mu).max(1e-9);
            // D V (n·l) dl, with dl = 4 v·h dh; n·l stands in V too.
            let shadow = 1.0 + seen + lambda(n_dot_l, alpha);
            sum += step * share * density * v_dot_h / (mu * shadow);
        }
    }
    sum
}

/// Smith's Λ, by the authors' fit.
fn lambda(cos: f64, alpha: f64) -> f64 {
    let fit = |x: f64| {
        let part = (1.0 - alpha).powi(2);
        let mix = |at_0: f64, at_1: f64| at_0 + (at_1 - at_0) * part;
        let (a, b) = (mix(21.5473, 25.3245), mix(3.82987, 3.32435));
        let (c, d, e) = (mix(0.19823, 0.16801), mix(-1.97760, -1.27393), mix(-4.32054, -4.85967));
        a / (1.0 + b * x.powf(c)) + d * x + e
    };
    if cos < 0.5 { fit(cos).exp() } else { (2.0 * fit(0.5) - fit(1.0 - cos)).exp() }
}

#[cfg(test)]
pub(crate) mod tests {
    use glam::DVec3;

    use super::*;

    /// D V of the fibres, times π.
    pub(crate) fn fibres(roughness: f64, eye: DVec3, light: DVec3) -> f64 {
        let alpha = roughness.powi(2);
        let cos = (eye + light).normalize().z;
        let density = (2.0 + 1.0 / alpha) * (1.0 - cos * cos).powf(0.5 / alpha) / 2.0;
        let shadow = 1.0 + lambda(eye.z, alpha) + lambda(light.z, alpha);
        density / (shadow * 4.0 * eye.z * light.z)
    }

    /// The albedo by another way: over directions of the light.
    pub(crate) fn integrated(mu: f64, roughness: f64) -> f64 {
        const STEPS: usize = 400;
        let eye = DVec3::new((1.0 - mu * mu).sqrt(), 0.0, mu);
        let mut sum = 0.0;
        for (i, j) in (0..STEPS).flat_map(|i| (0..STEPS).map(move |j| (i, j))) {
            let z = (i as f64 + 0.5) / STEPS as f64;
            let (sin, cos) = (PI * (j as f64 + 0.5) / STEPS as f64).sin_cos();
            let flat = (1.0 - z * z).sqrt();
            sum += fibres(roughness, eye, DVec3::new(flat * cos, flat * sin, z)) * z;
        }
        // Half of the circle, twice; π is in `fibres`.
        sum * 2.0 / (STEPS * STEPS) as f64
    }

    #[test]
    fn fibres_reflect_what_their_brdf_integrates_to() {
        let nodes = crate::albedo::gauss_legendre();
        for roughness in [0.1, 0.2, 0.35, 0.6, 1.0] {
            for mu in [0.05, 0.1, 0.2, 0.5, 0.8, 1.0] {
                let (got, wanted) = (albedo(mu, roughness, &nodes), integrated(mu, roughness));
                assert!((got - wanted).abs() < 0.003, "{got}, {wanted}: {mu}, {roughness}");
            }
        }
    }
}
