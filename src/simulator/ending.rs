//! Why the work on a local wall ends early: Ctrl-C, or a window that its user has closed.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use tokio_util::sync::CancellationToken;

/// Why work ends before it is done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Ending {
    /// Ctrl-C, or SIGTERM.
    Interrupted,
    /// The user has closed a window.
    WindowClosed,
}

impl Ending {
    /// Returns why the user ended a run, if that is what an error says.
    pub fn of(error: &anyhow::Error) -> Option<Self> {
        error.downcast_ref().copied()
    }
}

impl std::fmt::Display for Ending {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Interrupted => "interrupted",
            Self::WindowClosed => "a window was closed",
        })
    }
}

impl std::error::Error for Ending {}

/// A request to end the work, with its reason, shared by all threads.
#[derive(Debug, Default)]
pub(crate) struct EndRequest {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct State {
    ending: Option<Ending>,
    /// The work has something to write at its end; without, it is broken off.
    has_results: bool,
    /// Break the work off.
    stops: Vec<CancellationToken>,
}

impl EndRequest {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Asks the work to end. Work without results is broken off at once.
    pub fn request(&self, ending: Ending) {
        let mut state = self.state();
        state.ending.get_or_insert(ending);
        if !state.has_results {
            state.stops.iter().for_each(CancellationToken::cancel);
        }
        self.changed.notify_all();
    }

    /// Adds what is cancelled where the work is broken off; at once if that has come already.
    pub fn add_stop(&self, stop: CancellationToken) {
        let mut state = self.state();
        if state.ending.is_some() && !state.has_results {
            stop.cancel();
        }
        state.stops.push(stop);
    }

    /// The work has results from now on, and is given time to write them. Work that was asked to
    /// end before that has none.
    pub fn has_results(&self) {
        let mut state = self.state();
        state.has_results |= state.ending.is_none();
    }

    /// Returns whether the work has results.
    pub fn is_reported(&self) -> bool {
        self.state().has_results
    }

    /// Why the work is to end, if it is.
    pub fn ending(&self) -> Option<Ending> {
        self.state().ending
    }

    /// Waits until `due`, or until the work is to end: then it returns why.
    pub fn wait_until(&self, due: Instant) -> Option<Ending> {
        let mut state = self.state();
        loop {
            let left = due.saturating_duration_since(Instant::now());
            if state.ending.is_some() || left.is_zero() {
                return state.ending;
            }
            let waited = self.changed.wait_timeout(state, left);
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn work_without_results_is_broken_off_and_other_work_is_not() {
        for has_results in [false, true] {
            let request = EndRequest::default();
            let stop = CancellationToken::new();
            request.add_stop(stop.clone());
            if has_results {
                request.has_results();
            }
            request.request(Ending::WindowClosed);
            assert_eq!(stop.is_cancelled(), !has_results);
            let late = CancellationToken::new();
            request.add_stop(late.clone());
            assert_eq!(late.is_cancelled(), !has_results);
        }
    }

    #[test]
    fn the_first_reason_counts_and_ends_a_wait_at_once() {
        let request = EndRequest::default();
        assert_eq!(request.wait_until(Instant::now()), None);
        request.request(Ending::Interrupted);
        request.request(Ending::WindowClosed);
        let far = Instant::now() + Duration::from_hours(1);
        assert_eq!(request.wait_until(far), Some(Ending::Interrupted));
    }
}
