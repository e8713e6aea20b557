//! Masks of other systems: pictures of any size, as codes of a channel's pixels.

use std::fs;

use glam::DVec2;

use super::super::optics::places;
use super::mesh::path_of;
use super::tree::At;

/// Longest side of a mask, in pixels.
const SIDE_MAX: u32 = 16_384;

/// The grey of a PNG or JPEG that a configuration names, at the centre of each pixel of a channel,
/// row by row from the upper left.
pub(super) fn read(at: &At<'_>, size: [u32; 2]) -> anyhow::Result<Vec<f64>> {
    let path = path_of(at)?;
    let bad = |error: &dyn std::fmt::Display| {
        let what = format!("cannot read {}: {error}", path.display());
        at.error(what, "a PNG or JPEG would be right")
    };
    let bytes = fs::read(&path).map_err(|error| bad(&error))?;
    let mut reader = image::ImageReader::new(std::io::Cursor::new(bytes));
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(SIDE_MAX);
    limits.max_image_height = Some(SIDE_MAX);
    reader.limits(limits);
    let reader = reader.with_guessed_format().map_err(|error| bad(&error))?;
    let picture = reader.decode().map_err(|error| bad(&error))?.into_luma16();
    let last = DVec2::new(f64::from(picture.width()), f64::from(picture.height())) - 1.0;
    let code = |x: f64, y: f64| f64::from(picture.get_pixel(x as u32, y as u32)[0]) / 65_535.0;
    let sample = |place: DVec2| {
        let at = DVec2::new(place.x, 1.0 - place.y) * (last + 1.0) - 0.5;
        let at = at.clamp(DVec2::ZERO, last);
        let (low, share) = (at.floor(), at.fract());
        let high = (low + 1.0).min(last);
        let upper = code(low.x, low.y) * (1.0 - share.x) + code(high.x, low.y) * share.x;
        let lower = code(low.x, high.y) * (1.0 - share.x) + code(high.x, high.y) * share.x;
        upper * (1.0 - share.y) + lower * share.y
    };
    Ok(places(size).map(sample).collect())
}
