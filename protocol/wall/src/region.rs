//! Regions of the world, and which triangles lie in them: f64.
//!
//! Borders belong to a region. Points that are computed on the way, such as where an edge meets a
//! plane, count as in it if they lie beyond its border by no more than [`ROUNDING`] of the
//! coordinates that they were computed from, so that what touches a border is found. Corners of
//! triangles are compared with boxes and with the height of prisms as they are.

mod convex;
mod prism;

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use self::convex::Convex;
use self::prism::Prism;
use crate::limits::{REGION_CORNERS_MAX, REGION_PLANES_MAX, REGION_REACH_MAX};
use crate::triangle_distance::nearest_on_triangle;

/// Distance beyond a border within which a computed point counts as on it, as a share of the
/// coordinates that it was computed from: 16 roundings of f64, which is more than the few
/// operations make that lead to it.
pub const ROUNDING: f64 = 16.0 * f64::EPSILON;

/// A part of the world, in world units; its border belongs to it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Region {
    /// A box along the axes; it may be flat.
    Box {
        /// Its lowest corner.
        min: DVec3,
        /// Its highest corner, at least `min` on each axis.
        max: DVec3,
    },
    /// A ball.
    Sphere {
        /// Its centre.
        center: DVec3,
        /// Its radius, 0 or more.
        radius: f64,
    },
    /// A vertical prism over a polygon, which need not be convex.
    Prism {
        /// The corners of the polygon, x and z, in either direction: 3 to [`REGION_CORNERS_MAX`].
        /// Its edges meet at its corners only.
        polygon: Vec<DVec2>,
        /// The height of its floor, y.
        low: f64,
        /// The height of its roof, y; at least `low`.
        high: f64,
    },
    /// The common part of these half spaces, 3 to [`REGION_PLANES_MAX`]: a convex polyhedron, or a
    /// pyramid without an end.
    Convex(Vec<HalfSpace>),
}

/// The points whose product with `normal` is at most `offset`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct HalfSpace {
    /// Out of the half space; of any length but 0.
    pub normal: DVec3,
    /// The product of `normal` with a point of the border plane.
    pub offset: f64,
}

/// The relation of a node's triangles to a region.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Relation {
    /// All of every triangle is in the region.
    Inside,
    /// Some triangle has a point of the region.
    Touches,
    /// All of the region is in the node's box, along the axes of the world. No box contains a
    /// region without an end.
    Contains,
    /// No triangle has a point of the region.
    Disjoint,
}

/// The reason why a region cannot be queried.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RegionError {
    /// A coordinate is NaN, infinite or too large.
    #[error("{what} is {value:e}; give a finite number, at most {REGION_REACH_MAX:e} from 0")]
    NoNumber {
        /// The number that is wrong.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// Its ends are in the wrong order.
    #[error("the region is empty: its {axis} ends at {end} and begins at {begin}; swap the two")]
    Empty {
        /// x, y or z.
        axis: char,
        /// Its lower end.
        begin: f64,
        /// Its upper end, which is less.
        end: f64,
    },
    /// A sphere of a negative radius.
    #[error("the region is empty: its radius is {0}; give 0 or more")]
    Radius(f64),
    /// A prism of too few or too many corners.
    #[error("the prism has {0} corners; give 3 to {REGION_CORNERS_MAX}")]
    Corners(usize),
    /// A polygon with edges that cross or touch each other.
    #[error(
        "edges {first} and {second} of the prism's polygon meet beside their common corner, or \
         have no length; give corners in order, whose edges do not cross"
    )]
    Edges {
        /// The edge from the corner of this index.
        first: usize,
        /// The edge from the corner of this index.
        second: usize,
    },
    /// Too few or too many planes.
    #[error("the region has {0} planes; give 3 to {REGION_PLANES_MAX}")]
    Planes(usize),
    /// A plane without a direction.
    #[error("the normal of plane {0} has no length; give a normal out of the region")]
    Normal(usize),
    /// Planes that leave nothing, or a space without a corner.
    #[error(
        "the region of these planes has no corner: it is empty, or goes on in opposite directions; \
         turn normals out of it, and add planes until it has a corner"
    )]
    NoCorner,
}

/// The place of a box relative to a region.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoxPlace {
    /// It has no point of the region.
    Outside,
    /// All of it is in the region.
    Inside,
    /// Neither is known.
    Across,
}

/// A checked region, ready for many triangles.
#[derive(Clone, Debug)]
pub struct RegionTest {
    shape: Shape,
    /// The box around it, along the axes; `None` if it goes on without an end.
    around: Option<(DVec3, DVec3)>,
}

#[derive(Clone, Debug)]
enum Shape {
    Box { min: DVec3, max: DVec3 },
    Sphere { center: DVec3, radius: f64 },
    Prism(Prism),
    Convex(Convex),
}

impl RegionTest {
    /// Checks a region.
    ///
    /// # Errors
    /// [`RegionError`]
    pub fn new(region: &Region) -> Result<Self, RegionError> {
        match region {
            Region::Box { min, max } => {
                check_all("a corner of the box", &[min.to_array(), max.to_array()].concat())?;
                for (axis, (begin, end)) in
                    ['x', 'y', 'z'].into_iter().zip(min.to_array().into_iter().zip(max.to_array()))
                {
                    check_order(axis, begin, end)?;
                }
                let (min, max) = (*min, *max);
                Ok(Self { shape: Shape::Box { min, max }, around: Some((min, max)) })
            }
            Region::Sphere { center, radius } => {
                check_all("the centre of the sphere", &center.to_array())?;
                check_all("the radius of the sphere", &[*radius])?;
                if *radius < 0.0 {
                    return Err(RegionError::Radius(*radius));
                }
                let (center, radius) = (*center, *radius);
                let around = Some((center - radius, center + radius));
                Ok(Self { shape: Shape::Sphere { center, radius }, around })
            }
            Region::Prism { polygon, low, high } => {
                let prism = Prism::new(polygon, *low, *high)?;
                let around = Some(prism.around());
                Ok(Self { shape: Shape::Prism(prism), around })
            }
            Region::Convex(planes) => {
                let (convex, around) = Convex::new(planes)?;
                Ok(Self { shape: Shape::Convex(convex), around })
            }
        }
    }

    /// Returns whether all of the region is in a box.
    pub fn is_within(&self, low: DVec3, high: DVec3) -> bool {
        self.around.is_some_and(|(min, max)| min.cmpge(low).all() && max.cmple(high).all())
    }

    /// Returns where a box along the axes lies to the region.
    pub fn place_of_box(&self, low: DVec3, high: DVec3) -> BoxPlace {
        let is_met = |(min, max): (DVec3, DVec3)| (min.cmple(high) & max.cmpge(low)).all();
        if !self.around.is_none_or(is_met) {
            return BoxPlace::Outside;
        }
        let is_inside = match &self.shape {
            Shape::Box { min, max } => min.cmple(low).all() && max.cmpge(high).all(),
            Shape::Sphere { center, radius } => {
                if !is_near(*center, center.clamp(low, high), *radius) {
                    return BoxPlace::Outside;
                }
                let farthest = (*center - low).abs().max((high - *center).abs());
                farthest.length() <= *radius
            }
            Shape::Prism(prism) => return prism.place_of_box(low, high),
            Shape::Convex(convex) => return convex.place_of_box(low, high),
        };
        if is_inside { BoxPlace::Inside } else { BoxPlace::Across }
    }

    /// Returns whether a triangle has a point of the region; it may be a line or a point.
    pub fn touches(&self, corners: &[DVec3; 3]) -> bool {
        match &self.shape {
            Shape::Box { min, max } => meets_box(corners, *min, *max),
            Shape::Sphere { center, radius } => {
                is_near(*center, nearest_on_triangle(*center, corners), *radius)
            }
            Shape::Prism(prism) => prism.touches(corners),
            Shape::Convex(convex) => convex.touches(corners),
        }
    }

    /// Returns whether all of a triangle is in the region.
    pub fn holds(&self, corners: &[DVec3; 3]) -> bool {
        match &self.shape {
            Shape::Box { min, max } => {
                corners.iter().all(|at| at.cmpge(*min).all() && at.cmple(*max).all())
            }
            Shape::Sphere { center, radius } => {
                corners.iter().all(|at| is_near(*center, *at, *radius))
            }
            Shape::Prism(prism) => prism.holds(corners),
            Shape::Convex(convex) => corners.iter().all(|at| convex.has(*at)),
        }
    }
}

/// Returns whether a point is no farther from a centre than a radius, rounding apart; NaN is not.
fn is_near(center: DVec3, point: DVec3, radius: f64) -> bool {
    let reach = center.abs().max_element().max(point.abs().max_element());
    point.distance(center) <= radius + ROUNDING * (radius + reach)
}

/// Returns whether a triangle meets a box, by looking for an axis that separates them:
/// T. Akenine-Möller, *Fast 3D triangle-box overlap testing*, 2001.
fn meets_box(corners: &[DVec3; 3], min: DVec3, max: DVec3) -> bool {
    let [a, b, c] = *corners;
    let is_between = a.min(b).min(c).cmple(max) & a.max(b).max(c).cmpge(min);
    if !is_between.all() {
        return false;
    }
    let edges = [b - a, c - b, a - c];
    let crosses = |edge: DVec3| DVec3::AXES.map(|axis| axis.cross(edge));
    let normal = edges[0].cross(edges[1]);
    let mut axes = edges.into_iter().flat_map(crosses).chain([normal]);
    // From a corner of the triangle, so that less is rounded.
    let (low, high) = (min - a, max - a);
    let (to_b, to_c) = (b - a, c - a);
    let reach = [a, b, c, min, max].map(|at| at.abs().max_element()).into_iter();
    let reach = reach.fold(0.0, f64::max);
    axes.all(|axis| {
        let (b, c) = (axis.dot(to_b), axis.dot(to_c));
        let (one, two) = (axis * low, axis * high);
        let (least, most) = (one.min(two).element_sum(), one.max(two).element_sum());
        let slack = ROUNDING * reach * axis.abs().element_sum();
        least <= b.max(c).max(0.0) + slack && most >= b.min(c).min(0.0) - slack
    })
}

fn check_all(what: &'static str, numbers: &[f64]) -> Result<(), RegionError> {
    let wrong = numbers.iter().find(|number| number.is_nan() || number.abs() > REGION_REACH_MAX);
    wrong.map_or(Ok(()), |value| Err(RegionError::NoNumber { what, value: *value }))
}

fn check_order(axis: char, begin: f64, end: f64) -> Result<(), RegionError> {
    if begin <= end { Ok(()) } else { Err(RegionError::Empty { axis, begin, end }) }
}

#[cfg(test)]
mod tests;
