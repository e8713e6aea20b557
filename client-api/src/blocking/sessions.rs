//! Sessions, for programs without tokio.

use polyptych_protocol::saved_session::{OpenedSession, SavedSession};

use super::{Client, wait};
use crate::error::ClientError;

impl Client {
    /// Blocking version of [`crate::Client::save_session`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn save_session(&self, name: impl Into<String>) -> Result<(), ClientError> {
        wait(self.inner.save_session(name))
    }

    /// Blocking version of [`crate::Client::open_session`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn open_session(&self, name: impl Into<String>) -> Result<OpenedSession, ClientError> {
        wait(self.inner.open_session(name))
    }

    /// Blocking version of [`crate::Client::sessions`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn sessions(&self) -> Result<Vec<SavedSession>, ClientError> {
        wait(self.inner.sessions())
    }

    /// Blocking version of [`crate::Client::remove_session`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn remove_session(&self, name: impl Into<String>) -> Result<(), ClientError> {
        wait(self.inner.remove_session(name))
    }
}
