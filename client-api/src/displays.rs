//! Display settings beside the scene: the point that is aligned, and the hours of rest.

use polyptych_protocol::calibration_marker::CalibrationMarker;
use polyptych_protocol::request::Request;
use polyptych_protocol::screen_rest::RestRules;

use crate::client::Client;
use crate::error::ClientError;

impl Client {
    /// Lights a point of a channel over its test pattern, where its calibration has it; `None`:
    /// no point. A paused wall draws a frame for it.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Failed`] names what there is instead.
    pub async fn mark_point(&self, marker: Option<CalibrationMarker>) -> Result<(), ClientError> {
        self.done("mark the point", Request::MarkPoint(marker)).await
    }

    /// Sets the rules by which displays go dark by themselves. The manager keeps them, and no
    /// client has to be there. Requests that change what the wall shows light it again.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Failed`] names the number that cannot be.
    pub async fn set_rest(&self, rules: RestRules) -> Result<(), ClientError> {
        self.done("set the rest of the displays", Request::SetRest(rules)).await
    }
}
