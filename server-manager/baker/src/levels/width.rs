//! The width of a set of points: how far its outline moves where it is left out.

use glam::DVec3;

/// Returns the diameter of an endless cylinder that holds all points: for a strip or a bar up to
/// twice its width, and never above √2 times the largest distance between two points. A part that
/// shrinks to the cylinder's axis moves by half of it. 0 without points.
///
/// The axis has the direction between two points that are found by going from one to the farthest,
/// and from there to the farthest again; it runs through the middle of the points across it.
pub(super) fn of_points(points: impl Iterator<Item = DVec3> + Clone) -> f64 {
    let Some(first) = points.clone().next() else { return 0.0 };
    let farthest = |from: DVec3| {
        let by_distance = |one: &DVec3, two: &DVec3| {
            one.distance_squared(from).total_cmp(&two.distance_squared(from))
        };
        points.clone().max_by(by_distance).unwrap_or(from)
    };
    let one = farthest(first);
    let two = farthest(one);
    let Some(axis) = (two - one).try_normalize() else { return 0.0 };
    // The sides across the axis of the box around all.
    let (right, up) = axis.any_orthonormal_pair();
    let empty = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    let (low, high) = points.fold(empty, |(low, high), point| {
        let across = [(point - one).dot(right), (point - one).dot(up)];
        ([0, 1].map(|at| low[at].min(across[at])), [0, 1].map(|at| high[at].max(across[at])))
    });
    (high[0] - low[0]).hypot(high[1] - low[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bar_is_as_wide_as_its_cross_section() {
        let corner = |at: u32| {
            let pick = |axis: u32| f64::from(at >> axis & 1);
            DVec3::new(8.0 * pick(0), 0.3 * pick(1), 0.4 * pick(2))
        };
        let bar: Vec<DVec3> = (0..8).map(corner).collect();
        let width = of_points(bar.iter().copied());
        // The axis runs from corner to corner, so up to twice the diagonal of 0.3 and 0.4.
        assert!((0.5..1.1).contains(&width), "{width}");
        assert_eq!(of_points([DVec3::ONE; 3].into_iter()), 0.0);
        assert_eq!(of_points(std::iter::empty()), 0.0);
    }
}
