//! Textures: a mip chain and how it is sampled.

use polyptych_files::blob::BlobHash;
use serde::{Deserialize, Serialize};

use crate::limits::TEXTURE_SIDE_MAX;

/// An image with its mip levels.
///
/// Its blob holds the levels from the largest on, rows from the top, 4 bytes a pixel, no padding.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Texture {
    /// The bytes.
    pub blob: BlobHash,
    /// The meaning of a pixel's bytes.
    pub format: TextureFormat,
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Levels in the blob; each is half of the one before, rounded down, at least 1 pixel.
    pub mip_count: u32,
    /// The source's sampler.
    pub sampler: Sampler,
}

/// The meaning of a pixel's bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum TextureFormat {
    /// RGB as sRGB, alpha linear.
    Rgba8Srgb,
    /// All linear: normals, roughness, occlusion.
    Rgba8Linear,
}

/// The sampling of a texture, as in glTF's samplers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Sampler {
    /// Seen larger than it is.
    pub mag: Filter,
    /// Seen smaller than it is.
    pub min: Filter,
    /// Between mip levels.
    pub mip: MipFilter,
    /// Beyond 0 and 1 along u.
    pub wrap_u: Wrap,
    /// Beyond 0 and 1 along v.
    pub wrap_v: Wrap,
}

/// Within one level.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Filter {
    /// The nearest pixel.
    Nearest,
    /// Between four pixels.
    Linear,
}

/// Between levels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum MipFilter {
    /// The largest level only.
    None,
    /// The nearest level.
    Nearest,
    /// Between two levels.
    Linear,
}

/// Beyond the edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Wrap {
    /// The edge goes on.
    Clamp,
    /// Every second copy is mirrored.
    Mirror,
    /// Copies side by side.
    Repeat,
}

impl Default for Sampler {
    /// The sampler for glTF textures without one, which glTF leaves to the renderer: trilinear,
    /// repeated.
    fn default() -> Self {
        Self {
            mag: Filter::Linear,
            min: Filter::Linear,
            mip: MipFilter::Linear,
            wrap_u: Wrap::Repeat,
            wrap_v: Wrap::Repeat,
        }
    }
}

impl Texture {
    /// Width and height of a level in pixels.
    pub fn level_size(&self, level: u32) -> [u32; 2] {
        let side = |pixels: u32| pixels.checked_shr(level).unwrap_or(0).max(1);
        [side(self.width), side(self.height)]
    }

    /// Bytes of the whole blob.
    pub fn bytes(&self) -> u64 {
        let level_bytes = |level| {
            let [width, height] = self.level_size(level);
            u64::from(width) * u64::from(height) * 4
        };
        (0..self.mip_count).map(level_bytes).sum()
    }

    /// Returns the fault of its sizes, if any.
    pub fn fault(&self) -> Option<String> {
        let (width, height, levels) = (self.width, self.height, self.mip_count);
        let sides = 1..=TEXTURE_SIDE_MAX;
        if !sides.contains(&width) || !sides.contains(&height) {
            return Some(format!(
                "{width} × {height} pixels, where 1 to {TEXTURE_SIDE_MAX} can be"
            ));
        }
        let levels_max = width.max(height).ilog2() + 1;
        (!(1..=levels_max).contains(&levels))
            .then(|| format!("{levels} mip levels, where 1 to {levels_max} can be"))
    }
}
