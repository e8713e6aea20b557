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

/// Hands out what comes, until the other end says that it is over, or says nothing for too long.
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

#[cfg(test)]
mod tests {
    use std::future::ready;
    use std::pin::Pin;
    use std::task::{Context, Poll};

    use polyptych_protocol::framing::{decode, frames};
    use polyptych_protocol::handshake::Welcome;
    use polyptych_protocol::ids::{Epoch, RequestId, Term};
    use polyptych_protocol::limits::{
        CLIENT_HEARTBEAT_PERIOD, MANAGER_SILENCE_MAX, MESSAGE_BYTES_MAX,
    };
    use polyptych_protocol::request::{Request, RequestError, RequestMessage, Response};
    use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream, ReadBuf, duplex};
    use tokio::time::advance;

    use super::*;
    use crate::client::Client;
    use crate::connect::{ConnectOptions, limit_silence};
    use crate::connection_handle::ConnectionHandle;
    use crate::reconnect::ReconnectPolicy;

    /// The manager's end of a connection.
    struct Manager(MessageStream<DuplexStream>);

    impl Manager {
        /// Waits for the next request, which must be this one.
        async fn expect(&mut self, expected: Request) -> RequestId {
            let bytes = self.0.next().await.expect("a request").expect("whole");
            let message = decode::<RequestMessage>(&bytes).expect("a request");
            assert_eq!(message.request, expected);
            message.id
        }

        async fn send(&mut self, message: MessageToClient) {
            self.0.send(polyptych_codec::encode(&message)).await.expect("sent");
        }

        async fn done(&mut self, id: RequestId) {
            self.send(MessageToClient::Reply { id, reply: Ok(Response::Done) }).await;
        }
    }

    fn open_scene() -> Request {
        Request::OpenScene { path: "a.glb".into(), scene: None }
    }

    /// Both ends of a connection, with or without other managers.
    fn connect(
        session: u64,
        heartbeat_ms: u32,
        has_standby: bool,
    ) -> (HandshakeResult<DuplexStream>, Manager) {
        let (ours, theirs) = duplex(1 << 16);
        let stream = StallLimit::new(ours, WRITE_TIME_MAX);
        let wall = "lab".to_owned();
        let welcome = Welcome { epoch: Epoch(7), term: Term(1), session, wall, heartbeat_ms };
        let introduced = (MessageStream::new(stream, frames(MESSAGE_BYTES_MAX)), welcome);
        let manager = Manager(MessageStream::new(theirs, frames(MESSAGE_BYTES_MAX)));
        (limit_silence(introduced, has_standby), manager)
    }

    /// A client that has these connections, one after the other.
    fn start(connections: Vec<HandshakeResult<DuplexStream>>) -> Client {
        let mut connections = connections.into_iter();
        let (stream, welcome) = connections.next().expect("a first one");
        let reconnect = ReconnectPolicy::default();
        let options =
            ConnectOptions { reconnect: Some(reconnect), ..ConnectOptions::new("one,two") };
        let (link, messages) = ConnectionHandle::new(options, welcome);
        let refused =
            || ClientError::Refused { address: "two".into(), reason: "it does not lead".into() };
        let dial = move || ready(connections.next().ok_or_else(refused));
        let redial = Reconnector { reconnect, dial, has_standby: true };
        tokio::spawn(run_connection(stream, link.shared.clone(), messages, Some(redial)));
        Client::from_link(link)
    }

    #[tokio::test(start_paused = true)]
    async fn a_manager_that_falls_silent_is_left_for_the_next() {
        let (first, mut hangs) = connect(1, 2000, true);
        let (second, mut next) = connect(2, 2000, true);
        let client = start(vec![first, second]);
        let begin = Instant::now();
        let pause = client.submit(Request::Pause).expect("posted");
        let scene = client.submit(open_scene()).expect("posted");
        hangs.expect(Request::Pause).await;
        let of = hangs.expect(open_scene()).await;

        let error = pause.await.expect_err("no answer");
        assert!(matches!(error, ClientError::ConnectionLost { .. }), "{error}");
        assert!(error.is_outcome_unknown());
        assert!(error.to_string().contains("it has sent nothing for 5 s"), "{error}");
        assert_eq!(begin.elapsed().as_secs(), 5);
        let close = client.submit(Request::CloseScene).expect("posted");
        // It may be the same manager, which was stopped for a while: that is asked what it did.
        assert_eq!(next.expect(Request::OpenOutcome { session: 1, of }).await, of);
        let id = next.expect(Request::CloseScene).await;
        let refused = Err(RequestError::new("no such file"));
        next.send(MessageToClient::Reply { id: of, reply: refused }).await;
        next.done(id).await;
        assert!(matches!(scene.await, Err(ClientError::Failed { .. })));
        assert_eq!(close.await.expect("done"), Response::Done);
        assert_eq!((client.close_reason(), client.pending_requests()), (None, 0));
        assert!(hangs.0.next().await.is_none(), "it is sent nothing any more");
    }

    #[tokio::test(start_paused = true)]
    async fn a_manager_that_says_little_and_answers_late_is_not_left() {
        let (connection, mut manager) = connect(1, 2000, true);
        let client = start(vec![connection]);
        let scene = client.submit(open_scene()).expect("posted");
        let id = manager.expect(open_scene()).await;
        let almost = MANAGER_SILENCE_MAX.saturating_sub(CLIENT_HEARTBEAT_PERIOD);
        for _ in 0..10 {
            advance(almost).await;
            manager.send(MessageToClient::Heartbeat).await;
        }
        // Each byte counts: a long message may take its time.
        let answer = MessageToClient::Reply { id, reply: Ok(Response::Done) };
        for byte in polyptych_codec::framed(&polyptych_codec::encode(&answer)) {
            advance(almost).await;
            manager.0.get_mut().write_all(&[byte]).await.expect("sent");
        }
        assert_eq!(scene.await.expect("answered"), Response::Done);
        assert_eq!(client.close_reason(), None);
    }

    /// A stream whose bytes are seen at the third look, as by a process that stood still.
    struct SeenLate(u32);

    impl AsyncRead for SeenLate {
        fn poll_read(
            mut self: Pin<&mut Self>,
            _context: &mut Context<'_>,
            buffer: &mut ReadBuf<'_>,
        ) -> Poll<io::Result<()>> {
            self.0 += 1;
            if self.0 < 3 {
                return Poll::Pending;
            }
            buffer.put_slice(b"beat");
            Poll::Ready(Ok(()))
        }
    }

    #[tokio::test(start_paused = true)]
    async fn what_came_while_the_client_stood_still_is_seen() {
        let mut stream = StallLimit::new(SeenLate(0), WRITE_TIME_MAX);
        stream.limit_silence(MANAGER_SILENCE_MAX);
        let mut bytes = [0; 4];
        stream.read_exact(&mut bytes).await.expect("the manager is not silent");
        assert_eq!(&bytes, b"beat");
    }

    #[tokio::test(start_paused = true)]
    async fn silence_is_borne_of_the_only_manager_and_by_walls_with_patience() {
        for (heartbeat_ms, has_standby) in [(2000, false), (60_000, true)] {
            let (connection, mut manager) = connect(1, heartbeat_ms, has_standby);
            let client = start(vec![connection]);
            let pause = client.submit(Request::Pause).expect("posted");
            let id = manager.expect(Request::Pause).await;
            for _ in 0..4 {
                advance(MANAGER_SILENCE_MAX).await;
            }
            manager.done(id).await;
            assert_eq!(pause.await.expect("answered"), Response::Done);
            assert_eq!(client.close_reason(), None);
        }
    }
}
