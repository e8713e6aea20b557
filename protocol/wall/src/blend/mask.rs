//! Masks of a channel's light, from files.

use glam::UVec2;

/// The values of a mask for each pixel, in linear light: 65,535 is all of it.
#[derive(Clone, Copy, Debug)]
pub struct MaskTexels<'a> {
    size: UVec2,
    components: usize,
    texels: &'a [u16],
}

/// The masks of one channel.
#[derive(Clone, Copy, Debug, Default)]
pub struct ChannelMasks<'a> {
    /// Multiplies its light.
    pub alpha: Option<MaskTexels<'a>>,
    /// Is its least light: light becomes light · (1 − β) + β.
    pub beta: Option<MaskTexels<'a>>,
    /// Multiplies its light, too: what a warp mesh says at its corners.
    pub light: Option<MaskTexels<'a>>,
}

impl<'a> MaskTexels<'a> {
    /// A mask of this size, rows from the top, with 1 or 3 components for each pixel; `None` where
    /// there are not as many texels.
    pub fn new(size: UVec2, components: usize, texels: &'a [u16]) -> Option<Self> {
        let pixels = (size.x as usize).checked_mul(size.y as usize)?;
        let is_sound = pixels > 0 && matches!(components, 1 | 3);
        (is_sound && pixels.checked_mul(components) == Some(texels.len())).then_some(Self {
            size,
            components,
            texels,
        })
    }

    fn texel(&self, x: u32, y: u32, colour: usize) -> f64 {
        let at = (y as usize * self.size.x as usize + x as usize) * self.components;
        f64::from(self.texels[at + colour.min(self.components - 1)]) / 65535.0
    }

    /// Red (0), green (1) or blue at a pixel of a picture of this size; between the mask's pixels
    /// where it has others.
    fn at(&self, x: u32, y: u32, picture: UVec2, colour: usize) -> f64 {
        if self.size == picture {
            return self.texel(x, y, colour);
        }
        let along = |at: u32, side: u32, own: u32| {
            let place = (f64::from(at) + 0.5) / f64::from(side) * f64::from(own) - 0.5;
            let place = place.clamp(0.0, f64::from(own - 1));
            let low = (place as u32).min(own.saturating_sub(2));
            (low, (low + 1).min(own - 1), place - f64::from(low))
        };
        let (left, right, across) = along(x, picture.x, self.size.x);
        let (top, bottom, down) = along(y, picture.y, self.size.y);
        let row = |y: u32| {
            let (a, b) = (self.texel(left, y, colour), self.texel(right, y, colour));
            a + (b - a) * across
        };
        let (above, below) = (row(top), row(bottom));
        above + (below - above) * down
    }

    fn most(&self) -> f64 {
        f64::from(self.texels.iter().copied().max().unwrap_or(0)) / 65535.0
    }
}

impl ChannelMasks<'_> {
    pub(super) fn is_empty(&self) -> bool {
        self.alpha.is_none() && self.beta.is_none() && self.light.is_none()
    }

    /// No pixel gets more light than this.
    pub(super) fn offset_max(&self) -> f64 {
        self.beta.map_or(0.0, |beta| beta.most())
    }

    /// Returns whether red, green and blue have masks of their own.
    pub(super) fn is_coloured(&self) -> bool {
        [self.alpha, self.beta, self.light].iter().flatten().any(|mask| mask.components == 3)
    }

    /// Factor and addend of red (0), green (1) or blue at a pixel of a picture of this size:
    /// P·α·(1 − β) + β, *MPCDI 2.0*, §2.4.
    pub fn at(&self, x: u32, y: u32, picture: UVec2, colour: usize) -> (f64, f64) {
        let part = |mask: Option<MaskTexels<'_>>| mask.map(|m| m.at(x, y, picture, colour));
        let alpha = part(self.alpha).unwrap_or(1.0) * part(self.light).unwrap_or(1.0);
        let beta = part(self.beta).unwrap_or(0.0);
        (alpha * (1.0 - beta), beta)
    }
}
