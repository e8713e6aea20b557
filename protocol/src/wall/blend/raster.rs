//! The shares of all pixels of a channel, block by block.
//!
//! Places of other channels' pictures are found at the corners of blocks and interpolated between
//! them, where that is as good as exact; blocks that no other channel lights cost nothing more.

use glam::{DVec2, UVec2};

use super::lamp::{self, Lamp};
use super::{Blend, Share};
use crate::ids::ChannelId;

/// Pixels of a block, across and down.
const BLOCK: u32 = 8;

/// How far an interpolated place may be from the exact one in the middle of a block, in pixels:
/// with the steepest ramp of two pixels, a weight is off by less than 1/1,000 there; with one of
/// 20 pixels or more, by less than 1/8,192.
const PLACE_ERROR_MAX: f64 = 1e-3;

/// Beyond this many pixels beside a picture, nothing of a block is in it.
const BESIDE: f64 = 0.01;

/// Another channel in a block.
struct Other<'l, 'w> {
    lamp: &'l Lamp<'w>,
    widths: [Option<f64>; 4],
    is_before: bool,
    /// Its pixels at the corners of the block; `None` where that is no good.
    corners: Option<[DVec2; 4]>,
}

impl Blend<'_> {
    /// Calls `put` with the share of each pixel of a channel, in blocks; a channel that has no
    /// neighbours is alone everywhere.
    pub(super) fn raster(&self, id: ChannelId, mut put: impl FnMut(u32, u32, Share)) {
        let Some(lamp) = self.lamps.get(usize::from(id.0)) else { return };
        let size = lamp.channel.size;
        let nodes = UVec2::new(size.x.div_ceil(BLOCK), size.y.div_ceil(BLOCK)) + 1;
        let node = |x: u32, y: u32| (UVec2::new(x, y) * BLOCK).min(size).as_dvec2();
        let others: Vec<_> = lamp.neighbours.iter().map(|other| self.other(id, *other)).collect();
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
                    block.fill(&mut put, Share { weight: 1.0, count: 1 });
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
        let middle = Node::new(lamp, others, block.place(DVec2::splat(0.5)));
        let is_lit = corners.iter().all(|node| node.is_lit) && middle.is_lit;
        let mut here = Vec::new();
        for (index, other) in others.iter().enumerate() {
            let seen = corners.map(|node| node.pixels[index]);
            let exact = middle.pixels[index];
            let is_nowhere = exact.is_none() && seen.iter().all(Option::is_none);
            if is_nowhere || seen_beside(other.lamp, seen, exact) {
                continue;
            }
            let found = match (seen, exact) {
                ([Some(a), Some(b), Some(c), Some(d)], Some(exact)) => {
                    let is_good = ((a + b + c + d) / 4.0).distance(exact) <= PLACE_ERROR_MAX;
                    is_good.then_some([a, b, c, d])
                }
                _ => None,
            };
            here.push(Other { lamp: other.lamp, corners: found, ..*other });
        }
        if here.is_empty() && is_lit {
            return block.fill(put, Share { weight: 1.0, count: 1 });
        }
        let (widths, mut steps) = (self.widths(id), Vec::with_capacity(here.len()));
        for y in block.begin.y..block.end.y {
            for x in block.begin.x..block.end.x {
                let pixel = DVec2::new(f64::from(x), f64::from(y)) + 0.5;
                let is_exact = !is_lit || here.iter().any(|other| other.corners.is_none());
                let canvas = if is_exact { lamp.canvas(pixel) } else { None };
                if !is_lit && canvas.is_none() {
                    put(x, y, Share { weight: 0.0, count: 0 });
                    continue;
                }
                let at = (pixel - block.begin.as_dvec2()) / block.size();
                steps.clear();
                let mut is_later = false;
                for other in &here {
                    let place = match other.corners {
                        Some([a, b, c, d]) => Some(a.lerp(b, at.x).lerp(c.lerp(d, at.x), at.y)),
                        None => canvas.and_then(|canvas| other.lamp.pixel(canvas)),
                    };
                    if let Some(place) = place.filter(|place| other.lamp.has(*place)) {
                        steps.push(other.lamp.step(place, other.widths));
                        is_later |= other.is_before;
                    }
                }
                let own = lamp.step(pixel, widths);
                let (exponent, theirs) = (self.wall.blend.exponent, steps.iter().copied());
                let weight = lamp::weight(own, theirs, is_later, exponent);
                put(x, y, Share { weight, count: 1 + steps.len() });
            }
        }
    }
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

    /// The place at (0, 0) to (1, 1) of it.
    fn place(&self, at: DVec2) -> DVec2 {
        self.begin.as_dvec2() + self.size() * at
    }

    fn fill(&self, put: &mut impl FnMut(u32, u32, Share), share: Share) {
        for y in self.begin.y..self.end.y {
            for x in self.begin.x..self.end.x {
                put(x, y, share);
            }
        }
    }
}
