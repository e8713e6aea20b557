//! Puts the blobs of a bake into a store: only those that are missing there, several at a time.
//!
//! ```text
//! all sent | one failed -> stop | interrupted -> stop
//!                            each that is on its way gives its parts up -> end
//! ```

use futures_util::{StreamExt, stream};
use polyptych_files::blob::{BlobHash, BlobStore};

use crate::remote_store::RemoteStore;
use crate::stop_signal::{StopSender, StopSignal, stopped_by};
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
/// that a manifest there has all that it names. Calls `tell` after each. Ends early once
/// `interrupted` is ready, and returns `None` then.
///
/// What was sent before an early end stays there, and another upload goes on from it. Of blobs that
/// are on their way, the store keeps nothing, unless it does not answer any more.
///
/// # Errors
/// [`StoreFault`] of the first blob that could not be sent.
pub async fn upload(
    store: &RemoteStore,
    from: &BlobStore,
    blobs: &[BlobHash],
    interrupted: impl Future<Output = ()>,
    tell: impl FnMut(&Uploaded),
) -> Result<Option<Uploaded>, StoreFault> {
    let stop = StopSender::new();
    stopped_by(&stop, interrupted, send_all(store, from, blobs, &stop, tell)).await
}

async fn send_all(
    store: &RemoteStore,
    from: &BlobStore,
    blobs: &[BlobHash],
    stop: &StopSender,
    mut tell: impl FnMut(&Uploaded),
) -> Result<Option<Uploaded>, StoreFault> {
    let mut uploaded = Uploaded::default();
    let Some((last, others)) = blobs.split_last() else { return Ok(Some(uploaded)) };
    // A web server is sent whole blobs, each of which may be as large as the largest.
    let together = if store.is_web() { 1 } else { UPLOADS_MAX };
    let others = stream::iter(others).map(|hash| send(store, from, *hash, stop.signal()));
    let mut all = others.buffer_unordered(together);
    let mut count = |sent: Sent| {
        match sent {
            Sent::Present => uploaded.present += 1,
            Sent::Bytes(bytes) => {
                uploaded.sent += 1;
                uploaded.sent_bytes += bytes;
            }
            Sent::Stopped => return,
        }
        tell(&uploaded);
    };
    let mut first_fault = None;
    // Also those that were told to stop are waited for: they give their parts up.
    while let Some(sent) = all.next().await {
        match sent {
            Ok(sent) => count(sent),
            Err(fault) => {
                stop.stop();
                first_fault.get_or_insert(fault);
            }
        }
    }
    if let Some(fault) = first_fault {
        return Err(fault);
    }
    count(send(store, from, *last, stop.signal()).await?);
    Ok((uploaded.done() == blobs.len() as u64).then_some(uploaded))
}

/// The outcome of one blob.
#[derive(Clone, Copy, Debug)]
enum Sent {
    /// It was there.
    Present,
    /// So many bytes were sent.
    Bytes(u64),
    /// Nothing, since all is to end.
    Stopped,
}

/// Sends a blob unless it is there.
async fn send(
    store: &RemoteStore,
    from: &BlobStore,
    hash: BlobHash,
    mut stop: StopSignal,
) -> Result<Sent, StoreFault> {
    // An object of 0 bytes would else do for a blob that is missing here.
    let missing = |error| store.local(&format!("blob {hash} is not in {from:?}: {error}"));
    let bytes = std::fs::metadata(from.path_of(hash)).map_err(missing)?.len();
    let Some(size) = stop.unless_stopped(store.size_of(hash)).await.transpose()? else {
        return Ok(Sent::Stopped);
    };
    if size == Some(bytes) {
        return Ok(Sent::Present);
    }
    let put = store.put(from, hash, &mut stop).await?;
    Ok(put.map_or(Sent::Stopped, |()| Sent::Bytes(bytes)))
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};
    use std::net::{TcpListener, TcpStream};

    use polyptych_files::blob::StoreUrl;

    use super::*;

    /// Answers a request for the size of an object with 0 bytes.
    fn answer(mut stream: TcpStream) {
        let mut request = [0; 4096];
        let _ = stream.read(&mut request);
        let date = "last-modified: Wed, 25 Nov 2026 10:00:00 GMT";
        let head = format!("HTTP/1.1 200 OK\r\ncontent-length: 0\r\n{date}\r\netag: \"0\"\r\n");
        let _ = stream.write_all(format!("{head}connection: close\r\n\r\n").as_bytes());
    }

    #[test]
    fn names_a_blob_that_is_missing_here_though_the_store_has_an_empty_object() {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
        let url = format!("http://{}/blobs", listener.local_addr().expect("an address"));
        let serve = move || listener.incoming().flatten().for_each(answer);
        std::thread::Builder::new().name("store".into()).spawn(serve).expect("a thread");
        let url = StoreUrl::from_text(&url).expect("a URL").expect("of a store");
        let store = RemoteStore::open(url).expect("a store");
        let folder = tempfile::tempdir().expect("a folder");
        let (from, missing) = (BlobStore::new(folder.path()), BlobHash([7; 32]));
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
        let (blobs, never) = ([missing], std::future::pending());
        let sent = upload(&store, &from, &blobs, never, |_| {});
        let sent = runtime.expect("a runtime").block_on(sent);
        let reason = sent.expect_err("it is not there").to_string();
        assert!(reason.contains(&format!("blob {missing} is not in")), "{reason}");
    }
}
