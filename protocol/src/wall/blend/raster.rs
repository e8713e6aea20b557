//! The shares of all pixels of a channel, block by block.
//!
//! Places of other channels' pictures are found at the corners of blocks and interpolated between
//! them, where that is as good as exact; blocks that no other channel lights cost nothing more.

use glam::{DVec2, UVec2};

use super::eyes::{self, Light};
use super::lamp::Lamp;
use super::{Blend, Share};
use crate::ids::ChannelId;

/// Pixels of a block, across and down.
const BLOCK: u32 = 8;

/// How far an interpolated place may be from the exact one in a block, in pixels.
const PLACE_ERROR_MAX: f64 = 1e-3;

/// By how much such a place may make a weight wrong: an eighth of what a sum of weights may be off
/// by, for four channels and more. Elsewhere places are exact: in steep ramps, and where outer
/// edges cross, around which weights turn within a pixel.
const WEIGHT_ERROR_MAX: f64 = 1.0 / 32768.0;

/// Parts of a pixel across and down of which it is asked who lights them, where an edge of another
/// picture runs through it.
const PARTS: u32 = 8;

/// Beyond this many pixels beside a picture, nothing of a block is in it.
const BESIDE: f64 = 0.01;

/// Another channel in a block.
struct Other<'l, 'w> {
    lamp: &'l Lamp<'w>,
    widths: [Option<f64>; 4],
    is_before: bool,
    /// Its pixels at the corners of the block, and how far those between may be off; `None` where
    /// that is no good.
    corners: Option<([DVec2; 4], f64)>,
}

/// A place of another channel's picture.
struct Seen<'o, 'l, 'w> {
    other: &'o Other<'l, 'w>,
    place: DVec2,
    /// How far it may be off, in pixels.
    error_px: f64,
    /// By what it moves from pixel to pixel, across and down.
    slope: [DVec2; 2],
}

impl Blend<'_> {
    /// Calls `put` with the share of each pixel of a channel, in blocks; a channel that has no
    /// neighbours is alone everywhere.
    pub(super) fn raster(&self, id: ChannelId, mut put: impl FnMut(u32, u32, Share)) {
        let Some(lamp) = self.lamps.get(usize::from(id.0)) else { return };
        let size = lamp.channel.size;
        let nodes = UVec2::new(size.x.div_ceil(BLOCK), size.y.div_ceil(BLOCK)) + 1;
        let node = |x: u32, y: u32| (UVec2::new(x, y) * BLOCK).min(size).as_dvec2();
        let others: Vec<_> = self.family(id).iter().map(|other| self.other(id, *other)).collect();
        let row = |y: u32| -> Vec<Node> {
            (0..nodes.x).map(|x| Node::new(lamp, &others, node(x, y))).collect()
        };
        let is_alone = others.is_empty();
        let mut above = if is_alone { Vec::new() } else { row(0) };
        for block_y in 0..nodes.y - 1 {
            let below = if is_alone { Vec::new() } else { row(block_y + 1) };
            for block_x in 0..nodes.x - 1 {
                let begin = UVec2::new(block_x, block_y) * BLOCK;
                let block = Block { begin, end: (begin + BLOCK).min(size) };
                let x = block_x as usize;
                if is_alone {
                    block.fill(&mut put, Share::ALONE);
                } else {
                    let corners = [&above[x], &above[x + 1], &below[x], &below[x + 1]];
                    self.block((id, lamp), &others, &block, corners, &mut put);
                }
            }
            above = below;
        }
    }

    fn other(&self, id: ChannelId, other: ChannelId) -> Other<'_, '_> {
        Other {
            lamp: &self.lamps[usize::from(other.0)],
            widths: self.widths(other),
            is_before: other < id,
            corners: None,
        }
    }

    fn block(
        &self,
        (id, lamp): (ChannelId, &Lamp<'_>),
        others: &[Other<'_, '_>],
        block: &Block,
        corners: [&Node; 4],
        put: &mut impl FnMut(u32, u32, Share),
    ) {
        let middles = block.middles().map(|at| Node::new(lamp, others, at));
        let is_lit = corners.iter().copied().chain(&middles).all(|node| node.is_lit);
        let mut here = Vec::new();
        for (index, other) in others.iter().enumerate() {
            let seen = corners.map(|node| node.pixels[index]);
            let exact = [0, 1, 2].map(|at| middles[at].pixels[index]);
            let is_nowhere = exact.iter().chain(&seen).all(Option::is_none);
            if is_nowhere || seen_beside(other.lamp, seen, exact[0]) {
                continue;
            }
            let found = linear(seen, exact).filter(|(_, error_px)| *error_px <= PLACE_ERROR_MAX);
            here.push(Other { lamp: other.lamp, corners: found, ..*other });
        }
        if here.is_empty() && is_lit {
            return block.fill(put, Share::ALONE);
        }
        let pixels = Pixels { blend: self, id, lamp, block, others: &here, is_lit };
        for y in block.begin.y..block.end.y {
            for x in block.begin.x..block.end.x {
                put(x, y, pixels.share(DVec2::new(f64::from(x), f64::from(y)) + 0.5));
            }
        }
    }
}

/// The pixels of a block that other channels light.
struct Pixels<'p, 'l, 'w> {
    blend: &'p Blend<'w>,
    id: ChannelId,
    lamp: &'p Lamp<'w>,
    block: &'p Block,
    others: &'p [Other<'l, 'w>],
    /// Whether the whole block is.
    is_lit: bool,
}

impl<'p, 'l, 'w> Pixels<'p, 'l, 'w> {
    fn share(&self, pixel: DVec2) -> Share {
        let is_linear = self.is_lit && self.others.iter().all(|other| other.corners.is_some());
        let linear = is_linear.then(|| self.share_among(pixel, &self.between(pixel))).flatten();
        let exact = || {
            let canvas = self.lamp.canvas(pixel)?;
            self.share_among(pixel, &self.exact(pixel, canvas))
        };
        linear.or_else(exact).unwrap_or(Share { weight: 0.0, count: 0.0 })
    }

    /// Places between those at the corners of the block.
    fn between(&self, pixel: DVec2) -> Vec<Seen<'p, 'l, 'w>> {
        let size = self.block.size();
        let at = (pixel - self.block.begin.as_dvec2()) / size;
        let seen = |other: &'p Other<'l, 'w>| {
            let ([a, b, c, d], error_px) = other.corners?;
            let (above, below) = (a.lerp(b, at.x), c.lerp(d, at.x));
            let slope = [(b - a).lerp(d - c, at.y) / size.x, (below - above) / size.y];
            Some(Seen { other, place: above.lerp(below, at.y), error_px, slope })
        };
        self.others.iter().filter_map(seen).collect()
    }

    /// Where they are.
    fn exact(&self, pixel: DVec2, canvas: DVec2) -> Vec<Seen<'p, 'l, 'w>> {
        let seen = |other: &'p Other<'l, 'w>| {
            let place = other.lamp.pixel(canvas)?;
            let beside = |by: DVec2| other.lamp.pixel(self.lamp.canvas(pixel + by)?);
            let slope = |by: DVec2| match (beside(by * 0.5), beside(by * -0.5)) {
                (Some(ahead), Some(behind)) => ahead - behind,
                (Some(ahead), None) => (ahead - place) * 2.0,
                (None, Some(behind)) => (place - behind) * 2.0,
                (None, None) => DVec2::ZERO,
            };
            let slope = [slope(DVec2::X), slope(DVec2::Y)];
            Some(Seen { other, place, error_px: 0.0, slope })
        };
        self.others.iter().filter_map(seen).collect()
    }

    /// The share of a pixel whose places in other pictures these are; `None` where they are too
    /// far off for it.
    fn share_among(&self, pixel: DVec2, seen: &[Seen<'_, 'l, 'w>]) -> Option<Share> {
        let exponent = self.blend.wall.blend.exponent;
        let lit: Vec<_> = seen.iter().filter(|seen| seen.other.lamp.has(seen.place)).collect();
        let steps: Vec<_> =
            lit.iter().map(|seen| seen.other.lamp.step(seen.place, seen.other.widths)).collect();
        let own = self.lamp.step(pixel, self.blend.widths(self.id));
        let lights: Vec<_> = seen.iter().map(Seen::light).collect();
        let share = eyes::share(Light::whole(self.lamp.eye(), own), &lights, exponent);
        // ∂w/∂r of another, times what its error makes of r.
        let most = steps.iter().copied().fold(own, f64::max);
        let error: f64 = (lit.iter().zip(&steps))
            .filter(|(seen, step)| seen.error_px > 0.0 && **step > 0.0)
            .map(|(seen, step)| {
                let relative = seen.other.lamp.steepness(seen.place, seen.other.widths);
                (step / most).powf(exponent) * exponent * relative * seen.error_px
            })
            .sum();
        (share.weight * error <= WEIGHT_ERROR_MAX).then_some(share)
    }
}

impl Seen<'_, '_, '_> {
    fn light(&self) -> Light {
        let other = self.other;
        let step = other.lamp.has(self.place).then(|| other.lamp.step(self.place, other.widths));
        let (eye, is_before) = (other.lamp.eye(), other.is_before);
        Light { eye, step, is_before, part: self.lit_part() }
    }

    /// How much of the pixel the other one lights: an edge of a picture that runs askew through a
    /// pixel ends its black within it.
    fn lit_part(&self) -> f64 {
        let lamp = self.other.lamp;
        let reach = (self.slope[0].abs() + self.slope[1].abs()) * 0.5;
        let (low, high) = (self.place - reach, self.place + reach);
        if lamp.has(low) && lamp.has(high) {
            return 1.0;
        }
        if high.cmple(DVec2::ZERO).any() || low.cmpge(lamp.size).any() {
            return 0.0;
        }
        let part = |at: u32| (f64::from(at) + 0.5) / f64::from(PARTS) - 0.5;
        let parts = (0..PARTS).flat_map(|y| (0..PARTS).map(move |x| (part(x), part(y))));
        let is_lit =
            |(x, y): &(f64, f64)| lamp.has(self.place + self.slope[0] * *x + self.slope[1] * *y);
        parts.filter(is_lit).count() as f64 / f64::from(PARTS * PARTS)
    }
}

/// Places at the corners of a block, if those between them are linear, and how far they are off at
/// most: at the block's middle, and at those of its upper and left side, where a saddle is off
/// whose middle is right; twice as much, since the worst place may be another.
fn linear(corners: [Option<DVec2>; 4], exact: [Option<DVec2>; 3]) -> Option<([DVec2; 4], f64)> {
    let ([Some(a), Some(b), Some(c), Some(d)], [Some(middle), Some(above), Some(left)]) =
        (corners, exact)
    else {
        return None;
    };
    let errors = [
        ((a + b + c + d) / 4.0).distance(middle),
        ((a + b) / 2.0).distance(above),
        ((a + c) / 2.0).distance(left),
    ];
    Some(([a, b, c, d], 2.0 * errors.into_iter().fold(0.0, f64::max)))
}

/// Whether a block that is seen there has no place in the picture: all of it lies beyond one side.
fn seen_beside(lamp: &Lamp<'_>, corners: [Option<DVec2>; 4], middle: Option<DVec2>) -> bool {
    let ([Some(a), Some(b), Some(c), Some(d)], Some(middle)) = (corners, middle) else {
        return false;
    };
    let low = a.min(b).min(c).min(d).min(middle);
    let high = a.max(b).max(c).max(d).max(middle);
    // A little more where the sides of the block are bent.
    let bulge = ((a + b + c + d) / 4.0 - middle).abs() * 2.0 + BESIDE;
    (low - bulge).cmpgt(lamp.size).any() || (high + bulge).cmplt(DVec2::ZERO).any()
}

/// A corner of a block.
struct Node {
    is_lit: bool,
    /// For each other channel, its place there.
    pixels: Vec<Option<DVec2>>,
}

impl Node {
    fn new(lamp: &Lamp<'_>, others: &[Other<'_, '_>], place: DVec2) -> Self {
        let canvas = lamp.canvas(place);
        let pixel = |other: &Other<'_, '_>| other.lamp.pixel(canvas?);
        Self { is_lit: canvas.is_some(), pixels: others.iter().map(pixel).collect() }
    }
}

/// A rectangle of pixels.
struct Block {
    begin: UVec2,
    end: UVec2,
}

impl Block {
    fn size(&self) -> DVec2 {
        (self.end - self.begin).as_dvec2()
    }

    /// The middles of all of it, of its upper side and of its left one.
    fn middles(&self) -> [DVec2; 3] {
        let place = |x: f64, y: f64| self.begin.as_dvec2() + self.size() * DVec2::new(x, y);
        [place(0.5, 0.5), place(0.5, 0.0), place(0.0, 0.5)]
    }

    fn fill(&self, put: &mut impl FnMut(u32, u32, Share), share: Share) {
        for y in self.begin.y..self.end.y {
            for x in self.begin.x..self.end.x {
                put(x, y, share);
            }
        }
    }
}
