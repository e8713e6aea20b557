//! The state of a tour of the camera.

use polyptych_scene::NodeId;
use polyptych_wall::tour::Tour;
use serde::{Deserialize, Serialize};

use crate::request::Pacing;

/// The tour that is played, and the clock that it follows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TourStatus {
    /// The tour; `None` where none is played.
    pub tour: Option<Tour>,
    /// The node that the camera follows instead.
    pub following: Option<NodeId>,
    /// Scene time at which it began, in seconds; `None` until the first frame of it, with which it
    /// begins.
    pub began_s: Option<f64>,
    /// Scene time of the last frame, in seconds.
    pub time_s: f64,
    /// The wall's own pace; `None` for a wall that is paused, on which nothing
    /// moves until a frame is asked for.
    pub pace: Option<Pacing>,
}
