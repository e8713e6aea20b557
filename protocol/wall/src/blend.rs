//! Sharing of the light of places that several channels light, and levelling of their black; pure
//! f64, from the geometry alone.
//!
//! ```text
//! ramp   r_i = (Π over edges: s(distance to the edge / width of its ramp))^exponent
//! weight w_i = r_i / Σ r_j, over all channels j that light the place: the sum is 1 everywhere
//! black  l_i = C_i⁻¹·b_i, B = the largest Σ l_j of any place of the wall
//! light  w_i · C_i·((B − Σ l_j) + (1 − B)·I) / (1 − b_i), in each colour
//! ```
//!
//! I is the light that the wall should show, b_i the leak of a projector (its black as a share of
//! its white) and C_i its gains times its matrix, which make the light of the wall of its own: it
//! shows C_i⁻¹·(b_i + (1 − b_i)·light), so that all of them together show
//! Σ l_j + (B − Σ l_j) + (1 − B)·I = B + (1 − B)·I, whichever light the place. (1 − B) and
//! 1 / (1 − b_i) are in the colours ([`BlendModel::color`]), the rest is in the light map.
//!
//! If an edge of a picture runs through a pixel of another one, l is its mean over the pixel's
//! area: no pixel can end its black at the edge, but all of it has the right sum.
//!
//! A weight depends on the place and not on the pixel that shows it, so that channels whose pixels
//! lie askew agree. Channels for different eyes share nothing: glasses hide the others'. Channels
//! for both eyes have weights that keep both sums (`stereo.rs`). Channels whose pixels a file
//! places ([`ChannelKind::Map`](super::ChannelKind::Map)) have weight 1 if that file brings its own
//! shares of light: an alpha mask, or light at a mesh's corners.

pub(super) mod blend_channel;
mod mask;
mod overlap;
mod stereo;
mod weights;

use std::collections::BTreeSet;
use std::sync::OnceLock;

use blend_channel::BlendChannel;
use glam::{DMat3, DVec2, DVec3, UVec2};
use stereo::EyeContribution;

use super::wall_geometry::ResolvedWall;
use super::{CalibrationFile, Channel, ColorCorrection, Eye, Screen};
use crate::ChannelId;

pub use mask::{ChannelMasks, MaskTexels};

/// The texel of a [`BlendMap`] that stands for 1.
pub const TEXEL_ONE: u16 = u16::MAX;

/// The factor and the addend of the light of each pixel of a channel's upright picture, in linear
/// light.
#[derive(Clone, Debug, PartialEq)]
pub struct BlendMap {
    /// The size of the upright picture, in pixels.
    pub size: UVec2,
    /// Row by row from the top: factor in parts of [`TEXEL_ONE`], and addend in those of `add`;
    /// once for all colours, or for red, then all for green, then all for blue. A weight is
    /// rounded by 1/131,070 at most, so that the sum of four keeps 1/4096 eight times over.
    pub texels: Vec<[u16; 2]>,
    /// The addend that a texel of [`TEXEL_ONE`] stands for, of red, green and blue.
    pub add: DVec3,
}

/// Returns the light map of a channel; `None` if it changes nothing: its light is its own, nothing
/// leaks and nothing is masked. For several channels, make a [`BlendModel`] first.
pub fn blend_map<'a>(
    of: impl Into<ResolvedWall<'a>>,
    id: ChannelId,
    masks: &ChannelMasks<'_>,
) -> Option<BlendMap> {
    BlendModel::new(of).blend_map(id, masks)
}

/// All that a channel's light map is made from: equal ones make equal maps.
#[derive(Clone, Debug, PartialEq)]
pub struct LightInputs {
    eye: DVec3,
    exponent: f64,
    /// The black of the wall, from [`BlendModel::black`].
    black: DVec3,
    /// The factor of the channel's addends, if there are any.
    mix: DMat3,
    screen: Screen,
    files: Vec<CalibrationFile>,
    /// The channel and those on which its weights depend, without their colours; with what they
    /// leak and the widths of their ramps.
    channels: Vec<(ChannelId, Channel, DVec3, [Option<f64>; 4])>,
}

impl BlendMap {
    /// Factors and addends of red, green and blue at a pixel, as they are after rounding.
    pub fn light_at(&self, x: u32, y: u32) -> [DVec3; 2] {
        let [red, green, blue] = [0, 1, 2].map(|colour| self.texel(x, y, colour));
        [0, 1].map(|part| DVec3::new(red[part], green[part], blue[part]))
    }

    /// Factor and addend of red (0), green (1) or blue at a pixel, as they are after rounding.
    pub fn texel(&self, x: u32, y: u32, colour: usize) -> [f64; 2] {
        let pixels = self.size.x as usize * self.size.y as usize;
        let layer = colour.min(self.texels.len() / pixels.max(1) - 1);
        let at = layer * pixels + y as usize * self.size.x as usize + x as usize;
        let [factor, addend] = self.texels[at];
        let part = |texel: u16| f64::from(texel) / f64::from(TEXEL_ONE);
        [part(factor), part(addend) * self.add[colour]]
    }
}

/// A channel's part in the light of a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlendWeight {
    /// The weight of the picture's light; the sum of all channels is 1. Zero where the channel
    /// lights nothing.
    pub weight: f64,
    /// The sum of the black levels of all channels that light the place, in light of the wall; for
    /// a pixel, the mean over its area. Less than the channel's own where channels of one eye make
    /// up for much that channels of both cannot add.
    pub black: DVec3,
}

/// The blends of a wall: its channels as sources of light, and its black.
#[derive(Clone, Debug)]
pub struct BlendModel<'a> {
    wall: &'a super::Wall,
    /// One for each channel.
    lamps: Vec<BlendChannel<'a>>,
    /// See [`Self::black`]; computed on first use.
    black: OnceLock<DVec3>,
}

impl<'a> BlendModel<'a> {
    /// The blends of a wall; without its shapes, channels that files place share nothing.
    pub fn new(of: impl Into<ResolvedWall<'a>>) -> Self {
        let shaped = of.into();
        let wall = shaped.wall;
        let mut lamps: Vec<_> =
            wall.channels.iter().map(|c| BlendChannel::new(shaped, c)).collect();
        overlap::find_neighbours(&mut lamps);
        Self { wall, lamps, black: OnceLock::new() }
    }

    /// The black of the wall, in its light: as much as leaks where most of it does, 0 to 1. What
    /// no place may be darker than, none is.
    pub fn black(&self) -> DVec3 {
        let find = || self.most_of(|lamp| lamp.leak).clamp(DVec3::ZERO, DVec3::ONE);
        // Where nothing leaks, nobody needs to know who lights a place.
        let leaks = || self.lamps.iter().any(|lamp| lamp.leak != DVec3::ZERO);
        *self.black.get_or_init(|| if leaks() { find() } else { DVec3::ZERO })
    }

    /// Returns the correction of a channel's light before it becomes codes, so that its black is
    /// that of the wall; `None` if there is no such channel.
    pub fn color(&self, id: ChannelId) -> Option<ColorCorrection> {
        let color = self.wall.channel(id)?.adjustment.color.clone();
        let black = self.black();
        if black == DVec3::ZERO {
            return Some(color);
        }
        let matrix = self.mix(id) * DMat3::from_diagonal(DVec3::ONE - black);
        Some(ColorCorrection { matrix, gain: DVec3::ONE, ..color })
    }

    /// From light of the wall to that of a channel's codes, which is what it shows above black.
    fn mix(&self, id: ChannelId) -> DMat3 {
        let Some(channel) = self.wall.channel(id) else { return DMat3::IDENTITY };
        let above_black = DVec3::ONE - self.wall.leak_of(channel);
        DMat3::from_diagonal(above_black.recip()) * channel.adjustment.color.made()
    }

    /// Returns the inputs of a channel's light map; `None` if there is no such channel.
    pub fn light_inputs(&self, id: ChannelId) -> Option<LightInputs> {
        let wall = self.wall;
        let screen = wall.screen_of(wall.channel(id)?).clone();
        let of = |id: ChannelId| {
            let mut channel = wall.channel(id)?.clone();
            channel.adjustment.color = ColorCorrection::default();
            Some((id, channel, self.lamps.get(usize::from(id.0))?.leak, self.ramp_widths(id)))
        };
        let black = self.black();
        Some(LightInputs {
            eye: wall.eye,
            exponent: wall.blend.exponent,
            black,
            mix: if black == DVec3::ZERO { DMat3::IDENTITY } else { self.mix(id) },
            screen,
            files: wall.files.clone(),
            channels: std::iter::once(id).chain(self.family(id)).filter_map(of).collect(),
        })
    }

    /// The light map of a channel, as [`blend_map`] has it.
    pub fn blend_map(&self, id: ChannelId, masks: &ChannelMasks<'_>) -> Option<BlendMap> {
        let (channel, lamp) = (self.wall.channel(id)?, self.lamps.get(usize::from(id.0))?);
        let (black, mix) = (self.black(), self.mix(id));
        let missing = |share: BlendWeight| (black - share.black).max(DVec3::ZERO);
        let size = channel.size;
        // No share of what is missing is larger, whatever the signs of a matrix make of it.
        let bound = DMat3::from_cols(mix.x_axis.abs(), mix.y_axis.abs(), mix.z_axis.abs());
        let add = bound * missing(lamp.alone()) + masks.offset_max();
        if masks.is_empty() && self.neighbours(id).is_empty() && add == DVec3::ZERO {
            return None;
        }
        let parts = |value: f64, whole: f64| {
            if whole > 0.0 { (value / whole * f64::from(TEXEL_ONE)).round() as u16 } else { 0 }
        };
        let texel = |at: UVec2, share: BlendWeight, colour: usize| {
            let (own, least) = masks.at(at.x, at.y, size, colour);
            let raised = mix.row(colour).dot(missing(share)) * share.weight;
            [parts(share.weight * own, 1.0), parts(raised * own + least, add[colour])]
        };
        // They are the same where there is no mask: most of the picture.
        let alone = [0, 1, 2].map(|colour| texel(UVec2::ZERO, lamp.alone(), colour));
        let is_alone = |share: BlendWeight| masks.is_empty() && share == lamp.alone();
        let mut texels;
        if masks.is_coloured() || self.is_coloured(id) {
            let mut colours = vec![[[0; 2]; 3]; size.x as usize * size.y as usize];
            self.for_each_weight(id, &mut colours, |at, share| {
                if is_alone(share) { alone } else { [0, 1, 2].map(|c| texel(at, share, c)) }
            });
            let of = |colour: usize| colours.iter().map(move |texel| texel[colour]);
            texels = (0..3).flat_map(of).collect();
        } else {
            texels = vec![[0; 2]; size.x as usize * size.y as usize];
            self.for_each_weight(id, &mut texels, |at, share| {
                if is_alone(share) { alone[0] } else { texel(at, share, 0) }
            });
        }
        let is_plain = texels.iter().all(|texel| *texel == [TEXEL_ONE, 0]);
        (!is_plain).then_some(BlendMap { size, texels, add })
    }

    /// Returns whether what is added to a channel's light may have a colour.
    fn is_coloured(&self, id: ChannelId) -> bool {
        let family = std::iter::once(id).chain(self.family(id));
        let leaks = family.map(|id| self.lamps[usize::from(id.0)].leak);
        let mut all = leaks.chain([self.black(), self.mix(id) * DVec3::ONE]);
        self.black() != DVec3::ZERO && all.any(|light| light != DVec3::splat(light.x))
    }

    /// The channels that light a place of a screen's canvas for the eye of `id`'s channel, with
    /// their weights: in pixels from the canvas's upper left.
    pub fn weights(&self, id: ChannelId, canvas: DVec2) -> Vec<(ChannelId, f64)> {
        let Some(lamp) = self.lamps.get(usize::from(id.0)) else { return Vec::new() };
        let side = if lamp.eye() == Eye::Right { Eye::Right } else { Eye::Left };
        let screen = lamp.channel.screen;
        let on_screen = self.wall.channel_ids().zip(&self.lamps);
        let on_screen = on_screen.filter(|(_, other)| other.channel.screen == screen);
        let lit: Vec<_> = on_screen
            .filter_map(|(id, lamp)| {
                let step = lamp.ramp(lamp.lit_pixel(canvas)?, self.ramp_widths(id));
                Some((id, EyeContribution::full_pixel(lamp, step)))
            })
            .collect();
        let seen = lit.iter().filter(|(_, light)| [Eye::Center, side].contains(&light.eye));
        let shared = seen.map(|(id, own)| {
            // Who brings shares of light of its own is not one of them.
            let family = self.family(*id);
            let others = lit.iter().filter(|(other, _)| family.contains(other));
            let others: Vec<_> = others
                .map(|(other, light)| EyeContribution { is_before: other < id, ..*light })
                .collect();
            (*id, stereo::blend_weight(*own, &others, self.wall.blend.exponent).weight)
        });
        shared.collect()
    }

    /// Returns the place of a channel's picture, in pixels, that lights a place of its screen's
    /// canvas; it may lie beside the picture. `None` where its light does not come: behind a
    /// projector, and on the far side of a curved screen.
    pub fn pixel(&self, id: ChannelId, canvas: DVec2) -> Option<DVec2> {
        self.lamps.get(usize::from(id.0))?.pixel(canvas)
    }

    /// Returns the widths of the ramps at a channel's edges, in its pixels: left, right, top and
    /// bottom; `None` if it shares no light.
    pub fn ramp_widths(&self, id: ChannelId) -> [Option<f64>; 4] {
        let at = usize::from(id.0);
        self.lamps.get(at).map_or([None; 4], |lamp| {
            *lamp.widths.get_or_init(|| overlap::ramp_widths(lamp, &self.lamps))
        })
    }

    /// The channels on which the weights of this one depend, in their order: its neighbours, and
    /// those of the other eye where some of them are for both.
    fn family(&self, id: ChannelId) -> Vec<ChannelId> {
        let lamp = |id: &ChannelId| &self.lamps[usize::from(id.0)];
        let own = self.neighbours(id);
        let of_both = own.iter().map(lamp).filter(|lamp| lamp.eye() == Eye::Center);
        let further = of_both.flat_map(|lamp| &lamp.neighbours).filter(|other| **other != id);
        let family: BTreeSet<_> = own.iter().chain(further).copied().collect();
        family.into_iter().collect()
    }

    /// Returns whether two channels may light one place, whatever shares its light.
    pub fn may_light_same(&self) -> bool {
        let meets = |(at, lamp): (usize, &BlendChannel<'_>)| {
            self.lamps[..at].iter().any(|other| lamp.may_light_same(other))
        };
        self.lamps.iter().enumerate().any(meets)
    }

    /// The channels with which this one shares the light of some place by weights.
    pub fn neighbours(&self, id: ChannelId) -> &[ChannelId] {
        self.lamps.get(usize::from(id.0)).map_or(&[], |lamp| &lamp.neighbours)
    }

    /// The most channels that light any place of the wall; 1 or more.
    pub fn overlap_max(&self) -> usize {
        self.most_of(|_| DVec3::ONE).x.max(1.0) as usize
    }

    /// The most that channels which light one place have together of what `of` says of each.
    fn most_of(&self, of: impl Fn(&BlendChannel<'_>) -> DVec3) -> DVec3 {
        let most = |lamp: &BlendChannel<'_>| overlap::overlap_max(lamp, &self.lamps, &of);
        self.lamps.iter().map(most).fold(DVec3::ZERO, DVec3::max)
    }
}

#[cfg(test)]
pub(super) mod tests;
