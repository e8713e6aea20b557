//! Saved scenes, for programs without tokio.

use polyptych_protocol::saved_scene::SavedScene;
use polyptych_protocol::scene_file_list::SceneFileList;

use super::{Client, wait};
use crate::error::ClientError;

impl Client {
    /// Blocking version of [`crate::Client::save_scene`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn save_scene(&self, name: impl Into<String>) -> Result<(), ClientError> {
        wait(self.inner.save_scene(name))
    }

    /// Blocking version of [`crate::Client::saved_scenes`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn saved_scenes(&self) -> Result<Vec<SavedScene>, ClientError> {
        wait(self.inner.saved_scenes())
    }

    /// Blocking version of [`crate::Client::scene_files`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn scene_files(&self) -> Result<SceneFileList, ClientError> {
        wait(self.inner.scene_files())
    }

    /// Blocking version of [`crate::Client::remove_saved_scene`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn remove_saved_scene(&self, name: impl Into<String>) -> Result<(), ClientError> {
        wait(self.inner.remove_saved_scene(name))
    }
}
