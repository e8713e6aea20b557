//! The scene files that a manager can open.

use polyptych_text::text_of_peer;
use serde::{Deserialize, Serialize};

/// Maximum number of files in a list: its JSON takes 512 KiB at most.
pub const SCENE_FILES_MAX: usize = 1024;

/// In refusals of a file that lies in none of them.
pub const SCENE_FOLDERS: &str = "the manager's scene folders";

/// The glTF files in the manager's scene folders.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SceneFileList {
    /// By path; at most [`SCENE_FILES_MAX`].
    pub files: Vec<SceneFileInfo>,
    /// `true` if there are more than could be listed.
    pub is_cut: bool,
}

/// A scene file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SceneFileInfo {
    /// The path by which it is opened, relative to its scene folder.
    #[serde(deserialize_with = "text_of_peer")]
    pub path: String,
    /// The size of the file itself, in bytes.
    pub bytes: u64,
    /// The time of its last change, in seconds since 1970, UTC; 0 if the system does not tell.
    pub changed_at_s: u64,
}
