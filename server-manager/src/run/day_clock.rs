//! The minute of the day, of which the core is told while displays have hours.

use std::time::Duration;

use chrono::Timelike;
use polyptych_core::Input;
use tokio::time::Instant;

use super::EventLoop;

/// Time between two looks at the clock: displays go dark within a second of their hour.
const LOOK_PERIOD: Duration = Duration::from_secs(1);

/// The last look at the clock.
#[derive(Debug, Default)]
pub(super) struct DayClock {
    looked_at: Option<Instant>,
    /// The minute that the core was told.
    told: Option<u16>,
}

impl EventLoop {
    /// Tells the core the minute of the day, where it needs it and another one has begun.
    pub(super) fn tell_minute(&mut self) {
        if !self.cluster.has_hours() {
            self.day_clock = DayClock::default();
            return;
        }
        let is_recent = |at: Instant| at.elapsed() < LOOK_PERIOD;
        if self.day_clock.looked_at.is_some_and(is_recent) {
            return;
        }
        self.day_clock.looked_at = Some(Instant::now());
        let time = chrono::Local::now();
        let of_day = (time.hour() * 60 + time.minute()) as u16;
        if self.day_clock.told.replace(of_day) != Some(of_day) {
            self.tell(self.now(), Input::Minute { of_day });
        }
    }

    /// Returns the time of the next look at the clock; `None` without hours.
    pub(super) fn next_look(&self) -> Option<Instant> {
        let looked_at = self.day_clock.looked_at.filter(|_| self.cluster.has_hours());
        looked_at.map(|at| at + LOOK_PERIOD)
    }
}
