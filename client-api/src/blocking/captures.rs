//! Frames of the wall that move nothing, and its pictures, for programs without tokio.

use polyptych_protocol::feedback::FrameFeedback;
use polyptych_wall::camera::Camera;

use super::{Client, wait};
use crate::error::ClientError;
use crate::image::Capture;

impl Client {
    /// Blocking version of [`crate::Client::redraw`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn redraw(&self, camera: Option<Camera>) -> Result<FrameFeedback, ClientError> {
        wait(self.inner.redraw(camera))
    }

    /// Blocking version of [`crate::Client::preview`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn preview(&self, width: u32) -> Result<Capture, ClientError> {
        wait(self.inner.preview(width))
    }
}
