//! Screens that are no rectangle, as the wall file says them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::lists::{Rotation, exact};

/// A patch of a cylinder, instead of corners or size. Its axis stands upright unless it is turned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CylinderSection {
    /// A point of its axis, [x, y, z] in metres; heights count from here. Default: the origin.
    #[serde(default, deserialize_with = "exact")]
    pub center: [f64; 3],
    /// In metres.
    pub radius: f64,
    /// [left, right] edge as the viewer sees them, in degrees from −Z, growing to +X. Rising: seen
    /// from within; falling: from outside. No more than 360 apart.
    #[serde(deserialize_with = "exact")]
    pub degrees: [f64; 2],
    /// [bottom, top] edge in metres above the center.
    #[serde(deserialize_with = "exact")]
    pub height: [f64; 2],
    /// [yaw, pitch, roll] in degrees, as of a planar screen, or a quaternion [x, y, z, w].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotation: Option<Rotation>,
}

/// A patch of a sphere, instead of corners or size: a dome.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SphereSection {
    /// [x, y, z] in metres. Default: the origin.
    #[serde(default, deserialize_with = "exact")]
    pub center: [f64; 3],
    /// In metres.
    pub radius: f64,
    /// [left, right] edge as the viewer sees them, in degrees from −Z, growing to +X. Rising: seen
    /// from within; falling: from outside. No more than 360 apart.
    #[serde(deserialize_with = "exact")]
    pub azimuth: [f64; 2],
    /// [bottom, top] edge in degrees above the equator, from −90 to 90.
    #[serde(deserialize_with = "exact")]
    pub elevation: [f64; 2],
    /// [yaw, pitch, roll] in degrees, as of a planar screen, or a quaternion [x, y, z, w].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotation: Option<Rotation>,
}

/// A projector without distortion, instead of an origin: what it lights is what the channel shows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ProjectorSection {
    /// Where its light comes from, [x, y, z] in metres.
    #[serde(deserialize_with = "exact")]
    pub position: [f64; 3],
    /// The point in the middle of its picture without shift, [x, y, z] in metres; its picture is
    /// upright.
    #[serde(
        default,
        deserialize_with = "super::lists::some_exact",
        skip_serializing_if = "Option::is_none"
    )]
    pub look_at: Option<[f64; 3]>,
    /// Instead of `look_at`: [yaw, pitch, roll] in degrees, or a quaternion [x, y, z, w]. At
    /// [0, 0, 0] light goes along −Z; yaw 90 turns it to −X, pitch 90 up.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rotation: Option<Rotation>,
    /// [across, down] of its picture in degrees, without shift.
    #[serde(
        default,
        deserialize_with = "super::lists::some_exact",
        skip_serializing_if = "Option::is_none"
    )]
    pub degrees: Option<[f64; 2]>,
    /// Instead of `degrees`: tangents of the angles from its axis to the picture's edges,
    /// [left, right, bottom, top].
    #[serde(
        default,
        deserialize_with = "super::lists::some_exact",
        skip_serializing_if = "Option::is_none"
    )]
    pub tangents: Option<[f64; 4]>,
    /// With `degrees`: by what share of its width and height lens shift moves the picture, right
    /// and up. Default: [0, 0].
    #[serde(
        default,
        deserialize_with = "super::lists::some_exact",
        skip_serializing_if = "Option::is_none"
    )]
    pub shift: Option<[f64; 2]>,
}
