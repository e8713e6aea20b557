//! Projectors: pinholes that throw pixels onto a screen.

use glam::{DQuat, DVec2, DVec3};
use serde::{Deserialize, Serialize};

use super::surface::Surface;

/// A projector without distortion: a pinhole with an image plane.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Projector {
    /// Where its light comes from, in metres of display space.
    pub position: DVec3,
    /// Turns its own axes (x right and y up in its picture, light goes along −Z) into display
    /// space.
    pub rotation: DQuat,
    /// Tangents of its picture's edges from the axis: left, right, bottom, top; left < right and
    /// bottom < top. A lens shift makes them unequal.
    pub tangents: [f64; 4],
}

impl Projector {
    /// The direction, not normalised, in which the light of a place of its picture goes, (0, 0)
    /// being the upper left corner and (1, 1) the lower right one.
    pub fn direction(&self, place: DVec2) -> DVec3 {
        let [left, right, bottom, top] = self.tangents;
        let x = left + (right - left) * place.x;
        let y = top + (bottom - top) * place.y;
        self.rotation * DVec3::new(x, y, -1.0)
    }

    /// The point of a surface that a place of its picture lights.
    pub fn lit(&self, surface: &Surface, place: DVec2) -> Option<DVec3> {
        surface.hit(self.position, self.direction(place))
    }

    /// The place of its picture whose light goes through a point of display space; `None` for
    /// one that is not in front of it.
    pub fn place(&self, point: DVec3) -> Option<DVec2> {
        let own = self.rotation.inverse() * (point - self.position);
        let [left, right, bottom, top] = self.tangents;
        (own.z < 0.0).then(|| {
            let (x, y) = (own.x / -own.z, own.y / -own.z);
            DVec2::new((x - left) / (right - left), (y - top) / (bottom - top))
        })
    }

    pub(super) fn fault(&self) -> Option<String> {
        let [left, right, bottom, top] = self.tangents;
        let is_finite = self.position.is_finite()
            && self.rotation.is_finite()
            && self.tangents.iter().all(|tangent| tangent.is_finite());
        let is_turned = (self.rotation.length() - 1.0).abs() < 1e-6;
        (!(is_finite && is_turned && left < right && bottom < top))
            .then(|| "its projector has no pose or no picture".into())
    }
}
