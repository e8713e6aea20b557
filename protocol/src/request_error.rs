//! The reason for which a request fails.

use polyptych_text::text_of_peer;
use serde::{Deserialize, Serialize};

/// The beginning of the reason why a capture is refused while pictures of others take the room: it
/// can be asked for again once they were read.
pub const CAPTURE_ROOM_TAKEN: &str = "captures on their way take";

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
