//! Scenes as they were edited, kept by the manager under names.

use polyptych_text::{printable, text_of_peer};
use serde::{Deserialize, Serialize};

use polyptych_wall::limits::NAME_BYTES_MAX;

/// Stands before a saved scene's name where a scene's path is asked for:
/// `saved:NAME` in [`Request::OpenScene`](crate::request::Request::OpenScene).
pub const SAVED_PREFIX: &str = "saved:";

/// An entry in the list of saved scenes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SavedScene {
    /// The name that it was saved under.
    #[serde(deserialize_with = "text_of_peer")]
    pub name: String,
    /// The scene that was open.
    #[serde(deserialize_with = "text_of_peer")]
    pub scene: String,
    /// Nodes that are not as its file has them.
    pub edited_nodes: u64,
    /// The time of saving, in seconds since 1970, UTC.
    pub saved_at_s: u64,
}

/// Returns what is wrong with the name of a saved scene, if anything.
pub fn name_fault(name: &str) -> Option<String> {
    kept_name_fault("a saved scene's name", name)
}

/// Returns what is wrong with a name under which the manager keeps something, if anything. `what`
/// begins the message: "a saved scene's name".
pub(crate) fn kept_name_fault(what: &str, name: &str) -> Option<String> {
    if (1..=NAME_BYTES_MAX).contains(&name.len()) && printable(name) == name {
        return None;
    }
    let shown = printable(&name[..name.floor_char_boundary(NAME_BYTES_MAX)]).into_owned();
    Some(format!(
        "{what} has 1 to {NAME_BYTES_MAX} bytes without control characters; this \
         one has {} bytes: {shown}",
        name.len()
    ))
}
