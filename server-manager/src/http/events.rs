//! Server-sent events: status, feedback of frames, and what happens in words.

use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};

use bytes::Bytes;
use tokio::sync::broadcast;
use tokio::sync::broadcast::error::RecvError;

use super::live_wall::{FeedbackWish, LiveEvent};

type Received = (Result<Arc<LiveEvent>, RecvError>, broadcast::Receiver<Arc<LiveEvent>>);

/// The events of one connection, until it ends. A browser that reads slowly loses events, and is
/// told how many.
pub(super) struct EventStream {
    next: Pin<Box<dyn Future<Output = Received> + Send>>,
    /// Feedback of frames is sent too, for as long as this is there.
    feedback: Option<FeedbackWish>,
}

impl EventStream {
    pub fn new(
        receiver: broadcast::Receiver<Arc<LiveEvent>>,
        feedback: Option<FeedbackWish>,
    ) -> Self {
        Self { next: Box::pin(receive(receiver)), feedback }
    }

    /// The text of the next event; `None` once the manager ends.
    pub fn poll_next(&mut self, context: &mut Context<'_>) -> Poll<Option<Bytes>> {
        loop {
            let (event, receiver) = ready!(self.next.as_mut().poll(context));
            self.next = Box::pin(receive(receiver));
            match event {
                Ok(event) if event.is_feedback && self.feedback.is_none() => {}
                Ok(event) => return Poll::Ready(Some(event.text.clone())),
                Err(RecvError::Lagged(lost)) => {
                    let text = format!("event: lost\ndata: {{\"events\":{lost}}}\n\n");
                    return Poll::Ready(Some(text.into()));
                }
                Err(RecvError::Closed) => return Poll::Ready(None),
            }
        }
    }
}

async fn receive(mut receiver: broadcast::Receiver<Arc<LiveEvent>>) -> Received {
    (receiver.recv().await, receiver)
}
