//! Fetches a blob from the manager. What came of a large one is kept on disk piece by piece, so
//! that a server that is killed, or loses its connection, asks for the rest only.

use std::io;
use std::sync::mpsc::sync_channel;

use bytes::{Bytes, BytesMut};
use polyptych_files::blob::{BlobHash, BlobHasher, BlobStore, CHUNK_BYTES_MAX, PartialBlob};

use crate::blob_sources::{BlobOrder, wait};
use crate::bulk::{BulkJob, PIECES_MAX};

/// Smallest blob whose beginning is kept: smaller ones are sent again in the time of a few files.
const RESUMED_BYTES_MIN: u64 = 4 * CHUNK_BYTES_MAX as u64;

/// Returns a blob, checked, and whether it could be put into its place of the cache; `None` if
/// that was not tried.
///
/// # Errors
/// The manager does not have it, it was damaged, or the preparation is not wanted any more.
pub(crate) fn fetch(
    cache: &BlobStore,
    hash: BlobHash,
    order: &BlobOrder<'_>,
) -> Result<(Bytes, Option<io::Result<()>>), String> {
    // A cache that can't be read has no beginnings.
    let begun = PartialBlob::open(cache, hash, false).unwrap_or_default();
    let had = begun.as_ref().map_or(0, |(_, bytes)| bytes.len());
    let mut transfer = Transfer::new(begun);
    // A server may have been killed behind the last byte of a blob of whole pieces: there is no
    // rest to ask for.
    if had > 0 && transfer.is_whole(hash) {
        return Ok(transfer.finish(cache, hash));
    }
    let (reason, is_wrong) = match transfer.run(cache, hash, order) {
        Ok(()) => return Ok(transfer.finish(cache, hash)),
        Err(Broken::Cancelled(reason)) => return Err(reason),
        Err(Broken::Missing(reason)) => (reason, false),
        Err(Broken::Wrong(reason)) => (reason, true),
    };
    if is_wrong {
        transfer.discard();
    }
    // Where nothing came, the blob may be shorter than a beginning that is damaged.
    let may_come_anew = had > 0 && (is_wrong || transfer.bytes.len() == had);
    if !may_come_anew {
        return Err(reason);
    }
    tracing::warn!(%hash, had, reason, "a blob is fetched anew, not from its beginning on");
    let mut anew = Transfer::new(None);
    match anew.run(cache, hash, order) {
        Ok(()) => {
            transfer.discard();
            Ok(anew.finish(cache, hash))
        }
        Err(Broken::Cancelled(reason) | Broken::Missing(reason)) => Err(reason),
        Err(Broken::Wrong(reason)) => {
            anew.discard();
            Err(reason)
        }
    }
}

/// Why a transfer did not give a blob.
enum Broken {
    /// The connection has ended, or the preparation is not wanted any more: what came stays.
    Cancelled(String),
    /// The manager can't give the rest, as its disk may fail for a while: what came stays.
    Missing(String),
    /// The bytes are not the blob.
    Wrong(String),
}

/// A blob as far as it has come.
struct Transfer {
    bytes: BytesMut,
    /// Of these bytes: they are hashed as they come, while they are near and more come.
    hasher: BlobHasher,
    partial: Option<PartialBlob>,
}

impl Transfer {
    fn new(begun: Option<(PartialBlob, Vec<u8>)>) -> Self {
        let (partial, bytes) = begun.unzip();
        let bytes = bytes.unwrap_or_default();
        let mut hasher = BlobHasher::default();
        hasher.update(&bytes);
        Self { bytes: bytes.as_slice().into(), hasher, partial }
    }

    /// Fetches what is missing, and checks the whole.
    fn run(
        &mut self,
        cache: &BlobStore,
        hash: BlobHash,
        order: &BlobOrder<'_>,
    ) -> Result<(), Broken> {
        let (pieces, fetched) = sync_channel(PIECES_MAX);
        let offset = self.bytes.len() as u64;
        let asked = order.bulk.blocking_send(BulkJob::Fetch { hash, offset, pieces });
        asked.map_err(|_| Broken::Cancelled("the bulk connection has ended".to_owned()))?;
        loop {
            // Pieces may come faster than a wait looks whether they are wanted.
            (order.check)().map_err(Broken::Cancelled)?;
            let piece = wait(&fetched, order).map_err(Broken::Cancelled)?;
            let ended = || Broken::Cancelled("the bulk connection has ended".to_owned());
            let piece = piece.ok_or_else(ended)?.map_err(Broken::Missing)?;
            if self.bytes.is_empty() && piece.total >= RESUMED_BYTES_MIN {
                // Without a file the transfer goes on, but not after its end. So it does beside
                // what another server has left there since this one asked from the beginning on.
                let opened = PartialBlob::open(cache, hash, true).unwrap_or_default();
                let empty = opened.filter(|(_, begun)| begun.is_empty());
                self.partial = empty.map(|(partial, _)| partial);
            }
            // All at once: growing would copy it again and again.
            self.bytes.reserve((piece.total as usize).saturating_sub(self.bytes.len()));
            self.bytes.extend_from_slice(&piece.bytes);
            self.hasher.update(&piece.bytes);
            if self.partial.as_mut().is_some_and(|file| file.append(&piece.bytes).is_err()) {
                // The disk is full, or was taken away.
                self.discard();
            }
            if self.bytes.len() as u64 >= piece.total {
                break;
            }
        }
        if self.is_whole(hash) {
            return Ok(());
        }
        let reason = format!("blob {hash} was damaged on its way or in the manager's store");
        Err(Broken::Wrong(reason))
    }

    /// Returns whether these bytes are the blob of this name.
    fn is_whole(&self, hash: BlobHash) -> bool {
        self.hasher.finish() == hash
    }

    /// Forgets what came.
    fn discard(&mut self) {
        if let Some(partial) = self.partial.take() {
            partial.discard();
        }
    }

    fn finish(self, cache: &BlobStore, hash: BlobHash) -> (Bytes, Option<io::Result<()>>) {
        let placed = self.partial.map(|partial| partial.place(cache, hash));
        (self.bytes.freeze(), placed)
    }
}

#[cfg(test)]
mod tests {
    use std::thread;

    use tokio::sync::mpsc;

    use super::*;
    use crate::bulk::Piece;

    #[test]
    fn a_beginning_that_is_the_whole_blob_is_taken_without_asking() {
        let root = tempfile::tempdir().expect("a folder");
        let cache = BlobStore::new(root.path());
        let whole = vec![5u8; 2 * CHUNK_BYTES_MAX];
        let hash = BlobHash::of(&whole);
        let opened = PartialBlob::open(&cache, hash, true).expect("opened");
        let (mut partial, _) = opened.expect("nobody else has it");
        partial.append(&whole).expect("kept");
        drop(partial);
        // Nobody answers there.
        let (bulk, jobs) = mpsc::channel(1);
        drop(jobs);
        let order = BlobOrder { bulk: &bulk, check: &|| Ok(()) };
        let (bytes, placed) = fetch(&cache, hash, &order).expect("it is here");
        assert_eq!(bytes, whole);
        placed.expect("tried").expect("placed");
        assert_eq!(cache.read(hash).expect("read").as_deref(), Some(&whole[..]));
    }

    #[test]
    fn a_beginning_stays_where_the_manager_cannot_read_the_rest() {
        let root = tempfile::tempdir().expect("a folder");
        let cache = BlobStore::new(root.path());
        let hash = BlobHash::of(b"a blob of eight pieces");
        let (bulk, mut jobs) = mpsc::channel(1);
        let answer = move || {
            let mut offsets = Vec::new();
            while let Some(BulkJob::Fetch { offset, pieces, .. }) = jobs.blocking_recv() {
                let count = if offsets.is_empty() { 5 } else { 0 };
                for _ in 0..count {
                    let bytes = Bytes::from(vec![5_u8; CHUNK_BYTES_MAX]);
                    let piece = Piece { total: 8 * CHUNK_BYTES_MAX as u64, bytes };
                    pieces.send(Ok(piece)).expect("waited for");
                }
                pieces.send(Err("the disk fails".to_owned())).expect("waited for");
                offsets.push(offset);
            }
            offsets
        };
        let manager = thread::Builder::new().name("manager".into()).spawn(answer);
        let order = BlobOrder { bulk: &bulk, check: &|| Ok(()) };
        for _ in 0..2 {
            let fetched = fetch(&cache, hash, &order);
            assert_eq!(fetched.expect_err("it fails"), "the disk fails");
            let begun = PartialBlob::open(&cache, hash, false).expect("opened");
            assert_eq!(begun.expect("it is there").1.len(), 5 * CHUNK_BYTES_MAX);
        }
        drop(bulk);
        let offsets = manager.expect("a thread").join().expect("no panic");
        assert_eq!(offsets, [0, 5 * CHUNK_BYTES_MAX as u64, 0]);
    }
}
