//! Animations of the open scene, for programs without tokio.

use polyptych_protocol::clip::{ClipAction, ClipStatus};

use super::{Client, wait};
use crate::error::ClientError;

impl Client {
    /// Blocking version of [`crate::Client::change_clips`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn change_clips(&self, clip: Option<&str>, action: ClipAction) -> Result<(), ClientError> {
        wait(self.inner.change_clips(clip, action))
    }

    /// Blocking version of [`crate::Client::clips`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn clips(&self) -> Result<Vec<ClipStatus>, ClientError> {
        wait(self.inner.clips())
    }
}
