//! A pose of the viewer's head as trackers tell it.

use glam::{DQuat, DVec3};
use polyptych_wall::head::HeadPose;
use serde::{Deserialize, Serialize};

/// A pose of the viewer's head; what is not given stays as it is. A tracker of one marker knows
/// the position only.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeadUpdate {
    /// The middle between the eyes, in metres of display space.
    pub position: DVec3,
    /// A unit quaternion, as [`HeadPose::rotation`].
    pub rotation: Option<DQuat>,
    /// From the left eye to the right one, in metres.
    pub eye_separation_m: Option<f64>,
}

impl HeadUpdate {
    /// This update behind an older one that was not applied: one that does what both do.
    pub fn after(self, older: &Self) -> Self {
        Self {
            rotation: self.rotation.or(older.rotation),
            eye_separation_m: self.eye_separation_m.or(older.eye_separation_m),
            ..self
        }
    }

    /// The pose that this makes of another.
    pub fn apply(&self, to: &HeadPose) -> HeadPose {
        HeadPose {
            position: self.position,
            rotation: self.rotation.unwrap_or(to.rotation),
            eye_separation_m: self.eye_separation_m.unwrap_or(to.eye_separation_m),
        }
    }
}

impl From<HeadPose> for HeadUpdate {
    fn from(HeadPose { position, rotation, eye_separation_m }: HeadPose) -> Self {
        Self { position, rotation: Some(rotation), eye_separation_m: Some(eye_separation_m) }
    }
}

impl From<DVec3> for HeadUpdate {
    fn from(position: DVec3) -> Self {
        Self { position, rotation: None, eye_separation_m: None }
    }
}
