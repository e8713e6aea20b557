//! Mip levels: each pixel is the mean of the light that falls on it.
//!
//! Colours are averaged in linear light, weighted by alpha where alpha means coverage; normals
//! are made unit vectors again on every level. A side that is odd is filtered with three taps
//! whose weights move along it, so that every pixel counts alike (Guthe and Heckbert,
//! "Non-Power-of-Two Mipmapping", NVIDIA 2005).
//!
//! Means of a mask's alpha tend to one value, which its cutoff draws everywhere or nowhere. So the
//! alpha of each level is scaled until the mask draws the share of it that it draws of the picture
//! (Castano, "Computing Alpha Mipmaps", 2010).

use std::ops::Range;
use std::sync::atomic::AtomicBool;

use rayon::prelude::*;

use super::check;
use super::error::BakeError;
use super::material::TextureKind;

/// Eight bits a channel, rows from the top.
#[derive(Debug)]
pub(super) struct Rgba8Image {
    pub width: u32,
    pub height: u32,
    pub rgba: Vec<u8>,
}

/// Weight of a pixel of alpha 0: too small to be seen beside any other, but not nothing, so that
/// a transparent region keeps its colour.
const CLEAR_WEIGHT: f32 = 1e-4;

/// One level in linear light; alpha is not multiplied in.
struct Level {
    width: usize,
    height: usize,
    texels: Vec<[f32; 4]>,
}

/// The bytes of `count` levels, the picture itself first.
pub(super) fn chain(
    picture: Rgba8Image,
    content: TextureKind,
    count: u32,
    cancel: &AtomicBool,
) -> Result<Vec<u8>, BakeError> {
    let Rgba8Image { width, height, rgba: mut bytes } = picture;
    if count < 2 {
        return Ok(bytes);
    }
    check(cancel)?;
    let (width, height) = (width as usize, height as usize);
    let share = share_drawn(&bytes, content);
    let mut level = halve_bytes(&bytes, width, height, content);
    level.write(content, share, &mut bytes);
    for _ in 2..count {
        check(cancel)?;
        level = halve_level(&level, content);
        level.write(content, share, &mut bytes);
    }
    Ok(bytes)
}

/// The picture, halved until no side is longer than `side_max`.
pub(super) fn fit(
    mut picture: Rgba8Image,
    content: TextureKind,
    side_max: u32,
    cancel: &AtomicBool,
) -> Result<Rgba8Image, BakeError> {
    let share = share_drawn(&picture.rgba, content);
    while picture.width.max(picture.height) > side_max {
        check(cancel)?;
        let (width, height) = (picture.width as usize, picture.height as usize);
        let level = halve_bytes(&picture.rgba, width, height, content);
        picture.rgba = Vec::new();
        level.write(content, share, &mut picture.rgba);
        (picture.width, picture.height) = (level.width as u32, level.height as u32);
    }
    Ok(picture)
}

/// The share of texels that a mask draws; 1 without a mask.
fn share_drawn(bytes: &[u8], content: TextureKind) -> f64 {
    let TextureKind::ColorMask(cutoff) = content else { return 1.0 };
    let texels = bytes.as_chunks::<4>().0;
    let drawn = texels.iter().filter(|[.., alpha]| *alpha >= cutoff).count();
    drawn as f64 / texels.len().max(1) as f64
}

fn halve_bytes(bytes: &[u8], width: usize, height: usize, content: TextureKind) -> Level {
    let linear = linear_of_srgb();
    let texel = |x: usize, y: usize| {
        let at = (y * width + x) * 4;
        let [r, g, b, a] = [bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]];
        let unit = |byte: u8| f32::from(byte) / 255.0;
        match content {
            TextureKind::Color
            | TextureKind::ColorAlpha
            | TextureKind::ColorMask(_)
            | TextureKind::Tint => {
                [linear[r as usize], linear[g as usize], linear[b as usize], unit(a)]
            }
            TextureKind::Data | TextureKind::Glossiness(_) => [unit(r), unit(g), unit(b), unit(a)],
            TextureKind::Normal => {
                [unit(r) * 2.0 - 1.0, unit(g) * 2.0 - 1.0, unit(b) * 2.0 - 1.0, unit(a)]
            }
        }
    };
    halve(width, height, content, texel)
}

fn halve_level(level: &Level, content: TextureKind) -> Level {
    halve(level.width, level.height, content, |x, y| level.texels[y * level.width + x])
}

fn halve(
    width: usize,
    height: usize,
    content: TextureKind,
    texel: impl Fn(usize, usize) -> [f32; 4] + Sync,
) -> Level {
    let (out_width, out_height) = ((width / 2).max(1), (height / 2).max(1));
    let mut texels = vec![[0.0; 4]; out_width * out_height];
    texels.par_chunks_mut(out_width).enumerate().for_each(|(y, row)| {
        let (ys, y_weights) = taps(y, height);
        for (x, out) in row.iter_mut().enumerate() {
            let (xs, x_weights) = taps(x, width);
            let mut sum = [0.0f32; 4];
            let mut color_weight = 0.0;
            for (y, wy) in ys.clone().zip(y_weights) {
                for (x, wx) in xs.clone().zip(x_weights) {
                    let [r, g, b, a] = texel(x, y);
                    let weight = wx * wy;
                    let color = match content {
                        TextureKind::ColorAlpha | TextureKind::ColorMask(_) => {
                            weight * a.max(CLEAR_WEIGHT)
                        }
                        _ => weight,
                    };
                    color_weight += color;
                    let parts = [r * color, g * color, b * color, a * weight];
                    (0..4).for_each(|i| sum[i] += parts[i]);
                }
            }
            *out = [sum[0] / color_weight, sum[1] / color_weight, sum[2] / color_weight, sum[3]];
        }
    });
    Level { width: out_width, height: out_height, texels }
}

/// Returns the pixels of a side of `size` that make pixel `i` of its half, and their weights, which
/// sum to 1.
fn taps(i: usize, size: usize) -> (Range<usize>, [f32; 3]) {
    let half = size / 2;
    if size == 1 {
        return (0..1, [1.0, 0.0, 0.0]);
    }
    if size.is_multiple_of(2) {
        return (2 * i..2 * i + 2, [0.5, 0.5, 0.0]);
    }
    let size = size as f32;
    (2 * i..2 * i + 3, [(half - i) as f32 / size, half as f32 / size, (i + 1) as f32 / size])
}

impl Level {
    /// Appends the level in eight bits, of which a mask draws about this share.
    fn write(&self, content: TextureKind, share: f64, bytes: &mut Vec<u8>) {
        let scale = match content {
            TextureKind::ColorMask(cutoff) => self.alpha_scale(cutoff, share),
            _ => 1.0,
        };
        let start = bytes.len();
        bytes.resize(start + self.texels.len() * 4, 0);
        let row_bytes = self.width * 4;
        let rows = bytes[start..].par_chunks_mut(row_bytes).zip(self.texels.par_chunks(self.width));
        rows.for_each(|(out, texels)| {
            for (out, texel) in out.chunks_exact_mut(4).zip(texels) {
                let [r, g, b, a] = *texel;
                out.copy_from_slice(&bytes_of([r, g, b, a * scale], content));
            }
        });
    }

    /// The factor of alpha that lets a mask draw as nearly this share of the level as can be: 1 if
    /// no other does better, since texels of one alpha are drawn or left out together.
    fn alpha_scale(&self, cutoff: u8, share: f64) -> f32 {
        // The least alpha that becomes the cutoff in eight bits.
        let least = (f32::from(cutoff) - 0.5) / 255.0;
        let mut alphas: Vec<f32> = self.texels.iter().map(|texel| texel[3]).collect();
        alphas.par_sort_unstable_by(|one, two| two.total_cmp(one));
        let wanted = (share * alphas.len() as f64).round() as usize;
        let edge = alphas[wanted.max(1) - 1];
        let own = alphas.partition_point(|alpha| *alpha >= least);
        let without = alphas.partition_point(|alpha| *alpha > edge);
        let with = alphas.partition_point(|alpha| *alpha >= edge && *alpha > 0.0);
        let is_less = without.abs_diff(wanted) <= with.abs_diff(wanted);
        let drawn = if is_less { without } else { with };
        if own.abs_diff(wanted) <= drawn.abs_diff(wanted) {
            return 1.0;
        }
        // Halfway between the last that is drawn and the first that is not.
        let below = alphas.get(drawn).copied().unwrap_or(0.0);
        let above = if drawn == 0 { 2.0 * below } else { alphas[drawn - 1] };
        2.0 * least / (below + above)
    }
}

fn bytes_of([r, g, b, a]: [f32; 4], content: TextureKind) -> [u8; 4] {
    let byte = |value: f32| (value * 255.0 + 0.5) as u8;
    match content {
        TextureKind::Color
        | TextureKind::ColorAlpha
        | TextureKind::ColorMask(_)
        | TextureKind::Tint => {
            [byte(srgb_of_linear(r)), byte(srgb_of_linear(g)), byte(srgb_of_linear(b)), byte(a)]
        }
        TextureKind::Data | TextureKind::Glossiness(_) => [byte(r), byte(g), byte(b), byte(a)],
        TextureKind::Normal => {
            let length = (r * r + g * g + b * b).sqrt();
            let flat = [0.0, 0.0, 1.0];
            let normal = if length > 1e-6 { [r, g, b].map(|c| c / length) } else { flat };
            let [x, y, z] = normal.map(|c| byte(c * 0.5 + 0.5));
            [x, y, z, byte(a)]
        }
    }
}

/// IEC 61966-2-1.
fn srgb_of_linear(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// IEC 61966-2-1, for every byte.
pub(super) fn linear_of_srgb() -> [f32; 256] {
    std::array::from_fn(|byte| {
        let srgb = byte as f32 / 255.0;
        if srgb <= 0.040_45 { srgb / 12.92 } else { ((srgb + 0.055) / 1.055).powf(2.4) }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chain_of(width: u32, height: u32, rgba: Vec<u8>, content: TextureKind) -> Vec<u8> {
        let count = width.max(height).ilog2() + 1;
        let picture = Rgba8Image { width, height, rgba };
        chain(picture, content, count, &AtomicBool::new(false)).expect("a chain")
    }

    #[test]
    fn a_checker_is_half_the_light() {
        let texel = |i: u32| if (i + i / 4).is_multiple_of(2) { [255; 4] } else { [0, 0, 0, 255] };
        let checker: Vec<u8> = (0..16).flat_map(texel).collect();
        let bytes = chain_of(4, 4, checker.clone(), TextureKind::Color);
        assert_eq!(bytes.len(), (16 + 4 + 1) * 4);
        assert!(bytes[64..].chunks(4).all(|texel| texel == [188, 188, 188, 255]));
        let bytes = chain_of(4, 4, checker, TextureKind::Data);
        assert_eq!(bytes[64..68], [128, 128, 128, 255]);
    }

    #[test]
    fn clear_pixels_lend_no_colour() {
        let bytes = chain_of(2, 1, vec![255, 0, 0, 255, 0, 255, 0, 0], TextureKind::ColorAlpha);
        assert_eq!(bytes[8], 255);
        assert!(bytes[9] < 2 && bytes[11] == 128);
    }

    #[test]
    fn odd_sides_weigh_every_pixel_alike() {
        for size in [1usize, 2, 3, 5, 7, 101] {
            let mut weight_of = vec![0.0; size];
            for i in 0..(size / 2).max(1) {
                let (pixels, weights) = taps(i, size);
                assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-6);
                pixels.zip(weights).for_each(|(pixel, weight)| weight_of[pixel] += weight);
            }
            let mean = weight_of.iter().sum::<f32>() / size as f32;
            assert!(weight_of.iter().all(|w| (w - mean).abs() < 1e-5), "{size}: {weight_of:?}");
        }
    }

    #[test]
    fn normals_stay_unit_vectors() {
        let bytes =
            chain_of(2, 1, vec![255, 128, 128, 255, 128, 128, 255, 255], TextureKind::Normal);
        let [x, z] = [bytes[8], bytes[10]].map(|byte| f32::from(byte) / 127.5 - 1.0);
        assert!((x * x + z * z - 1.0).abs() < 0.02, "{x} {z}");
    }
}
