//! Upper bounds of the largest distance from one surface to another: half of the Hausdorff
//! distance, which is the larger one of both directions.
//!
//! The distance to a triangle is a convex function of the point, since a triangle is convex. Its
//! maximum over a convex polygon is thus at a corner of the polygon, and the least of these maxima
//! over all triangles bounds the distance of every point of the polygon to the surface. The bound
//! is tight if one triangle is nearest to the whole polygon. So a triangle of the first surface is
//! divided along the edges of those of the second one, and where that is not enough, into halves,
//! until the bound is near the largest distance of any point that was looked at. M. Guthe,
//! P. Borodin, R. Klein, *Fast and accurate Hausdorff distance calculation between meshes* (2005),
//! divide into quarters; along the edges, what lies flat on the other surface takes no division at
//! all.
//!
//! Returned bounds are proven up to the rounding of f64, which the caller adds.

use foldhash::HashMap;
use glam::DVec3;

use super::convex_polygon::ConvexPolygon;
use super::triangle_set::{Nearest, TriangleSet};

/// A bound may be so much larger than the largest distance that was found, as a share of it.
const EXCESS: f64 = 0.05;

/// Parts that each triangle may be divided into on average. Beyond, bounds stay as they are.
const PARTS_MAX: usize = 64;

/// Parts that any number of triangles may be divided into.
const PARTS_MIN: usize = 4096;

/// The largest distance so far, of several surfaces that are looked at in turn.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Deviation {
    /// The largest distance of a point that was looked at.
    pub lower: f64,
    /// No point is farther.
    pub upper: f64,
}

/// Raises `deviation` to the largest distance of any point of `triangles` to the surface `to`.
/// `nearest` holds for each point that they name the triangle of `to` that is nearest to it. Bounds
/// below `negligible` are not made tighter.
pub(super) fn measure(
    deviation: &mut Deviation,
    points: &[DVec3],
    triangles: &[[u32; 3]],
    nearest: &HashMap<u32, Nearest>,
    to: &TriangleSet,
    negligible: f64,
) {
    let corners = triangles.iter().flatten();
    let farthest = corners.map(|point| nearest[point].distance).fold(0.0, f64::max);
    deviation.lower = deviation.lower.max(farthest);
    let budget = PARTS_MIN + PARTS_MAX * triangles.len();
    let mut search = Search { deviation, to, negligible, budget, work: Vec::new() };
    let mut outside = Vec::new();
    for triangle in triangles {
        let corners = triangle.map(|point| points[point as usize]);
        let candidates = triangle.map(|point| nearest[&point].triangle);
        if !candidates.iter().any(|candidate| search.accept(&corners, *candidate)) {
            search.work.push((ConvexPolygon::from_triangle(&corners), candidates[0]));
            search.divide_all(&mut outside);
        }
    }
}

struct Search<'a> {
    deviation: &'a mut Deviation,
    to: &'a TriangleSet,
    negligible: f64,
    /// Polygons that may yet be divided.
    budget: usize,
    /// Polygons without a bound, each with a triangle that may be near.
    work: Vec<(ConvexPolygon, u32)>,
}

impl Search<'_> {
    fn bound(&self, corners: &[DVec3], triangle: u32) -> f64 {
        let distances = corners.iter().map(|corner| self.to.distance(*corner, triangle));
        distances.fold(0.0, f64::max)
    }

    /// Takes the bound that a triangle gives for a polygon if it is tight enough; returns whether
    /// it is.
    fn accept(&mut self, corners: &[DVec3], triangle: u32) -> bool {
        let limit = (self.deviation.lower * (1.0 + EXCESS)).max(self.negligible);
        let mut bound = self.deviation.upper;
        for corner in corners {
            bound = bound.max(self.to.distance(*corner, triangle));
            // `upper` itself may be above the limit, after parts were too many.
            if bound > limit.max(self.deviation.upper) {
                return false;
            }
        }
        self.deviation.upper = bound;
        true
    }

    fn divide_all(&mut self, outside: &mut Vec<ConvexPolygon>) {
        while let Some((polygon, guess)) = self.work.pop() {
            if self.budget == 0 {
                let bound = self.bound(polygon.corners(), guess);
                self.deviation.upper = self.deviation.upper.max(bound);
                continue;
            }
            self.budget -= 1;
            let near = self.look_at(polygon.middle(), guess);
            if self.accept(polygon.corners(), near) {
                continue;
            }
            match polygon.divide(self.to.corners(near), outside) {
                Some(inside) => {
                    self.work.extend(outside.drain(..).map(|part| (part, near)));
                    self.bound_or_halve(&inside, near);
                }
                None => self.work.extend(polygon.halves().map(|half| (half, near))),
            }
        }
    }

    /// Bounds what projects onto a triangle. Halves it if another triangle is nearer to some of it.
    fn bound_or_halve(&mut self, polygon: &ConvexPolygon, near: u32) {
        if self.accept(polygon.corners(), near) {
            return;
        }
        let distance = |corner: &&DVec3| self.to.distance(**corner, near);
        let by_distance = |one: &&DVec3, two: &&DVec3| distance(one).total_cmp(&distance(two));
        if let Some(farthest) = polygon.corners().iter().max_by(by_distance).copied() {
            self.look_at(farthest, near);
        }
        if !self.accept(polygon.corners(), near) {
            self.work.extend(polygon.halves().map(|half| (half, near)));
        }
    }

    /// Returns the triangle nearest to a point, whose distance the largest one is at least.
    fn look_at(&mut self, point: DVec3, guess: u32) -> u32 {
        let near = self.to.nearest(point, guess);
        self.deviation.lower = self.deviation.lower.max(near.distance);
        near.triangle
    }
}
