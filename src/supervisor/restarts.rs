//! Waits between the end of a child and its next start: a pure function of the times at which it
//! began and ended.

use std::time::{Duration, Instant};

/// The waits before a child is started again.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RestartPolicy {
    /// The wait after the first failure, and after a child that ran for `steady` or longer.
    pub first: Duration,
    /// The maximum wait; each failure in a row doubles it until then.
    pub longest: Duration,
    /// The time after which the end of a child is no failure in a row with the one before.
    pub steady: Duration,
}

impl RestartPolicy {
    /// A policy with this wait each time.
    pub const fn even(wait: Duration) -> Self {
        Self { first: wait, longest: wait, steady: Duration::ZERO }
    }
}

/// The waits of one child.
#[derive(Debug)]
pub(super) struct Restarts {
    policy: RestartPolicy,
    next: Duration,
}

impl Restarts {
    pub fn new(policy: RestartPolicy) -> Self {
        Self { policy, next: policy.first }
    }

    /// Returns the wait after a child that began and ended so; one that never ran has no beginning.
    pub fn wait_after(&mut self, begun: Option<Instant>, ended: Instant) -> Duration {
        let ran = begun.map(|begun| ended.saturating_duration_since(begun));
        if ran.is_some_and(|ran| ran >= self.policy.steady) {
            self.next = self.policy.first;
        }
        let wait = self.next;
        self.next = (wait * 2).min(self.policy.longest);
        wait
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waits_grow_with_failures_in_a_row_and_begin_anew_after_a_steady_run() {
        let ms = Duration::from_millis;
        let policy = RestartPolicy { first: ms(250), longest: ms(1500), steady: ms(5000) };
        let mut restarts = Restarts::new(policy);
        let now = Instant::now();
        let waits = [None, Some(now), None, Some(now + ms(1))];
        let waits = waits.map(|begun| restarts.wait_after(begun, now + ms(4999)).as_millis());
        assert_eq!(waits, [250, 500, 1000, 1500]);
        assert_eq!(restarts.wait_after(Some(now), now + ms(5000)), ms(250));
        assert_eq!(restarts.wait_after(Some(now), now), ms(500));
        // A clock that stands before the beginning is a short run.
        assert_eq!(restarts.wait_after(Some(now + ms(9)), now), ms(1000));
        let mut even = Restarts::new(RestartPolicy::even(ms(1000)));
        assert_eq!([None, Some(now)].map(|at| even.wait_after(at, now)), [ms(1000); 2]);
    }
}
