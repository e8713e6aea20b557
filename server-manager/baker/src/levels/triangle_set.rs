//! Triangles of which the nearest to a point is found: f64.

use std::convert::Infallible;
use std::ops::ControlFlow;

use glam::{DVec2, DVec3};
use polyptych_wall::triangle_bvh::TriangleBvh;

/// The square of the sine between two edges below which what is nearest is looked for on the edges:
/// the area is mostly rounding.
const SLIVER: f64 = 1e-10;

/// A point of a surface with its place on the textures and its colour, in lengths of the surface.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SurfacePoint {
    pub position: DVec3,
    /// Texture coordinates of two sets, then red and green, then blue and alpha, as lengths; zero
    /// for what is missing.
    pub looks: [DVec2; 4],
}

impl SurfacePoint {
    /// Returns the distance in space, on the textures and in colour: the root of the sum of all
    /// squares.
    pub fn distance(self, other: Self) -> f64 {
        let between = self.minus(other);
        between.dot(between).sqrt()
    }

    /// Returns the point of a triangle that has these shares of its corners.
    pub fn mix([a, b, c]: &[Self; 3], shares: [f64; 3]) -> Self {
        let [first, second, third] = shares;
        let look = |at: usize| a.looks[at] * first + b.looks[at] * second + c.looks[at] * third;
        let position = a.position * first + b.position * second + c.position * third;
        Self { position, looks: [0, 1, 2, 3].map(look) }
    }

    fn minus(self, other: Self) -> Self {
        let looks = [0, 1, 2, 3].map(|at| self.looks[at] - other.looks[at]);
        Self { position: self.position - other.position, looks }
    }

    fn dot(self, other: Self) -> f64 {
        let looks = self.looks.iter().zip(other.looks).map(|(own, other)| own.dot(other));
        self.position.dot(other.position) + looks.sum::<f64>()
    }
}

/// Triangles over points, with a tree over them; at least one.
#[derive(Debug)]
pub(super) struct TriangleSet {
    triangles: Vec<Triangle>,
    tree: TriangleBvh,
}

/// A triangle with what its distance to any point takes.
#[derive(Debug)]
struct Triangle {
    corners: [DVec3; 3],
    /// From the first corner to the second and the third one.
    edges: [DVec3; 2],
    /// The products of the edges, as [`nearest_shares`] takes them.
    products: [f64; 3],
}

impl Triangle {
    fn new(corners: [DVec3; 3]) -> Self {
        let [ab, ac] = [corners[1] - corners[0], corners[2] - corners[0]];
        Self { corners, edges: [ab, ac], products: [ab.dot(ab), ab.dot(ac), ac.dot(ac)] }
    }
}

/// A triangle and its distance to a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Nearest {
    pub triangle: u32,
    pub distance: f64,
}

impl TriangleSet {
    /// The set of these triangles.
    pub fn new(points: &[DVec3], triangles: &[[u32; 3]]) -> Self {
        let tree = TriangleBvh::new(points, triangles);
        let triangles = triangles.iter();
        let triangles = triangles.map(|at| Triangle::new(at.map(|point| points[point as usize])));
        Self { triangles: triangles.collect(), tree }
    }

    /// Returns the points of a triangle's corners.
    pub fn corners(&self, triangle: u32) -> &[DVec3; 3] {
        &self.triangles[triangle as usize].corners
    }

    /// Returns the distance of a point to a triangle.
    #[inline]
    pub fn distance(&self, point: DVec3, triangle: u32) -> f64 {
        let Triangle { corners: [first, ..], edges: [ab, ac], products } =
            &self.triangles[triangle as usize];
        let to = point - *first;
        let [second, third] = nearest_shares(*products, [ab.dot(to), ac.dot(to)]);
        // Of the point itself, not by the quadratic function, which rounds off small distances.
        (*ab * second + *ac * third).distance(to)
    }

    /// Returns the triangle that is nearest to a point, found sooner if `guess` is near to it.
    pub fn nearest(&self, point: DVec3, guess: u32) -> Nearest {
        let mut best = Nearest { triangle: guess, distance: self.distance(point, guess) };
        self.visit_within(point, best.distance, |triangle| {
            let distance = self.distance(point, triangle);
            if distance < best.distance {
                best = Nearest { triangle, distance };
            }
            best.distance
        });
        best
    }

    /// Visits triangles, all of those whose distance to a point is within the limit and others.
    /// `visit` returns the limit for what follows.
    pub fn visit_within(&self, point: DVec3, limit: f64, mut visit: impl FnMut(u32) -> f64) {
        let distance = |low: DVec3, high: DVec3| point.clamp(low, high).distance(point);
        let end = self.tree.visit_nearest(limit, distance, |triangle| {
            ControlFlow::<Infallible, f64>::Continue(visit(triangle as u32))
        });
        match end {
            ControlFlow::Continue(()) => {}
            ControlFlow::Break(never) => match never {},
        }
    }
}

/// Returns the shares of the corners in the point of a triangle that is nearest to `point`.
pub(super) fn shares_of_nearest(point: SurfacePoint, [a, b, c]: &[SurfacePoint; 3]) -> [f64; 3] {
    let (ab, ac, to) = (b.minus(*a), c.minus(*a), point.minus(*a));
    let products = [ab.dot(ab), ab.dot(ac), ac.dot(ac)];
    let [second, third] = nearest_shares(products, [ab.dot(to), ac.dot(to)]);
    [1.0 - second - third, second, third]
}

/// Returns the shares of the second and the third corner in the point of a triangle that is nearest
/// to another point. They come from the products of the edges `ab` and `ac` and the way `to` the
/// point, all from the first corner: `ab·ab`, `ab·ac`, `ac·ac`; `ab·to`, `ac·to`; in a space of any
/// dimension. Some point of the triangle is returned in any case.
///
/// The square of the distance is a quadratic function of the shares. Its minimum is where the
/// gradient is zero, or on an edge.
#[inline]
fn nearest_shares([bb, bc, cc]: [f64; 3], [b, c]: [f64; 2]) -> [f64; 2] {
    let area = bb * cc - bc * bc;
    let (second, third) = ((cc * b - bc * c) / area, (bb * c - bc * b) / area);
    // A triangle without an area has no such minimum: comparisons with NaN are false.
    if second >= 0.0 && third >= 0.0 && second + third <= 1.0 && area > SLIVER * bb * cc {
        return [second, third];
    }
    let share = |along: f64, length: f64| {
        let share = along / length;
        if share.is_nan() { 0.0 } else { share.clamp(0.0, 1.0) }
    };
    // From the second corner to the third one.
    let across = share(c - b + bb - bc, bb - 2.0 * bc + cc);
    let edges = [[share(b, bb), 0.0], [0.0, share(c, cc)], [1.0 - across, across]];
    let square = |[second, third]: &[f64; 2]| {
        second * (second * bb + 2.0 * third * bc - 2.0 * b) + third * (third * cc - 2.0 * c)
    };
    let mut nearest = edges[0];
    let mut least = square(&edges[0]);
    for edge in &edges[1..] {
        let square = square(edge);
        if square < least {
            (nearest, least) = (*edge, square);
        }
    }
    nearest
}

#[cfg(test)]
mod tests {
    use super::*;
    use polyptych_wall::triangle_distance::nearest_on_triangle;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = DVec3> {
        [-1.0..1.0_f64, -1.0..1.0, -1.0..1.0].prop_map(DVec3::from_array)
    }

    proptest! {
        #[test]
        fn agrees_with_the_other_formula(corners in [point(), point(), point()], at in point()) {
            let set = TriangleSet::new(&corners, &[[0, 1, 2]]);
            let expected = nearest_on_triangle(at, &corners).distance(at);
            prop_assert!((set.distance(at, 0) - expected).abs() < 1e-9);
            let flat = |position: DVec3| SurfacePoint { position, ..SurfacePoint::default() };
            let shares = shares_of_nearest(flat(at), &corners.map(flat));
            let near = corners.iter().zip(shares);
            let near: DVec3 = near.map(|(corner, share)| *corner * share).sum();
            prop_assert!((near.distance(at) - expected).abs() < 1e-9);
        }

        #[test]
        fn lines_and_points_are_triangles(one in point(), two in point(), at in point()) {
            let inner = one.lerp(two, 0.3);
            for corners in [[one; 3], [one, one, two], [one, two, one], [one, two, inner]] {
                let set = TriangleSet::new(&corners, &[[0, 1, 2]]);
                let expected = nearest_on_triangle(at, &corners).distance(at);
                prop_assert!((set.distance(at, 0) - expected).abs() < 1e-6, "{corners:?} {at}");
            }
        }
    }
}
