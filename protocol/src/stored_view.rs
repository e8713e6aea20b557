//! Places of the camera that the manager keeps under a name.

use polyptych_text::{printable, text_of_peer};
use polyptych_wall::camera::Camera;
use polyptych_wall::limits::NAME_BYTES_MAX;
use serde::{Deserialize, Serialize};

/// A place of the camera under a name. It is no [`View`](polyptych_wall::view::View), which lies
/// over the wall's own picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StoredView {
    /// 1 to [`NAME_BYTES_MAX`] bytes without control characters, unique on a wall.
    #[serde(deserialize_with = "text_of_peer")]
    pub name: String,
    /// The place of display space in the scene.
    pub camera: Camera,
}

/// Returns what is wrong with the name of a stored view, if anything.
pub fn name_fault(name: &str) -> Option<String> {
    if (1..=NAME_BYTES_MAX).contains(&name.len()) && printable(name) == name {
        return None;
    }
    let bytes = name.len();
    Some(format!(
        "the name of a view has 1 to {NAME_BYTES_MAX} bytes without control characters; this one \
         has {bytes} bytes: {}",
        printable(&name[..name.floor_char_boundary(NAME_BYTES_MAX)])
    ))
}
