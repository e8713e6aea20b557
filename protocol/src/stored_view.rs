//! Places of the camera that the manager keeps under a name.

use polyptych_text::text_of_peer;
use polyptych_wall::camera::Camera;
use serde::{Deserialize, Serialize};

use crate::saved_scene::kept_name_fault;

/// A place of the camera under a name. It is no [`View`](polyptych_wall::view::View), which lies
/// over the wall's own picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StoredView {
    /// 1 to [`NAME_BYTES_MAX`](polyptych_wall::limits::NAME_BYTES_MAX) bytes without control
    /// characters, unique on a wall.
    #[serde(deserialize_with = "text_of_peer")]
    pub name: String,
    /// The place of display space in the scene.
    pub camera: Camera,
}

/// Returns what is wrong with the name of a stored view, if anything.
pub fn name_fault(name: &str) -> Option<String> {
    kept_name_fault("the name of a view", name)
}
