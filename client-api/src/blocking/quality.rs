//! Exposure, and the bounds of error and rate, for those who wait.

use polyptych_protocol::quality_bounds::QualityBounds;

use super::{Client, wait};
use crate::error::ClientError;

impl Client {
    /// Blocking version of [`crate::Client::set_exposure`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn set_exposure(&self, exposure: f32) -> Result<(), ClientError> {
        wait(self.inner.set_exposure(exposure))
    }

    /// Blocking version of [`crate::Client::set_bounds`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn set_bounds(&self, bounds: QualityBounds) -> Result<(), ClientError> {
        wait(self.inner.set_bounds(bounds))
    }
}
