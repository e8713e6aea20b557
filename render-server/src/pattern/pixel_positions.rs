//! The positions of all pixels of a channel on the canvas.
//!
//! One position takes a hundred nanoseconds on a curved screen, and a picture has two million
//! pixels. So positions are computed at the corners of blocks of pixels, and in between only if
//! interpolation is not exact enough.

use glam::{DVec2, UVec2};
use image::RgbaImage;
use polyptych_wall::channel_mapping::ChannelMapping;
use rayon::prelude::*;

use super::opaque;

/// Pixels of a block, each way.
pub(super) const BLOCK: u32 = 16;

/// Maximum error of an interpolated position, in pixels of the canvas: a tenth of the tolerance for
/// lines.
const ERROR_MAX: f64 = 0.001;

/// The places of one channel's pixels.
#[derive(Debug)]
pub(super) struct PixelPositions<'a> {
    map: &'a ChannelMapping<'a>,
    size: UVec2,
}

/// The position of a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PixelPosition {
    /// Its middle, in pixels of the canvas.
    pub at: DVec2,
    /// Its length along the canvas's x and y: the root of the sum of squares of both its sides.
    pub extent: DVec2,
}

/// A block of pixels, with what is known of all of them.
#[derive(Debug)]
pub(super) struct Block<'a> {
    map: &'a ChannelMapping<'a>,
    pub origin: UVec2,
    /// The places of its corners, where interpolation between them is exact.
    corners: Option<[DVec2; 4]>,
}

impl<'a> PixelPositions<'a> {
    pub fn new(map: &'a ChannelMapping<'a>, size: UVec2) -> Self {
        Self { map, size }
    }

    /// The smallest and largest place of the canvas that lie on the channel, nearly; `None` where
    /// nothing does.
    pub fn bounds(&self) -> Option<(DVec2, DVec2)> {
        let steps = 16;
        let place = |x: u32, y: u32| UVec2::new(x, y).as_dvec2() / f64::from(steps);
        let all = (0..=steps).flat_map(|y| (0..=steps).map(move |x| place(x, y)));
        let size = self.size.as_dvec2();
        all.filter_map(|place| self.map.canvas_from_pixel(place * size)).fold(None, |range, at| {
            let (low, high) = range.unwrap_or((at, at));
            Some((at.min(low), at.max(high)))
        })
    }

    /// Returns whether light of the channel at a place of the canvas falls on it.
    pub fn is_lit(&self, canvas: DVec2) -> bool {
        self.map.is_on_canvas(canvas)
    }

    /// A picture whose pixels are a function of their places, of the blocks they are in and of
    /// what is made once for each of these.
    pub fn paint<T>(
        &self,
        prepare: impl Fn(&Block<'_>) -> T + Sync,
        shade: impl Fn(&T, Option<PixelPosition>) -> [u8; 3] + Sync,
    ) -> RgbaImage {
        let (width, height) = (self.size.x, self.size.y);
        let mut bytes = vec![0; width as usize * height as usize * 4];
        let row_bytes = width as usize * 4;
        let rows = bytes.par_chunks_mut(row_bytes * BLOCK as usize).enumerate();
        rows.for_each(|(row, pixels)| {
            for left in (0..width).step_by(BLOCK as usize) {
                let block = Block::new(self.map, UVec2::new(left, row as u32 * BLOCK));
                let prepared = prepare(&block);
                for (y, line) in pixels.chunks_exact_mut(row_bytes).enumerate() {
                    for x in 0..BLOCK.min(width - left) {
                        let place = block.place(UVec2::new(x, y as u32));
                        let color = opaque(shade(&prepared, place));
                        let at = (left + x) as usize * 4;
                        line[at..at + 4].copy_from_slice(&color.0);
                    }
                }
            }
        });
        RgbaImage::from_raw(width, height, bytes).unwrap_or_default()
    }
}

impl<'a> Block<'a> {
    fn new(map: &'a ChannelMapping<'a>, origin: UVec2) -> Self {
        let (from, side) = (origin.as_dvec2(), f64::from(BLOCK));
        let find = |at: DVec2| map.canvas_from_pixel(from + at * side);
        let between = |corners: &[DVec2; 4], at: DVec2| {
            find(at).is_some_and(|place| place.distance(bilinear(corners, at)) < ERROR_MAX)
        };
        let corners = || {
            let [a, b, c, d] = [DVec2::ZERO, DVec2::X, DVec2::Y, DVec2::ONE].map(find);
            let corners = [a?, b?, c?, d?];
            let probes = [DVec2::splat(0.5), DVec2::new(0.5, 0.0), DVec2::new(0.0, 0.5)];
            probes.iter().all(|at| between(&corners, *at)).then_some(corners)
        };
        Self { map, origin, corners: corners() }
    }

    /// Returns the position of a pixel of the block; `None` if it has none.
    fn place(&self, pixel: UVec2) -> Option<PixelPosition> {
        let middle = pixel.as_dvec2() + 0.5;
        let (at, across, down) = if let Some(corners) = &self.corners {
            let at = middle / f64::from(BLOCK);
            let [a, b, c, d] = *corners;
            let across = ((b - a) * (1.0 - at.y) + (d - c) * at.y) / f64::from(BLOCK);
            let down = ((c - a) * (1.0 - at.x) + (d - b) * at.x) / f64::from(BLOCK);
            (bilinear(corners, at), across, down)
        } else {
            let find = |at: DVec2| self.map.canvas_from_pixel(self.origin.as_dvec2() + at);
            let at = find(middle)?;
            // Beyond the edge of a screen there may be nothing to measure by.
            let beside = |step: DVec2| {
                let forward = find(middle + step).map(|next| next - at);
                forward.or_else(|| find(middle - step).map(|before| at - before))
            };
            (at, beside(DVec2::X)?, beside(DVec2::Y)?)
        };
        let extent = DVec2::new(across.x.hypot(down.x), across.y.hypot(down.y));
        Some(PixelPosition { at, extent: extent.max(DVec2::splat(1e-9)) })
    }

    /// The places of its corners, where the whole block lies on the screen without a bend.
    pub fn corners(&self) -> Option<&[DVec2; 4]> {
        self.corners.as_ref()
    }
}

fn bilinear([a, b, c, d]: &[DVec2; 4], at: DVec2) -> DVec2 {
    a.lerp(*b, at.x).lerp(c.lerp(*d, at.x), at.y)
}
