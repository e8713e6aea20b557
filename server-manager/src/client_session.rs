//! A client's connection.

use std::sync::Arc;

use futures_util::StreamExt;
use polyptych_core::SessionId;
use polyptych_protocol::delivery::Delivery;
use polyptych_protocol::handshake::Proof;
use polyptych_protocol::handshake_io::{self, MessageStream};
use polyptych_protocol::limits::CALL_BYTES_MAX;
use polyptych_protocol::request::RequestMessage;
use polyptych_protocol::stream::Stream;
use tokio::io::ReadHalf;
use tokio::sync::{Semaphore, mpsc, oneshot, watch};
use tokio_util::codec::{FramedParts, FramedRead, FramedWrite, LengthDelimitedCodec};

use crate::requests::{
    Asked, QUEUED_BYTES_MIN, REQUEST_BYTES_MAX, REQUEST_BYTES_MIN, RequestQueues,
};
use crate::session::{ClientHandle, Event, write_all};

/// A client that may come in.
pub(crate) struct Visitor {
    pub frames: MessageStream<Stream>,
    /// The manager's, for its welcome.
    pub proof: Proof,
    pub name: String,
    /// `true` if it is on the manager's machine.
    pub is_local: bool,
}

/// Serves one connection until it ends.
pub(crate) async fn serve(
    visitor: Visitor,
    events: mpsc::Sender<Event>,
    queues: RequestQueues,
    heartbeats: watch::Receiver<()>,
) {
    let Visitor { mut frames, proof, name, is_local } = visitor;
    let (link, waiting) = ClientHandle::new();
    let close = link.close.clone();
    let (verdict, answer) = oneshot::channel();
    if events.send(Event::ClientJoins { name, is_local, link, verdict }).await.is_err() {
        return;
    }
    let welcome = match answer.await {
        Ok(Ok(welcome)) => welcome,
        Ok(Err(reason)) => {
            let _ = handshake_io::reject(&mut frames, reason).await;
            return;
        }
        Err(_) => return,
    };
    let session = SessionId(welcome.session);
    let reason = if handshake_io::accept(&mut frames, welcome, proof).await.is_ok() {
        let FramedParts { io, codec, read_buf, .. } = frames.into_parts();
        let (read_half, write_half) = tokio::io::split(io);
        // What clients ask is short, what they are sent is not.
        let mut stream =
            FramedRead::new(read_half, polyptych_protocol::framing::frames(CALL_BYTES_MAX));
        *stream.read_buffer_mut() = read_buf;
        let sink = FramedWrite::new(write_half, codec);
        tokio::select! {
            reason = hear(stream, session, &queues) => reason,
            reason = write_all(sink, waiting, heartbeats, close) => reason,
        }
    } else {
        "the connection failed during the handshake".to_owned()
    };
    queues.push(session, Asked::Gone(reason));
}

/// Puts requests into their queue until there is no more to hear; says why. Waiting for room in it
/// is the back-pressure on a client that asks too much.
async fn hear(
    mut stream: FramedRead<ReadHalf<Stream>, LengthDelimitedCodec>,
    session: SessionId,
    queues: &RequestQueues,
) -> String {
    let [room, queued_room] = [(); 2].map(|()| Arc::new(Semaphore::new(REQUEST_BYTES_MAX)));
    loop {
        let bytes = match stream.next().await {
            None => return "it closed the connection".to_owned(),
            Some(Err(error)) => return format!("the connection failed: {error}"),
            Some(Ok(bytes)) => bytes,
        };
        let call: RequestMessage = match polyptych_protocol::framing::decode(&bytes) {
            Ok(call) => call,
            Err(error) => return format!("it sent something malformed: {error}"),
        };
        if call.delivery != Delivery::Immediate {
            // Waiting for room here would hold up what must not wait.
            let share = bytes.len().clamp(QUEUED_BYTES_MIN, REQUEST_BYTES_MAX) as u32;
            let asked = match Arc::clone(&queued_room).try_acquire_many_owned(share) {
                Ok(share) => Asked::Call(call, share),
                Err(_) => Asked::Beyond(call.id),
            };
            queues.push(session, asked);
            continue;
        }
        let share = bytes.len().clamp(REQUEST_BYTES_MIN, REQUEST_BYTES_MAX) as u32;
        let Ok(share) = Arc::clone(&room).acquire_many_owned(share).await else {
            return "the manager ends".to_owned();
        };
        queues.push(session, Asked::Call(call, share));
    }
}
