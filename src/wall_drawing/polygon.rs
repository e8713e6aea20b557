//! Polygons of the paper: area, hull, and fewer points.

use glam::DVec2;

/// Returns the signed area, half the sum of cross products; positive if x turns to y.
pub(super) fn area(points: &[DVec2]) -> f64 {
    let Some(last) = points.last() else { return 0.0 };
    let pairs = std::iter::once(last).chain(points).zip(points);
    pairs.map(|(a, b)| a.perp_dot(*b)).sum::<f64>() / 2.0
}

/// Returns the convex hull of finite points. A. Andrew, *Another efficient algorithm for convex
/// hulls in two dimensions*, 1979.
pub(super) fn hull(points: impl IntoIterator<Item = DVec2>) -> Vec<DVec2> {
    let mut points: Vec<DVec2> = points.into_iter().filter(|point| point.is_finite()).collect();
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    points.dedup();
    if points.len() < 3 {
        return points;
    }
    let mut hull: Vec<DVec2> = Vec::new();
    let half = |hull: &mut Vec<DVec2>, points: &mut dyn Iterator<Item = DVec2>| {
        let first = hull.len();
        for point in points {
            while hull.len() >= first + 2 {
                let (a, b) = (hull[hull.len() - 2], hull[hull.len() - 1]);
                if (b - a).perp_dot(point - a) > 0.0 {
                    break;
                }
                hull.pop();
            }
            hull.push(point);
        }
        hull.pop();
    };
    half(&mut hull, &mut points.iter().copied());
    half(&mut hull, &mut points.iter().rev().copied());
    hull
}

/// Leaves out points of an outline that are nearer than `tolerance` to the line between the points
/// that are kept around them. D. Douglas, T. Peucker, *Algorithms for the reduction of the number
/// of points*, 1973.
pub(super) fn simplified(points: &[DVec2], tolerance: f64) -> Vec<DVec2> {
    let mut is_kept = vec![false; points.len()];
    let mut open = Vec::new();
    if let Some(last) = points.len().checked_sub(1) {
        // A closed outline has no ends: it is cut where it is farthest from its beginning.
        let far = |at: &usize| points[*at].distance_squared(points[0]);
        let middle = (0..=last).max_by(|a, b| far(a).total_cmp(&far(b))).unwrap_or(0);
        for at in [0, middle, last] {
            is_kept[at] = true;
        }
        open.extend([(0, middle), (middle, last)]);
    }
    while let Some((from, to)) = open.pop() {
        let along = points[to] - points[from];
        let off = |at: usize| {
            let beside = points[at] - points[from];
            let share = (beside.dot(along) / along.length_squared()).clamp(0.0, 1.0);
            if share.is_nan() { beside.length() } else { beside.distance(along * share) }
        };
        let between = from + 1..to;
        let farthest = between.map(|at| (at, off(at))).max_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((at, distance)) = farthest
            && distance > tolerance
        {
            is_kept[at] = true;
            open.extend([(from, at), (at, to)]);
        }
    }
    let kept = points.iter().zip(is_kept).filter(|(_, is_kept)| *is_kept);
    kept.map(|(point, _)| *point).collect()
}

/// Returns the part of an outline within a rectangle. I. Sutherland, G. Hodgman, *Reentrant polygon
/// clipping*, 1974.
pub(super) fn clipped(points: &[DVec2], [low, high]: [DVec2; 2]) -> Vec<DVec2> {
    let mut part = points.to_vec();
    for axis in 0..2 {
        for (border, sign) in [(low[axis], 1.0), (high[axis], -1.0)] {
            let depth = |at: &DVec2| (at[axis] - border) * sign;
            let whole = std::mem::take(&mut part);
            let Some(last) = whole.last() else { return part };
            for (a, b) in std::iter::once(last).chain(&whole).zip(&whole) {
                if (depth(a) < 0.0) != (depth(b) < 0.0) {
                    let mut cut = a.lerp(*b, depth(a) / (depth(a) - depth(b)));
                    cut[axis] = border;
                    part.push(cut);
                }
                if depth(b) >= 0.0 {
                    part.push(*b);
                }
            }
        }
    }
    part
}

/// Returns whether a place lies within outlines, by the number of sides to its right.
pub(super) fn is_within<'a>(outlines: impl IntoIterator<Item = &'a Vec<DVec2>>, at: DVec2) -> bool {
    let is_crossed = |(a, b): &(&DVec2, &DVec2)| {
        (a.y > at.y) != (b.y > at.y) && at.x < a.x + (b.x - a.x) * (at.y - a.y) / (b.y - a.y)
    };
    let crossed = |outline: &'a Vec<DVec2>| {
        let sides = outline.last().into_iter().chain(outline).zip(outline);
        sides.filter(is_crossed).count()
    };
    outlines.into_iter().map(crossed).sum::<usize>() % 2 == 1
}

/// Returns a place within outlines that is far from them, and its distance to the nearest of their
/// points; `None` if none of a grid of places is inside.
pub(super) fn inner_place(outlines: &[Vec<DVec2>]) -> Option<(DVec2, f64)> {
    const SIDE: u32 = 16;
    let [low, high] = bounds(outlines.iter().flatten().copied())?;
    let part = |step: u32| (f64::from(step) + 0.5) / f64::from(SIDE);
    let places = (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| DVec2::new(part(x), part(y))));
    let inner = places.map(|at| low + (high - low) * at).filter(|at| is_within(outlines, *at));
    let clear = |at: DVec2| {
        let distances = outlines.iter().flatten().map(|point| point.distance(at));
        (at, distances.fold(f64::INFINITY, f64::min))
    };
    inner.map(clear).max_by(|a, b| a.1.total_cmp(&b.1))
}

/// Returns the rectangle around points; `None` if there are none.
pub(super) fn bounds(points: impl IntoIterator<Item = DVec2>) -> Option<[DVec2; 2]> {
    let none = [DVec2::INFINITY, DVec2::NEG_INFINITY];
    let finite = points.into_iter().filter(|point| point.is_finite());
    let [low, high] = finite.fold(none, |[low, high], at| [low.min(at), high.max(at)]);
    (low.x <= high.x).then_some([low, high])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hull_holds_all_points_and_has_no_others() {
        let corners = [[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]].map(DVec2::from);
        let inner = [[1.0, 1.0], [2.0, 0.0], [4.0, 0.0], [f64::NAN, 1.0]].map(DVec2::from);
        let found = hull(corners.into_iter().chain(inner));
        assert_eq!(found.len(), 4, "{found:?}");
        assert_eq!(area(&found), 12.0);
        assert_eq!(hull([DVec2::ONE, DVec2::ONE]), [DVec2::ONE]);
    }

    #[test]
    fn an_outline_is_cut_to_a_rectangle() {
        let square = [[-1.0, -1.0], [3.0, -1.0], [3.0, 3.0], [-1.0, 3.0]].map(DVec2::from);
        let part = clipped(&square, [DVec2::ZERO, DVec2::splat(2.0)]);
        assert_eq!(area(&part).abs(), 4.0, "{part:?}");
        assert!(clipped(&square, [DVec2::splat(5.0), DVec2::splat(6.0)]).is_empty());
        assert!(is_within([&part], DVec2::ONE) && !is_within([&part], DVec2::splat(2.5)));
        let (middle, _) = inner_place(&[square.to_vec()]).expect("inside");
        assert!(middle.distance(DVec2::ONE) < 0.5, "{middle}");
    }

    #[test]
    fn straight_lines_keep_their_ends_only() {
        let side =
            |from: DVec2, to: DVec2| (0..8).map(move |at| from.lerp(to, f64::from(at) / 8.0));
        let corners = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];
        let outline: Vec<DVec2> =
            (0..4).flat_map(|at| side(corners[at], corners[(at + 1) % 4])).collect();
        let kept = simplified(&outline, 0.01);
        assert!(corners.iter().all(|corner| kept.contains(corner)), "{kept:?}");
        assert!(kept.len() <= 5, "{kept:?}");
        assert!(simplified(&[], 1.0).is_empty());
    }
}
