//! The presentation of the scene: modes, patterns, light, fog, glow, ambient
//! occlusion and bounds.

use polyptych_protocol::calibration_marker::{CalibrationMarker, MarkedPoint};
use polyptych_protocol::output_mode::OutputMode;
use polyptych_protocol::pattern::TestPattern;
use polyptych_protocol::quality_bounds::QualityBounds;
use polyptych_protocol::request::Request;
use polyptych_protocol::screen_rest::{LitHours, RestRules};
use polyptych_scene::{AmbientOcclusion, DepthOfField, Fog, Glow, ToneMapper};
use polyptych_wall::calibration_change::Corner;
use serde::Deserialize;
use serde_json::json;

use crate::http::answer::Refusal;
use crate::http::route::{Action, Call, Route};

/// Stops beyond which an exposure is 0 or infinite in f32.
const STOPS_MAX: f64 = 126.0;

/// The routes of this resource.
pub(in crate::http) const ROUTES: &[Route] = &[
    Route {
        method: "GET",
        path: "/presentation",
        summary: "All that the wall presents: camera, head, overlays, light, modes and bounds.",
        query: &[],
        body: None,
        action: Action::Read(|status| json!(status.presentation)),
    },
    Route {
        method: "PUT",
        path: "/displays",
        summary: "Sets the mode of all displays: normal, identify, blank or freeze.",
        query: &[],
        body: Some(|| json!({ "mode": OutputMode::Identify })),
        action: Action::Ask(|call| {
            let DisplaysBody { mode } = call.parse()?;
            Ok(Request::SetDisplays(mode))
        }),
    },
    Route {
        method: "PUT",
        path: "/pattern",
        summary: "Lets channels draw a test pattern, or the scene again without one.",
        query: &[],
        body: Some(|| json!({ "pattern": TestPattern::Grid })),
        action: Action::Ask(|call| {
            let PatternBody { pattern } = call.parse()?;
            Ok(Request::SetPattern(pattern))
        }),
    },
    Route {
        method: "PUT",
        path: "/marker",
        summary: "Lights a point of a channel over its test pattern: a `Corner`, an `Edge` or a \
                  point of its `Bend`; or none without a `marker`.",
        query: &[],
        body: Some(|| {
            let point = MarkedPoint::Corner(Corner::UpperLeft);
            json!({ "marker": CalibrationMarker { channel: "front-1-1".into(), point } })
        }),
        action: Action::Ask(|call| {
            let MarkerBody { marker } = call.parse()?;
            Ok(Request::MarkPoint(marker))
        }),
    },
    Route {
        method: "GET",
        path: "/rest",
        summary: "The rules by which displays go dark by themselves, and whether they are dark.",
        query: &[],
        body: None,
        action: Action::Read(|status| json!(status.rest)),
    },
    Route {
        method: "PUT",
        path: "/rest",
        summary: "Lets displays go dark after `idle_s` seconds without use, and outside `hours`: \
                  from `from_min` until `until_min`, in minutes since midnight by the manager's \
                  clock. What is not given does not darken them.",
        query: &[],
        body: Some(|| {
            let hours = Some(LitHours { from_min: 540, until_min: 1080 });
            json!(RestRules { idle_s: Some(1800.0), hours })
        }),
        action: Action::Ask(|call| Ok(Request::SetRest(call.parse()?))),
    },
    Route {
        method: "PUT",
        path: "/exposure",
        summary: "Sets the exposure in `stops` or as a `factor`, or lets the wall set it \
                  (`is_automatic`).",
        query: &[],
        body: Some(|| json!({ "stops": -1.5 })),
        action: Action::Ask(exposure),
    },
    Route {
        method: "PUT",
        path: "/tone",
        summary: "Sets the tone mapper: Neutral, Aces or None.",
        query: &[],
        body: Some(|| json!({ "tone": ToneMapper::Aces })),
        action: Action::Ask(|call| {
            let ToneBody { tone } = call.parse()?;
            Ok(Request::SetTone(tone))
        }),
    },
    Route {
        method: "PUT",
        path: "/fog",
        summary: "Lays fog over what cameras see, or takes it away without one.",
        query: &[],
        body: Some(|| json!({ "fog": Fog::even(800.0) })),
        action: Action::Ask(|call| {
            let FogBody { fog } = call.parse()?;
            Ok(Request::SetFog(fog))
        }),
    },
    Route {
        method: "PUT",
        path: "/glow",
        summary: "Spreads light around what is bright, or ends it without one.",
        query: &[],
        body: Some(|| json!({ "glow": Glow::new(0.25) })),
        action: Action::Ask(|call| {
            let GlowBody { glow } = call.parse()?;
            Ok(Request::SetGlow(glow))
        }),
    },
    Route {
        method: "PUT",
        path: "/ambient_occlusion",
        summary: "Darkens corners and gaps within a radius, or ends it without one.",
        query: &[],
        body: Some(|| json!({ "ambient_occlusion": AmbientOcclusion { radius: 0.5 } })),
        action: Action::Ask(|call| {
            let OcclusionBody { ambient_occlusion } = call.parse()?;
            Ok(Request::SetAmbientOcclusion(ambient_occlusion))
        }),
    },
    Route {
        method: "PUT",
        path: "/depth_of_field",
        summary: "Blurs what is nearer or farther than a distance, or ends it without one.",
        query: &[],
        body: Some(|| json!({ "depth_of_field": DepthOfField { focus: 12.0, aperture: 0.25 } })),
        action: Action::Ask(|call| {
            let FocusBody { depth_of_field } = call.parse()?;
            Ok(Request::SetDepthOfField(depth_of_field))
        }),
    },
    Route {
        method: "PUT",
        path: "/bounds",
        summary: "Bounds the error of pictures in pixels and their rate in frames per second.",
        query: &[],
        body: Some(|| json!(QualityBounds { error_px: 0.5, rate_fps: Some(30.0) })),
        action: Action::Ask(|call| Ok(Request::SetBounds(call.parse()?))),
    },
];

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DisplaysBody {
    mode: OutputMode,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PatternBody {
    pattern: Option<TestPattern>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MarkerBody {
    marker: Option<CalibrationMarker>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ExposureBody {
    stops: Option<f64>,
    factor: Option<f32>,
    #[serde(default)]
    is_automatic: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ToneBody {
    tone: ToneMapper,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FogBody {
    fog: Option<Fog>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct GlowBody {
    glow: Option<Glow>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct OcclusionBody {
    ambient_occlusion: Option<AmbientOcclusion>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FocusBody {
    depth_of_field: Option<DepthOfField>,
}

fn exposure(call: &Call) -> Result<Request, Refusal> {
    match call.parse()? {
        ExposureBody { stops: Some(stops), factor: None, is_automatic: false } => {
            if !(-STOPS_MAX..=STOPS_MAX).contains(&stops) {
                let reason = format!("stops are -{STOPS_MAX} to {STOPS_MAX}, not {stops}");
                return Err(Refusal::malformed(reason));
            }
            Ok(Request::SetExposure(stops.exp2() as f32))
        }
        ExposureBody { stops: None, factor: Some(factor), is_automatic: false } => {
            Ok(Request::SetExposure(factor))
        }
        ExposureBody { stops: None, factor: None, is_automatic: true } => {
            Ok(Request::SetAutomaticExposure)
        }
        _ => Err(Refusal::malformed("say one of stops, factor and is_automatic")),
    }
}
