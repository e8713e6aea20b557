//! The point of a channel that is being moved while the wall is aligned: its display lights it.

use polyptych_text::text_of_peer;
use polyptych_wall::calibration_change::{Corner, Edge};
use serde::{Deserialize, Serialize};

/// A point that a channel lights over its test pattern, where its calibration has it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CalibrationMarker {
    /// The channel's name.
    #[serde(deserialize_with = "text_of_peer")]
    pub channel: String,
    /// The point.
    pub point: MarkedPoint,
}

/// A point that calibration moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum MarkedPoint {
    /// A corner of the picture.
    Corner(Corner),
    /// A point of the bend.
    Bend {
        /// From 0 at the left.
        column: u32,
        /// From 0 at the top.
        row: u32,
    },
    /// The middle of an edge, where a blend begins.
    Edge(Edge),
}
