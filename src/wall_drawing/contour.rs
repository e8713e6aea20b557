//! Outlines of regions that are known by a function, which says of a place that it is inside.

use std::collections::BTreeMap;

use glam::DVec2;

/// Bisections of the distance between two neighbouring places of the grid: to 1/4,096 of it.
const BISECTIONS: u32 = 12;

/// The places that are asked: a grid of `cells` + 1 places along each axis of a rectangle, with a
/// ring around it that is always outside.
struct Grid {
    low: DVec2,
    high: DVec2,
    cells: usize,
}

/// A side of a cell, by its upper left place: 0 for the side to the right of it, 1 for the one
/// below.
type Side = (usize, usize, u8);

impl Grid {
    fn count(&self) -> usize {
        self.cells + 3
    }

    fn place(&self, x: usize, y: usize) -> DVec2 {
        let part = |at: usize| at.saturating_sub(1).min(self.cells) as f64 / self.cells as f64;
        self.low + (self.high - self.low) * DVec2::new(part(x), part(y))
    }

    fn is_around(&self, x: usize, y: usize) -> bool {
        x == 0 || y == 0 || x > self.cells + 1 || y > self.cells + 1
    }
}

/// Returns the closed outlines of the part of a rectangle for which `is_inside` holds, holes among
/// them, by marching squares over `cells` × `cells` cells (at least 1 each way). Parts and gaps
/// that are smaller than a cell may be missed; borders are found to 1/4,096 of a cell.
pub(super) fn contours(
    [low, high]: [DVec2; 2],
    cells: usize,
    is_inside: impl Fn(DVec2) -> bool,
) -> Vec<Vec<DVec2>> {
    let grid = Grid { low, high, cells: cells.max(1) };
    let count = grid.count();
    let mut inside = vec![false; count * count];
    for y in 1..count - 1 {
        for x in 1..count - 1 {
            inside[y * count + x] = is_inside(grid.place(x, y));
        }
    }
    let mut next: BTreeMap<Side, Side> = BTreeMap::new();
    for y in 0..count - 1 {
        for x in 0..count - 1 {
            let corners = [(x, y), (x + 1, y), (x + 1, y + 1), (x, y + 1)];
            let is_in = corners.map(|(x, y)| inside[y * count + x]);
            let sides: [Side; 4] = [(x, y, 0), (x + 1, y, 1), (x, y + 1, 0), (x, y, 1)];
            for at in 0..4 {
                // Around the cell, from where the outside ends to where it begins again.
                if is_in[at] || !is_in[(at + 1) % 4] {
                    continue;
                }
                let leaves = (1..4).map(|step| (at + step) % 4);
                let mut leaves = leaves.filter(|to| is_in[*to] && !is_in[(to + 1) % 4]);
                if let Some(to) = leaves.next() {
                    next.insert(sides[to], sides[at]);
                }
            }
        }
    }
    let mut loops = Vec::new();
    while let Some((first, mut side)) = next.pop_first() {
        let mut outline = vec![crossing(&grid, &inside, first, &is_inside)];
        while side != first {
            outline.push(crossing(&grid, &inside, side, &is_inside));
            let Some(following) = next.remove(&side) else { break };
            side = following;
        }
        loops.push(outline);
    }
    loops
}

/// Returns the place of a side at which the region ends.
fn crossing(grid: &Grid, inside: &[bool], side: Side, is_inside: &impl Fn(DVec2) -> bool) -> DVec2 {
    let (x, y, along) = side;
    let (a, b) = ((x, y), if along == 0 { (x + 1, y) } else { (x, y + 1) });
    let is_a = inside[a.1 * grid.count() + a.0];
    let (within, beyond) = if is_a { (a, b) } else { (b, a) };
    let (mut low, mut high) = (grid.place(within.0, within.1), grid.place(beyond.0, beyond.1));
    if !grid.is_around(beyond.0, beyond.1) {
        for _ in 0..BISECTIONS {
            let middle = low.midpoint(high);
            let end = if is_inside(middle) { &mut low } else { &mut high };
            *end = middle;
        }
    }
    low.midpoint(high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wall_drawing::polygon::area;

    #[test]
    fn a_circle_has_its_area_and_a_ring_has_a_hole() {
        let ends = [DVec2::splat(-2.0), DVec2::splat(2.0)];
        let circle = contours(ends, 40, |at| at.length() < 1.5);
        assert_eq!(circle.len(), 1);
        let due = std::f64::consts::PI * 2.25;
        assert!((area(&circle[0]).abs() - due).abs() < 0.02, "{}", area(&circle[0]));
        assert!(circle[0].iter().all(|at| (at.length() - 1.5).abs() < 1e-3));
        let ring = contours(ends, 40, |at| (0.5..1.5).contains(&at.length()));
        assert_eq!(ring.len(), 2);
        assert!(area(&ring[0]) * area(&ring[1]) < 0.0, "a hole turns the other way");
    }

    #[test]
    fn all_of_a_rectangle_ends_at_its_sides_and_nothing_has_no_outline() {
        let ends = [DVec2::ZERO, DVec2::new(3.0, 1.0)];
        let all = contours(ends, 4, |_| true);
        assert_eq!(all.len(), 1);
        let (low, high) = all[0]
            .iter()
            .fold((DVec2::INFINITY, DVec2::NEG_INFINITY), |(a, b), at| (a.min(*at), b.max(*at)));
        assert_eq!([low, high], ends);
        assert!(contours(ends, 4, |_| false).is_empty());
        // Corners that touch stay apart.
        let touching = contours(ends, 2, |at| (at.x < 1.0) == (at.y < 0.3));
        assert!(touching.iter().map(|part| area(part).abs()).sum::<f64>() > 0.5);
    }
}
