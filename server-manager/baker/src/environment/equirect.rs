//! Equirectangular pictures of radiance: columns go around the y axis, rows from up to down.
//!
//! The direction (x, y, z) is at u = ½ + atan2(z, x) / 2π and v = acos(y) / π, as in Khronos'
//! viewer and three.js: the picture's middle is +X, and −Z is a quarter of the width left of it.

use std::f64::consts::{PI, TAU};
use std::io::Cursor;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use glam::{DVec3, Vec3};
use image::{ImageDecoder, codecs::hdr::HdrDecoder};

use crate::error::BakeError;
use crate::source_file;

/// Largest file: one of 16,384 × 8,192 pixels without any compression.
const FILE_BYTES_MAX: u64 = 540 << 20;

/// Maximum number of pixels, 8,192 × 4,096: 4 of them for each texel of the largest map, and
/// 400 MB while it is read.
const PIXELS_MAX: u64 = 32 << 20;

/// Minimum number of pixels along each side.
const SIDE_MIN: u32 = 2;

/// A picture of the whole sphere.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Equirect {
    pub width: u32,
    pub height: u32,
    /// Linear RGB radiance, by rows from the top; finite, and 0 or more.
    pub pixels: Vec<Vec3>,
}

impl Equirect {
    /// Reads a Radiance .hdr file.
    ///
    /// # Errors
    /// It cannot be read, is another kind of file, breaks off, is too large, or has a number that
    /// is no radiance.
    pub fn read(path: &Path, cancel: &AtomicBool) -> Result<Self, BakeError> {
        let bytes = source_file::read(path, FILE_BYTES_MAX, "file", cancel)?;
        Self::decode(&bytes)
    }

    pub fn decode(bytes: &[u8]) -> Result<Self, BakeError> {
        if !bytes.starts_with(b"#?") {
            let what = "it is not a Radiance .hdr file, whose first line is #?RADIANCE or #?RGBE";
            let right = "save the surroundings as an equirectangular Radiance .hdr (RGBE)";
            return Err(BakeError::at("file", what, right));
        }
        let broken = |error: image::ImageError| {
            let what = format!("it cannot be read as Radiance .hdr: {error}");
            BakeError::at("file", what, "save or download it again")
        };
        // The strict reader knows no other name than #?RADIANCE.
        let decoder = HdrDecoder::new_nonstrict(Cursor::new(bytes)).map_err(broken)?;
        let (width, height) = decoder.dimensions();
        check_size(width, height)?;
        let mut rgb = vec![0; width as usize * height as usize * 12];
        decoder.read_image(&mut rgb).map_err(broken)?;
        let number = |bytes: &[u8]| {
            let four = bytes.first_chunk::<4>().copied().unwrap_or_default();
            f32::from_ne_bytes(four)
        };
        let pixel = |of: &[u8]| Vec3::new(number(&of[..4]), number(&of[4..8]), number(&of[8..12]));
        let pixels = rgb.chunks_exact(12).map(pixel).collect();
        Self::checked(width, height, pixels)
    }

    /// A picture whose numbers are radiance.
    ///
    /// # Errors
    /// The first pixel that has a number below 0, NaN or an infinity.
    pub fn checked(width: u32, height: u32, pixels: Vec<Vec3>) -> Result<Self, BakeError> {
        let is_radiance = |of: &Vec3| of.is_finite() && of.min_element() >= 0.0;
        if let Some(at) = pixels.iter().position(|pixel| !is_radiance(pixel)) {
            let (x, y) = (at % width as usize, at / width as usize);
            let Vec3 { x: r, y: g, z: b } = pixels[at];
            let what = format!("its radiance is {r}, {g}, {b}");
            let right = "only finite numbers of 0 and more would be right; clamp it in an editor";
            return Err(BakeError::at(format!("pixel {x}, {y}"), what, right));
        }
        Ok(Self { width, height, pixels })
    }

    /// The picture of radiance that is finite and 0 or more, this wide and half as high.
    pub fn of(width: u32, radiance: impl Fn(DVec3) -> Vec3) -> Self {
        let height = width / 2;
        let pixel = |index: u32| {
            let u = (f64::from(index % width) + 0.5) / f64::from(width);
            radiance(Self::direction(u, (f64::from(index / width) + 0.5) / f64::from(height)))
        };
        Self { width, height, pixels: (0..width * height).map(pixel).collect() }
    }

    /// The direction of a place, from 0 to 1 along both sides.
    pub fn direction(u: f64, v: f64) -> DVec3 {
        let (around, down) = ((u - 0.5) * TAU, v * PI);
        let level = down.sin();
        DVec3::new(level * around.cos(), down.cos(), level * around.sin())
    }

    /// Radiance from a direction of length 1: bilinear between the middles of pixels.
    pub fn radiance(&self, from: DVec3) -> Vec3 {
        let u = 0.5 + from.z.atan2(from.x) / TAU;
        let v = from.y.clamp(-1.0, 1.0).acos() / PI;
        let (x, y) = (u * f64::from(self.width) - 0.5, v * f64::from(self.height) - 0.5);
        let (left, top) = (x.floor(), y.floor());
        let (part_x, part_y) = ((x - left) as f32, (y - top) as f32);
        let row =
            |down: f64| self.at(left, top + down).lerp(self.at(left + 1.0, top + down), part_x);
        row(0.0).lerp(row(1.0), part_y)
    }

    /// A pixel; columns go around, and rows end.
    fn at(&self, x: f64, y: f64) -> Vec3 {
        let column = x.rem_euclid(f64::from(self.width)) as usize;
        let row = y.clamp(0.0, f64::from(self.height - 1)) as usize;
        let column = column.min(self.width as usize - 1);
        self.pixels[row * self.width as usize + column]
    }
}

fn check_size(width: u32, height: u32) -> Result<(), BakeError> {
    let right = "an equirectangular picture of at most 8192 × 4096 would be right; scale it down";
    if width < SIDE_MIN || height < SIDE_MIN {
        let what = format!("it has {width} × {height} pixels, which are no surroundings");
        return Err(BakeError::at("file", what, "save a picture that is twice as wide as high"));
    }
    if u64::from(width) * u64::from(height) > PIXELS_MAX {
        return Err(BakeError::at("file", format!("it has {width} × {height} pixels"), right));
    }
    if width != height.saturating_mul(2) {
        let what = format!("it has {width} × {height} pixels, so it is not equirectangular");
        let right = "a picture of the whole sphere is twice as wide as high; convert it to that";
        return Err(BakeError::at("file", what, right));
    }
    Ok(())
}
