//! The lease of a wall: a record on shared storage that says which manager leads, without I/O and
//! clock.
//!
//! Managers that share a wall read and write one [`LeaseRecord`], each time under a lock, so that
//! reading and writing are one step. The holder renews the record; the others watch it, each by its
//! own clock. Clocks are never compared: only their rates matter.
//!
//! ```text
//! holder     writes at t                     fences itself at t + 2/3 lease time
//! candidate  sees that at s >= t             may take at s + lease time
//! ```
//!
//! So no two believe to hold the lease at once, unless the rates of their clocks differ by more
//! than a third. This is how lease locks work: Gray and Cheriton, "Leases", SOSP 1989.
//!
//! A clock that is never set stands still while its machine sleeps, and the lease goes to another.
//! So a holder looks at the time of day too: the lease is over once either clock says so. A time of
//! day that is set forward costs one look at the record; a candidate counts what it was awake for.

mod lease_file;

use std::time::Duration;

pub use lease_file::{LeaseFile, LeaseFileError};
use serde::{Deserialize, Serialize};

/// The lease time of a manager that is told none.
pub const LEASE_TIME_DEFAULT: Duration = Duration::from_secs(1);

/// Minimum lease time: a renewal must survive a slow disk.
pub const LEASE_TIME_MIN: Duration = Duration::from_millis(200);

/// Maximum lease time: nobody looks at a frozen wall for longer.
pub const LEASE_TIME_MAX: Duration = Duration::from_mins(1);

/// Renewals in one lease time: one may be late.
const RENEWALS_PER_LEASE: u32 = 3;

/// Looks of a candidate in one lease time: by at most one of them it takes over later.
const LOOKS_PER_LEASE: u32 = 20;

/// The record on shared storage.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LeaseRecord {
    /// The number of times that the lease was taken; each holder has a greater one than all before.
    pub term: u64,
    /// The number of renewals in this term.
    pub renewal: u64,
    /// The holder's name, for people.
    pub holder: String,
    /// The holder's lease time in milliseconds, by which the others wait.
    pub lease_ms: u64,
    /// `true` if the holder ended in order, so that the lease may be taken at once.
    pub is_released: bool,
    /// `true` if a client stopped the wall, so that managers that wait end too.
    pub is_stopped: bool,
    /// `true` once a holder has written the wall's state: whoever holds the lease later does not
    /// begin without it.
    #[serde(default)]
    pub has_state: bool,
}

/// The two clocks of a manager's machine, read one after the other in this order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ClockReading {
    /// Time since the manager started, by a clock that nobody sets, and that stands still while the
    /// machine sleeps.
    pub awake: Duration,
    /// Time of day, since 1970: it goes on while the machine sleeps, and may be set.
    pub of_day: Duration,
}

impl ClockReading {
    /// Returns whether both clocks are before this end.
    pub fn is_before(self, end: Self) -> bool {
        self.awake < end.awake && self.of_day < end.of_day
    }

    fn after(self, time: Duration) -> Self {
        Self { awake: self.awake + time, of_day: self.of_day + time }
    }
}

/// The part of one manager in the lease.
#[derive(Clone, Debug)]
pub struct Contender {
    name: String,
    lease_time: Duration,
    state: State,
}

#[derive(Clone, Copy, Debug)]
enum State {
    /// It watches the record.
    Watching(Option<Seen>),
    /// It held the lease when it last wrote.
    Holding { term: u64, valid_until: ClockReading },
}

/// A record, and the time awake at which it was first seen.
#[derive(Clone, Copy, Debug)]
struct Seen {
    term: u64,
    renewal: u64,
    since: Duration,
}

impl Contender {
    /// A manager of this name that watches the lease.
    pub fn new(name: String, lease_time: Duration) -> Self {
        Self { name, lease_time, state: State::Watching(None) }
    }

    /// Takes or renews the lease if it may, and returns the record to write.
    ///
    /// `found` was read under the lock, `now` are this manager's clocks after that, and the record
    /// is written before the lock is released. If writing fails, the contender as it was before the
    /// call goes on.
    pub fn step(&mut self, now: ClockReading, found: Option<&LeaseRecord>) -> Option<LeaseRecord> {
        let next = match (self.state, found) {
            (State::Holding { term, .. }, Some(found)) if self.is_mine(term, found) => {
                (term, found.renewal + 1)
            }
            // Another one has taken it, or the record was removed.
            (State::Holding { .. }, found) => {
                self.state = State::Watching(found.map(|found| Seen::first(now, found)));
                return None;
            }
            (State::Watching(seen), Some(found)) if !found.is_released => {
                let is_same =
                    |seen: &Seen| (seen.term, seen.renewal) == (found.term, found.renewal);
                let seen = seen.filter(is_same).unwrap_or_else(|| Seen::first(now, found));
                if now.awake < seen.since + Duration::from_millis(found.lease_ms) {
                    self.state = State::Watching(Some(seen));
                    return None;
                }
                (found.term + 1, 0)
            }
            // The file was removed, or its storage is not there: another one may still lead.
            (State::Watching(Some(_)), None) => return None,
            (State::Watching(_), found) => (found.map_or(0, |found| found.term) + 1, 0),
        };
        let (term, renewal) = next;
        self.state = State::Holding { term, valid_until: now.after(self.lease_time * 2 / 3) };
        let (holder, lease_ms) = (self.name.clone(), self.lease_time.as_millis() as u64);
        let (is_released, is_stopped) = (false, false);
        let has_state = found.is_some_and(|found| found.has_state);
        Some(LeaseRecord { term, renewal, holder, lease_ms, is_released, is_stopped, has_state })
    }

    /// Gives the lease up: returns the record to write, under the lock under which `found` was
    /// read. `None` if another one has it.
    pub fn release(&mut self, found: Option<&LeaseRecord>) -> Option<LeaseRecord> {
        let State::Holding { term, .. } = self.state else { return None };
        self.state = State::Watching(None);
        let mine = found.filter(|found| self.is_mine(term, found))?;
        Some(LeaseRecord { is_released: true, ..mine.clone() })
    }

    /// Returns the end of the time in which this manager may lead, by both clocks; `None` if it
    /// does not hold the lease.
    pub fn valid_until(&self) -> Option<ClockReading> {
        match self.state {
            State::Watching(_) => None,
            State::Holding { valid_until, .. } => Some(valid_until),
        }
    }

    /// Returns the term of the lease that this manager held when it last wrote.
    pub fn term(&self) -> Option<u64> {
        match self.state {
            State::Watching(_) => None,
            State::Holding { term, .. } => Some(term),
        }
    }

    /// Returns the time from one step to the next.
    pub fn period(&self) -> Duration {
        match self.state {
            State::Watching(_) => self.lease_time / LOOKS_PER_LEASE,
            State::Holding { .. } => self.lease_time / RENEWALS_PER_LEASE,
        }
    }

    fn is_mine(&self, term: u64, found: &LeaseRecord) -> bool {
        found.term == term && found.holder == self.name && !found.is_released
    }
}

impl Seen {
    fn first(now: ClockReading, found: &LeaseRecord) -> Self {
        Self { term: found.term, renewal: found.renewal, since: now.awake }
    }
}

#[cfg(test)]
mod tests;
