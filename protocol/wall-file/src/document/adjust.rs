//! What a wall file says of a channel however it was made: `[channel.NAME]`.

use polyptych_wall::{Eye, Orientation, Ramps, StereoPacking};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::lists::{Pair, Row, ScalarOrRgb, exact, some_points, some_rows};

/// What makes a channel's picture right on the display that it has.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct AdjustSection {
    /// The monitor that the channel fills in full screen, as `polyptych server --list-monitors`
    /// names it on the server's machine. Default: the next one that no other channel of the
    /// server takes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub monitor: Option<String>,
    /// How the display hangs: to which side of the viewer its upper side went, or half a turn.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub turn: Option<Orientation>,
    /// Left and right are exchanged, as for projection from behind.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mirror: Option<bool>,
    /// For whose eye it is: one of two groups of channels for passive stereo.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub eye: Option<Eye>,
    /// How the pictures of both eyes share this one display: its own pixels, however it is turned.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stereo: Option<StereoPacking>,
    /// By how many pixels, [x right, y down], the corners are moved: upper left, upper right,
    /// lower left, lower right.
    #[serde(deserialize_with = "some_points", skip_serializing_if = "Option::is_none")]
    pub pin: Option<[Pair; 4]>,
    /// A grid of points that are moved, after the pins.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bend: Option<BendSection>,
    /// How wide the ramps of its blends are. Default: as wide as the overlap.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub edges: Option<EdgesSection>,
    /// Linear light is multiplied by this after the matrix: a number, or [red, green, blue].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gain: Option<ScalarOrRgb>,
    /// Linear light [red, green, blue] is multiplied by these three rows.
    #[serde(deserialize_with = "some_rows", skip_serializing_if = "Option::is_none")]
    pub matrix: Option<[Row; 3]>,
    /// How codes become light: code^gamma, a number or [red, green, blue]. Default: sRGB.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gamma: Option<ScalarOrRgb>,
    /// Instead of gamma: measured light of equally spaced codes, rising from 0 to 1; each a number
    /// or [red, green, blue].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub curve: Option<Vec<ScalarOrRgb>>,
    /// What it shows of black, as a share of its white: a number, or [red, green, blue]. Default:
    /// leak of [blend].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub leak: Option<ScalarOrRgb>,
    /// A file that says where each of the channel's pixels lies. Files stand in the wall file's
    /// folder.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub warp: Option<String>,
    /// What pixels of a PFM of points are that lie at (0, 0, 0): "point", a place like others, or
    /// "dark", unlit. Default: "point".
    #[serde(skip_serializing_if = "Option::is_none")]
    pub warp_zero: Option<WarpZero>,
    /// What an OBJ holds: "room", points in metres for places of the channel's picture, which are
    /// its UV; or "sgct", places from -1 to 1 on the channel's picture, whose UV are on the
    /// screen's canvas. Default: "room".
    #[serde(skip_serializing_if = "Option::is_none")]
    pub warp_obj: Option<WarpObj>,
    /// A picture that multiplies the channel's light.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub alpha: Option<String>,
    /// What says how its light fades where others light the same places: their geometry, or its
    /// alpha alone, instead of what would be computed. Default: computed; for a channel that a
    /// warp file places, its alpha, unless edges say how wide ramps are.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ramps: Option<Ramps>,
    /// A picture of the least light of each pixel: light becomes light × (1 − beta) + beta.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub beta: Option<String>,
    /// Bits of the display's red, green and blue, 8 or 10. A display that takes no 10 is given 8,
    /// which its server says. Default: 8.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bits: Option<u32>,
}

/// What a point at the origin is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum WarpZero {
    /// A place like others.
    Point,
    /// Unlit.
    Dark,
}

/// What positions and UV of an OBJ are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum WarpObj {
    /// Points in metres, and places of the channel's picture.
    Room,
    /// Places of the channel's picture from -1 to 1, and places of the canvas.
    Sgct,
}

/// A grid of control points over the channel's picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BendSection {
    /// Points [across, down], from edge to edge; 2 or more each.
    #[serde(deserialize_with = "exact")]
    pub points: [u32; 2],
    /// By how many pixels, [x right, y down], each is moved, row by row from the upper left.
    pub moves: Vec<Pair>,
}

/// Widths of the ramps at a channel's edges, in its pixels. Default: as wide as the overlap.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct EdgesSection {
    /// At the left edge.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub left: Option<f64>,
    /// At the right edge.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub right: Option<f64>,
    /// At the upper edge.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub top: Option<f64>,
    /// At the lower edge.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bottom: Option<f64>,
}
