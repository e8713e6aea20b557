//! Patterns of the display's own pixels.

use glam::UVec2;
use image::RgbaImage;

use super::{blank, opaque};

/// Steps of grey under the colour bars.
const GREY_STEPS: u32 = 16;

/// Side of a patch of the focus pattern, in pixels; even, so that patches fit together.
const PATCH: u32 = 32;

/// White, yellow, cyan, green, magenta, red, blue, black: falling in luminance.
const BARS: [[u8; 3]; 8] = [
    [255, 255, 255],
    [255, 255, 0],
    [0, 255, 255],
    [0, 255, 0],
    [255, 0, 255],
    [255, 0, 0],
    [0, 0, 255],
    [0, 0, 0],
];

/// The outermost pixels, white.
pub(super) fn border(size: UVec2) -> RgbaImage {
    let mut image = blank(size);
    for (x, y, pixel) in image.enumerate_pixels_mut() {
        if x == 0 || y == 0 || x + 1 == size.x || y + 1 == size.y {
            *pixel = opaque([255; 3]);
        }
    }
    image
}

/// All codes from 0 at the left to 255 at the right: of grey, red, green and blue, in rows.
pub(super) fn ramp(size: UVec2) -> RgbaImage {
    const ROWS: [[u8; 3]; 4] = [[1, 1, 1], [1, 0, 0], [0, 1, 0], [0, 0, 1]];
    paint(size, |x, y| {
        let code = part(x, size.x, 256) as u8;
        ROWS[part(y, size.y, 4) as usize].map(|share| share * code)
    })
}

/// Bars of full colour, and below them steps of grey.
pub(super) fn color_bars(size: UVec2) -> RgbaImage {
    paint(size, |x, y| {
        if part(y, size.y, 4) < 3 {
            BARS[part(x, size.x, BARS.len() as u32) as usize]
        } else {
            [(part(x, size.x, GREY_STEPS) * 255 / (GREY_STEPS - 1)) as u8; 3]
        }
    })
}

/// Patches of upright and lying lines of one pixel, and of squares of one and of two.
pub(super) fn focus_chart(size: UVec2) -> RgbaImage {
    paint(size, |x, y| {
        let is_lit = match ((x / PATCH) % 2, (y / PATCH) % 2) {
            (0, 0) => x % 2 == 0,
            (1, 0) => y % 2 == 0,
            (0, _) => (x + y) % 2 == 0,
            _ => (x / 2 + y / 2) % 2 == 0,
        };
        [if is_lit { 255 } else { 0 }; 3]
    })
}

/// Returns the index of the part that a pixel lies in, if a side has so many equal parts.
fn part(at: u32, side: u32, parts: u32) -> u32 {
    (u64::from(at) * u64::from(parts) / u64::from(side)) as u32
}

fn paint(size: UVec2, color: impl Fn(u32, u32) -> [u8; 3]) -> RgbaImage {
    RgbaImage::from_fn(size.x, size.y, |x, y| opaque(color(x, y)))
}
