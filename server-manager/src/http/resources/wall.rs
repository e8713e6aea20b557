//! The wall itself: status, description, statistics, frames, calibration.

use glam::DVec3;
use polyptych_protocol::request::{Pacing, Request};
use polyptych_wall::calibration_change::CalibrationChange;
use polyptych_wall::camera::Camera;
use serde::Deserialize;
use serde_json::json;

use crate::http::answer::Refusal;
use crate::http::route::{Action, Call, Route};

/// The routes of this resource.
pub(in crate::http) const ROUTES: &[Route] = &[
    Route {
        method: "GET",
        path: "/status",
        summary: "The wall as it stands, as `polyptych status --json` prints it.",
        query: &[],
        body: None,
        action: Action::Ask(|_| Ok(Request::Status)),
    },
    Route {
        method: "GET",
        path: "/wall",
        summary: "The wall's description: screens, channels, eye.",
        query: &[],
        body: None,
        action: Action::Ask(|_| Ok(Request::DescribeWall)),
    },
    Route {
        method: "GET",
        path: "/devices",
        summary: "The trackers, wands and pads of the wall file, as they stand.",
        query: &[],
        body: None,
        action: Action::Read(|status| json!(status.devices)),
    },
    Route {
        method: "GET",
        path: "/statistics",
        summary: "The times of frames since statistics were last reset.",
        query: &[],
        body: None,
        action: Action::Ask(|_| Ok(Request::Statistics { reset: false })),
    },
    Route {
        method: "POST",
        path: "/statistics/reset",
        summary: "Returns the statistics, and begins them anew.",
        query: &[],
        body: None,
        action: Action::Ask(|_| Ok(Request::Statistics { reset: true })),
    },
    Route {
        method: "POST",
        path: "/frame",
        summary: "Draws and shows one frame, and returns its feedback. Camera and scene time are \
                  set first where they are given; with `keeps_time` a paused wall stays at the \
                  time of the frame before.",
        query: &[],
        body: Some(|| json!({ "camera": Camera::IDENTITY, "time_s": 1.5, "keeps_time": false })),
        action: Action::Ask(|call| {
            let FrameBody { camera, time_s, keeps_time } = call.parse()?;
            if keeps_time && time_s.is_some() {
                return Err(Refusal::malformed("give time_s or keeps_time, not both"));
            }
            Ok(if keeps_time {
                Request::Redraw(camera)
            } else {
                Request::RenderFrame { camera, time_s }
            })
        }),
    },
    Route {
        method: "PUT",
        path: "/pace",
        summary: "Lets the wall draw by itself: at `rate` frames a second, as fast as it can with \
                  `is_free`, or not any more without either.",
        query: &[],
        body: Some(|| json!({ "rate": 30.0 })),
        action: Action::Ask(pace),
    },
    Route {
        method: "POST",
        path: "/channels/{name}/calibration",
        summary: "Changes a channel's adjustment: all of `changes`, or nothing.",
        query: &[],
        body: Some(|| json!({ "changes": [CalibrationChange::Gain(DVec3::new(1.0, 0.9, 1.0))] })),
        action: Action::Ask(|call| {
            let CalibrationBody { changes } = call.parse()?;
            Ok(Request::Tune { channel: call.name(), changes })
        }),
    },
];

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FrameBody {
    camera: Option<Camera>,
    time_s: Option<f64>,
    /// A paused wall stays at the scene time of the frame before.
    #[serde(default)]
    keeps_time: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PaceBody {
    rate: Option<f64>,
    #[serde(default)]
    is_free: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CalibrationBody {
    changes: Vec<CalibrationChange>,
}

fn pace(call: &Call) -> Result<Request, Refusal> {
    match call.parse()? {
        PaceBody { rate: Some(_), is_free: true } => {
            Err(Refusal::malformed("say either rate or is_free, not both"))
        }
        PaceBody { rate: Some(rate), .. } => Ok(Request::Run(Pacing::Rate(rate))),
        PaceBody { is_free: true, .. } => Ok(Request::Run(Pacing::Free)),
        PaceBody { .. } => Ok(Request::Pause),
    }
}
