//! Projectors: pinholes that throw pixels onto a screen.

use glam::{DQuat, DVec2, DVec3};
use serde::{Deserialize, Serialize};

use super::surface::Surface;

/// Rays across and down that say from which side a projector lights its screen.
const SIDE_RAYS: u32 = 9;

/// A projector without distortion: a pinhole with an image plane.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Projector {
    /// The point from which its light comes, in metres of display space.
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

    /// The point of a surface that a place of its picture lights, from either side.
    pub fn intersect(&self, surface: &Surface, place: DVec2) -> Option<DVec3> {
        let hit = |side| surface.hit_side(self.position, self.direction(place), side);
        hit(false).or_else(|| hit(true))
    }

    /// Returns whether it is a rear projector: more of its rays meet the back of a screen first
    /// than its front. `side_of` returns whether a ray meets a back first; `None` if it meets
    /// nothing.
    pub(super) fn is_rear(&self, side_of: impl Fn(DVec3) -> Option<bool>) -> bool {
        let place = |step: u32| (f64::from(step) + 0.5) / f64::from(SIDE_RAYS);
        let places = (0..SIDE_RAYS).flat_map(|y| (0..SIDE_RAYS).map(move |x| (x, y)));
        let rays = places.map(|(x, y)| self.direction(DVec2::new(place(x), place(y))));
        let sides: Vec<bool> = rays.filter_map(side_of).collect();
        let backs = sides.iter().filter(|is_back| **is_back).count();
        backs * 2 > sides.len()
    }

    /// The place of its picture whose light goes through a point of display space; `None` for
    /// one that is not in front of it.
    pub fn project(&self, point: DVec3) -> Option<DVec2> {
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
