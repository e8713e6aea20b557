//! A client's wish for one frame.

use std::num::NonZeroU32;

use polyptych_protocol::output_mode::OutputMode;
use polyptych_protocol::pattern::TestPattern;
use polyptych_wall::camera::Camera;
use serde::{Deserialize, Serialize};

use super::ClientRequest;

/// A client's wish for one frame.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct FrameRequest {
    pub job: ClientRequest,
    pub camera: Option<Camera>,
    pub time_s: Option<f64>,
    /// The side of the squares of pixels that its pictures have the mean light of, if any are sent.
    pub capture: Option<NonZeroU32>,
    /// `true` for pictures that a person watches: others do not wait for them.
    pub is_preview: bool,
    /// A paused wall keeps the scene time of the frame before.
    pub keeps_time: bool,
    /// The output change that takes effect with this frame, if the request has one.
    pub wish: Option<OutputChange>,
}

/// A change of the output mode or test pattern that a client requests with a frame.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) enum OutputChange {
    Displays(OutputMode),
    Pattern(Option<TestPattern>),
}

impl FrameRequest {
    /// A frame of the wall as it stands.
    pub fn unchanged(job: ClientRequest) -> Self {
        Self {
            job,
            camera: None,
            time_s: None,
            capture: None,
            is_preview: false,
            keeps_time: false,
            wish: None,
        }
    }
}
