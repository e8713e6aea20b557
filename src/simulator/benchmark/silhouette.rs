//! The distance between the outlines of a scene in two pictures.

use super::distance_transform::{NONE, squared_distances};

/// The pixels of a picture in which anything is drawn in front of the background.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Coverage {
    width: usize,
    /// Row by row, from the top.
    is_covered: Vec<bool>,
}

impl Coverage {
    /// Returns the pixels that differ from those of a picture of the background alone. Both
    /// pictures are RGBA8 of `width` pixels a row, and of the same size.
    pub fn in_front_of(background: &[u8], picture: &[u8], width: u32) -> Self {
        let pixels = picture.chunks_exact(4).zip(background.chunks_exact(4));
        Self { width: width as usize, is_covered: pixels.map(|(a, b)| a != b).collect() }
    }

    /// Returns whether no background is seen, and so no outline.
    pub fn is_full(&self) -> bool {
        self.is_covered.iter().all(|covered| *covered)
    }

    /// Returns the largest distance by which the outline has to move to turn this coverage into
    /// the other one, in pixels; in either direction, and 0 if both are equal.
    ///
    /// Pixels that only one of the two covers form connected areas. An area goes away if the
    /// outline moves to the other's coverage, or if it closes over the area from its own
    /// background, as a feature does that is too small to be drawn, however far away the next
    /// covered pixel is. Each area counts by the shorter of both ways, measured at its worst pixel
    /// between centres of pixels. Full coverage of one and none of the other count as the diagonal
    /// of the picture.
    pub fn outline_distance_px(&self, other: &Self) -> f64 {
        if self == other {
            return 0.0;
        }
        self.distance_beyond(other).max(other.distance_beyond(self))
    }

    /// Returns the largest distance of an area that this covers and the other one does not.
    fn distance_beyond(&self, other: &Self) -> f64 {
        let background: Vec<bool> = self.is_covered.iter().map(|covered| !covered).collect();
        let to_other = squared_distances(&other.is_covered, self.width);
        let to_background = squared_distances(&background, self.width);
        let pairs = self.is_covered.iter().zip(&other.is_covered);
        let is_beyond = pairs.map(|(own, others)| *own && !others).collect();
        let mut largest = 0;
        for_each_area(is_beyond, self.width, |area| {
            let worst = |squares: &[u32]| area.iter().map(|&at| squares[at]).max().unwrap_or(0);
            largest = largest.max(worst(&to_other).min(worst(&to_background)));
        });
        if largest == NONE { self.diagonal_px() } else { f64::from(largest).sqrt() }
    }

    fn diagonal_px(&self) -> f64 {
        let height = self.is_covered.len().checked_div(self.width).unwrap_or(0);
        (self.width as f64).hypot(height as f64)
    }
}

/// Calls a function with the pixels of each area of a set; pixels that touch at a side or corner
/// are of one area.
fn for_each_area(mut is_member: Vec<bool>, width: usize, mut visit: impl FnMut(&[usize])) {
    let height = is_member.len().checked_div(width).unwrap_or(0);
    let mut area = Vec::new();
    for first in 0..is_member.len() {
        if !std::mem::take(&mut is_member[first]) {
            continue;
        }
        area.clear();
        area.push(first);
        let mut next = 0;
        while let Some(&at) = area.get(next) {
            next += 1;
            let (x, y) = (at % width, at / width);
            for near_y in y.saturating_sub(1)..(y + 2).min(height) {
                for near_x in x.saturating_sub(1)..(x + 2).min(width) {
                    let near = near_y * width + near_x;
                    if std::mem::take(&mut is_member[near]) {
                        area.push(near);
                    }
                }
            }
        }
        visit(&area);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn covering(width: usize, height: usize, covers: impl Fn(usize, usize) -> bool) -> Coverage {
        let is_covered = (0..width * height).map(|at| covers(at % width, at / width)).collect();
        Coverage { width, is_covered }
    }

    fn disc(x: f64, y: f64, radius: f64) -> Coverage {
        covering(80, 60, |px, py| (px as f64 - x).hypot(py as f64 - y) <= radius)
    }

    #[test]
    fn an_edge_that_moves_is_as_far_off_as_it_has_moved() {
        let edge = |at: usize| covering(40, 30, move |x, _| x < at);
        for moved in 0..8 {
            let (a, b) = (edge(20), edge(20 + moved));
            assert_eq!(a.outline_distance_px(&b), moved as f64);
            assert_eq!(b.outline_distance_px(&a), moved as f64);
        }
    }

    #[test]
    fn discs_of_two_radii_are_the_difference_apart() {
        for (small, large) in [(10.0, 11.0), (10.0, 13.5), (20.0, 26.0)] {
            let distance = disc(40.0, 30.0, small).outline_distance_px(&disc(40.0, 30.0, large));
            // Both outlines are rounded to pixels.
            assert!((distance - (large - small)).abs() <= 1.0, "{small}, {large}: {distance}");
        }
    }

    #[test]
    fn a_feature_that_vanishes_counts_by_half_its_width() {
        let none = covering(50, 50, |_, _| false);
        for width in [1, 2, 3, 6] {
            let bar = covering(50, 50, |x, _| (20..20 + width).contains(&x));
            let half = width.div_ceil(2) as f64;
            assert_eq!(bar.outline_distance_px(&none), half, "{width}");
            assert_eq!(none.outline_distance_px(&bar), half, "{width}");
            // A hole that closes, likewise.
            let hole = covering(50, 50, |x, _| !(20..20 + width).contains(&x));
            let full = covering(50, 50, |_, _| true);
            assert_eq!(hole.outline_distance_px(&full), half, "{width}");
        }
    }

    #[test]
    fn a_thin_spike_that_vanishes_counts_by_its_width_and_not_its_length() {
        let body = covering(60, 40, |x, _| x < 20);
        let with_spike = covering(60, 40, |x, y| x < 20 || (y == 15 && x < 50));
        assert_eq!(with_spike.outline_distance_px(&body), 1.0);
        // Beside an edge that moves by more, the edge counts.
        let moved = covering(60, 40, |x, y| x < 24 || (y == 15 && x < 50));
        // At the foot of the spike the background is a corner farther away.
        assert_eq!(moved.outline_distance_px(&body), 4.0_f64.hypot(1.0));
    }

    #[test]
    fn of_several_areas_the_worst_counts() {
        let edge_and_dot = |edge: usize, has_dot: bool| {
            covering(60, 40, move |x, y| x < edge || (has_dot && (40..45).contains(&x) && y < 5))
        };
        // The block of 5 × 5 pixels closes from its sides.
        let distance = edge_and_dot(10, true).outline_distance_px(&edge_and_dot(12, false));
        assert_eq!(distance, 3.0);
        let distance = edge_and_dot(10, true).outline_distance_px(&edge_and_dot(17, false));
        assert_eq!(distance, 7.0);
    }

    #[test]
    fn all_against_nothing_is_the_diagonal_and_equal_is_none() {
        let (full, none) = (covering(30, 40, |_, _| true), covering(30, 40, |_, _| false));
        assert_eq!(full.outline_distance_px(&none), 50.0);
        assert_eq!(full.outline_distance_px(&full), 0.0);
        assert_eq!(none.outline_distance_px(&none), 0.0);
    }

    #[test]
    fn coverage_is_all_that_differs_from_the_background() {
        let background = [9, 9, 9, 255, 8, 8, 8, 255];
        let picture = [9, 9, 9, 255, 8, 9, 8, 255];
        let coverage = Coverage::in_front_of(&background, &picture, 2);
        assert_eq!(coverage.is_covered, [false, true]);
    }
}
