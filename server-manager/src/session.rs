//! What all connections have in common: an outbox with a limit, and a way to the brain.

use std::time::Duration;

use bytes::Bytes;
use futures_util::SinkExt;
use futures_util::stream::SplitSink;
use polyptych_protocol::blob::PictureChunk;
use polyptych_protocol::connection::Frames;
use polyptych_protocol::handshake::{ServerHello, Welcome};
use polyptych_protocol::ids::RequestId;
use polyptych_protocol::request::Request;
use polyptych_protocol::status::Status;
use tokio::net::TcpStream;
use tokio::sync::{mpsc, oneshot};
use tokio_util::sync::CancellationToken;

use crate::cluster::SessionId;
use crate::server_session::ServerLink;

/// Most messages that wait to be sent to one peer. A server that stands still for two seconds at
/// 60 frames per second has 240; a peer beyond this reads too slowly and is let go.
pub(crate) const OUTBOX_MESSAGES_MAX: usize = 512;

/// Most events that wait for the brain: it handles one in microseconds.
pub(crate) const EVENTS_MAX: usize = 1024;

/// How long a closed connection may still send what waits for it.
pub(crate) const DRAIN_TIME_MAX: Duration = Duration::from_millis(300);

/// What connections tell the brain.
#[derive(Debug)]
pub(crate) enum Event {
    ServerJoins {
        hello: ServerHello,
        address: String,
        link: ServerLink,
        verdict: oneshot::Sender<Result<Welcome, String>>,
    },
    ServerSays {
        from: SessionId,
        status: Status,
        bytes: usize,
    },
    ClientJoins {
        name: String,
        link: Link,
        welcomed: oneshot::Sender<Welcome>,
    },
    ClientAsks {
        from: SessionId,
        id: RequestId,
        request: Request,
    },
    BulkJoins {
        session: SessionId,
        is_known: oneshot::Sender<bool>,
    },
    PictureComes {
        from: SessionId,
        chunk: PictureChunk,
    },
    Gone {
        session: SessionId,
        reason: String,
    },
}

/// The brain's end of a connection.
#[derive(Clone, Debug)]
pub(crate) struct Link {
    pub outbox: mpsc::Sender<Bytes>,
    /// Closes the connection after what is in the outbox.
    pub close: CancellationToken,
}

impl Link {
    pub fn new() -> (Self, mpsc::Receiver<Bytes>) {
        let (outbox, inbox) = mpsc::channel(OUTBOX_MESSAGES_MAX);
        (Self { outbox, close: CancellationToken::new() }, inbox)
    }
}

/// Sends what is in the outbox until the connection is closed from one side.
///
/// Once closed, what is in the outbox still goes out, as far as the peer takes it in
/// [`DRAIN_TIME_MAX`]: a peer that has stopped reading holds nothing.
pub(crate) async fn write_all(
    sink: SplitSink<Frames<TcpStream>, Bytes>,
    outbox: mpsc::Receiver<Bytes>,
    close: CancellationToken,
) {
    let hard_end = async {
        close.cancelled().await;
        tokio::time::sleep(DRAIN_TIME_MAX).await;
    };
    tokio::select! {
        () = write_until_closed(sink, outbox, &close) => {}
        () = hard_end => {}
    }
}

async fn write_until_closed(
    mut sink: SplitSink<Frames<TcpStream>, Bytes>,
    mut outbox: mpsc::Receiver<Bytes>,
    close: &CancellationToken,
) {
    loop {
        let message = tokio::select! {
            biased;
            message = outbox.recv() => message,
            () = close.cancelled() => None,
        };
        let Some(message) = message else { break };
        if sink.feed(message).await.is_err() {
            return;
        }
        // What waits already goes out in the same packets.
        while let Ok(next) = outbox.try_recv() {
            if sink.feed(next).await.is_err() {
                return;
            }
        }
        if sink.flush().await.is_err() {
            return;
        }
    }
    // A peer that is gone already needs no goodbye.
    let _ = sink.close().await;
}
