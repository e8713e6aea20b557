//! Tunings of the running wall, for programs without tokio.

use polyptych_protocol::tuned_channel::TunedChannel;

use super::{Client, wait};
use crate::error::ClientError;

impl Client {
    /// Blocking version of [`crate::Client::tunings`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn tunings(&self) -> Result<Vec<TunedChannel>, ClientError> {
        wait(self.inner.tunings())
    }
}
