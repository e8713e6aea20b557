//! The width of a set of points: how far its outline moves where it is left out.

use foldhash::{HashSet, HashSetExt};
use glam::{DVec2, DVec3};

/// Points of which the direction to another one is tried as an axis, at most.
const AXES_MAX: usize = 64;

/// Points up to which other axes are tried than the longest one.
const POINTS_MAX: usize = 512;

/// Returns the diameter of an endless cylinder that holds all points: for a box the diagonal of its
/// smallest face, for a strip its width, and never above √2 times the largest distance between two
/// points. A part that shrinks to the cylinder's axis moves by half of it. 0 without points.
///
/// The axis has the direction between two points that are found by going from one to the farthest,
/// and from there to the farthest again; or from the first of these to another point, as along the
/// edge of a box, where that makes the cylinder thinner. It runs through the middle of the points
/// across it.
pub(super) fn of_points(points: impl Iterator<Item = DVec3>) -> f64 {
    let mut known = HashSet::new();
    let points: Vec<DVec3> =
        points.filter(|point| known.insert(point.to_array().map(f64::to_bits))).collect();
    let Some(first) = points.first() else { return 0.0 };
    let farthest = |from: DVec3| {
        let by_distance = |one: &DVec3, two: &DVec3| {
            one.distance_squared(from).total_cmp(&two.distance_squared(from))
        };
        points.iter().copied().max_by(by_distance).unwrap_or(from)
    };
    let one = farthest(*first);
    let longest = across(&points, one, farthest(one) - one).unwrap_or(0.0);
    if points.len() > POINTS_MAX {
        return longest;
    }
    let others = points.iter().take(AXES_MAX);
    let others = others.filter_map(|point| across(&points, one, *point - one));
    others.fold(longest, f64::min)
}

/// The diameter of a cylinder in this direction that holds all points; `None` if the direction has
/// no length.
fn across(points: &[DVec3], origin: DVec3, direction: DVec3) -> Option<f64> {
    let axis = direction.try_normalize()?;
    let (right, up) = axis.any_orthonormal_pair();
    let places = points.iter().map(|point| {
        let way = *point - origin;
        DVec2::new(way.dot(right), way.dot(up))
    });
    let empty = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    let (low, high) = places.clone().fold(empty, |(low, high), at| (low.min(at), high.max(at)));
    let middle = low.midpoint(high);
    Some(2.0 * places.map(|at| at.distance(middle)).fold(0.0, f64::max))
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, EulerRot};

    use super::*;

    #[test]
    fn a_bar_is_as_wide_as_its_cross_section() {
        let corner = |at: u32| {
            let pick = |axis: u32| f64::from(at >> axis & 1);
            DVec3::new(8.0 * pick(0), 0.3 * pick(1), 0.4 * pick(2))
        };
        let bar: Vec<DVec3> = (0..8).map(corner).collect();
        let width = of_points(bar.iter().copied());
        // The axis runs along an edge, so the diagonal of 0.3 and 0.4.
        assert!((width - 0.5).abs() < 1e-9, "{width}");
        let strip = bar.iter().map(|at| DVec3::new(at.x, at.y, 0.0));
        assert!((of_points(strip) - 0.3).abs() < 1e-9, "a strip is as wide as its shorter side");
        let turn = DQuat::from_euler(EulerRot::XYZ, 0.3, 0.7, 1.1);
        let turned = of_points(bar.iter().map(|at| turn * *at));
        assert!((turned - 0.5).abs() < 1e-9, "{turned}, however it is turned");
        assert_eq!(of_points([DVec3::ONE; 3].into_iter()), 0.0);
        assert_eq!(of_points(std::iter::empty()), 0.0);
    }
}
