//! Scenes and sessions that clients save, list and forget, beside the loop of the manager.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

use polyptych_core::{ClientRequest, EditedScene, SessionId};
use polyptych_files::blob::BlobStore;
use polyptych_protocol::ids::RequestId;
use polyptych_protocol::request::{Request, Response};

use super::EventLoop;
use super::querying::{Answered, Found};
use crate::entry_store::{EntryStore, StoreFile};
use crate::scene_folders;
use crate::state_file::kept_copy;
use crate::stored_scene::StoredScene;
use crate::stored_session::StoredSession;

/// The reason where nothing is kept.
pub(super) const NO_STORE: &str = "this wall keeps no state, so it keeps neither scenes nor \
                                   sessions; start its manager by `polyptych manager`, without \
                                   --afresh";

/// The scenes and sessions that clients keep on a wall whose state is kept.
#[derive(Clone)]
pub(super) struct Stores {
    pub scenes: Arc<dyn EntryStore<StoredScene>>,
    pub sessions: Arc<dyn EntryStore<StoredSession>>,
}

impl Stores {
    /// Returns the stores beside this state file.
    pub fn beside(state_file: &Path) -> Self {
        let file = Arc::new(StoreFile::new(store_path(state_file)));
        Self { scenes: Arc::clone(&file) as Arc<_>, sessions: file }
    }
}

/// The file of scenes and sessions beside a state file: another one for each, but the same for
/// copies that were kept of it.
fn store_path(state_file: &Path) -> PathBuf {
    let path = kept_copy::original(state_file);
    if path.extension().is_some_and(|extension| extension == "state") {
        path.with_extension("scenes")
    } else {
        path.with_added_extension("scenes")
    }
}

/// The content of the wall at the moment at which it was to be saved.
enum Kept {
    Nothing,
    Scene(Box<Option<EditedScene>>),
    Session(Box<StoredSession>),
}

impl EventLoop {
    /// Does what a client asks of the saved scenes and sessions.
    pub(super) fn ask_stores(&mut self, client: SessionId, id: RequestId, request: Request) {
        let job = ClientRequest { client, id };
        let Some(stores) = self.stores.clone() else {
            let refused = Answered::new(job, Err(NO_STORE.to_owned()));
            return self.handle_found(Found::Answer(refused));
        };
        let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
        let saved_at_s = since.map_or(0, |since| since.as_secs());
        let kept = match request {
            Request::SaveScene { .. } => Kept::Scene(Box::new(self.cluster.edited_scene())),
            Request::SaveSession { .. } => {
                let (wall, state) =
                    (self.options.wall.without_paths(), self.cluster.session_state());
                Kept::Session(Box::new(StoredSession { wall, state, saved_at_s }))
            }
            _ => Kept::Nothing,
        };
        let blobs = BlobStore::new(self.options.baker.store.join("blobs"));
        let turns = Arc::clone(&self.queries.store_turns);
        self.answer_beside(job, turns, move || act(&stores, &request, kept, (&blobs, saved_at_s)));
    }

    /// Lists what can be opened.
    pub(super) fn list_scene_files(&mut self, client: SessionId, id: RequestId) {
        let roots = self.options.scene_roots.clone();
        let job = ClientRequest { client, id };
        let turns = Arc::clone(&self.queries.folder_turns);
        self.answer_beside(job, turns, move || {
            Ok(Response::SceneFiles(scene_folders::list(&roots)))
        });
    }
}

fn act(
    Stores { scenes, sessions }: &Stores,
    request: &Request,
    kept: Kept,
    (blobs, saved_at_s): (&BlobStore, u64),
) -> Result<Response, String> {
    match (request, kept) {
        (Request::SaveScene { name }, Kept::Scene(scene)) => {
            let scene = (*scene).ok_or("no scene is open; open one first")?;
            scenes.save(name, &StoredScene::new(scene, blobs, saved_at_s)?)?;
        }
        (Request::SaveSession { name }, Kept::Session(session)) => sessions.save(name, &session)?,
        (Request::RemoveSavedScene { name }, _) => scenes.remove(name)?,
        (Request::RemoveSession { name }, _) => sessions.remove(name)?,
        (Request::ListSessions, _) => return sessions.list().map(Response::Sessions),
        _ => return scenes.list().map(Response::SavedScenes),
    }
    Ok(Response::Done)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_state_file_has_scenes_of_its_own() {
        for (state, scenes) in [
            ("/s/wall.state", "/s/wall.scenes"),
            ("/s/wall.state.old", "/s/wall.scenes"),
            ("/s/wall.state.old-2", "/s/wall.scenes"),
            ("/s/lab.left", "/s/lab.left.scenes"),
            ("/s/lab.right", "/s/lab.right.scenes"),
            ("/s/wall", "/s/wall.scenes"),
        ] {
            assert_eq!(store_path(Path::new(state)), Path::new(scenes));
        }
    }
}
