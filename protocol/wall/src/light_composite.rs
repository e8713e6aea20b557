//! The light that a wall shows for the codes of its displays: on each place of a screen's canvas
//! the sum of the light of all channels that light it; pure f64.
//!
//! ```text
//! codes of a display → turn, packing, mirror undone → light by the display's curve
//!     → b + (1 − b)·light of a projector that leaks → resampled, summed
//! ```
//!
//! Tiles are the canvas's pixels, so that nothing is resampled; between the pixels of projectors
//! and of pinned, bent or warped pictures, light is linear. Of a map that is folded, one of the
//! pixels that show a place is among them.

use std::cell::OnceCell;
use std::ops::Range;

use glam::{DVec2, DVec3, UVec2};

use super::blend::blend_channel::{BlendChannel, Smoothness};
use super::wall_geometry::ResolvedWall;
use super::{
    Channel, ChannelCalibration, ChannelKind, Eye, Orientation, StereoPacking, TransferFunction,
    Wall,
};
use crate::ChannelId;

/// Pixels of a row whose places are found at its ends and its middle only, where that is as good.
const SPAN: u32 = 16;

/// Maximum error of a place between them, in pixels of the picture.
const PLACE_ERROR_MAX: f64 = 1e-3;

/// The picture of a channel as its display gets it.
#[derive(Clone, Copy, Debug)]
pub struct DisplayImage<'a> {
    /// The channel that drew it.
    pub channel: ChannelId,
    /// RGBA8, rows from the top, of the channel's
    /// [`display_size`](super::Channel::display_size).
    pub rgba: &'a [u8],
}

/// The eye of a viewer that sees a screen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StereoEye {
    /// The left one, or both where channels are for the middle of both.
    Left,
    /// The right one.
    Right,
}

/// The light of one screen, as one eye sees it.
#[derive(Clone, Debug)]
pub struct LightComposite<'a> {
    canvas: UVec2,
    shown: Vec<LinearImage<'a>>,
}

impl StereoEye {
    /// Returns whether this eye sees a channel.
    pub fn sees(self, channel: &Channel) -> bool {
        let ChannelCalibration { packing, eye, .. } = channel.adjustment;
        packing != StereoPacking::None
            || match eye {
                Eye::Center => true,
                Eye::Left => self == Self::Left,
                Eye::Right => self == Self::Right,
            }
    }

    /// The sides from which a screen has pictures that differ: the left one, and the right one
    /// where a channel is for it.
    pub fn of(wall: &Wall, screen: u16) -> &'static [Self] {
        let is_right = |channel: &Channel| {
            let ChannelCalibration { packing, eye, .. } = channel.adjustment;
            channel.screen == screen && (packing != StereoPacking::None || eye == Eye::Right)
        };
        if wall.channels.iter().any(is_right) { &[Self::Left, Self::Right] } else { &[Self::Left] }
    }

    /// Pixels across all pictures of a wall's screens, side by side.
    pub fn pixels_across(wall: &Wall) -> u64 {
        let screens = (0..).zip(&wall.screens);
        let across = screens.map(|(index, screen)| {
            let eyes = Self::of(wall, index).len() as u64;
            eyes * u64::from(screen.canvas.x)
        });
        across.sum()
    }
}

/// Returns whether an eye's view of a screen differs from the codes of its tiles beside each other.
pub fn needs_composite(wall: &Wall, screen: u16, side: StereoEye) -> bool {
    let seen = |channel: &&Channel| channel.screen == screen && side.sees(channel);
    let lamps: Vec<_> =
        wall.channels.iter().filter(seen).map(|channel| BlendChannel::new(wall, channel)).collect();
    let is_plain = |lamp: &BlendChannel<'_>| {
        let adjustment = &lamp.channel.adjustment;
        lamp.is_plain_tile()
            && adjustment.color.curve == TransferFunction::Srgb
            && adjustment.packing == StereoPacking::None
            && adjustment.turn == Orientation::None
            && !adjustment.mirror
    };
    let meets =
        |(at, lamp): (usize, &BlendChannel<'_>)| lamps[..at].iter().any(|o| lamp.may_light_same(o));
    let leaks = lamps.iter().any(|lamp| wall.leak_of(lamp.channel) != DVec3::ZERO);
    leaks || !lamps.iter().all(is_plain) || lamps.iter().enumerate().any(meets)
}

impl<'a> LightComposite<'a> {
    /// Combines the pictures that belong to this screen and are seen from this side; a picture that
    /// is missing, or not of its channel's size, gives no light.
    pub fn new(
        of: impl Into<ResolvedWall<'a>>,
        screen: u16,
        side: StereoEye,
        pictures: &[DisplayImage<'a>],
    ) -> Self {
        let shaped = of.into();
        let wall = shaped.wall;
        let canvas = wall.screens.get(usize::from(screen)).map_or(UVec2::ZERO, |s| s.canvas);
        let shown = pictures.iter().filter_map(|picture| {
            let channel = wall.channel(picture.channel)?;
            let is_seen = channel.screen == screen && side.sees(channel);
            is_seen.then(|| LinearImage::new(shaped, picture.channel, side, picture.rgba))?
        });
        // Where only a file knows that nobody has read, nothing is seen.
        let shown = shown.filter(|shown| shown.lamp.is_known());
        Self { canvas, shown: shown.collect() }
    }

    /// The light of a place of the canvas, in pixels from its upper left; `None` where no channel
    /// lights it. 1 is the white of one projector.
    pub fn light(&self, canvas: DVec2) -> Option<DVec3> {
        let lit = self
            .shown
            .iter()
            .filter_map(|shown| Some(shown.leaking(shown.between(shown.lamp.lit_pixel(canvas)?))));
        lit.reduce(|sum, light| sum + light)
    }

    /// The light at the middle of each pixel of a row of the canvas, from the left.
    pub fn row(&self, y: u32) -> Vec<Option<DVec3>> {
        let mut row: Vec<Option<DVec3>> = vec![None; self.canvas.x as usize];
        let mut add = |x: u32, light: DVec3| {
            if let Some(sum) = row.get_mut(x as usize) {
                *sum = Some(sum.unwrap_or_default() + light);
            }
        };
        // Of a mesh each takes a search, which all projectors share.
        let spots = OnceCell::new();
        for shown in &self.shown {
            let (origin, size) = (shown.lamp.channel.origin, shown.lamp.channel.size);
            if shown.lamp.is_plain_tile() {
                let Some(y) = y.checked_sub(origin.y).filter(|y| *y < size.y) else { continue };
                (0..size.x)
                    .for_each(|x| add(origin.x + x, shown.leaking(shown.pixel(UVec2::new(x, y)))));
                continue;
            }
            if shown.may_have_holes() {
                let middle = |x: u32| DVec2::new(f64::from(x), f64::from(y)) + 0.5;
                let spot = |x: u32| shown.lamp.spot_on(middle(x));
                let spots = spots.get_or_init(|| (0..self.canvas.x).map(spot).collect::<Vec<_>>());
                for (x, spot) in (0..).zip(spots) {
                    if let Some(pixel) = spot.as_ref().and_then(|of| shown.lamp.lit_pixel_of(of)) {
                        add(x, shown.leaking(shown.between(pixel)));
                    }
                }
                continue;
            }
            for begin in (0..self.canvas.x).step_by(SPAN as usize) {
                let end = (begin + SPAN).min(self.canvas.x);
                shown.span(y, begin..end, |x, pixel| {
                    add(x, shown.leaking(shown.between(pixel)));
                });
            }
        }
        row
    }
}

/// A channel's picture, and the light of its codes.
#[derive(Clone, Debug)]
pub struct LinearImage<'a> {
    lamp: BlendChannel<'a>,
    rgba: &'a [u8],
    /// From upright pixels to those of the display.
    hang: DisplayTransform,
    /// The light of each code, of the colours that pass the eye's glass.
    light: Vec<DVec3>,
    /// The display's black level.
    leak: DVec3,
}

impl<'a> LinearImage<'a> {
    /// The picture of a channel, RGBA8 as its display gets it, as an eye sees it; `None` where
    /// it is not of the display's size.
    pub fn new(
        of: impl Into<ResolvedWall<'a>>,
        id: ChannelId,
        side: StereoEye,
        rgba: &'a [u8],
    ) -> Option<Self> {
        let shaped = of.into();
        let channel = shaped.wall.channel(id)?;
        let display = channel.display_size();
        if rgba.len() != 4 * display.x as usize * display.y as usize {
            return None;
        }
        let adjustment = &channel.adjustment;
        let glass = match (adjustment.packing, side) {
            (StereoPacking::Anaglyph, StereoEye::Left) => DVec3::X,
            (StereoPacking::Anaglyph, StereoEye::Right) => DVec3::new(0.0, 1.0, 1.0),
            _ => DVec3::ONE,
        };
        let curve = &adjustment.color.curve;
        let light = |code: u8| curve.decode(DVec3::splat(f64::from(code) / 255.0)) * glass;
        Some(Self {
            lamp: BlendChannel::new(shaped, channel),
            rgba,
            hang: DisplayTransform::new(adjustment, channel.size, side),
            light: (0..=u8::MAX).map(light).collect(),
            leak: shaped.wall.leak_of(channel),
        })
    }

    /// Returns the light that the display shows for the light of its codes: its black level is
    /// added.
    pub fn leaking(&self, light: DVec3) -> DVec3 {
        light * (DVec3::ONE - self.leak) + self.leak
    }

    /// The light of an upright pixel, which must be one of the channel's, without what leaks.
    pub fn pixel(&self, upright: UVec2) -> DVec3 {
        let at = 4 * self.hang.index(upright);
        let light = |axis: usize| self.light[usize::from(self.rgba[at + axis])][axis];
        DVec3::new(light(0), light(1), light(2))
    }

    /// Returns whether what it lights may have holes, and ends, between any two pixels: a map or a
    /// mesh says what that is.
    fn may_have_holes(&self) -> bool {
        let is_tile = self.lamp.channel.cover == ChannelKind::Tile;
        !is_tile && self.lamp.smoothness() == Smoothness::Faceted
    }

    /// Calls `put` with each pixel of a row of the canvas that it lights, and the place of its
    /// picture that does: exact where the span is bent, else between both ends.
    fn span(&self, y: u32, columns: Range<u32>, mut put: impl FnMut(u32, DVec2)) {
        let canvas = |x: f64| DVec2::new(x, f64::from(y) + 0.5);
        let place = |x: f64| self.lamp.pixel(canvas(x));
        let (first, last) = (f64::from(columns.start) + 0.5, f64::from(columns.end) - 0.5);
        let found = (place(first), place(f64::midpoint(first, last)), place(last));
        let (a, middle, b) = match found {
            (None, None, None) => return,
            (Some(a), Some(middle), Some(b)) => (a, middle, b),
            _ => (DVec2::NAN, DVec2::ZERO, DVec2::ZERO),
        };
        let is_straight = ((a + b) / 2.0).distance(middle) <= PLACE_ERROR_MAX;
        let (low, high) = (a.min(b) - PLACE_ERROR_MAX, a.max(b) + PLACE_ERROR_MAX);
        if is_straight && (high.cmplt(DVec2::ZERO).any() || low.cmpgt(self.lamp.size).any()) {
            return;
        }
        for x in columns {
            let at = f64::from(x) + 0.5;
            let pixel = if is_straight {
                Some(a.lerp(b, (at - first) / (last - first).max(1.0)))
            } else {
                place(at)
            };
            if let Some(pixel) = pixel.filter(|pixel| self.lamp.contains(*pixel)) {
                put(x, pixel);
            }
        }
    }

    /// The light of a place of the upright picture; beyond the middles of its outermost pixels as
    /// there.
    fn between(&self, place: DVec2) -> DVec3 {
        let last = self.lamp.channel.size - 1;
        let at = (place - 0.5).clamp(DVec2::ZERO, last.as_dvec2());
        let low = at.as_uvec2();
        let (high, t) = ((low + 1).min(last), at - low.as_dvec2());
        let row = |y: u32| {
            let (a, b) = (self.pixel(UVec2::new(low.x, y)), self.pixel(UVec2::new(high.x, y)));
            a.lerp(b, t.x)
        };
        row(low.y).lerp(row(high.y), t.y)
    }
}

/// The transform of an upright picture into a part of a display's: mirrored, turned, then packed.
#[derive(Clone, Copy, Debug)]
struct DisplayTransform {
    turn: Orientation,
    is_mirrored: bool,
    upright: UVec2,
    /// The upper left corner of this eye's part of the display.
    begin: UVec2,
    /// The width of the display.
    width: u32,
}

impl DisplayTransform {
    fn new(adjustment: &ChannelCalibration, upright: UVec2, side: StereoEye) -> Self {
        let (turn, is_mirrored) = (adjustment.turn, adjustment.mirror);
        let step = (adjustment.packing.parts() - 1) * turn.turned(upright);
        let begin = if side == StereoEye::Right { step } else { UVec2::ZERO };
        let width = adjustment.display_size(upright).x;
        Self { turn, is_mirrored, upright, begin, width }
    }

    /// The number of the display's pixel that shows an upright one, row by row.
    fn index(&self, pixel: UVec2) -> usize {
        let x = if self.is_mirrored { self.upright.x - 1 - pixel.x } else { pixel.x };
        let at = UVec2::new(x, pixel.y);
        let from_end = self.upright - 1 - at;
        let turned = match self.turn {
            Orientation::None => at,
            Orientation::Left => UVec2::new(from_end.y, at.x),
            Orientation::Right => UVec2::new(at.y, from_end.x),
            Orientation::Half => from_end,
        };
        let place = self.begin + turned;
        place.y as usize * self.width as usize + place.x as usize
    }
}

#[cfg(test)]
mod tests;
