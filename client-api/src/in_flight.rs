//! The requests that wait for an answer: one small table with a deadline for each.
//!
//! It has no socket and no clock. Its owner removes a request exactly once: answered, expired,
//! given up or, at the end of the connection, all of them.

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

use polyptych_protocol::ids::RequestId;

/// Maximum number of requests of one connection that wait for an answer: seventeen seconds of a
/// camera set 60 times a second without any answer. An application that has more open has lost its
/// pace.
pub const OPEN_REQUESTS_MAX: usize = 1024;

/// Beyond what a clock can say: a year, which no connection lasts.
const FOR_EVER: Duration = Duration::from_hours(8760);

/// A request that waits.
#[derive(Debug)]
pub(crate) struct OpenRequest<W> {
    /// The name of the request, for messages.
    pub request: &'static str,
    /// The time that it may take.
    pub after: Duration,
    /// The receiver of the answer.
    pub waiter: W,
    /// `true` once the connection task has begun to write it.
    pub is_sent: bool,
    deadline: Instant,
}

/// All requests that wait.
#[derive(Debug)]
pub(crate) struct InFlight<W> {
    open: BTreeMap<RequestId, OpenRequest<W>>,
    deadlines: BTreeSet<(Instant, RequestId)>,
    /// Requests whose time was over before they were sent, as long as they wait to be.
    unsent: BTreeSet<RequestId>,
    next: u64,
}

impl<W> InFlight<W> {
    /// An empty table.
    pub fn new() -> Self {
        let (open, deadlines, unsent) = (BTreeMap::new(), BTreeSet::new(), BTreeSet::new());
        Self { open, deadlines, unsent, next: 1 }
    }

    /// Takes a request in, and gives it its number; `None` where the table is full.
    pub fn insert(
        &mut self,
        now: Instant,
        request: &'static str,
        after: Duration,
        waiter: W,
    ) -> Option<RequestId> {
        if self.open.len() >= OPEN_REQUESTS_MAX {
            return None;
        }
        let id = RequestId(self.next);
        self.next += 1;
        let deadline = now.checked_add(after).unwrap_or(now + FOR_EVER);
        self.deadlines.insert((deadline, id));
        self.open.insert(id, OpenRequest { request, after, waiter, is_sent: false, deadline });
        Some(id)
    }

    /// Returns a number for a request whose answer is ignored.
    pub fn number(&mut self) -> RequestId {
        self.next += 1;
        RequestId(self.next - 1)
    }

    /// It is being sent, and has its time from now on. `false` where it has left, or its time is
    /// over.
    pub fn send(&mut self, now: Instant, id: RequestId, after: Duration) -> bool {
        let Some(open) = self.open.get_mut(&id).filter(|open| open.deadline > now) else {
            return false;
        };
        open.is_sent = true;
        self.set_deadline(now, id, after);
        true
    }

    /// Gives every request that was not sent this much time from now on.
    pub fn postpone_unsent(&mut self, now: Instant, after: Duration) {
        let unsent = self.open.iter().filter(|(_, open)| !open.is_sent);
        let ids: Vec<RequestId> = unsent.map(|(id, _)| *id).collect();
        for id in ids {
            self.set_deadline(now, id, after);
        }
    }

    /// Gives a request that was sent all of its time again.
    pub fn renew(&mut self, now: Instant, id: RequestId) {
        if let Some(after) = self.open.get(&id).filter(|open| open.is_sent).map(|open| open.after) {
            self.set_deadline(now, id, after);
        }
    }

    fn set_deadline(&mut self, now: Instant, id: RequestId, after: Duration) {
        let Some(open) = self.open.get_mut(&id) else { return };
        self.deadlines.remove(&(open.deadline, id));
        (open.after, open.deadline) = (after, now.checked_add(after).unwrap_or(now + FOR_EVER));
        self.deadlines.insert((open.deadline, id));
    }

    /// Takes the requests out that were sent and that `leaves` says of, the oldest first.
    pub fn drain_sent(&mut self, leaves: impl Fn(&W) -> bool) -> Vec<OpenRequest<W>> {
        let sent = self.open.iter().filter(|(_, open)| open.is_sent && leaves(&open.waiter));
        let ids: Vec<RequestId> = sent.map(|(id, _)| *id).collect();
        ids.into_iter().filter_map(|id| self.remove(id)).collect()
    }

    /// Returns the requests that were sent, the oldest first.
    pub fn sent(&self) -> impl Iterator<Item = (RequestId, &W)> {
        let sent = self.open.iter().filter(|(_, open)| open.is_sent);
        sent.map(|(id, open)| (*id, &open.waiter))
    }

    /// Takes a request out.
    pub fn remove(&mut self, id: RequestId) -> Option<OpenRequest<W>> {
        let open = self.open.remove(&id)?;
        self.deadlines.remove(&(open.deadline, id));
        Some(open)
    }

    /// Returns the receiver of the answer to this request.
    pub fn waiter_mut(&mut self, id: RequestId) -> Option<&mut W> {
        self.open.get_mut(&id).map(|open| &mut open.waiter)
    }

    /// Returns the time when [`InFlight::expire`] must be called next.
    pub fn next_deadline(&self) -> Option<Instant> {
        self.deadlines.first().map(|(deadline, _)| *deadline)
    }

    /// Takes one request out whose time is over; call it until it gives `None`.
    pub fn expire(&mut self, now: Instant) -> Option<OpenRequest<W>> {
        let (deadline, id) = *self.deadlines.first()?;
        let expired = if deadline > now { None } else { self.remove(id) };
        if expired.as_ref().is_some_and(|of| !of.is_sent) {
            self.unsent.insert(id);
        }
        expired
    }

    /// Returns whether its time was over before it was sent, and forgets it.
    pub fn take_unsent(&mut self, id: RequestId) -> bool {
        self.unsent.remove(&id)
    }

    /// Takes all requests out, the oldest first.
    pub fn drain(&mut self) -> impl Iterator<Item = OpenRequest<W>> + use<W> {
        self.deadlines.clear();
        std::mem::take(&mut self.open).into_values()
    }

    /// Returns the time until which this request waits; `None` where it has left.
    pub fn deadline(&self, id: RequestId) -> Option<Instant> {
        self.open.get(&id).map(|open| open.deadline)
    }

    /// Returns the number of requests that wait.
    pub fn len(&self) -> usize {
        self.open.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    #[test]
    fn each_request_leaves_once() {
        let now = Instant::now();
        let mut table = InFlight::new();
        let first = table.insert(now, "a", SECOND, 'a').expect("room");
        let second = table.insert(now, "b", SECOND, 'b').expect("room");
        assert_ne!(first, second);
        assert_eq!(table.remove(second).map(|open| open.waiter), Some('b'));
        assert!(table.remove(second).is_none());
        assert_eq!(table.waiter_mut(first), Some(&mut 'a'));
        assert_eq!(table.waiter_mut(second), None);
        assert_eq!(table.drain().map(|open| open.waiter).collect::<Vec<_>>(), ['a']);
        assert_eq!((table.len(), table.next_deadline()), (0, None));
    }

    #[test]
    fn requests_expire_in_the_order_of_their_deadlines() {
        let now = Instant::now();
        let mut table = InFlight::new();
        table.insert(now, "slow", 3 * SECOND, 3).expect("room");
        table.insert(now, "quick", SECOND, 1).expect("room");
        table.insert(now, "middling", 2 * SECOND, 2).expect("room");
        assert_eq!(table.next_deadline(), Some(now + SECOND));
        assert!(table.expire(now).is_none());
        let later = now + 2 * SECOND;
        let expired: Vec<_> = std::iter::from_fn(|| table.expire(later)).collect();
        let names: Vec<_> = expired.iter().map(|open| (open.request, open.after)).collect();
        assert_eq!(names, [("quick", SECOND), ("middling", 2 * SECOND)]);
        assert_eq!(table.next_deadline(), Some(now + 3 * SECOND));
    }

    #[test]
    fn progress_of_a_request_that_was_sent_renews_its_time() {
        let now = Instant::now();
        let mut table = InFlight::new();
        let [sent, unsent] = [(); 2].map(|()| table.insert(now, "x", SECOND, ()).expect("room"));
        assert!(table.send(now, sent, SECOND));
        for id in [sent, unsent, RequestId(99)] {
            table.renew(now + SECOND / 2, id);
        }
        assert!(table.expire(now + SECOND).is_some_and(|open| !open.is_sent));
        assert!(table.expire(now + SECOND).is_none());
        assert!(table.expire(now + SECOND * 3 / 2).is_some_and(|open| open.is_sent));
    }

    #[test]
    fn a_full_table_takes_no_more_until_one_leaves() {
        let now = Instant::now();
        let mut table = InFlight::new();
        let ids: Vec<_> =
            (0..OPEN_REQUESTS_MAX).filter_map(|i| table.insert(now, "x", SECOND, i)).collect();
        assert_eq!(ids.len(), OPEN_REQUESTS_MAX);
        assert_eq!(table.insert(now, "x", SECOND, 0), None);
        table.remove(ids[7]);
        assert!(table.insert(now, "x", SECOND, 0).is_some());
    }

    #[test]
    fn a_time_without_end_does_not_overflow() {
        let mut table = InFlight::new();
        let now = Instant::now();
        assert!(table.insert(now, "x", Duration::MAX, ()).is_some());
        assert!(table.expire(now + 1000 * SECOND).is_none());
    }
}
