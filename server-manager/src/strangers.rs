//! Connections that have not introduced themselves yet, and which of them ends if there are too
//! many.
//!
//! New ones always come in, since one of them may be a render server that returns; the one that
//! ends has said nothing for longest. A peer of ours speaks at once and is through in milliseconds,
//! so that a flood of connections ends itself.

use std::collections::{BTreeMap, BTreeSet};
use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio_util::sync::CancellationToken;

/// Maximum number of connections in the handshake.
pub(crate) const STRANGERS_MAX: usize = 512;

/// Maximum number of addresses of peers that are remembered: those of the largest wall, and desks.
const KNOWN_MAX: usize = 4096;

/// All connections in the handshake.
#[derive(Clone, Debug, Default)]
pub(crate) struct Strangers(Arc<Mutex<State>>);

#[derive(Debug, Default)]
struct State {
    next: u64,
    /// By the order in which they came.
    waiting: BTreeMap<u64, Stranger>,
    /// Addresses from which peers have been let in.
    known: BTreeSet<IpAddr>,
}

#[derive(Debug)]
struct Stranger {
    address: IpAddr,
    has_spoken: bool,
    end: CancellationToken,
}

/// A connection in the handshake, counted until it is dropped.
#[derive(Debug)]
pub(crate) struct Guest {
    strangers: Strangers,
    number: u64,
    /// Cancelled if it has to make room.
    pub end: CancellationToken,
}

impl Strangers {
    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Counts a connection from this address; another one may have to end for it.
    pub fn admit(&self, address: IpAddr) -> Guest {
        let mut state = self.state();
        if state.waiting.len() >= STRANGERS_MAX {
            state.make_room();
        }
        let (number, end) = (state.next, CancellationToken::new());
        state.next += 1;
        state.waiting.insert(number, Stranger { address, has_spoken: false, end: end.clone() });
        Guest { strangers: self.clone(), number, end }
    }

    /// Ends the connection that is missed least, if there is one: the system has no more room.
    pub fn make_room(&self) {
        self.state().make_room();
    }
}

impl State {
    /// Ends one connection: of addresses that are not known before those that are; silent before
    /// those that have spoken; of the address with most of them; the oldest.
    fn make_room(&mut self) {
        let mut shares = BTreeMap::<IpAddr, usize>::new();
        for stranger in self.waiting.values() {
            *shares.entry(stranger.address).or_default() += 1;
        }
        let rank = |stranger: &Stranger| {
            let is_known = self.known.contains(&stranger.address);
            let share = shares.get(&stranger.address).copied().unwrap_or(0);
            (is_known, stranger.has_spoken, usize::MAX - share)
        };
        let last = self.waiting.iter().min_by_key(|(number, of)| (rank(of), **number));
        if let Some(number) = last.map(|(number, _)| *number)
            && let Some(stranger) = self.waiting.remove(&number)
        {
            stranger.end.cancel();
        }
    }
}

impl Guest {
    /// Its first bytes have come.
    pub fn has_spoken(&self) {
        if let Some(stranger) = self.strangers.state().waiting.get_mut(&self.number) {
            stranger.has_spoken = true;
        }
    }

    /// It was let in: its address is known from now on.
    pub fn is_let_in(&self) {
        let mut state = self.strangers.state();
        let address = state.waiting.get(&self.number).map(|stranger| stranger.address);
        if state.known.len() < KNOWN_MAX {
            state.known.extend(address);
        }
    }
}

impl Drop for Guest {
    fn drop(&mut self) {
        self.strangers.state().waiting.remove(&self.number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn address(last: u8) -> IpAddr {
        IpAddr::from([10, 0, 0, last])
    }

    fn ended(guests: &[Guest]) -> Vec<usize> {
        let is_over = |(_, guest): &(usize, &Guest)| guest.end.is_cancelled();
        guests.iter().enumerate().filter(is_over).map(|(index, _)| index).collect()
    }

    #[test]
    fn a_flood_ends_its_own_silent_connections_first() {
        let strangers = Strangers::default();
        let peer = strangers.admit(address(1));
        peer.is_let_in();
        drop(peer);
        let mut guests: Vec<Guest> = Vec::new();
        // A peer that returns, one that has spoken, one of a third address, and the flood.
        guests.push(strangers.admit(address(1)));
        guests.push(strangers.admit(address(66)));
        guests[1].has_spoken();
        guests.push(strangers.admit(address(3)));
        let flood = (guests.len()..STRANGERS_MAX).map(|_| strangers.admit(address(66)));
        guests.extend(flood.collect::<Vec<_>>());
        assert_eq!(ended(&guests), [0; 0]);
        for _ in 0..2 * STRANGERS_MAX {
            guests.push(strangers.admit(address(66)));
            assert!(strangers.state().waiting.len() <= STRANGERS_MAX);
        }
        let over = ended(&guests);
        assert!(!over.contains(&0) && !over.contains(&1) && !over.contains(&2), "{over:?}");
        assert_eq!(over.len(), 2 * STRANGERS_MAX);
        assert!(!guests.last().expect("the last").end.is_cancelled(), "the newest has its chance");
        drop(guests);
        assert_eq!(strangers.state().waiting.len(), 0);
    }
}
