//! Parts that lie side by side: they cover together what a wider part would.

use glam::DVec3;

use super::chart;
use super::width;

/// Parts lie side by side if the gap between their boxes is at most this share of the narrower
/// one's width: shingles and planks do, windows in a wall do not.
const GAP: f64 = 0.25;

/// The points of a connected part of a surface, and how much room they take.
#[derive(Clone, Debug)]
pub(super) struct PartPoints {
    points: Vec<DVec3>,
    low: DVec3,
    high: DVec3,
    /// See [`width::of_points`].
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
    /// The width of all together.
    pub width: f64,
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
        let from = part(at).low[axis] - GAP * part(at).width;
        open.retain(|other| part(*other).high[axis] >= from);
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
    let width = match members[..] {
        [only] => parts[only].width,
        _ => width::of_points(members.iter().flat_map(|at| &parts[*at].points).copied()),
    };
    PartGroup { parts: members, width }
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
    use super::*;

    /// Upright planks of 0.2 m by 3 m in a plane, side by side with such gaps.
    fn planks(count: usize, gap: f64) -> Vec<PartPoints> {
        let plank = |at: usize| {
            let left = at as f64 * (0.2 + gap);
            let corners = [[left, 0.0], [left + 0.2, 0.0], [left, 3.0], [left + 0.2, 3.0]];
            PartPoints::new(corners.map(|[x, y]| DVec3::new(x, y, 0.0)).to_vec())
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
        assert!((width - 2.09).abs() < 1e-9, "{width}");
    }

    #[test]
    fn planks_apart_are_as_wide_as_each() {
        let apart = widths(&planks(10, 0.2));
        assert_eq!(apart.len(), 10);
        assert!(apart.iter().all(|(count, width)| *count == 1 && (width - 0.2).abs() < 1e-9));
        assert!(groups(&[]).is_empty());
    }

    #[test]
    fn a_narrow_part_reaches_a_wide_one_only_by_its_own_width() {
        let wide = PartPoints::new(vec![DVec3::ZERO, DVec3::new(2.0, 2.0, 0.0), DVec3::X]);
        let strip = |x: f64| {
            PartPoints::new(vec![
                DVec3::new(x, 0.0, 0.0),
                DVec3::new(x + 0.1, 0.0, 0.0),
                DVec3::new(x, 2.0, 0.0),
            ])
        };
        assert_eq!(widths(&[strip(2.2), wide.clone()]).len(), 2);
        assert_eq!(widths(&[strip(2.01), wide]).len(), 1);
    }
}
