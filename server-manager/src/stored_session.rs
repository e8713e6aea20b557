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
    const TABLE: &'static str = "sessions.2";
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

#[cfg(test)]
mod tests {
    use polyptych_protocol::environment::Environment;
    use polyptych_protocol::state_log::SceneRef;
    use polyptych_wall::camera::Camera;
    use polyptych_wall::view::{Area, View};

    use super::*;

    fn wall(screen: &str) -> Wall {
        let text = format!(
            "[wall]\nname = \"w\"\n[[screen]]\nname = \"{screen}\"\nsize = [2.0, 1.0]\n\
             center = [0.0, 0.0, -2.0]\n[screen.tiles]\ncolumns = 1\nrows = 1\n\
             pixels = [100, 50]\n"
        );
        polyptych_wall_file::parse(&text, "w.toml".as_ref()).expect("a wall")
    }

    fn session() -> StoredSession {
        let wall = wall("front");
        let mut state = PersistentState::of_wall(&wall);
        let area = Area::Screen { screen: 0, rect: [0, 0, 50, 50] };
        state.presentation.views = vec![View { area, ..View::of_wall(Camera::IDENTITY) }];
        StoredSession { wall: wall.without_paths(), state, saved_at_s: 7 }
    }

    #[test]
    fn what_does_not_fit_the_wall_any_more_is_left_out_and_said() {
        let folder = tempfile::tempdir().expect("a folder");
        let blobs = BlobStore::new(folder.path());
        let (same, allowed) = session().read("show", &wall("front"), &blobs).expect("read");
        assert_eq!((&same.left_out, allowed.len()), (&Vec::new(), 0));
        assert_eq!(same.state.presentation.views.len(), 1);
        // A screen of the same form is the same, whatever its name.
        let (renamed, _) = session().read("show", &wall("face"), &blobs).expect("read");
        assert_eq!(renamed.state.presentation.views.len(), 1);
        let mut narrow = wall("side");
        narrow.screens[0].canvas.x = 40;
        let mut lit = session();
        let environment = Environment { name: "sky".into(), blob: BlobHash([7; 32]) };
        lit.state.environment = Some(environment);
        let (less, _) = lit.read("show", &narrow, &blobs).expect("read");
        assert!(less.state.presentation.views.is_empty() && less.state.environment.is_none());
        let [view, sky] = &less.left_out[..] else { panic!("{:?}", less.left_out) };
        assert!(view.starts_with("view 1: ") && sky.contains("surroundings sky"), "{view} {sky}");
    }

    #[test]
    fn a_session_whose_scene_is_gone_is_refused_by_name() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut gone = session();
        gone.state.scene = Some(SceneRef { name: "town".into(), manifest: BlobHash([1; 32]) });
        assert_eq!(gone.summary("show").scene.as_deref(), Some("town"));
        let read = gone.read("show", &wall("front"), &BlobStore::new(folder.path()));
        let reason = read.expect_err("gone");
        assert!(reason.starts_with("the session show is not whole any more: "), "{reason}");
    }
}
