//! The tone mapper on the CPU, for the sky; the twin of `include/tone.wgsl`.

use glam::Vec3;
use polyptych_scene::ToneMapper;

/// The maximum value of a float target.
pub(crate) const LIGHT_MAX: f32 = 60000.0;

/// Linear display light of exposed scene light.
pub(crate) fn tone_map(tone: ToneMapper, light: Vec3) -> Vec3 {
    match tone {
        ToneMapper::Neutral => neutral(light),
        ToneMapper::Aces => aces(light),
        ToneMapper::None => light.clamp(Vec3::ZERO, Vec3::ONE),
    }
}

/// K. Narkowicz, "ACES Filmic Tone Mapping Curve" (2015).
fn aces(light: Vec3) -> Vec3 {
    let c = light.clamp(Vec3::ZERO, Vec3::splat(LIGHT_MAX)) * 0.6;
    let curve = (c * (c * 2.51 + 0.03)) / (c * (c * 2.43 + 0.59) + 0.14);
    curve.clamp(Vec3::ZERO, Vec3::ONE)
}

/// Khronos PBR Neutral, github.com/KhronosGroup/ToneMapping.
fn neutral(light: Vec3) -> Vec3 {
    const START: f32 = 0.76;
    const DESATURATION: f32 = 0.15;
    let color = light.max(Vec3::ZERO).min(Vec3::splat(LIGHT_MAX));
    let least = color.min_element();
    let offset = if least < 0.08 { least - 6.25 * least * least } else { 0.04 };
    let shifted = color - offset;
    let peak = shifted.max_element();
    if peak < START {
        return shifted;
    }
    let d = 1.0 - START;
    let new_peak = 1.0 - d * d / (peak + d - START);
    let g = 1.0 / (DESATURATION * (peak - new_peak) + 1.0);
    Vec3::splat(new_peak).lerp(shifted * (new_peak / peak), g)
}

/// Linear light of an 8-bit sRGB code; IEC 61966-2-1.
pub(crate) fn linear_from_srgb(code: u8) -> f64 {
    let v = f64::from(code) / 255.0;
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

/// The number that 16 bits of IEEE 754 binary16 stand for, infinities and NaN aside: a target
/// of light holds none.
pub(crate) fn f16_from_bits(bits: u16) -> f64 {
    let (exponent, fraction) = (i32::from(bits >> 10 & 0x1f), f64::from(bits & 0x3ff));
    let size = match exponent {
        0 => fraction / 1024.0 * (-14f64).exp2(),
        _ => (1.0 + fraction / 1024.0) * f64::from(exponent - 15).exp2(),
    };
    if bits >> 15 == 1 { -size } else { size }
}

/// Bits of the IEEE 754 binary16 that is nearest to a number from 0 to 65504.
pub(crate) fn f16_bits(number: f64) -> u16 {
    let exponent = number.max((-14f64).exp2()).log2().floor();
    // One that is rounded up to the next power of two carries into the exponent, as it should.
    let fraction = (number / exponent.exp2() * 1024.0).round() as u16;
    ((exponent as i32 + 14) as u16) * 1024 + fraction
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_half_float_is_written_as_it_is_read() {
        for bits in 0..0x7c00 {
            assert_eq!(f16_bits(f16_from_bits(bits)), bits);
        }
        assert_eq!(f16_bits(1.0 / 3.0), 0x3555);
    }

    #[test]
    fn half_floats_are_read() {
        let known = [(0x3c00, 1.0), (0x0001, 2f64.powi(-24)), (0xc000, -2.0), (0x3555, 0.33325195)];
        for (bits, number) in known {
            assert!((f16_from_bits(bits) - number).abs() < 1e-8, "{bits:x}");
        }
    }

    #[test]
    fn greys_keep_their_order_and_their_bounds() {
        for tone in ToneMapper::ALL {
            let mut last = -1.0;
            for step in 0..4000 {
                let mapped = tone_map(tone, Vec3::splat(step as f32 * 0.01)).x;
                assert!(mapped >= last && mapped <= 1.0, "{tone:?} {step}: {mapped}, {last}");
                last = mapped;
            }
            assert!(tone_map(tone, Vec3::splat(f32::INFINITY)).is_finite());
        }
        let of = |tone, light| tone_map(tone, Vec3::splat(light)).x;
        assert!((of(ToneMapper::Neutral, 0.5) - 0.46).abs() < 1e-6);
        // (c (2.51 c + 0.03)) / (c (2.43 c + 0.59) + 0.14) at c = 0.3 and at c = 0.6.
        assert!((of(ToneMapper::Aces, 0.5) - 0.2349 / 0.5357).abs() < 1e-6);
        assert!((of(ToneMapper::Aces, 1.0) - 0.9216 / 1.3688).abs() < 1e-6);
        assert_eq!((of(ToneMapper::None, 0.5), of(ToneMapper::None, 7.0)), (0.5, 1.0));
    }
}
