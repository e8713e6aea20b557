//! Sessions: all that a wall shows and how it shows it, kept by the manager under names.

use polyptych_text::text_of_peer;
use serde::{Deserialize, Serialize};

use crate::request::SceneSummary;
use crate::saved_scene::kept_name_fault;

/// An entry in the list of saved sessions.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SavedSession {
    /// 1 to [`NAME_BYTES_MAX`](polyptych_wall::limits::NAME_BYTES_MAX) bytes without control
    /// characters, unique on a wall.
    #[serde(deserialize_with = "text_of_peer")]
    pub name: String,
    /// The scene that was open, if one was.
    #[serde(deserialize_with = "text_of_peer")]
    pub scene: Option<String>,
    /// Views that lay over the wall's own picture.
    pub views: u64,
    /// Places of the camera that were stored.
    pub stored_views: u64,
    /// The time at which it was saved, in seconds since 1970, UTC.
    pub saved_at_s: u64,
}

/// A session that was opened.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OpenedSession {
    /// The scene that it shows, if it shows one.
    pub scene: Option<SceneSummary>,
    /// The parts of it that do not fit this wall, each with its reason; they were left out.
    #[serde(deserialize_with = "text_of_peer")]
    pub left_out: Vec<String>,
}

/// Returns what is wrong with the name of a session, if anything.
pub fn name_fault(name: &str) -> Option<String> {
    kept_name_fault("a session's name", name)
}
