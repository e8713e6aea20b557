//! Answers: JSON, bytes and streams, with the headers that keep browsers safe; and refusals.

use std::io;
use std::pin::Pin;
use std::task::{Context, Poll, ready};

use bytes::Bytes;
use hyper::body::Frame;
use hyper::header::{
    ALLOW, CACHE_CONTROL, CONTENT_TYPE, HeaderName, HeaderValue, REFERRER_POLICY, RETRY_AFTER,
    UPGRADE, WWW_AUTHENTICATE, X_CONTENT_TYPE_OPTIONS, X_FRAME_OPTIONS,
};
use hyper::{Response, StatusCode};
use polyptych_protocol::request::RequestError;
use serde::Serialize;
use tokio::sync::OwnedSemaphorePermit;

use super::events::EventStream;
use super::file_stream::FileStream;

/// Bytes that hyper is given at a time: a reader that is slow holds the rest where it is counted.
const SLICE_BYTES: usize = 64 << 10;

/// A page from another origin may not read an answer, not even as a picture.
const RESOURCE_POLICY: HeaderName = HeaderName::from_static("cross-origin-resource-policy");

/// Seconds after which a request that was not done may be repeated.
const RETRY_S: HeaderValue = HeaderValue::from_static("1");

/// The body of an answer.
pub(super) enum Body {
    /// Bytes, and the place that they hold among large answers until they are read.
    Bytes(
        Bytes,
        #[expect(dead_code, reason = "counted until it is dropped")] Option<OwnedSemaphorePermit>,
    ),
    /// Server-sent events, which end with the connection.
    Events(EventStream),
    /// A file that is still coming.
    File(Box<FileStream>),
}

impl hyper::body::Body for Body {
    type Data = Bytes;
    type Error = io::Error;

    fn poll_frame(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<io::Result<Frame<Bytes>>>> {
        match self.get_mut() {
            Self::Bytes(bytes, _) if bytes.is_empty() => Poll::Ready(None),
            Self::Bytes(bytes, _) => {
                let slice = bytes.split_to(bytes.len().min(SLICE_BYTES));
                Poll::Ready(Some(Ok(Frame::data(slice))))
            }
            Self::Events(events) => {
                let event = ready!(events.poll_next(context));
                Poll::Ready(event.map(|bytes| Ok(Frame::data(bytes))))
            }
            Self::File(file) => {
                let piece = ready!(file.poll_next(context));
                Poll::Ready(piece.map(|bytes| bytes.map(Frame::data)))
            }
        }
    }

    fn is_end_stream(&self) -> bool {
        matches!(self, Self::Bytes(bytes, _) if bytes.is_empty())
    }

    fn size_hint(&self) -> hyper::body::SizeHint {
        match self {
            Self::Bytes(bytes, _) => hyper::body::SizeHint::with_exact(bytes.len() as u64),
            Self::Events(_) | Self::File(_) => hyper::body::SizeHint::default(),
        }
    }
}

/// The refusal of a request: a status and a reason in words.
#[derive(Debug)]
pub(super) struct Refusal {
    pub status: StatusCode,
    pub reason: String,
    /// The methods that there are instead, for 405.
    pub allow: Option<String>,
}

impl Refusal {
    pub fn new(status: StatusCode, reason: impl Into<String>) -> Self {
        Self { status, reason: reason.into(), allow: None }
    }

    /// Returns the refusal of a request that has the wrong form: 400.
    pub fn malformed(reason: impl Into<String>) -> Self {
        Self::new(StatusCode::BAD_REQUEST, reason)
    }

    /// Returns the refusal after the manager ended with the request on its way: 504.
    pub fn outcome_unknown(self) -> Self {
        let reason = format!("{}; whether the request was done is unknown", self.reason);
        Self::new(StatusCode::GATEWAY_TIMEOUT, reason)
    }

    /// Returns the refusal where the manager has no room now, or ends: 503, nothing was done.
    pub fn unavailable(reason: impl Into<String>) -> Self {
        Self::new(StatusCode::SERVICE_UNAVAILABLE, reason)
    }

    pub fn not_found(reason: impl Into<String>) -> Self {
        Self::new(StatusCode::NOT_FOUND, reason)
    }

    /// Returns the answer with the reason: `{"error": "…"}`.
    pub fn into_answer(self) -> Response<Body> {
        let mut answer = json(self.status, &serde_json::json!({ "error": self.reason }));
        let headers = answer.headers_mut();
        if self.status == StatusCode::UNAUTHORIZED {
            headers.insert(WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
        }
        if self.status == StatusCode::UPGRADE_REQUIRED {
            headers.insert(UPGRADE, HeaderValue::from_static("websocket"));
        }
        if self.status == StatusCode::SERVICE_UNAVAILABLE {
            headers.insert(RETRY_AFTER, RETRY_S);
        }
        if let Some(allow) = self.allow.and_then(|allow| HeaderValue::from_str(&allow).ok()) {
            headers.insert(ALLOW, allow);
        }
        answer
    }
}

/// The manager understood a request and does not do it: the text is that of TCP.
impl From<RequestError> for Refusal {
    fn from(error: RequestError) -> Self {
        Self::new(StatusCode::UNPROCESSABLE_ENTITY, error.reason)
    }
}

/// An answer of JSON.
pub(super) fn json(status: StatusCode, value: &impl Serialize) -> Response<Body> {
    match serde_json::to_vec(value) {
        Ok(text) => with_type(status, "application/json", text.into()),
        Err(error) => {
            let text = format!("{{\"error\":\"the answer is no JSON: {error}\"}}");
            with_type(StatusCode::INTERNAL_SERVER_ERROR, "application/json", text.into())
        }
    }
}

/// An answer of bytes of this type.
pub(super) fn with_type(
    status: StatusCode,
    content_type: &'static str,
    bytes: Bytes,
) -> Response<Body> {
    with_body(status, content_type, Body::Bytes(bytes, None))
}

/// An answer with this body.
pub(super) fn with_body(
    status: StatusCode,
    content_type: &'static str,
    body: Body,
) -> Response<Body> {
    let mut answer = Response::new(body);
    *answer.status_mut() = status;
    let headers = answer.headers_mut();
    headers.insert(CONTENT_TYPE, HeaderValue::from_static(content_type));
    headers.insert(CACHE_CONTROL, HeaderValue::from_static("no-store"));
    headers.insert(X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(X_FRAME_OPTIONS, HeaderValue::from_static("DENY"));
    headers.insert(REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    headers.insert(RESOURCE_POLICY, HeaderValue::from_static("same-origin"));
    answer
}
