//! Patches of spheres: domes.

use std::f64::consts::FRAC_PI_2;

use glam::{DQuat, DVec2, DVec3};
use serde::{Deserialize, Serialize};

use super::crossings;
use super::cylinder::{first_visible_hit, is_sweep, place_of_angle};

/// A patch of a sphere, seen from within unless its azimuths fall. Its own axes: azimuth 0 at −Z,
/// growing to +X; elevation 0 on the equator, π/2 at +Y.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sphere {
    /// In metres of display space.
    pub center: DVec3,
    /// Turns its own axes into display space.
    pub rotation: DQuat,
    /// In metres.
    pub radius_m: f64,
    /// Azimuths of the left and right edge as the viewer sees them, in radians.
    pub azimuth_rad: [f64; 2],
    /// Elevations of the lower and the upper edge, in radians, from −π/2 to π/2.
    pub elevation_rad: [f64; 2],
}

impl Sphere {
    pub(super) fn display_from_uv(&self, uv: DVec2) -> DVec3 {
        let [left, right] = self.azimuth_rad;
        let [bottom, top] = self.elevation_rad;
        let (sin, cos) = (left + (right - left) * uv.x).sin_cos();
        let (up, out) = (top + (bottom - top) * uv.y).sin_cos();
        self.center + self.rotation * (DVec3::new(out * sin, up, -out * cos) * self.radius_m)
    }

    pub(super) fn uv_from_display(&self, point: DVec3) -> Option<DVec2> {
        let own = self.rotation.inverse() * (point - self.center);
        let [left, right] = self.azimuth_rad;
        let [bottom, top] = self.elevation_rad;
        let elevation = own.y.atan2(own.x.hypot(own.z));
        let u = place_of_angle(own.x.atan2(-own.z), left, right);
        let uv = DVec2::new(u, (elevation - top) / (bottom - top));
        uv.is_finite().then_some(uv)
    }

    pub(super) fn normal(&self, uv: DVec2) -> DVec3 {
        let inward = self.center - self.display_from_uv(uv);
        if self.azimuth_rad[0] < self.azimuth_rad[1] { inward } else { -inward }
    }

    pub(super) fn hit(&self, from: DVec3, direction: DVec3, is_behind: bool) -> Option<DVec3> {
        let p = from - self.center;
        let both = crossings(p.dot(p), p.dot(direction), direction.dot(direction), self.radius_m)?;
        let is_inside = self.azimuth_rad[0] < self.azimuth_rad[1];
        first_visible_hit(both, is_inside != is_behind, from, direction, |point| {
            self.uv_from_display(point)
        })
    }

    pub(super) fn size_m(&self) -> DVec2 {
        let [left, right] = self.azimuth_rad;
        let [bottom, top] = self.elevation_rad;
        DVec2::new((right - left).abs(), top - bottom) * self.radius_m
    }

    pub(super) fn fault(&self) -> Option<String> {
        let [left, right] = self.azimuth_rad;
        let [bottom, top] = self.elevation_rad;
        let is_finite = self.center.is_finite()
            && self.rotation.is_finite()
            && self.radius_m.is_finite()
            && left.is_finite()
            && right.is_finite();
        let range = -FRAC_PI_2 - 1e-12..=FRAC_PI_2 + 1e-12;
        let is_patch = self.radius_m > 0.0
            && is_sweep(left, right)
            && bottom < top
            && range.contains(&bottom)
            && range.contains(&top);
        let is_turned = (self.rotation.length() - 1.0).abs() < 1e-6;
        (!(is_finite && is_patch && is_turned)).then(|| "its numbers are no sphere".into())
    }
}
