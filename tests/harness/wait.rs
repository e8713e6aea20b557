//! Waiting for what is tested, never for a time.

use std::sync::mpsc::sync_channel;
use std::thread::Builder;
use std::time::{Duration, Instant};

/// Longest wait for anything: two cores that build something else are slow, but not that slow.
pub const LIMIT: Duration = Duration::from_mins(1);

/// Longest wait for what must be quick: children end within two seconds, on a machine that may be
/// as busy as three of these suites at once make it.
pub const SOON: Duration = Duration::from_secs(10);

/// Between two looks; short beside everything that is waited for.
const PERIOD: Duration = Duration::from_millis(10);

/// Looks until there is something to see; `None` after `limit`.
pub fn look_for<T>(limit: Duration, mut look: impl FnMut() -> Option<T>) -> Option<T> {
    let deadline = Instant::now() + limit;
    loop {
        if let Some(seen) = look() {
            return Some(seen);
        }
        if Instant::now() > deadline {
            return None;
        }
        std::thread::park_timeout(PERIOD);
    }
}

/// Looks as [`look_for`] does; there must be something within [`LIMIT`].
#[track_caller]
pub fn until<T>(what: &str, look: impl FnMut() -> Option<T>) -> T {
    look_for(LIMIT, look).unwrap_or_else(|| panic!("{what}: not within {LIMIT:?}"))
}

/// Does what may block for ever, on another thread; there must be an answer within [`LIMIT`].
#[track_caller]
pub fn within<T: Send + 'static>(what: &str, work: impl FnOnce() -> T + Send + 'static) -> T {
    let (sender, receiver) = sync_channel(1);
    let work = move || drop(sender.send(work()));
    Builder::new().name("patient".into()).spawn(work).expect("a thread");
    receiver.recv_timeout(LIMIT).unwrap_or_else(|error| panic!("{what}: {error}"))
}
