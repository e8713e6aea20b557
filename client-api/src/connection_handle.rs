//! The state that callers and the connection task share: the table of open requests, the queue of
//! messages to send, the subscribers, and the reason of the end.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use bytes::Bytes;
use polyptych_protocol::delivery::Delivery;
use polyptych_protocol::feedback::FrameFeedback;
use polyptych_protocol::handshake::Welcome;
use polyptych_protocol::ids::{Epoch, RequestId};
use polyptych_protocol::limits::CALL_BYTES_MAX;
use polyptych_protocol::progress::OpenProgress;
use polyptych_protocol::request::{ReplyChunk, Request, RequestError, RequestMessage, Response};
use tokio::sync::{Notify, broadcast, mpsc, oneshot, watch};

use crate::connect::ConnectOptions;
use crate::error::{ClientError, wrong_answer};
use crate::feedback::{FEEDBACK_QUEUE_MAX, FeedbackStream, TaggedFeedback};
use crate::image::ChunkSink;
use crate::in_flight::{InFlight, OPEN_REQUESTS_MAX, OpenRequest};
use crate::outgoing::{Outgoing, OutgoingQueue};
use crate::pending::{CompletedResponse, Pending};

/// The callers' end of a connection. The connection is closed when the last one is dropped.
#[derive(Clone, Debug)]
pub(crate) struct ConnectionHandle {
    pub shared: Arc<Shared>,
    outgoing: mpsc::Sender<Outgoing>,
}

/// Known to the callers and to the connection task.
#[derive(Debug)]
pub(crate) struct Shared {
    pub address: String,
    /// The wall's name; a manager of another one is not the one that was meant.
    pub wall: String,
    /// Told when a connection is there, or will never be.
    pub connection_changed: Notify,
    /// Told when a request may have made the next deadline an earlier one.
    pub deadline_moved: Notify,
    options: ConnectOptions,
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    open: InFlight<Waiter>,
    /// `None` once the connection has ended, so that the readers end too.
    feedback: Option<broadcast::Sender<TaggedFeedback>>,
    subscribers: usize,
    /// The life of the manager that this client talks to, or has talked to last.
    epoch: Epoch,
    /// Counts the connections.
    connection: u64,
    /// The present or last connection, as the manager names it.
    session: u64,
    /// `true` if this client has asked the manager to end; it then makes no other connection.
    has_stopped: bool,
    /// The reason why there is no connection now, while another one is tried.
    lost: Option<CloseReason>,
    /// The time until which what was posted before the last loss, and not sent, may be sent.
    unsent_until: Option<Instant>,
    /// The reason why the client has ended.
    end: Option<CloseReason>,
}

/// The reason why a connection ended.
#[derive(Clone, Debug)]
pub(crate) struct CloseReason {
    /// For a person.
    pub reason: String,
    /// `true` if the manager said that it ends.
    pub is_goodbye: bool,
}

impl CloseReason {
    /// For any reason but a goodbye.
    pub fn lost(reason: impl Into<String>) -> Self {
        Self { reason: reason.into(), is_goodbye: false }
    }
}

/// The caller that waits for an answer, and the pieces that came until then, if they are wanted.
#[derive(Debug)]
struct Waiter {
    answer: oneshot::Sender<Result<CompletedResponse, ClientError>>,
    parts: Option<ChunkSink>,
    /// Holds the newest progress, for requests that tell theirs.
    progress: Option<watch::Sender<OpenProgress>>,
    /// `true` if the outcome can be asked for over another connection.
    is_job: bool,
    /// The connection that it was sent over, as the manager names it.
    session: u64,
}

/// The messages before a reply that are wanted, and when the request is begun.
#[derive(Debug, Default)]
pub(crate) struct Wanted {
    /// Pieces go here.
    pub parts: Option<ChunkSink>,
    /// The newest progress goes here.
    pub progress: Option<watch::Sender<OpenProgress>>,
    /// The condition for beginning the request.
    pub delivery: Delivery,
}

impl ConnectionHandle {
    /// A new connection's, with the queue that the connection task empties.
    pub fn new(options: ConnectOptions, welcome: Welcome) -> (Self, OutgoingQueue) {
        // A message may wait after its request was given up, so this queue can be full before
        // the table is; both then say the same.
        let (outgoing, messages) = mpsc::channel(OPEN_REQUESTS_MAX);
        let state = State {
            open: InFlight::new(),
            feedback: Some(broadcast::Sender::new(FEEDBACK_QUEUE_MAX)),
            subscribers: 0,
            epoch: welcome.epoch,
            connection: 0,
            session: welcome.session,
            has_stopped: false,
            lost: None,
            unsent_until: None,
            end: None,
        };
        let shared = Shared {
            address: options.address.clone(),
            wall: welcome.wall,
            connection_changed: Notify::new(),
            deadline_moved: Notify::new(),
            options,
            state: Mutex::new(state),
        };
        (Self { shared: Arc::new(shared), outgoing }, OutgoingQueue::new(messages))
    }

    /// Sends a request without waiting for its answer.
    pub fn post(&self, request: Request, wanted: Wanted) -> Result<Pending, ClientError> {
        self.post_in(&mut self.shared.lock(), request, wanted)
    }

    /// Under the caller's lock, so that requests leave in the order of their numbers.
    fn post_in(
        &self,
        state: &mut State,
        request: Request,
        wanted: Wanted,
    ) -> Result<Pending, ClientError> {
        let name = request.name();
        let shared = &self.shared;
        if let Some(end) = &state.end {
            let (address, reason) = (shared.address.clone(), end.reason.clone());
            return Err(ClientError::Closed { request: name, address, reason });
        }
        let (answer, receiver) = oneshot::channel();
        let Wanted { parts, progress, delivery } = wanted;
        let after = match delivery {
            Delivery::Immediate => shared.options.timeouts.of(&request),
            // It has none for its turn to come.
            Delivery::Queued { .. } => Duration::MAX,
        };
        // tokio's clock, which tests own.
        let now = tokio::time::Instant::now().into_std();
        let full = || ClientError::TooManyOpen { request: name, limit: OPEN_REQUESTS_MAX };
        let is_job = matches!(request, Request::OpenScene { .. } | Request::OpenSession { .. });
        let waiter = Waiter { answer, parts, progress, is_job, session: 0 };
        // Without a connection it waits for one first.
        let first_after = if state.lost.is_some() { shared.wait() } else { after };
        let id = state.open.insert(now, name, first_after, waiter).ok_or_else(full)?;

        let is_stop = matches!(request, Request::Stop | Request::StopServers);
        let message = polyptych_codec::encode(&RequestMessage { id, request, delivery });
        let (bytes, limit) = (message.len(), CALL_BYTES_MAX);
        let sent = if bytes > limit {
            Err(ClientError::RequestTooLarge { request: name, bytes, limit })
        } else {
            let until = state.lost.as_ref().and_then(|_| now.checked_add(shared.wait()));
            let connection = state.connection;
            let outgoing = Outgoing { id, connection, until, after, is_stop, bytes: message };
            self.outgoing.try_send(outgoing).map_err(|_| full())
        };
        if let Err(error) = sent {
            state.open.remove(id);
            return Err(error);
        }
        shared.deadline_moved.notify_one();
        Ok(Pending::new(id, name, receiver, self.clone()))
    }

    /// Subscribes to the feedback of every frame.
    pub async fn subscribe(&self) -> Result<FeedbackStream, ClientError> {
        let (receiver, connection, epoch, posted) = {
            let state = &mut *self.shared.lock();
            // After the end, posting fails, and the receiver only has to exist.
            let receiver = match &state.feedback {
                Some(sender) => sender.subscribe(),
                None => broadcast::Sender::new(1).subscribe(),
            };
            state.subscribers += 1;
            let (connection, epoch) = (state.connection, state.epoch);
            let posted = self.post_in(state, Request::Subscribe(true), Wanted::default());
            (receiver, connection, epoch, posted)
        };
        let feedbacks = FeedbackStream::new(receiver, connection, epoch, self.clone());
        match posted?.await? {
            Response::Done => Ok(feedbacks),
            other => Err(wrong_answer("subscribe to feedback", &other)),
        }
    }

    /// A subscriber leaves; the last one ends the subscription.
    pub fn unsubscribe(&self) {
        let posted = {
            let state = &mut *self.shared.lock();
            state.subscribers = state.subscribers.saturating_sub(1);
            if state.subscribers > 0 || state.end.is_some() {
                return;
            }
            self.post_in(state, Request::Subscribe(false), Wanted::default())
        };
        if let Err(error) = posted {
            tracing::debug!(%error, "feedback goes on coming and is ignored");
        }
    }
}

impl State {
    /// Returns whether a request may still be sent: it must not once its time to wait for a
    /// connection or for those before it is over, since callers have then given it up.
    fn is_due(&mut self, now: Instant, outgoing: &Outgoing) -> bool {
        if self.open.take_unsent(outgoing.id) {
            return false;
        }
        let is_older = self.lost.is_some() || outgoing.connection != self.connection;
        let unsent_until = || self.unsent_until.filter(|_| is_older);
        // A caller may have dropped the answer, and wants the request done all the same.
        let until = self.open.deadline(outgoing.id).or(outgoing.until).or_else(unsent_until);
        until.is_none_or(|until| now < until)
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        // Whoever panicked here left a table that is whole: each change is one call.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The caller does not want this answer any more.
    pub fn forget(&self, id: RequestId) {
        let _forgotten = self.lock().open.remove(id);
    }

    /// Returns the number of requests that wait for their answers.
    pub fn open_requests(&self) -> usize {
        self.lock().open.len()
    }

    /// Returns the reason why there is no connection; `None` while there is one.
    pub fn end_reason(&self) -> Option<String> {
        let state = self.lock();
        state.end.as_ref().or(state.lost.as_ref()).map(|end| end.reason.clone())
    }

    /// The life of the manager.
    pub fn epoch(&self) -> Epoch {
        self.lock().epoch
    }

    /// The life of the manager where there is a connection, `None` where one is tried.
    ///
    /// # Errors
    /// The reason why there will be none.
    pub fn connection(&self) -> Result<Option<Epoch>, ClientError> {
        let state = self.lock();
        let closed = |end: &CloseReason| ClientError::Closed {
            request: "wait for a connection",
            address: self.address.clone(),
            reason: end.reason.clone(),
        };
        state.end.as_ref().map_or(Ok(()), |end| Err(closed(end)))?;
        Ok(state.lost.is_none().then_some(state.epoch))
    }

    /// Returns whether a connection that has ended is to be made again.
    pub fn wants_connection(&self) -> bool {
        !self.lock().has_stopped
    }

    /// Returns the time that a request waits for a connection.
    fn wait(&self) -> Duration {
        self.options.reconnect.map_or(Duration::ZERO, |reconnect| reconnect.wait)
    }

    /// Returns whether this request may still be sent.
    pub fn is_due(&self, outgoing: &Outgoing) -> bool {
        self.lock().is_due(tokio::time::Instant::now().into_std(), outgoing)
    }

    /// The bytes of a request that is to be sent now; `None` where it waited too long.
    pub fn take_to_send(&self, outgoing: Outgoing) -> Option<Bytes> {
        let now = tokio::time::Instant::now().into_std();
        let state = &mut *self.lock();
        let is_due = state.is_due(now, &outgoing);
        state.has_stopped |= is_due && outgoing.is_stop;
        state.open.send(now, outgoing.id, outgoing.after);
        let session = state.session;
        if let Some(waiter) = state.open.waiter_mut(outgoing.id) {
            waiter.session = session;
        }
        self.deadline_moved.notify_one();
        is_due.then_some(outgoing.bytes)
    }

    /// The connection has ended, and another one is tried. What was sent is told so, once; what
    /// can be asked for over the next connection waits for it, unless the manager has ended.
    pub fn handle_loss(&self, end: &CloseReason) {
        let now = tokio::time::Instant::now().into_std();
        let sent = {
            let state = &mut *self.lock();
            state.lost = Some(end.clone());
            state.unsent_until = now.checked_add(self.wait());
            state.open.postpone_unsent(now, self.wait());
            state.open.drain_sent(|waiter| !waiter.is_job || end.is_goodbye)
        };
        self.deadline_moved.notify_one();
        self.tell_of_end(sent, end);
    }

    /// Stores the reason why the last attempt to connect has failed.
    pub fn note_reason(&self, reason: &str) {
        self.lock().lost = Some(CloseReason::lost(reason));
    }

    /// There is a connection again. Returns what must be sent first.
    pub fn handle_connected(&self, welcome: &Welcome) -> Vec<Bytes> {
        let (greeting, gone, lost) = {
            let state = &mut *self.lock();
            let lost = state.lost.take();
            let is_same = state.epoch == welcome.epoch;
            state.epoch = welcome.epoch;
            state.connection += 1;
            state.session = welcome.session;
            // Another epoch knows nothing of what was asked in the last one.
            let gone = state.open.drain_sent(|_| !is_same);
            let asked = |(id, waiter): (RequestId, &Waiter)| {
                let request = Request::OpenOutcome { session: waiter.session, of: id };
                polyptych_codec::encode(&RequestMessage::new(id, request))
            };
            let mut greeting: Vec<Bytes> = state.open.sent().map(asked).collect();
            if state.subscribers > 0 {
                // Should it fail, the stream is silent, as that of a wall that draws nothing.
                let id = state.open.number();
                greeting.push(polyptych_codec::encode(&RequestMessage::new(
                    id,
                    Request::Subscribe(true),
                )));
            }
            (greeting, gone, lost)
        };
        if let Some(end) = lost {
            self.tell_of_end(gone, &end);
        }
        self.connection_changed.notify_waiters();
        greeting
    }

    /// An answer came.
    pub fn handle_reply(&self, id: RequestId, reply: Result<Response, RequestError>) {
        let Some(OpenRequest { request, waiter, .. }) = self.lock().open.remove(id) else {
            tracing::debug!(request = id.0, "an answer that nobody waits for");
            return;
        };
        let answer = match reply {
            Ok(reply) => Ok(CompletedResponse { reply, parts: waiter.parts }),
            Err(RequestError { reason }) => Err(ClientError::Failed { request, reason }),
        };
        deliver(waiter.answer, answer);
    }

    /// A request has come further: it has its time from now on.
    pub fn handle_progress(&self, id: RequestId, progress: OpenProgress) {
        let now = tokio::time::Instant::now().into_std();
        let mut state = self.lock();
        state.open.renew(now, id);
        let waiter = state.open.waiter_mut(id);
        if let Some(sender) = waiter.and_then(|waiter| waiter.progress.as_ref()) {
            sender.send_replace(progress);
        }
        drop(state);
        self.deadline_moved.notify_one();
    }

    /// A piece of what comes before a reply. Returns the queue that it is to be put into, if it
    /// is one of a file.
    pub fn handle_chunk(&self, part: ReplyChunk) -> Option<(mpsc::Sender<Bytes>, Bytes)> {
        let now = tokio::time::Instant::now().into_std();
        let mut state = self.lock();
        state.open.renew(now, part.id);
        self.deadline_moved.notify_one();
        let parts = state.open.waiter_mut(part.id).and_then(|waiter| waiter.parts.as_mut());
        let parts = match parts {
            Some(ChunkSink::Pictures(parts)) => parts,
            Some(ChunkSink::File(queue)) => return Some((queue.clone(), part.bytes)),
            None => {
                tracing::debug!(request = part.id.0, "a piece that nobody waits for");
                return None;
            }
        };
        let Err(error) = parts.add(part.index, &part.bytes) else { return None };
        let open = state.open.remove(part.id);
        drop(state);
        if let Some(open) = open {
            deliver(open.waiter.answer, Err(error));
        }
        None
    }

    /// Maximum bytes that the pictures of a capture may take.
    pub fn capture_bytes_max(&self) -> usize {
        self.options.capture_bytes_max
    }

    /// A frame's feedback came.
    pub fn handle_feedback(&self, feedback: FrameFeedback) {
        let (sender, epoch, connection) = {
            let state = self.lock();
            (state.feedback.clone(), state.epoch, state.connection)
        };
        if let Some(sender) = sender {
            // An error says that nobody subscribes any more, and the manager will know soon.
            let _readers =
                sender.send(TaggedFeedback { feedback: Arc::new(feedback), epoch, connection });
        }
    }

    /// Returns the time when [`Shared::handle_timeout`] must be called next.
    pub fn poll_timeout(&self) -> Option<Instant> {
        self.lock().open.next_deadline()
    }

    /// Tells those whose time is over.
    pub fn handle_timeout(&self, now: Instant) {
        loop {
            let (expired, lost) = {
                let state = &mut *self.lock();
                (state.open.expire(now), state.lost.clone())
            };
            let Some(OpenRequest { request, after, waiter, is_sent, .. }) = expired else { return };
            let error = match lost.filter(|_| !is_sent) {
                Some(CloseReason { reason, .. }) => {
                    let address = self.address.clone();
                    ClientError::NotConnected { request, address, after, reason }
                }
                None => ClientError::TimedOut { request, after },
            };
            deliver(waiter.answer, Err(error));
        }
    }

    /// Ends the client: every waiting request fails with this reason. The first reason holds.
    pub fn handle_end(&self, end: &CloseReason) {
        let (open, readers) = {
            let state = &mut *self.lock();
            if state.end.is_some() {
                return;
            }
            state.end = Some(end.clone());
            (state.open.drain().collect::<Vec<_>>(), state.feedback.take())
        };
        // The streams of feedback end.
        drop(readers);
        self.connection_changed.notify_waiters();
        self.tell_of_end(open, end);
    }

    fn tell_of_end(&self, open: Vec<OpenRequest<Waiter>>, end: &CloseReason) {
        for OpenRequest { request, waiter, is_sent, .. } in open {
            let (address, reason) = (self.address.clone(), end.reason.clone());
            let error = if !is_sent {
                ClientError::Closed { request, address, reason }
            } else if end.is_goodbye {
                ClientError::ManagerEnded { request, address, reason }
            } else {
                ClientError::ConnectionLost { request, address, reason }
            };
            deliver(waiter.answer, Err(error));
        }
    }
}

/// Delivers an answer; it is dropped if the caller has just given up.
fn deliver(
    waiter: oneshot::Sender<Result<CompletedResponse, ClientError>>,
    answer: Result<CompletedResponse, ClientError>,
) {
    let _unwanted = waiter.send(answer);
}
