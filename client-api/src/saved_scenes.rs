//! Scenes as they were edited, which the manager keeps under names.

use polyptych_protocol::request::{Request, Response};
use polyptych_protocol::saved_scene::SavedScene;

use crate::client::Client;
use crate::error::{ClientError, wrong_answer};

impl Client {
    /// Keeps the open scene with all that was changed of it, in the place of what had that name.
    /// [`Client::open_scene`] with `saved:NAME` opens it. Returns once it is on the manager's disk.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Failed`] where none is open, or it cannot be kept.
    pub async fn save_scene(&self, name: impl Into<String>) -> Result<(), ClientError> {
        self.done("save the scene", Request::SaveScene { name: name.into() }).await
    }

    /// Returns the scenes that were saved, by name.
    ///
    /// # Errors
    /// [`ClientError`].
    pub async fn saved_scenes(&self) -> Result<Vec<SavedScene>, ClientError> {
        match self.request(Request::ListSavedScenes).await? {
            Response::SavedScenes(scenes) => Ok(scenes),
            other => Err(wrong_answer("list the saved scenes", &other)),
        }
    }

    /// Forgets a scene that was saved.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Failed`] names those that there are.
    pub async fn remove_saved_scene(&self, name: impl Into<String>) -> Result<(), ClientError> {
        let request = Request::RemoveSavedScene { name: name.into() };
        self.done("remove the saved scene", request).await
    }
}
