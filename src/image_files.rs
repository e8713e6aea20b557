//! Pictures of a wall as files.

use std::io::Cursor;
use std::path::Path;

use anyhow::{Context, bail};
use image::codecs::jpeg::JpegEncoder;
use image::imageops::FilterType;
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

/// The quality of a JPEG file, of 100.
const JPEG_QUALITY: u8 = 88;

/// Returns whether a path names a JPEG file; `None` if neither that nor PNG.
fn is_jpeg(path: &Path) -> Option<bool> {
    let end = path.extension()?.to_ascii_lowercase();
    match end.to_str()? {
        "png" => Some(false),
        "jpg" | "jpeg" => Some(true),
        _ => None,
    }
}

/// Checks that a picture can be written here.
///
/// # Errors
/// The name ends in another way than those of pictures do, or something is there that is no file.
pub(crate) fn check(path: &Path) -> anyhow::Result<()> {
    let Some(_) = is_jpeg(path) else {
        bail!("{}: write a name that ends in .png or .jpg", path.display());
    };
    outputs::check(path)
}

/// Writes a PNG or JPEG file, as its name says; with half of the pixels along each side if asked.
pub(crate) fn save(path: &Path, image: &RgbaImage, is_halved: bool) -> anyhow::Result<()> {
    let halved = is_halved.then(|| {
        let [width, height] = [image.width(), image.height()].map(|side| side.div_ceil(2));
        image::imageops::resize(image, width, height, FilterType::Triangle)
    });
    let image = halved.as_ref().unwrap_or(image);
    if is_jpeg(path) != Some(true) {
        return save_png(path, image);
    }
    let mut bytes = Vec::new();
    let opaque = image::DynamicImage::ImageRgba8(image.clone()).into_rgb8();
    opaque.write_with_encoder(JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY))?;
    outputs::write(path, &bytes)
}

/// Writes a PNG file.
pub(crate) fn save_png(path: &Path, image: &RgbaImage) -> anyhow::Result<()> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, ImageFormat::Png)?;
    outputs::write(path, &bytes.into_inner())
}
