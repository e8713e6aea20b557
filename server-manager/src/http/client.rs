//! A client of the event loop that HTTP speaks for: it joins, asks one thing at a time, and leaves
//! when it is dropped.

use std::net::SocketAddr;
use std::sync::Arc;

use hyper::StatusCode;
use polyptych_core::SessionId;
use polyptych_protocol::framing;
use polyptych_protocol::ids::RequestId;
use polyptych_protocol::limits::CALL_BYTES_MAX;
use polyptych_protocol::request::{MessageToClient, Request, RequestMessage, Response};
use tokio::sync::{Semaphore, mpsc};
use tokio_util::sync::CancellationToken;

use super::answer::Refusal;
use crate::requests::{Asked, REQUEST_BYTES_MAX, REQUEST_BYTES_MIN, RequestQueues};
use crate::session::{ClientHandle, Event, OutboxReceiver};

/// A client, until it is dropped.
#[derive(Debug)]
pub(super) struct HttpClient {
    session: SessionId,
    waiting: OutboxReceiver,
    close: CancellationToken,
    queues: RequestQueues,
    room: Arc<Semaphore>,
    last: u64,
}

/// The outcome of a request.
#[derive(Debug)]
pub(super) struct Answered {
    pub response: Response,
    /// Warnings for its sender.
    pub warnings: Vec<String>,
    /// The bytes of pictures or of a file, by their place in the response.
    pub pieces: Vec<Vec<u8>>,
}

impl HttpClient {
    /// Joins the wall's clients.
    ///
    /// # Errors
    /// 503, where there is no place.
    pub async fn join(
        events: &mpsc::Sender<Event>,
        queues: &RequestQueues,
        name: String,
        address: Option<SocketAddr>,
    ) -> Result<Self, Refusal> {
        let (link, waiting) = ClientHandle::new();
        let close = link.close.clone();
        let welcome = super::join(events, name, address, link).await;
        let welcome = welcome.map_err(Refusal::unavailable)?;
        Ok(Self {
            session: SessionId(welcome.session),
            waiting,
            close,
            queues: queues.clone(),
            room: Arc::new(Semaphore::new(REQUEST_BYTES_MAX)),
            last: 0,
        })
    }

    /// Returns whether the manager has ended it meanwhile.
    pub fn is_over(&self) -> bool {
        self.close.is_cancelled()
    }

    /// Sends a request. Returns its number.
    ///
    /// # Errors
    /// 413, where it is larger than on TCP.
    pub async fn send(&mut self, request: Request) -> Result<RequestId, Refusal> {
        self.last += 1;
        let id = RequestId(self.last);
        let message = RequestMessage::new(id, request);
        let bytes = polyptych_codec::encode(&message).len();
        if bytes > CALL_BYTES_MAX {
            let reason =
                format!("a request takes at most {CALL_BYTES_MAX} bytes, and this one {bytes}");
            return Err(Refusal::new(StatusCode::PAYLOAD_TOO_LARGE, reason));
        }
        let share = bytes.clamp(REQUEST_BYTES_MIN, REQUEST_BYTES_MAX) as u32;
        let share = Arc::clone(&self.room).acquire_many_owned(share).await;
        let share = share.map_err(|_| Refusal::unavailable("the manager ends"))?;
        self.queues.push(self.session, Asked::Call(message, share));
        Ok(id)
    }

    /// Waits for the next message.
    ///
    /// # Errors
    /// 503, where the manager ends the client.
    pub async fn next(&mut self) -> Result<MessageToClient, Refusal> {
        let over = || Refusal::unavailable("the manager ended this client; ask again");
        let bytes = tokio::select! {
            biased;
            bytes = self.waiting.next() => bytes.ok_or_else(over)?,
            () = self.close.cancelled() => return Err(over()),
        };
        match framing::decode(&bytes) {
            Ok(MessageToClient::Goodbye(goodbye)) => {
                Err(Refusal::unavailable(format!("the manager ended this client: {goodbye}")))
            }
            Ok(message) => Ok(message),
            Err(error) => Err(Refusal::unavailable(format!("an answer is malformed: {error}"))),
        }
    }

    /// Sends a request and waits for all of its answer.
    ///
    /// # Errors
    /// The manager's refusal, or those of [`Self::send`]; 504, where the manager ends meanwhile.
    pub async fn ask(&mut self, request: Request) -> Result<Answered, Refusal> {
        let asked = self.send(request).await?;
        let (mut warnings, mut pieces) = (Vec::new(), Vec::<Vec<u8>>::new());
        loop {
            match self.next().await.map_err(Refusal::outcome_unknown)? {
                MessageToClient::Reply { id, reply } if id == asked => {
                    return Ok(Answered { response: reply?, warnings, pieces });
                }
                MessageToClient::Warning { id, warning } if id == asked => warnings.push(warning),
                MessageToClient::Chunk(chunk) if chunk.id == asked => {
                    let index = chunk.index as usize;
                    if index >= pieces.len() {
                        pieces.resize_with(index + 1, Vec::new);
                    }
                    pieces[index].extend_from_slice(&chunk.bytes);
                }
                // Of a request whose sender went away, or nothing that was asked for here.
                _ => {}
            }
        }
    }
}

impl Drop for HttpClient {
    fn drop(&mut self) {
        self.queues.push(self.session, Asked::Gone("it closed the connection".into()));
    }
}
