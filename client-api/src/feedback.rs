//! The feedback of every frame, as it comes.

use std::sync::Arc;

use polyptych_protocol::feedback::Feedback;
use tokio::sync::broadcast;
use tokio::sync::broadcast::error::RecvError;

use crate::link::Link;

/// Most feedbacks that wait for a slow reader: four seconds at 60 frames per second. Beyond it the
/// oldest are dropped and counted; the connection never waits.
pub const FEEDBACK_QUEUE_MAX: usize = 256;

/// The feedback of every frame from the subscription on; see [`crate::Client::feedback`].
///
/// Dropping the last one of a connection ends the subscription.
#[derive(Debug)]
pub struct Feedbacks {
    receiver: broadcast::Receiver<Arc<Feedback>>,
    dropped: u64,
    link: Link,
}

impl Feedbacks {
    pub(crate) fn new(receiver: broadcast::Receiver<Arc<Feedback>>, link: Link) -> Self {
        Self { receiver, dropped: 0, link }
    }

    /// Waits for the next frame's feedback; `None` once the connection has ended. Why it ended is
    /// the error of every later call, and [`crate::Client::end_reason`].
    ///
    /// Dropping the future loses nothing.
    pub async fn next(&mut self) -> Option<Feedback> {
        loop {
            match self.receiver.recv().await {
                Ok(feedback) => return Some(Arc::unwrap_or_clone(feedback)),
                Err(RecvError::Lagged(missed)) => self.dropped += missed,
                Err(RecvError::Closed) => return None,
            }
        }
    }

    /// How many feedbacks were dropped so far because they were not read in time.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }
}

impl Drop for Feedbacks {
    fn drop(&mut self) {
        self.link.unsubscribe();
    }
}
