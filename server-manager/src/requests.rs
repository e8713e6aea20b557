//! Requests that wait for the core: a queue for each client, served in turn within a budget, so
//! that however much clients ask, servers are heard first and frames go on.

mod client_queue;

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use client_queue::ClientQueue;
use polyptych_core::{Micros, SessionId};
use polyptych_protocol::delivery::QUEUED_REQUESTS_MAX;
use polyptych_protocol::ids::RequestId;
use polyptych_protocol::request::RequestMessage;
use tokio::sync::{Notify, OwnedSemaphorePermit};

/// Maximum size of the requests of one client that wait, in bytes on the wire.
pub(crate) const REQUEST_BYTES_MAX: usize = polyptych_protocol::limits::CALL_BYTES_MAX;

/// Minimum share of [`REQUEST_BYTES_MAX`] that a request takes: the queue's own memory for it.
pub(crate) const REQUEST_BYTES_MIN: usize = 128;

/// The least share of a queued request of as much memory for all of those.
pub(crate) const QUEUED_BYTES_MIN: usize = REQUEST_BYTES_MAX / QUEUED_REQUESTS_MAX;

/// Length of a budget's period, in microseconds.
const PERIOD: Micros = 10_000;

/// Maximum time of the core for all clients in a period, in microseconds: frames and servers have
/// the rest.
const TIME_PER_PERIOD: Micros = 3_000;

/// Maximum number of requests of one client in a period: 3,200 a second, three times what a mouse
/// or a tracker sends.
const REQUESTS_PER_PERIOD: u32 = 32;

/// A message of a client's connection.
#[derive(Debug)]
pub(crate) enum Asked {
    /// A request, and its share of [`REQUEST_BYTES_MAX`].
    Call(RequestMessage, OwnedSemaphorePermit),
    /// A request for which there is no room among the queued ones.
    Beyond(RequestId),
    /// The connection has ended, for this reason; nothing follows.
    Gone(String),
}

type Queues = BTreeMap<SessionId, ClientQueue>;

/// The queues of all clients, which their connections fill.
#[derive(Clone, Debug, Default)]
pub(crate) struct RequestQueues {
    queues: Arc<Mutex<Queues>>,
    news: Arc<Notify>,
}

impl RequestQueues {
    fn lock(&self) -> MutexGuard<'_, Queues> {
        self.queues.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Puts it behind what the client has said before, or among its queued requests.
    pub fn push(&self, from: SessionId, asked: Asked) {
        self.lock().entry(from).or_default().push(asked);
        self.news.notify_one();
    }

    /// A request of a client has its answer: the next queued one may begin.
    pub fn finish(&self, from: SessionId, id: RequestId) {
        let mut queues = self.lock();
        let Some(queue) = queues.get_mut(&from) else { return };
        if queue.finish(id) {
            self.news.notify_one();
        }
        if queue.is_empty() {
            queues.remove(&from);
        }
    }

    /// Returns whether a client has asked something that it has no answer to yet.
    pub fn awaits_answer(&self, from: SessionId) -> bool {
        // Of one that awaits none nothing is kept.
        self.lock().contains_key(&from)
    }

    /// Ready when there may be something to serve.
    pub async fn news(&self) {
        self.news.notified().await;
    }
}

/// The order in which clients are served, and the rest of the budget.
#[derive(Debug, Default)]
pub(crate) struct Turns {
    queues: RequestQueues,
    last: SessionId,
    period: Micros,
    spent: Micros,
    served: BTreeMap<SessionId, u32>,
}

impl Turns {
    /// The queues, for connections to fill.
    pub fn queues(&self) -> &RequestQueues {
        &self.queues
    }

    /// The next request within the budget, of the client whose turn it is; `may_ask` says whose
    /// requests are served at all now. That a connection has ended is heard in any case.
    pub fn next(
        &mut self,
        now: Micros,
        may_ask: impl Fn(SessionId) -> bool,
    ) -> Option<(SessionId, Asked)> {
        if now >= self.period + PERIOD {
            (self.period, self.spent) = (now, 0);
            self.served.clear();
        }
        let mut queues = self.queues.lock();
        let has_budget = self.spent < TIME_PER_PERIOD;
        let is_next = |(session, queue): &(&SessionId, &ClientQueue)| match queue.front() {
            None => false,
            Some(Asked::Gone(_)) => true,
            Some(Asked::Call(..) | Asked::Beyond(_)) => {
                let served = self.served.get(session).copied().unwrap_or(0);
                has_budget && served < REQUESTS_PER_PERIOD && may_ask(**session)
            }
        };
        let behind =
            queues.range((std::ops::Bound::Excluded(self.last), std::ops::Bound::Unbounded));
        let found = behind.chain(queues.range(..=self.last)).find(is_next).map(|(of, _)| *of)?;
        let queue = queues.get_mut(&found)?;
        let asked = queue.pop()?;
        if queue.is_empty() {
            queues.remove(&found);
        }
        self.last = found;
        *self.served.entry(found).or_default() += 1;
        Some((found, asked))
    }

    /// Notes what serving took of the core's time, in microseconds.
    pub fn spend(&mut self, time: Micros) {
        self.spent += time;
    }

    /// Returns the time at which requests that wait may be served; `None` if none waits.
    pub fn due(&self) -> Option<Micros> {
        let is_any = self.queues.lock().values().any(|queue| queue.front().is_some());
        is_any.then_some(self.period + PERIOD)
    }

    /// Drops what this client has asked.
    pub fn forget(&mut self, session: SessionId) {
        self.queues.lock().remove(&session);
        self.served.remove(&session);
    }
}

#[cfg(test)]
mod tests {
    use polyptych_protocol::delivery::Delivery;
    use polyptych_protocol::request::Request;
    use tokio::sync::Semaphore;

    use super::*;

    fn ask(turns: &Turns, session: u64, id: u64) {
        let room = Arc::new(Semaphore::new(1)).try_acquire_owned().expect("free");
        let call = RequestMessage::new(RequestId(id), Request::Status);
        turns.queues().push(SessionId(session), Asked::Call(call, room));
    }

    fn serve(turns: &mut Turns, now: Micros, cost: Micros) -> Vec<u64> {
        let mut served = Vec::new();
        while let Some((from, _)) = turns.next(now, |_| true) {
            turns.spend(cost);
            served.push(from.0);
        }
        served
    }

    #[test]
    fn clients_are_served_in_turn_and_a_flood_waits_for_the_next_period() {
        let mut turns = Turns::default();
        (0..1000).for_each(|id| ask(&turns, 7, id));
        (0..2).for_each(|id| ask(&turns, 3, id));
        ask(&turns, 9, 0);
        let first = serve(&mut turns, PERIOD, 1);
        assert_eq!(first[..5], [3, 7, 9, 3, 7], "one of each");
        assert_eq!(first.iter().filter(|of| **of == 7).count() as u32, REQUESTS_PER_PERIOD);
        assert_eq!(serve(&mut turns, PERIOD + 1, 1), [0; 0], "its budget is spent");
        assert_eq!(turns.due(), Some(2 * PERIOD));
        assert_eq!(serve(&mut turns, 2 * PERIOD, 1).len() as u32, REQUESTS_PER_PERIOD);
    }

    fn queue(turns: &Turns, session: u64, id: u64, priority: u8) {
        let room = Arc::new(Semaphore::new(1)).try_acquire_owned().expect("free");
        let delivery = Delivery::Queued { priority };
        let call = RequestMessage { id: RequestId(id), request: Request::Status, delivery };
        turns.queues().push(SessionId(session), Asked::Call(call, room));
    }

    /// The number of the next request; that of an end is 0.
    fn next(turns: &mut Turns) -> Option<u64> {
        turns.next(PERIOD, |_| true).map(|(_, asked)| match asked {
            Asked::Call(call, _) => call.id.0,
            Asked::Beyond(id) => id.0,
            Asked::Gone(_) => 0,
        })
    }

    #[test]
    fn queued_requests_begin_one_by_one_by_priority_behind_all_others() {
        let mut turns = Turns::default();
        for (id, priority) in [(1, 0), (2, 7), (3, 7), (4, 255), (5, 0)] {
            queue(&turns, 3, id, priority);
        }
        ask(&turns, 3, 10);
        ask(&turns, 3, 11);
        assert_eq!([next(&mut turns), next(&mut turns)], [Some(10), Some(11)]);
        let finish = |turns: &Turns, id| turns.queues().finish(SessionId(3), RequestId(id));
        for id in [10, 11] {
            finish(&turns, id);
        }
        for (at, id) in (12..).zip([4, 2, 3, 1, 5]) {
            assert_eq!(next(&mut turns), Some(id));
            assert_eq!((next(&mut turns), turns.due()), (None, None), "{id} has no answer yet");
            // Others need not wait for it, and their answers are not its own.
            ask(&turns, 3, at);
            assert_eq!(next(&mut turns), Some(at));
            finish(&turns, at);
            assert_eq!(next(&mut turns), None);
            finish(&turns, id);
        }
        assert_eq!((next(&mut turns), turns.queues().lock().len()), (None, 0), "nothing is left");
    }

    #[test]
    fn a_client_that_goes_away_drops_its_queued_requests() {
        let mut turns = Turns::default();
        queue(&turns, 3, 1, 0);
        queue(&turns, 3, 2, 9);
        ask(&turns, 3, 10);
        queue(&turns, 4, 20, 0);
        turns.queues().push(SessionId(3), Asked::Beyond(RequestId(11)));
        turns.queues().push(SessionId(3), Asked::Gone("closed".into()));
        let mut heard: Vec<u64> = std::iter::from_fn(|| next(&mut turns)).collect();
        heard.sort_unstable();
        assert_eq!(heard, [0, 10, 11, 20]);
        turns.forget(SessionId(3));
        turns.queues().finish(SessionId(3), RequestId(2));
        assert_eq!(turns.queues().lock().keys().collect::<Vec<_>>(), [&SessionId(4)]);
    }

    #[test]
    fn slow_requests_leave_most_of_the_time_to_servers() {
        let mut turns = Turns::default();
        for client in 0..100 {
            (0..10).for_each(|id| ask(&turns, client, id));
        }
        let cost = 1000;
        let periods = 20;
        let served: usize =
            (1..=periods).map(|at| serve(&mut turns, at * PERIOD, cost).len()).sum();
        assert_eq!(served as u64, periods * TIME_PER_PERIOD / cost);
    }

    #[test]
    fn who_does_not_read_is_not_served_but_its_end_is_heard() {
        let mut turns = Turns::default();
        ask(&turns, 1, 0);
        turns.queues().push(SessionId(2), Asked::Gone("closed".into()));
        assert!(matches!(turns.next(PERIOD, |_| false), Some((SessionId(2), Asked::Gone(_)))));
        assert!(turns.next(PERIOD, |_| false).is_none());
        turns.forget(SessionId(1));
        assert_eq!((turns.due(), turns.next(PERIOD, |_| true).is_none()), (None, true));
    }
}
