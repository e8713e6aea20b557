//! Sessions: all that a wall shows, which the manager keeps under names.

use polyptych_protocol::request::{Request, Response};
use polyptych_protocol::saved_session::{OpenedSession, SavedSession};

use crate::client::Client;
use crate::error::{ClientError, wrong_answer};

impl Client {
    /// Keeps all that the wall shows and how it shows it, in the place of what had that name: the
    /// scene with all that was changed of it, camera, head, views, stored views, tour, light,
    /// surroundings, bounds, modes and pace. Returns once it is on the manager's disk.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Failed`] where it cannot be kept.
    pub async fn save_session(&self, name: impl Into<String>) -> Result<(), ClientError> {
        self.done("save the session", Request::SaveSession { name: name.into() }).await
    }

    /// Shows a saved session in the place of all that is shown, stored views too. Returns once
    /// every live channel can draw it, with the parts that do not fit this wall any more.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Failed`] names the sessions that there are. Then the wall
    /// shows what it showed before.
    pub async fn open_session(
        &self,
        name: impl Into<String>,
    ) -> Result<OpenedSession, ClientError> {
        match self.request(Request::OpenSession { name: name.into() }).await? {
            Response::SessionOpened(opened) => Ok(*opened),
            other => Err(wrong_answer("open the session", &other)),
        }
    }

    /// Returns the saved sessions, by name.
    ///
    /// # Errors
    /// [`ClientError`].
    pub async fn sessions(&self) -> Result<Vec<SavedSession>, ClientError> {
        match self.request(Request::ListSessions).await? {
            Response::Sessions(sessions) => Ok(sessions),
            other => Err(wrong_answer("list the sessions", &other)),
        }
    }

    /// Forgets a saved session.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Failed`] names those that there are.
    pub async fn remove_session(&self, name: impl Into<String>) -> Result<(), ClientError> {
        self.done("remove the session", Request::RemoveSession { name: name.into() }).await
    }
}
