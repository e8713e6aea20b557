//! The rules by which displays go dark by themselves: outside hours, or if nobody uses the wall.

use serde::{Deserialize, Serialize};

/// Minutes of a day.
pub const DAY_MINUTES: u16 = 24 * 60;

/// Shortest and longest time without use before displays go dark, in seconds: a person who looks
/// is not left in the dark, and a week is never.
pub const IDLE_S: std::ops::RangeInclusive<f64> = 10.0..=604_800.0;

/// The rules by which displays go dark. A wall without any is never dark by itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RestRules {
    /// Time without use after which displays go dark, in seconds.
    pub idle_s: Option<f64>,
    /// The hours in which displays are lit, every day; outside of them they go dark.
    pub hours: Option<LitHours>,
}

/// The part of a day in which displays are lit, in minutes since midnight by the clock of the
/// manager's machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LitHours {
    /// The first minute.
    pub from_min: u16,
    /// The minute after the last; before `from_min` for hours across midnight.
    pub until_min: u16,
}

/// The rules and what they come to now.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RestStatus {
    /// The rules.
    pub rules: RestRules,
    /// Displays are dark by them.
    pub is_resting: bool,
}

impl LitHours {
    /// Returns whether displays are lit in this minute of a day.
    pub fn contains(&self, minute: u16) -> bool {
        if self.from_min <= self.until_min {
            (self.from_min..self.until_min).contains(&minute)
        } else {
            minute >= self.from_min || minute < self.until_min
        }
    }
}

impl RestRules {
    /// Checks the rules.
    ///
    /// # Errors
    /// The number that cannot be, and what would be right.
    pub fn validate(&self) -> Result<(), String> {
        if let Some(idle_s) = self.idle_s.filter(|idle_s| !IDLE_S.contains(idle_s)) {
            let (least, most) = (IDLE_S.start(), IDLE_S.end());
            return Err(format!("displays go dark after {least} to {most} seconds, not {idle_s}"));
        }
        let Some(LitHours { from_min, until_min }) = self.hours else { return Ok(()) };
        let last = DAY_MINUTES;
        if from_min >= last || until_min > last {
            return Err(format!(
                "hours are minutes of a day, 0 to {last}, not {from_min} to {until_min}"
            ));
        }
        if from_min == until_min {
            return Err(
                "hours that end as they begin light nothing; leave hours out instead".into()
            );
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hours_may_go_across_midnight() {
        let day = LitHours { from_min: 540, until_min: 1080 };
        assert_eq!([539, 540, 1079, 1080].map(|at| day.contains(at)), [false, true, true, false]);
        let night = LitHours { from_min: 1200, until_min: 120 };
        assert_eq!(
            [1199, 1200, 0, 119, 120].map(|at| night.contains(at)),
            [false, true, true, true, false]
        );
    }

    #[test]
    fn rejects_rules_that_cannot_be() {
        let hours = |from_min, until_min| Some(LitHours { from_min, until_min });
        let of = |idle_s, hours| RestRules { idle_s, hours }.validate();
        assert_eq!(of(Some(60.0), hours(540, 1440)), Ok(()));
        for (idle_s, hours) in [
            (Some(f64::NAN), None),
            (Some(0.0), None),
            (None, hours(1440, 3)),
            (None, hours(3, 1441)),
            (None, hours(3, 3)),
        ] {
            assert!(of(idle_s, hours).is_err(), "{idle_s:?} {hours:?}");
        }
    }
}
