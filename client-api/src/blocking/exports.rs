//! Scenes as files, for programs without tokio.

use std::io::Write;

use polyptych_protocol::exported_scene::ExportedScene;
use polyptych_protocol::progress::OpenProgress;

use super::{Client, wait};
use crate::error::ClientError;

impl Client {
    /// Blocking version of [`crate::Client::export_scene`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn export_scene(
        &self,
        saved: Option<&str>,
        to: &mut (impl Write + ?Sized),
    ) -> Result<ExportedScene, ClientError> {
        wait(self.inner.export_scene(saved, to))
    }

    /// Blocking version of [`crate::Client::export_scene_with`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn export_scene_with(
        &self,
        saved: Option<&str>,
        to: &mut (impl Write + ?Sized),
        on_progress: impl FnMut(OpenProgress),
    ) -> Result<ExportedScene, ClientError> {
        wait(self.inner.export_scene_with(saved, to, on_progress))
    }
}
