//! Display settings beside the scene, for programs without tokio.

use polyptych_protocol::calibration_marker::CalibrationMarker;
use polyptych_protocol::screen_rest::RestRules;

use super::{Client, wait};
use crate::error::ClientError;

impl Client {
    /// Blocking version of [`crate::Client::mark_point`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn mark_point(&self, marker: Option<CalibrationMarker>) -> Result<(), ClientError> {
        wait(self.inner.mark_point(marker))
    }

    /// Blocking version of [`crate::Client::set_rest`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn set_rest(&self, rules: RestRules) -> Result<(), ClientError> {
        wait(self.inner.set_rest(rules))
    }
}
