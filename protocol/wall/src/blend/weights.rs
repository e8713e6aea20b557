//! The shares of all pixels of a channel, cell by cell; on all cores with the feature `parallel`.
//!
//! Places of other channels' pictures are found at a few places of a cell and interpolated between
//! them, where that is as good as exact; where it is not, the cell is divided. Cells that no other
//! channel lights cost nothing more.

mod patch;
mod pixel;

use glam::{DVec2, UVec2};
use patch::Patch;
use pixel::Pixels;
#[cfg(feature = "parallel")]
use rayon::prelude::*;

use super::blend_channel::{BlendChannel, Smoothness, Spot};
use super::{BlendModel, BlendWeight};
use crate::ChannelId;

/// Pixels of the largest cells, across and down; rows of them are what threads share.
const CELL: u32 = 64;

/// Pixels of the largest cells where slopes may have kinks.
const BENT_CELL: u32 = 16;

/// Pixels of the smallest cells: places between their corners are linear, or exact.
const BLOCK: u32 = 8;

/// Maximum error of an interpolated place in a large cell, in pixels.
const SMOOTH_ERROR_MAX: f64 = 3e-5;

/// Maximum error of an interpolated place in a block, in pixels.
const PLACE_ERROR_MAX: f64 = 1e-3;

/// Beyond this many pixels beside a picture, nothing of a block is in it.
const BESIDE: f64 = 0.01;

/// Another channel as it is asked for its places.
#[derive(Clone, Copy)]
struct Neighbour<'l, 'w> {
    lamp: &'l BlendChannel<'w>,
    widths: [Option<f64>; 4],
    is_before: bool,
}

/// Another channel in a cell, and its places there; `None` where each must be found by itself.
struct Here<'l, 'w> {
    other: Neighbour<'l, 'w>,
    patch: Option<Patch>,
}

/// One channel among those that share its light.
struct Raster<'l, 'w> {
    lamp: &'l BlendChannel<'w>,
    widths: [Option<f64>; 4],
    others: Vec<Neighbour<'l, 'w>>,
    exponent: f64,
    /// `true` if places have kinks, so that they are interpolated in blocks only.
    is_faceted: bool,
    /// Pixels of the largest cells whose places may be interpolated with curves.
    largest: u32,
}

impl<'w> BlendModel<'w> {
    /// Fills `texels`, row by row, with what `make` gives for each pixel of a channel's picture
    /// and its share. A channel that has no neighbours is alone everywhere.
    pub(super) fn for_each_weight<T: Send>(
        &self,
        id: ChannelId,
        texels: &mut [T],
        make: impl Fn(UVec2, BlendWeight) -> T + Sync,
    ) {
        let Some(lamp) = self.lamps.get(usize::from(id.0)) else { return };
        let others: Vec<_> = self.family(id).iter().map(|other| self.other(id, *other)).collect();
        let smoothness = others.iter().map(|other| other.lamp.smoothness());
        let smoothness = smoothness.fold(lamp.smoothness(), Smoothness::min);
        let raster = Raster {
            lamp,
            widths: self.ramp_widths(id),
            others,
            exponent: self.wall.blend.exponent,
            is_faceted: smoothness == Smoothness::Faceted,
            largest: if smoothness == Smoothness::Smooth { CELL } else { BENT_CELL },
        };
        let size = lamp.channel.size;
        let strip = (size.x.max(1) * CELL) as usize;
        let fill = |(strip, texels): (usize, &mut [T])| {
            let top = strip as u32 * CELL;
            let mut put = |x: u32, y: u32, share: BlendWeight| {
                let at = (y - top) as usize * size.x as usize + x as usize;
                texels[at] = make(UVec2::new(x, y), share);
            };
            for left in (0..size.x).step_by(CELL as usize) {
                let begin = UVec2::new(left, top);
                raster.cell(&Cell { begin, end: (begin + CELL).min(size) }, CELL, &mut put);
            }
        };
        #[cfg(feature = "parallel")]
        texels.par_chunks_mut(strip).enumerate().for_each(fill);
        #[cfg(not(feature = "parallel"))]
        texels.chunks_mut(strip).enumerate().for_each(fill);
    }

    fn other(&self, id: ChannelId, other: ChannelId) -> Neighbour<'_, 'w> {
        Neighbour {
            lamp: &self.lamps[usize::from(other.0)],
            widths: self.ramp_widths(other),
            is_before: other < id,
        }
    }
}

impl<'l, 'w> Raster<'l, 'w> {
    /// The shares of a cell of this side: at once where places are smooth, else of its parts.
    fn cell(&self, cell: &Cell, side: u32, put: &mut impl FnMut(u32, u32, BlendWeight)) {
        if self.others.is_empty() {
            return cell.fill(put, self.lamp.alone());
        }
        if !self.is_faceted
            && side <= self.largest
            && let Some(here) = self.smooth(cell)
        {
            return self.fill(cell, &here, true, put);
        }
        let half = side / 2;
        if self.is_faceted || half < BLOCK {
            return self.blocks(cell, put);
        }
        for begin in cell.parts(half) {
            self.cell(&Cell { begin, end: (begin + half).min(cell.end) }, half, put);
        }
    }

    /// Those that may light a cell, with smooth places; `None` where some of them are not.
    fn smooth(&self, cell: &Cell) -> Option<Vec<Here<'l, 'w>>> {
        let spots = patch::places().map(|place| self.lamp.spot(cell.place(place)));
        if spots.iter().any(Option::is_none) {
            return None;
        }
        let mut here = Vec::new();
        for other in &self.others {
            let places = spots.each_ref().map(|spot| other.lamp.pixel_of(spot.as_ref()?));
            if places.iter().all(Option::is_none) {
                if is_behind(other.lamp, &spots) {
                    continue;
                }
                return None;
            }
            let patch = Patch::curved(&places, cell.size())?;
            if patch.is_beside(other.lamp.size) {
                continue;
            }
            if patch.error_px > SMOOTH_ERROR_MAX {
                return None;
            }
            here.push(Here { other: *other, patch: Some(patch) });
        }
        Some(here)
    }

    /// The shares of a cell, block by block.
    fn blocks(&self, cell: &Cell, put: &mut impl FnMut(u32, u32, BlendWeight)) {
        let row = |y: u32| -> Vec<CornerSample> {
            let across = (cell.begin.x..cell.end.x).step_by(BLOCK as usize).chain([cell.end.x]);
            across.map(|x| self.node(UVec2::new(x, y).as_dvec2())).collect()
        };
        let mut above = row(cell.begin.y);
        for y in (cell.begin.y..cell.end.y).step_by(BLOCK as usize) {
            let below = row((y + BLOCK).min(cell.end.y));
            for (at, x) in (cell.begin.x..cell.end.x).step_by(BLOCK as usize).enumerate() {
                let begin = UVec2::new(x, y);
                let block = Cell { begin, end: (begin + BLOCK).min(cell.end) };
                self.block(&block, [&above[at], &above[at + 1], &below[at], &below[at + 1]], put);
            }
            above = below;
        }
    }

    fn block(
        &self,
        block: &Cell,
        corners: [&CornerSample; 4],
        put: &mut impl FnMut(u32, u32, BlendWeight),
    ) {
        let middles = patch::MIDDLES.map(|place| self.node(block.place(place)));
        let is_lit = corners.iter().copied().chain(&middles).all(|node| node.is_lit);
        let mut here = Vec::new();
        for (index, other) in self.others.iter().enumerate() {
            let seen = corners.map(|node| node.pixels[index]);
            let exact = [0, 1, 2].map(|at| middles[at].pixels[index]);
            let is_nowhere = exact.iter().chain(&seen).all(Option::is_none);
            if is_nowhere || seen_beside(other.lamp, seen, exact[0]) {
                continue;
            }
            let patch = Patch::linear(seen, exact, block.size());
            let patch = patch.filter(|patch| patch.error_px <= PLACE_ERROR_MAX);
            here.push(Here { other: *other, patch });
        }
        self.fill(block, &here, is_lit, put);
    }

    /// The weights of a cell for the channels that may light it; `is_lit` says that all of it lies
    /// on the screen.
    fn fill(
        &self,
        cell: &Cell,
        here: &[Here<'l, 'w>],
        is_lit: bool,
        put: &mut impl FnMut(u32, u32, BlendWeight),
    ) {
        if here.is_empty() && is_lit {
            return cell.fill(put, self.lamp.alone());
        }
        let mut pixels = Pixels::new(self, cell, here, is_lit);
        for y in cell.begin.y..cell.end.y {
            pixels.begin_row(y);
            for x in cell.begin.x..cell.end.x {
                put(x, y, pixels.share(x, y));
            }
        }
    }

    fn node(&self, place: DVec2) -> CornerSample {
        let spot = self.lamp.spot(place);
        let pixel = |other: &Neighbour<'_, '_>| other.lamp.pixel_of(spot.as_ref()?);
        CornerSample { is_lit: spot.is_some(), pixels: self.others.iter().map(pixel).collect() }
    }
}

/// Returns whether spots lie behind a projector, and by so much that all between them do.
fn is_behind(lamp: &BlendChannel<'_>, spots: &[Option<Spot>]) -> bool {
    let depths = || spots.iter().flatten().map(|spot| lamp.depth(spot).unwrap_or(0.0));
    let (low, high) = (depths().fold(0.0, f64::min), depths().fold(f64::MIN, f64::max));
    high < low - high
}

/// Returns whether a block seen at these places has no place in the picture: all of it lies beyond
/// one side.
fn seen_beside(
    lamp: &BlendChannel<'_>,
    corners: [Option<DVec2>; 4],
    middle: Option<DVec2>,
) -> bool {
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
struct CornerSample {
    is_lit: bool,
    /// For each other channel, its place there.
    pixels: Vec<Option<DVec2>>,
}

/// A rectangle of pixels.
struct Cell {
    begin: UVec2,
    end: UVec2,
}

impl Cell {
    fn size(&self) -> DVec2 {
        (self.end - self.begin).as_dvec2()
    }

    /// A place of it, from (0, 0) to (1, 1), in the picture.
    fn place(&self, (x, y): (f64, f64)) -> DVec2 {
        self.begin.as_dvec2() + self.size() * DVec2::new(x, y)
    }

    /// Returns the upper left pixels of its parts with this side.
    fn parts(&self, side: u32) -> impl Iterator<Item = UVec2> + use<> {
        let (begin, end) = (self.begin, self.end);
        let across =
            move |y| (begin.x..end.x).step_by(side as usize).map(move |x| UVec2::new(x, y));
        (begin.y..end.y).step_by(side as usize).flat_map(across)
    }

    fn fill(&self, put: &mut impl FnMut(u32, u32, BlendWeight), share: BlendWeight) {
        for y in self.begin.y..self.end.y {
            for x in self.begin.x..self.end.x {
                put(x, y, share);
            }
        }
    }
}
