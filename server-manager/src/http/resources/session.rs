//! Resources of the connection: any request, events, the description, and logging in.

use hyper::{Response, StatusCode};
use polyptych_protocol::request::Request;
use serde::Deserialize;
use serde_json::json;

use crate::http::answer::{self, Body, Refusal};
use crate::http::connection::Connection;
use crate::http::events::EventStream;
use crate::http::route::{Action, Call, Route};

/// The routes of this resource.
pub(in crate::http) const ROUTES: &[Route] = &[
    Route {
        method: "POST",
        path: "/requests",
        summary: "Any request of the wire, in the form of its type; answered with `response` and \
                  `warnings`.",
        query: &[],
        body: Some(|| json!(Request::Status)),
        action: Action::Request,
    },
    Route {
        method: "GET",
        path: "/events",
        summary: "Server-sent events: `status` twice a second, `log` in words, and with \
                  `feedback=true` the `feedback` of every frame. A reader that is slow is sent \
                  `lost` with the number of events that it missed.",
        query: &[("feedback", "true for the feedback of every frame.")],
        body: None,
        action: Action::Events,
    },
    Route {
        method: "GET",
        path: "/openapi.json",
        summary: "This description.",
        query: &[],
        body: None,
        action: Action::Description,
    },
    Route {
        method: "POST",
        path: "/login/challenge",
        summary: "Begins a login: a random number of the client, for one of the manager and its \
                  proof that it knows the wall's token.",
        query: &[],
        body: Some(|| json!({ "nonce": "00112233445566778899aabbccddeeff" })),
        action: Action::Challenge,
    },
    Route {
        method: "POST",
        path: "/login/code",
        summary: "Ends a login: the client's proof, for the code of a link that is good once.",
        query: &[],
        body: Some(|| json!({ "nonce": "00112233445566778899aabbccddeeff", "proof": "…" })),
        action: Action::Code,
    },
];

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ChallengeBody {
    nonce: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CodeBody {
    nonce: String,
    proof: String,
}

/// Asks anything that has one answer without pictures or files.
///
/// # Errors
/// The manager's refusal; 400 for what has a resource of its own.
pub(in crate::http) async fn request(
    connection: &Connection,
    call: &Call,
) -> Result<Response<Body>, Refusal> {
    let request: Request = call.parse()?;
    let instead = match &request {
        Request::Capture { .. } | Request::Preview { .. } => {
            Some("pictures are at GET /api/v1/wall.png")
        }
        Request::Subscribe(_) => Some("feedback is at GET /api/v1/events?feedback=true"),
        Request::ExportScene { .. } => Some("files are at GET /api/v1/scene/export.glb"),
        _ => None,
    };
    if let Some(instead) = instead {
        let reason = format!("to {} is not for HTTP's requests; {instead}", request.name());
        return Err(Refusal::malformed(reason));
    }
    let answered = connection.ask(&call.headers, request).await?;
    let all = json!({ "response": answered.response, "warnings": answered.warnings });
    Ok(answer::json(StatusCode::OK, &all))
}

/// Begins a stream of events.
pub(in crate::http) fn events(connection: &Connection, call: &Call) -> Response<Body> {
    let live = &connection.context.live;
    let wish = (call.query.get("feedback") == Some("true")).then(|| live.wish_for_feedback());
    let events = EventStream::new(live.watch(), wish);
    answer::with_body(StatusCode::OK, "text/event-stream", Body::Events(events))
}

/// Begins a login.
///
/// # Errors
/// The manager has keys, or the number is no such.
pub(in crate::http) fn challenge(
    connection: &Connection,
    call: &Call,
) -> Result<Response<Body>, Refusal> {
    let ChallengeBody { nonce } = call.parse()?;
    let (nonce, proof) = connection.context.gate.challenge(&nonce)?;
    Ok(answer::json(StatusCode::OK, &json!({ "nonce": nonce, "proof": proof })))
}

/// Ends a login.
///
/// # Errors
/// The proof is wrong.
pub(in crate::http) fn code(
    connection: &Connection,
    call: &Call,
) -> Result<Response<Body>, Refusal> {
    let CodeBody { nonce, proof } = call.parse()?;
    let code = connection.context.gate.code(&nonce, &proof)?;
    Ok(answer::json(StatusCode::OK, &json!({ "code": code })))
}
