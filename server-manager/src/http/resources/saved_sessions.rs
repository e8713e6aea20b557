//! Saved sessions: all that the wall shows, under names.

use polyptych_protocol::request::Request;

use crate::http::route::{Action, Route};

/// The routes of this resource.
pub(in crate::http) const ROUTES: &[Route] = &[
    Route {
        method: "GET",
        path: "/sessions",
        summary: "The saved sessions, by name.",
        query: &[],
        body: None,
        action: Action::Ask(|_| Ok(Request::ListSessions)),
    },
    Route {
        method: "PUT",
        path: "/sessions/{name}",
        summary: "Saves all that the wall shows and how it shows it under a name: the scene with \
                  its edits, camera, head, overlays, stored views, tour, light, surroundings, \
                  bounds, modes and pace.",
        query: &[],
        body: None,
        action: Action::Ask(|call| Ok(Request::SaveSession { name: call.name() })),
    },
    Route {
        method: "POST",
        path: "/sessions/{name}/open",
        summary: "Shows a saved session in the place of all that is shown: answered once all can \
                  draw it, with its `scene` and the parts `left_out` that do not fit this wall.",
        query: &[],
        body: None,
        action: Action::Ask(|call| Ok(Request::OpenSession { name: call.name() })),
    },
    Route {
        method: "DELETE",
        path: "/sessions/{name}",
        summary: "Forgets a saved session.",
        query: &[],
        body: None,
        action: Action::Ask(|call| Ok(Request::RemoveSession { name: call.name() })),
    },
];
