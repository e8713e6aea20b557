//! A render server's second connection: blobs go down, pictures come up, control never waits.

use std::collections::HashSet;
use std::sync::{Arc, Mutex, PoisonError};

use bytes::BytesMut;
use futures_util::{FutureExt, SinkExt, StreamExt};
use polyptych_core::SessionId;
use polyptych_files::blob::{BlobHash, BlobReader, BlobStore};
use polyptych_protocol::bulk::{BlobChunk, BulkToManager, BulkToServer, CaptureChunk};
use polyptych_protocol::handshake::{Proof, Welcome};
use polyptych_protocol::handshake_io::{self, MessageStream};
use polyptych_protocol::stream::Stream;
use polyptych_tls::NodeIdentity;
use tokio::io::AsyncWriteExt;
use tokio::sync::{mpsc, oneshot};

use crate::session::Event;
use crate::traffic::Traffic;

/// The blobs of the wall and of scenes that servers were sent: a hash is a name, not a permission.
#[derive(Clone, Debug, Default)]
pub(crate) struct BlobAllowlist(Arc<Mutex<HashSet<BlobHash>>>);

impl BlobAllowlist {
    pub fn allow(&self, blobs: &[BlobHash]) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).extend(blobs);
    }

    fn contains(&self, hash: BlobHash) -> bool {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).contains(&hash)
    }
}

/// A piece of a picture, and the server that it comes from.
pub(crate) type PictureOf = (SessionId, CaptureChunk);

/// The blobs that a peer may be sent.
pub(crate) struct ServedBlobs {
    pub folder: BlobStore,
    pub allowed: BlobAllowlist,
}

/// The server that a second connection claims to belong to, and the identity that it has proven.
pub(crate) struct BulkPeer {
    /// The welcome, with the session of the control connection.
    pub welcome: Welcome,
    pub proven: Option<NodeIdentity>,
}

/// Serves one connection until it ends.
pub(crate) async fn serve(
    (mut frames, proof): (MessageStream<Stream>, Proof),
    BulkPeer { welcome, proven }: BulkPeer,
    (events, pictures): (mpsc::Sender<Event>, mpsc::Sender<PictureOf>),
    store: ServedBlobs,
    traffic: Traffic,
) {
    let session = SessionId(welcome.session);
    let (is_known, answer) = oneshot::channel();
    if events.send(Event::BulkJoins { session, proven, is_known }).await.is_err() {
        return;
    }
    let Ok(Some(end)) = answer.await else {
        let reason = format!("session {} is no control connection of this server", session.0);
        let _ = handshake_io::reject(&mut frames, reason).await;
        return;
    };
    if handshake_io::accept(&mut frames, welcome, proof).await.is_err() {
        return;
    }
    tokio::select! {
        () = converse(frames, session, (&events, &pictures), &store, &traffic) => {}
        () = end.cancelled() => {}
    }
}

async fn converse(
    mut frames: MessageStream<Stream>,
    session: SessionId,
    (events, pictures): (&mpsc::Sender<Event>, &mpsc::Sender<PictureOf>),
    store: &ServedBlobs,
    traffic: &Traffic,
) {
    // A message that came while a blob went out.
    let mut early = None;
    while let Some(Ok(bytes)) = next_message(&mut frames, &mut early).await {
        traffic.bulk_received(bytes.len());
        let up = match polyptych_protocol::framing::decode::<BulkToManager>(&bytes) {
            Ok(up) => up,
            Err(error) => {
                let reason = format!("it sent something malformed on the bulk connection: {error}");
                let _ = events.send(Event::Gone { session, reason }).await;
                return;
            }
        };
        let wanted = match up {
            BulkToManager::Want(hash) => (hash, 0),
            BulkToManager::WantRest { hash, offset } => (hash, offset),
            BulkToManager::Picture(chunk) => {
                if pictures.send((session, chunk)).await.is_err() {
                    return;
                }
                continue;
            }
            BulkToManager::Stop => {
                // Of a blob that has ended by its own last piece, or by this message.
                if frames.send(polyptych_codec::encode(&BulkToServer::Stopped)).await.is_err() {
                    return;
                }
                continue;
            }
        };
        match send_blob(&mut frames, wanted, store, traffic).await {
            Ok(came) => early = came,
            Err(_) => return,
        }
    }
}

/// A message of the peer, or the end of its connection.
type Received = Option<std::io::Result<BytesMut>>;

/// Returns what came early, or waits for the next message.
async fn next_message(
    frames: &mut MessageStream<Stream>,
    early: &mut Option<Received>,
) -> Received {
    match early.take() {
        Some(came) => came,
        None => frames.next().await,
    }
}

/// Sends a blob from an offset on piece by piece, or the reason why it does not come. However slow
/// the link is, two pieces of it are held here: one is read while the other is sent.
///
/// A message that comes meanwhile ends the blob and is returned: a server sends
/// [`BulkToManager::Stop`] then, and nothing else.
async fn send_blob(
    frames: &mut MessageStream<Stream>,
    (hash, offset): (BlobHash, u64),
    store: &ServedBlobs,
    traffic: &Traffic,
) -> std::io::Result<Option<Received>> {
    let mut next = if store.allowed.contains(hash) {
        let folder = store.folder.clone();
        off_thread(move || begin(&folder, hash, offset)).await
    } else {
        Err("it belongs to no wall or scene that this server was sent".to_owned())
    };
    let mut room = Vec::new();
    loop {
        match next {
            Ok(Some(Piece { reader, messages })) => {
                traffic.bulk_sent(messages.len());
                // All that was sent before is out of the stream's own buffer.
                let (sent, read) = tokio::join!(
                    frames.get_mut().write_all(&messages),
                    off_thread(move || go_on(reader, room))
                );
                sent?;
                (next, room) = (read, messages);
                if let Some(came) = frames.next().now_or_never() {
                    return Ok(Some(came));
                }
            }
            Ok(None) => {
                frames.get_mut().flush().await?;
                return Ok(None);
            }
            Err(reason) => {
                let missing = BulkToServer::Missing { hash, reason };
                frames.send(polyptych_codec::encode(&missing)).await?;
                return Ok(None);
            }
        }
    }
}

/// An open blob, and the piece that was read of it last.
struct Piece {
    reader: BlobReader,
    /// Its place and its bytes, as they go over the wire.
    messages: Vec<u8>,
}

/// Reads and hashes away from the core's thread, which neither a disk nor a hash may hold.
async fn off_thread(
    read: impl FnOnce() -> Result<Option<Piece>, String> + Send + 'static,
) -> Result<Option<Piece>, String> {
    let read = tokio::task::spawn_blocking(read).await;
    read.unwrap_or_else(|error| Err(error.to_string()))
}

fn begin(folder: &BlobStore, hash: BlobHash, offset: u64) -> Result<Option<Piece>, String> {
    let reader = folder.open(hash).map_err(|error| error.to_string())?;
    let mut reader =
        reader.ok_or("the manager has lost it; open the scene again, or start the manager")?;
    reader.skip_to(offset).map_err(|error| error.to_string())?;
    if offset > 0 && (reader.position() != offset || offset == reader.total()) {
        return Err(format!("of its {} bytes none begin at {offset}", reader.total()));
    }
    match go_on(reader, Vec::new())? {
        None => Err("it is empty, which no blob is".to_owned()),
        piece => Ok(piece),
    }
}

/// Reads the next piece into the room of one that was sent.
fn go_on(mut reader: BlobReader, mut room: Vec<u8>) -> Result<Option<Piece>, String> {
    let length = reader.next_length();
    if length == 0 {
        return Ok(None);
    }
    let (hash, total, offset) = (reader.hash(), reader.total(), reader.position());
    let chunk = BulkToServer::Chunk(BlobChunk { hash, total, offset });
    let head = polyptych_codec::framed(&polyptych_codec::encode(&chunk));
    let [head_end, start] = [head.len(), head.len() + size_of::<u32>()];
    room.resize(start + length, 0);
    room[..head_end].copy_from_slice(&head);
    room[head_end..start].copy_from_slice(&(length as u32).to_le_bytes());
    reader.read_piece(&mut room[start..]).map_err(|error| error.to_string())?;
    Ok(Some(Piece { reader, messages: room }))
}

#[cfg(test)]
mod tests {
    use polyptych_files::blob::CHUNK_BYTES_MAX;
    use tokio::net::{TcpListener, TcpStream};
    use tokio_util::codec::Framed;

    use super::*;

    /// Pieces of a blob that no system holds between two sockets.
    const PIECES: usize = 64;

    #[tokio::test]
    async fn a_blob_that_a_server_stops_ends_and_the_next_one_comes() {
        let root = tempfile::tempdir().expect("a folder");
        let store =
            ServedBlobs { folder: BlobStore::new(root.path()), allowed: BlobAllowlist::default() };
        let large = store.folder.write(&vec![7; PIECES * CHUNK_BYTES_MAX]).expect("written");
        let small = store.folder.write(b"small").expect("written");
        store.allowed.allow(&[large, small]);
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let near = TcpStream::connect(listener.local_addr().expect("bound")).await;
        let (far, _) = listener.accept().await.expect("a connection");
        let codec = || polyptych_protocol::framing::frames(2 * CHUNK_BYTES_MAX);
        let frames = Framed::new(Stream::Plain(far), codec());
        let mut server = Framed::new(Stream::Plain(near.expect("connected")), codec());
        let (events, _heard) = mpsc::channel(1);
        let (pictures, _seen) = mpsc::channel(1);
        let traffic = Traffic::default();
        let asked = async {
            let want = polyptych_codec::encode(&BulkToManager::Want(large));
            server.send(want).await.expect("sent");
            let first = server.next().await.expect("a piece").expect("read");
            assert!(!first.is_empty());
            let stop = polyptych_codec::encode(&BulkToManager::Stop);
            server.send(stop).await.expect("sent");
            let stopped = polyptych_codec::encode(&BulkToServer::Stopped);
            let mut bytes = 0;
            loop {
                let message = server.next().await.expect("a message").expect("read");
                if message == stopped[..] {
                    break;
                }
                bytes += message.len();
            }
            assert!(bytes < PIECES * CHUNK_BYTES_MAX, "all of it came");
            let want = polyptych_codec::encode(&BulkToManager::Want(small));
            server.send(want).await.expect("sent");
            let chunk = BlobChunk { hash: small, total: 5, offset: 0 };
            let head = server.next().await.expect("a message").expect("read");
            assert_eq!(head, polyptych_codec::encode(&BulkToServer::Chunk(chunk))[..]);
            let bytes = server.next().await.expect("a message").expect("read");
            assert_eq!(bytes, b"small"[..]);
            drop(server);
        };
        let served = converse(frames, SessionId(1), (&events, &pictures), &store, &traffic);
        tokio::join!(served, asked);
    }
}
