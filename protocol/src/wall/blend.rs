//! How channels share the light of places that several of them light, and how their black becomes
//! one; pure f64, from the geometry alone.
//!
//! ```text
//! ramp   r_i = (Π over edges: s(distance to the edge / width of its ramp))^exponent
//! weight w_i = r_i / Σ r_j, over all channels j that light the place: the sum is 1 everywhere
//! light  w_i · ((K − k)·b + (1 − K·b)·I) / (1 − b)
//! ```
//!
//! I is the light that the wall should show, b the leak of a projector (its black as a share of
//! its white), k how many channels light the place and K the most that light any place of the
//! wall. A projector shows b + (1 − b)·light, so that k of them show
//! k·b + (K − k)·b + (1 − K·b)·I = K·b + (1 − K·b)·I, whatever k is.
//!
//! Where an edge of a picture runs through a pixel of another one, k is its mean over the pixel's
//! area: no pixel can end its black where the edge is, but all of it has the right sum.
//!
//! A weight depends on the place and not on the pixel that shows it, so that channels whose
//! pixels lie askew agree. Channels for different eyes share nothing: glasses hide the others'.
//! What is for both eyes has the light that keeps both sums (`eyes.rs`).
//! Channels whose pixels lie where a file says ([`Cover::Map`](super::Cover::Map)) have weight 1
//! where that file brings its own shares of light: an alpha mask, or light at a mesh's corners.

mod eyes;
pub(super) mod lamp;
mod mask;
mod overlap;
mod raster;

use std::collections::BTreeSet;
use std::sync::OnceLock;

use glam::{DVec2, DVec3, UVec2};

use super::shapes::Shaped;
use super::{BlendRule, Channel, Color, EyeOf, MapFile, Screen};
use crate::ids::ChannelId;
use eyes::Light;
use lamp::Lamp;

pub use mask::{MaskTexels, Masks};

/// What a texel of 1 is in a [`LightMap`].
pub const TEXEL_ONE: u16 = u16::MAX;

/// What the light of each pixel of a channel's upright picture is multiplied by, and what is then
/// added, in linear light.
#[derive(Clone, Debug, PartialEq)]
pub struct LightMap {
    /// Of the upright picture, in pixels.
    pub size: UVec2,
    /// Row by row from the top: factor and addend, in parts of [`TEXEL_ONE`] of `multiply` and
    /// `add`; once for all colours, or for red, then all for green, then all for blue. A weight is
    /// rounded by 1/131,070 at most, so that the sum of four keeps 1/4096 eight times over.
    pub texels: Vec<[u16; 2]>,
    /// The factor that a texel of [`TEXEL_ONE`] stands for.
    pub multiply: f64,
    /// The addend that a texel of [`TEXEL_ONE`] stands for, of red, green and blue alike.
    pub add: f64,
}

/// The light map of a channel, or `None` where it changes nothing: its light is its own, nothing
/// leaks and nothing is masked. Who asks for several makes a [`Blend`] first.
pub fn light_map<'a>(
    of: impl Into<Shaped<'a>>,
    id: ChannelId,
    masks: &Masks<'_>,
) -> Option<LightMap> {
    Blend::new(of).light_map(id, masks)
}

/// All that a channel's light map is made from: equal ones make equal maps.
#[derive(Clone, Debug, PartialEq)]
pub struct LightInputs {
    eye: DVec3,
    rule: BlendRule,
    most: usize,
    screen: Screen,
    files: Vec<MapFile>,
    /// The channel and those on which its weights depend, without their colours; with the widths
    /// of their ramps.
    channels: Vec<(ChannelId, Channel, [Option<f64>; 4])>,
}

impl LightMap {
    /// Factor and addend at a pixel, as they are after rounding; of red where colours differ.
    pub fn at(&self, x: u32, y: u32) -> [f64; 2] {
        self.of_colour(x, y, 0)
    }

    /// As [`Self::at`], of red (0), green (1) or blue.
    pub fn of_colour(&self, x: u32, y: u32, colour: usize) -> [f64; 2] {
        let pixels = self.size.x as usize * self.size.y as usize;
        let layer = colour.min(self.texels.len() / pixels.max(1) - 1);
        let at = layer * pixels + y as usize * self.size.x as usize + x as usize;
        let [factor, addend] = self.texels[at];
        let part = |texel: u16| f64::from(texel) / f64::from(TEXEL_ONE);
        [part(factor) * self.multiply, part(addend) * self.add]
    }
}

/// How the black of some projectors is raised to that of others.
#[derive(Clone, Copy, Debug)]
pub struct BlackRule {
    leak: f64,
    most: usize,
    /// What the picture's light is multiplied by, beside the weight.
    pub multiply: f64,
}

impl BlackRule {
    /// For projectors with this leak, of which at most `most` light any place. Where together
    /// they leak all the light there is, nothing of the picture is left.
    pub fn new(leak: f64, most: usize) -> Self {
        let multiply = (1.0 - most as f64 * leak).max(0.0) / (1.0 - leak);
        Self { leak, most, multiply }
    }

    /// What is added, before the weight, where `count` projectors light the place; of a pixel
    /// that another one lights in part, the mean.
    pub fn add(&self, count: f64) -> f64 {
        (self.most as f64 - count).max(0.0) * self.leak / (1.0 - self.leak)
    }
}

/// A channel's part in the light of a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Share {
    /// Of the picture's light; all channels' together 1. Zero where the channel lights nothing.
    pub weight: f64,
    /// How many channels light the place: k; of a pixel, the mean over its area. Less than 1 where
    /// channels of one eye make up for much that channels of both cannot add.
    pub count: f64,
}

impl Share {
    /// Of a channel that alone lights a place.
    const ALONE: Self = Self { weight: 1.0, count: 1.0 };
}

/// Who lights what on a wall.
#[derive(Clone, Debug)]
pub struct Blend<'a> {
    wall: &'a super::Wall,
    /// One for each channel.
    lamps: Vec<Lamp<'a>>,
    /// See [`Self::most`]; found when somebody asks.
    most: OnceLock<usize>,
}

impl<'a> Blend<'a> {
    /// The blends of a wall; without its shapes, channels that files place share nothing.
    pub fn new(of: impl Into<Shaped<'a>>) -> Self {
        let shaped = of.into();
        let wall = shaped.wall;
        let mut lamps: Vec<_> = wall.channels.iter().map(|c| Lamp::new(shaped, c)).collect();
        overlap::find_neighbours(&mut lamps);
        Self { wall, lamps, most: OnceLock::new() }
    }

    /// How black is raised on this wall. Without a leak, nobody needs to know how many channels
    /// light a place.
    fn rule(&self) -> BlackRule {
        let leak = self.wall.blend.leak;
        BlackRule::new(leak, if leak > 0.0 { self.most() } else { 1 })
    }

    /// What the light map of a channel is made from; `None` where there is no such channel.
    pub fn light_inputs(&self, id: ChannelId) -> Option<LightInputs> {
        let wall = self.wall;
        let screen = wall.screen_of(wall.channel(id)?).clone();
        let of = |id: ChannelId| {
            let mut channel = wall.channel(id)?.clone();
            channel.adjustment.color = Color::default();
            Some((id, channel, self.widths(id)))
        };
        Some(LightInputs {
            eye: wall.eye,
            rule: wall.blend,
            most: self.rule().most,
            screen,
            files: wall.files.clone(),
            channels: std::iter::once(id).chain(self.family(id)).filter_map(of).collect(),
        })
    }

    /// The light map of a channel, as [`light_map`] has it.
    pub fn light_map(&self, id: ChannelId, masks: &Masks<'_>) -> Option<LightMap> {
        let channel = self.wall.channel(id)?;
        let rule = self.rule();
        let [multiply, most_added] = [rule.multiply, rule.add(1.0)];
        let add = most_added + masks.most_added();
        if masks.is_empty() && self.neighbours(id).is_empty() && multiply == 1.0 && add == 0.0 {
            return None;
        }
        let parts = |value: f64, whole: f64| {
            if whole > 0.0 { (value / whole * f64::from(TEXEL_ONE)).round() as u16 } else { 0 }
        };
        let size = channel.size;
        let pixels = size.x as usize * size.y as usize;
        let colours = if masks.is_coloured() { 3 } else { 1 };
        let mut texels = vec![[0; 2]; pixels * colours];
        // Everything is a multiple of few numbers where there is no mask: most of the picture.
        let alone = [parts(multiply, multiply), parts(rule.add(1.0), add)];
        for (colour, layer) in texels.chunks_mut(pixels.max(1)).enumerate() {
            self.raster(id, layer, |at, share| {
                if masks.is_empty() && share == Share::ALONE {
                    return alone;
                }
                let lights = [multiply, rule.add(share.count)];
                let [factor, addend] = lights.map(|light| share.weight * light);
                let (own, least) = masks.at(at.x, at.y, size, colour);
                [parts(factor * own, multiply), parts(addend * own + least, add)]
            });
        }
        let is_plain = multiply == 1.0 && texels.iter().all(|texel| *texel == [TEXEL_ONE, 0]);
        (!is_plain).then_some(LightMap { size, texels, multiply, add })
    }

    /// The channels that light a place of a screen's canvas for the eye of `id`'s channel, with
    /// their weights: in pixels from the canvas's upper left.
    pub fn weights(&self, id: ChannelId, canvas: DVec2) -> Vec<(ChannelId, f64)> {
        let Some(lamp) = self.lamps.get(usize::from(id.0)) else { return Vec::new() };
        let side = if lamp.eye() == EyeOf::Right { EyeOf::Right } else { EyeOf::Left };
        let screen = lamp.channel.screen;
        let on_screen = self.wall.channel_ids().zip(&self.lamps);
        let on_screen = on_screen.filter(|(_, other)| other.channel.screen == screen);
        let lit: Vec<_> = on_screen
            .filter_map(|(id, lamp)| {
                let step = lamp.step(lamp.lit(canvas)?, self.widths(id));
                Some((id, Light::whole(lamp.eye(), step)))
            })
            .collect();
        let seen = lit.iter().filter(|(_, light)| [EyeOf::Center, side].contains(&light.eye));
        let shared = seen.map(|(id, own)| {
            let others = lit.iter().filter(|(other, _)| other != id);
            let others: Vec<_> =
                others.map(|(other, light)| Light { is_before: other < id, ..*light }).collect();
            (*id, eyes::share(*own, &others, self.wall.blend.exponent).weight)
        });
        shared.collect()
    }

    /// How wide the ramps at a channel's edges are, in its pixels: left, right, top and bottom;
    /// `None` where it shares no light.
    pub fn widths(&self, id: ChannelId) -> [Option<f64>; 4] {
        let at = usize::from(id.0);
        self.lamps.get(at).map_or([None; 4], |lamp| {
            *lamp.widths.get_or_init(|| overlap::widths(lamp, &self.lamps))
        })
    }

    /// The channels on which the weights of this one depend, in their order: its neighbours, and
    /// those of the other eye where some of them are for both.
    fn family(&self, id: ChannelId) -> Vec<ChannelId> {
        let lamp = |id: &ChannelId| &self.lamps[usize::from(id.0)];
        let own = self.neighbours(id);
        let of_both = own.iter().map(lamp).filter(|lamp| lamp.eye() == EyeOf::Center);
        let further = of_both.flat_map(|lamp| &lamp.neighbours).filter(|other| **other != id);
        let family: BTreeSet<_> = own.iter().chain(further).copied().collect();
        family.into_iter().collect()
    }

    /// The channels that may light what this one lights.
    pub fn neighbours(&self, id: ChannelId) -> &[ChannelId] {
        self.lamps.get(usize::from(id.0)).map_or(&[], |lamp| &lamp.neighbours)
    }

    /// The most channels that light any place of the wall: K; 1 or more.
    pub fn most(&self) -> usize {
        let most = |lamp: &Lamp<'_>| overlap::most(lamp, &self.lamps);
        *self.most.get_or_init(|| self.lamps.iter().map(most).max().unwrap_or(1))
    }
}

#[cfg(test)]
pub(super) mod tests;
