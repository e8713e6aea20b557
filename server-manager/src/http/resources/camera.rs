//! The camera, the head, stored views and tours.

use glam::{DQuat, DVec3};
use hyper::{Response, StatusCode};
use polyptych_protocol::head_update::HeadUpdate;
use polyptych_protocol::request::{Request, Response as WallResponse};
use polyptych_wall::camera::Camera;
use polyptych_wall::tour::{Tour, TourStop};
use polyptych_wall::view::View;
use serde::Deserialize;
use serde_json::json;

use crate::http::answer::{self, Body, Refusal};
use crate::http::connection::Connection;
use crate::http::request_examples;
use crate::http::route::{self, Action, Call, Route};

/// The routes of this resource.
pub(in crate::http) const ROUTES: &[Route] = &[
    Route {
        method: "GET",
        path: "/camera",
        summary: "The camera: position, rotation as a quaternion x, y, z, w, and scale.",
        query: &[],
        body: None,
        action: Action::Read(|status| json!(status.presentation.camera)),
    },
    Route {
        method: "PUT",
        path: "/camera",
        summary: "Moves the camera, from the next frame on: to a `position` with a `rotation`, or \
                  with a `target` and what is `up` (0, 1, 0 where it is not given). `scale` is in \
                  world units per metre of the wall's room; where it is not given, 1.",
        query: &[],
        body: Some(|| json!({ "position": [0.0, 2.0, 5.0], "target": [0.0, 1.0, 0.0] })),
        action: Action::Ask(set_camera),
    },
    Route {
        method: "POST",
        path: "/camera/fly",
        summary: "Moves the viewer through the scene: by `offset_m` along the axes of the wall's \
                  room, in its metres, and turned by `turn_rad` to the right and up.",
        query: &[],
        body: Some(|| json!(request_examples::flight())),
        action: Action::Ask(|call| Ok(Request::Fly(call.parse()?))),
    },
    Route {
        method: "GET",
        path: "/head",
        summary: "The pose of the viewer's head.",
        query: &[],
        body: None,
        action: Action::Read(|status| json!(status.presentation.head)),
    },
    Route {
        method: "PUT",
        path: "/head",
        summary: "Moves the viewer's head, from the next frame on. What is not given stays.",
        query: &[],
        body: Some(|| json!(HeadUpdate::from(DVec3::new(0.0, 1.7, 0.0)))),
        action: Action::Ask(|call| Ok(Request::SetHead(call.parse()?))),
    },
    Route {
        method: "PUT",
        path: "/overlays",
        summary: "Lays these views over the wall's own picture, from the next frame on.",
        query: &[],
        body: Some(|| json!({ "views": [View::of_wall(Camera::IDENTITY)] })),
        action: Action::Ask(|call| {
            let OverlaysBody { views } = call.parse()?;
            Ok(Request::SetViews(views))
        }),
    },
    Route {
        method: "GET",
        path: "/views",
        summary: "The stored views, by name.",
        query: &[],
        body: None,
        action: Action::Ask(|_| Ok(Request::ListStoredViews)),
    },
    Route {
        method: "PUT",
        path: "/views/{name}",
        summary: "Stores a view under a name: the camera as it is, or `camera`.",
        query: &[],
        body: Some(|| json!({ "camera": Camera::IDENTITY })),
        action: Action::Ask(|call| {
            let ViewBody { camera } = call.parse()?;
            Ok(Request::StoreView { name: call.name(), camera })
        }),
    },
    Route {
        method: "DELETE",
        path: "/views/{name}",
        summary: "Forgets a stored view.",
        query: &[],
        body: None,
        action: Action::Ask(|call| Ok(Request::RemoveView { name: call.name() })),
    },
    Route {
        method: "POST",
        path: "/views/{name}/show",
        summary: "Moves the camera to a stored view, and draws a frame.",
        query: &[],
        body: None,
        action: Action::ShowView,
    },
    Route {
        method: "GET",
        path: "/tour",
        summary: "The state of the tour.",
        query: &[],
        body: None,
        action: Action::Ask(|_| Ok(Request::DescribeTour)),
    },
    Route {
        method: "PUT",
        path: "/tour",
        summary: "Moves the camera through stops, as a function of scene time.",
        query: &[],
        body: Some(|| {
            let stops = vec![TourStop::new(Camera::IDENTITY, 4.0)];
            json!(Tour { stops, is_loop: true })
        }),
        action: Action::Ask(|call| Ok(Request::PlayTour(call.parse()?))),
    },
    Route {
        method: "DELETE",
        path: "/tour",
        summary: "Ends the tour; the camera stays where it is.",
        query: &[],
        body: None,
        action: Action::Ask(|_| Ok(Request::StopTour)),
    },
];

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraBody {
    position: DVec3,
    rotation: Option<DQuat>,
    target: Option<DVec3>,
    up: Option<DVec3>,
    scale: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct OverlaysBody {
    views: Vec<View>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ViewBody {
    camera: Option<Camera>,
}

fn set_camera(call: &Call) -> Result<Request, Refusal> {
    let CameraBody { position, rotation, target, up, scale } = call.parse()?;
    let scale = scale.unwrap_or(1.0);
    let camera = match (rotation, target) {
        (Some(rotation), None) if up.is_none() => Camera { position, rotation, scale },
        (None, Some(target)) => {
            let up = up.unwrap_or(DVec3::Y);
            if !(position.is_finite() && target.is_finite() && up.is_finite()) {
                return Err(Refusal::malformed("position, target and up are finite numbers"));
            }
            Camera::look_at(position, target, up).with_scale(scale)
        }
        _ => {
            let reason = "a camera has a position, and either a rotation or a target with its up";
            return Err(Refusal::malformed(reason));
        }
    };
    Ok(Request::SetCamera(camera))
}

/// Moves the camera to a stored view.
///
/// # Errors
/// There is no such view.
pub(in crate::http) async fn show_view(
    connection: &Connection,
    call: &Call,
) -> Result<Response<Body>, Refusal> {
    let name = call.name();
    let listed = connection.ask(&call.headers, Request::ListStoredViews).await?;
    let WallResponse::StoredViews(views) = listed.response else {
        return Err(Refusal::unavailable("the manager sent another answer"));
    };
    let Some(view) = views.iter().find(|view| view.name == name) else {
        let names: Vec<&str> = views.iter().map(|view| view.name.as_str()).collect();
        let reason = format!("no view is stored as {name:?}; there are: {}", names.join(", "));
        return Err(Refusal::not_found(reason));
    };
    let frame = Request::Redraw(Some(view.camera));
    let shown = connection.ask(&call.headers, frame).await?;
    let WallResponse::Frame(frame) = shown.response else {
        return Err(Refusal::unavailable("the manager sent another answer"));
    };
    Ok(route::with_warnings(answer::json(StatusCode::OK, &frame), shown.warnings))
}
