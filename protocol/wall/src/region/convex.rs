//! Convex regions: what lies in all of some half spaces.

use glam::DVec3;

use super::{BoxPlace, HalfSpace, ROUNDING, RegionError, check_all};
use crate::limits::REGION_PLANES_MAX;

/// Three planes meet in one point if the volume that their normals span is more than this.
const VOLUME_MIN: f64 = 1e-12;

/// Distance from a border within which a point that was computed in several steps is in doubt, as a
/// share of the coordinates that it was computed from: it is farther off the flatter the planes
/// meet.
const DOUBT_SHARE: f64 = 1e-9;

/// Half spaces with normals whose largest coordinate is 1 to 2: scaled by powers of two, and so as
/// exact as they were given.
#[derive(Clone, Debug)]
pub(super) struct Convex(Vec<HalfSpace>);

impl Convex {
    /// The region, with the box around it if it has an end in all directions.
    pub fn new(planes: &[HalfSpace]) -> Result<(Self, Option<(DVec3, DVec3)>), RegionError> {
        if !(3..=REGION_PLANES_MAX).contains(&planes.len()) {
            return Err(RegionError::Planes(planes.len()));
        }
        let scaled = |(index, plane): (usize, &HalfSpace)| {
            check_all("the normal of a plane", &plane.normal.to_array())?;
            let size = plane.normal.abs().max_element();
            if !size.is_normal() {
                return Err(RegionError::Normal(index));
            }
            let scale = (-size.log2().floor()).exp2();
            let offset = plane.offset * scale;
            check_all("the distance of a plane", &[offset])?;
            Ok(HalfSpace { normal: plane.normal * scale, offset })
        };
        let planes = planes.iter().enumerate().map(scaled);
        let convex = Self(planes.collect::<Result<_, _>>()?);
        let corners = convex.corners();
        let (Some(low), Some(high)) = (
            corners.iter().copied().reduce(DVec3::min),
            corners.iter().copied().reduce(DVec3::max),
        ) else {
            return Err(RegionError::NoCorner);
        };
        let around = (!convex.is_endless()).then_some((low, high));
        Ok((convex, around))
    }

    /// The points where three planes meet that lie in all half spaces.
    fn corners(&self) -> Vec<DVec3> {
        let mut found = Vec::new();
        for (i, a) in self.0.iter().enumerate() {
            for (j, b) in self.0.iter().enumerate().skip(i + 1) {
                let ab = a.normal.cross(b.normal);
                for c in &self.0[j + 1..] {
                    let volume = ab.dot(c.normal);
                    if volume.abs() < VOLUME_MIN {
                        continue;
                    }
                    let (bc, ca) = (b.normal.cross(c.normal), c.normal.cross(a.normal));
                    let at = (a.offset * bc + b.offset * ca + c.offset * ab) / volume;
                    let is_in =
                        |plane: &HalfSpace| plane.height(at) <= plane.slack(at, DOUBT_SHARE);
                    if self.0.iter().all(is_in) {
                        found.push(at);
                    }
                }
            }
        }
        found
    }

    /// Returns whether some direction leads out of no half space; the region has a corner, so that
    /// one along two of its planes does if any does.
    fn is_endless(&self) -> bool {
        let leads_on =
            |direction: DVec3| self.0.iter().all(|plane| plane.normal.dot(direction) <= VOLUME_MIN);
        self.0.iter().enumerate().any(|(i, a)| {
            self.0[i + 1..].iter().any(|b| {
                let along = a.normal.cross(b.normal).normalize_or_zero();
                along != DVec3::ZERO && (leads_on(along) || leads_on(-along))
            })
        })
    }

    pub fn has(&self, point: DVec3) -> bool {
        self.0.iter().all(|plane| plane.has(point))
    }

    pub fn place_of_box(&self, low: DVec3, high: DVec3) -> BoxPlace {
        let (center, half) = ((low + high) * 0.5, (high - low) * 0.5);
        let mut is_inside = true;
        for plane in &self.0 {
            let (height, reach) = (plane.height(center), plane.normal.abs().dot(half));
            let slack = plane.slack(center, ROUNDING) + ROUNDING * reach;
            let is_met = height - reach <= slack;
            if !is_met {
                return BoxPlace::Outside;
            }
            is_inside &= height + reach <= -slack;
        }
        if is_inside { BoxPlace::Inside } else { BoxPlace::Across }
    }

    pub fn touches(&self, corners: &[DVec3; 3]) -> bool {
        let reach = corners.iter().map(|at| at.abs().element_sum()).fold(0.0, f64::max);
        // Clipping is fast and decides all triangles but those that end at a border.
        self.clips(corners, reach, -DOUBT_SHARE)
            || (self.clips(corners, reach, DOUBT_SHARE) && self.is_met_in_shares(corners, reach))
    }

    /// Returns whether anything is left of a triangle that is clipped by each plane in turn, all
    /// moved outward by a share of the coordinates: I. Sutherland, G. Hodgman, *Reentrant polygon
    /// clipping*, 1974.
    fn clips(&self, corners: &[DVec3; 3], reach: f64, share: f64) -> bool {
        let mut polygon = corners.to_vec();
        let mut left = Vec::new();
        for plane in &self.0 {
            left.clear();
            let moved = share * (reach + plane.offset.abs());
            let mut before = polygon[polygon.len() - 1];
            for &at in &polygon {
                let (from, to) = (plane.height(before) - moved, plane.height(at) - moved);
                if from.min(to) < 0.0 && from.max(to) > 0.0 {
                    left.push(before.lerp(at, from / (from - to)));
                }
                if to <= 0.0 {
                    left.push(at);
                }
                before = at;
            }
            std::mem::swap(&mut polygon, &mut left);
            if polygon.is_empty() {
                return false;
            }
        }
        true
    }

    /// Returns whether a triangle with corners a, b, c has a point of all half spaces. In shares
    /// u, v of its edges b − a, c − a each is an inequality, as are the triangle's own edges; if
    /// all can be met, they are where two of them are equations. No step divides, so that the
    /// error of a result stays a few roundings of the numbers that it comes from.
    fn is_met_in_shares(&self, &[a, b, c]: &[DVec3; 3], reach: f64) -> bool {
        // Shares of u and v, the most that they may sum up to, and the size of what this was
        // computed from.
        let mut rows = vec![[-1.0, 0.0, 0.0, 1.0], [0.0, -1.0, 0.0, 1.0], [1.0, 1.0, 1.0, 1.0]];
        rows.extend(self.0.iter().map(|plane| {
            let along = |to: DVec3| plane.normal.dot(to) - plane.normal.dot(a);
            [along(b), along(c), -plane.height(a), 2.0 * (reach + plane.offset.abs())]
        }));
        let is_met = |one: &[f64; 4], two: &[f64; 4]| {
            let (volume, size) = (one[0] * two[1] - two[0] * one[1], one[3] * two[3]);
            let (u, v) = (one[2] * two[1] - two[2] * one[1], one[0] * two[2] - two[0] * one[2]);
            let is_under = |row: &[f64; 4]| {
                let over = (row[0] * u + row[1] * v) * volume.signum() - row[2] * volume.abs();
                over <= ROUNDING * size * row[3]
            };
            volume.abs() > ROUNDING * size && rows.iter().all(is_under)
        };
        rows.iter().enumerate().any(|(i, one)| rows[i + 1..].iter().any(|two| is_met(one, two)))
    }
}

impl HalfSpace {
    /// Returns the distance of a point outside in lengths of the normal; negative inside.
    fn height(&self, point: DVec3) -> f64 {
        self.normal.dot(point) - self.offset
    }

    fn slack(&self, point: DVec3, share: f64) -> f64 {
        share * (point.abs().element_sum() + self.offset.abs())
    }

    fn has(&self, point: DVec3) -> bool {
        self.height(point) <= self.slack(point, ROUNDING)
    }
}
