//! Says the same thing once, and after that only how often it came again.
//!
//! A peer with a wrong token asks every two seconds for as long as nobody looks; a log on disk
//! must not grow with it.

use std::collections::BTreeMap;

use crate::Micros;

/// Different things that are told apart at a time; all others count as one.
const KEYS_MAX: usize = 256;

/// After so much silence a thing is news again.
const FORGET_AFTER: Micros = 10 * 60 * 1_000_000;

#[derive(Debug, Default)]
pub struct LogLimiter {
    seen: BTreeMap<String, Occurrence>,
}

#[derive(Debug)]
struct Occurrence {
    times: u64,
    last: Micros,
}

impl LogLimiter {
    /// Notes that something came, by what makes it the same. `Some` where it is to be said now,
    /// with the times that it has come: at the first, the 10th, the 100th and so on.
    pub fn should_log(&mut self, now: Micros, what: &str) -> Option<u64> {
        if !self.seen.contains_key(what) && self.seen.len() >= KEYS_MAX {
            self.seen.retain(|_, seen| now.saturating_sub(seen.last) < FORGET_AFTER);
        }
        let is_known = self.seen.contains_key(what);
        // Whoever makes up new reasons all the time has one line for all of them.
        let key = if is_known || self.seen.len() < KEYS_MAX { what } else { "" };
        let seen = self.seen.entry(key.to_owned()).or_insert(Occurrence { times: 0, last: now });
        if now.saturating_sub(seen.last) >= FORGET_AFTER {
            seen.times = 0;
        }
        seen.last = now;
        seen.times += 1;
        let is_power_of_ten = 10_u64.pow(seen.times.ilog10()) == seen.times;
        is_power_of_ten.then_some(seen.times)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_is_said_ever_more_rarely_and_again_after_a_silence() {
        let mut repetitions = LogLimiter::default();
        let said: Vec<u64> = (0..5000).filter_map(|now| repetitions.should_log(now, "a")).collect();
        assert_eq!(said, [1, 10, 100, 1000]);
        assert_eq!(repetitions.should_log(5000, "b"), Some(1), "something else");
        assert_eq!(repetitions.should_log(5000 + FORGET_AFTER, "a"), Some(1));
    }

    #[test]
    fn new_reasons_without_end_make_few_lines_and_little_memory() {
        let mut repetitions = LogLimiter::default();
        let note = |n: u64| repetitions.should_log(n, &n.to_string());
        let said = (0..100_000).filter_map(note).count();
        assert!(said < KEYS_MAX + 10, "{said} lines");
        assert!(repetitions.seen.len() <= KEYS_MAX + 1);
    }
}
