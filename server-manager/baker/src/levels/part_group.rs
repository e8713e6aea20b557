//! Parts that lie side by side: they cover together what a wider part would.

use glam::{DVec2, DVec3};

use super::chart;
use super::width;

/// Parts lie side by side if the gap between their boxes is at most this share of the narrower
/// one's width: shingles and planks do, windows in a wall do not.
const GAP: f64 = 0.25;

/// Cells along the longest side of the grid on which a group is looked at.
const CELLS_MAX: f64 = 64.0;

/// Cells across the narrowest part of a group, if that makes no more than [`CELLS_MAX`].
const CELLS_ACROSS: f64 = 4.0;

/// A group that covers more of the rectangle around it than this share is as wide as all of it: a
/// frame around a window does not, shingles do, some of which may be left.
const COVERED_MAX: f64 = 0.6;

/// Points of the triangles of a quad.
const QUAD_POINTS: usize = 6;

/// The triangles of a connected part of a surface, and how much room they take.
#[derive(Clone, Debug)]
pub(super) struct PartPoints {
    /// Three for each triangle.
    points: Vec<DVec3>,
    low: DVec3,
    high: DVec3,
    /// See [`width::of_points`], or [`width_of`] of a chart.
    pub width: f64,
}

impl PartPoints {
    pub fn new(points: Vec<DVec3>) -> Self {
        let bounds = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (low, high) =
            points.iter().fold(bounds, |(low, high), at| (low.min(*at), high.max(*at)));
        let width = width::of_points(points.iter().copied());
        Self { points, low, high, width }
    }

    /// The triangles of a chart of a texture or colour, which is as wide as what it covers: see
    /// [`width_of`].
    pub fn of_chart(points: Vec<DVec3>) -> Self {
        let width = width_of(&points);
        Self { width, ..Self::new(points) }
    }

    /// Returns the diagonal of the box around them.
    pub fn length(&self) -> f64 {
        (self.high - self.low).length()
    }

    fn is_beside(&self, other: &Self) -> bool {
        let gap = (self.low - other.high).max(other.low - self.high).max_element();
        gap <= GAP * self.width.min(other.width)
    }
}

/// Parts each of which lies beside another one of them.
#[derive(Debug)]
pub(super) struct PartGroup {
    /// Their numbers in the list.
    pub parts: Vec<usize>,
    /// How wide all are together: as wide as what encloses them if they cover most of it, and else
    /// the side of the largest square that they cover; at least the width of each. So it is large
    /// for shingles, and small for a frame, whatever that encloses.
    pub width: f64,
}

/// Returns how wide triangles are that are connected, three points for each: see
/// [`PartGroup::width`].
pub(super) fn width_of(points: &[DVec3]) -> f64 {
    let enclosed = width::of_points(points.iter().copied());
    // A quad encloses about what it covers, and there may be one for each texture chart.
    if points.len() <= QUAD_POINTS {
        return enclosed;
    }
    let Some(views) = views(points) else { return enclosed };
    // A triangle is looked at from aside: no side of it appears shorter than by this factor.
    let facing = |corners: &[DVec3; 3]| {
        let normal = area_normal(corners).try_normalize()?;
        Some(views.iter().map(|view| normal.dot(*view).abs()).fold(0.0, f64::max))
    };
    let facing = points.as_chunks::<3>().0.iter().filter_map(facing).fold(1.0, f64::min);
    enclosed.min(covered_width(points, 0.0) / facing)
}

/// Divides parts into groups, by the first of each.
///
/// Takes time by the number of pairs that overlap along the axis on which parts lie farthest apart.
pub(super) fn groups(parts: &[&PartPoints]) -> Vec<PartGroup> {
    let mut parents: Vec<u32> = (0..parts.len() as u32).collect();
    let axis = longest_axis(parts);
    let mut order: Vec<u32> = parents.clone();
    let part = |at: u32| parts[at as usize];
    order.sort_by(|one, two| part(*one).low[axis].total_cmp(&part(*two).low[axis]));
    let mut open: Vec<u32> = Vec::new();
    for at in order {
        // No farther from a part than by its own width is one that lies beside it.
        let reach = |other: &PartPoints| other.high[axis] + GAP * other.width;
        open.retain(|other| reach(part(*other)) >= part(at).low[axis]);
        for other in &open {
            if part(at).is_beside(part(*other)) {
                chart::join(&mut parents, [at, *other, *other]);
            }
        }
        open.push(at);
    }
    let mut members = vec![Vec::new(); parts.len()];
    for at in 0..parts.len() {
        members[chart::root(&mut parents, at as u32) as usize].push(at);
    }
    members.into_iter().filter(|group| !group.is_empty()).map(|of| group(parts, of)).collect()
}

fn group(parts: &[&PartPoints], members: Vec<usize>) -> PartGroup {
    let own = members.iter().map(|at| parts[*at].width);
    let (least, most) =
        own.fold((f64::INFINITY, 0.0_f64), |(low, high), width| (low.min(width), high.max(width)));
    let width = if members.len() == 1 {
        most
    } else {
        let points: Vec<DVec3> =
            members.iter().flat_map(|at| &parts[*at].points).copied().collect();
        let enclosed = width::of_points(points.iter().copied());
        most.max(enclosed.min(covered_width(&points, least)))
    };
    PartGroup { parts: members, width }
}

/// Returns the width of what triangles cover, seen along the normal of the largest one and along
/// one of its edges and across that, whatever is most: see [`largest_square`]. Cells that a
/// triangle touches count as covered: at most two cells too wide, of which there are
/// [`CELLS_ACROSS`] in `least`, the width of the narrowest part, if not fewer.
fn covered_width(points: &[DVec3], least: f64) -> f64 {
    let Some([normal, along, across]) = views(points) else { return 0.0 };
    let covered = |[right, up]: [DVec3; 2]| {
        let flat = |at: &[DVec3; 3]| at.map(|at| DVec2::new(at.dot(right), at.dot(up)));
        let flat: Vec<[DVec2; 3]> = points.as_chunks::<3>().0.iter().map(flat).collect();
        largest_square(&flat, least)
    };
    let views = [[along, across], [across, normal], [normal, along]];
    views.map(covered).into_iter().fold(0.0, f64::max)
}

/// Returns the normal of the largest triangle, the direction of its edge along which the points are
/// narrowest, and the one across both; `None` if no triangle has an area.
fn views(points: &[DVec3]) -> Option<[DVec3; 3]> {
    let by_area = |one: &&[DVec3; 3], two: &&[DVec3; 3]| {
        area_normal(one).length_squared().total_cmp(&area_normal(two).length_squared())
    };
    let largest = points.as_chunks::<3>().0.iter().max_by(by_area)?;
    let normal = area_normal(largest).try_normalize()?;
    let narrowness = |along: &DVec3| {
        let places = points.iter().map(|at| at.dot(normal.cross(*along)));
        let ends = |(low, high): (f64, f64), at: f64| (low.min(at), high.max(at));
        let (low, high) = places.fold((f64::INFINITY, f64::NEG_INFINITY), ends);
        high - low
    };
    let [a, b, c] = *largest;
    let edges = [b - a, c - b, a - c].into_iter().filter_map(DVec3::try_normalize);
    let by_width = |one: &DVec3, two: &DVec3| narrowness(one).total_cmp(&narrowness(two));
    let along = edges.min_by(by_width)?;
    Some([normal, along, normal.cross(along)])
}

/// The normal of a triangle times twice its area.
fn area_normal([a, b, c]: &[DVec3; 3]) -> DVec3 {
    (*b - *a).cross(*c - *a)
}

/// Returns the side of the largest square that triangles cover; the shorter side of the rectangle
/// around them if they cover most of it.
fn largest_square(triangles: &[[DVec2; 3]], least: f64) -> f64 {
    let empty = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    let corners = triangles.iter().flatten();
    let (low, high) = corners.fold(empty, |(low, high), at| (low.min(*at), high.max(*at)));
    let cell = ((high - low).max_element() / CELLS_MAX).max(least / CELLS_ACROSS);
    let size = ((high - low) / cell).floor().as_uvec2() + 1;
    let mut is_covered = vec![false; (size.x * size.y) as usize];
    for corners in triangles {
        // In cells.
        let corners = corners.map(|at| ((at - low) / cell).clamp(DVec2::ZERO, size.as_dvec2()));
        let heights = corners.map(|at| at.y.floor() as u32);
        let [first, last] = [heights.iter().min(), heights.iter().max()];
        let rows = first.copied().unwrap_or(0)..=last.copied().unwrap_or(0).min(size.y - 1);
        for y in rows {
            let Some([left, right]) = columns(&corners, y.into()) else { continue };
            let row = &mut is_covered[(y * size.x) as usize..][..size.x as usize];
            let end = (right.floor() as usize).min(row.len() - 1);
            row[(left.floor() as usize).min(end)..=end].fill(true);
        }
    }
    // The side of the largest square that ends at each cell.
    let mut sides = vec![0_u32; is_covered.len()];
    for (at, is_covered) in (0..size.x * size.y).zip(&is_covered) {
        let (x, y) = (at % size.x, at / size.x);
        let side = |x: Option<u32>, y: Option<u32>| {
            x.zip(y).map_or(0, |(x, y)| sides[(y * size.x + x) as usize])
        };
        let [left, below] = [x.checked_sub(1), y.checked_sub(1)];
        let least = side(left, Some(y)).min(side(Some(x), below)).min(side(left, below));
        sides[at as usize] = if *is_covered { least + 1 } else { 0 };
    }
    let covered = is_covered.iter().filter(|is| **is).count();
    if covered as f64 > is_covered.len() as f64 * COVERED_MAX {
        return (high - low).min_element();
    }
    f64::from(sides.into_iter().max().unwrap_or(0)) * cell
}

/// The left and right end of what a triangle covers between two heights that are 1 apart; `None` if
/// it does not reach them.
fn columns(corners: &[DVec2; 3], low: f64) -> Option<[f64; 2]> {
    let [a, b, c] = *corners;
    let ends = [(a, b), (b, c), (c, a)].map(|(from, to)| {
        let share = |height: f64| (height - from.y) / (to.y - from.y);
        // Of a level edge, both ends if it is between the heights.
        let [one, two] = if from.y == to.y { [0.0, 1.0] } else { [share(low), share(low + 1.0)] };
        let (first, last) = (one.min(two).max(0.0), one.max(two).min(1.0));
        let is_between = from.y.min(to.y) <= low + 1.0 && from.y.max(to.y) >= low;
        let [one, two] = [first, last].map(|share| from.lerp(to, share).x);
        is_between.then(|| [one.min(two), one.max(two)])
    });
    let reach = |one: [f64; 2], two: [f64; 2]| [one[0].min(two[0]), one[1].max(two[1])];
    ends.into_iter().flatten().reduce(reach)
}

/// The axis along which parts lie farthest apart.
fn longest_axis(parts: &[&PartPoints]) -> usize {
    let bounds = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (low, high) =
        parts.iter().fold(bounds, |(low, high), of| (low.min(of.low), high.max(of.high)));
    (high - low).max_position()
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, EulerRot};

    use super::*;

    fn rectangle([left, low]: [f64; 2], [width, height]: [f64; 2]) -> PartPoints {
        let corner = |x: f64, y: f64| DVec3::new(left + x * width, low + y * height, 0.0);
        let [a, b, c, d] =
            [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[x, y]| corner(x, y));
        PartPoints::new(vec![a, b, c, a, c, d])
    }

    /// Upright planks of 0.2 m by 3 m in a plane, side by side with such gaps.
    fn planks(count: usize, gap: f64) -> Vec<PartPoints> {
        let plank = |at: usize| {
            let left = at as f64 * (0.2 + gap);
            rectangle([left, 0.0], [0.2, 3.0])
        };
        (0..count).map(plank).collect()
    }

    fn widths(parts: &[PartPoints]) -> Vec<(usize, f64)> {
        let groups = groups(&parts.iter().collect::<Vec<_>>());
        groups.iter().map(|group| (group.parts.len(), group.width)).collect()
    }

    #[test]
    fn planks_side_by_side_are_as_wide_as_the_wall_that_they_cover() {
        let [(count, width)] = widths(&planks(10, 0.01))[..] else { panic!("one group") };
        assert_eq!(count, 10);
        assert!((2.0..=2.19).contains(&width), "{width}");
    }

    #[test]
    fn planks_apart_are_as_wide_as_each() {
        let apart = widths(&planks(10, 0.2));
        assert_eq!(apart.len(), 10);
        assert!(apart.iter().all(|(count, width)| *count == 1 && (width - 0.2).abs() < 1e-9));
        assert!(groups(&[]).is_empty());
    }

    #[test]
    fn a_frame_is_as_wide_as_its_widest_part() {
        // Two shutters, a sill and a lintel around a window.
        let frame = [
            rectangle([0.0, 0.0], [0.4, 1.4]),
            rectangle([1.4, 0.0], [0.4, 1.4]),
            rectangle([0.0, -0.1], [1.8, 0.1]),
            rectangle([0.0, 1.4], [1.8, 0.1]),
        ];
        let [(count, width)] = widths(&frame)[..] else { panic!("one group") };
        assert_eq!(count, 4);
        assert!((0.4..0.5).contains(&width), "{width} of a frame of 0.4 m around a window of 1 m");
    }

    #[test]
    fn a_ring_is_as_wide_as_its_band_however_it_is_turned() {
        // The reveals of a window of 1 by 1.5 m, 0.1 m deep; then a square of 1 m.
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.5], [0.0, 1.5]];
        let at = |corner: usize, z: f64| {
            let [x, y] = corners[corner % 4];
            DVec3::new(x, y, z)
        };
        let reveal = |n: usize| {
            let [a, b, c, d] = [at(n, 0.0), at(n + 1, 0.0), at(n + 1, 0.1), at(n, 0.1)];
            [a, b, c, a, c, d]
        };
        let ring: Vec<DVec3> = (0..4).flat_map(reveal).collect();
        let square = rectangle([0.0, 0.0], [1.0, 1.0]).points;
        // The square beside a larger triangle that is turned against it.
        let turn = DQuat::from_euler(EulerRot::XYZ, 0.3, 0.7, 1.1);
        let folded: Vec<DVec3> = square
            .iter()
            .map(|at| turn * *at)
            .chain([DVec3::ZERO, DVec3::X * 3.0, DVec3::Y * 1.2])
            .collect();
        for turn in [DQuat::IDENTITY, turn] {
            let turned = |points: &[DVec3]| {
                width_of(&points.iter().map(|at| turn * *at).collect::<Vec<_>>())
            };
            let width = turned(&ring);
            assert!((0.1..0.16).contains(&width), "{width} of a ring of 0.1 m around 1 m");
            assert!((turned(&square) - 1.0).abs() < 0.05);
            assert!(turned(&folded) >= 1.0, "a part of it is a square of 1 m");
        }
        assert_eq!(width_of(&[DVec3::ONE; 3]), 0.0);
        assert_eq!(width_of(&[]), 0.0);
    }

    #[test]
    fn long_blades_side_by_side_are_one_wide_part() {
        let blade = |at: u32| {
            let left = 0.01 * f64::from(at);
            let up = DVec3::new(left + 9.0, 9.0, 0.0);
            PartPoints::new(vec![DVec3::X * left, DVec3::X * (left + 0.01), up])
        };
        let blades: Vec<PartPoints> = (0..1000).map(blade).collect();
        let [(count, width)] = widths(&blades)[..] else { panic!("one group") };
        assert_eq!(count, 1000);
        assert!((5.0..12.0).contains(&width), "{width}");
    }

    #[test]
    fn a_speck_between_wide_parts_keeps_none_from_the_other() {
        let wide = |x: f64| rectangle([x, 0.0], [2.0, 2.0]);
        let speck = rectangle([2.1, 1.0], [0.01, 0.01]);
        let mut groups = widths(&[wide(0.0), speck, wide(2.2)]);
        groups.sort_by_key(|(count, _)| *count);
        assert_eq!(groups.iter().map(|(count, _)| *count).collect::<Vec<_>>(), [1, 2]);
    }

    #[test]
    fn a_narrow_part_reaches_a_wide_one_only_by_its_own_width() {
        let wide = rectangle([0.0, 0.0], [2.0, 2.0]);
        let strip = |x: f64| rectangle([x, 0.0], [0.1, 2.0]);
        assert_eq!(widths(&[strip(2.2), wide.clone()]).len(), 2);
        assert_eq!(widths(&[strip(2.01), wide]).len(), 1);
    }
}
