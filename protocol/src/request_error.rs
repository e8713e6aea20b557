//! The reason for which a request fails.

use polyptych_text::text_of_peer;
use serde::{Deserialize, Serialize};

/// The reason why a request was not done; the wall is as it was before.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[error("{reason}")]
pub struct RequestError {
    /// The failure, its place, and the fix.
    #[serde(deserialize_with = "text_of_peer")]
    pub reason: String,
}

impl RequestError {
    /// A failure for this reason.
    pub fn new(reason: impl Into<String>) -> Self {
        Self { reason: reason.into() }
    }
}
