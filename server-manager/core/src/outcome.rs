//! Outcomes of scenes whose client has lost its connection meanwhile: a scene may bake for minutes,
//! and a client that is back in the same epoch can ask.

use std::collections::VecDeque;

use polyptych_protocol::ids::RequestId;
use polyptych_protocol::request::{RequestError, Response};
use serde::{Deserialize, Serialize};

use super::{ClientRequest, Cluster, SessionId};

/// Maximum number of outcomes that are kept for clients that may come back.
pub(super) const OUTCOMES_MAX: usize = 64;

/// A request to open a scene that its client has not been answered yet.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Opened {
    /// The first client's request, which names the bake.
    job: ClientRequest,
    /// The request that is answered in its place: the same, or one for its outcome.
    heir: ClientRequest,
    /// The outcome, if it came after the client had gone.
    outcome: Option<Result<Response, RequestError>>,
}

/// All of them, the oldest first.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Outcomes(VecDeque<Opened>);

impl Outcomes {
    /// A client has asked for a scene.
    pub fn begin(&mut self, job: ClientRequest) {
        self.0.push_back(Opened { job, heir: job, outcome: None });
    }

    /// Returns the request that is answered for this one.
    pub fn heir(&self, job: ClientRequest) -> ClientRequest {
        let opened = self.0.iter().find(|opened| opened.job == job);
        opened.map_or(job, |opened| opened.heir)
    }

    /// The client was answered.
    fn remove(&mut self, job: ClientRequest) {
        self.0.retain(|opened| opened.job != job);
    }

    /// Keeps what came of a scene whose client is not there; other requests are forgotten.
    fn keep(&mut self, job: ClientRequest, outcome: Result<Response, RequestError>) {
        let Some(opened) = self.0.iter_mut().find(|opened| opened.job == job) else { return };
        opened.outcome = Some(outcome);
        let kept = self.0.iter().filter(|opened| opened.outcome.is_some()).count();
        if kept > OUTCOMES_MAX
            && let Some(oldest) = self.0.iter().position(|opened| opened.outcome.is_some())
        {
            self.0.remove(oldest);
        }
    }
}

impl Cluster {
    /// Answers a request, or keeps the answer for a client that may come back for it.
    pub(super) fn reply(&mut self, job: ClientRequest, reply: Result<Response, RequestError>) {
        let to = self.outcomes.heir(job);
        if self.clients.contains_key(&to.client) {
            self.outcomes.remove(job);
            self.send_reply(to, reply);
        } else {
            self.outcomes.keep(job, reply);
        }
    }

    /// A client asks what became of a scene that it opened over another connection. The answer is
    /// that of the first request, now or once there is one.
    pub(super) fn claim_outcome(
        &mut self,
        job: ClientRequest,
        session: u64,
        id: RequestId,
    ) -> Result<Option<Response>, String> {
        let first = ClientRequest { client: SessionId(session), id };
        let Some(opened) = self.outcomes.0.iter_mut().find(|opened| opened.job == first) else {
            return Err("the scene was not opened before the connection was lost, or its outcome \
                        was asked for too late; open it again"
                .to_owned());
        };
        opened.heir = job;
        let Some(outcome) = opened.outcome.take() else { return Ok(None) };
        self.outcomes.remove(first);
        outcome.map(Some).map_err(|failure| failure.reason)
    }
}
