//! The pose of display space in the scene.

mod moves;

use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};

/// The pose of display space in the world: `world = position + rotation * (scale * display)`.
///
/// Looking straight at a wall that stands at z < 0 in display space, the camera looks along its
/// −Z with +Y up, as a glTF camera does.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// The origin of display space, in world units.
    pub position: DVec3,
    /// A unit quaternion.
    pub rotation: DQuat,
    /// World units per metre of display space; above 0.
    pub scale: f64,
}

impl Camera {
    /// The camera at the origin, world units being metres.
    pub const IDENTITY: Self =
        Self { position: DVec3::ZERO, rotation: DQuat::IDENTITY, scale: 1.0 };

    /// A camera at `position` that looks at `target`, with `up` upwards as far as it can be.
    ///
    /// If `up` is parallel to the view, or target and position coincide, some upright pose is
    /// chosen rather than none: a camera path may pass through such a point.
    pub fn look_at(position: DVec3, target: DVec3, up: DVec3) -> Self {
        let backward = (position - target).try_normalize().unwrap_or(DVec3::Z);
        let right = up
            .cross(backward)
            .try_normalize()
            .filter(|_| up.cross(backward).length() > 1e-9 * up.length())
            .unwrap_or_else(|| backward.any_orthonormal_vector());
        let rotation = DMat3::from_cols(right, backward.cross(right), backward);
        Self { position, rotation: DQuat::from_mat3(&rotation).normalize(), scale: 1.0 }
    }

    /// Returns the pose with `scale` world units per metre of display space.
    pub fn with_scale(self, scale: f64) -> Self {
        Self { scale, ..self }
    }

    /// The point of the world where this point of display space lies.
    pub fn world_from_display(&self, display: DVec3) -> DVec3 {
        self.position + self.rotation * (self.scale * display)
    }

    /// Returns the fault of these numbers, if any: they come from outside.
    pub fn fault(&self) -> Option<String> {
        if !self.position.is_finite() {
            return Some(format!("camera position {} is not finite", self.position));
        }
        if !self.rotation.is_finite() || (self.rotation.length() - 1.0).abs() > 1e-3 {
            return Some(format!("camera rotation {} is not a unit quaternion", self.rotation));
        }
        if !(self.scale.is_finite() && self.scale > 0.0) {
            return Some(format!("camera scale {} is not a number above 0", self.scale));
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn look_at_puts_the_target_on_minus_z() {
        let camera = Camera::look_at(DVec3::new(3.0, 2.0, 1.0), DVec3::ZERO, DVec3::Y);
        let ahead = camera.world_from_display(DVec3::NEG_Z);
        let expected = camera.position - camera.position.normalize();
        assert!((ahead - expected).length() < 1e-12, "{ahead} is not {expected}");
        assert!(camera.fault().is_none());
    }

    #[test]
    fn look_at_survives_up_parallel_to_the_view_and_no_direction() {
        for (position, target) in [(DVec3::Y, DVec3::ZERO), (DVec3::ONE, DVec3::ONE)] {
            let camera = Camera::look_at(position, target, DVec3::Y);
            assert!(camera.fault().is_none(), "{camera:?}");
        }
    }
}
