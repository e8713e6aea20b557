//! UV images, also called ST maps: a PNG whose red is u and green is v of the screen's canvas.
//!
//! u runs from 0 at the left to 1 at the right, v from 0 at the bottom to 1 at the top, as in
//! programs for film; a stored value is the number times 65,535, whatever the file says of gamma.
//! 16 bits are asked for, as 8 bits are steps of 8 pixels on 2,048. A pixel is unlit where alpha
//! is 0, or, in a file without alpha, where blue is 0.

use glam::Vec3;
use polyptych_wall::warp::{MapCoordinates, WarpGeometry, WarpGrid, WarpMap};

use super::super::error::BakeError;
use super::png_image;

/// Reads a map.
pub(super) fn read(bytes: &[u8]) -> Result<WarpMap, BakeError> {
    let picture = png_image::decode(bytes)?;
    let right = "a PNG of 16 bits with u in red, v in green, and alpha or blue above 0 where lit";
    let bad = |what: String| BakeError::at("PNG", what, format!("{right} would be right"));
    if picture.components < 3 {
        return Err(bad("it is grey".to_owned()));
    }
    if picture.bits != 16 {
        return Err(bad(format!("it has {} bits", picture.bits)));
    }
    let number = |stored: u16| f32::from(stored) / f32::from(u16::MAX);
    let value = |pixel: &[u16]| {
        let lit = pixel.get(3).copied().unwrap_or(pixel[2]);
        if lit == 0 { Vec3::NAN } else { Vec3::new(number(pixel[0]), 1.0 - number(pixel[1]), 0.0) }
    };
    let values: Vec<Vec3> = picture.texels.chunks_exact(picture.components).map(value).collect();
    if values.iter().all(|value| value.is_nan()) {
        let which = if picture.components == 4 { "alpha" } else { "blue" };
        return Err(bad(format!("every pixel is unlit: {which} is 0 everywhere")));
    }
    let grid = WarpGrid::new(picture.size, values);
    Ok(WarpMap { space: MapCoordinates::Canvas, shape: WarpGeometry::Grid(grid) })
}
