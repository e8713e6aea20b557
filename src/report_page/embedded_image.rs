//! Pictures within a page: no other file is needed to see them.

use std::io::Cursor;

use glam::DVec2;
use image::codecs::jpeg::JpegEncoder;
use image::imageops::FilterType;
use image::{ImageFormat, RgbaImage};

use super::markup::{add, escaped};

/// Maximum side of a picture in a page, in pixels.
const SIDE_MAX: u32 = 1600;

/// The quality of a JPEG picture, of 100.
const JPEG_QUALITY: u8 = 85;

/// Radius of a mark, in shares of the width of a picture.
const MARK: f64 = 0.011;

/// A picture that is written into a page.
#[derive(Clone, Debug)]
pub(crate) struct EmbeddedImage {
    uri: String,
    /// Width and height of the whole picture, which the page may have smaller.
    size: DVec2,
}

/// A place of a picture, in its pixels, with a text beside it.
pub(crate) struct Mark {
    pub at: DVec2,
    /// A short text beside it.
    pub text: String,
    pub class: &'static str,
}

impl EmbeddedImage {
    /// Returns a photograph-like picture.
    ///
    /// # Errors
    /// The encoder's error for a picture without pixels.
    pub fn photograph(image: &RgbaImage) -> anyhow::Result<Self> {
        let opaque = image::DynamicImage::ImageRgba8(shrunk(image)).into_rgb8();
        let mut bytes = Vec::new();
        opaque.write_with_encoder(JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY))?;
        Ok(Self::new("image/jpeg", &bytes, image))
    }

    /// Returns a picture of which every level counts: a pixel is as bright as the brightest that it
    /// stands for.
    ///
    /// # Errors
    /// The encoder's error for a picture without pixels.
    pub fn exact(image: &RgbaImage) -> anyhow::Result<Self> {
        let mut bytes = Cursor::new(Vec::new());
        brightest(image).write_to(&mut bytes, ImageFormat::Png)?;
        Ok(Self::new("image/png", &bytes.into_inner(), image))
    }

    fn new(kind: &str, bytes: &[u8], image: &RgbaImage) -> Self {
        let size = DVec2::new(f64::from(image.width()), f64::from(image.height()));
        Self { uri: format!("data:{kind};base64,{}", base64(bytes)), size }
    }

    /// Returns the picture with its marks, as an SVG element as wide as the page.
    pub fn svg(&self, title: &str, marks: &[Mark]) -> String {
        let (width, height, title) = (self.size.x, self.size.y, escaped(title));
        let mut svg = format!(
            "<svg class=\"picture\" viewBox=\"0 0 {width} {height}\" role=\"img\" \
             aria-label=\"{title}\">\n<title>{title}</title>\n<image href=\"{}\" \
             width=\"{width}\" height=\"{height}\"/>\n",
            self.uri
        );
        let radius = MARK * width;
        for Mark { at, text, class } in marks.iter().filter(|mark| mark.at.is_finite()) {
            let (x, y, text) = (at.x, at.y, escaped(text));
            add(
                &mut svg,
                format_args!(
                    "<circle class=\"mark-ring {class}\" cx=\"{x:.1}\" cy=\"{y:.1}\" \
                     r=\"{radius:.1}\" style=\"stroke-width:{:.1}\"/><text class=\"mark-text\" \
                     x=\"{:.1}\" y=\"{y:.1}\" style=\"font-size:{:.1}px\">{text}</text>\n",
                    radius * 0.3,
                    x + radius * 1.4,
                    radius * 2.2
                ),
            );
        }
        svg.push_str("</svg>\n");
        svg
    }
}

/// Returns width and height of a picture in a page, of which none is larger than [`SIDE_MAX`].
fn shrunk_size(image: &RgbaImage) -> [u32; 2] {
    let longest = image.width().max(image.height()).max(SIDE_MAX);
    let part = |side: u32| u64::from(side) * u64::from(SIDE_MAX) / u64::from(longest);
    [image.width(), image.height()].map(|side| (part(side) as u32).max(side.min(1)))
}

/// Returns a picture no larger than [`SIDE_MAX`], whose pixels are means.
fn shrunk(image: &RgbaImage) -> RgbaImage {
    let [width, height] = shrunk_size(image);
    if [width, height] == [image.width(), image.height()] {
        return image.clone();
    }
    image::imageops::resize(image, width, height, FilterType::Triangle)
}

/// Returns a picture no larger than [`SIDE_MAX`], whose pixels are maxima: a mean would hide a
/// difference of a single pixel.
fn brightest(image: &RgbaImage) -> RgbaImage {
    let [width, height] = shrunk_size(image);
    let part = |at: u32, from: u32, to: u32| u64::from(at) * u64::from(to) / u64::from(from);
    let mut small = RgbaImage::new(width, height);
    for (x, y, pixel) in image.enumerate_pixels() {
        let at = [part(x, image.width(), width), part(y, image.height(), height)];
        let most = small.get_pixel_mut(at[0] as u32, at[1] as u32);
        most.0 = std::array::from_fn(|channel| most.0[channel].max(pixel.0[channel]));
    }
    small
}

/// Returns bytes as text: RFC 4648, §4.
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for group in bytes.chunks(3) {
        let byte = |at: usize| u32::from(group.get(at).copied().unwrap_or(0));
        let bits = byte(0) << 16 | byte(1) << 8 | byte(2);
        for digit in 0..4 {
            let value = (bits >> (18 - 6 * digit)) & 63;
            let is_there = digit <= group.len();
            text.push(if is_there { char::from(DIGITS[value as usize]) } else { '=' });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_written_as_rfc_4648_has_them() {
        let cases =
            [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foob", "Zm9vYg==")];
        for (bytes, text) in cases {
            assert_eq!(base64(bytes.as_bytes()), text);
        }
    }

    #[test]
    fn a_difference_of_one_pixel_is_as_bright_in_a_smaller_picture() {
        let mut image = RgbaImage::from_pixel(4001, 5, image::Rgba([0, 0, 0, 255]));
        image.put_pixel(4000, 4, image::Rgba([0, 31, 0, 255]));
        let small = brightest(&image);
        assert_eq!(small.dimensions(), (1600, 1));
        assert_eq!(small.get_pixel(1599, 0).0, [0, 31, 0, 255]);
        assert_eq!(small.get_pixel(1598, 0).0, [0, 0, 0, 255]);
        assert_eq!(brightest(&RgbaImage::new(7, 3)).dimensions(), (7, 3));
        EmbeddedImage::exact(&image).expect("a picture");
    }

    #[test]
    fn a_large_picture_keeps_its_places() {
        let image = RgbaImage::new(4000, 1000);
        let embedded = EmbeddedImage::photograph(&image).expect("a picture");
        let mark = Mark { at: DVec2::new(3999.0, 10.0), text: "1 & 2".into(), class: "s0" };
        let svg = embedded.svg("wall", &[mark]);
        let document = roxmltree::Document::parse(&svg).expect("XML");
        assert!(svg.contains("viewBox=\"0 0 4000 1000\"") && svg.contains("cx=\"3999.0\""));
        assert!(document.descendants().any(|node| node.text() == Some("1 & 2")));
    }
}
