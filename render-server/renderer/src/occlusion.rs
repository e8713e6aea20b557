//! Occlusion culling: finds boxes that lie behind opaque surfaces at all pixels that they may
//! touch, in f64 and on the safe side.
//!
//! The depths of what was drawn are reduced to the farthest one of each cell of pixels, and those
//! to the farthest of ever larger squares, as in Greene, Kass and Miller, "Hierarchical Z-Buffer
//! Visibility" (1993).

use glam::{DMat4, DVec3};

use super::pass::occluder::CELL_SIDE;
use super::scene::Bounds;
use super::view::ViewDesc;

/// The frames in which items that others hide are left out, which changes no pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OcclusionCulling {
    /// Never.
    Never,
    /// If frames take less time so, as measured now and then.
    #[default]
    WhereFaster,
    /// In every frame.
    Always,
}

/// Pixels by which the rectangle around a box is wider: half of a line's or point's pixel, and what
/// rasterisation rounds.
const PIXEL_MARGIN: f64 = 2.0;

/// The share of its depth by which a box must be farther than what hides it. The depth of a
/// fragment is off by less, also on triangles that are seen edge-on.
const DEPTH_MARGIN: f64 = 1.0 / 1024.0;

/// The additional depth by which a box must be farther if rays are parallel: their depth goes from
/// 0 to 1 and is rounded in proportion to 1.
const PARALLEL_DEPTH_MARGIN: f64 = 1e-5;

/// Cells along each side of a rectangle of which each is looked at; of larger ones, larger squares.
const CELLS_ACROSS_MAX: usize = 4;

/// Depths of squares of cells.
#[derive(Debug)]
struct Level {
    size: [usize; 2],
    /// Row by row; reversed: 0 is infinitely far.
    farthest: Vec<f32>,
}

/// The farthest depths of the cells of a picture, and of ever larger squares of them.
#[derive(Debug)]
pub(crate) struct CellDepths {
    /// From cells to the whole picture.
    levels: Vec<Level>,
}

impl CellDepths {
    /// Takes the farthest depth of each cell, row by row.
    pub fn new(size: [usize; 2], farthest: Vec<f32>) -> Self {
        let mut levels = vec![Level { size, farthest }];
        while let Some(last) = levels.last().filter(|level| level.size.iter().any(|s| *s > 1)) {
            let size = last.size.map(|side| side.div_ceil(2));
            let mut farthest = vec![f32::INFINITY; size[0] * size[1]];
            for (y, row) in last.farthest.chunks_exact(last.size[0]).enumerate() {
                for (x, depth) in row.iter().enumerate() {
                    let square = &mut farthest[y / 2 * size[0] + x / 2];
                    *square = square.min(*depth);
                }
            }
            levels.push(Level { size, farthest });
        }
        Self { levels }
    }

    /// The farthest depth within a rectangle of cells: the first and the last one, inclusive.
    fn farthest(&self, first: [usize; 2], last: [usize; 2]) -> f32 {
        let across = |level: usize, axis: usize| (last[axis] >> level) - (first[axis] >> level) + 1;
        let is_fine = |level: &usize| (0..2).all(|axis| across(*level, axis) <= CELLS_ACROSS_MAX);
        let at = (0..self.levels.len()).find(is_fine).unwrap_or(self.levels.len() - 1);
        let Level { size, farthest } = &self.levels[at];
        let columns = first[0] >> at..=(last[0] >> at).min(size[0] - 1);
        let rows = first[1] >> at..=(last[1] >> at).min(size[1] - 1);
        let row = |y: usize| farthest[y * size[0]..][columns.clone()].iter().copied();
        rows.flat_map(row).fold(f32::INFINITY, f32::min)
    }
}

/// The test of boxes in one view.
#[derive(Debug)]
pub(crate) struct OcclusionTest<'a> {
    view: &'a ViewDesc,
    clip_from_eye: DMat4,
    /// The pixels that the view may touch: x, y, width, height.
    rectangle: [u32; 4],
    depths: &'a CellDepths,
}

impl<'a> OcclusionTest<'a> {
    /// The test of a view onto a rectangle of the target that the depths are of.
    pub fn new(view: &'a ViewDesc, rectangle: [u32; 4], depths: &'a CellDepths) -> Self {
        Self { view, clip_from_eye: view.clip_from_eye(), rectangle, depths }
    }

    /// Returns whether nothing in the box can show.
    pub fn hides(&self, bounds: &Bounds) -> bool {
        let Some((span, nearest)) = self.project(bounds) else { return false };
        let [x, y, width, height] = self.rectangle.map(f64::from);
        let [x0, x1] = [span[0] - PIXEL_MARGIN, span[2] + PIXEL_MARGIN].map(|at| {
            // Beyond the rectangle nothing is drawn.
            at.clamp(x, x + width - 1.0)
        });
        let [y0, y1] = [span[1] - PIXEL_MARGIN, span[3] + PIXEL_MARGIN]
            .map(|at| at.clamp(y, y + height - 1.0));
        let cell = |pixel: f64| pixel as usize / CELL_SIDE as usize;
        let farthest = self.depths.farthest([cell(x0), cell(y0)], [cell(x1), cell(y1)]);
        let margin = if self.view.is_parallel() { PARALLEL_DEPTH_MARGIN } else { 0.0 };
        f64::from(farthest) > nearest * (1.0 + DEPTH_MARGIN) + margin
    }

    /// The pixels around a box: left, top, right, bottom; and its nearest depth. `None` where a
    /// corner is not behind the near plane.
    ///
    /// Depth is a quotient of linear functions, so that it is greatest in a corner.
    fn project(&self, bounds: &Bounds) -> Option<([f64; 4], f64)> {
        let [vx, vy, vw, vh] = self.view.viewport;
        let mut span = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
        let mut nearest: f64 = 0.0;
        let (min, max) = (bounds.min - self.view.eye_in_world, bounds.max - self.view.eye_in_world);
        for corner in 0..8 {
            let pick = |axis: usize| if corner >> axis & 1 == 0 { min[axis] } else { max[axis] };
            let clip = self.clip_from_eye * DVec3::new(pick(0), pick(1), pick(2)).extend(1.0);
            if !(clip.w > 0.0 && clip.z < clip.w) {
                return None;
            }
            let ndc = clip.truncate() / clip.w;
            if !ndc.is_finite() {
                return None;
            }
            let (x, y) = (vx + (ndc.x + 1.0) * 0.5 * vw, vy + (1.0 - ndc.y) * 0.5 * vh);
            span = [span[0].min(x), span[1].min(y), span[2].max(x), span[3].max(y)];
            nearest = nearest.max(ndc.z);
        }
        Some((span, nearest))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn rectangle_is_never_nearer_than_its_farthest_cell(
            size in [1usize..70, 1usize..50],
            corners in prop::array::uniform4(0.0..1.0f64),
            seed: u32,
        ) {
            let depth = |at: usize| {
                // A few holes in a picture of any depths.
                let mixed = (at as u32 ^ seed).wrapping_mul(0x9e37_79b9) >> 8;
                if mixed.is_multiple_of(97) { 0.0 } else { mixed as f32 / (1 << 24) as f32 }
            };
            let depths = CellDepths::new(size, (0..size[0] * size[1]).map(depth).collect());
            let at = |share: f64, axis: usize| (share * size[axis] as f64) as usize;
            let [x0, x1] = [at(corners[0].min(corners[1]), 0), at(corners[0].max(corners[1]), 0)];
            let [y0, y1] = [at(corners[2].min(corners[3]), 1), at(corners[2].max(corners[3]), 1)];
            let found = depths.farthest([x0, y0], [x1, y1]);
            let cells = (y0..=y1).flat_map(|y| (x0..=x1).map(move |x| (x, y)));
            let exact = cells.map(|(x, y)| depth(y * size[0] + x)).fold(f32::INFINITY, f32::min);
            prop_assert!(found <= exact);
            if x1 - x0 < CELLS_ACROSS_MAX && y1 - y0 < CELLS_ACROSS_MAX {
                prop_assert_eq!(found, exact, "each cell of a small rectangle is looked at");
            }
        }
    }
}
