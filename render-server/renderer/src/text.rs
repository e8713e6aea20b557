//! Letters in a picture in main memory.

use image::{GrayImage, Luma, Rgba, RgbaImage};
use noto_sans_mono_bitmap::{
    FontWeight, RasterHeight, RasterizedChar, get_raster, get_raster_width,
};

/// Dark enough for letters in any light, and not black: it is seen where a display ends.
pub(crate) const BACKGROUND: Rgba<u8> = Rgba([18, 22, 28, 255]);
const LETTERS: [u8; 3] = [214, 222, 230];

/// Lines of text, broken where they would not fit, in one size of letters.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Text {
    lines: Vec<String>,
    size: RasterHeight,
    /// Each pixel of the letters is a square of this side.
    scale: u32,
}

impl Text {
    /// The lines in the largest letters in which they fit into `width` × `height` pixels, of at
    /// most `modest` pixels a line. Where not even the smallest letters do, lines are broken;
    /// what then goes beyond the height is left out. `None` where there is no room for a letter.
    pub fn fit(lines: &[String], width: u32, height: u32, modest: u32) -> Option<Self> {
        let sizes = [RasterHeight::Size16, RasterHeight::Size24, RasterHeight::Size32];
        let smallest = Self { lines: lines.to_vec(), size: RasterHeight::Size16, scale: 1 };
        let scaled = sizes.into_iter().flat_map(|size| (1..=8).map(move |scale| (size, scale)));
        let whole = scaled
            .map(|(size, scale)| Self { size, scale, ..smallest.clone() })
            .filter(|text| text.width() <= width && text.height() <= height)
            .filter(|text| text.line_height() <= modest)
            .max_by_key(|text| (text.line_height(), text.size.val()));
        let text = whole.unwrap_or_else(|| {
            let columns = (width / smallest.letter_width()) as usize;
            let mut lines: Vec<String> = lines.iter().flat_map(|l| broken(l, columns)).collect();
            lines.truncate((height / smallest.line_height()) as usize);
            Self { lines, ..smallest }
        });
        (text.width() > 0 && text.height() > 0).then_some(text)
    }

    /// Returns the width of the longest line, in pixels.
    pub fn width(&self) -> u32 {
        let longest = self.lines.iter().map(|line| line.chars().count()).max().unwrap_or(0);
        longest as u32 * self.letter_width()
    }

    /// Returns the height of all lines, in pixels.
    pub fn height(&self) -> u32 {
        self.lines.len() as u32 * self.line_height()
    }

    /// In pixels.
    pub fn line_height(&self) -> u32 {
        self.size.val() as u32 * self.scale
    }

    fn letter_width(&self) -> u32 {
        get_raster_width(FontWeight::Regular, self.size) as u32 * self.scale
    }

    /// Writes the lines one under the other, each centred. Letters outside of ASCII become "?".
    pub fn write(&self, image: &mut RgbaImage) {
        let mut top = image.height().saturating_sub(self.height()) / 2;
        for line in &self.lines {
            let width = line.chars().count() as u32 * self.letter_width();
            let mut left = image.width().saturating_sub(width) / 2;
            for letter in line.chars() {
                self.write_letter(image, letter, left, top);
                left += self.letter_width();
            }
            top += self.line_height();
        }
    }

    fn write_letter(&self, image: &mut RgbaImage, letter: char, left: u32, top: u32) {
        let raster = get_raster(letter, FontWeight::Regular, self.size)
            .or_else(|| get_raster('?', FontWeight::Regular, self.size));
        for (row, pixels) in (0u32..).zip(raster.iter().flat_map(RasterizedChar::rows)) {
            for (column, &ink) in (0u32..).zip(pixels) {
                let (x, y) = (left + column * self.scale, top + row * self.scale);
                blot(image, x, y, self.scale, ink);
            }
        }
    }
}

/// A line by itself: the ink of each pixel, 0 to 255, in the smallest letters. Letters outside of
/// ASCII become "?".
pub fn rasterize(line: &str) -> GrayImage {
    let size = RasterHeight::Size16;
    let width = get_raster_width(FontWeight::Regular, size) as u32;
    let mut image = GrayImage::new(line.chars().count() as u32 * width, size.val() as u32);
    for (at, letter) in (0u32..).zip(line.chars()) {
        let raster = get_raster(letter, FontWeight::Regular, size)
            .or_else(|| get_raster('?', FontWeight::Regular, size));
        for (y, pixels) in (0u32..).zip(raster.iter().flat_map(RasterizedChar::rows)) {
            for (x, &ink) in (0u32..).zip(pixels) {
                image.put_pixel(at * width + x, y, Luma([ink]));
            }
        }
    }
    image
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

/// A line as lines of at most `columns` letters, broken at spaces where there are some.
fn broken(line: &str, columns: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    if columns == 0 {
        return lines;
    }
    for word in line.split(' ') {
        let mut rest: Vec<char> = word.chars().collect();
        let last = lines.last().map_or(0, |last| last.chars().count());
        if last > 0 && last + 1 + rest.len() <= columns {
            if let Some(last) = lines.last_mut() {
                last.push(' ');
                last.extend(rest);
            }
            continue;
        }
        if last > 0 {
            lines.push(String::new());
        }
        while rest.len() > columns {
            let tail = rest.split_off(columns);
            if let Some(last) = lines.last_mut() {
                last.extend(rest);
            }
            lines.push(String::new());
            rest = tail;
        }
        if let Some(last) = lines.last_mut() {
            last.extend(rest);
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(text: &[&str]) -> Vec<String> {
        text.iter().map(|line| (*line).to_owned()).collect()
    }

    #[test]
    fn letters_are_as_large_as_fits_and_is_modest() {
        let two = lines(&["front-1-1", "127.0.0.1:41234"]);
        let large = Text::fit(&two, 3000, 1800, 180).expect("fits");
        assert!((150..=180).contains(&large.line_height()), "{large:?}");
        let small = Text::fit(&two, 300, 150, 16).expect("fits");
        assert_eq!((small.line_height(), small.lines.len()), (16, 2));
        assert_eq!(Text::fit(&two, 3, 150, 16), None, "no room for a letter");
        assert_eq!(Text::fit(&two, 300, 3, 16), None);
        assert_eq!(Text::fit(&[], 300, 300, 16), None);
    }

    #[test]
    fn what_is_too_long_is_broken_at_spaces_or_anywhere() {
        assert_eq!(broken("manager lost since noon", 12), ["manager lost", "since noon"]);
        assert_eq!(broken("a abcdefgh", 3), ["a", "abc", "def", "gh"]);
        assert_eq!(broken("", 3), [""]);
        let long = lines(&["adapter llvmpipe (LLVM 15.0.6, 256 bits)", "x"]);
        let text = Text::fit(&long, 160, 64, 16).expect("fits");
        assert!(text.width() <= 160 && text.height() <= 64, "{text:?}");
        assert_eq!(text.lines.last().map(String::as_str), Some("x"));
    }
}
