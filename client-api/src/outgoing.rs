//! Requests on their way to the connection task, and the queue in which they wait for it.

use std::time::{Duration, Instant};

use bytes::Bytes;
use polyptych_protocol::ids::RequestId;
use tokio::sync::mpsc;

use crate::connection_handle::Shared;

/// A request on its way to the connection task.
#[derive(Debug)]
pub(crate) struct Outgoing {
    pub id: RequestId,
    /// The number of the connection that there was when it was posted, or had been before.
    pub connection: u64,
    /// The time until which it may wait for a connection; `None` if there was one, as far as was
    /// known.
    pub until: Option<Instant>,
    /// The time that the request may take, once it is sent.
    pub after: Duration,
    /// `true` if it asks the manager to end: once it is sent, no other connection is made.
    pub is_stop: bool,
    pub bytes: Bytes,
}

/// The requests that wait to be sent, in the order in which they were posted.
#[derive(Debug)]
pub(crate) struct OutgoingQueue {
    /// Goes before the rest, from which it was taken to look at it.
    first: Option<Outgoing>,
    rest: mpsc::Receiver<Outgoing>,
}

impl OutgoingQueue {
    /// Takes what is posted into this channel.
    pub fn new(rest: mpsc::Receiver<Outgoing>) -> Self {
        Self { first: None, rest }
    }

    /// Takes the next request; `None` once there are no more, and no caller is left.
    pub async fn recv(&mut self) -> Option<Outgoing> {
        match self.first.take() {
            Some(first) => Some(first),
            None => self.rest.recv().await,
        }
    }

    /// Takes the next request, if there is one.
    pub fn try_recv(&mut self) -> Option<Outgoing> {
        self.first.take().or_else(|| self.rest.try_recv().ok())
    }

    /// Drops the requests that waited too long, so that later ones find room. The oldest are the
    /// first whose time is over.
    pub fn drop_expired(&mut self, shared: &Shared) {
        while let Some(next) = self.try_recv() {
            if shared.is_due(&next) {
                self.first = Some(next);
                return;
            }
        }
    }

    /// Returns whether no request waits, and none will come.
    pub fn is_finished(&self) -> bool {
        self.rest.is_closed() && self.rest.is_empty() && self.first.is_none()
    }
}

#[cfg(test)]
mod tests {
    use polyptych_protocol::handshake::Welcome;
    use polyptych_protocol::ids::{Epoch, Term};
    use polyptych_protocol::request::Request;

    use super::*;
    use crate::connect::ConnectOptions;
    use crate::connection_handle::{CloseReason, ConnectionHandle, Wanted};
    use crate::error::ClientError;
    use crate::in_flight::OPEN_REQUESTS_MAX;
    use crate::reconnect::ReconnectPolicy;

    const WAIT: Duration = Duration::from_secs(10);

    fn welcome() -> Welcome {
        let wall = "lab".into();
        Welcome { epoch: Epoch(7), term: Term(1), session: 1, wall, heartbeat_ms: 2000 }
    }

    fn connected() -> (ConnectionHandle, OutgoingQueue) {
        let reconnect = Some(ReconnectPolicy { wait: WAIT, give_up_after: None });
        let options = ConnectOptions { reconnect, ..ConnectOptions::new("wall-3") };
        ConnectionHandle::new(options, welcome())
    }

    /// Waits, and tells those whose time is over.
    async fn wait(link: &ConnectionHandle, time: Duration) {
        tokio::time::advance(time).await;
        link.shared.handle_timeout(tokio::time::Instant::now().into_std());
    }

    #[tokio::test(start_paused = true)]
    async fn what_waited_too_long_is_not_sent_once_there_is_a_connection() {
        let (link, mut queue) = connected();
        // The connection is dead already, and nobody knows.
        let mut given_up = link.post(Request::CloseScene, Wanted::default()).expect("posted");
        drop(link.post(Request::Pause, Wanted::default()).expect("posted"));
        link.shared.handle_loss(&CloseReason::lost("torn"));
        wait(&link, WAIT / 2).await;
        drop(link.post(Request::Status, Wanted::default()).expect("posted"));
        wait(&link, WAIT / 2).await;
        let error = given_up.poll().expect("an answer").expect_err("no connection");
        assert!(matches!(error, ClientError::NotConnected { .. }), "{error}");
        link.shared.handle_connected(&welcome());
        drop(link.post(Request::Status, Wanted::default()).expect("posted"));
        let taken = std::iter::from_fn(|| queue.try_recv());
        let sent: Vec<_> = taken.map(|next| link.shared.take_to_send(next).is_some()).collect();
        assert_eq!(sent, [false, false, true, true]);
    }

    #[tokio::test(start_paused = true)]
    async fn what_waited_too_long_behind_others_is_not_sent() {
        let (link, mut queue) = connected();
        let mut given_up = link.post(Request::Pause, Wanted::default()).expect("posted");
        drop(link.post(Request::Pause, Wanted::default()).expect("posted"));
        // A large request before them leaves slowly.
        wait(&link, ConnectOptions::new("wall-3").timeouts.other).await;
        let error = given_up.poll().expect("an answer").expect_err("its time is over");
        assert!(matches!(error, ClientError::TimedOut { .. }), "{error}");
        let taken = std::iter::from_fn(|| queue.try_recv());
        let sent: Vec<_> = taken.map(|next| link.shared.take_to_send(next).is_some()).collect();
        assert_eq!(sent, [false, true], "nobody was told of the second");
    }

    #[tokio::test(start_paused = true)]
    async fn only_a_stop_that_is_sent_ends_reconnection() {
        let (link, mut queue) = connected();
        link.shared.handle_loss(&CloseReason::lost("torn"));
        drop(link.post(Request::Stop, Wanted::default()).expect("posted"));
        wait(&link, WAIT).await;
        link.shared.handle_connected(&welcome());
        drop(link.post(Request::Stop, Wanted::default()).expect("posted"));
        let mut send = || {
            let is_sent = queue.try_recv().map(|next| link.shared.take_to_send(next).is_some());
            (is_sent, link.shared.wants_connection())
        };
        assert_eq!(send(), (Some(false), true), "no manager was asked to end");
        assert_eq!(send(), (Some(true), false));
    }

    #[tokio::test(start_paused = true)]
    async fn requests_whose_time_is_over_leave_room_for_others_during_an_outage() {
        let (link, mut queue) = connected();
        link.shared.handle_loss(&CloseReason::lost("torn"));
        for _ in 0..OPEN_REQUESTS_MAX {
            drop(link.post(Request::Pause, Wanted::default()).expect("room"));
        }
        queue.drop_expired(&link.shared);
        // The first was taken out, to look at it.
        drop(link.post(Request::Status, Wanted::default()).expect("room for one"));
        assert!(link.post(Request::Status, Wanted::default()).is_err());
        wait(&link, WAIT).await;
        queue.drop_expired(&link.shared);
        drop(link.post(Request::Status, Wanted::default()).expect("room again"));
        drop(link);
        assert!(!queue.is_finished());
        assert!(queue.try_recv().is_some() && queue.is_finished());
    }
}
