//! Light to codes of a display, and back; pure f64. The renderer does the same in f32, and what
//! simulates a wall undoes it.

use glam::{DMat3, DVec3};

use super::{ColorCorrection, TransferFunction};

impl ColorCorrection {
    /// Returns the factor of linear light: the matrix, then the gains.
    pub fn made(&self) -> DMat3 {
        DMat3::from_diagonal(self.gain) * self.matrix
    }

    /// The codes, 0 to 1, of linear light that neighbours share and masks cut: × `multiply` +
    /// `add`, after the matrix and the gains.
    pub fn codes(&self, light: DVec3, multiply: DVec3, add: DVec3) -> DVec3 {
        let mixed = self.made() * light;
        self.curve.encode(mixed.clamp(DVec3::ZERO, DVec3::ONE) * multiply + add)
    }
}

impl TransferFunction {
    /// The codes, 0 to 1, with which a display shows this light; what leaves 0 to 1 is clipped.
    pub fn encode(&self, light: DVec3) -> DVec3 {
        let light = light.clamp(DVec3::ZERO, DVec3::ONE);
        match self {
            Self::Srgb => light.map(srgb_from_linear),
            Self::Gamma(gamma) => powers(light, gamma.recip()),
            Self::Measured(points) => {
                let code = |axis: usize| code_of(points, axis, light[axis]);
                DVec3::new(code(0), code(1), code(2))
            }
        }
    }

    /// The light, 0 to 1, that a display makes of codes.
    pub fn decode(&self, code: DVec3) -> DVec3 {
        let code = code.clamp(DVec3::ZERO, DVec3::ONE);
        match self {
            Self::Srgb => code.map(linear_from_srgb),
            Self::Gamma(gamma) => powers(code, *gamma),
            Self::Measured(points) => {
                let last = points.len().saturating_sub(1);
                let light = |axis: usize| {
                    let at = code[axis] * last as f64;
                    let low = (at as usize).min(last.saturating_sub(1));
                    let of = |index: usize| points.get(index).map_or(code[axis], |p| p[axis]);
                    of(low) + (of(low + 1) - of(low)) * (at - low as f64)
                };
                DVec3::new(light(0), light(1), light(2))
            }
        }
    }
}

/// Each component to a power of its own.
fn powers(base: DVec3, exponents: DVec3) -> DVec3 {
    DVec3::from_array([0, 1, 2].map(|axis| base[axis].powf(exponents[axis])))
}

/// The code that gives this light, of a curve that rises linearly between its points; the first
/// one where several do.
fn code_of(points: &[DVec3], axis: usize, light: f64) -> f64 {
    let above = points.partition_point(|point| point[axis] < light);
    let Some(below) = above.checked_sub(1) else { return 0.0 };
    let low = points[below][axis];
    let high = points.get(above).map_or(1.0, |point| point[axis]);
    (below as f64 + (light - low) / (high - low)) / (points.len() - 1) as f64
}

/// Light to the nearest of the 256 sRGB codes, as fast as a wall's canvas wants it, and exact.
#[derive(Clone, Debug)]
pub struct SrgbCodes {
    /// From this light on, the code is the next one.
    ends: [f64; 256],
    /// The code of the lights i / 4,095, or a lower one: at most two below, as the steepest part
    /// has 3,295 codes per light of 1.
    first: Vec<u8>,
}

impl Default for SrgbCodes {
    fn default() -> Self {
        let mut ends = std::array::from_fn(|code| linear_from_srgb((code as f64 + 0.5) / 255.0));
        ends[255] = f64::INFINITY;
        let first = |i: u16| ends.partition_point(|end| *end <= f64::from(i) / 4095.0) as u8;
        let first = (0..4096).map(first).collect();
        Self { ends, first }
    }
}

impl SrgbCodes {
    /// The code of a light; what leaves 0 to 1 is clipped.
    pub fn code(&self, light: f64) -> u8 {
        let light = light.clamp(0.0, 1.0);
        let mut code = self.first.get((light * 4095.0) as usize).copied().unwrap_or(0);
        while self.ends[usize::from(code)] <= light {
            code += 1;
        }
        code
    }
}

/// IEC 61966-2-1: the code of light, both 0 to 1.
pub fn srgb_from_linear(light: f64) -> f64 {
    if light <= 0.0031308 { light * 12.92 } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
}

/// IEC 61966-2-1: the light of a code, both 0 to 1.
pub fn linear_from_srgb(code: f64) -> f64 {
    if code <= 0.04045 { code / 12.92 } else { ((code + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests;
