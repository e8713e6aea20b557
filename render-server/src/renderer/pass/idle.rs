//! The picture of a channel that has nothing to draw: who it is, and where its display ends.

use image::{Rgba, RgbaImage};
use noto_sans_mono_bitmap::{
    FontWeight, RasterHeight, RasterizedChar, get_raster, get_raster_width,
};

use crate::renderer::gpu::Gpu;
use crate::renderer::target::Target;

const BACKGROUND: Rgba<u8> = Rgba([18, 22, 28, 255]);
const LETTERS: [u8; 3] = [214, 222, 230];
const FRAME: Rgba<u8> = Rgba([242, 140, 40, 255]);
/// Of the shorter side; at least one pixel.
const FRAME_SHARE: u32 = 240;
/// Of the width that the longest line may take.
const TEXT_SHARE: f64 = 0.9;

/// Writes the idle picture into the target: the lines, centred, and a frame along the edges.
/// Letters outside of ASCII become "?".
pub fn draw(gpu: &Gpu, target: &mut Target, lines: &[String]) {
    let [width, height] = target.size();
    let picture = picture(target.size(), lines);
    gpu.queue.write_texture(
        target.display().as_image_copy(),
        &picture,
        wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(width * 4),
            rows_per_image: None,
        },
        wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
    );
    // Nothing else is submitted until the next frame, and a window may want the picture now.
    gpu.queue.submit([]);
}

/// The picture itself, for a target of this size in pixels.
pub fn picture([width, height]: [u32; 2], lines: &[String]) -> RgbaImage {
    let mut image = RgbaImage::from_pixel(width, height, BACKGROUND);
    let border = (width.min(height) / FRAME_SHARE).max(1);
    for (x, y, pixel) in image.enumerate_pixels_mut() {
        if x < border || y < border || x >= width - border || y >= height - border {
            *pixel = FRAME;
        }
    }
    let longest = lines.iter().map(|line| line.chars().count()).max().unwrap_or(0);
    let Some((size, scale)) = fit([width, height], longest, lines.len()) else { return image };
    let line_height = size.val() as u32 * scale;
    let text_height = line_height * lines.len() as u32;
    let mut top = (height - text_height.min(height)) / 2;
    for line in lines {
        write_line(&mut image, line, top, size, scale);
        top += line_height;
    }
    image
}

/// The largest letters with which all lines fit, up to a twelfth of the height; `None` where not
/// even the smallest do.
fn fit(
    [width, height]: [u32; 2],
    longest: usize,
    line_count: usize,
) -> Option<(RasterHeight, u32)> {
    let sizes = [RasterHeight::Size16, RasterHeight::Size24, RasterHeight::Size32];
    let scaled = sizes.into_iter().flat_map(|size| (1..=8).map(move |scale| (size, scale)));
    scaled
        .filter(|&(size, scale)| {
            let letter = get_raster_width(FontWeight::Regular, size) * scale as usize;
            let line = size.val() * scale as usize;
            let fits_across = (longest * letter) as f64 <= f64::from(width) * TEXT_SHARE;
            let fits_down = (line * line_count) as f64 <= f64::from(height) * TEXT_SHARE;
            let modest = line <= (height as usize / 12).max(RasterHeight::Size16.val());
            longest > 0 && fits_across && fits_down && modest
        })
        .max_by_key(|&(size, scale)| (size.val() as u32 * scale, size.val()))
}

fn write_line(image: &mut RgbaImage, line: &str, top: u32, size: RasterHeight, scale: u32) {
    let letter_width = get_raster_width(FontWeight::Regular, size) as u32 * scale;
    let line_width = line.chars().count() as u32 * letter_width;
    let mut left = (image.width() - line_width.min(image.width())) / 2;
    for letter in line.chars() {
        let raster = get_raster(letter, FontWeight::Regular, size)
            .or_else(|| get_raster('?', FontWeight::Regular, size));
        for (row, pixels) in (0u32..).zip(raster.iter().flat_map(RasterizedChar::rows)) {
            for (column, &ink) in (0u32..).zip(pixels) {
                blot(image, left + column * scale, top + row * scale, scale, ink);
            }
        }
        left += letter_width;
    }
}

/// A square of ink, 0 to 255, over the background.
fn blot(image: &mut RgbaImage, left: u32, top: u32, side: u32, ink: u8) {
    if ink == 0 {
        return;
    }
    let mix = |i: usize| {
        let (from, to) = (u32::from(BACKGROUND.0[i]), u32::from(LETTERS[i]));
        ((from * (255 - u32::from(ink)) + to * u32::from(ink)) / 255) as u8
    };
    let color = Rgba([mix(0), mix(1), mix(2), 255]);
    for y in top..top + side {
        for x in left..left + side {
            if let Some(pixel) = image.get_pixel_mut_checked(x, y) {
                *pixel = color;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_size_has_its_frame() {
        let lines = ["front-left".to_owned(), "waiting for the manager".to_owned()];
        for size in [[1, 1], [2, 1], [1, 700], [16, 16], [640, 360], [1080, 1920]] {
            let image = picture(size, &lines);
            assert_eq!(*image.get_pixel(0, 0), FRAME, "{size:?}");
            assert_eq!(*image.get_pixel(size[0] - 1, size[1] - 1), FRAME, "{size:?}");
        }
        let large = picture([640, 360], &lines);
        let bright = large.pixels().filter(|pixel| pixel.0[2] > 150).count();
        assert!(bright > 500, "only {bright} pixels of letters");
        assert_eq!(*picture([640, 360], &[]).get_pixel(320, 180), BACKGROUND);
    }
}
