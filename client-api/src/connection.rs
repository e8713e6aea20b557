//! The one task that owns a client's connections, one after the other: it writes what callers
//! post, hands out what comes, and tells those whose time is over. The three never wait for each
//! other.

use std::io;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use futures_util::stream::{SplitSink, SplitStream};
use futures_util::{SinkExt, StreamExt};
use polyptych_protocol::handshake_io::MessageStream;
use polyptych_protocol::request::MessageToClient;
use polyptych_protocol::stall_limit::StallLimit;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::time::{Instant, sleep_until, timeout};

use crate::connection_handle::{CloseReason, Shared};
use crate::error::ClientError;
use crate::outgoing::OutgoingQueue;
use crate::reconnect::{HandshakeResult, Reconnector};

/// A manager that takes nothing for so long is gone, or as good as.
pub(crate) const WRITE_TIME_MAX: Duration = Duration::from_secs(30);

/// The time that the other end may take to close, so that a reset does not cut off the last
/// messages, and its goodbye is received.
const CLOSE_TIME_MAX: Duration = Duration::from_secs(1);

/// Runs a connection until it ends, and further ones if it may be made again; then fails all
/// waiting requests.
pub(crate) fn run_connection<S, D, F>(
    frames: MessageStream<StallLimit<S>>,
    shared: Arc<Shared>,
    messages: OutgoingQueue,
    redial: Option<Reconnector<D>>,
) -> impl Future<Output = ()>
where
    S: AsyncRead + AsyncWrite + Unpin,
    D: FnMut() -> F,
    F: Future<Output = Result<HandshakeResult<S>, ClientError>>,
{
    // Made before the first poll: a runtime may be shut down before it comes to that.
    let guard = CloseOnDrop(shared);
    async move {
        let shared = &*guard.0;
        let end = tokio::select! {
            end = run(frames, shared, messages, redial) => end,
            end = expire(shared) => end,
        };
        shared.handle_end(&end);
    }
}

async fn run<S, D, F>(
    mut frames: MessageStream<StallLimit<S>>,
    shared: &Shared,
    mut messages: OutgoingQueue,
    mut redial: Option<Reconnector<D>>,
) -> CloseReason
where
    S: AsyncRead + AsyncWrite + Unpin,
    D: FnMut() -> F,
    F: Future<Output = Result<HandshakeResult<S>, ClientError>>,
{
    let mut greeting = Vec::new();
    loop {
        let (end, is_wanted) = serve(frames, shared, greeting, &mut messages).await;
        tracing::debug!(address = shared.address, reason = end.reason, "the connection ended");
        let is_wanted = is_wanted && shared.wants_connection();
        let Some(redial) = redial.as_mut().filter(|_| is_wanted) else { return end };
        shared.handle_loss(&end);
        let welcome;
        (frames, welcome) = match redial.connect(shared, &mut messages).await {
            Ok(introduced) => introduced,
            Err(end) => return end,
        };
        tracing::info!(address = shared.address, epoch = %welcome.epoch, "connected again");
        greeting = shared.handle_connected(&welcome);
    }
}

/// Runs one connection. Gives why it ended, and whether another one is wanted.
async fn serve<S>(
    frames: MessageStream<S>,
    shared: &Shared,
    greeting: Vec<Bytes>,
    messages: &mut OutgoingQueue,
) -> (CloseReason, bool)
where
    S: AsyncRead + AsyncWrite + Unpin,
{
    let (sink, stream) = frames.split();
    let mut reading = pin!(read(stream, shared));
    tokio::select! {
        end = &mut reading => (end, true),
        written = write(sink, shared, greeting, messages) => {
            let heard = timeout(CLOSE_TIME_MAX, reading).await;
            match (written, heard) {
                (Err(_), Ok(end)) => (end, true),
                (Err(error), Err(_)) => (CloseReason::lost(error.to_string()), true),
                (Ok(()), _) => (CloseReason::lost("this client closed it"), false),
            }
        }
    }
}

/// Ends the connection when its future is dropped with its runtime, so that no caller waits
/// indefinitely.
struct CloseOnDrop(Arc<Shared>);

impl Drop for CloseOnDrop {
    fn drop(&mut self) {
        self.0.handle_end(&CloseReason::lost("the client's runtime was shut down"));
    }
}

/// Hands out what comes, until the other end says that it is over.
async fn read<S>(mut stream: SplitStream<MessageStream<S>>, shared: &Shared) -> CloseReason
where
    S: AsyncRead + AsyncWrite + Unpin,
{
    loop {
        let bytes = match stream.next().await {
            Some(Ok(bytes)) => bytes,
            Some(Err(error)) => return CloseReason::lost(error.to_string()),
            None => return CloseReason::lost("the manager closed it"),
        };
        match polyptych_protocol::framing::decode::<MessageToClient>(&bytes) {
            Ok(MessageToClient::Reply { id, reply }) => shared.handle_reply(id, reply),
            Ok(MessageToClient::Feedback(feedback)) => shared.handle_feedback(feedback),
            Ok(MessageToClient::Chunk(part)) => {
                if let Some((queue, piece)) = shared.handle_chunk(part) {
                    // Until the caller has written enough; one that gave up holds nothing up.
                    let _given_up = queue.send(piece).await;
                }
            }
            Ok(MessageToClient::Progress { id, progress }) => shared.handle_progress(id, progress),
            Ok(MessageToClient::Warning { warning, .. }) => tracing::warn!("{warning}"),
            // Its bytes have come, which is all that it says.
            Ok(MessageToClient::Heartbeat) => {}
            Ok(MessageToClient::Goodbye(goodbye)) => {
                return CloseReason { reason: goodbye.to_string(), is_goodbye: true };
            }
            Err(error) => return CloseReason::lost(format!("a message made no sense: {error}")),
        }
    }
}

/// Writes the greeting and what callers post, until the last caller is gone.
async fn write<S>(
    mut sink: SplitSink<MessageStream<S>, Bytes>,
    shared: &Shared,
    greeting: Vec<Bytes>,
    messages: &mut OutgoingQueue,
) -> io::Result<()>
where
    S: AsyncRead + AsyncWrite + Unpin,
{
    let mut greeting = greeting.into_iter();
    loop {
        let first = match greeting.next() {
            Some(greeting) => Some(greeting),
            None => match messages.recv().await {
                Some(outgoing) => shared.take_to_send(outgoing),
                None => break,
            },
        };
        if let Some(first) = first {
            sink.feed(first).await?;
        }
        // What was posted together travels together.
        while let Some(outgoing) = messages.try_recv() {
            if let Some(message) = shared.take_to_send(outgoing) {
                sink.feed(message).await?;
            }
        }
        sink.flush().await?;
    }
    // Where it can't be closed it is closed already.
    let _closed = timeout(CLOSE_TIME_MAX, sink.close()).await;
    Ok(())
}

/// Fails requests whose time is over, indefinitely.
async fn expire(shared: &Shared) -> CloseReason {
    loop {
        let moved = shared.deadline_moved.notified();
        match shared.poll_timeout() {
            None => moved.await,
            Some(deadline) => {
                tokio::select! {
                    () = moved => {}
                    () = sleep_until(Instant::from_std(deadline)) => {
                        shared.handle_timeout(Instant::now().into_std());
                    }
                }
            }
        }
    }
}
