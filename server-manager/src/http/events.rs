//! Server-sent events: status, feedback of frames, and what happens in words.

use std::pin::Pin;
use std::task::{Context, Poll, ready};

use bytes::Bytes;
use tokio::sync::broadcast;
use tokio::sync::broadcast::error::RecvError;

use super::live_wall::FeedbackWish;

type Received = (Result<Bytes, RecvError>, broadcast::Receiver<Bytes>);

/// The events of one connection, until it ends. A browser that reads slowly loses events, and is
/// told how many.
pub(super) struct EventStream {
    events: Source,
    /// Feedback of frames, for as long as it is wished for.
    feedback: Option<(Source, FeedbackWish)>,
}

impl EventStream {
    pub fn new(events: broadcast::Receiver<Bytes>, wish: Option<FeedbackWish>) -> Self {
        let feedback = wish.map(|wish| (Source::new(wish.listen()), wish));
        Self { events: Source::new(events), feedback }
    }

    /// The text of the next event; `None` once the manager ends.
    pub fn poll_next(&mut self, context: &mut Context<'_>) -> Poll<Option<Bytes>> {
        // Feedback is what there is most of: the few others go before it.
        if let Poll::Ready(event) = self.events.poll_next(context) {
            return Poll::Ready(event);
        }
        match &mut self.feedback {
            Some((feedback, _)) => feedback.poll_next(context),
            None => Poll::Pending,
        }
    }
}

/// Events of one kind of listener.
struct Source(Pin<Box<dyn Future<Output = Received> + Send>>);

impl Source {
    fn new(receiver: broadcast::Receiver<Bytes>) -> Self {
        Self(Box::pin(receive(receiver)))
    }

    fn poll_next(&mut self, context: &mut Context<'_>) -> Poll<Option<Bytes>> {
        let (event, receiver) = ready!(self.0.as_mut().poll(context));
        *self = Self::new(receiver);
        Poll::Ready(match event {
            Ok(text) => Some(text),
            Err(RecvError::Lagged(lost)) => {
                Some(format!("event: lost\ndata: {{\"events\":{lost}}}\n\n").into())
            }
            Err(RecvError::Closed) => None,
        })
    }
}

async fn receive(mut receiver: broadcast::Receiver<Bytes>) -> Received {
    (receiver.recv().await, receiver)
}
