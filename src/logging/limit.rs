//! Bounds how often one place of the program may log.
//!
//! A peer that connects, fails or reports the same thing without end makes lines that differ in a
//! number, a port or a reason. Each place of the program has a budget of lines: a burst, refilled
//! slowly. Lines beyond it are counted, and the next line that is logged says how many there were.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Lines of one place that may come at once: two for each channel of the largest wall.
const BURST: u32 = 2048;

/// Time in which the budget of one place grows by one line.
const REFILL_TIME: Duration = Duration::from_secs(10);

/// A place of the program that logs: file and line are unique to it.
type Callsite = (&'static str, u32);

/// The budgets of all places that have logged.
#[derive(Debug, Default)]
pub(super) struct Budgets(Mutex<BTreeMap<Callsite, Budget>>);

#[derive(Debug)]
struct Budget {
    lines: u32,
    refilled: Instant,
    left_out: u64,
}

impl Budgets {
    /// Returns the number of lines that were left out before this one, or `None` if this one is
    /// to be left out too.
    pub fn take(&self, now: Instant, callsite: Callsite) -> Option<u64> {
        let mut budgets = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let full = || Budget { lines: BURST, refilled: now, left_out: 0 };
        let budget = budgets.entry(callsite).or_insert_with(full);
        let since = now.saturating_duration_since(budget.refilled);
        let refill = (since.as_millis() / REFILL_TIME.as_millis()).min(u128::from(BURST)) as u32;
        if refill == BURST {
            (budget.lines, budget.refilled) = (BURST, now);
        } else {
            budget.lines = BURST.min(budget.lines + refill);
            budget.refilled += REFILL_TIME * refill;
        }
        if budget.lines == 0 {
            budget.left_out += 1;
            return None;
        }
        budget.lines -= 1;
        Some(std::mem::take(&mut budget.left_out))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_place_that_logs_without_end_says_little_and_counts_the_rest() {
        let budgets = Budgets::default();
        let start = Instant::now();
        let (mut said, mut counted) = (0_u64, 0);
        // A day of 10 lines a second.
        for n in 0..864_000_u32 {
            let now = start + Duration::from_millis(100) * n;
            if let Some(left_out) = budgets.take(now, ("peer.rs", 7)) {
                said += 1;
                counted += left_out;
            }
        }
        assert!((10_600..10_800).contains(&said), "{said}");
        assert!(864_000 - said - counted < 200, "{counted}");
        let end = start + Duration::from_hours(24);
        assert_eq!(budgets.take(end, ("other.rs", 7)), Some(0), "another place is not hurt");
        let rested = end + Duration::from_hours(24);
        let burst = (0..5000).filter(|_| budgets.take(rested, ("peer.rs", 7)).is_some()).count();
        assert_eq!(burst, BURST as usize, "the budget is full again, and not more than full");
    }
}
