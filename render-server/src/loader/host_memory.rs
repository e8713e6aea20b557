//! The bytes of scenes that a server holds in main memory while it loads them.

use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::Duration;

use bytes::Bytes;

/// The period in which a loader that waits for room looks whether its preparation is wanted.
const CHECK_PERIOD: Duration = Duration::from_millis(50);

/// A counter of bytes that wait for the render thread.
#[derive(Clone, Debug, Default)]
pub(super) struct HostMemory(Arc<Shared>);

#[derive(Debug, Default)]
struct Shared {
    held: Mutex<u64>,
    freed: Condvar,
}

/// Bytes that are counted until they are dropped.
struct Counted {
    bytes: Bytes,
    memory: HostMemory,
}

impl AsRef<[u8]> for Counted {
    fn as_ref(&self) -> &[u8] {
        &self.bytes
    }
}

impl Drop for Counted {
    fn drop(&mut self) {
        let shared = &self.memory.0;
        let mut held = shared.held.lock().unwrap_or_else(PoisonError::into_inner);
        *held = held.saturating_sub(self.bytes.len() as u64);
        shared.freed.notify_all();
    }
}

impl HostMemory {
    /// Waits until there is room for these bytes, and counts them until they are dropped. Bytes
    /// that alone are more than the limit wait until nothing else is held.
    ///
    /// # Errors
    /// Those of `check`, which says whether the bytes are wanted.
    pub fn count(
        &self,
        bytes: Bytes,
        limit: u64,
        check: &dyn Fn() -> Result<(), String>,
    ) -> Result<Bytes, String> {
        let length = bytes.len() as u64;
        let mut held = self.0.held.lock().unwrap_or_else(PoisonError::into_inner);
        while *held > 0 && held.saturating_add(length) > limit {
            let waited = self.0.freed.wait_timeout(held, CHECK_PERIOD);
            held = waited.unwrap_or_else(PoisonError::into_inner).0;
            check()?;
        }
        *held += length;
        drop(held);
        Ok(Bytes::from_owner(Counted { bytes, memory: self.clone() }))
    }

    /// Bytes that are counted now.
    #[cfg(test)]
    pub fn held(&self) -> u64 {
        *self.0.held.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    #[test]
    fn bytes_wait_for_room_and_are_given_back() {
        let memory = HostMemory::default();
        let count = |length: usize| memory.count(vec![1; length].into(), 100, &|| Ok(()));
        let first = count(60).expect("room");
        let second = count(40).expect("room");
        assert_eq!(memory.held(), 100);
        let asked = Cell::new(0);
        let check = || {
            asked.set(asked.get() + 1);
            if asked.get() > 1 { Err("not wanted".to_owned()) } else { Ok(()) }
        };
        let refused = memory.count(Bytes::from_static(b"x"), 100, &check);
        assert_eq!(refused.unwrap_err(), "not wanted");
        std::thread::scope(|scope| {
            let waiting = scope.spawn(|| count(1000).expect("alone").len());
            drop((first, second));
            assert_eq!(waiting.join().expect("no panic"), 1000);
        });
        assert_eq!(memory.held(), 0);
    }
}
