//! Rectangles of whole pixels on a canvas: grids of tiles, overlaps, and what no tile covers.
//!
//! All rectangles are in pixels from the canvas's upper left, rows downwards. Callers check first
//! that they lie within a canvas, so that no sum here leaves `u32`.

use glam::UVec2;

/// A rectangle of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Rect {
    /// The upper left pixel.
    pub origin: UVec2,
    /// Width and height.
    pub size: UVec2,
}

impl Rect {
    /// The first column and row behind the rectangle.
    pub fn end(self) -> UVec2 {
        self.origin.saturating_add(self.size)
    }

    /// Returns the part that both rectangles cover, if that is a pixel or more.
    pub fn intersection(self, other: Self) -> Option<Self> {
        let origin = self.origin.max(other.origin);
        let end = self.end().min(other.end());
        origin.cmplt(end).all().then(|| Self { origin, size: end - origin })
    }

    /// Returns whether the rectangle lies on the canvas with all its pixels.
    pub fn lies_on(self, canvas: UVec2) -> bool {
        self.end().cmple(canvas).all() && self.end() == self.origin.wrapping_add(self.size)
    }

    /// Returns the number of its pixels.
    pub fn area(self) -> u64 {
        u64::from(self.size.x) * u64::from(self.size.y)
    }
}

/// The gap in whole pixels that a bezel of `bezel_m` metres takes, rounded to an even number so
/// that tiles begin at even pixels; `None` where the bezels leave no room for the tiles.
///
/// `side_m` is the whole side, bezels included, that holds `tiles` tiles of `tile_px` pixels.
pub(super) fn gap_pixels(side_m: f64, tiles: u32, tile_px: u32, bezel_m: f64) -> Option<u32> {
    let lit_m = side_m - f64::from(tiles - 1) * bezel_m;
    let pitch_m = lit_m / (f64::from(tiles) * f64::from(tile_px));
    // `>` and not `<=`, so that NaN is no room either.
    (lit_m > 0.0 && pitch_m > 0.0)
        .then(|| ((bezel_m / pitch_m / 2.0).round() as u32).saturating_mul(2))
}

/// The canvas of a grid whose tiles begin `step` after each other, or `None` beyond `u32`. Tiles
/// have gaps between them where the step is longer than they are, and overlap where it is shorter.
pub(super) fn grid_canvas(grid: UVec2, tile: UVec2, step: UVec2) -> Option<UVec2> {
    let side = |tiles: u32, tile_px: u32, step_px: u32| {
        tiles.checked_sub(1)?.checked_mul(step_px)?.checked_add(tile_px)
    };
    Some(UVec2::new(side(grid.x, tile.x, step.x)?, side(grid.y, tile.y, step.y)?))
}

/// The tiles of a grid whose canvas was checked, row by row from the upper left.
pub(super) fn grid_tiles(grid: UVec2, tile: UVec2, step: UVec2) -> impl Iterator<Item = Rect> {
    (0..grid.y).flat_map(move |row| {
        (0..grid.x).map(move |column| Rect { origin: UVec2::new(column, row) * step, size: tile })
    })
}

/// The first two rectangles that overlap, by index, and what both cover.
pub(super) fn overlap(rects: &[Rect]) -> Option<(usize, usize, Rect)> {
    rects.iter().enumerate().find_map(|(second, rect)| {
        rects[..second]
            .iter()
            .enumerate()
            .find_map(|(first, other)| rect.intersection(*other).map(|both| (first, second, both)))
    })
}

/// Returns the area that none of the rectangles covers, as rectangles without overlap, from the top
/// down.
///
/// A sweep over the rows where something begins or ends: between two such rows the picture is
/// the same in each row, so one pass over the sorted intervals finds the gaps.
pub(super) fn gaps(canvas: UVec2, covered: &[Rect]) -> Vec<Rect> {
    let mut rows: Vec<u32> = covered.iter().flat_map(|r| [r.origin.y, r.end().y]).collect();
    rows.extend([0, canvas.y]);
    rows.sort_unstable();
    rows.dedup();
    let mut done = Vec::new();
    let mut open: Vec<Rect> = Vec::new();
    for slab in rows.windows(2) {
        let found = slab_gaps(canvas.x, slab[0], slab[1], covered);
        let mut next = Vec::with_capacity(found.len());
        for mut gap in found {
            // A gap of the same columns right above grows downwards instead of starting anew.
            let above =
                open.iter().position(|o| o.origin.x == gap.origin.x && o.size.x == gap.size.x);
            if let Some(above) = above.map(|index| open.swap_remove(index)) {
                gap = Rect { origin: above.origin, size: above.size + UVec2::new(0, gap.size.y) };
            }
            next.push(gap);
        }
        done.append(&mut open);
        open = next;
    }
    done.append(&mut open);
    done.sort_unstable_by_key(|gap| (gap.origin.y, gap.origin.x));
    done
}

/// The gaps between `top` and `bottom`, rows between which no rectangle begins or ends.
fn slab_gaps(width: u32, top: u32, bottom: u32, covered: &[Rect]) -> Vec<Rect> {
    let mut spans: Vec<(u32, u32)> = covered
        .iter()
        .filter(|r| r.origin.y <= top && r.end().y >= bottom)
        .map(|r| (r.origin.x, r.end().x))
        .collect();
    spans.sort_unstable();
    spans.push((width, width));
    let mut gaps = Vec::new();
    let mut reached = 0;
    for (begin, end) in spans {
        if begin > reached {
            let size = UVec2::new(begin - reached, bottom - top);
            gaps.push(Rect { origin: UVec2::new(reached, top), size });
        }
        reached = reached.max(end);
    }
    gaps
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rect(x: u32, y: u32, width: u32, height: u32) -> Rect {
        Rect { origin: UVec2::new(x, y), size: UVec2::new(width, height) }
    }

    #[test]
    fn a_bezel_becomes_the_nearest_even_number_of_pixels() {
        // Two tiles of 100 pixels on 2.02 m with 2 cm between them: 1 cm per pixel.
        assert_eq!(gap_pixels(2.02, 2, 100, 0.02), Some(2));
        assert_eq!(gap_pixels(2.029, 2, 100, 0.029), Some(2));
        assert_eq!(gap_pixels(2.031, 2, 100, 0.031), Some(4));
        assert_eq!(gap_pixels(2.0, 2, 100, 0.0), Some(0));
    }

    #[test]
    fn bezels_that_leave_no_room_are_none() {
        assert_eq!(gap_pixels(2.0, 3, 100, 1.0), None);
        assert_eq!(gap_pixels(2.0, 3, 100, f64::NAN), None);
        // A sliver of room: a gap beyond any canvas, but no overflow.
        assert!(gap_pixels(2.0, 2, 100, 2.0 - 1e-15).is_some_and(|gap| gap > 1 << 30));
    }

    #[test]
    fn a_grid_covers_its_canvas_but_for_the_gaps() {
        let (grid, tile, step) = (UVec2::new(3, 2), UVec2::new(10, 20), UVec2::new(12, 24));
        let canvas = grid_canvas(grid, tile, step);
        assert_eq!(canvas, Some(UVec2::new(34, 44)));
        let tiles: Vec<Rect> = grid_tiles(grid, tile, step).collect();
        assert_eq!(tiles[4], rect(12, 24, 10, 20));
        assert_eq!(overlap(&tiles), None);
        let gaps = gaps(UVec2::new(34, 44), &tiles);
        let covered: u64 = gaps.iter().chain(&tiles).map(|r| r.area()).sum();
        assert_eq!(covered, 34 * 44);
        assert!(gaps.contains(&rect(0, 20, 34, 4)), "{gaps:?}");
    }

    #[test]
    fn a_grid_beyond_u32_has_no_canvas() {
        let huge = UVec2::splat(u32::MAX);
        assert_eq!(grid_canvas(huge, huge, huge), None);
        assert_eq!(grid_canvas(UVec2::ZERO, huge, huge), None);
    }

    #[test]
    fn an_overlap_names_both_and_the_rectangle() {
        let rects = [rect(0, 0, 10, 10), rect(10, 0, 10, 10), rect(8, 9, 4, 4)];
        assert_eq!(overlap(&rects), Some((0, 2, rect(8, 9, 2, 1))));
    }

    #[test]
    fn gaps_with_the_same_columns_are_one() {
        let covered = [rect(0, 0, 5, 10), rect(8, 0, 2, 4), rect(8, 4, 2, 6)];
        assert_eq!(gaps(UVec2::new(10, 10), &covered), [rect(5, 0, 3, 10)]);
        assert_eq!(gaps(UVec2::new(10, 10), &[]), [rect(0, 0, 10, 10)]);
        assert_eq!(gaps(UVec2::new(10, 10), &[rect(0, 0, 10, 10)]), []);
    }

    #[test]
    fn a_rectangle_that_wraps_lies_on_no_canvas() {
        assert!(!rect(u32::MAX, 0, 2, 1).lies_on(UVec2::splat(u32::MAX)));
        assert!(rect(0, 0, 7, 7).lies_on(UVec2::splat(7)));
        assert!(!rect(1, 0, 7, 7).lies_on(UVec2::splat(7)));
    }
}
