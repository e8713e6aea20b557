//! The light of a clear sky, from the direction of the sun alone.
//!
//! A. J. Preetham, P. Shirley and B. Smits, "A Practical Analytic Model for Daylight" (1999),
//! appendix A: Perez' formula for luminance and chromaticity, fitted to simulated scattering. The
//! sun itself is not in it: a directional light is. Below the horizon is ground of one colour.

use std::f64::consts::PI;

use glam::{DMat3, DVec3, Vec3};
use polyptych_scene::DEFAULT_SUN_TOWARD;

use super::equirect::Equirect;

/// The direction of the sun where no light of the scene gives one: that of the sun which shines in
/// scenes without lights, 49° high.
pub fn default_sun() -> DVec3 {
    DEFAULT_SUN_TOWARD.as_dvec3().normalize()
}

/// Minimum height of the sun, as the sine of 3°: the model has no dusk.
pub const SUN_HEIGHT_MIN: f64 = 0.052_335_956_242_943_83;

/// Haze, from 2 for air of high mountains to 10: a clear day.
const TURBIDITY: f64 = 3.0;

/// Radiance for a luminance of 1,000 cd/m²: with the sun 45° high, the whole sky gives as much
/// light as the sky of a scene that brings none.
const RADIANCE_PER_KCD: f64 = 0.05;

/// Albedo of the ground: dry soil.
const GROUND_ALBEDO: DVec3 = DVec3::new(0.24, 0.20, 0.16);

/// The sun's illuminance above the air in lux/1,000, and how much of it is lost along the shortest
/// way through clear air: Illuminating Engineering Society, RP-21 (1984).
const SUN_KLX: f64 = 127.5;
const SUN_EXTINCTION: f64 = 0.21;

/// Pixels across: 0.7° each, which is fine for what has no edge but the horizon.
const WIDTH: u32 = 512;

/// Directions for each pixel down, so that the horizon is smooth.
const STEPS_DOWN: u32 = 4;

/// The sun's direction with a length of 1, raised above the horizon where it is not.
pub(super) fn raised(sun: DVec3) -> DVec3 {
    let sun = sun.normalize_or(default_sun());
    if sun.y >= SUN_HEIGHT_MIN {
        return sun;
    }
    let level = DVec3::new(sun.x, 0.0, sun.z).normalize_or(DVec3::NEG_Z);
    level * (1.0 - SUN_HEIGHT_MIN * SUN_HEIGHT_MIN).sqrt() + DVec3::Y * SUN_HEIGHT_MIN
}

/// The sky for a direction of the sun that [`raised`] gave, and the ground that it lights.
pub(super) fn picture(sun: DVec3) -> Equirect {
    let height = WIDTH / 2;
    let sky = Sky::new(sun);
    let mut rows: Vec<Vec<DVec3>> = Vec::with_capacity(height as usize);
    let mut irradiance = DVec3::ZERO;
    for y in 0..height / 2 {
        let v = (f64::from(y) + 0.5) / f64::from(height);
        let row = |x: u32| {
            let u = (f64::from(x) + 0.5) / f64::from(WIDTH);
            let part = |step: u32| (f64::from(step) + 0.5) / f64::from(STEPS_DOWN) - 0.5;
            let place = |step| Equirect::direction(u, v + part(step) / f64::from(height));
            (0..STEPS_DOWN).map(|step| sky.radiance(place(step))).sum::<DVec3>()
                / f64::from(STEPS_DOWN)
        };
        let row: Vec<DVec3> = (0..WIDTH).map(row).collect();
        let solid_angle = (v * PI).sin() * (PI / f64::from(height)).powi(2);
        irradiance += row.iter().sum::<DVec3>() * ((v * PI).cos() * solid_angle);
        rows.push(row);
    }
    // The ground lies in the sun too, whatever light of the scene that is.
    let sun_klx = SUN_KLX * (-SUN_EXTINCTION / sun.y).exp() * sun.y;
    irradiance += DVec3::splat(sun_klx * RADIANCE_PER_KCD);
    let ground = (irradiance * GROUND_ALBEDO / PI).as_vec3();
    let above = rows.into_iter().flatten().map(DVec3::as_vec3);
    let below = std::iter::repeat_n(ground, (WIDTH * (height - height / 2)) as usize);
    Equirect { width: WIDTH, height, pixels: above.chain(below).collect::<Vec<Vec3>>() }
}

/// Perez' five numbers, for luminance Y and for the chromaticities x and y: factor of the
/// turbidity and constant of each.
const PEREZ: [[[f64; 2]; 5]; 3] = [
    [[0.1787, -1.4630], [-0.3554, 0.4275], [-0.0227, 5.3251], [0.1206, -2.5771], [-0.0670, 0.3703]],
    [
        [-0.0193, -0.2592],
        [-0.0665, 0.0008],
        [-0.0004, 0.2125],
        [-0.0641, -0.8989],
        [-0.0033, 0.0452],
    ],
    [
        [-0.0167, -0.2608],
        [-0.0950, 0.0092],
        [-0.0079, 0.2102],
        [-0.0441, -1.6537],
        [-0.0109, 0.0529],
    ],
];

/// Chromaticities x and y of the zenith: rows by T², T and 1, columns by θ³, θ², θ and 1.
const ZENITH: [[[f64; 4]; 3]; 2] = [
    [
        [0.001_66, -0.003_75, 0.002_09, 0.0],
        [-0.029_03, 0.063_77, -0.032_02, 0.003_94],
        [0.116_93, -0.211_96, 0.060_52, 0.258_86],
    ],
    [
        [0.002_75, -0.006_10, 0.003_17, 0.0],
        [-0.042_14, 0.089_70, -0.041_53, 0.005_16],
        [0.153_46, -0.267_56, 0.066_70, 0.266_88],
    ],
];

/// A sky with its sun.
#[derive(Clone, Copy, Debug)]
struct Sky {
    sun: DVec3,
    /// Perez' numbers for luminance and chromaticities.
    perez: [[f64; 5]; 3],
    /// The zenith's luminance in 1,000 cd/m² and its chromaticities, each over Perez' function
    /// there.
    zenith: [f64; 3],
}

impl Sky {
    fn new(sun: DVec3) -> Self {
        let angle = sun.y.clamp(-1.0, 1.0).acos();
        let perez = PEREZ.map(|rows| rows.map(|[slope, constant]| slope * TURBIDITY + constant));
        let chi = (4.0 / 9.0 - TURBIDITY / 120.0) * (PI - 2.0 * angle);
        let luminance = (4.0453 * TURBIDITY - 4.9710) * chi.tan() - 0.2155 * TURBIDITY + 2.4192;
        let [x, y] = ZENITH.map(|rows| {
            let row = |of: [f64; 4]| ((of[0] * angle + of[1]) * angle + of[2]) * angle + of[3];
            (row(rows[0]) * TURBIDITY + row(rows[1])) * TURBIDITY + row(rows[2])
        });
        let mut zenith = [luminance, x, y];
        for (value, perez) in zenith.iter_mut().zip(&perez) {
            *value /= distribution(perez, 1.0, angle);
        }
        Self { sun, perez, zenith }
    }

    /// Linear sRGB radiance from a direction above the horizon.
    fn radiance(&self, from: DVec3) -> DVec3 {
        let gamma = from.dot(self.sun).clamp(-1.0, 1.0).acos();
        // The horizon itself has no end in the formula.
        let cos = from.y.max(1e-3);
        let value = |at: usize| self.zenith[at] * distribution(&self.perez[at], cos, gamma);
        let [luminance, x, y] = [value(0), value(1), value(2)];
        let xyz = DVec3::new(x / y, 1.0, (1.0 - x - y) / y) * luminance;
        // IEC 61966-2-1, by columns.
        let rgb_from_xyz = DMat3::from_cols_array(&[
            3.2406, -0.9689, 0.0557, -1.5372, 1.8758, -0.2040, -0.4986, 0.0415, 1.0570,
        ]);
        (rgb_from_xyz * xyz * RADIANCE_PER_KCD).max(DVec3::ZERO)
    }
}

/// Perez' function of the cosine to the zenith and the angle to the sun.
fn distribution([a, b, c, d, e]: &[f64; 5], cos: f64, gamma: f64) -> f64 {
    (1.0 + a * (b / cos).exp()) * (1.0 + c * (d * gamma).exp() + e * gamma.cos().powi(2))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn luminance(rgb: DVec3) -> f64 {
        rgb.dot(DVec3::new(0.2126, 0.7152, 0.0722))
    }

    #[test]
    fn a_sky_is_blue_brightest_at_the_sun_and_lit_as_the_default_one() {
        let sun = raised(DVec3::new(-0.5, std::f64::consts::FRAC_1_SQRT_2, -0.5));
        let sky = Sky::new(sun);
        let zenith = sky.radiance(DVec3::Y);
        // Preetham's zenith, which its own formula gives: 7.32 kcd/m² at 45° and a turbidity of 3.
        let expected = 7.326 * RADIANCE_PER_KCD;
        assert!((luminance(zenith) - expected).abs() < 0.01 * expected, "{zenith}");
        assert!(zenith.z > 1.5 * zenith.x, "blue: {zenith}");
        let away = DVec3::new(-sun.x, sun.y, -sun.z);
        assert!(luminance(sky.radiance(sun)) > 3.0 * luminance(sky.radiance(away)));
        let picture = picture(sun);
        let irradiance = super::super::irradiance::diffuse(&picture);
        let up = irradiance[0] + irradiance[1] - irradiance[6] - irradiance[8];
        let default = luminance(crate::SKY_DEFAULT.as_dvec3());
        let share = luminance(up) / default;
        assert!((0.5..2.0).contains(&share), "{share} of the default sky's light");
        // 95 klx through the air, 67 klx on level ground, and a fifth of it reflected: the sun's
        // part is 0.21, and the ground is no bluer than what lights it.
        let ground = picture.pixels[picture.pixels.len() - 1];
        assert!((0.2..0.35).contains(&ground.y) && ground.z < 1.3 * ground.x, "{ground}");
    }

    #[test]
    fn a_sun_below_the_horizon_is_raised_and_gives_a_sky() {
        for sun in [DVec3::NEG_Y, DVec3::new(1.0, -0.2, 0.3), DVec3::ZERO] {
            let sun = raised(sun);
            assert!((sun.length() - 1.0).abs() < 1e-9 && sun.y >= SUN_HEIGHT_MIN - 1e-12);
            let picture = picture(sun);
            assert!(picture.pixels.iter().all(|of| of.is_finite() && of.min_element() >= 0.0));
        }
    }
}
