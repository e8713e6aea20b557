//! The places where a server finds blobs: this machine's cache, the wall's folders, its object
//! stores in their order, and the manager.
//!
//! Hashes are checked wherever the bytes come from, and what came over the network goes into the
//! cache. Stores are asked on a thread of their own, several blobs at a time; the loader waits for
//! them as long as its preparation is wanted.

use std::collections::VecDeque;
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::Duration;

use bytes::Bytes;
use polyptych_files::blob::{Abandoned, BLOB_BYTES_MAX, BlobHash, BlobStore, StoreUrl};
use polyptych_object_store::RemoteStore;
use polyptych_protocol::server_message::ServerMessage;
use tokio::runtime::Runtime;
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use tracing::Instrument;

use crate::bulk::BulkJob;
use crate::manager_fetch;
use crate::watched_store::{Fetched, WatchedStore};

/// Bytes of blobs that are kept on disk when a server starts: several large scenes.
const CACHE_BYTES_MAX: u64 = 16 << 30;

/// The period in which a preparation that waits for a blob looks whether it is still wanted.
const CHECK_PERIOD: Duration = Duration::from_millis(50);

/// Blobs that are fetched from stores at a time: most of a request's time is spent waiting.
const FETCHES_MAX: usize = 16;

/// Largest blob that is fetched before its turn; with [`FETCHES_MAX`] it bounds the memory.
const FETCH_AHEAD_BYTES_MAX: u64 = 16 << 20;

/// A preparation that wants blobs.
pub(crate) struct BlobOrder<'a> {
    /// The connection to the manager.
    pub bulk: &'a mpsc::Sender<BulkJob>,
    /// Fails if the preparation is not wanted any more.
    pub check: &'a dyn Fn() -> Result<(), String>,
}

/// All places of blobs, as the wall names them.
#[derive(Debug)]
pub(crate) struct BlobSources {
    cache: BlobStore,
    /// `true` if the cache's last write failed: said once, not for each of ten thousand blobs.
    is_cacheless: AtomicBool,
    /// The wall's list, from which the following were made.
    named: Vec<String>,
    folders: Vec<BlobStore>,
    stores: Arc<[WatchedStore]>,
    /// The thread on which stores are asked, if there are any.
    runtime: Option<Runtime>,
    /// The warning of the budget of memory, for the operator.
    memory_warning: Option<String>,
    /// The last warning that the manager was told.
    told: Option<String>,
}

/// Ranges of a blob in bytes; `None` for all of it as one.
pub(crate) type BlobParts = Option<Vec<Range<u64>>>;

/// A fetch from stores that is under way; dropping it ends it.
struct Fetch {
    fetched: Receiver<Fetched>,
    task: JoinHandle<()>,
}

impl Drop for Fetch {
    fn drop(&mut self) {
        self.task.abort();
    }
}

impl BlobSources {
    /// A cache alone.
    pub fn new(cache: BlobStore) -> Self {
        Self {
            cache,
            is_cacheless: AtomicBool::new(false),
            named: Vec::new(),
            folders: Vec::new(),
            stores: Arc::new([]),
            runtime: None,
            memory_warning: None,
            told: None,
        }
    }

    /// Removes what killed processes left in the cache, and what is too much of it.
    pub fn clean_cache(&self) {
        let cache = self.cache.root().display();
        let Abandoned { files, bytes } = self.cache.remove_old_partials();
        if files > 0 {
            tracing::info!(%cache, files, bytes, "old beginnings of blobs were removed");
        }
        let Abandoned { files, bytes } = self.cache.remove_abandoned();
        if files > 0 {
            tracing::info!(%cache, files, bytes, "files of killed processes were removed");
        }
        match self.cache.evict(CACHE_BYTES_MAX) {
            Ok(0) => {}
            Ok(removed) => tracing::info!(removed, "old blobs were removed from the cache"),
            Err(error) => tracing::warn!(%error, "the cache can't be read"),
        }
    }

    /// Takes a wall's list of folders and URLs.
    pub fn set_stores(&mut self, named: &[String]) {
        if self.named == named {
            return;
        }
        self.named = named.to_vec();
        self.folders.clear();
        let mut stores = Vec::new();
        for name in named {
            match StoreUrl::from_text(name) {
                Ok(None) => self.folders.push(BlobStore::foreign(name.as_str())),
                Ok(Some(url)) => match RemoteStore::open(url) {
                    Ok(store) => stores.push(WatchedStore::of(store)),
                    Err(fault) => stores.push(WatchedStore::unusable(&fault.to_string())),
                },
                // The manager checks wall files; this one comes from another version of it.
                Err(error) => stores.push(WatchedStore::unusable(&error.to_string())),
            }
        }
        if !stores.is_empty() && self.runtime.is_none() {
            let runtime = tokio::runtime::Builder::new_multi_thread()
                .worker_threads(1)
                .thread_name("stores")
                .enable_all()
                .build();
            let failed = |error| tracing::warn!(%error, "object stores can't be asked");
            self.runtime = runtime.map_err(failed).ok();
        }
        self.stores = stores.into();
    }

    /// Sets what the operator should know of the budget of memory.
    pub fn set_memory_warning(&mut self, warning: Option<String>) {
        self.memory_warning = warning;
    }

    /// Returns what the manager is to be told of stores and memory, if that is another sentence
    /// than before or it may have gone over a connection that has ended.
    pub fn news(&mut self) -> Option<ServerMessage> {
        let stores = self.stores.iter().filter_map(WatchedStore::tell_warning);
        let warnings: Vec<String> = stores.chain(self.memory_warning.clone()).collect();
        let warning = (!warnings.is_empty()).then(|| warnings.join("; "));
        let before = std::mem::replace(&mut self.told, warning.clone());
        (warning.is_some() || before.is_some()).then_some(ServerMessage::Storage { warning })
    }

    /// Gives parts of each of these blobs in order, while the following ones are fetched from
    /// stores, into at most half of so many bytes if that is more than one.
    ///
    /// # Errors
    /// A blob is nowhere, the preparation is not wanted any more, or `deliver` says so.
    pub fn each<T>(
        &self,
        wanted: impl IntoIterator<Item = (BlobHash, BlobParts, T)>,
        (order, host_bytes): (&BlobOrder<'_>, Option<u64>),
        mut deliver: impl FnMut(T, Vec<Bytes>) -> Result<(), String>,
    ) -> Result<(), String> {
        let mut wanted = wanted.into_iter();
        let mut ahead = VecDeque::new();
        let fetches = host_bytes.map_or(FETCHES_MAX, |bytes| {
            FETCHES_MAX.min((bytes / 2 / FETCH_AHEAD_BYTES_MAX).max(1) as usize)
        });
        loop {
            while ahead.len() < fetches
                && let Some((hash, parts, of)) = wanted.next()
            {
                ahead.push_back((hash, parts, of, self.fetch(hash, FETCH_AHEAD_BYTES_MAX)));
            }
            let Some((hash, parts, of, fetch)) = ahead.pop_front() else { return Ok(()) };
            // Blobs of this machine wait for nothing, so they are looked at here.
            (order.check)()?;
            let fetched = fetch.map(|fetch| wait(&fetch.fetched, order)).transpose()?.flatten();
            let fetched = fetched.unwrap_or(Fetched::Nowhere);
            let bytes = match fetched {
                Fetched::Blob(bytes) => self.keep(bytes),
                Fetched::TooLarge => self.blob(hash, order)?,
                Fetched::Nowhere => {
                    if let Some(stored) = parts.as_ref().and_then(|of| self.stored_parts(hash, of))
                    {
                        deliver(of, stored)?;
                        continue;
                    }
                    match self.stored(hash) {
                        Some(bytes) => bytes,
                        None => self.ask_manager(hash, order)?,
                    }
                }
            };
            deliver(of, cut(bytes, parts)?)?;
        }
    }

    /// Returns a blob from the first place that has it.
    ///
    /// # Errors
    /// It is nowhere, or the preparation is not wanted any more.
    pub fn blob(&self, hash: BlobHash, order: &BlobOrder<'_>) -> Result<Bytes, String> {
        (order.check)()?;
        if let Some(bytes) = self.stored(hash) {
            return Ok(bytes);
        }
        let fetched = self.fetch(hash, BLOB_BYTES_MAX).map(|fetch| wait(&fetch.fetched, order));
        match fetched.transpose()?.flatten() {
            Some(Fetched::Blob(bytes)) => Ok(self.keep(bytes)),
            _ => self.ask_manager(hash, order),
        }
    }

    /// The blob from the cache or a folder.
    fn stored(&self, hash: BlobHash) -> Option<Bytes> {
        for folder in std::iter::once(&self.cache).chain(&self.folders) {
            match folder.read(hash) {
                Ok(Some(bytes)) => return Some(bytes),
                Ok(None) => {}
                // Another place may have it whole.
                Err(error) if self.is_cacheless.load(Ordering::Relaxed) => {
                    tracing::debug!(%error, "a stored blob is of no use");
                }
                Err(error) => tracing::warn!(%error, "a stored blob is of no use"),
            }
        }
        None
    }

    /// Parts of a blob from the cache or a folder. All of it is read and checked, and no more than
    /// the parts and one piece is held.
    fn stored_parts(&self, hash: BlobHash, parts: &[Range<u64>]) -> Option<Vec<Bytes>> {
        let read = |folder: &BlobStore| {
            let mut reader = folder.open(hash).ok()??;
            // A description may lie: a part may begin behind the blob's end.
            let length =
                |of: &Range<u64>| of.end.min(reader.total()).saturating_sub(of.start) as usize;
            let mut read: Vec<Vec<u8>> =
                parts.iter().map(|of| Vec::with_capacity(length(of))).collect();
            while let Some((first, piece)) = reader.next_piece().ok()? {
                for (to, of) in read.iter_mut().zip(parts) {
                    let end = first + piece.len() as u64;
                    let [from, to_end] = [of.start, of.end].map(|at| at.clamp(first, end) - first);
                    to.extend_from_slice(piece.get(from as usize..to_end as usize)?);
                }
            }
            let is_whole =
                read.iter().zip(parts).all(|(to, of)| of.start + to.len() as u64 == of.end);
            is_whole.then(|| read.into_iter().map(Bytes::from).collect())
        };
        std::iter::once(&self.cache).chain(&self.folders).find_map(read)
    }

    /// Begins to fetch a blob from stores, unless no store works or a file of its name is here.
    fn fetch(&self, hash: BlobHash, bytes_max: u64) -> Option<Fetch> {
        let runtime = self.runtime.as_ref()?;
        let is_here = || self.cache.contains(hash) || self.folders.iter().any(|f| f.contains(hash));
        if !self.stores.iter().any(WatchedStore::is_usable) || is_here() {
            return None;
        }
        let stores = Arc::clone(&self.stores);
        let (answer, fetched) = sync_channel(1);
        let fetch = async move {
            let mut found = Fetched::Nowhere;
            for store in &*stores {
                found = store.fetch(hash, bytes_max).await;
                if !matches!(found, Fetched::Nowhere) {
                    break;
                }
            }
            // Whoever asked may have been told to stop meanwhile.
            let _ = answer.send(found);
        };
        Some(Fetch { fetched, task: runtime.spawn(fetch.in_current_span()) })
    }

    /// Asks the manager, which has all blobs of a wall and its scenes.
    fn ask_manager(&self, hash: BlobHash, order: &BlobOrder<'_>) -> Result<Bytes, String> {
        let (bytes, placed) = manager_fetch::fetch(&self.cache, hash, order)?;
        if let Some(placed) = placed {
            self.note_cache(&placed);
            return Ok(bytes);
        }
        Ok(self.keep(bytes))
    }

    /// Puts a blob that came over the network into the cache.
    fn keep(&self, bytes: Bytes) -> Bytes {
        self.note_cache(&self.cache.write(&bytes));
        bytes
    }

    fn note_cache<T, E: std::fmt::Display>(&self, written: &Result<T, E>) {
        let was_cacheless = self.is_cacheless.swap(written.is_err(), Ordering::Relaxed);
        if let Err(error) = written
            && !was_cacheless
        {
            tracing::warn!(%error, "the cache can't be written; going on without it");
        }
    }
}

impl Drop for BlobSources {
    fn drop(&mut self) {
        // A process that ends does not wait for a store.
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}

/// The parts of a whole blob. Of a blob of which some is left over they are copies, so that no more
/// than they are held.
///
/// # Errors
/// It ends before one of them.
fn cut(bytes: Bytes, parts: BlobParts) -> Result<Vec<Bytes>, String> {
    let Some(parts) = parts else { return Ok(vec![bytes]) };
    let length = bytes.len() as u64;
    if let Some(part) = parts.iter().find(|of| of.start > of.end || of.end > length) {
        return Err(format!("a blob has {length} bytes, where {} are described", part.end));
    }
    let is_all = parts.iter().map(|of| of.end - of.start).sum::<u64>() >= length;
    let part = |of: &Range<u64>| {
        let part = bytes.slice(of.start as usize..of.end as usize);
        if is_all { part } else { Bytes::copy_from_slice(&part) }
    };
    Ok(parts.iter().map(part).collect())
}

/// Waits for an answer as long as the preparation is wanted; `None` if none comes any more.
///
/// # Errors
/// The preparation is not wanted any more.
pub(crate) fn wait<T>(answer: &Receiver<T>, order: &BlobOrder<'_>) -> Result<Option<T>, String> {
    loop {
        match answer.recv_timeout(CHECK_PERIOD) {
            Ok(answer) => return Ok(Some(answer)),
            Err(RecvTimeoutError::Timeout) => (order.check)()?,
            Err(RecvTimeoutError::Disconnected) => return Ok(None),
        }
    }
}

#[cfg(test)]
mod tests;
