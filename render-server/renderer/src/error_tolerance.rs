//! The errors of levels of detail that a view may draw: a function of the scene, of the point
//! between the viewer's eyes and of the allowed error, never of the channel.
//!
//! All is decided in f64 and by the same steps for the same numbers, so that all meshlets of a
//! group, both eyes and all channels come to one answer.

use glam::{DMat3, DVec3};
use polyptych_scene::meshlet::{ErrorSphere, Meshlet};

use super::scene::{Bounds, Stance};
use super::view::{AllowedError, ViewDesc};

/// Slack where many spheres are decided at once, relative to the sizes involved: far above the
/// rounding of f64, so that each of them by itself would be decided alike.
const SLACK: f64 = 1e-9;

/// The share of a distance by which rounding may change it, and more.
const ROUNDING: f64 = 1e-6;

/// Bits of a number's mantissa below the three highest.
const LOW_MANTISSA_BITS: u32 = 49;

/// A sphere around spheres of errors, in the primitive's space.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BoundingSphere {
    pub center: DVec3,
    pub radius: f64,
}

impl BoundingSphere {
    /// Around the middle of the box around all; around everything if one has no bounds.
    pub fn around<'a>(spheres: impl Iterator<Item = &'a ErrorSphere> + Clone) -> Self {
        let corners = |of: &ErrorSphere| {
            let (center, half) = (of.center.as_dvec3(), DVec3::splat(f64::from(of.radius)));
            Bounds { min: center - half, max: center + half }
        };
        let center = spheres.clone().map(corners).fold(Bounds::EMPTY, Bounds::union).center();
        if !center.is_finite() {
            return Self { center: DVec3::ZERO, radius: f64::INFINITY };
        }
        let reach = |of: &ErrorSphere| of.center.as_dvec3().distance(center) + f64::from(of.radius);
        Self { center, radius: spheres.map(reach).fold(0.0, f64::max) }
    }
}

/// The error that a view allows at each distance.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ErrorTolerance {
    /// The point between the eyes, in world space.
    eye: DVec3,
    /// No eye is farther from that point, in units of the world.
    eye_offset: f64,
    angle_rad: f64,
    length: f64,
    /// The unit of errors that are larger than allowed: an angle, and a length.
    unit: [f64; 2],
}

impl ErrorTolerance {
    pub fn new(view: &ViewDesc) -> Self {
        let AllowedError { angle_rad, length, eye_offset, pixel, .. } = view.allowed_error;
        let eye = view.middle_eye_in_world;
        if view.is_parallel() {
            // What parallel rays show of an error is the same at all distances.
            let unit = [0.0, if length > 0.0 { length } else { pixel }];
            return Self { eye, eye_offset: 0.0, angle_rad: 0.0, length, unit };
        }
        let eye_offset = rounded_up(view.eye_in_world.distance(eye).max(eye_offset));
        let unit = if angle_rad > 0.0 || length > 0.0 { [angle_rad, length] } else { [pixel, 0.0] };
        Self { eye, eye_offset, angle_rad, length, unit }
    }

    /// Returns whether only the finest level is allowed.
    pub fn is_zero(&self) -> bool {
        self.angle_rad <= 0.0 && self.length <= 0.0
    }

    /// The allowed error so far from the point between the eyes, in units of the world.
    fn at(&self, distance: f64) -> f64 {
        // Without an angle it does not depend on a distance, which may be infinite.
        let grown = if self.angle_rad > 0.0 { (distance - self.eye_offset).max(0.0) } else { 0.0 };
        self.angle_rad * grown + self.length
    }

    /// Returns the diameter of a sphere in world space as a share of the allowed error, if it is so
    /// small that what is in it may be left out: below 1, and with no eye inside.
    pub fn share_if_small(&self, (center, radius): (DVec3, f64)) -> Option<f64> {
        let distance = center.distance(self.eye) - radius;
        let (size, allowed) = (2.0 * radius, self.at(distance));
        (distance > self.eye_offset && size < allowed).then(|| size / allowed)
    }

    /// The errors of an item with its origin in world space.
    pub fn of_item(&self, origin: DVec3, stance: &Stance) -> ItemErrors {
        ItemErrors {
            tolerance: *self,
            is_zero: self.is_zero(),
            origin: origin - self.eye,
            linear: stance.linear,
            stretch: stance.stretch,
        }
    }
}

/// The next number with three bits of mantissa above a distance. The eyes are equally far from the
/// point between them, but for rounding: this makes it one number for both.
pub(crate) fn rounded_up(distance: f64) -> f64 {
    let bits = (distance * (1.0 + ROUNDING)).to_bits();
    f64::from_bits(bits.next_multiple_of(1 << LOW_MANTISSA_BITS))
}

/// The errors of an item's levels, compared with what is allowed where it stands.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ItemErrors {
    tolerance: ErrorTolerance,
    is_zero: bool,
    /// The position relative to the point between the eyes, in world axes.
    origin: DVec3,
    linear: DMat3,
    /// No length in the primitive's space is longer in the world, times this.
    stretch: f64,
}

impl ItemErrors {
    /// Returns an error as a share of what is allowed at the nearest point of its sphere, 0 to 1;
    /// `None` if it is not allowed. 0 always is, infinity never.
    pub fn share(&self, error: f32, sphere: &ErrorSphere) -> Option<f64> {
        if error == 0.0 {
            return Some(0.0);
        }
        if self.is_zero || error.is_infinite() {
            return None;
        }
        let center = self.origin + self.linear * sphere.center.as_dvec3();
        let distance = center.length() - self.stretch * f64::from(sphere.radius);
        self.compared(error, self.tolerance.at(distance))
    }

    /// Returns the share of a meshlet's error, if it is drawn: its own error is allowed, and that
    /// of what would replace it is not.
    ///
    /// Along a chain of replacements, errors begin with 0, which is allowed, and end with infinity,
    /// which is not: so at least one level of each part of the surface is drawn, whatever the
    /// numbers between, and exactly one if errors and spheres do not shrink.
    pub fn share_if_drawn(&self, meshlet: &Meshlet) -> Option<f64> {
        if self.share(meshlet.coarser_error, &meshlet.coarser_sphere).is_some() {
            return None;
        }
        self.share(meshlet.error, &meshlet.sphere)
    }

    /// Returns the least and the greatest error that may be allowed at any sphere within this one.
    pub fn allowed_within(&self, around: &BoundingSphere) -> [f64; 2] {
        if self.is_zero {
            return [0.0; 2];
        }
        let center = self.linear * around.center;
        let reach = self.stretch * around.radius;
        let sizes = self.origin.abs().element_sum() + center.abs().element_sum() + reach;
        let distance = (self.origin + center).length();
        let slack = SLACK * sizes;
        [-reach - slack, reach + slack].map(|by| self.tolerance.at(distance + by))
    }

    /// Returns an error that is drawn though it may be larger than allowed, where it is at the
    /// nearest point of a sphere: as a share of what is allowed, or in pixels if nothing is.
    ///
    /// An eye that is nearer than the error itself sees it from there: under a radian.
    pub fn held_share(&self, error: f32, around: &BoundingSphere) -> f64 {
        let length = f64::from(error) * self.stretch;
        if length <= 0.0 {
            return 0.0;
        }
        let center = self.origin + self.linear * around.center;
        let distance = center.length() - self.stretch * around.radius;
        let [angle_rad, by_length] = self.tolerance.unit;
        let unit = angle_rad * distance.max(length) + by_length;
        if unit > 0.0 { length / unit } else { 0.0 }
    }

    /// Returns an error above 0 as a share of an allowed one, in units of the world; `None` if it
    /// is greater.
    pub fn compared(&self, error: f32, allowed: f64) -> Option<f64> {
        let length = f64::from(error) * self.stretch;
        let is_allowed = !self.is_zero && length <= allowed;
        is_allowed.then(|| if length > 0.0 { (length / allowed).min(1.0) } else { 0.0 })
    }
}
