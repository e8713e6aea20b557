//! Words over a picture: what a display is, or that its picture is old. Drawn onto the display
//! only, by `present_pass.rs`; the picture itself stays as it is, for it may be captured.

use image::RgbaImage;

use crate::text::{BACKGROUND, Text};

/// Letters are not smaller than this: 16 pixels a line.
const LINE_MIN: u32 = 16;

/// The position of a label, which also decides its size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LabelPosition {
    /// In the middle, in letters that are read from across the room.
    Middle,
    /// In the lower left, in letters that leave the picture alone.
    Corner,
}

/// The words of a label.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Label {
    /// One under the other. Letters outside of ASCII become "?".
    pub lines: Vec<String>,
    /// The position of the lines on the display.
    pub place: LabelPosition,
}

impl Label {
    /// The panel with the words, and its upper left on a display of this size in pixels; `None`
    /// where there is no room for a letter.
    pub fn image(&self, [width, height]: [u32; 2]) -> Option<(RgbaImage, [u32; 2])> {
        let line_share = match self.place {
            LabelPosition::Middle => 10,
            LabelPosition::Corner => 45,
        };
        let modest = (height / line_share).max(LINE_MIN);
        // The panel stands out by half a line on all sides, as far as the display does.
        let text = Text::fit(&self.lines, width * 9 / 10, height * 9 / 10, modest)?;
        let margin = text.line_height() / 2;
        let panel = [(text.width() + 2 * margin).min(width), (text.height() + margin).min(height)];
        let mut image = RgbaImage::from_pixel(panel[0], panel[1], BACKGROUND);
        text.write(&mut image);
        let origin = match self.place {
            LabelPosition::Middle => [(width - panel[0]) / 2, (height - panel[1]) / 2],
            LabelPosition::Corner => [0, height - panel[1]],
        };
        Some((image, origin))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_label_fits_every_display_and_leaves_most_of_it_free() {
        let lines = ["front-1-1", "server left", "192.168.100.200:41234", "3840 x 2160 pixels"];
        let lines: Vec<String> = lines.map(str::to_owned).to_vec();
        for (place, share) in [(LabelPosition::Middle, 0.75), (LabelPosition::Corner, 0.55)] {
            let label = Label { lines: lines.clone(), place };
            for size in [[320, 180], [640, 360], [1080, 1920], [3840, 2160], [8192, 512]] {
                let (image, [left, top]) = label.image(size).expect("room");
                let (width, height) = (left + image.width(), top + image.height());
                assert!(width <= size[0] && height <= size[1], "{place:?} {size:?}");
                let covered = f64::from(image.width() * image.height());
                let covered = covered / f64::from(size[0] * size[1]);
                assert!(covered < share, "{place:?} {size:?}: {covered}");
                let bright = image.pixels().filter(|pixel| pixel.0[2] > 150).count();
                assert!(bright > 300, "{place:?} {size:?}: only {bright} pixels of letters");
            }
            assert!(label.image([4, 4]).is_none(), "no room for a letter");
        }
    }
}
