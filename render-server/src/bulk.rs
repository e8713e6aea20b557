//! The second connection: blobs come down, pictures go up, one after the other.

use std::sync::mpsc::{SyncSender, TrySendError};

use bytes::{Bytes, BytesMut};
use futures_util::{SinkExt, StreamExt};
use polyptych_files::blob::CHUNK_BYTES_MAX;
use polyptych_files::blob::{BLOB_BYTES_MAX, BlobHash};
use polyptych_protocol::bulk::{BulkToManager, BulkToServer, CaptureChunk};
use polyptych_protocol::handshake_io::MessageStream;
use polyptych_protocol::server_message::ServerMessage;
use polyptych_protocol::stream::Stream;
use tokio::sync::mpsc;

use crate::render_event::CapturedImage;

/// Jobs that wait for the bulk connection.
pub(crate) const BULK_JOBS_MAX: usize = 16;

/// Pieces of one blob that wait for the loader: all of the largest, as the network thread waits for
/// no disk.
pub(crate) const PIECES_MAX: usize = BLOB_BYTES_MAX as usize / CHUNK_BYTES_MAX + 1;

/// The next bytes of a blob.
#[derive(Debug)]
pub(crate) struct Piece {
    /// Bytes of the whole blob.
    pub total: u64,
    pub bytes: Bytes,
}

/// A job of the bulk connection.
#[derive(Debug)]
pub(crate) enum BulkJob {
    /// Fetch a blob from an offset on, piece by piece; nothing is checked here but the order.
    Fetch { hash: BlobHash, offset: u64, pieces: SyncSender<Result<Piece, String>> },
    /// Send a picture.
    Send(CapturedImage),
}

/// Puts a picture behind the jobs of the bulk connection. If there is no room, the picture is
/// dropped, and the message is returned that tells the manager so.
pub(crate) fn send_picture(
    jobs: &mpsc::Sender<BulkJob>,
    picture: CapturedImage,
) -> Option<ServerMessage> {
    let (channel, frame) = (picture.channel, picture.frame);
    jobs.try_send(BulkJob::Send(picture)).err()?;
    tracing::warn!(%channel, %frame, "a picture was dropped: the bulk connection is busy");
    let reason = format!(
        "its picture was dropped: {BULK_JOBS_MAX} others and blobs wait for the bulk connection; \
         capture again once the scene is ready, or more seldom"
    );
    Some(ServerMessage::DrawFailed { channel, frame, reason })
}

/// Does jobs until the connection or the server ends; says why it did.
pub(crate) async fn serve(
    mut frames: MessageStream<Stream>,
    mut jobs: mpsc::Receiver<BulkJob>,
) -> String {
    while let Some(job) = jobs.recv().await {
        let done = match job {
            // Whoever asked hears of a connection's end by the end of the pieces.
            BulkJob::Fetch { hash, offset, pieces } => {
                fetch(&mut frames, hash, offset, &pieces).await
            }
            BulkJob::Send(picture) => send(&mut frames, &picture).await,
        };
        if let Err(reason) = done {
            return format!("the bulk connection ended: {reason}");
        }
    }
    "the server ends".to_owned()
}

/// Passes the pieces of a blob on, or the reason why it is not to be had. An error is the
/// connection's.
async fn fetch(
    frames: &mut MessageStream<Stream>,
    hash: BlobHash,
    offset: u64,
    pieces: &SyncSender<Result<Piece, String>>,
) -> Result<(), String> {
    let want = match offset {
        0 => BulkToManager::Want(hash),
        offset => BulkToManager::WantRest { hash, offset },
    };
    let want = frames.send(polyptych_codec::encode(&want)).await;
    want.map_err(|error| error.to_string())?;
    let mut next = offset;
    loop {
        let chunk = match next_answer(frames).await? {
            BulkToServer::Stopped => return Err("it stopped a blob that is wanted".to_owned()),
            BulkToServer::Missing { hash, reason } => {
                let missing = Err(format!("blob {hash} is not to be had: {reason}"));
                // As below.
                let _ = pieces.try_send(missing);
                return Ok(());
            }
            BulkToServer::Chunk(chunk) => chunk,
        };
        let bytes = next_message(frames).await?.freeze();
        let is_next = chunk.hash == hash && chunk.offset == next && !bytes.is_empty();
        next += bytes.len() as u64;
        if !is_next || next > chunk.total || chunk.total > BLOB_BYTES_MAX {
            return Err(format!("a piece of blob {hash} came out of order"));
        }
        let is_last = next == chunk.total;
        let piece = Piece { total: chunk.total, bytes };
        match pieces.try_send(Ok(piece)) {
            _ if is_last => return Ok(()),
            Ok(()) => {}
            Err(TrySendError::Full(_)) => {
                return Err(format!("blob {hash} came in more than {PIECES_MAX} pieces"));
            }
            // Whoever asked was told to stop; what others want must not wait for the rest.
            Err(TrySendError::Disconnected(_)) => return stop(frames).await,
        }
    }
}

/// Ends the blob that comes: passes by what of it is already on its way.
async fn stop(frames: &mut MessageStream<Stream>) -> Result<(), String> {
    let stop = polyptych_codec::encode(&BulkToManager::Stop);
    frames.send(stop).await.map_err(|error| error.to_string())?;
    loop {
        match next_answer(frames).await? {
            BulkToServer::Chunk(_) => _ = next_message(frames).await?,
            BulkToServer::Missing { .. } => {}
            BulkToServer::Stopped => return Ok(()),
        }
    }
}

async fn next_answer(frames: &mut MessageStream<Stream>) -> Result<BulkToServer, String> {
    let message = next_message(frames).await?;
    polyptych_protocol::framing::decode(&message).map_err(|error| error.to_string())
}

async fn next_message(frames: &mut MessageStream<Stream>) -> Result<BytesMut, String> {
    let message = frames.next().await.ok_or("the manager closed it")?;
    message.map_err(|error| error.to_string())
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

#[cfg(test)]
mod tests {
    use std::sync::mpsc::sync_channel;

    use polyptych_protocol::bulk::BlobChunk;
    use polyptych_protocol::framing;
    use polyptych_protocol::ids::FrameId;
    use polyptych_wall::ChannelId;
    use tokio::net::{TcpListener, TcpStream};
    use tokio_util::codec::Framed;

    use super::*;

    #[tokio::test]
    async fn a_blob_that_nobody_wants_any_more_is_stopped_for_the_next() {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let near = TcpStream::connect(listener.local_addr().expect("bound")).await;
        let (far, _) = listener.accept().await.expect("a connection");
        let frames = |tcp| Framed::new(Stream::Plain(tcp), framing::frames(1 << 16));
        let mut manager = frames(far);
        let fetch = |hash| {
            let (pieces, fetched) = sync_channel(PIECES_MAX);
            (BulkJob::Fetch { hash, offset: 0, pieces }, fetched)
        };
        let [unwanted, wanted] = [1, 2].map(|byte| BlobHash([byte; 32]));
        let (jobs, waiting) = mpsc::channel(2);
        let (job, fetched) = fetch(unwanted);
        drop(fetched);
        jobs.try_send(job).expect("room");
        let (job, fetched) = fetch(wanted);
        jobs.try_send(job).expect("room");
        drop(jobs);
        let answers = async {
            let heard = async |manager: &mut MessageStream<Stream>| {
                let message = manager.next().await.expect("a message").expect("read");
                framing::decode::<BulkToManager>(&message).expect("well formed")
            };
            let chunk = async |manager: &mut MessageStream<Stream>, hash, offset, total| {
                let chunk = BulkToServer::Chunk(BlobChunk { hash, total, offset });
                manager.send(polyptych_codec::encode(&chunk)).await.expect("sent");
                manager.send(Bytes::from_static(b"four")).await.expect("sent");
            };
            assert_eq!(heard(&mut manager).await, BulkToManager::Want(unwanted));
            chunk(&mut manager, unwanted, 0, BLOB_BYTES_MAX).await;
            assert_eq!(heard(&mut manager).await, BulkToManager::Stop);
            // It was on its way.
            chunk(&mut manager, unwanted, 4, BLOB_BYTES_MAX).await;
            let stopped = polyptych_codec::encode(&BulkToServer::Stopped);
            manager.send(stopped).await.expect("sent");
            assert_eq!(heard(&mut manager).await, BulkToManager::Want(wanted));
            chunk(&mut manager, wanted, 0, 4).await;
        };
        let (end, ()) = tokio::join!(serve(frames(near.expect("connected")), waiting), answers);
        assert_eq!(end, "the server ends");
        let piece = fetched.recv().expect("it came").expect("whole");
        assert_eq!((piece.total, &piece.bytes[..]), (4, &b"four"[..]));
    }

    #[test]
    fn the_manager_is_told_of_a_picture_that_finds_no_room() {
        let (jobs, _waiting) = mpsc::channel(1);
        let picture = |frame| CapturedImage {
            channel: ChannelId(3),
            frame: FrameId(frame),
            width: 1,
            height: 1,
            bytes: Bytes::from_static(&[0; 4]),
        };
        assert_eq!(send_picture(&jobs, picture(7)), None);
        let told = send_picture(&jobs, picture(8));
        let Some(ServerMessage::DrawFailed { channel, frame, reason }) = told else {
            panic!("{told:?}")
        };
        assert_eq!((channel, frame), (ChannelId(3), FrameId(8)));
        assert!(reason.contains("its picture was dropped"), "{reason}");
    }
}
