//! Triangles of which the nearest to a point is found: f64.

use std::convert::Infallible;
use std::ops::ControlFlow;

use glam::DVec3;
use polyptych_wall::triangle_bvh::TriangleBvh;
use polyptych_wall::triangle_distance::nearest_on_triangle;

/// Triangles over points, with a tree over them; at least one.
#[derive(Debug)]
pub(super) struct TriangleSet<'a> {
    points: &'a [DVec3],
    triangles: &'a [[u32; 3]],
    tree: TriangleBvh,
}

/// A triangle and its distance to a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Nearest {
    pub triangle: u32,
    pub distance: f64,
}

impl<'a> TriangleSet<'a> {
    /// The set of these triangles.
    pub fn new(points: &'a [DVec3], triangles: &'a [[u32; 3]]) -> Self {
        Self { points, triangles, tree: TriangleBvh::new(points, triangles) }
    }

    /// Returns the points of a triangle's corners.
    pub fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.triangles[triangle as usize].map(|point| self.points[point as usize])
    }

    /// Returns the distance of a point to a triangle.
    pub fn distance(&self, point: DVec3, triangle: u32) -> f64 {
        nearest_on_triangle(point, &self.corners(triangle)).distance(point)
    }

    /// Returns the triangle that is nearest to a point, found sooner if `guess` is near to it.
    pub fn nearest(&self, point: DVec3, guess: u32) -> Nearest {
        let mut best = Nearest { triangle: guess, distance: self.distance(point, guess) };
        self.visit_within(point, best.distance, |triangle, distance| {
            if distance < best.distance {
                best = Nearest { triangle, distance };
            }
            best.distance
        });
        best
    }

    /// Visits triangles with their distances to a point, all of those that are within the limit
    /// and others. `visit` returns the limit for what follows.
    pub fn visit_within(&self, point: DVec3, limit: f64, mut visit: impl FnMut(u32, f64) -> f64) {
        let distance = |low: DVec3, high: DVec3| point.clamp(low, high).distance(point);
        let end = self.tree.visit_nearest(limit, distance, |triangle| {
            let triangle = triangle as u32;
            ControlFlow::<Infallible, f64>::Continue(visit(
                triangle,
                self.distance(point, triangle),
            ))
        });
        match end {
            ControlFlow::Continue(()) => {}
            ControlFlow::Break(never) => match never {},
        }
    }
}
