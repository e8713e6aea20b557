//! An upload of one blob in parts, which is completed or given up: stores keep the parts of one
//! that is neither, and ask money for them.

use std::time::Duration;

use object_store::{Error as StoreError, MultipartUpload, PutPayload, Result};
use tokio::task::JoinSet;
use tokio::time::timeout;

/// Parts of one blob that are on their way at a time.
const PARTS_MAX: usize = 2;

/// Longest time in which a store may answer that it has dropped the parts of an upload.
const ABORT_TIME_MAX: Duration = Duration::from_secs(5);

/// An upload in parts.
#[derive(Debug)]
pub(crate) struct PartUpload {
    upload: Box<dyn MultipartUpload>,
    /// The parts that are on their way.
    sending: JoinSet<Result<()>>,
}

impl PartUpload {
    /// An upload that was begun, of which no part was sent.
    pub fn new(upload: Box<dyn MultipartUpload>) -> Self {
        Self { upload, sending: JoinSet::new() }
    }

    /// Sends the next part, once there is room for it on the way.
    ///
    /// # Errors
    /// A part that was sent before was not taken.
    pub async fn send(&mut self, part: PutPayload) -> Result<()> {
        while self.sending.len() >= PARTS_MAX {
            self.await_part().await?;
        }
        self.sending.spawn(self.upload.put_part(part));
        Ok(())
    }

    /// Makes an object of all parts.
    ///
    /// # Errors
    /// A part was not taken, or the object was not made.
    pub async fn complete(&mut self) -> Result<()> {
        while !self.sending.is_empty() {
            self.await_part().await?;
        }
        self.upload.complete().await.map(drop)
    }

    async fn await_part(&mut self) -> Result<()> {
        match self.sending.join_next().await {
            None => Ok(()),
            Some(Ok(sent)) => sent,
            Some(Err(source)) => Err(StoreError::JoinError { source }),
        }
    }

    /// Ends the upload without an object, and lets the store drop its parts. A store that does not
    /// answer any more keeps them.
    pub async fn abort(mut self) {
        self.sending.shutdown().await;
        let _ = timeout(ABORT_TIME_MAX, self.upload.abort()).await;
    }
}
