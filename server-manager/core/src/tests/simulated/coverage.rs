//! Coverage of the schedules: a schedule in which nothing happens proves nothing.

use std::collections::BTreeMap;

/// Counts over schedules.
#[derive(Clone, Debug, Default)]
pub struct Coverage {
    pub schedules: u64,
    pub happenings: u64,
    pub frames: u64,
    pub shown: u64,
    pub virtual_us: u64,
    counts: BTreeMap<&'static str, u64>,
    /// Changes of a channel's state, by the states before and after.
    pub changes: [[u64; 6]; 6],
}

/// In the order of `ChannelState`.
const STATES: [&str; 6] = ["lost", "joining", "preparing", "ready", "live", "late"];

impl Coverage {
    pub fn count(&mut self, what: &'static str) {
        *self.counts.entry(what).or_default() += 1;
    }

    pub fn tally(&mut self, what: &'static str, count: u64) {
        *self.counts.entry(what).or_default() += count;
    }

    pub fn of(&self, what: &str) -> u64 {
        self.counts.get(what).copied().unwrap_or(0)
    }

    pub fn add(&mut self, other: &Self) {
        self.schedules += other.schedules;
        self.happenings += other.happenings;
        self.frames += other.frames;
        self.shown += other.shown;
        self.virtual_us += other.virtual_us;
        for (what, count) in &other.counts {
            *self.counts.entry(what).or_default() += count;
        }
        for (sum, more) in self.changes.iter_mut().flatten().zip(other.changes.iter().flatten()) {
            *sum += more;
        }
    }

    /// Every fault and every turn of the wall was there.
    pub fn assert_wide(&self) {
        for what in WHAT_MUST_HAPPEN {
            assert!(self.of(what) > 0, "no schedule had this: {what}");
        }
    }

    pub fn print(&self) {
        println!(
            "{} schedules, {} happenings, {} frames, {} pictures shown, {:.1} hours of a wall",
            self.schedules,
            self.happenings,
            self.frames,
            self.shown,
            self.virtual_us as f64 / 3.6e9
        );
        for (what, count) in &self.counts {
            println!("{count:>12}  {what}");
        }
        for (before, row) in STATES.iter().zip(&self.changes) {
            for (after, count) in STATES.iter().zip(row).filter(|(_, count)| **count > 0) {
                println!("{count:>12}  channel {before} -> {after}");
            }
        }
    }
}

/// The events that ten thousand schedules must have had.
const WHAT_MUST_HAPPEN: [&str; 33] = [
    "camera moved by a mouse",
    "client disconnected",
    "connection cut",
    "connection half open",
    "connection half open to the server",
    "delays",
    "draw failed",
    "drawn with a wrong digest",
    "held state corrupt",
    "import done",
    "import failed",
    "loads slow",
    "frame sent ahead",
    "frame shown but on a channel that could not draw it",
    "manager killed",
    "manager killed between two outputs",
    "manager silent for a server",
    "manager stopped",
    "manager stopped by a client",
    "next state corrupt",
    "picture kept aside",
    "prepare failed",
    "prepared with a wrong digest",
    "render thread hangs",
    "server killed",
    "server refused",
    "server slow",
    "server stopped",
    "session closed by the core",
    "shown at its instant",
    "shown behind its instant",
    "taken over by the same process",
    "tuning refused by a server",
];
