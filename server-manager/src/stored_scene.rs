//! Scenes as they were edited, in the store.

use polyptych_core::EditedScene;
use polyptych_files::blob::BlobStore;
use polyptych_protocol::saved_scene::{self, SavedScene};
use serde::{Deserialize, Serialize};

use crate::entry_store::Entry;
use crate::import;

/// A scene as it is kept.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct StoredScene {
    pub scene: EditedScene,
    /// Nodes that are not as the scene's file has them.
    pub edited_nodes: u64,
    /// In seconds since 1970, UTC.
    pub saved_at_s: u64,
}

impl StoredScene {
    /// A scene to be kept. What its file says of nodes counts as no edit.
    ///
    /// # Errors
    /// Its file is not whole any more.
    pub fn new(scene: EditedScene, blobs: &BlobStore, saved_at_s: u64) -> Result<Self, String> {
        let mut edited_nodes = 0;
        if !scene.edits.is_empty() {
            let first = import::read_manifest(blobs, scene.scene.manifest)?.scene.edits;
            let is_edited = |(node, edits)| first.node(node) != Some(edits);
            edited_nodes = scene.edits.nodes().filter(|of| is_edited(*of)).count() as u64;
        }
        Ok(Self { scene, edited_nodes, saved_at_s })
    }
}

impl Entry for StoredScene {
    type Summary = SavedScene;
    const TABLE: &'static str = "scenes.2";
    const NOUN: &'static str = "scene";

    fn name_fault(name: &str) -> Option<String> {
        saved_scene::name_fault(name)
    }

    fn summary(&self, name: &str) -> SavedScene {
        SavedScene {
            name: name.to_owned(),
            scene: self.scene.scene.name.clone(),
            edited_nodes: self.edited_nodes,
            saved_at_s: self.saved_at_s,
        }
    }
}
