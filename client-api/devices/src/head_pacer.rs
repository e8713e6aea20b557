//! The times at which the head is sent: once for each frame, with the freshest reading.
//!
//! A head that is sent with the first reading after a frame was swapped is in time for the next
//! one, or for the one that follows a frame which began at that swap. What comes later in the same
//! frame replaces what waits, so no queue grows.

use crate::Micros;

/// Time after a swap for which a reading that came before it waits for a fresher one: a reading of
/// a tracker at 100 Hz comes meanwhile.
const FRESH_WAIT: Micros = 10_000;

/// Period of heads that no swap asks for: those of a wall that stands still.
pub const IDLE_PERIOD: Micros = 100_000;

/// The state that decides when the next head is sent.
#[derive(Clone, Debug, Default)]
pub(crate) struct HeadPacer {
    /// The time of the last swap; `None` if a head was sent since.
    swapped: Option<Micros>,
    /// The time at which the last head was sent.
    sent: Option<Micros>,
    is_unanswered: bool,
}

impl HeadPacer {
    /// Records the swap of a frame.
    pub fn handle_swap(&mut self, now: Micros) {
        self.swapped = Some(now);
    }

    /// Records the answer to the head that was sent.
    pub fn handle_answer(&mut self) {
        self.is_unanswered = false;
    }

    /// Returns the time to send a head that differs from the last one sent and whose newest reading
    /// came at `reading`; `None` while the last one is not answered.
    pub fn due(&self, reading: Option<Micros>) -> Option<Micros> {
        if self.is_unanswered {
            return None;
        }
        let idle = self.sent.map_or(0, |sent| sent + IDLE_PERIOD);
        let Some(swapped) = self.swapped else { return Some(idle) };
        let turn = match reading {
            Some(reading) if reading >= swapped => reading,
            _ => swapped + FRESH_WAIT,
        };
        Some(turn.min(idle))
    }

    /// Records that no head is sent in this turn: it is invalid, or the same as before.
    pub fn record_skipped(&mut self, now: Micros) {
        (self.swapped, self.sent) = (None, Some(now));
    }

    /// Records that a head is sent.
    pub fn record_sent(&mut self, now: Micros) {
        (self.swapped, self.sent, self.is_unanswered) = (None, Some(now), true);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_head_goes_out_for_each_swap_with_the_first_reading_after_it() {
        let mut pacer = HeadPacer::default();
        assert_eq!(pacer.due(Some(5)), Some(0), "the first at once");
        pacer.record_sent(5);
        assert_eq!(pacer.due(Some(6)), None, "one at a time");
        pacer.handle_answer();
        assert_eq!(pacer.due(Some(7)), Some(100_005), "without a swap the next waits");
        pacer.handle_swap(10_000);
        assert_eq!(pacer.due(Some(9_000)), Some(20_000), "a fresher one may come");
        assert_eq!(pacer.due(Some(12_000)), Some(12_000));
        assert_eq!(pacer.due(None), Some(20_000), "a head that moves by itself");
        pacer.record_sent(12_000);
        pacer.handle_answer();
        assert_eq!(pacer.due(Some(13_000)), Some(112_000));
    }
}
