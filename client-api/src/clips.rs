//! Animations of the open scene.

use polyptych_protocol::clip::{ClipAction, ClipChange, ClipStatus};
use polyptych_protocol::request::{Request, Response};

use crate::client::Client;
use crate::error::{ClientError, wrong_answer};

impl Client {
    /// Changes how an animation is played, by its name or its number from 0 on, or how all are that
    /// move something. All channels show it from one frame on; the manager goes on with it after a
    /// restart.
    ///
    /// Animations are functions of scene time: a wall that is paused does not move by itself. Let
    /// it run ([`Client::start_rendering`]), or ask for each frame, with times of your own
    /// ([`Client::capture_at`]) for a film.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Failed`] names the animations that there are, or the number
    /// that cannot be.
    pub async fn change_clips(
        &self,
        clip: Option<&str>,
        action: ClipAction,
    ) -> Result<(), ClientError> {
        let change = ClipChange { clip: clip.map(str::to_owned), action };
        self.done("play the animation", Request::ChangeClips(change)).await
    }

    /// Returns the animations of the open scene, in the order of their numbers.
    ///
    /// # Errors
    /// [`ClientError`].
    pub async fn clips(&self) -> Result<Vec<ClipStatus>, ClientError> {
        match self.request(Request::ListClips).await? {
            Response::Clips(clips) => Ok(clips),
            other => Err(wrong_answer("list the animations", &other)),
        }
    }
}
