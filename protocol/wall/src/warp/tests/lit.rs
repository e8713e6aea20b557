//! The table of a grid's lit cells, against the cells themselves.

use std::collections::BTreeSet;

use glam::{DVec2, UVec2, Vec3};
use proptest::array::uniform4;
use proptest::collection::vec;
use proptest::prelude::{any, prop_assert_eq, proptest};

use super::super::WarpGrid;
use crate::warp_mesh::reach::CellReach;

/// Returns the answer of [`WarpGrid::is_mixed`] from every value of the grid.
fn is_mixed_by_cells(grid: &WarpGrid, low: DVec2, high: DVec2) -> bool {
    let (scale, last) = (grid.size.as_dvec2(), (grid.size - 1).as_dvec2());
    let first = (low * scale - 0.5).floor().min(last - 1.0).max(DVec2::ZERO);
    let end = (high * scale - 0.5).ceil().max(first + 1.0).min(last);
    let is_around = |index: u32| {
        let at = UVec2::new(index % grid.size.x, index / grid.size.x).as_dvec2();
        at.cmpge(first).all() && at.cmple(end).all()
    };
    let around = (0..).zip(&grid.values).filter(|(index, _)| is_around(*index));
    around.map(|(_, value)| value.is_nan()).collect::<BTreeSet<_>>().len() == 2
}

/// A grid whose cells are lit or not within each of these rectangles, and the reverse around it.
fn holed(size: UVec2, is_lit: bool, rects: &[[f64; 4]]) -> WarpGrid {
    let value = |index: u32| {
        let at = UVec2::new(index % size.x, index / size.x).as_dvec2() / size.as_dvec2();
        let is_in = |[x, y, w, h]: &[f64; 4]| {
            let (low, by) = (DVec2::new(*x, *y), DVec2::new(w * w * 0.5, h * h * 0.5));
            at.cmpge(low).all() && at.cmplt(low + by).all()
        };
        let count = rects.iter().filter(|rect| is_in(rect)).count();
        if count.is_multiple_of(2) == is_lit {
            Vec3::ONE
        } else if index.is_multiple_of(3) {
            Vec3::splat(f32::NAN)
        } else {
            Vec3::ZERO.with_y(f32::NAN)
        }
    };
    WarpGrid::new(size, (0..size.element_product()).map(value).collect())
}

proptest! {
    /// Views wide and thin, in the picture and beside it, on grids of holes and of islands.
    #[test]
    fn blocks_say_what_their_cells_say(
        (width, height) in (1u32..150, 1u32..150),
        is_lit in any::<bool>(),
        rects in vec(uniform4(0.0..1.0f64), 0..6),
        views in vec(uniform4(0.0..1.0f64), 1..12),
    ) {
        let grid = holed(UVec2::new(width, height), is_lit, &rects);
        for [x, y, w, h] in views {
            let low = DVec2::new(x, y) * 1.6 - 0.3;
            let high = low + DVec2::new(w.powi(4), h.powi(4)) * 0.9;
            let due = is_mixed_by_cells(&grid, low, high);
            prop_assert_eq!(grid.is_mixed(CellReach::Within { low, high }), due);
        }
    }
}

/// A view that moves over a map costs as much as the map has blocks.
#[test]
fn values_of_even_blocks_are_not_read() {
    let size = UVec2::splat(256);
    let hole = [100.0 / 256.0, 100.0 / 256.0, 0.2, 0.2];
    let mut grid = holed(size, true, &[hole]);
    let reach = |low: f64, high: f64| CellReach::Within {
        low: DVec2::splat(low),
        high: DVec2::splat(high),
    };
    assert!(grid.is_mixed(reach(0.0, 1.0)), "the hole is seen");
    assert!(!grid.is_mixed(reach(0.6, 1.0)), "beside the hole");
    grid.values.clear();
    assert!(!grid.is_mixed(reach(0.6, 1.0)), "no value is asked");
}
