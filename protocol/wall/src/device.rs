//! Trackers, wands and pads of a wall: the sources of their readings, and the meaning of these in
//! display space.

use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};

/// A tracker, a wand or a pad.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Device {
    /// The name, unique in the wall.
    pub name: String,
    /// The origin of its readings.
    pub source: DeviceSource,
    /// The silence after which it is lost, in milliseconds.
    pub lost_ms: u32,
    /// The place of its own axes in display space.
    pub frame: TrackerFrame,
    /// The tracking of the viewer's head; at most one device of a wall has it.
    pub head: Option<HeadTracking>,
    /// The controls that fly the camera.
    pub fly: Option<FlyControls>,
}

/// The origin of a device's readings.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum DeviceSource {
    /// OSC 1.0 messages in UDP packets.
    Osc {
        /// The local address and port that packets are sent to.
        listen: String,
    },
    /// A VRPN server.
    Vrpn {
        /// The server's host and TCP port, separated by a colon.
        server: String,
    },
    /// A game pad or a joystick of Linux.
    Joystick {
        /// The path of its device file, such as `/dev/input/js0`.
        path: String,
    },
    /// A 3D mouse, by spacenavd.
    Spacenav {
        /// The path of spacenavd's socket, such as `/var/run/spnav.sock`.
        path: String,
    },
}

impl DeviceSource {
    /// Returns the word that the wall file has for the kind of source.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Osc { .. } => "osc",
            Self::Vrpn { .. } => "vrpn",
            Self::Joystick { .. } => "joystick",
            Self::Spacenav { .. } => "spacenav",
        }
    }

    /// Returns the address or the path of the source.
    pub fn place(&self) -> &str {
        match self {
            Self::Osc { listen: place }
            | Self::Vrpn { server: place }
            | Self::Joystick { path: place }
            | Self::Spacenav { path: place } => place,
        }
    }

    /// Returns whether readings come only when a value changes, so that silence is no loss.
    pub fn is_read_by_change(&self) -> bool {
        matches!(self, Self::Joystick { .. } | Self::Spacenav { .. })
    }
}

/// An axis of a tracker with its direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SignedAxis {
    /// 0 to 2: x, y or z.
    pub index: u8,
    /// `true` for the opposite direction.
    pub is_negative: bool,
}

impl SignedAxis {
    /// The tracker's x.
    pub const X: Self = Self { index: 0, is_negative: false };
    /// The tracker's y.
    pub const Y: Self = Self { index: 1, is_negative: false };
    /// The tracker's z.
    pub const Z: Self = Self { index: 2, is_negative: false };
}

/// The place of a tracker's own axes in display space: a point p of the tracker is at
/// origin + rotation · (unit · axes · p).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrackerFrame {
    /// The tracker's axes that point to +X (right), +Y (up) and +Z (backwards). Each of x, y and z
    /// is one of them; they may be left-handed.
    pub axes: [SignedAxis; 3],
    /// Metres in a unit of the tracker; above 0.
    pub unit_m: f64,
    /// The tracker's origin, in metres of display space.
    pub origin: DVec3,
    /// A unit quaternion.
    pub rotation: DQuat,
}

impl TrackerFrame {
    /// Axes, unit and origin as those of display space.
    pub const IDENTITY: Self = Self {
        axes: [SignedAxis::X, SignedAxis::Y, SignedAxis::Z],
        unit_m: 1.0,
        origin: DVec3::ZERO,
        rotation: DQuat::IDENTITY,
    };

    /// Returns the matrix that gives components along X, Y and Z from those along the tracker's
    /// x, y and z; its determinant is -1 if the tracker's axes are left-handed.
    pub fn axes_matrix(&self) -> DMat3 {
        let row = |axis: SignedAxis| {
            let mut row = [0.0; 3];
            row[usize::from(axis.index.min(2))] = if axis.is_negative { -1.0 } else { 1.0 };
            DVec3::from_array(row)
        };
        let [right, up, back] = self.axes.map(row);
        DMat3::from_cols(right, up, back).transpose()
    }

    /// Returns the point of display space, in metres, at a position in the tracker's units.
    pub fn position(&self, of_tracker: DVec3) -> DVec3 {
        self.origin + self.rotation * (self.axes_matrix() * of_tracker * self.unit_m)
    }

    /// Returns the rotation of a sensor in display space. `of_tracker` turns the sensor's own axes,
    /// named as the tracker's, into the tracker's; both are unit quaternions.
    pub fn rotation(&self, of_tracker: DQuat) -> DQuat {
        let axes = self.axes_matrix();
        // A M A⁻¹ with A orthogonal: the axis turns with A, and a mirror reverses the angle.
        let vector = axes * of_tracker.xyz() * axes.determinant();
        self.rotation * DQuat::from_xyzw(vector.x, vector.y, vector.z, of_tracker.w)
    }
}

/// The way in which a tracker writes a rotation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum RotationForm {
    /// Four numbers x, y, z, w.
    Quaternion,
    /// Four numbers w, x, y, z.
    QuaternionWxyz,
    /// Nine numbers, row after row; with a position, sixteen of a 4 × 4 matrix, row after row.
    Matrix,
    /// Three angles about the axes of [`EulerOrder`].
    Euler {
        /// The axes that are turned about.
        order: EulerOrder,
        /// `true` if angles are in degrees, `false` if in radians.
        is_degrees: bool,
    },
}

/// Axes that three angles turn about, each 0 to 2 for x, y and z: the first about the tracker's
/// axis, the others about axes that turned with the ones before (intrinsic).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct EulerOrder(pub [u8; 3]);

/// The readings that the viewer's head is tracked by.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum HeadInput {
    /// OSC messages.
    Osc {
        /// The address of messages with the position, and with the rotation behind it if `form` is
        /// given.
        position: String,
        /// The address of messages with the rotation alone, if that comes in messages of its own.
        rotation: Option<String>,
        /// The form of the rotation; `None` if no rotation is tracked.
        form: Option<RotationForm>,
    },
    /// A tracker of a VRPN server.
    Vrpn {
        /// Its name at the server.
        tracker: String,
        /// The number of the sensor.
        sensor: i32,
    },
}

/// The tracking of the viewer's head.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeadTracking {
    /// The readings.
    pub input: HeadInput,
    /// The rotation of the head in the axes of its sensor; a unit quaternion.
    pub mount: DQuat,
    /// The point between the eyes from the sensor, in metres along the head's own axes: +X right,
    /// +Y up, the head looks along −Z.
    pub eyes: DVec3,
    /// The time that poses are predicted ahead, in milliseconds.
    pub prediction_ms: u32,
    /// Maximum speed of a head, in metres per second; faster readings are refused as jumps.
    pub speed_max: f64,
    /// Maximum distance between two readings beyond what `speed_max` explains, in metres.
    pub jump_m: f64,
    /// Time for which the last pose of a lost device is held, in milliseconds.
    pub hold_ms: u32,
    /// Minimum time in which the head moves back to its place in the wall file, or from there to a
    /// device that is tracked again, in milliseconds.
    pub ease_ms: u32,
    /// Two corners, the lower coordinates first, of the box that the point between the eyes is kept
    /// in, in metres of display space.
    pub bounds: Option<[DVec3; 2]>,
}

/// One value of a device that a control reads.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Control {
    /// The value.
    pub input: ControlInput,
    /// `true` if the sign of the value is reversed.
    pub is_negative: bool,
}

/// The value that a control reads: −1 to 1 of an axis, 0 or 1 of a button.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ControlInput {
    /// An argument of an OSC message.
    Osc {
        /// The message's address.
        address: String,
        /// The number of the argument, from 0 on.
        argument: u16,
    },
    /// An axis of a pad, from 0 on.
    Axis(u8),
    /// A button of a pad, from 0 on.
    Button(u8),
}

/// The controls that fly the camera through the scene, and their speeds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FlyControls {
    /// Moves to the right.
    pub right: Option<Control>,
    /// Moves up.
    pub up: Option<Control>,
    /// Moves forwards.
    pub forward: Option<Control>,
    /// Turns to the right.
    pub turn: Option<Control>,
    /// Looks up.
    pub pitch: Option<Control>,
    /// Speed at a full move, in metres of display space per second.
    pub speed: f64,
    /// Speed of a full turn, in radians per second.
    pub turn_speed: f64,
    /// Values nearer to 0 than this count as 0; 0 to below 1.
    pub dead_zone: f64,
}

impl FlyControls {
    /// Returns the controls in the order right, up, forward, turn, pitch.
    pub fn controls(&self) -> [Option<&Control>; 5] {
        let all = [&self.right, &self.up, &self.forward, &self.turn, &self.pitch];
        all.map(Option::as_ref)
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;

    fn axis(index: u8, is_negative: bool) -> SignedAxis {
        SignedAxis { index, is_negative }
    }

    /// A turn and a place survive the change of axes as matrices say.
    #[test]
    fn poses_change_axes_as_matrices_do_for_both_hands() {
        let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -0.7, 1.1);
        let z_up = [axis(0, false), axis(2, false), axis(1, true)];
        let left_handed = [axis(0, false), axis(1, false), axis(2, true)];
        for axes in [TrackerFrame::IDENTITY.axes, z_up, left_handed] {
            let rotation = DQuat::from_rotation_y(0.4);
            let frame = TrackerFrame { axes, rotation, ..TrackerFrame::IDENTITY };
            let matrix = frame.axes_matrix();
            let expected =
                DMat3::from_quat(rotation) * (matrix * DMat3::from_quat(turn) * matrix.transpose());
            let found = DMat3::from_quat(frame.rotation(turn));
            assert!(found.abs_diff_eq(expected, 1e-12), "{axes:?}");
        }
    }

    #[test]
    fn a_tracker_in_millimetres_with_z_up_stands_where_its_origin_is() {
        let frame = TrackerFrame {
            // Its y points away from the viewer.
            axes: [axis(0, false), axis(2, false), axis(1, true)],
            unit_m: 0.001,
            origin: DVec3::new(0.0, 0.0, -2.0),
            rotation: DQuat::IDENTITY,
        };
        let at = frame.position(DVec3::new(100.0, 500.0, 1700.0));
        assert!(at.abs_diff_eq(DVec3::new(0.1, 1.7, -2.5), 1e-12), "{at}");
        // Turned left about its own vertical, the head looks to the left of the wall.
        let turned = frame.rotation(DQuat::from_rotation_z(FRAC_PI_2)) * DVec3::NEG_Z;
        assert!(turned.abs_diff_eq(DVec3::NEG_X, 1e-12), "{turned}");
    }
}
