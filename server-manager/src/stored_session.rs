//! Sessions, in the store: written for the wall as it was, read for the wall as it is.

use polyptych_core::{EditedScene, ImportedSession, PersistentState};
use polyptych_files::blob::{BlobHash, BlobStore};
use polyptych_protocol::saved_session::{self, SavedSession};
use polyptych_wall::Wall;
use serde::{Deserialize, Serialize};

use crate::entry_store::Entry;
use crate::import::{self, Import};
use crate::state_file::{Saved, reconcile};

/// A session as it is kept.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct StoredSession {
    /// The wall of the wall file at that time, without paths.
    pub wall: Wall,
    /// The state of this wall.
    pub state: PersistentState,
    /// In seconds since 1970, UTC.
    pub saved_at_s: u64,
}

impl Entry for StoredSession {
    type Summary = SavedSession;
    const TABLE: &'static str = "sessions.1";
    const NOUN: &'static str = "session";

    fn name_fault(name: &str) -> Option<String> {
        saved_session::name_fault(name)
    }

    fn summary(&self, name: &str) -> SavedSession {
        SavedSession {
            name: name.to_owned(),
            scene: self.state.scene.as_ref().map(|scene| scene.name.clone()),
            views: self.state.presentation.views.len() as u64,
            stored_views: self.state.stored_views.len() as u64,
            saved_at_s: self.saved_at_s,
        }
    }
}

impl StoredSession {
    /// Returns the session as this wall can show it, and the blobs that servers may ask for.
    ///
    /// # Errors
    /// Its scene is not whole any more.
    pub fn read(
        self,
        name: &str,
        wall: &Wall,
        blobs: &BlobStore,
    ) -> Result<(ImportedSession, Vec<BlobHash>), String> {
        let reconciled = reconcile(Saved { wall: self.wall, memory: self.state }, wall);
        let dropped = reconciled.dropped.into_iter();
        let mut left_out: Vec<_> = dropped.map(|(what, why)| format!("{what}: {why}")).collect();
        let mut state = reconciled.memory;
        let mut allowed = Vec::new();
        let mut scene = None;
        if let Some(of) = state.scene.clone() {
            let (edits, next_node) = (state.edits.clone(), state.next_node);
            let edited = EditedScene { scene: of, edits, next_node };
            let gone = |reason| format!("the session {name} is not whole any more: {reason}");
            let Import { scene: imported, blobs } =
                import::read_edited(blobs, edited).map_err(gone)?;
            allowed.extend(blobs);
            scene = Some(imported);
        }
        if let Some(environment) = state.environment.take_if(|of| !blobs.contains(of.blob)) {
            let name = environment.name;
            left_out.push(format!("the surroundings {name}: they are not in the store any more"));
        }
        allowed.extend(state.environment.iter().map(|of| of.blob));
        Ok((ImportedSession { scene, state, left_out }, allowed))
    }
}
