//! The second connection: blobs come down, pictures go up, one after the other.

use std::sync::mpsc::SyncSender;

use bytes::{Bytes, BytesMut};
use futures_util::{SinkExt, StreamExt};
use polyptych_files::blob::CHUNK_BYTES_MAX;
use polyptych_files::blob::{BLOB_BYTES_MAX, BlobHash};
use polyptych_protocol::bulk::{BulkToManager, BulkToServer, CaptureChunk};
use polyptych_protocol::handshake_io::MessageStream;
use polyptych_protocol::stream::Stream;
use tokio::sync::mpsc;

use crate::render_event::CapturedImage;

/// Jobs that wait for the bulk connection.
pub(crate) const BULK_JOBS_MAX: usize = 16;

/// What the bulk connection is used for.
#[derive(Debug)]
pub(crate) enum BulkJob {
    /// Fetch a blob; the answer is checked against its name.
    Fetch { hash: BlobHash, answer: SyncSender<Result<Bytes, String>> },
    /// Send a picture.
    Send(CapturedImage),
}

/// Does jobs until the connection or the server ends; says why it did.
pub(crate) async fn serve(
    mut frames: MessageStream<Stream>,
    mut jobs: mpsc::Receiver<BulkJob>,
) -> String {
    while let Some(job) = jobs.recv().await {
        let done = match job {
            BulkJob::Fetch { hash, answer } => match fetch(&mut frames, hash).await {
                Ok(blob) => {
                    // Whoever asked may have been told to stop meanwhile.
                    let _ = answer.send(blob);
                    Ok(())
                }
                Err(reason) => {
                    let _ = answer.send(Err(reason.clone()));
                    Err(reason)
                }
            },
            BulkJob::Send(picture) => send(&mut frames, &picture).await,
        };
        if let Err(reason) = done {
            return format!("the bulk connection ended: {reason}");
        }
    }
    "the server ends".to_owned()
}

/// The outer error is the connection's, the inner one the blob's.
async fn fetch(
    frames: &mut MessageStream<Stream>,
    hash: BlobHash,
) -> Result<Result<Bytes, String>, String> {
    let want = frames.send(polyptych_codec::encode(&BulkToManager::Want(hash))).await;
    want.map_err(|error| error.to_string())?;
    let mut blob = BytesMut::new();
    loop {
        let message = frames.next().await.ok_or("the manager closed it")?;
        let message = message.map_err(|error| error.to_string())?;
        let down = polyptych_protocol::framing::decode::<BulkToServer>(&message)
            .map_err(|error| error.to_string())?;
        match down {
            BulkToServer::Missing { hash, reason } => {
                return Ok(Err(format!("blob {hash} is not to be had: {reason}")));
            }
            BulkToServer::Chunk(chunk) => {
                let is_next = chunk.hash == hash && chunk.offset == blob.len() as u64;
                if !is_next || chunk.total > BLOB_BYTES_MAX || chunk.bytes.is_empty() {
                    return Err(format!("a piece of blob {hash} came out of order"));
                }
                // Grows with what is there, not with what was promised.
                blob.extend_from_slice(&chunk.bytes);
                if blob.len() as u64 == chunk.total {
                    let blob = blob.freeze();
                    let is_right = BlobHash::of(&blob) == hash;
                    return Ok(is_right.then_some(blob).ok_or_else(|| {
                        format!("blob {hash} was damaged on its way or in the manager's store")
                    }));
                }
                if blob.len() as u64 > chunk.total {
                    return Err(format!("blob {hash} is longer than it was said to be"));
                }
            }
        }
    }
}

async fn send(frames: &mut MessageStream<Stream>, picture: &CapturedImage) -> Result<(), String> {
    for start in (0..picture.bytes.len()).step_by(CHUNK_BYTES_MAX) {
        let end = picture.bytes.len().min(start + CHUNK_BYTES_MAX);
        let chunk = CaptureChunk {
            channel: picture.channel,
            frame: picture.frame,
            width: picture.width,
            height: picture.height,
            offset: start as u64,
            bytes: picture.bytes.slice(start..end),
        };
        let sent = frames.send(polyptych_codec::encode(&BulkToManager::Picture(chunk))).await;
        sent.map_err(|error| error.to_string())?;
    }
    Ok(())
}
