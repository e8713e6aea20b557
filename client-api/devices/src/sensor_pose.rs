//! Readings of a sensor, and the poses of the viewer's head that follow from them.

use glam::{DQuat, DVec3};
use polyptych_wall::device::{HeadTracking, TrackerFrame};

/// A reading of a sensor, in the tracker's own axes and units; finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorPose {
    /// The position, in units of the tracker.
    pub position: DVec3,
    /// A unit quaternion that turns the sensor's axes into the tracker's; `None` if it is unknown.
    pub rotation: Option<DQuat>,
}

/// A pose of the head in display space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadSample {
    /// The point between the eyes, in metres.
    pub position: DVec3,
    /// A unit quaternion; the identity if the tracker does not know it.
    pub rotation: DQuat,
}

impl HeadSample {
    /// Returns the pose of the head whose sensor is there.
    pub fn from_sensor(frame: &TrackerFrame, head: &HeadTracking, sensor: &SensorPose) -> Self {
        let turned = sensor.rotation.map(|rotation| frame.rotation(rotation) * head.mount);
        let rotation = turned.unwrap_or(DQuat::IDENTITY);
        Self { position: frame.position(sensor.position) + rotation * head.eyes, rotation }
    }

    /// Returns the pose between this one (0) and another (1).
    pub fn mix(&self, to: &Self, fraction: f64) -> Self {
        Self {
            position: self.position.lerp(to.position, fraction),
            rotation: self.rotation.slerp(to.rotation, fraction).normalize(),
        }
    }

    /// Returns whether all numbers are finite.
    pub fn is_finite(&self) -> bool {
        self.position.is_finite() && self.rotation.is_finite()
    }
}
