//! A texture while it is painted: colour, relief, roughness, occlusion; written as PNG.

use glam::{Vec3, vec3};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

use super::TownError;
use super::heightfield::smooth;
use super::random::lattice;

/// The properties of a painted point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Texel {
    /// sRGB, each in [0, 1].
    pub color: Vec3,
    /// 0 is see-through, 1 opaque.
    pub alpha: f32,
    /// Height above the surface, in widths of a texel.
    pub height: f32,
    /// Perceptual roughness.
    pub roughness: f32,
    /// 1 where all ambient light arrives.
    pub occlusion: f32,
}

impl Texel {
    /// Opaque, rough and flat.
    pub fn flat(color: Vec3) -> Self {
        Self { color, alpha: 1.0, height: 0.0, roughness: 0.9, occlusion: 1.0 }
    }
}

/// A square picture that tiles in both directions.
#[derive(Debug)]
pub(super) struct Canvas {
    side: u32,
    texels: Vec<Texel>,
}

impl Canvas {
    /// Paints every texel at its centre, (0, 0) being the upper left corner and (1, 1) the lower
    /// right one.
    pub fn paint(side: u32, texel: impl Fn(f32, f32) -> Texel) -> Self {
        let at = |n: u32| (n as f32 + 0.5) / side as f32;
        let texels = (0..side * side).map(|n| texel(at(n % side), at(n / side))).collect();
        Self { side, texels }
    }

    /// The texel at a place, wrapped around the edges.
    fn at(&self, x: i32, y: i32) -> &Texel {
        let side = self.side as i32;
        &self.texels[(y.rem_euclid(side) * side + x.rem_euclid(side)) as usize]
    }

    /// Base colour in sRGB, without alpha.
    pub fn base_color(&self) -> Result<Vec<u8>, TownError> {
        let bytes: Vec<u8> = self.texels.iter().flat_map(|t| bytes_of(t.color)).collect();
        self.png(&bytes, ExtendedColorType::Rgb8)
    }

    /// Base colour in sRGB, with alpha.
    pub fn base_color_alpha(&self) -> Result<Vec<u8>, TownError> {
        let rgba = |t: &Texel| {
            let [r, g, b] = bytes_of(t.color);
            [r, g, b, byte_of(t.alpha)]
        };
        let bytes: Vec<u8> = self.texels.iter().flat_map(rgba).collect();
        self.png(&bytes, ExtendedColorType::Rgba8)
    }

    /// The normal map: +Y is up in the picture, as glTF has it.
    pub fn normals(&self) -> Result<Vec<u8>, TownError> {
        let side = self.side as i32;
        let normal = |n: i32| {
            let (x, y) = (n % side, n / side);
            let right = (self.at(x + 1, y).height - self.at(x - 1, y).height) * 0.5;
            let down = (self.at(x, y + 1).height - self.at(x, y - 1).height) * 0.5;
            let normal = vec3(-right, down, 1.0).normalize_or(Vec3::Z);
            bytes_of(normal * 0.5 + 0.5)
        };
        let bytes: Vec<u8> = (0..side * side).flat_map(normal).collect();
        self.png(&bytes, ExtendedColorType::Rgb8)
    }

    /// Occlusion in red, roughness in green, metal (none) in blue.
    pub fn occlusion_roughness_metal(&self) -> Result<Vec<u8>, TownError> {
        let bytes: Vec<u8> = self
            .texels
            .iter()
            .flat_map(|t| bytes_of(vec3(t.occlusion, t.roughness, 0.0)))
            .collect();
        self.png(&bytes, ExtendedColorType::Rgb8)
    }

    fn png(&self, bytes: &[u8], color: ExtendedColorType) -> Result<Vec<u8>, TownError> {
        let mut out = Vec::new();
        PngEncoder::new_with_quality(&mut out, CompressionType::Default, FilterType::Adaptive)
            .write_image(bytes, self.side, self.side, color)
            .map_err(TownError::Texture)?;
        Ok(out)
    }
}

fn byte_of(value: f32) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}

fn bytes_of(color: Vec3) -> [u8; 3] {
    [byte_of(color.x), byte_of(color.y), byte_of(color.z)]
}

/// Value noise in [0, 1] with `cells` × `cells` waves to the picture; it tiles.
pub(super) fn noise(u: f32, v: f32, cells: i32, layer: u64) -> f32 {
    let (x, y) = (u * cells as f32, v * cells as f32);
    let (column, row) = (x.floor(), y.floor());
    let (s, t) = (smooth(x - column), smooth(y - row));
    let (column, row) = (column as i32, row as i32);
    let at = |dx: i32, dy: i32| {
        lattice(layer, (column + dx).rem_euclid(cells), (row + dy).rem_euclid(cells))
    };
    let above = at(0, 0) + (at(1, 0) - at(0, 0)) * s;
    let below = at(0, 1) + (at(1, 1) - at(0, 1)) * s;
    above + (below - above) * t
}

/// Four octaves of `noise`, in [0, 1].
pub(super) fn cloud(u: f32, v: f32, cells: i32, layer: u64) -> f32 {
    let octave = |n: i32| noise(u, v, cells << n, layer + n as u64) / (1 << n) as f32;
    (octave(0) + octave(1) + octave(2) + octave(3)) / 1.875
}

/// The nearest of the jittered points of a lattice: its cell, the distance to it and the distance
/// to the border with the next, both in cells (Worley, "A Cellular Texture Basis Function", 1996).
pub(super) fn pebble(u: f32, v: f32, cells: i32, layer: u64) -> ([i32; 2], f32, f32) {
    let (x, y) = (u * cells as f32, v * cells as f32);
    let (column, row) = (x.floor() as i32, y.floor() as i32);
    let (mut least, mut second, mut owner) = (f32::MAX, f32::MAX, [0, 0]);
    for dy in -1..=1 {
        for dx in -1..=1 {
            let cell = [(column + dx).rem_euclid(cells), (row + dy).rem_euclid(cells)];
            let jitter = |layer: u64| 0.2 + 0.6 * lattice(layer, cell[0], cell[1]);
            let px = (column + dx) as f32 + jitter(layer) - x;
            let py = (row + dy) as f32 + jitter(layer + 1) - y;
            let distance = (px * px + py * py).sqrt();
            if distance < least {
                (second, least, owner) = (least, distance, cell);
            } else {
                second = second.min(distance);
            }
        }
    }
    (owner, least, (second - least) * 0.5)
}
