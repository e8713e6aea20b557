//! Stored views, tours and frames at given times, for programs without tokio.

use polyptych_protocol::follow::Follow;
use polyptych_protocol::stored_view::StoredView;
use polyptych_protocol::tour_status::TourStatus;
use polyptych_wall::camera::Camera;
use polyptych_wall::tour::Tour;

use super::{Client, wait};
use crate::error::ClientError;
use crate::image::Capture;

impl Client {
    /// Blocking version of [`crate::Client::store_view`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn store_view(
        &self,
        name: impl Into<String>,
        camera: Option<Camera>,
    ) -> Result<(), ClientError> {
        wait(self.inner.store_view(name, camera))
    }

    /// Blocking version of [`crate::Client::remove_view`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn remove_view(&self, name: impl Into<String>) -> Result<(), ClientError> {
        wait(self.inner.remove_view(name))
    }

    /// Blocking version of [`crate::Client::stored_views`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn stored_views(&self) -> Result<Vec<StoredView>, ClientError> {
        wait(self.inner.stored_views())
    }

    /// Blocking version of [`crate::Client::play_tour`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn play_tour(&self, tour: Tour) -> Result<(), ClientError> {
        wait(self.inner.play_tour(tour))
    }

    /// Blocking version of [`crate::Client::follow_node`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn follow_node(&self, follow: Follow) -> Result<(), ClientError> {
        wait(self.inner.follow_node(follow))
    }

    /// Blocking version of [`crate::Client::stop_tour`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn stop_tour(&self) -> Result<(), ClientError> {
        wait(self.inner.stop_tour())
    }

    /// Blocking version of [`crate::Client::tour`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn tour(&self) -> Result<TourStatus, ClientError> {
        wait(self.inner.tour())
    }

    /// Blocking version of [`crate::Client::capture_at`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn capture_at(&self, time_s: Option<f64>) -> Result<Capture, ClientError> {
        wait(self.inner.capture_at(time_s))
    }
}
