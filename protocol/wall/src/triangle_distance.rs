//! The point of a triangle that is nearest to another point; f64.

use glam::DVec3;

/// A triangle whose two first edges have an angle with less than this as its sine is a line: the
/// direction of its normal is mostly rounding.
const LINE_SINE: f64 = 1e-12;

/// Returns the point of a triangle that is nearest to a point; the triangle may be a line or a
/// point.
pub fn nearest_on_triangle(point: DVec3, corners: &[DVec3; 3]) -> DVec3 {
    let [a, b, c] = *corners;
    let normal = (b - a).cross(c - a);
    let edges = [(a, b), (b, c), (c, a)];
    let is_above = edges.iter().all(|(from, to)| {
        // In the prism over the triangle, along its normal.
        (*to - *from).cross(point - *from).dot(normal) >= 0.0
    });
    let across = normal.length_squared();
    let lengths = (b - a).length_squared() * (c - a).length_squared();
    if is_above && across > LINE_SINE * LINE_SINE * lengths && across.is_finite() {
        return point - normal * ((point - a).dot(normal) / across);
    }
    let nearest = edges.map(|(from, to)| nearest_on_edge(point, from, to));
    let distance = |at: &DVec3| at.distance_squared(point);
    nearest.into_iter().min_by(|one, two| distance(one).total_cmp(&distance(two))).unwrap_or(a)
}

fn nearest_on_edge(point: DVec3, from: DVec3, to: DVec3) -> DVec3 {
    let along = to - from;
    let share = (point - from).dot(along) / along.length_squared();
    // An edge without a length is a point.
    if share.is_nan() { from } else { from + along * share.clamp(0.0, 1.0) }
}
