//! A request that was sent and may be answered later.

use std::pin::Pin;
use std::task::{Context, Poll};

use polyptych_protocol::ids::RequestId;
use polyptych_protocol::request::Response;
use tokio::sync::oneshot;
use tokio::sync::oneshot::error::TryRecvError;

use crate::connection_handle::ConnectionHandle;
use crate::error::ClientError;
use crate::image::ChunkSink;

/// A reply, and the pieces that came before it.
#[derive(Debug)]
pub(crate) struct CompletedResponse {
    pub reply: Response,
    pub parts: Option<ChunkSink>,
}

/// A request that was sent: await it, ask it from time to time, or drop it.
///
/// Dropping gives up the answer, not the request: the manager may do it all the same. It frees the
/// request's place at once. While it is held, the connection stays open.
#[derive(Debug)]
#[must_use = "dropping gives up the answer"]
pub struct Pending {
    id: RequestId,
    request: &'static str,
    /// `None` once the answer was given out.
    answer: Option<oneshot::Receiver<Result<CompletedResponse, ClientError>>>,
    link: ConnectionHandle,
}

impl Pending {
    pub(crate) fn new(
        id: RequestId,
        request: &'static str,
        answer: oneshot::Receiver<Result<CompletedResponse, ClientError>>,
        link: ConnectionHandle,
    ) -> Self {
        Self { id, request, answer: Some(answer), link }
    }

    /// The request's number, as it stands in the manager's log.
    pub fn id(&self) -> RequestId {
        self.id
    }

    /// Returns the answer, if it is there; does not wait. The answer is given once.
    ///
    /// # Errors
    /// The request's [`ClientError`]; [`ClientError::AnswerTaken`] after that.
    pub fn poll(&mut self) -> Option<Result<Response, ClientError>> {
        let Some(answer) = &mut self.answer else {
            return Some(Err(ClientError::AnswerTaken { request: self.request }));
        };
        let answered = match answer.try_recv() {
            Err(TryRecvError::Empty) => return None,
            Ok(answered) => answered,
            Err(TryRecvError::Closed) => Err(self.lost()),
        };
        self.answer = None;
        Some(answered.map(|answered| answered.reply))
    }

    /// Waits for the answer and the pictures that came before it.
    pub(crate) fn poll_answered(
        &mut self,
        context: &mut Context<'_>,
    ) -> Poll<Result<CompletedResponse, ClientError>> {
        let Some(answer) = &mut self.answer else {
            return Poll::Ready(Err(ClientError::AnswerTaken { request: self.request }));
        };
        let Poll::Ready(answered) = Pin::new(answer).poll(context) else {
            return Poll::Pending;
        };
        self.answer = None;
        Poll::Ready(answered.unwrap_or_else(|_| Err(self.lost())))
    }

    /// The table always answers before it lets go; this is for completeness.
    fn lost(&self) -> ClientError {
        ClientError::ConnectionLost {
            request: self.request,
            address: self.link.shared.address.clone(),
            reason: "the client ended".into(),
        }
    }
}

impl Future for Pending {
    type Output = Result<Response, ClientError>;

    fn poll(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Self::Output> {
        let answered = self.get_mut().poll_answered(context);
        answered.map(|answered| answered.map(|answered| answered.reply))
    }
}

impl Drop for Pending {
    fn drop(&mut self) {
        if self.answer.is_some() {
            self.link.shared.forget(self.id);
        }
    }
}
