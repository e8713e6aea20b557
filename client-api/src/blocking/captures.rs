//! Pictures of the wall, for programs without tokio.

use super::{Client, wait};
use crate::error::ClientError;
use crate::image::Capture;

impl Client {
    /// Blocking version of [`crate::Client::preview`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn preview(&self, width: u32) -> Result<Capture, ClientError> {
        wait(self.inner.preview(width))
    }
}
