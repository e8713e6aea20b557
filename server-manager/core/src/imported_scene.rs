//! Scenes that can be shown, as the core is told of them.

use std::sync::Arc;

use polyptych_protocol::request::SceneSummary;
use polyptych_protocol::state_log::SceneRef;
use polyptych_scene::{SceneEdits, SceneOutline};
use serde::{Deserialize, Serialize};

/// A scene that was baked and can be shown.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImportedScene {
    /// Its name and manifest.
    pub scene: SceneRef,
    /// The summary that the client is sent; the core fills in the revision.
    pub summary: Box<SceneSummary>,
    /// The outline, which is needed to edit it.
    pub outline: Arc<SceneOutline>,
    /// Its changes when it was saved.
    pub edits: SceneEdits,
    /// The number that its next node gets at least.
    pub next_node: u64,
}

impl ImportedScene {
    /// A scene as its file has it.
    pub fn of_file(scene: SceneRef, summary: SceneSummary, outline: Arc<SceneOutline>) -> Self {
        let summary = Box::new(summary);
        Self { scene, summary, outline, edits: SceneEdits::default(), next_node: 0 }
    }
}

/// A scene with all that was changed of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EditedScene {
    /// Its name and manifest.
    pub scene: SceneRef,
    /// Its changes.
    pub edits: SceneEdits,
    /// The number that its next node gets at least.
    pub next_node: u64,
}
