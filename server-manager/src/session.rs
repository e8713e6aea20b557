//! Parts that all connections have in common: an outbox with a limit, and a way to the core.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use bytes::Bytes;
use futures_util::SinkExt;
use polyptych_core::SessionId;
use polyptych_protocol::handshake::{ServerHello, Welcome};
use polyptych_protocol::request::MessageToClient;
use polyptych_protocol::server_message::ServerMessage;
use polyptych_protocol::stall_limit::StallLimit;
use polyptych_protocol::stream::Stream;
use polyptych_tls::NodeIdentity;
use tokio::io::WriteHalf;
use tokio::sync::{mpsc, oneshot, watch};
use tokio_util::codec::{FramedWrite, LengthDelimitedCodec};
use tokio_util::sync::CancellationToken;

use crate::metrics::MetricsSnapshot;
use crate::server_session::ServerHandle;

/// Most messages that wait to be sent to one peer. A server that stands still for two seconds at
/// 60 frames per second has 240; a peer beyond this reads too slowly and is let go.
pub(crate) const OUTBOX_MESSAGES_MAX: usize = 512;

/// Most events that wait for the core: it handles one in microseconds.
pub(crate) const EVENTS_MAX: usize = 1024;

/// Maximum time in which a closed connection may still send what waits for it.
pub(crate) const DRAIN_TIME_MAX: Duration = Duration::from_millis(300);

/// An event that a connection sends to the event loop.
#[derive(Debug)]
pub(crate) enum Event {
    ServerJoins {
        hello: ServerHello,
        address: String,
        link: ServerHandle,
        verdict: oneshot::Sender<Result<Welcome, String>>,
    },
    ServerSays {
        from: SessionId,
        status: ServerMessage,
        bytes: usize,
    },
    ClientJoins {
        name: String,
        /// `true` if it is on the manager's machine.
        is_local: bool,
        link: ClientHandle,
        verdict: oneshot::Sender<Result<Welcome, String>>,
    },
    BulkJoins {
        session: SessionId,
        /// Over TLS: a bulk connection is for the server that opened it.
        proven: Option<NodeIdentity>,
        /// Gets the token that ends it, if it may begin.
        is_known: oneshot::Sender<Option<CancellationToken>>,
    },
    Watched {
        answer: oneshot::Sender<MetricsSnapshot>,
    },
    /// A server is gone; of a client [`Asked::Gone`] says so.
    ///
    /// [`Asked::Gone`]: crate::requests::Asked::Gone
    Gone {
        session: SessionId,
        reason: String,
    },
}

/// Pieces of pictures that wait to be sent to one client, each of at most a mebibyte.
const PIECES_MAX: usize = 2;

/// Maximum time in which a client may take none of the bytes that wait for it. A client that stands
/// still for longer is disconnected: the manager holds these bytes meanwhile.
const STALL_TIME_MAX: Duration = Duration::from_secs(10);

/// Maximum size of the answers that wait for one client, in bytes, while it is served: its further
/// requests wait, and feedback for it is dropped. One answer more may wait, of at most
/// [`MESSAGE_BYTES_MAX`].
///
/// [`MESSAGE_BYTES_MAX`]: polyptych_protocol::limits::MESSAGE_BYTES_MAX
pub(crate) const ANSWER_BYTES_MAX: usize = 256 << 10;

/// The core's end of a client's connection.
#[derive(Clone, Debug)]
pub(crate) struct ClientHandle {
    pub outbox: mpsc::Sender<Bytes>,
    /// Messages that are sent while the outbox is empty: pictures, and the answers that follow
    /// them.
    pub pieces: mpsc::Sender<Bytes>,
    /// Closes the connection after what is in the outbox.
    pub close: CancellationToken,
    /// Bytes that are in the outbox.
    unread: Arc<AtomicUsize>,
}

/// The messages that wait to be sent to a client.
#[derive(Debug)]
pub(crate) struct OutboxReceiver {
    outbox: mpsc::Receiver<Bytes>,
    pieces: mpsc::Receiver<Bytes>,
    unread: Arc<AtomicUsize>,
}

impl OutboxReceiver {
    /// Takes the next message; `None` once there are no more. Pictures come behind the rest.
    pub async fn next(&mut self) -> Option<Bytes> {
        tokio::select! {
            biased;
            Some(message) = self.outbox.recv() => {
                self.unread.fetch_sub(message.len(), Ordering::AcqRel);
                Some(message)
            }
            piece = self.pieces.recv() => piece,
        }
    }
}

impl ClientHandle {
    pub fn new() -> (Self, OutboxReceiver) {
        let (outbox, messages) = mpsc::channel(OUTBOX_MESSAGES_MAX);
        let (pieces, waiting) = mpsc::channel(PIECES_MAX);
        let unread = Arc::<AtomicUsize>::default();
        let waiting =
            OutboxReceiver { outbox: messages, pieces: waiting, unread: Arc::clone(&unread) };
        (Self { outbox, pieces, close: CancellationToken::new(), unread }, waiting)
    }

    /// Sends a message; `false` if too many wait already.
    pub fn send(&self, message: Bytes) -> bool {
        self.unread.fetch_add(message.len(), Ordering::AcqRel);
        self.outbox.try_send(message).is_ok()
    }

    /// Returns whether it reads its answers, so that more may be made for it.
    pub fn has_room(&self) -> bool {
        let is_short = self.outbox.capacity() > OUTBOX_MESSAGES_MAX / 2;
        is_short && self.unread.load(Ordering::Acquire) < ANSWER_BYTES_MAX
    }
}

/// Sends what waits, and heartbeats between, until the connection is closed from one side, and says
/// why it ended.
///
/// Once closed, what is in the outbox still goes out, as far as the peer takes it in
/// [`DRAIN_TIME_MAX`]: a peer that has stopped reading holds nothing.
pub(crate) async fn write_all(
    sink: FramedWrite<WriteHalf<Stream>, LengthDelimitedCodec>,
    waiting: OutboxReceiver,
    heartbeats: watch::Receiver<()>,
    close: CancellationToken,
) -> String {
    let hard_end = async {
        close.cancelled().await;
        tokio::time::sleep(DRAIN_TIME_MAX).await;
    };
    tokio::select! {
        reason = write_until_closed(sink, waiting, heartbeats, &close) => reason,
        () = hard_end => "the manager closed the connection".to_owned(),
    }
}

async fn write_until_closed(
    sink: FramedWrite<WriteHalf<Stream>, LengthDelimitedCodec>,
    mut waiting: OutboxReceiver,
    mut heartbeats: watch::Receiver<()>,
    close: &CancellationToken,
) -> String {
    let codec = sink.encoder().clone();
    // A limit for each write: one for all that waits would end clients on slow links, which read.
    let half = StallLimit::new(sink.into_inner(), STALL_TIME_MAX);
    let mut sink = FramedWrite::new(half, codec);
    let heartbeat = polyptych_codec::encode(&MessageToClient::Heartbeat);
    loop {
        let (message, is_of_outbox) = tokio::select! {
            biased;
            message = waiting.outbox.recv() => (message, true),
            piece = waiting.pieces.recv() => (piece, false),
            () = close.cancelled() => (None, false),
            // Last, since other bytes say as much. The loop sends none any more once it has ended.
            Ok(()) = heartbeats.changed() => (Some(heartbeat.clone()), false),
        };
        let Some(message) = message else { break };
        let mut written = if is_of_outbox { message.len() } else { 0 };
        // Not all that comes meanwhile: a client that reads slowly would never be seen to read.
        let already_there = waiting.outbox.len();
        let work = async {
            sink.feed(message).await?;
            // What waits already goes out in the same packets.
            for _ in 0..already_there {
                let Ok(next) = waiting.outbox.try_recv() else { break };
                written += next.len();
                sink.feed(next).await?;
            }
            SinkExt::<Bytes>::flush(&mut sink).await
        };
        if let Err(error) = work.await {
            return format!("the connection failed: {error}");
        }
        waiting.unread.fetch_sub(written, Ordering::AcqRel);
    }
    // A peer that is gone already needs no goodbye.
    let _ = SinkExt::<Bytes>::close(&mut sink).await;
    "the manager closed the connection".to_owned()
}

#[cfg(test)]
mod tests {
    use futures_util::StreamExt;
    use polyptych_protocol::framing::{decode, frames};
    use polyptych_protocol::limits::MESSAGE_BYTES_MAX;
    use tokio::io::{AsyncReadExt, DuplexStream};
    use tokio::time::Instant;
    use tokio_util::codec::FramedRead;

    use super::*;

    /// The manager's end of a client's connection.
    fn sink(pipe: DuplexStream) -> FramedWrite<WriteHalf<Stream>, LengthDelimitedCodec> {
        let bytes = Box::new(pipe);
        let stream = Stream::Encrypted { bytes, local: ([127, 0, 0, 1], 7878).into() };
        let (_read_half, write_half) = tokio::io::split(stream);
        FramedWrite::new(write_half, frames(MESSAGE_BYTES_MAX))
    }

    fn run<F: Future>(future: F) -> F::Output {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
        runtime.expect("a runtime").block_on(future)
    }

    #[test]
    fn a_client_that_reads_nothing_is_let_go_and_a_slow_one_is_not() {
        run(async {
            tokio::time::pause();
            let (ours, mut theirs) = tokio::io::duplex(1 << 10);
            let (_beats, heartbeats) = watch::channel(());
            let (link, waiting) = ClientHandle::new();
            assert!(link.send(Bytes::from(vec![0; 8 << 10])));
            let began = Instant::now();
            let slow = async {
                for _ in 0..4 {
                    tokio::time::advance(STALL_TIME_MAX * 3 / 4).await;
                    theirs.read_exact(&mut [0; 1 << 10]).await.expect("read");
                }
            };
            let writing = write_all(sink(ours), waiting, heartbeats, link.close.clone());
            let (reason, ()) = tokio::join!(writing, slow);
            assert_eq!(reason, "the connection failed: it has read nothing for 10 s");
            assert!(began.elapsed() >= STALL_TIME_MAX * 7 / 2, "{:?}", began.elapsed());
        });
    }

    #[test]
    fn a_client_that_is_sent_nothing_else_hears_the_heartbeats() {
        run(async {
            let (ours, theirs) = tokio::io::duplex(1 << 10);
            let (beats, heartbeats) = watch::channel(());
            let (link, waiting) = ClientHandle::new();
            let mut heard = FramedRead::new(theirs, frames(MESSAGE_BYTES_MAX));
            let hearing = async {
                for _ in 0..3 {
                    beats.send_replace(());
                    let bytes = heard.next().await.expect("a message").expect("whole");
                    let message = decode::<MessageToClient>(&bytes).expect("a message");
                    assert_eq!(message, MessageToClient::Heartbeat);
                }
                // The loop has ended, and the connection waits for its goodbye.
                drop(beats);
                assert!(link.send(Bytes::from_static(b"goodbye")));
                assert_eq!(&heard.next().await.expect("it").expect("whole")[..], b"goodbye");
                link.close.cancel();
            };
            let writing = write_all(sink(ours), waiting, heartbeats, link.close.clone());
            let (reason, ()) = tokio::join!(writing, hearing);
            assert_eq!(reason, "the manager closed the connection");
        });
    }
}
