//! Flat convex polygons that are cut by planes.

use glam::DVec3;

/// Corners of a polygon that is cut further. Each of the three planes beside a triangle adds at
/// most one.
const CORNERS_KEPT: usize = 6;

/// Corners that one has room for.
const CORNERS_MAX: usize = CORNERS_KEPT + 3;

/// Corners nearer to a plane than this, as a share of the polygon's size, lie on both sides of it,
/// so that no slivers arise from rounding.
const ON_PLANE: f64 = 1e-9;

/// A convex polygon of at most nine corners.
#[derive(Clone, Copy, Debug)]
pub(super) struct ConvexPolygon {
    points: [DVec3; CORNERS_MAX],
    count: usize,
}

impl ConvexPolygon {
    /// The polygon with these corners, at most [`CORNERS_MAX`].
    fn new(corners: &[DVec3]) -> Self {
        let mut points = [DVec3::ZERO; CORNERS_MAX];
        points[..corners.len()].copy_from_slice(corners);
        Self { points, count: corners.len() }
    }

    /// The polygon of a triangle.
    pub fn from_triangle(corners: &[DVec3; 3]) -> Self {
        Self::new(corners)
    }

    /// Returns its corners in order; at least one.
    pub fn corners(&self) -> &[DVec3] {
        &self.points[..self.count]
    }

    /// Returns the mean of its corners, which lies within it.
    pub fn middle(&self) -> DVec3 {
        self.corners().iter().sum::<DVec3>() / self.count as f64
    }

    /// Returns the two parts on both sides of its longest edge's middle, which cover it.
    pub fn halves(&self) -> [Self; 2] {
        let corners = self.corners();
        let next = |at: usize| (at + 1) % self.count;
        let length = |at: &usize| corners[*at].distance_squared(corners[next(*at)]);
        let longest = (0..self.count).max_by(|one, two| length(one).total_cmp(&length(two)));
        let first = longest.unwrap_or(0);
        let middle = corners[first].midpoint(corners[next(first)]);
        // From the middle of the edge around to the corner that is opposite.
        let around = |from: usize, count: usize| {
            let mut part = Self { points: [middle; CORNERS_MAX], count: count + 1 };
            for (at, corner) in part.points[1..=count].iter_mut().enumerate() {
                *corner = corners[(from + at) % self.count];
            }
            part
        };
        let opposite = self.count.div_ceil(2);
        [
            around(next(first), opposite),
            around(next(first) + opposite - 1, self.count - opposite + 1),
        ]
    }

    /// Divides it by the three planes that stand on the edges of a triangle. Returns what projects
    /// onto the triangle along the triangle's normal, and appends the rest, in parts with few
    /// corners. `None`, with nothing appended, if nothing projects onto it.
    pub fn divide(&self, triangle: &[DVec3; 3], outside: &mut Vec<Self>) -> Option<Self> {
        let first = outside.len();
        let inside = self.divide_into(triangle, outside);
        if inside.is_none() {
            outside.truncate(first);
        }
        inside
    }

    fn divide_into(&self, triangle: &[DVec3; 3], outside: &mut Vec<Self>) -> Option<Self> {
        let [a, b, c] = *triangle;
        let normal = (b - a).cross(c - a);
        let size = self.corners().iter().map(|corner| corner.distance(self.points[0]));
        let slack = ON_PLANE * size.fold(0.0, f64::max);
        let mut inside = *self;
        for (from, to) in [(a, b), (b, c), (c, a)] {
            let inward = normal.cross(to - from).try_normalize()?;
            let mut heights = [0.0; CORNERS_MAX];
            for (height, corner) in heights.iter_mut().zip(inside.corners()) {
                let exact = (*corner - from).dot(inward);
                *height = if exact.abs() <= slack { 0.0 } else { exact };
            }
            let heights = &heights[..inside.count];
            if heights.iter().all(|height| *height <= 0.0) {
                return None;
            }
            if heights.iter().any(|height| *height < 0.0) {
                let [kept, mut cut] = inside.cut(heights)?;
                cut.reduce(outside);
                outside.push(cut);
                inside = kept;
            }
        }
        Some(inside)
    }

    /// Gives the parts above and below the height 0, of which both exist; `None` if rounding made
    /// it cross that height too often.
    fn cut(&self, heights: &[f64]) -> Option<[Self; 2]> {
        let (mut above, mut below) = (Self::new(&[]), Self::new(&[]));
        for (at, &corner) in self.corners().iter().enumerate() {
            let next = (at + 1) % self.count;
            let (here, there) = (heights[at], heights[next]);
            if here >= 0.0 {
                above.push(corner)?;
            }
            if here <= 0.0 {
                below.push(corner)?;
            }
            if here * there < 0.0 {
                let crossing = corner.lerp(self.points[next], here / (here - there));
                above.push(crossing)?;
                below.push(crossing)?;
            }
        }
        Some([above, below])
    }

    /// Cuts triangles off until few corners are left.
    fn reduce(&mut self, rest: &mut Vec<Self>) {
        while self.count > CORNERS_KEPT {
            let last = self.count - 1;
            rest.push(Self::new(&[self.points[0], self.points[last - 1], self.points[last]]));
            self.count -= 1;
        }
    }

    /// Appends a corner; `None` if there is no room.
    fn push(&mut self, corner: DVec3) -> Option<()> {
        *self.points.get_mut(self.count)? = corner;
        self.count += 1;
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn area(polygon: &ConvexPolygon) -> f64 {
        let corners = polygon.corners();
        let fan = corners
            .windows(2)
            .map(|edge| (edge[0] - corners[0]).cross(edge[1] - corners[0]).length() * 0.5);
        fan.sum()
    }

    fn point() -> impl Strategy<Value = DVec3> {
        [-1.0..1.0_f64, -1.0..1.0, -1.0..1.0].prop_map(DVec3::from_array)
    }

    proptest! {
        #[test]
        fn parts_cover_the_polygon(
            start in [point(), point(), point()],
            cuts in proptest::collection::vec([point(), point(), point()], 1..4),
        ) {
            let mut parts = vec![ConvexPolygon::from_triangle(&start)];
            let total = area(&parts[0]);
            for cut in &cuts {
                let mut next = Vec::new();
                for part in &parts {
                    match part.divide(cut, &mut next) {
                        Some(inside) => next.push(inside),
                        None => next.push(*part),
                    }
                }
                parts = next;
                prop_assert!(parts.iter().all(|part| part.count >= 3));
                let sum: f64 = parts.iter().map(area).sum();
                prop_assert!((sum - total).abs() <= 1e-6 * total.max(1e-3), "{sum} {total}");
                // Inner parts have up to nine corners; they are halved before they are cut.
                parts = parts.iter().flat_map(ConvexPolygon::halves).collect();
                let sum: f64 = parts.iter().map(area).sum();
                prop_assert!((sum - total).abs() <= 1e-6 * total.max(1e-3), "{sum} {total}");
            }
        }
    }
}
