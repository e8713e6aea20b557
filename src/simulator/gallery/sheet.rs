//! The sheet of a gallery: the pictures of all models in rows, each above its name.

use anyhow::bail;
use image::{GrayImage, Rgba, RgbaImage, imageops};
use polyptych_render::rasterize;

/// Height of a line of text, and width of a letter, in pixels.
const LETTER: [u32; 2] = [7, 16];

/// Height of the line below a picture, in pixels.
const CAPTION_HEIGHT: u32 = LETTER[1] + 4;

/// Pixels to the left of text.
const MARGIN: u32 = 4;

/// Maximum size of a sheet: with a copy of its file it fits into the memory of a small machine.
const SHEET_BYTES_MAX: u64 = 1 << 30;

/// Longest side of a sheet, in pixels: what viewers still open.
const SIDE_MAX: u64 = 1 << 16;

const PAPER: Rgba<u8> = Rgba([24, 26, 30, 255]);
const LETTERS: [u8; 3] = [214, 222, 230];
const WARNING_LETTERS: [u8; 3] = [255, 176, 96];

/// Pictures in rows.
#[derive(Debug)]
pub(crate) struct Sheet {
    image: RgbaImage,
    /// Width and height of a picture, in pixels.
    size: [u32; 2],
    columns: u32,
}

impl Sheet {
    /// Returns a sheet for so many pictures of this size in pixels, in so many columns; without a
    /// number, it is about as wide as high.
    ///
    /// # Errors
    /// A sheet that would be too large.
    pub fn new(count: usize, size: [u32; 2], columns: Option<u32>) -> anyhow::Result<Self> {
        let count = u32::try_from(count).unwrap_or(u32::MAX).max(1);
        let aspect = f64::from(size[1] + CAPTION_HEIGHT) / f64::from(size[0].max(1));
        let square = (f64::from(count) * aspect).sqrt().ceil() as u32;
        let columns = columns.unwrap_or(square).clamp(1, count);
        let rows = count.div_ceil(columns);
        let [width, height] = [
            u64::from(columns) * u64::from(size[0]),
            u64::from(rows) * u64::from(size[1] + CAPTION_HEIGHT),
        ];
        if width.max(height) > SIDE_MAX || width * height * 4 > SHEET_BYTES_MAX {
            bail!(
                "a sheet of {count} pictures of {}x{} pixels in {columns} columns has \
                 {width}x{height} pixels, where {SIDE_MAX} are the most along a side and {} \
                 together: give a smaller --size, other --columns, or fewer models",
                size[0],
                size[1],
                SHEET_BYTES_MAX / 4
            );
        }
        let image = RgbaImage::from_pixel(width as u32, height as u32, PAPER);
        Ok(Self { image, size, columns })
    }

    /// Puts a picture into its place; without one, the reason stands there.
    pub fn place(&mut self, index: usize, name: &str, picture: Result<&RgbaImage, &str>) {
        let index = index as u32;
        let left = index % self.columns * self.size[0];
        let top = index / self.columns * (self.size[1] + CAPTION_HEIGHT);
        let columns = (self.size[0].saturating_sub(MARGIN) / LETTER[0]) as usize;
        let mut color = LETTERS;
        match picture {
            Ok(picture) => imageops::replace(&mut self.image, picture, left.into(), top.into()),
            Err(reason) => {
                color = WARNING_LETTERS;
                let letters: Vec<char> = reason.chars().collect();
                let lines = letters.chunks(columns.max(1)).map(String::from_iter);
                let most = (self.size[1] / LETTER[1]) as usize;
                for (row, line) in (0u32..).zip(lines.take(most)) {
                    self.write(&line, [left + MARGIN, top + row * LETTER[1]], color);
                }
            }
        }
        let below = top + self.size[1] + (CAPTION_HEIGHT - LETTER[1]) / 2;
        let name: String = name.chars().take(columns).collect();
        self.write(&name, [left + MARGIN, below], color);
    }

    /// Returns the sheet.
    pub fn into_image(self) -> RgbaImage {
        self.image
    }

    fn write(&mut self, line: &str, [left, top]: [u32; 2], color: [u8; 3]) {
        let ink: GrayImage = rasterize(line);
        for (x, y, ink) in ink.enumerate_pixels() {
            let Some(pixel) = self.image.get_pixel_mut_checked(left + x, top + y) else { continue };
            let share = u32::from(ink.0[0]);
            for (i, to) in color.into_iter().enumerate() {
                let mixed = u32::from(pixel.0[i]) * (255 - share) + u32::from(to) * share;
                pixel.0[i] = (mixed / 255) as u8;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_picture_has_a_place_of_its_own_above_its_name() {
        let mut sheet = Sheet::new(3, [64, 48], Some(2)).expect("a sheet");
        let colors = [Rgba([200, 0, 0, 255]), Rgba([0, 200, 0, 255])];
        for (index, color) in colors.into_iter().enumerate() {
            let picture = RgbaImage::from_pixel(64, 48, color);
            sheet.place(index, "ab", Ok(&picture));
        }
        sheet.place(2, "cd", Err("no such file, and a long reason that goes on for some lines"));
        let image = sheet.into_image();
        assert_eq!(image.dimensions(), (128, 2 * (48 + CAPTION_HEIGHT)));
        assert_eq!((*image.get_pixel(63, 47), *image.get_pixel(64, 0)), (colors[0], colors[1]));
        let inked = |x: std::ops::Range<u32>, y: std::ops::Range<u32>| {
            y.flat_map(|y| x.clone().map(move |x| (x, y)))
                .filter(|&(x, y)| *image.get_pixel(x, y) != PAPER)
                .count()
        };
        assert!(inked(0..64, 48..68) > 10, "the first name");
        assert!(inked(0..64, 68..116) > 100, "the reason");
        assert_eq!(inked(64..128, 68..136), 0, "nothing beyond the last model");
    }

    #[test]
    fn a_sheet_that_no_viewer_opens_is_refused_with_a_remedy() {
        let error = Sheet::new(100_000, [320, 180], None).expect_err("too high").to_string();
        assert!(error.contains("--columns") && error.contains("--size"), "{error}");
        let sheet = Sheet::new(1800, [320, 180], None).expect("a sheet").into_image();
        let (width, height) = (f64::from(sheet.width()), f64::from(sheet.height()));
        assert!((0.9..1.1).contains(&(width / height)), "{width} by {height}");
    }
}
