//! Scenes that leave a wall as files.

use polyptych_text::text_of_peer;
use serde::{Deserialize, Serialize};

/// A scene that was written as a binary glTF file.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ExportedScene {
    /// The scene's name.
    #[serde(deserialize_with = "text_of_peer")]
    pub name: String,
    /// The size of the file.
    pub bytes: u64,
    /// Nodes in it, hidden ones too.
    pub nodes: u64,
    /// Meshes in it: those that nodes show.
    pub meshes: u64,
    /// Textures in it: those of the materials of these meshes.
    pub textures: u64,
    /// The facts of the scene that glTF cannot hold, in lines for people; at most
    /// [`polyptych_scene::limits::NOTES_MAX`].
    #[serde(deserialize_with = "text_of_peer")]
    pub notes: Vec<String>,
}
