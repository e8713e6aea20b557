//! A render server's second connection: blobs go down, pictures come up, control never waits.

use std::collections::HashSet;
use std::sync::{Arc, Mutex, PoisonError};

use bytes::Bytes;
use futures_util::{SinkExt, StreamExt};
use polyptych_protocol::blob::{BlobChunk, BlobFolder, BulkDown, BulkUp};
use polyptych_protocol::codec;
use polyptych_protocol::connection::{self, Frames};
use polyptych_protocol::handshake::Welcome;
use polyptych_protocol::ids::BlobHash;
use polyptych_protocol::limits::CHUNK_BYTES_MAX;
use tokio::net::TcpStream;
use tokio::sync::{mpsc, oneshot};

use crate::cluster::SessionId;
use crate::session::Event;

/// The blobs of scenes that servers were sent: a hash is a name, not a permission.
#[derive(Clone, Debug, Default)]
pub(crate) struct AllowedBlobs(Arc<Mutex<HashSet<BlobHash>>>);

impl AllowedBlobs {
    pub fn allow(&self, blobs: &[BlobHash]) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).extend(blobs);
    }

    fn contains(&self, hash: BlobHash) -> bool {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).contains(&hash)
    }
}

/// Serves one connection until it ends.
pub(crate) async fn serve(
    mut frames: Frames<TcpStream>,
    welcome: Welcome,
    events: mpsc::Sender<Event>,
    folder: BlobFolder,
    allowed: AllowedBlobs,
) {
    let session = SessionId(welcome.session);
    let (is_known, answer) = oneshot::channel();
    if events.send(Event::BulkJoins { session, is_known }).await.is_err() {
        return;
    }
    if answer.await != Ok(true) {
        let reason = format!("session {} has no control connection", session.0);
        let _ = connection::refuse(&mut frames, reason).await;
        return;
    }
    if connection::welcome(&mut frames, welcome).await.is_err() {
        return;
    }
    while let Some(Ok(bytes)) = frames.next().await {
        let up = match codec::decode::<BulkUp>(&bytes) {
            Ok(up) => up,
            Err(error) => {
                let reason = format!("it sent something malformed on the bulk connection: {error}");
                let _ = events.send(Event::Gone { session, reason }).await;
                return;
            }
        };
        match up {
            BulkUp::Want(hash) => {
                if send_blob(&mut frames, hash, &folder, &allowed).await.is_err() {
                    return;
                }
            }
            BulkUp::Picture(chunk) => {
                if events.send(Event::PictureComes { from: session, chunk }).await.is_err() {
                    return;
                }
            }
        }
    }
}

async fn send_blob(
    frames: &mut Frames<TcpStream>,
    hash: BlobHash,
    folder: &BlobFolder,
    allowed: &AllowedBlobs,
) -> std::io::Result<()> {
    let found = if allowed.contains(hash) {
        let folder = folder.clone();
        let read = tokio::task::spawn_blocking(move || folder.read(hash)).await;
        match read {
            Ok(Ok(Some(bytes))) => Ok(bytes),
            Ok(Ok(None)) => Err("the manager has lost it; open the scene again".to_owned()),
            Ok(Err(error)) => Err(error.to_string()),
            Err(error) => Err(error.to_string()),
        }
    } else {
        Err("it belongs to no scene that this server was sent".to_owned())
    };
    match found {
        Err(reason) => frames.send(codec::encode(&BulkDown::Missing { hash, reason })).await,
        Ok(bytes) => send_chunks(frames, hash, &bytes).await,
    }
}

async fn send_chunks(
    frames: &mut Frames<TcpStream>,
    hash: BlobHash,
    bytes: &Bytes,
) -> std::io::Result<()> {
    let total = bytes.len() as u64;
    let mut offset = 0;
    while offset < bytes.len() {
        let end = (offset + CHUNK_BYTES_MAX).min(bytes.len());
        let piece = bytes.slice(offset..end);
        let chunk = BlobChunk { hash, total, offset: offset as u64, bytes: piece };
        frames.send(codec::encode(&BulkDown::Chunk(chunk))).await?;
        offset = end;
    }
    Ok(())
}
