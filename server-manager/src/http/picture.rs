//! Pictures of a capture as files: screens side by side, scaled down, encoded.

use bytes::Bytes;
use polyptych_protocol::request::{CaptureInfo, ImageInfo};
use polyptych_wall::color::{linear_from_srgb, srgb_from_linear};

use super::JpegEncoder;

/// Form of a picture's bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PictureFormat {
    /// Lossless.
    Png,
    /// Small and quick.
    Jpeg,
    /// sRGB RGBA8, rows from the top, as on TCP.
    Rgba,
}

impl PictureFormat {
    /// The format of a file with this ending.
    pub fn from_ending(ending: &str) -> Option<Self> {
        match ending {
            "png" => Some(Self::Png),
            "jpg" => Some(Self::Jpeg),
            "rgba" => Some(Self::Rgba),
            _ => None,
        }
    }

    pub fn content_type(self) -> &'static str {
        match self {
            Self::Png => "image/png",
            Self::Jpeg => "image/jpeg",
            Self::Rgba => "application/octet-stream",
        }
    }
}

/// A picture as a file, with its size in pixels.
#[derive(Clone)]
pub(super) struct EncodedPicture {
    pub bytes: Bytes,
    pub width: u32,
    pub height: u32,
}

/// A picture: sRGB RGBA8, rows from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Picture {
    pub width: u32,
    pub height: u32,
    pub rgba: Vec<u8>,
}

/// The picture of a channel or screen of a capture; `None` where there is no such one.
pub(super) fn named(
    info: &CaptureInfo,
    pieces: &mut [Vec<u8>],
    is_screen: bool,
    name: &str,
) -> Option<Picture> {
    let is_it = |of: &ImageInfo| of.is_screen == is_screen && of.name == name;
    let index = info.pictures.iter().position(is_it)?;
    let rgba = std::mem::take(pieces.get_mut(index)?);
    let ImageInfo { width, height, .. } = info.pictures[index];
    Some(Picture { width, height, rgba }).filter(Picture::is_whole)
}

/// The screens of a capture in the order of the wall file, from left to right, their tops in line;
/// `None` where a picture is not whole. What no screen covers is clear.
pub(super) fn side_by_side(info: &CaptureInfo, pieces: Vec<Vec<u8>>) -> Option<Picture> {
    let all = info.pictures.iter().zip(pieces);
    let screens = all.filter(|(of, _)| of.is_screen).map(|(of, rgba)| Picture {
        width: of.width,
        height: of.height,
        rgba,
    });
    let mut screens: Vec<Picture> = screens.collect();
    if screens.is_empty() || !screens.iter().all(Picture::is_whole) {
        return None;
    }
    if screens.len() == 1 {
        return screens.pop();
    }
    let width: u32 = screens.iter().map(|screen| screen.width).sum();
    let height = screens.iter().map(|screen| screen.height).max()?;
    let mut all = Picture { width, height, rgba: vec![0; 4 * width as usize * height as usize] };
    let mut left = 0;
    for screen in &screens {
        let row_bytes = 4 * screen.width as usize;
        for (row, pixels) in screen.rgba.chunks_exact(row_bytes).enumerate() {
            let at = 4 * (row * width as usize + left);
            all.rgba[at..at + row_bytes].copy_from_slice(pixels);
        }
        left += screen.width as usize;
    }
    Some(all)
}

impl Picture {
    /// Returns whether it has all of its pixels.
    pub fn is_whole(&self) -> bool {
        let bytes = 4 * u64::from(self.width) * u64::from(self.height);
        bytes > 0 && self.rgba.len() as u64 == bytes
    }

    /// The picture with this many pixels across, or as it is where it has no more. Each pixel has
    /// the mean light of those that it stands for.
    pub fn scaled(self, width: u32) -> Self {
        if width == 0 || width >= self.width {
            return self;
        }
        let height = u64::from(self.height) * u64::from(width);
        let height = ((height + u64::from(self.width) / 2) / u64::from(self.width)).max(1) as u32;
        let light = light_of_codes();
        let columns = ranges(self.width, width);
        let mut rgba = Vec::with_capacity(4 * width as usize * height as usize);
        for rows in ranges(self.height, height) {
            for columns in &columns {
                rgba.extend_from_slice(&self.mean(&light, rows.clone(), columns.clone()));
            }
        }
        Self { width, height, rgba }
    }

    /// The mean of a rectangle: of its light, and of its coverage.
    fn mean(
        &self,
        light: &[f32; 256],
        rows: std::ops::Range<usize>,
        columns: std::ops::Range<usize>,
    ) -> [u8; 4] {
        let count = (rows.len() * columns.len()) as f32;
        let (mut sums, mut alpha) = ([0.0_f32; 3], 0.0_f32);
        for row in rows {
            let at = 4 * row * self.width as usize;
            let pixels = &self.rgba[at + 4 * columns.start..at + 4 * columns.end];
            for pixel in pixels.chunks_exact(4) {
                for (sum, &code) in sums.iter_mut().zip(pixel) {
                    *sum += light[usize::from(code)];
                }
                alpha += f32::from(pixel[3]);
            }
        }
        let [red, green, blue] = sums.map(|sum| code_of_light(sum / count));
        [red, green, blue, (alpha / count).round() as u8]
    }

    /// The picture as a file.
    ///
    /// # Errors
    /// The encoder's reason.
    pub fn encode(
        self,
        format: PictureFormat,
        jpeg: JpegEncoder,
    ) -> Result<EncodedPicture, String> {
        let (width, height) = (self.width, self.height);
        let bytes = match format {
            PictureFormat::Rgba => self.rgba,
            PictureFormat::Png => self.png().map_err(|error| error.to_string())?,
            PictureFormat::Jpeg => {
                let pixels = self.rgba.chunks_exact(4);
                let rgb: Vec<u8> =
                    pixels.flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
                jpeg(&rgb, width, height)?
            }
        };
        Ok(EncodedPicture { bytes: bytes.into(), width, height })
    }

    fn png(&self) -> Result<Vec<u8>, png::EncodingError> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width, self.height);
        encoder.set_color(png::ColorType::Rgba);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::Fast);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&self.rgba)?;
        writer.finish()?;
        Ok(bytes)
    }
}

/// Divides `from` pixels among `to`, at least one for each.
fn ranges(from: u32, to: u32) -> Vec<std::ops::Range<usize>> {
    let edge = |n: u32| (u64::from(n) * u64::from(from) / u64::from(to)) as usize;
    (0..to).map(|n| edge(n)..edge(n + 1).max(edge(n) + 1)).collect()
}

/// The light of each code of sRGB, 0 to 1.
fn light_of_codes() -> [f32; 256] {
    std::array::from_fn(|code| linear_from_srgb(code as f64 / 255.0) as f32)
}

fn code_of_light(light: f32) -> u8 {
    (srgb_from_linear(f64::from(light)) * 255.0).round().clamp(0.0, 255.0) as u8
}

#[cfg(test)]
mod tests {
    use polyptych_protocol::ids::FrameId;

    use super::*;

    fn info(name: &str, is_screen: bool, width: u32, height: u32) -> ImageInfo {
        ImageInfo { name: name.into(), is_screen, width, height }
    }

    #[test]
    fn every_code_survives_light_and_boxes_of_one_code_keep_it() {
        let light = light_of_codes();
        for code in 0..=255_u8 {
            assert_eq!(code_of_light(light[usize::from(code)]), code);
            let picture = Picture { width: 7, height: 5, rgba: vec![code; 4 * 35] };
            let small = picture.scaled(3);
            assert_eq!((small.width, small.height), (3, 2));
            assert!(small.rgba.iter().all(|&byte| byte == code), "{code}");
        }
    }

    #[test]
    fn black_and_white_lines_have_half_of_the_light() {
        let rgba = [[0, 0, 0, 255], [255; 4]].repeat(8).concat();
        let small = Picture { width: 16, height: 1, rgba }.scaled(8);
        assert_eq!((small.width, small.height), (8, 1));
        // Half of the light is code 188, and not 128.
        assert_eq!(small.rgba[..4], [188, 188, 188, 255]);
    }

    #[test]
    fn screens_stand_side_by_side_and_channels_are_left_out() {
        let pictures = vec![info("a", true, 1, 2), info("b", true, 2, 1), info("a", false, 1, 1)];
        let info = CaptureInfo { frame: FrameId(1), pictures, missing: Vec::new() };
        let pieces = vec![vec![1; 8], vec![2; 8], vec![3; 4]];
        let wall = side_by_side(&info, pieces.clone()).expect("whole");
        assert_eq!((wall.width, wall.height), (3, 2));
        assert_eq!(wall.rgba, [[1; 4], [2; 4], [2; 4], [1; 4], [0; 4], [0; 4]].concat());
        let channel = named(&info, &mut pieces.clone(), false, "a").expect("there");
        assert_eq!(channel.rgba, [3; 4]);
        assert_eq!(named(&info, &mut pieces.clone(), false, "b"), None);
        assert_eq!(side_by_side(&info, vec![vec![1; 8], vec![2; 4]]), None, "not whole");
    }
}
