//! Variants of the open scene.

use polyptych_protocol::feedback::Edited;
use polyptych_protocol::request::{Request, Response};
use polyptych_protocol::transaction::Transaction;
use polyptych_protocol::variant::VariantList;

use crate::client::Client;
use crate::error::{ClientError, wrong_answer};

impl Client {
    /// Shows a variant of the open scene, by its name or its number from 0 on, `None` for the
    /// materials that its parts have without one; returns once a frame shows it. All channels show
    /// it from one frame on. It is an edit of the scene: servers that join show it, and so do a
    /// restarted manager and scenes that are saved.
    ///
    /// # Errors
    /// [`ClientError`]; [`ClientError::Failed`] names the variants that there are.
    pub async fn set_variant(&self, variant: Option<&str>) -> Result<Edited, ClientError> {
        let mut transaction = Transaction::default();
        transaction.set_variant(variant);
        self.commit(transaction).await
    }

    /// Returns the variants of the open scene.
    ///
    /// # Errors
    /// [`ClientError`].
    pub async fn variants(&self) -> Result<VariantList, ClientError> {
        match self.request(Request::ListVariants).await? {
            Response::Variants(variants) => Ok(variants),
            other => Err(wrong_answer("list the variants", &other)),
        }
    }
}
