//! The outcome of a request to end all servers.

use polyptych_text::text_of_peer;
use serde::{Deserialize, Serialize};

/// The outcome for a wall's servers that were told to end, by name.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct StoppedServers {
    /// Servers that said goodbye.
    #[serde(deserialize_with = "text_of_peer")]
    pub ended: Vec<String>,
    /// Servers that were told to end and did not say goodbye, with what they did instead.
    #[serde(deserialize_with = "text_of_peer")]
    pub silent: Vec<(String, String)>,
    /// Servers of the wall file that were not connected, so they could not be told.
    #[serde(deserialize_with = "text_of_peer")]
    pub absent: Vec<String>,
}
