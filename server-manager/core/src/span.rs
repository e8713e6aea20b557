//! Whom and what a line of the log is about.
//!
//! Spans are made where something is said, not where something happens: a frame of a healthy wall
//! makes none. They are errors by level, so that they stand around lines of every level.

use polyptych_protocol::ids::FrameId;
use tracing::{Span, error_span};

use super::registry::Registry;
use super::{ClientRequest, Cluster, SessionId};

impl Cluster {
    /// The peer of a connection, as far as it is known.
    pub fn session_span(&self, session: SessionId) -> Span {
        match self.clients.get(&session) {
            Some(client) => error_span!("client", session = session.0, client = client.name),
            None => self.registry.session_span(session),
        }
    }

    /// A request, within its client.
    pub fn request_span(&self, job: ClientRequest) -> Span {
        let client = self.session_span(job.client);
        error_span!(parent: &client, "request", request = job.id.0)
    }
}

impl Registry {
    /// A server's connection, as far as it is known.
    pub fn session_span(&self, session: SessionId) -> Span {
        let Some(server) = self.server(session) else {
            return error_span!("session", session = session.0);
        };
        let (name, address) = (server.name.as_str(), server.address.as_str());
        error_span!("server", session = session.0, server = name, address)
    }
}

/// A frame on its way.
pub(super) fn frame_span(frame: FrameId) -> Span {
    error_span!("frame", frame = frame.0)
}
