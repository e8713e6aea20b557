//! A coarse table of a grid's lit and unlit cells, so that a part of the grid is judged by blocks
//! of cells: a view that moves asks for nearly all of a map in each frame.

use glam::{UVec2, Vec3};

use super::WarpGrid;

/// Cells of a block, across and down.
const SIDE: u32 = 32;

/// Bit of a block that has lit cells.
const LIT: u8 = 1;

/// Bit of a block that has unlit cells.
const UNLIT: u8 = 2;

/// Bits of a block that has both.
const BOTH: u8 = LIT | UNLIT;

/// For each block of a grid's cells, [`LIT`] and [`UNLIT`]; a thousandth of the grid's size.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct LitBlocks {
    /// Blocks of a row.
    across: usize,
    /// Rows from the top.
    kinds: Vec<u8>,
}

impl LitBlocks {
    /// The table of a grid of this size with these values, rows from the top.
    pub fn new(size: UVec2, values: &[Vec3]) -> Self {
        let across = size.x.div_ceil(SIDE) as usize;
        let mut kinds = vec![0; across * size.y.div_ceil(SIDE) as usize];
        for (y, row) in values.chunks(size.x.max(1) as usize).enumerate() {
            let blocks = kinds.iter_mut().skip(y / SIDE as usize * across);
            for (kind, cells) in blocks.zip(row.chunks(SIDE as usize)) {
                *kind |= kinds_of(cells);
            }
        }
        Self { across, kinds }
    }
}

impl WarpGrid {
    /// Returns whether some of the cells from `first` to `end`, both of them included, are lit and
    /// others are not. Values are read only of blocks that have both kinds.
    pub(super) fn has_both(&self, first: UVec2, end: UVec2) -> bool {
        let (from, to) = (first / SIDE, end / SIDE);
        let mut found = 0;
        for (x, y) in (from.y..=to.y).flat_map(|y| (from.x..=to.x).map(move |x| (x, y))) {
            let kinds = self.lit.kinds[y as usize * self.lit.across + x as usize];
            found |= if kinds == BOTH {
                let begin = UVec2::new(x, y) * SIDE;
                self.kinds_between(first.max(begin), end.min(begin + (SIDE - 1)))
            } else {
                kinds
            };
            if found == BOTH {
                return true;
            }
        }
        false
    }

    /// The kinds of the cells from `first` to `end`, both of them included, cell by cell.
    fn kinds_between(&self, first: UVec2, end: UVec2) -> u8 {
        let mut found = 0;
        for y in first.y..=end.y {
            let row = y as usize * self.size.x as usize;
            found |= kinds_of(&self.values[row + first.x as usize..=row + end.x as usize]);
            if found == BOTH {
                break;
            }
        }
        found
    }
}

fn kinds_of(cells: &[Vec3]) -> u8 {
    cells.iter().fold(0, |kinds, cell| kinds | if cell.is_nan() { UNLIT } else { LIT })
}
