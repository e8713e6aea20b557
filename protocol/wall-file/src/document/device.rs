//! Trackers, wands and pads, as the wall file says them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::lists::{Rotation, Row, exact, some_corners};

/// Milliseconds without a reading after which a device is lost, by default: sixty readings of a
/// tracker at 120 Hz.
pub const LOST_MS_DEFAULT: u32 = 500;

/// Maximum speed of a head in metres per second by default: a runner's.
pub const SPEED_MAX_DEFAULT: f64 = 5.0;

/// Maximum jump between two readings in metres by default: reflections of a tracker are farther
/// off.
pub const JUMP_DEFAULT: f64 = 0.3;

/// Milliseconds for which the last pose is held by default: as long as a viewer turns away.
pub const HOLD_MS_DEFAULT: u32 = 2000;

/// Milliseconds in which a head is eased by default.
pub const EASE_MS_DEFAULT: u32 = 1000;

/// Degrees per second of a full turn by default.
pub const TURN_SPEED_DEFAULT: f64 = 60.0;

/// Share of an axis that counts as its middle, by default: sticks do not come back exactly.
pub const DEAD_ZONE_DEFAULT: f64 = 0.1;

/// A tracker, a wand or a pad, which `polyptych devices` reads.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DeviceSection {
    /// Unique in the wall. Letters a–z, digits, "-", "_", ".", 64 at most.
    pub name: String,
    /// The protocol: "osc", OSC 1.0 messages in UDP packets; "vrpn", a VRPN server; "joystick", a
    /// game pad or joystick of Linux; "spacenav", a 3D mouse by spacenavd.
    pub kind: DeviceKind,
    /// With kind = "osc": the local ADDRESS:PORT that packets are sent to.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub listen: Option<String>,
    /// With kind = "vrpn": the server, HOST:PORT; VRPN's own port is 3883.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub server: Option<String>,
    /// With kind = "joystick": the device file, such as "/dev/input/js0". With "spacenav": the
    /// socket of spacenavd, "/var/run/spnav.sock".
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub path: Option<String>,
    /// Milliseconds without a reading after which the device is lost, 20 to 60000. Default: 500.
    #[serde(default = "lost_ms_default")]
    pub lost_ms: u32,
    /// The tracker's own axes, unit and origin in display space.
    #[serde(default, skip_serializing_if = "FrameSection::is_default")]
    pub frame: FrameSection,
    /// The tracking of the viewer's head; one device of the wall at most has it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub head: Option<HeadSection>,
    /// The controls that fly the camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fly: Option<FlySection>,
}

/// The protocol of a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum DeviceKind {
    /// OSC 1.0 messages in UDP packets.
    Osc,
    /// A VRPN server.
    Vrpn,
    /// A game pad or joystick of Linux.
    Joystick,
    /// A 3D mouse by spacenavd.
    Spacenav,
}

/// The tracker's own axes, unit and origin in display space.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FrameSection {
    /// The tracker's axes that point right, up and backwards (away from the screen), such as
    /// `["x", "z", "-y"]`; each of x, y and z once. They may be left-handed.
    pub axes: [String; 3],
    /// Metres in a unit of the tracker; 0.001 for millimetres.
    pub unit: f64,
    /// Place of the tracker's origin, [x, y, z] in metres of display space.
    #[serde(deserialize_with = "exact")]
    pub origin: [f64; 3],
    /// [yaw, pitch, roll] in degrees by which its axes are turned, or a quaternion [x, y, z, w].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rotation: Option<Rotation>,
}

impl Default for FrameSection {
    fn default() -> Self {
        let axes = ["x", "y", "z"].map(str::to_owned);
        Self { axes, unit: 1.0, origin: [0.0; 3], rotation: None }
    }
}

impl FrameSection {
    fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// The form in which a tracker writes rotations.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum FormChoice {
    /// x, y, z, w.
    Quaternion,
    /// w, x, y, z.
    QuaternionWxyz,
    /// Nine numbers, row after row; as a pose sixteen, of a 4 × 4 matrix.
    Matrix,
    /// Three angles in degrees.
    EulerDegrees,
    /// Three angles in radians.
    EulerRadians,
}

/// The tracking of the viewer's head.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HeadSection {
    /// With OSC: the address of messages with position and rotation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose: Option<String>,
    /// With OSC, instead of pose: the address of messages with the position.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub position: Option<String>,
    /// With OSC and position: the address of messages with the rotation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotation: Option<String>,
    /// With OSC: "quaternion" (x, y, z, w), "quaternion-wxyz", "matrix" (nine numbers, row after
    /// row; as a pose sixteen), "euler-degrees" or "euler-radians". Default: quaternion.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub form: Option<FormChoice>,
    /// With angles: the axes that they turn about, in their order, such as "yxz"; each axis turns
    /// with the angles before. Default: "yxz".
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub order: Option<String>,
    /// With VRPN: the tracker's name at the server, such as "Tracker0".
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tracker: Option<String>,
    /// With VRPN: the number of the sensor. Default: 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensor: Option<i32>,
    /// Rotation of the head in the axes of its sensor, [yaw, pitch, roll] in degrees or a
    /// quaternion [x, y, z, w]. Default: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mount: Option<Rotation>,
    /// The point between the eyes from the sensor, [x, y, z] in metres along the head's own axes:
    /// right, up, backwards.
    #[serde(default, deserialize_with = "exact", skip_serializing_if = "is_origin")]
    pub eyes: [f64; 3],
    /// Milliseconds by which poses are predicted, 0 to 100. Default: 0.
    #[serde(default)]
    pub prediction_ms: u32,
    /// Maximum speed of the head, in metres per second; faster readings are refused as jumps.
    /// Default: 5.
    #[serde(default = "speed_max_default")]
    pub speed_max: f64,
    /// Maximum jump between two readings, in metres. A place that jumps further counts once it is
    /// steady. Default: 0.3.
    #[serde(default = "jump_default")]
    pub jump: f64,
    /// Milliseconds for which the last pose of a lost device is held, 0 to 600000. Default: 2000.
    #[serde(default = "hold_ms_default")]
    pub hold_ms: u32,
    /// Milliseconds in which the head then moves to wall.eye, and from there to a device that is
    /// back; 10 to 60000. Default: 1000.
    #[serde(default = "ease_ms_default")]
    pub ease_ms: u32,
    /// The box that the point between the eyes is kept in, as two corners [x, y, z] in metres of
    /// display space.
    #[serde(default, deserialize_with = "some_corners", skip_serializing_if = "Option::is_none")]
    pub bounds: Option<[Row; 2]>,
}

/// The controls that fly the camera. Each names a value: of OSC the address of a message, with
/// "[1]" behind it for its second argument; of a joystick and a 3D mouse "axis0" or "button3".
/// "-" before it reverses its sign.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FlySection {
    /// Moves to the right.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub right: Option<String>,
    /// Moves up.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub up: Option<String>,
    /// Moves forwards.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub forward: Option<String>,
    /// Turns to the right.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub turn: Option<String>,
    /// Looks up.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pitch: Option<String>,
    /// Metres of display space per second at 1. Default: 1.
    #[serde(default = "speed_default")]
    pub speed: f64,
    /// Degrees per second at 1. Default: 60.
    #[serde(default = "turn_speed_default")]
    pub turn_speed: f64,
    /// Values nearer to 0 count as 0; 0 to 0.9. Default: 0.1.
    #[serde(default = "dead_zone_default")]
    pub dead_zone: f64,
}

fn lost_ms_default() -> u32 {
    LOST_MS_DEFAULT
}

fn speed_max_default() -> f64 {
    SPEED_MAX_DEFAULT
}

fn jump_default() -> f64 {
    JUMP_DEFAULT
}

fn hold_ms_default() -> u32 {
    HOLD_MS_DEFAULT
}

fn ease_ms_default() -> u32 {
    EASE_MS_DEFAULT
}

fn speed_default() -> f64 {
    1.0
}

fn turn_speed_default() -> f64 {
    TURN_SPEED_DEFAULT
}

fn dead_zone_default() -> f64 {
    DEAD_ZONE_DEFAULT
}

fn is_origin(point: &[f64; 3]) -> bool {
    *point == [0.0; 3]
}
