//! A render server's control connection.
//!
//! Messages of the core go straight to the socket if nothing waits before them: waking a task for
//! each of 64 servers would cost more than the barrier itself. Over TLS the writer's task encrypts,
//! and all goes through it.

use std::io::ErrorKind;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};

use bytes::{Bytes, BytesMut};
use futures_util::StreamExt;
use polyptych_core::{Micros, SessionId};
use polyptych_protocol::command::{Command, Goodbye};
use polyptych_protocol::handshake::{Proof, ServerHello};
use polyptych_protocol::handshake_io::{self, MessageStream};
use polyptych_protocol::server_message::ServerMessage;
use polyptych_protocol::stream::{DuplexBytes, Stream};
use polyptych_tls::NodeIdentity;
use polyptych_wall::ChannelId;
use tokio::io::{AsyncRead, AsyncWriteExt, WriteHalf};
use tokio::net::tcp::OwnedWriteHalf;
use tokio::sync::{mpsc, oneshot};
use tokio::time::Instant;
use tokio_util::codec::{FramedParts, FramedRead, LengthDelimitedCodec};
use tokio_util::sync::CancellationToken;

use crate::acceptor::AcceptContext;
use crate::session::{DRAIN_TIME_MAX, Event, OUTBOX_MESSAGES_MAX};

/// The core's end of a server's connection. Only the core sends.
#[derive(Debug)]
pub(crate) struct ServerHandle {
    pub outbox: mpsc::Sender<Bytes>,
    /// Closes the connection after what is in the outbox.
    pub close: CancellationToken,
    /// The channels that it has claimed, once it was let in.
    pub channels: Vec<ChannelId>,
    /// Ends its second connection.
    bulk: CancellationToken,
    lane: Arc<DirectWriter>,
    /// Its name, which over TLS its certificate has too.
    server: String,
}

/// The way to the socket, which the core and the writer share.
#[derive(Debug, Default)]
struct DirectWriter {
    /// There once the peer was welcomed, where it is plain TCP.
    half: OnceLock<OwnedWriteHalf>,
    /// Messages that are in the outbox or partly written. While there are any, the writer alone
    /// writes.
    waiting: AtomicUsize,
    /// The time at which its last message came, in microseconds of the manager's clock.
    heard: AtomicU64,
}

/// To whom is told what a server says.
#[derive(Clone, Copy)]
struct Ears<'a> {
    session: SessionId,
    events: &'a mpsc::Sender<Event>,
    /// The start of the manager's clock.
    started: Instant,
}

impl ServerHandle {
    fn new(server: &str) -> (Self, mpsc::Receiver<Bytes>) {
        let (outbox, inbox) = mpsc::channel(OUTBOX_MESSAGES_MAX);
        let (close, lane) = (CancellationToken::new(), Arc::default());
        let (channels, bulk) = (Vec::new(), close.child_token());
        (Self { outbox, close, channels, bulk, lane, server: server.to_owned() }, inbox)
    }

    /// Sends a whole frame; `false` where the peer reads too slowly to be sent more.
    pub fn send(&self, frame: &Bytes) -> bool {
        let mut rest = frame.clone();
        if let Some(half) = self.lane.half.get()
            && self.lane.waiting.load(Ordering::Acquire) == 0
        {
            match half.try_write(frame) {
                Ok(written) if written == frame.len() => return true,
                Ok(written) => rest = frame.slice(written..),
                Err(error) if error.kind() == ErrorKind::WouldBlock => {}
                // The reader finds out why, and tells the core.
                Err(_) => return true,
            }
        }
        self.lane.waiting.fetch_add(1, Ordering::AcqRel);
        self.outbox.try_send(rest).is_ok()
    }

    /// Returns the time at which its last message came, in microseconds of the manager's clock; 0
    /// before the first.
    pub fn heard(&self) -> Micros {
        self.lane.heard.load(Ordering::Relaxed)
    }

    /// The name of the server.
    pub fn server(&self) -> &str {
        &self.server
    }

    /// Returns whether a peer that has proven this may open the second connection of this server.
    pub fn is_of(&self, proven: Option<&NodeIdentity>) -> bool {
        // In the clear everyone with the token is as good as everyone else.
        proven.is_none_or(|proven| *proven == NodeIdentity::Server(self.server.clone()))
    }

    /// A second connection begins: one that was there before ends, and this one does so at the
    /// latest with the first.
    pub fn begin_bulk(&mut self) -> CancellationToken {
        self.bulk.cancel();
        self.bulk = self.close.child_token();
        self.bulk.clone()
    }

    /// Ready when the connection is gone.
    pub fn closed(&self) -> impl Future<Output = ()> + use<> {
        let outbox = self.outbox.clone();
        async move { outbox.closed().await }
    }
}

/// Writes what is in the outbox until the connection is closed from one side; then what is left,
/// as far as the peer takes it in [`DRAIN_TIME_MAX`].
async fn write_rest(
    lane: Arc<DirectWriter>,
    mut outbox: mpsc::Receiver<Bytes>,
    close: CancellationToken,
) {
    let work = async {
        while let Some(mut frame) = next(&mut outbox, &close).await {
            let Some(half) = lane.half.get() else { return };
            while !frame.is_empty() {
                if half.writable().await.is_err() {
                    return;
                }
                match half.try_write(&frame) {
                    Ok(written) => frame = frame.slice(written..),
                    Err(error) if error.kind() == ErrorKind::WouldBlock => {}
                    Err(_) => return,
                }
            }
            lane.waiting.fetch_sub(1, Ordering::AcqRel);
        }
    };
    tokio::select! {
        () = work => {}
        () = drained(&close) => {}
    }
}

/// Writes what is in the outbox over TLS, where only this task writes, until the connection is
/// closed from one side; then what is left, as far as the peer takes it in [`DRAIN_TIME_MAX`].
async fn write_encrypted(
    mut half: WriteHalf<Box<dyn DuplexBytes>>,
    mut outbox: mpsc::Receiver<Bytes>,
    close: CancellationToken,
    mut last_words: oneshot::Receiver<Bytes>,
) {
    let work = async {
        loop {
            let (frame, is_last) = tokio::select! {
                biased;
                frame = next(&mut outbox, &close) => (frame, false),
                Ok(words) = &mut last_words => (Some(words), true),
            };
            let Some(frame) = frame else { break };
            half.write_all(&frame).await?;
            // What waits already goes out in the same packets.
            while let Ok(frame) = outbox.try_recv() {
                half.write_all(&frame).await?;
            }
            half.flush().await?;
            if is_last {
                break;
            }
        }
        // TLS tells the peer that this end is meant.
        half.shutdown().await
    };
    // Where it fails the reader finds out why, and tells the core.
    tokio::select! {
        _ = work => {}
        () = drained(&close) => {}
    }
}

/// Ready when a closed connection has had its time to send what was left.
async fn drained(close: &CancellationToken) {
    close.cancelled().await;
    tokio::time::sleep(DRAIN_TIME_MAX).await;
}

/// Returns the next message to write; `None` once the outbox is empty and the connection closed.
async fn next(outbox: &mut mpsc::Receiver<Bytes>, close: &CancellationToken) -> Option<Bytes> {
    tokio::select! {
        biased;
        frame = outbox.recv() => frame,
        () = close.cancelled() => None,
    }
}

/// Tells a peer what it did, where nothing stands half written before that.
fn say_goodbye(lane: &DirectWriter, fault: &str) {
    if let Some(half) = lane.half.get()
        && lane.waiting.load(Ordering::Acquire) == 0
    {
        // A peer that reads nothing is told nothing.
        let _ = half.try_write(&goodbye(fault));
    }
}

/// A whole frame that says what a peer did.
fn goodbye(fault: &str) -> Bytes {
    polyptych_codec::framed(&polyptych_codec::encode(&Command::Goodbye(Goodbye::closed(fault))))
}

/// Serves one connection until it ends, and tells the core why it did.
pub(crate) async fn serve(
    (mut frames, proof): (MessageStream<Stream>, Proof),
    hello: ServerHello,
    address: SocketAddr,
    AcceptContext { events, refusals, started, .. }: AcceptContext,
) {
    let (link, outbox) = ServerHandle::new(&hello.name);
    let (close, lane) = (link.close.clone(), Arc::clone(&link.lane));
    let (verdict, answer) = oneshot::channel();
    let name = hello.name.clone();
    let joins = Event::ServerJoins { hello, address: address.to_string(), link, verdict };
    if events.send(joins).await.is_err() {
        return;
    }
    let session = match answer.await {
        Ok(Ok(welcome)) => {
            let session = SessionId(welcome.session);
            if handshake_io::accept(&mut frames, welcome, proof).await.is_err() {
                let reason = "the connection failed during the handshake".to_owned();
                let _ = events.send(Event::Gone { session, reason }).await;
                return;
            }
            session
        }
        Ok(Err(reason)) => {
            if let Some(times) = refusals.record(address, &reason) {
                let peer = address;
                tracing::warn!(%peer, server = name, reason, times, "a server is refused");
            }
            let _ = handshake_io::reject(&mut frames, reason).await;
            return;
        }
        Err(_) => return,
    };
    let reason =
        converse(frames, Ears { session, events: &events, started }, lane, outbox, close).await;
    // The core may be gone already; then nobody needs to know.
    let _ = events.send(Event::Gone { session, reason }).await;
}

/// Carries messages both ways until the connection ends; says why it did.
async fn converse(
    frames: MessageStream<Stream>,
    ears: Ears<'_>,
    lane: Arc<DirectWriter>,
    outbox: mpsc::Receiver<Bytes>,
    close: CancellationToken,
) -> String {
    let FramedParts { io, codec, read_buf, .. } = frames.into_parts();
    // The writer has a task of its own: it has nothing to do while the peer reads, and would be
    // asked at every report otherwise.
    let ended = match io {
        Stream::Plain(tcp) => {
            let (read_half, write_half) = tcp.into_split();
            // Nobody else sets it.
            let _ = lane.half.set(write_half);
            let mut writer = tokio::spawn(write_rest(Arc::clone(&lane), outbox, close));
            let ended = tokio::select! {
                ended = hear(read_half, codec, read_buf, ears, &lane) => ended,
                _ = &mut writer => Ok(CLOSED.to_owned()),
            };
            writer.abort();
            ended.inspect_err(|fault| say_goodbye(&lane, fault))
        }
        Stream::Encrypted { bytes, .. } => {
            let (read_half, write_half) = tokio::io::split(bytes);
            let (say_last, last_words) = oneshot::channel();
            let mut writer = tokio::spawn(write_encrypted(write_half, outbox, close, last_words));
            let ended = tokio::select! {
                ended = hear(read_half, codec, read_buf, ears, &lane) => ended,
                _ = &mut writer => Ok(CLOSED.to_owned()),
            };
            if let Err(fault) = &ended {
                // A peer that reads nothing is told nothing.
                let _ = say_last.send(goodbye(fault));
                let _ = tokio::time::timeout(DRAIN_TIME_MAX, &mut writer).await;
            }
            writer.abort();
            ended
        }
    };
    ended.unwrap_or_else(|fault| fault)
}

/// Why a connection ended that this end has closed.
const CLOSED: &str = "the manager closed the connection";

/// Tells the core what the server says, until there is no more to hear; says why.
///
/// # Errors
/// Says what the server did that it must not.
async fn hear(
    read_half: impl AsyncRead + Unpin,
    codec: LengthDelimitedCodec,
    // What the peer sent behind its hello.
    read_buf: BytesMut,
    Ears { session, events, started }: Ears<'_>,
    lane: &DirectWriter,
) -> Result<String, String> {
    let mut stream = FramedRead::new(read_half, codec);
    *stream.read_buffer_mut() = read_buf;
    loop {
        let bytes = match stream.next().await {
            None => return Ok("it closed the connection".to_owned()),
            // Too long a message too.
            Some(Err(error)) => return Err(format!("the connection failed: {error}")),
            Some(Ok(bytes)) => bytes,
        };
        // Whoever is slow to look at it, this server lives.
        lane.heard.store(started.elapsed().as_micros() as Micros, Ordering::Relaxed);
        let status = match polyptych_protocol::framing::decode::<ServerMessage>(&bytes) {
            Ok(status) => status,
            Err(error) => return Err(format!("it sent something malformed: {error}")),
        };
        let says = Event::ServerSays { from: session, status, bytes: bytes.len() };
        if events.send(says).await.is_err() {
            return Ok("the manager ends".to_owned());
        }
    }
}
