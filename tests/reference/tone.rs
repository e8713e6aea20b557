//! From linear light to the codes of a display: Khronos PBR Neutral, then the curve of sRGB.
//! Unlit surfaces skip the tone mapper.

use glam::DVec3;

/// Codes from 0 to 255, not yet rounded, of linear light under an exposure.
pub fn codes(light: DVec3, exposure: f64) -> DVec3 {
    let light = (light * exposure).max(DVec3::ZERO);
    let shown = neutral(light).clamp(DVec3::ZERO, DVec3::ONE);
    DVec3::from_array(shown.to_array().map(|v| srgb(v) * 255.0))
}

/// Codes from 0 to 255, not yet rounded, of an unlit surface's linear colour, which is display
/// light as it stands (`KHR_materials_unlit`).
pub fn unlit_codes(color: DVec3) -> DVec3 {
    let color = color.clamp(DVec3::ZERO, DVec3::ONE);
    DVec3::from_array(color.to_array().map(|v| srgb(v) * 255.0))
}

/// Linear light of an 8-bit code; IEC 61966-2-1.
pub fn linear(code: u8) -> f64 {
    let v = f64::from(code) / 255.0;
    if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

fn srgb(v: f64) -> f64 {
    if v <= 0.003_130_8 { v * 12.92 } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}

/// The specification's own steps and constants: F90 is 0.04, compression begins at 0.8 − F90, and
/// the highlights lose their colour by 0.15.
fn neutral(color: DVec3) -> DVec3 {
    let (f90, desaturation) = (0.04, 0.15);
    let start = 0.8 - f90;
    let x = color.x.min(color.y).min(color.z);
    let offset = if x < 2.0 * f90 { x - x * x / (4.0 * f90) } else { f90 };
    let color = color - offset;
    let peak = color.x.max(color.y).max(color.z);
    if peak < start {
        return color;
    }
    let d = 1.0 - start;
    let new_peak = 1.0 - d * d / (peak + d - start);
    let g = 1.0 - 1.0 / (desaturation * (peak - new_peak) + 1.0);
    (color * (new_peak / peak)).lerp(DVec3::splat(new_peak), g)
}
