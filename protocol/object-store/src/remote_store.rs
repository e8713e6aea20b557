//! One object store: fetches blobs from it, and puts them there.

use std::time::Duration;

use bytes::{Bytes, BytesMut};
use futures_util::{Stream, StreamExt};
use object_store::aws::{AmazonS3Builder, AmazonS3ConfigKey};
use object_store::azure::{AzureConfigKey, MicrosoftAzureBuilder};
use object_store::client::ClientConfigKey;
use object_store::gcp::{GoogleCloudStorageBuilder, GoogleConfigKey};
use object_store::http::HttpBuilder;
use object_store::path::Path;
use object_store::{
    BackoffConfig, Error as StoreError, ObjectStore, ObjectStoreExt, PutPayloadMut, RetryConfig,
};
use polyptych_files::blob::{BlobHash, BlobReader, BlobStore, StoreScheme, StoreUrl};
use tokio::task::spawn_blocking;
use tokio::time::{Instant, timeout, timeout_at};
use tokio_rustls::rustls::crypto::{CryptoProvider, ring};

use crate::part_upload::PartUpload;
use crate::stop_signal::StopSignal;
use crate::store_fault::StoreFault;

/// Longest time in which a store may answer a request, its retries included.
const ANSWER_TIME_MAX: Duration = Duration::from_secs(10);

/// A limit of a client's requests.
type Limit = (ClientConfigKey, &'static str);

/// Longest time for a connection: beyond it the machine is down.
const CONNECTION: Limit = (ClientConfigKey::ConnectTimeout, "3 s");

/// Longest time without a byte of an answer, from the first byte of the request on.
const ANSWER: Limit = (ClientConfigKey::ReadTimeout, "5 s");

/// Least rate at which a blob must come over each [`ANSWER_TIME_MAX`], in bytes a second: a
/// preparation of the wall waits for it. Servers read 16 side by side, and share a slow link.
const RATE_MIN: u64 = 16 << 10;

/// Longest time for all bytes of a blob that comes at no less than [`RATE_MIN`]: no scene is
/// waited for any longer.
const ARRIVAL: Limit = (ClientConfigKey::Timeout, "3600 s");

/// Longest time for all bytes of one request of an upload: 2 GiB over a link of 30 Mbit/s.
const REQUEST: Limit = (ClientConfigKey::Timeout, "600 s");

/// Further tries of a request that a store could not serve just now.
const RETRIES_MAX: usize = 2;

/// First wait before another try.
const RETRY_FIRST: Duration = Duration::from_millis(100);

/// Blobs above it are sent in parts of this size, so that memory holds few of them.
const PART_BYTES: u64 = 8 << 20;

/// A folder of blobs in an object store.
#[derive(Debug)]
pub struct RemoteStore {
    url: StoreUrl,
    store: Box<dyn ObjectStore>,
    /// For uploads, which are answered once all bytes are there: a slow link is no stall.
    uploads: Box<dyn ObjectStore>,
}

impl RemoteStore {
    /// Prepares requests to this store, with the credentials and the endpoint of the process's
    /// environment; none is sent yet.
    ///
    /// # Errors
    /// [`StoreFault`] if the environment is not enough, or contradicts itself.
    pub fn open(url: StoreUrl) -> Result<Self, StoreFault> {
        // Another may be installed already, which serves as well.
        if CryptoProvider::get_default().is_none() {
            let _ = ring::default_provider().install_default();
        }
        let build = |limits| build(&url, limits);
        let fault = |error| StoreFault::of_store(&url, &error);
        let store = build(&[CONNECTION, ANSWER, ARRIVAL]).map_err(fault)?;
        let uploads = build(&[CONNECTION, REQUEST]).map_err(fault)?;
        Ok(Self { url, store, uploads })
    }

    /// The store's address.
    pub fn url(&self) -> &StoreUrl {
        &self.url
    }

    /// A blob's object, by its name as it stands: the request alone encodes it.
    fn path_of(&self, hash: BlobHash) -> Result<Path, StoreFault> {
        let path = Path::parse(self.url.key_of(hash));
        path.map_err(|error| StoreFault::unusable(&self.url, error.to_string(), "correct its name"))
    }

    fn fault(&self, error: &StoreError) -> StoreFault {
        StoreFault::of_store(&self.url, error)
    }

    async fn answer<T>(
        &self,
        request: impl Future<Output = object_store::Result<T>>,
    ) -> Result<Option<T>, StoreFault> {
        let silent = |_| StoreFault::silent(&self.url, ANSWER_TIME_MAX.as_secs());
        match timeout(ANSWER_TIME_MAX, request).await.map_err(silent)? {
            Ok(answer) => Ok(Some(answer)),
            // A bucket that is missing would else be one without blobs.
            Err(error @ StoreError::NotFound { .. }) if !names_no_bucket(&error) => Ok(None),
            Err(error) => Err(self.fault(&error)),
        }
    }

    /// Returns a blob of at most `bytes_max` bytes, checked, or `None` if the store has none of
    /// this name.
    ///
    /// # Errors
    /// [`StoreFault`] if the store cannot be read, or its object is not the blob.
    pub async fn fetch(&self, hash: BlobHash, bytes_max: u64) -> Result<Option<Bytes>, StoreFault> {
        let path = self.path_of(hash)?;
        let Some(found) = self.answer(self.store.get(&path)).await? else { return Ok(None) };
        if found.meta.size > bytes_max {
            return Err(StoreFault::too_large(&self.url, path.as_ref(), bytes_max));
        }
        let bytes = self.read(found.into_stream(), &path, bytes_max).await?;
        // Hashing 2 GiB takes seconds, for which other fetches need not wait.
        let checked = spawn_blocking(move || (BlobHash::of(&bytes) == hash, bytes)).await;
        match checked {
            Ok((true, bytes)) => Ok(Some(bytes)),
            Ok((false, _)) => {
                let reason = "has other bytes than its name says";
                Err(StoreFault::damaged(&self.url, path.as_ref(), reason))
            }
            Err(error) => Err(StoreFault::unusable(&self.url, error.to_string(), "try again")),
        }
    }

    /// Reads an object of at most `bytes_max` bytes, as long as enough of it comes: the time for
    /// all of it depends on how many share the link.
    async fn read(
        &self,
        mut pieces: impl Stream<Item = object_store::Result<Bytes>> + Unpin,
        path: &Path,
        bytes_max: u64,
    ) -> Result<Bytes, StoreFault> {
        // Grows with what is there, not with what was promised.
        let mut bytes = BytesMut::new();
        let (mut end, mut came_before) = (Instant::now() + ANSWER_TIME_MAX, 0);
        loop {
            let Ok(piece) = timeout_at(end, pieces.next()).await else {
                let seconds = ANSWER_TIME_MAX.as_secs();
                if ((bytes.len() - came_before) as u64) < RATE_MIN * seconds {
                    return Err(StoreFault::slow(&self.url, RATE_MIN, seconds));
                }
                (end, came_before) = (Instant::now() + ANSWER_TIME_MAX, bytes.len());
                continue;
            };
            let Some(piece) = piece else { return Ok(bytes.freeze()) };
            let piece = piece.map_err(|error| self.fault(&error))?;
            if (bytes.len() + piece.len()) as u64 > bytes_max {
                return Err(StoreFault::too_large(&self.url, path.as_ref(), bytes_max));
            }
            bytes.extend_from_slice(&piece);
        }
    }

    /// Returns the size of a blob's object in bytes, or `None` if there is none.
    ///
    /// # Errors
    /// [`StoreFault`] if the store cannot be asked.
    pub async fn size_of(&self, hash: BlobHash) -> Result<Option<u64>, StoreFault> {
        let path = self.path_of(hash)?;
        Ok(self.answer(self.store.head(&path)).await?.map(|object| object.size))
    }

    /// Puts a blob of a folder into the store, over what may be there. Returns `None` if it was
    /// told to stop before: then the store keeps nothing of the blob.
    ///
    /// # Errors
    /// [`StoreFault`] if the store does not take it, or the folder's blob is damaged or missing.
    pub(crate) async fn put(
        &self,
        from: &BlobStore,
        hash: BlobHash,
        stop: &mut StopSignal,
    ) -> Result<Option<()>, StoreFault> {
        let folder = from.clone();
        let opened = spawn_blocking(move || folder.open(hash)).await;
        let reader = match opened.map_err(|error| self.local(&error))? {
            Ok(Some(reader)) => reader,
            Ok(None) => return Err(self.local(&format!("blob {hash} is not in {from:?}"))),
            Err(error) => return Err(self.local(&error)),
        };
        let path = self.path_of(hash)?;
        // Web servers take no parts.
        if reader.total() <= PART_BYTES || self.is_web() {
            return stop.unless_stopped(self.put_whole(reader, &path)).await.transpose();
        }
        // Not to be stopped: who does not hear which upload was begun cannot end it.
        let begun = timeout(ANSWER_TIME_MAX, self.uploads.put_multipart(&path)).await;
        let silent = |_| StoreFault::silent(&self.url, ANSWER_TIME_MAX.as_secs());
        let upload = begun.map_err(silent)?.map_err(|error| self.fault(&error))?;
        let mut parts = PartUpload::new(upload);
        let sent = stop.unless_stopped(self.put_parts(reader, &mut parts)).await;
        if !matches!(sent, Some(Ok(()))) {
            parts.abort().await;
        }
        sent.transpose()
    }

    async fn put_whole(&self, reader: BlobReader, path: &Path) -> Result<(), StoreFault> {
        let bytes = self.read_whole(reader).await?;
        let put = self.uploads.put(path, bytes.into()).await;
        put.map(drop).map_err(|error| self.fault(&error))
    }

    async fn put_parts(
        &self,
        mut reader: BlobReader,
        parts: &mut PartUpload,
    ) -> Result<(), StoreFault> {
        let fault = |error| self.fault(&error);
        let mut part = PutPayloadMut::new();
        loop {
            let read = spawn_blocking(move || reader.next_piece().map(|piece| (piece, reader)));
            let read = read.await.map_err(|error| self.local(&error))?;
            let (piece, rest) = read.map_err(|error| self.local(&error))?;
            let Some((_, mut bytes)) = piece else { break };
            reader = rest;
            // All parts but the last are of one size.
            while part.content_length() + bytes.len() >= PART_BYTES as usize {
                part.push(bytes.split_to(PART_BYTES as usize - part.content_length()));
                parts.send(std::mem::take(&mut part).freeze()).await.map_err(fault)?;
            }
            part.push(bytes);
        }
        if !part.is_empty() {
            parts.send(part.freeze()).await.map_err(fault)?;
        }
        parts.complete().await.map_err(fault)
    }

    async fn read_whole(&self, mut reader: BlobReader) -> Result<Bytes, StoreFault> {
        let read = spawn_blocking(move || {
            let mut bytes = BytesMut::new();
            while let Some((_, piece)) = reader.next_piece()? {
                bytes.extend_from_slice(&piece);
            }
            Ok::<_, polyptych_files::blob::BlobError>(bytes.freeze())
        });
        let read = read.await.map_err(|error| self.local(&error))?;
        read.map_err(|error| self.local(&error))
    }

    /// Returns whether the store is a plain web server.
    pub(crate) fn is_web(&self) -> bool {
        matches!(self.url.scheme(), StoreScheme::Http | StoreScheme::Https)
    }

    /// A fault of this machine, in the course of an upload.
    pub(crate) fn local(&self, reason: &dyn std::fmt::Display) -> StoreFault {
        let reason = format!("not uploaded: {reason}");
        StoreFault::unusable(&self.url, reason, "bake the file again")
    }
}

fn names_no_bucket(error: &StoreError) -> bool {
    let StoreError::NotFound { source, .. } = error else { return false };
    let text = source.to_string();
    ["NoSuchBucket", "ContainerNotFound"].iter().any(|code| text.contains(code))
}

fn build(url: &StoreUrl, limits: &[Limit]) -> object_store::Result<Box<dyn ObjectStore>> {
    let backoff = BackoffConfig { init_backoff: RETRY_FIRST, ..BackoffConfig::default() };
    let retry = RetryConfig { backoff, max_retries: RETRIES_MAX, retry_timeout: ANSWER_TIME_MAX };
    let root = url.root();
    Ok(match url.scheme() {
        StoreScheme::S3 => {
            let mut builder = AmazonS3Builder::from_env().with_url(root).with_retry(retry);
            for (key, value) in limits {
                builder = builder.with_config(AmazonS3ConfigKey::Client(*key), *value);
            }
            Box::new(builder.build()?)
        }
        StoreScheme::Gs => {
            let mut builder = GoogleCloudStorageBuilder::from_env().with_url(root);
            for (key, value) in limits {
                builder = builder.with_config(GoogleConfigKey::Client(*key), *value);
            }
            Box::new(builder.with_retry(retry).build()?)
        }
        StoreScheme::Az => {
            let mut builder = MicrosoftAzureBuilder::from_env().with_url(root);
            for (key, value) in limits {
                builder = builder.with_config(AzureConfigKey::Client(*key), *value);
            }
            Box::new(builder.with_retry(retry).build()?)
        }
        StoreScheme::Http | StoreScheme::Https => {
            let mut builder = HttpBuilder::new().with_url(root).with_retry(retry);
            for (key, value) in limits {
                builder = builder.with_config(*key, *value);
            }
            let is_plain = url.scheme() == StoreScheme::Http;
            Box::new(builder.with_config(ClientConfigKey::AllowHttp, is_plain.to_string()).build()?)
        }
    })
}

#[cfg(test)]
mod tests {
    use std::future::pending;

    use futures_util::stream;

    use super::*;

    /// Reads 16 MiB that come at this rate, in bytes a second; the clock is the test's own.
    async fn read_at(rate: usize) -> Result<usize, StoreFault> {
        const BYTES: usize = 16 << 20;
        let url = StoreUrl::from_text("http://127.0.0.1:9/blobs").expect("a URL");
        let store = RemoteStore::open(url.expect("of a store")).expect("a store");
        let next = |left: usize| async move {
            let _ = timeout(Duration::from_secs(1), pending::<()>()).await;
            let length = left.min(rate);
            let piece: object_store::Result<Bytes> = Ok(Bytes::from(vec![0_u8; length]));
            (left > 0).then_some((piece, left - length))
        };
        let pieces = Box::pin(stream::unfold(BYTES, next));
        let read = store.read(pieces, &Path::from("a"), BYTES as u64).await;
        read.map(|bytes| bytes.len())
    }

    #[tokio::test(start_paused = true)]
    async fn a_share_of_a_slow_link_is_no_fault_and_a_trickle_is() {
        // Of 10 Mbit/s, which 16 blobs share.
        assert_eq!(read_at(80_000).await, Ok(16 << 20));
        let fault = read_at(8_000).await.expect_err("it takes half an hour").to_string();
        assert!(fault.contains("less than 16 KiB/s came within 10 s"), "{fault}");
    }
}
