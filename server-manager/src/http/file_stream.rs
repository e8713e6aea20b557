//! A file that is sent while it comes from the event loop: little of it is in memory.

use std::io;
use std::pin::Pin;
use std::task::{Context, Poll, ready};

use bytes::Bytes;
use polyptych_protocol::ids::RequestId;
use polyptych_protocol::request::{MessageToClient, Request};

use super::answer::Refusal;
use super::client::HttpClient;

type Received = (Option<io::Result<Bytes>>, HttpClient);

/// The rest of a file. A connection whose file breaks off ends without the end of the body, so
/// that no program takes a part for the whole.
pub(super) struct FileStream {
    asked: RequestId,
    /// The first piece, which was waited for.
    first: Option<Bytes>,
    next: Option<Pin<Box<dyn Future<Output = Received> + Send>>>,
}

impl FileStream {
    /// Asks for a file, and waits for its first piece.
    ///
    /// # Errors
    /// The manager's refusal.
    pub async fn begin(mut client: HttpClient, request: Request) -> Result<Self, Refusal> {
        let asked = client.send(request).await?;
        loop {
            match client.next().await? {
                MessageToClient::Chunk(chunk) if chunk.id == asked => {
                    let next: Pin<Box<dyn Future<Output = Received> + Send>> =
                        Box::pin(receive(client, asked));
                    return Ok(Self { asked, first: Some(chunk.bytes), next: Some(next) });
                }
                MessageToClient::Reply { id, reply } if id == asked => {
                    reply?;
                    return Err(Refusal::unavailable("the manager sent an empty file"));
                }
                _ => {}
            }
        }
    }

    /// The next piece; `None` once the file is whole.
    pub fn poll_next(&mut self, context: &mut Context<'_>) -> Poll<Option<io::Result<Bytes>>> {
        if let Some(first) = self.first.take() {
            return Poll::Ready(Some(Ok(first)));
        }
        let Some(next) = &mut self.next else { return Poll::Ready(None) };
        let (piece, client) = ready!(next.as_mut().poll(context));
        let goes_on = matches!(piece, Some(Ok(_)));
        self.next = goes_on.then(|| {
            let next: Pin<Box<dyn Future<Output = Received> + Send>> =
                Box::pin(receive(client, self.asked));
            next
        });
        Poll::Ready(piece)
    }
}

async fn receive(mut client: HttpClient, asked: RequestId) -> Received {
    loop {
        let piece = match client.next().await {
            Ok(MessageToClient::Chunk(chunk)) if chunk.id == asked => Some(Ok(chunk.bytes)),
            Ok(MessageToClient::Reply { id, reply }) if id == asked => {
                reply.err().map(|error| Err(io::Error::other(error.reason)))
            }
            Ok(_) => continue,
            Err(refusal) => Some(Err(io::Error::other(refusal.reason))),
        };
        return (piece, client);
    }
}
