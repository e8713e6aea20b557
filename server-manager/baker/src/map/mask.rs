//! Masks: PNG of 8 or 16 bits, grey or colour, to linear light.
//!
//! Stored values are raised to the power that the `gAMA` chunk says; without one they are sRGB.
//! An MPCDI archive says the gamma of its maps itself, and then that holds.

use polyptych_wall::warp::Mask;

use super::super::error::BakeError;
use super::png_image::{self, PngImage};

/// Reads a mask. `gamma`: what somebody else says of the file, light = stored^gamma.
pub(super) fn read(bytes: &[u8], gamma: Option<f64>) -> Result<Mask, BakeError> {
    let picture = png_image::decode(bytes)?;
    convert(&picture, gamma)
}

/// The mask that a decoded picture is.
pub(super) fn convert(picture: &PngImage, gamma: Option<f64>) -> Result<Mask, BakeError> {
    let pixels = picture.texels.len() / picture.components;
    let is_clear = |pixel: &usize| picture.alpha(*pixel).is_some_and(|alpha| alpha != u16::MAX);
    if let Some(pixel) = (0..pixels).find(is_clear) {
        let (x, y) = (pixel % picture.size.x as usize, pixel / picture.size.x as usize);
        let what = "it is transparent, which says nothing of light";
        let right = "grey or colours without alpha would be right";
        return Err(BakeError::at(format!("pixel ({x}, {y})"), what, right));
    }
    let exponent = gamma.or(picture.gamma.map(f64::recip));
    let table: Vec<u16> = (0..=u16::MAX).map(|stored| linear(stored, exponent)).collect();
    let colours = if picture.components >= 3 { 3 } else { 1 };
    let light = |pixel: &[u16], i: usize| table[usize::from(pixel[i])];
    let texels = || picture.texels.chunks_exact(picture.components);
    let is_grey = colours == 1 || texels().all(|p| p[0] == p[1] && p[1] == p[2]);
    let texels = if is_grey {
        texels().map(|pixel| light(pixel, 0)).collect()
    } else {
        texels().flat_map(|pixel| [0, 1, 2].map(|i| light(pixel, i))).collect()
    };
    Ok(Mask { size: picture.size, components: if is_grey { 1 } else { 3 }, texels })
}

/// Linear light of a stored value: IEC 61966-2-1 without an exponent.
fn linear(stored: u16, exponent: Option<f64>) -> u16 {
    let value = f64::from(stored) / f64::from(u16::MAX);
    let light = match exponent {
        Some(exponent) => value.powf(exponent),
        None if value <= 0.04045 => value / 12.92,
        None => ((value + 0.055) / 1.055).powf(2.4),
    };
    (light * f64::from(u16::MAX)).round() as u16
}
