//! Tunings of the running wall.

use polyptych_protocol::request::{Request, Response};
use polyptych_protocol::tuned_channel::TunedChannel;

use crate::client::Client;
use crate::error::{ClientError, wrong_answer};

impl Client {
    /// Returns the keys of channels that were tuned since the manager loaded the wall file.
    ///
    /// # Errors
    /// [`ClientError`].
    pub async fn tunings(&self) -> Result<Vec<TunedChannel>, ClientError> {
        match self.request(Request::ListTunings).await? {
            Response::Tunings(tunings) => Ok(tunings),
            other => Err(wrong_answer("list the tunings", &other)),
        }
    }
}
