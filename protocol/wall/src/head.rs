//! The viewer's head: where both eyes are.

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

use crate::Eye;

/// Farthest from the origin of display space that a head may be: a thousand kilometres are a slip
/// of the unit, and larger numbers would overflow when they are squared and multiplied.
pub const HEAD_REACH_MAX_M: f64 = 1e6;

/// Widest eyes: walls of models have large viewers, but a thousand metres are a slip of the unit.
pub const EYE_SEPARATION_MAX_M: f64 = 1e3;

/// The pose of the viewer's head in display space. All frusta of a frame follow from it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeadPose {
    /// The middle between the eyes, in metres.
    pub position: DVec3,
    /// A unit quaternion; at rest the head looks along −Z, +X is at its right.
    pub rotation: DQuat,
    /// From the left eye to the right one, in metres, 0 or more.
    pub eye_separation_m: f64,
}

impl HeadPose {
    /// A head at rest.
    pub fn facing_forward(position: DVec3, eye_separation_m: f64) -> Self {
        Self { position, rotation: DQuat::IDENTITY, eye_separation_m }
    }

    /// Returns the position of an eye, in metres of display space.
    pub fn eye(&self, of: Eye) -> DVec3 {
        let sideways = match of {
            Eye::Center => return self.position,
            Eye::Left => -0.5,
            Eye::Right => 0.5,
        };
        self.position + self.rotation * DVec3::new(sideways * self.eye_separation_m, 0.0, 0.0)
    }

    /// Returns the fault of these numbers, if any: they come from outside.
    pub fn fault(&self) -> Option<String> {
        if !self.position.is_finite() {
            return Some(format!("head position {} is not finite", self.position));
        }
        if self.position.abs().max_element() > HEAD_REACH_MAX_M {
            let reach = HEAD_REACH_MAX_M;
            return Some(format!("head position {} is beyond {reach} metres", self.position));
        }
        if !self.rotation.is_finite() || (self.rotation.length() - 1.0).abs() > 1e-3 {
            return Some(format!("head rotation {} is not a unit quaternion", self.rotation));
        }
        let separation = self.eye_separation_m;
        (!(0.0..=EYE_SEPARATION_MAX_M).contains(&separation)).then(|| {
            format!("an eye separation of {separation} m, where 0 to {EYE_SEPARATION_MAX_M} can be")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_right_eye_is_at_the_right_of_the_left_one() {
        let head = HeadPose::facing_forward(DVec3::new(0.0, 1.7, 0.5), 0.06);
        assert!(head.eye(Eye::Left).distance(DVec3::new(-0.03, 1.7, 0.5)) < 1e-15);
        assert!(head.eye(Eye::Right).distance(DVec3::new(0.03, 1.7, 0.5)) < 1e-15);
        assert_eq!(head.eye(Eye::Center), head.position);
        // Who looks to the left, along −X, has the right eye ahead of the room's own −Z.
        let turned = HeadPose { rotation: DQuat::from_rotation_y(90_f64.to_radians()), ..head };
        assert!(turned.eye(Eye::Right).distance(DVec3::new(0.0, 1.7, 0.47)) < 1e-12);
    }

    #[test]
    fn numbers_that_are_no_head_are_told() {
        let head = HeadPose::facing_forward(DVec3::ZERO, 0.06);
        assert_eq!(head.fault(), None);
        for bad in [
            HeadPose { position: DVec3::NAN, ..head },
            HeadPose { position: DVec3::Y * 1e7, ..head },
            HeadPose { eye_separation_m: 1e9, ..head },
            HeadPose { rotation: DQuat::from_xyzw(0.0, 0.0, 0.0, 0.5), ..head },
            HeadPose { eye_separation_m: -0.06, ..head },
            HeadPose { eye_separation_m: f64::NAN, ..head },
        ] {
            assert!(bad.fault().is_some(), "{bad:?}");
        }
    }
}
