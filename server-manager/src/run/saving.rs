//! Scenes that clients save, list and forget, beside the loop of the manager.

use std::sync::Arc;
use std::time::SystemTime;

use polyptych_core::{ClientRequest, SessionId};
use polyptych_protocol::ids::RequestId;
use polyptych_protocol::request::{Request, Response};

use super::EventLoop;
use super::querying::{Answered, Found};
use crate::scene_store::{SceneStore, StoredScene};

/// The reason where there is no store of scenes.
pub(super) const NO_STORE: &str =
    "this wall keeps no state, so it keeps no scenes; start its manager with `polyptych manager`";

impl EventLoop {
    /// Does what a client asks of the saved scenes.
    pub(super) fn ask_saved_scenes(&mut self, client: SessionId, id: RequestId, request: Request) {
        let job = ClientRequest { client, id };
        let Some(store) = self.scene_store.clone() else {
            let refused = Answered::new(job, Err(NO_STORE.to_owned()));
            return self.handle_found(Found::Answer(refused));
        };
        let scene = match request {
            Request::SaveScene { .. } => self.cluster.edited_scene().map(|scene| {
                let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
                StoredScene { scene, saved_at_s: since.map_or(0, |since| since.as_secs()) }
            }),
            _ => None,
        };
        self.answer_beside(job, move || act(&*store, &request, scene.as_ref()));
    }
}

fn act(
    store: &dyn SceneStore,
    request: &Request,
    scene: Option<&StoredScene>,
) -> Result<Response, String> {
    match request {
        Request::SaveScene { name } => {
            let scene = scene.ok_or("no scene is open; open one first")?;
            store.save(name, scene).map(|()| Response::Done)
        }
        Request::RemoveSavedScene { name } => store.remove(name).map(|()| Response::Done),
        _ => store.list().map(Response::SavedScenes),
    }
}

/// The saved scenes of a wall whose state is kept.
pub(super) type SharedStore = Arc<dyn SceneStore>;
