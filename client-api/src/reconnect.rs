//! Reconnection of a client, with pauses that grow.

use std::time::Duration;

use polyptych_protocol::handshake::Welcome;
use polyptych_protocol::handshake_io::MessageStream;
use polyptych_protocol::stall_limit::StallLimit;
use tokio::time::{Instant, sleep};

use crate::connection_handle::{CloseReason, Shared};
use crate::error::ClientError;
use crate::outgoing::OutgoingQueue;

/// Pause before the first attempt: a manager that is restarted finds its clients at once.
const RETRY_FIRST: Duration = Duration::from_millis(50);

/// Maximum pause: what an application loses at most, once its manager is there again.
const RETRY_LONGEST: Duration = Duration::from_secs(2);

/// The same where there is a standby, which takes over within a second or so.
const RETRY_LONGEST_OF_SEVERAL: Duration = Duration::from_millis(100);

/// The policy for a connection that has ended; see [`crate::ConnectOptions::reconnect`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReconnectPolicy {
    /// The time that a request waits for a connection before it fails with
    /// [`ClientError::NotConnected`]; ten seconds by default, enough for a manager to restart.
    pub wait: Duration,
    /// The time without a connection after which the client ends; `None`, the default: never.
    pub give_up_after: Option<Duration>,
}

impl Default for ReconnectPolicy {
    fn default() -> Self {
        Self { wait: Duration::from_secs(10), give_up_after: None }
    }
}

/// The means of making a new connection.
pub(crate) struct Reconnector<D> {
    pub reconnect: ReconnectPolicy,
    /// Connects to the next of the managers.
    pub dial: D,
    /// `true` if there are several managers.
    pub has_standby: bool,
}

/// A connection on which both sides have introduced themselves, and which ends if the manager
/// takes nothing.
pub(crate) type HandshakeResult<S> = (MessageStream<StallLimit<S>>, Welcome);

impl<D> Reconnector<D> {
    /// Connects again.
    ///
    /// # Errors
    /// The reason why there will be no connection any more: it is not wanted, or it took too long.
    pub async fn connect<S, F>(
        &mut self,
        shared: &Shared,
        messages: &mut OutgoingQueue,
    ) -> Result<HandshakeResult<S>, CloseReason>
    where
        D: FnMut() -> F,
        F: Future<Output = Result<HandshakeResult<S>, ClientError>>,
    {
        let began = Instant::now();
        let mut pause = RETRY_FIRST;
        let pause_max = if self.has_standby { RETRY_LONGEST_OF_SEVERAL } else { RETRY_LONGEST };
        let mut last_reason = String::new();
        loop {
            // Many clients of one manager must not come back in the same moment.
            sleep(pause.mul_f64(0.75 + 0.5 * fastrand::f64())).await;
            pause = (pause * 2).min(pause_max);
            messages.drop_expired(shared);
            // What was posted last may still be wanted though everyone is gone.
            if messages.is_finished() {
                return Err(CloseReason::lost("this client closed it"));
            }
            let dialled = (self.dial)().await;
            // What expired meanwhile must not be sent, and leaves room for others.
            messages.drop_expired(shared);
            let reason = match dialled {
                Ok((_, welcome)) if welcome.wall != shared.wall => {
                    format!("it drives wall {} now, not {}", welcome.wall, shared.wall)
                }
                Ok(introduced) => return Ok(introduced),
                Err(error) => error.to_string(),
            };
            // One line for each change; a manager that is away all night fills no disk.
            if reason != last_reason {
                tracing::warn!(address = shared.address, reason, "not connected; trying again");
                shared.note_reason(&reason);
                last_reason = reason;
            }
            if let Some(limit) = self.reconnect.give_up_after.filter(|l| began.elapsed() >= *l) {
                return Err(CloseReason::lost(format!(
                    "no connection within {limit:?}: {last_reason}"
                )));
            }
        }
    }
}
