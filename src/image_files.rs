//! Pictures of a wall as files.

use std::io::Cursor;
use std::path::Path;

use anyhow::Context;
use image::{ImageFormat, RgbaImage};
use polyptych_client::Image;

use crate::outputs;

/// A picture of a capture as an image.
pub(crate) fn to_image(picture: &Image) -> anyhow::Result<RgbaImage> {
    RgbaImage::from_raw(picture.width, picture.height, picture.rgba.clone())
        .with_context(|| format!("the picture of {} has the wrong size", picture.name))
}

/// The screens of a wall in the order of its file, from left to right, their tops in line.
pub(crate) fn side_by_side(screens: &[Image]) -> anyhow::Result<RgbaImage> {
    if let [screen] = screens {
        return to_image(screen);
    }
    let width = screens.iter().map(|screen| screen.width).sum();
    let height = screens.iter().map(|screen| screen.height).max().unwrap_or(0);
    let mut all = RgbaImage::new(width, height);
    let mut left = 0;
    for screen in screens {
        image::imageops::replace(&mut all, &to_image(screen)?, left, 0);
        left += i64::from(screen.width);
    }
    Ok(all)
}

/// Writes a PNG file.
pub(crate) fn save_png(path: &Path, image: &RgbaImage) -> anyhow::Result<()> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, ImageFormat::Png)?;
    outputs::write(path, &bytes.into_inner())
}
