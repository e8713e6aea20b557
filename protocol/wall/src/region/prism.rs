//! Vertical prisms over simple polygons.

use glam::{DVec2, DVec3};

use super::{BoxPlace, ROUNDING, RegionError, check_all, check_order};
use crate::limits::REGION_CORNERS_MAX;

/// Parts of a line that are shorter than this share of it are points.
const PART_MIN: f64 = 1e-12;

/// A polygon in x and z, from a floor to a roof.
#[derive(Clone, Debug)]
pub(super) struct Prism {
    polygon: Vec<DVec2>,
    min: DVec2,
    max: DVec2,
    low: f64,
    high: f64,
}

impl Prism {
    pub fn new(polygon: &[DVec2], low: f64, high: f64) -> Result<Self, RegionError> {
        if !(3..=REGION_CORNERS_MAX).contains(&polygon.len()) {
            return Err(RegionError::Corners(polygon.len()));
        }
        for corner in polygon {
            check_all("a corner of the prism", &corner.to_array())?;
        }
        check_all("the height of the prism", &[low, high])?;
        check_order('y', low, high)?;
        let min = polygon.iter().copied().fold(DVec2::INFINITY, DVec2::min);
        let max = polygon.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
        let prism = Self { polygon: polygon.to_vec(), min, max, low, high };
        prism.check_edges()?;
        Ok(prism)
    }

    /// The polygon is simple: edges meet at their common corners only.
    fn check_edges(&self) -> Result<(), RegionError> {
        let edges: Vec<_> = self.edges().collect();
        let count = edges.len();
        for (first, &(a, b)) in edges.iter().enumerate() {
            for (second, &(c, d)) in edges.iter().enumerate().skip(first + 1) {
                let folds = |back: DVec2, corner: DVec2, on: DVec2| {
                    side(back, corner, on) == 0.0 && (corner - back).dot(on - corner) <= 0.0
                };
                let meets = if second == first + 1 {
                    folds(a, b, d)
                } else if first == 0 && second == count - 1 {
                    folds(c, d, b)
                } else {
                    edges_meet((a, b), (c, d))
                };
                if meets {
                    return Err(RegionError::Edges { first, second });
                }
            }
        }
        Ok(())
    }

    pub fn around(&self) -> (DVec3, DVec3) {
        let corner = |at: DVec2, height| DVec3::new(at.x, height, at.y);
        (corner(self.min, self.low), corner(self.max, self.high))
    }

    pub fn place_of_box(&self, low: DVec3, high: DVec3) -> BoxPlace {
        let at = DVec2::new;
        let [x, z, to_x, to_z] = [low.x, low.z, high.x, high.z];
        let rectangle = [at(x, z), at(to_x, z), at(to_x, to_z), at(x, to_z)];
        let is_met = self.low <= high.y && self.high >= low.y && self.meets(&rectangle);
        if !is_met {
            return BoxPlace::Outside;
        }
        let is_inside = self.low <= low.y && self.high >= high.y && self.covers(&rectangle);
        if is_inside { BoxPlace::Inside } else { BoxPlace::Across }
    }

    pub fn touches(&self, corners: &[DVec3; 3]) -> bool {
        let mut polygon = Vec::with_capacity(5);
        let mut between = Vec::with_capacity(4);
        clip(corners, |at| at.y - self.low, self.low, &mut between);
        clip(&between, |at| self.high - at.y, self.high, &mut polygon);
        let flat: Vec<DVec2> = polygon.iter().map(|at| DVec2::new(at.x, at.z)).collect();
        !flat.is_empty() && self.meets(&flat)
    }

    pub fn holds(&self, corners: &[DVec3; 3]) -> bool {
        corners.iter().all(|at| at.y >= self.low && at.y <= self.high)
            && self.covers(&corners.map(|at| DVec2::new(at.x, at.z)))
    }

    fn edges(&self) -> impl Iterator<Item = (DVec2, DVec2)> + Clone {
        around(&self.polygon)
    }

    /// The edges whose boxes meet a box, rounding apart.
    fn edges_near(&self, min: DVec2, max: DVec2) -> impl Iterator<Item = (DVec2, DVec2)> {
        let reach = self.min.abs().max(self.max.abs()).max(min.abs()).max(max.abs());
        let slack = ROUNDING * reach.max_element();
        self.edges().filter(move |(a, b)| {
            a.min(*b).cmple(max + slack).all() && a.max(*b).cmpge(min - slack).all()
        })
    }

    /// Returns whether a convex polygon, which may be a line or a point, has a point of this one.
    fn meets(&self, convex: &[DVec2]) -> bool {
        let min = convex.iter().copied().fold(DVec2::INFINITY, DVec2::min);
        let max = convex.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
        let slack = ROUNDING * self.min.abs().max(self.max.abs()).max_element();
        if !((min - slack).cmple(self.max) & (max + slack).cmpge(self.min)).all() {
            return false;
        }
        let near: Vec<_> = self.edges_near(min, max).collect();
        let edge_meets = |edge| near.iter().any(|own| edges_meet(*own, edge));
        if self.has(convex[0]) || around(convex).any(edge_meets) {
            return true;
        }
        // Only if all of it is in the convex one, which then has an area.
        let (corner, sign) = (self.polygon[0], area_sign(convex));
        let is_near = corner.cmpge(min).all() && corner.cmple(max).all();
        sign != 0.0 && is_near && around(convex).all(|(a, b)| side(a, b, corner) * sign >= 0.0)
    }

    /// Returns whether all of a polygon, which may be a line or a point, is in this one: if its
    /// edges are, since this one has no holes.
    fn covers(&self, other: &[DVec2]) -> bool {
        other.iter().all(|at| self.has(*at))
            && around(other).all(|(from, to)| self.covers_line(from, to))
    }

    /// Returns whether all of a line is in the polygon, if its ends are.
    fn covers_line(&self, from: DVec2, to: DVec2) -> bool {
        if from == to {
            return true;
        }
        // Where it meets the border, and what of it lies along an edge, in shares of it.
        let (mut cuts, mut along) = (vec![0.0, 1.0], Vec::new());
        let length_squared = from.distance_squared(to);
        let share = |at: DVec2| (at - from).dot(to - from) / length_squared;
        for (a, b) in self.edges_near(from.min(to), from.max(to)) {
            if side(from, to, a) == 0.0 && side(from, to, b) == 0.0 {
                let (a, b) = (share(a), share(b));
                along.push((a.min(b), a.max(b)));
                cuts.extend([a, b]);
            } else {
                let (before, behind) = (side(a, b, from), side(a, b, to));
                if before != behind {
                    cuts.push(before / (before - behind));
                }
            }
        }
        cuts.retain(|cut| (0.0..=1.0).contains(cut));
        cuts.sort_by(f64::total_cmp);
        cuts.windows(2).filter(|part| part[1] - part[0] > PART_MIN).all(|part| {
            let middle = f64::midpoint(part[0], part[1]);
            along.iter().any(|(begin, end)| (begin..=end).contains(&&middle))
                || self.has(from.lerp(to, middle))
        })
    }

    /// Returns whether a point is in the polygon, by counting the edges on one side of it.
    fn has(&self, point: DVec2) -> bool {
        let mut is_in = false;
        for (a, b) in self.edges() {
            let is_across = (a.y > point.y) != (b.y > point.y);
            let is_beside = is_beside(a, b, point);
            if !is_across && !is_beside {
                continue;
            }
            let side = side(a, b, point);
            if is_beside && side == 0.0 {
                return true;
            }
            is_in ^= is_across && (side > 0.0) == (b.y > a.y);
        }
        is_in
    }
}

/// The edges of a polygon; the one of index i begins at corner i.
fn around(polygon: &[DVec2]) -> impl Iterator<Item = (DVec2, DVec2)> + Clone {
    polygon.iter().copied().zip(polygon.iter().copied().cycle().skip(1))
}

/// Twice the area of a triangle, positive if c is left of the way from a to b (x right, y up); 0 if
/// it is so small that rounding may have made it.
fn side(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    let (ab, ac) = (b - a, c - a);
    let area = ab.perp_dot(ac);
    let reach = a.abs().max(b.abs()).max(c.abs()).max_element();
    let slack = ROUNDING * reach * (ab.abs() + ac.abs()).element_sum();
    if area.abs() <= slack { 0.0 } else { area }
}

/// Returns whether a point of the line through a and b lies between the two.
fn is_beside(a: DVec2, b: DVec2, point: DVec2) -> bool {
    let slack = ROUNDING * a.abs().max(b.abs()).max(point.abs()).max_element();
    point.cmpge(a.min(b) - slack).all() && point.cmple(a.max(b) + slack).all()
}

fn edges_meet((a, b): (DVec2, DVec2), (c, d): (DVec2, DVec2)) -> bool {
    let (to_c, to_d) = (side(a, b, c), side(a, b, d));
    let (to_a, to_b) = (side(c, d, a), side(c, d, b));
    let is_opposite = |one: f64, two: f64| one.min(two) < 0.0 && one.max(two) > 0.0;
    (is_opposite(to_c, to_d) && is_opposite(to_a, to_b))
        || (to_c == 0.0 && is_beside(a, b, c))
        || (to_d == 0.0 && is_beside(a, b, d))
        || (to_a == 0.0 && is_beside(c, d, a))
        || (to_b == 0.0 && is_beside(c, d, b))
}

/// 1 or −1 as a convex polygon turns; 0 if it is a line or a point.
fn area_sign(convex: &[DVec2]) -> f64 {
    let first = convex[0];
    let areas = convex.windows(2).map(|edge| side(first, edge[0], edge[1]));
    let area: f64 = areas.sum();
    if area == 0.0 { 0.0 } else { area.signum() }
}

/// The part of a convex polygon where `inside`, which is a height or a depth, is 0 or more; new
/// corners are at `height`.
fn clip(polygon: &[DVec3], inside: impl Fn(&DVec3) -> f64, height: f64, left: &mut Vec<DVec3>) {
    let Some(last) = polygon.last() else { return };
    let mut before = *last;
    for at in polygon {
        let (from, to) = (inside(&before), inside(at));
        if from.min(to) < 0.0 && from.max(to) > 0.0 {
            left.push(before.lerp(*at, from / (from - to)).with_y(height));
        }
        if to >= 0.0 {
            left.push(*at);
        }
        before = *at;
    }
}
