//! The node that a pixel of the wall shows.

use glam::DVec2;
use hyper::{Response, StatusCode};
use polyptych_protocol::node_query::{RayHit, RayQuery};
use polyptych_protocol::request::{Request, Response as WallResponse};
use polyptych_scene::{NodeId, SceneSubset};
use polyptych_wall::Wall;
use serde::Deserialize;
use serde_json::json;

use crate::http::answer::{self, Body, Refusal};
use crate::http::client::{Answered, HttpClient};
use crate::http::connection::Connection;
use crate::http::route::{Action, Call, Route};

/// The routes of this resource.
pub(in crate::http) const ROUTES: &[Route] = &[Route {
    method: "POST",
    path: "/pick",
    summary: "The node of the open scene that a pixel of a screen shows, with the point that is \
              met, or null. Pixels count from the upper left of the screen; the middle of the \
              first is 0.5, 0.5.",
    query: &[],
    body: Some(|| json!({ "screen": "front", "pixel": [960.5, 540.5] })),
    action: Action::Pick,
}];

/// A pixel of the wall.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PickBody {
    screen: String,
    pixel: DVec2,
}

/// Finds what a pixel shows.
///
/// # Errors
/// There is no such screen or pixel, or no scene is open.
pub(in crate::http) async fn answer(
    connection: &Connection,
    call: &Call,
) -> Result<Response<Body>, Refusal> {
    let body: PickBody = call.parse()?;
    let status = connection.ask(&call.headers, Request::Status).await?;
    let query = query(&body, &connection.context.wall, status)?;
    let cast = connection.ask(&call.headers, Request::CastRay(query)).await?;
    Ok(answer::json(StatusCode::OK, &hit(cast)?))
}

/// Finds what a pixel shows, asked by this client.
///
/// # Errors
/// Those of [`answer`].
pub(super) async fn find(
    client: &mut HttpClient,
    wall: &Wall,
    body: &PickBody,
) -> Result<Option<RayHit>, Refusal> {
    let status = client.ask(Request::Status).await?;
    let query = query(body, wall, status)?;
    hit(client.ask(Request::CastRay(query)).await?)
}

fn other() -> Refusal {
    Refusal::unavailable("the manager sent another answer")
}

/// Returns the ray through a pixel, of the wall's own picture or of the view that lies there.
fn query(
    PickBody { screen, pixel }: &PickBody,
    wall: &Wall,
    status: Answered,
) -> Result<RayQuery, Refusal> {
    let WallResponse::Status(status) = status.response else { return Err(other()) };
    let (views, head) = (status.presentation.all_views(), status.presentation.head);
    let ray = wall.pick_ray(&views, &head, screen, *pixel);
    let refused = |reason: String| Refusal::new(StatusCode::UNPROCESSABLE_ENTITY, reason);
    let ray = ray.map_err(|error| refused(error.to_string()))?;
    let view = wall.view_at(&views, screen, *pixel).cloned();
    let subset = view.map_or_else(SceneSubset::default, |view| SceneSubset {
        root: view.root.map(NodeId),
        layers: view.layers,
    });
    Ok(RayQuery { subset, ..RayQuery::new(ray) })
}

fn hit(cast: Answered) -> Result<Option<RayHit>, Refusal> {
    let WallResponse::Ray(hit) = cast.response else { return Err(other()) };
    Ok(hit)
}
