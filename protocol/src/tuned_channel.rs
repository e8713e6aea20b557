//! The part of a channel's calibration that was tuned.

use polyptych_text::text_of_peer;
use serde::{Deserialize, Serialize};

/// A channel that was tuned since the manager loaded the wall file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TunedChannel {
    /// The channel's name.
    #[serde(deserialize_with = "text_of_peer")]
    pub channel: String,
    /// The keys that were tuned, as commands call them: `pin`, `edge.left`; those too that have
    /// the wall file's value again.
    #[serde(deserialize_with = "text_of_peer")]
    pub keys: Vec<String>,
}
