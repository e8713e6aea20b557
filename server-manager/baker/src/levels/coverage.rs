//! The extent that a surface covers, seen from all around: a level that covers far less than the
//! finest one would be gone from some sides.
//!
//! A thin log that has become a strip is within the error from its front, and nothing from behind,
//! where it is culled, or from its edge. Of one log the outline moves by no more than is allowed;
//! of a wall of logs nothing would be left. So what is one body stays one, down to some triangles,
//! until it is small enough to be left out as a whole.

use glam::{DVec2, DVec3};

use super::chart;

/// Directions along each of three axes: against it, across it, and along it.
const STEPS: [f64; 3] = [-1.0, 0.0, 1.0];

/// Cells along each side of a picture: a triangle covers those whose middles are in it.
const CELLS: usize = 24;

/// A level may cover no less than this share of what was covered: a round log that becomes a prism
/// of three sides still covers two thirds of its width from its narrowest side.
const SHARE_MIN: f64 = 0.5;

/// From where less is seen than this share of the most that is, nothing needs to be: a flat field
/// may lose its bumps.
const EDGE_ON: f64 = 0.1;

/// Parts of a body at most. Of many parts, each may be left out by its own width.
const PARTS_MAX: usize = 8;

/// The areas that triangles cover as they are seen from all around, where back faces are not seen.
#[derive(Clone, Debug)]
pub(super) struct Coverage {
    frames: Vec<Frame>,
    /// The area that is seen in each of them, squared units.
    areas: Vec<f64>,
}

/// A picture along parallel rays.
#[derive(Clone, Copy, Debug)]
struct Frame {
    /// Unit vectors across the rays, as who looks sees them.
    right: DVec3,
    up: DVec3,
    /// The lower left corner of the rectangle around what is seen, and its sides.
    low: DVec2,
    size: DVec2,
}

impl Coverage {
    /// The coverage of triangles over welded vertices; `None` if they are no body, or of so many
    /// parts that each counts by itself.
    pub fn new(triangles: &[[u32; 3]], position: impl Fn(u32) -> DVec3) -> Option<Self> {
        if parts(triangles) > PARTS_MAX {
            return None;
        }
        let corners: Vec<[DVec3; 3]> = triangles.iter().map(|of| of.map(&position)).collect();
        let axes = axes(&corners)?;
        let mut frames = Vec::new();
        for [x, y, z] in directions() {
            let toward = (axes[0] * x + axes[1] * y + axes[2] * z).normalize();
            // Across the longest axis, so that a thin body fills its rectangle.
            let right = axes[0].reject_from_normalized(toward).try_normalize().unwrap_or(axes[1]);
            let up = toward.cross(right);
            let places = corners.iter().flatten().map(|at| DVec2::new(at.dot(right), at.dot(up)));
            let empty = (DVec2::INFINITY, DVec2::NEG_INFINITY);
            let (low, high) = places.fold(empty, |(low, high), at| (low.min(at), high.max(at)));
            let size = high - low;
            if size.is_finite() && size.min_element() > 0.0 {
                frames.push(Frame { right, up, low, size });
            }
        }
        let areas: Vec<f64> = frames.iter().map(|frame| frame.area(&corners)).collect();
        Some(Self { frames, areas })
    }

    /// Returns whether other triangles cover about as much from each side.
    pub fn is_kept_by(&self, triangles: &[[DVec3; 3]]) -> bool {
        let most = self.areas.iter().copied().fold(0.0, f64::max);
        self.frames.iter().zip(&self.areas).all(|(frame, area)| {
            *area < most * EDGE_ON || frame.area(triangles) >= area * SHARE_MIN
        })
    }
}

impl Frame {
    /// The area of the cells that triangles cover with their fronts.
    fn area(&self, triangles: &[[DVec3; 3]]) -> f64 {
        let mut is_covered = [[false; CELLS]; CELLS];
        for corners in triangles {
            let [a, b, c] = corners.map(|at| {
                let at = DVec2::new(at.dot(self.right), at.dot(self.up));
                (at - self.low) / self.size * CELLS as f64 - 0.5
            });
            // Fronts go around counter-clockwise.
            if (b - a).perp_dot(c - a) > 0.0 {
                cover(&mut is_covered, [a, b, c]);
            }
        }
        let covered = is_covered.iter().flatten().filter(|is| **is).count();
        covered as f64 * self.size.element_product() / (CELLS * CELLS) as f64
    }
}

/// Covers the cells whose middles are in a triangle, which lie at whole numbers.
fn cover(is_covered: &mut [[bool; CELLS]; CELLS], corners: [DVec2; 3]) {
    let last = (CELLS - 1) as f64;
    let [a, b, c] = corners;
    let (low, high) = (a.min(b).min(c).ceil(), a.max(b).max(c).floor());
    if !(low.is_finite() && high.is_finite()) {
        return;
    }
    let (low, high) = (low.max(DVec2::ZERO), high.min(DVec2::splat(last)));
    let edges = [(a, b), (b, c), (c, a)];
    let mut y = low.y;
    while y <= high.y {
        let mut x = low.x;
        while x <= high.x {
            let at = DVec2::new(x, y);
            if edges.iter().all(|(from, to)| (to - from).perp_dot(at - from) >= 0.0) {
                is_covered[y as usize][x as usize] = true;
            }
            x += 1.0;
        }
        y += 1.0;
    }
}

/// The 26 directions to the faces, edges and corners of a cube.
fn directions() -> impl Iterator<Item = [f64; 3]> {
    let all = STEPS.into_iter().flat_map(|x| STEPS.into_iter().map(move |y| [x, y]));
    let all = all.flat_map(|[x, y]| STEPS.into_iter().map(move |z| [x, y, z]));
    all.filter(|of| *of != [0.0; 3])
}

/// Three axes across each other, the first one along the longest way through triangles; `None` if
/// all are in one place.
fn axes(triangles: &[[DVec3; 3]]) -> Option<[DVec3; 3]> {
    let points = || triangles.iter().flatten().copied();
    let farthest = |from: DVec3| {
        points().max_by(|a, b| a.distance_squared(from).total_cmp(&b.distance_squared(from)))
    };
    let one = farthest(points().next()?)?;
    let first = (farthest(one)? - one).try_normalize()?;
    let across = |at: DVec3| (at - one).reject_from_normalized(first);
    let by_way = |a: &DVec3, b: &DVec3| a.length_squared().total_cmp(&b.length_squared());
    let second = points().map(across).max_by(by_way).and_then(DVec3::try_normalize);
    let second = second.unwrap_or_else(|| first.any_orthonormal_vector());
    Some([first, second, first.cross(second)])
}

/// The number of connected parts of triangles.
fn parts(triangles: &[[u32; 3]]) -> usize {
    let mut vertices: Vec<u32> = triangles.iter().flatten().copied().collect();
    vertices.sort_unstable();
    vertices.dedup();
    let mut parents: Vec<u32> = (0..vertices.len() as u32).collect();
    let local = |at: u32| vertices.partition_point(|known| *known < at) as u32;
    for corners in triangles {
        chart::join(&mut parents, corners.map(local));
    }
    (0..parents.len() as u32).filter(|at| chart::root(&mut parents, *at) == *at).count()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use glam::DQuat;

    use super::*;

    /// A log of so many sides, with its ends, along an axis that is turned.
    fn log(sides: u32, turn: DQuat) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let at = |side: u32, x: f64| {
            let (sine, cosine) = (TAU * f64::from(side) / f64::from(sides)).sin_cos();
            turn * DVec3::new(x, 0.15 * cosine, 0.15 * sine)
        };
        let points = (0..sides).flat_map(|side| [at(side, 0.0), at(side, 12.0)]).collect();
        let mut triangles = Vec::new();
        for side in 0..sides {
            let [a, b] = [2 * side, 2 * ((side + 1) % sides)];
            triangles.extend([[a, b, b + 1], [a, b + 1, a + 1]]);
            if side > 1 {
                triangles.extend([[0, 2 * side, 2 * side - 2], [1, 2 * side - 1, 2 * side + 1]]);
            }
        }
        (points, triangles)
    }

    #[test]
    fn a_log_may_become_a_prism_and_no_strip() {
        for turn in [DQuat::IDENTITY, DQuat::from_scaled_axis(DVec3::new(0.3, 1.1, -0.7))] {
            let (points, triangles) = log(24, turn);
            let coverage = Coverage::new(&triangles, |at| points[at as usize]).expect("a body");
            let is_kept = |triangles: &[[u32; 3]], points: &[DVec3]| {
                let corners = |of: &[u32; 3]| of.map(|at| points[at as usize]);
                coverage.is_kept_by(&triangles.iter().map(corners).collect::<Vec<_>>())
            };
            assert!(is_kept(&triangles, &points));
            let (prism, of_prism) = log(3, turn);
            assert!(is_kept(&of_prism, &prism), "a prism of three sides");
            assert!(!is_kept(&of_prism[..2], &prism), "a strip on one side");
            let [a, b] = [[0, 2, 3], [0, 3, 1]];
            let both = [a, b, [0, 3, 2], [0, 1, 3]];
            assert!(!is_kept(&both, &prism), "a strip with two sides, seen from its edge");
            assert!(!is_kept(&[], &prism));
        }
    }

    #[test]
    fn a_field_may_lose_its_bumps_and_many_parts_each_by_itself() {
        let place = |x: u32, y: u32| {
            let bump = if (x + y).is_multiple_of(2) { 0.2 } else { 0.0 };
            DVec3::new(x.into(), y.into(), bump)
        };
        let points: Vec<DVec3> = (0..121).map(|at| place(at % 11, at / 11)).collect();
        let cell = |at: u32| {
            let first = at / 10 * 11 + at % 10;
            [[first, first + 1, first + 12], [first, first + 12, first + 11]]
        };
        let triangles: Vec<[u32; 3]> = (0..100).flat_map(cell).collect();
        let coverage = Coverage::new(&triangles, |at| points[at as usize]).expect("a body");
        let [a, b, c, d] = [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]]
            .map(|[x, y]| DVec3::new(x, y, 0.1));
        assert!(coverage.is_kept_by(&[[a, b, c], [a, c, d]]));
        assert!(!coverage.is_kept_by(&[[a, c, b], [a, d, c]]), "upside down");
        let apart: Vec<[u32; 3]> = (0..9).map(|at| [3 * at, 3 * at + 1, 3 * at + 2]).collect();
        let spread = |at: u32| DVec3::new(at.into(), (at * at % 7).into(), (at % 3).into());
        assert!(Coverage::new(&apart, spread).is_none());
        assert!(Coverage::new(&apart[..8], spread).is_some());
        assert!(Coverage::new(&[[0, 0, 0]], |_| DVec3::ONE).is_none(), "all in one place");
        assert!(Coverage::new(&[], |_| DVec3::ONE).is_none());
    }
}
