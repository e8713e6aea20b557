//! The feedback of every frame, as it comes.

use std::sync::Arc;

use polyptych_protocol::feedback::FrameFeedback;
use polyptych_protocol::ids::Epoch;
use tokio::sync::broadcast;
use tokio::sync::broadcast::error::RecvError;

use crate::connection_handle::ConnectionHandle;

/// Maximum number of feedbacks that wait for a slow reader: four seconds at 60 frames per second.
/// Beyond it the oldest are dropped and counted; the connection never waits.
pub const FEEDBACK_QUEUE_MAX: usize = 256;

/// A frame's feedback and where it came from.
#[derive(Clone, Debug)]
pub(crate) struct TaggedFeedback {
    pub feedback: Arc<FrameFeedback>,
    pub epoch: Epoch,
    pub connection: u64,
}

/// The feedback of every frame from the subscription on; see [`crate::Client::feedback`].
///
/// Dropping the last one of a connection ends the subscription.
#[derive(Debug)]
pub struct FeedbackStream {
    receiver: broadcast::Receiver<TaggedFeedback>,
    dropped: u64,
    connection: u64,
    gaps: u64,
    epoch: Epoch,
    link: ConnectionHandle,
}

impl FeedbackStream {
    pub(crate) fn new(
        receiver: broadcast::Receiver<TaggedFeedback>,
        connection: u64,
        epoch: Epoch,
        link: ConnectionHandle,
    ) -> Self {
        Self { receiver, dropped: 0, connection, gaps: 0, epoch, link }
    }

    /// Waits for the next frame's feedback; `None` once the client has ended. Why it ended is the
    /// error of every later call, and [`crate::Client::close_reason`]. Where the connection is made
    /// again, the stream goes on after a gap; see [`FeedbackStream::reconnects`].
    ///
    /// Dropping the future loses nothing.
    pub async fn next(&mut self) -> Option<FrameFeedback> {
        loop {
            match self.receiver.recv().await {
                Ok(TaggedFeedback { feedback, epoch, connection }) => {
                    self.gaps += connection.saturating_sub(self.connection);
                    (self.connection, self.epoch) = (connection, epoch);
                    return Some(Arc::unwrap_or_clone(feedback));
                }
                Err(RecvError::Lagged(missed)) => self.dropped += missed,
                Err(RecvError::Closed) => return None,
            }
        }
    }

    /// Returns the number of reconnections before the last feedback that was given out. Frames that
    /// the wall showed while there was no connection are not in the stream.
    pub fn reconnects(&self) -> u64 {
        self.gaps
    }

    /// The life of the manager that the last feedback comes from. Numbers of frames begin anew
    /// with each life.
    pub fn epoch(&self) -> Epoch {
        self.epoch
    }

    /// Returns the number of feedbacks that were dropped so far because they were not read in time.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }
}

impl Drop for FeedbackStream {
    fn drop(&mut self) {
        self.link.unsubscribe();
    }
}
