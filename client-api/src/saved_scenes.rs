//! Scenes that the manager has: files, and scenes as they were edited under names.

use polyptych_protocol::request::{Request, Response};
use polyptych_protocol::saved_scene::SavedScene;
use polyptych_protocol::scene_file_list::SceneFileList;

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

    /// Returns the scene files in the manager's scene folders, by path.
    ///
    /// # Errors
    /// [`ClientError`].
    pub async fn scene_files(&self) -> Result<SceneFileList, ClientError> {
        match self.request(Request::ListSceneFiles).await? {
            Response::SceneFiles(list) => Ok(list),
            other => Err(wrong_answer("list the scene files", &other)),
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
