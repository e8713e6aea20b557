//! The picture of a channel that has nothing to draw: who it is, and where its display ends.

use image::{Rgba, RgbaImage};

use crate::gpu::Gpu;
use crate::output_texture::OutputTexture;
use crate::text::{BACKGROUND, Text};

const FRAME: Rgba<u8> = Rgba([242, 140, 40, 255]);
/// The divisor of the shorter side that gives the width of the frame; it is at least one pixel.
const FRAME_SHARE: u32 = 240;
/// The fraction of the width and height that the text may take.
const TEXT_SHARE: f64 = 0.9;
/// The divisor of the height that gives the maximum height of a line.
const LINE_SHARE: u32 = 12;
/// A line may take so many pixels, however low the display: smaller letters are not read.
const LINE_MIN: u32 = 16;

/// The idle picture of a size in pixels: the lines, centred, and a frame along the edges.
/// Letters outside of ASCII become "?".
pub fn picture(gpu: &Gpu, size: [u32; 2], lines: &[String]) -> OutputTexture {
    let side_max = gpu.device.limits().max_texture_dimension_2d;
    let size = size.map(|side| side.clamp(1, side_max));
    OutputTexture::of_pixels(gpu, size, &image(size, lines))
}

pub(crate) fn image([width, height]: [u32; 2], lines: &[String]) -> RgbaImage {
    let mut image = RgbaImage::from_pixel(width, height, BACKGROUND);
    let border = (width.min(height) / FRAME_SHARE).max(1);
    for (x, y, pixel) in image.enumerate_pixels_mut() {
        if x < border || y < border || x >= width - border || y >= height - border {
            *pixel = FRAME;
        }
    }
    let [text_width, text_height] = [width, height].map(|s| (f64::from(s) * TEXT_SHARE) as u32);
    let modest = (height / LINE_SHARE).max(LINE_MIN);
    if let Some(text) = Text::fit(lines, text_width, text_height, modest) {
        text.write(&mut image);
    }
    image
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_size_has_its_frame() {
        let lines = ["front-left".to_owned(), "waiting for the manager".to_owned()];
        for size in [[1, 1], [2, 1], [1, 700], [16, 16], [640, 360], [1080, 1920]] {
            let image = image(size, &lines);
            assert_eq!(*image.get_pixel(0, 0), FRAME, "{size:?}");
            assert_eq!(*image.get_pixel(size[0] - 1, size[1] - 1), FRAME, "{size:?}");
        }
        let large = image([640, 360], &lines);
        let bright = large.pixels().filter(|pixel| pixel.0[2] > 150).count();
        assert!(bright > 500, "only {bright} pixels of letters");
        assert_eq!(*image([640, 360], &[]).get_pixel(320, 180), BACKGROUND);
    }
}
