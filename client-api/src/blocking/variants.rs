//! Variants of the open scene, for programs without tokio.

use polyptych_protocol::feedback::Edited;
use polyptych_protocol::variant::VariantList;

use super::{Client, wait};
use crate::error::ClientError;

impl Client {
    /// Blocking version of [`crate::Client::set_variant`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn set_variant(&self, variant: Option<&str>) -> Result<Edited, ClientError> {
        wait(self.inner.set_variant(variant))
    }

    /// Blocking version of [`crate::Client::variants`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn variants(&self) -> Result<VariantList, ClientError> {
        wait(self.inner.variants())
    }
}
