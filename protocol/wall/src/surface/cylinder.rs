//! Patches of cylinders.

use glam::{DQuat, DVec2, DVec3};
use serde::{Deserialize, Serialize};

use super::crossings;

/// Maximum distance beside a patch at which rays still meet its surface, as a share of its width
/// and height: places of patterns and seams beside the edge are known, and nothing is drawn there.
const BESIDE_MAX: f64 = 0.05;

/// A patch of a cylinder. Its own axes: y along the cylinder, azimuth 0 at −Z, growing to +X, so
/// that it grows to the right for a viewer in the middle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cylinder {
    /// A point of its axis, in metres of display space; heights count from here.
    pub center: DVec3,
    /// Turns its own axes into display space.
    pub rotation: DQuat,
    /// In metres.
    pub radius_m: f64,
    /// Azimuths of the left and right edge as the viewer sees them, in radians. Rising: seen from
    /// within; falling: from outside.
    pub azimuth_rad: [f64; 2],
    /// Heights of the lower and the upper edge, in metres.
    pub height_m: [f64; 2],
}

impl Cylinder {
    pub(super) fn display_from_uv(&self, uv: DVec2) -> DVec3 {
        let [left, right] = self.azimuth_rad;
        let [bottom, top] = self.height_m;
        let (sin, cos) = (left + (right - left) * uv.x).sin_cos();
        let y = top + (bottom - top) * uv.y;
        self.center + self.rotation * DVec3::new(self.radius_m * sin, y, -self.radius_m * cos)
    }

    pub(super) fn uv_from_display(&self, point: DVec3) -> Option<DVec2> {
        let own = self.rotation.inverse() * (point - self.center);
        let [left, right] = self.azimuth_rad;
        let [bottom, top] = self.height_m;
        let u = place_of_angle(own.x.atan2(-own.z), left, right);
        let uv = DVec2::new(u, (own.y - top) / (bottom - top));
        uv.is_finite().then_some(uv)
    }

    pub(super) fn normal(&self, uv: DVec2) -> DVec3 {
        let [left, right] = self.azimuth_rad;
        let (sin, cos) = (left + (right - left) * uv.x).sin_cos();
        let inward = self.rotation * DVec3::new(-sin, 0.0, cos);
        if left < right { inward } else { -inward }
    }

    pub(super) fn hit(&self, from: DVec3, direction: DVec3, is_behind: bool) -> Option<DVec3> {
        let inverse = self.rotation.inverse();
        let (p, d) = (inverse * (from - self.center), inverse * direction);
        let flat = |v: DVec3| DVec2::new(v.x, v.z);
        let (p2, d2) = (flat(p), flat(d));
        let both = crossings(p2.dot(p2), p2.dot(d2), d2.dot(d2), self.radius_m)?;
        let is_inside = self.azimuth_rad[0] < self.azimuth_rad[1];
        first_visible_hit(both, is_inside != is_behind, from, direction, |point| {
            self.uv_from_display(point)
        })
    }

    pub(super) fn size_m(&self) -> DVec2 {
        let [left, right] = self.azimuth_rad;
        let [bottom, top] = self.height_m;
        DVec2::new((right - left).abs() * self.radius_m, top - bottom)
    }

    pub(super) fn fault(&self) -> Option<String> {
        let [left, right] = self.azimuth_rad;
        let [bottom, top] = self.height_m;
        let numbers = [self.radius_m, left, right, bottom, top];
        let is_finite = self.center.is_finite()
            && self.rotation.is_finite()
            && numbers.iter().all(|number| number.is_finite());
        let is_patch = self.radius_m > 0.0 && bottom < top && is_sweep(left, right);
        let is_turned = (self.rotation.length() - 1.0).abs() < 1e-6;
        (!(is_finite && is_patch && is_turned)).then(|| "its numbers are no cylinder".into())
    }
}

/// Some angle, and no more than once around.
pub(super) fn is_sweep(left: f64, right: f64) -> bool {
    let sweep = (right - left).abs();
    sweep > 0.0 && sweep <= std::f64::consts::TAU * (1.0 + 1e-12)
}

/// Returns the place of an angle between `left`, 0, and `right`, 1: of all turns, the one nearest
/// to the middle.
pub(super) fn place_of_angle(angle: f64, left: f64, right: f64) -> f64 {
    let middle = f64::midpoint(left, right);
    let turns = ((middle - angle) / std::f64::consts::TAU).round();
    (angle + turns * std::f64::consts::TAU - left) / (right - left)
}

/// The first of both crossings at which the ray meets the side that is seen, on the patch.
pub(super) fn first_visible_hit(
    both: [f64; 2],
    is_inside: bool,
    from: DVec3,
    direction: DVec3,
    uv: impl Fn(DVec3) -> Option<DVec2>,
) -> Option<DVec3> {
    // A ray enters at the first crossing, so that it meets the outside there, and leaves at the
    // second one.
    let t = both[usize::from(is_inside)];
    let point = from + direction * t;
    let beside = DVec2::splat(BESIDE_MAX);
    let on_patch = |uv: DVec2| uv.cmpge(-beside).all() && uv.cmple(DVec2::ONE + beside).all();
    (t > 0.0 && uv(point).is_some_and(on_patch)).then_some(point)
}
