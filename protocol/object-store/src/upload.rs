//! Puts the blobs of a bake into a store: only those that are missing there, several at a time.

use futures_util::{StreamExt, stream};
use polyptych_files::blob::{BlobHash, BlobStore};

use crate::remote_store::RemoteStore;
use crate::store_fault::StoreFault;

/// Blobs that are on their way to a store at a time: a request takes tens of milliseconds, most of
/// which are spent waiting. With parts of 8 MiB they hold 128 MiB at most.
const UPLOADS_MAX: usize = 8;

/// The outcome of an upload.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Uploaded {
    /// Blobs that were sent.
    pub sent: u64,
    /// Their bytes.
    pub sent_bytes: u64,
    /// Blobs that the store had already, in their full size.
    pub present: u64,
}

impl Uploaded {
    /// Returns how many blobs were looked at.
    pub fn done(&self) -> u64 {
        self.sent + self.present
    }
}

/// Puts the blobs of a folder that a store lacks there, the last of the list after all others, so
/// that a manifest there has all that it names. Calls `tell` after each.
///
/// # Errors
/// [`StoreFault`] of the first blob that could not be sent; what was sent before stays there, and
/// another upload goes on from it.
pub async fn upload(
    store: &RemoteStore,
    from: &BlobStore,
    blobs: &[BlobHash],
    mut tell: impl FnMut(&Uploaded),
) -> Result<Uploaded, StoreFault> {
    let mut uploaded = Uploaded::default();
    let Some((last, others)) = blobs.split_last() else { return Ok(uploaded) };
    // A web server is sent whole blobs, each of which may be as large as the largest.
    let together = if store.is_web() { 1 } else { UPLOADS_MAX };
    let others = stream::iter(others).map(|hash| send(store, from, *hash));
    let mut all = others.buffer_unordered(together);
    let mut count = |bytes: Option<u64>| {
        match bytes {
            None => uploaded.present += 1,
            Some(bytes) => {
                uploaded.sent += 1;
                uploaded.sent_bytes += bytes;
            }
        }
        tell(&uploaded);
    };
    while let Some(sent) = all.next().await {
        count(sent?);
    }
    count(send(store, from, *last).await?);
    Ok(uploaded)
}

/// Sends a blob unless it is there; returns the bytes that were sent, or `None` if it was.
async fn send(
    store: &RemoteStore,
    from: &BlobStore,
    hash: BlobHash,
) -> Result<Option<u64>, StoreFault> {
    let bytes = std::fs::metadata(from.path_of(hash)).map_or(0, |file| file.len());
    if store.size_of(hash).await? == Some(bytes) {
        return Ok(None);
    }
    store.put(from, hash).await?;
    Ok(Some(bytes))
}
