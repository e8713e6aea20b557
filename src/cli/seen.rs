//! Who saw what a command did: what it says of displays that did not, and its exit code.
//!
//! ```text
//! 0  done, and every channel of the wall shows it
//! 1  refused or failed
//! 3  done, but shown by no channel, or not by all
//! ```

use std::process::ExitCode;
use std::time::{Duration, Instant};

use polyptych_client::blocking::Client;
use polyptych_client::{
    Capture, ChannelFeedback, ChannelState, ChannelStatus, FrameFeedback, FrameId, Statistics,
};
use polyptych_text::{counted, printable};

use super::progress::ProgressReport;
use super::say;
use crate::logging;

/// What `polyptych --help` says of exit codes.
pub(super) const EXIT_CODES: &str = "\
Exit codes: 0 done, and every display of the wall shows it; 1 refused or failed; 2 wrong arguments;
3 done, but shown by no display or not by all, which standard error names with their reasons.";

/// Exit code of a command that was done, but not seen on every display.
const NOT_SEEN: u8 = 3;

/// Maximum number of channels that are named; a wall may have a thousand.
const NAMED_MAX: usize = 32;

/// Maximum time that a display that is late, or not ready yet, has to show the frame after all.
const LATE_TIME_MAX: Duration = Duration::from_secs(2);

/// Between two looks at displays.
const LOOK_PERIOD: Duration = Duration::from_millis(20);

/// Maximum time that `open` waits for displays that get ready: a large scene on a slow link.
const READY_TIME_MAX: Duration = Duration::from_mins(1);

/// How long a display without a server may still get one: who starts a wall starts its servers at
/// the same time, and one that has died is started again.
const ARRIVAL_TIME_MAX: Duration = Duration::from_secs(5);

/// Which channels of a wall show a frame.
#[derive(Debug)]
pub(super) struct Seen {
    frame: FrameId,
    /// How the sentence about a channel goes on before the number of the frame.
    lacks: &'static str,
    channels: usize,
    missing: Vec<Missing>,
}

/// A channel that does not show a frame.
#[derive(Debug)]
struct Missing {
    name: String,
    why: String,
}

impl Missing {
    fn of_feedback(channel: &ChannelFeedback) -> Self {
        Self::new(&channel.name, channel.state, channel.reason.as_deref())
    }

    fn new(name: &str, state: ChannelState, reason: Option<&str>) -> Self {
        let reason = reason.map(|reason| format!(": {}", printable(reason))).unwrap_or_default();
        Self { name: printable(name).into_owned(), why: format!("it is {state}{reason}") }
    }
}

impl Seen {
    /// Returns who shows the frame of this feedback, or a later one. Frames do not wait for a
    /// channel that is late or not ready; this does, for a short time.
    ///
    /// # Errors
    /// The manager does not answer any more.
    pub fn of(client: &Client, feedback: &FrameFeedback) -> anyhow::Result<Self> {
        let late = feedback.missing_channels().filter(|c| c.state != ChannelState::Lost);
        let late: Vec<&str> = late.map(|channel| channel.name.as_str()).collect();
        let shown_late = await_late(client, &late, feedback.frame)?;
        let missing = feedback.missing_channels();
        let missing = missing.filter(|channel| !shown_late.contains(&channel.name));
        Ok(Self {
            frame: feedback.frame,
            lacks: "does not show frame",
            channels: feedback.channels.len(),
            missing: missing.map(Missing::of_feedback).collect(),
        })
    }

    /// Returns who is in the pictures of a capture.
    pub fn in_pictures(capture: &Capture) -> Self {
        let missing = capture.missing.iter();
        let missing = missing.map(|(name, why)| Missing {
            name: printable(name).into_owned(),
            why: printable(why).into_owned(),
        });
        Self {
            frame: capture.frame,
            lacks: "is not in the picture of frame",
            channels: capture.channels.len() + capture.missing.len(),
            missing: missing.collect(),
        }
    }

    /// Counts channels that showed none of the frames of a run as missing too.
    pub fn and_never_shown(mut self, statistics: &Statistics) -> Self {
        // What was shown is reported a moment later, so a run of whole frames has no such channel.
        let is_whole = statistics.complete >= statistics.frames;
        let never = statistics.channels.iter().filter(|c| c.frames == 0 && !is_whole);
        for channel in never {
            let name = printable(&channel.name).into_owned();
            if self.missing.iter().all(|missing| missing.name != name) {
                self.missing.push(Missing { name, why: "it showed no frame at all".into() });
            }
        }
        self
    }

    /// Returns whether every channel shows it.
    pub fn is_complete(&self) -> bool {
        self.missing.is_empty() && self.channels > 0
    }

    /// Says where the frame is seen, for the end of a line: `shown at frame 7`.
    pub fn in_words(&self) -> String {
        let (frame, all) = (self.frame, self.channels);
        match all - self.missing.len().min(all) {
            0 => format!("frame {frame} was shown by no display"),
            shown if shown < all => format!("shown at frame {frame} by {shown} of {all} displays"),
            _ => format!("shown at frame {frame}"),
        }
    }

    /// Says who sees it, for the beginning of a line: `every display`.
    pub fn displays(&self) -> String {
        match self.missing.len() {
            _ if self.is_complete() => "every display".to_owned(),
            missing if missing >= self.channels => "no display".to_owned(),
            missing => format!("every display but {missing} of {}", self.channels),
        }
    }

    /// Names on standard error the channels that do not show it, with the reasons, and returns the
    /// command's exit code.
    pub fn conclude(&self) -> ExitCode {
        if self.is_complete() {
            return ExitCode::SUCCESS;
        }
        for Missing { name, why } in self.missing.iter().take(NAMED_MAX) {
            let Self { lacks, frame, .. } = self;
            logging::say_warning(&format!("channel {name} {lacks} {frame}: {why}"));
        }
        if let Some(more @ 1..) = self.missing.len().checked_sub(NAMED_MAX) {
            let more = counted(more, "more channel");
            logging::say_warning(&format!("{more} of the same kind; see: polyptych status"));
        }
        ExitCode::from(NOT_SEEN)
    }
}

/// Waits until these channels have shown the frame, or cannot any more; returns those that have.
fn await_late(client: &Client, names: &[&str], frame: FrameId) -> anyhow::Result<Vec<String>> {
    if names.is_empty() {
        return Ok(Vec::new());
    }
    let began = Instant::now();
    loop {
        let status = client.status()?;
        let late: Vec<&ChannelStatus> =
            status.channels.iter().filter(|c| names.contains(&c.name.as_str())).collect();
        let is_settled = |channel: &&&ChannelStatus| {
            channel.frame >= frame || channel.state == ChannelState::Lost
        };
        let is_over = began.elapsed() > LATE_TIME_MAX;
        if is_over || late.iter().filter(is_settled).count() == late.len() {
            let shown = late.iter().filter(|channel| channel.frame >= frame);
            return Ok(shown.map(|channel| channel.name.clone()).collect());
        }
        std::thread::sleep(LOOK_PERIOD);
    }
}

/// Draws a frame with what was set, and says who sees it. A paused wall stays at its scene time.
///
/// # Errors
/// The manager does not answer, or refuses the frame.
pub(super) fn show(client: &Client) -> anyhow::Result<ExitCode> {
    let seen = Seen::of(client, &client.redraw(None)?)?;
    say(seen.in_words())?;
    Ok(seen.conclude())
}

/// Draws a frame with what was changed, if anything was, and returns the exit code that says who
/// sees it: a wall that is paused draws none by itself.
///
/// # Errors
/// The manager does not answer, or refuses the frame.
pub(super) fn conclude(client: &Client, is_changed: bool) -> anyhow::Result<ExitCode> {
    if !is_changed {
        return Ok(ExitCode::SUCCESS);
    }
    Ok(Seen::of(client, &client.redraw(None)?)?.conclude())
}

/// Waits until every display that may soon be ready could draw: for `wait`, where given, else for
/// [`READY_TIME_MAX`], and no longer than [`ARRIVAL_TIME_MAX`] for servers that are not there.
///
/// # Errors
/// The manager does not answer any more.
pub(super) fn await_displays(
    client: &Client,
    wait: Option<Duration>,
    progress: &ProgressReport,
) -> anyhow::Result<()> {
    await_displays_unless(client, wait, progress, || false)
}

/// Waits as [`await_displays`] does, and no longer than until `is_over` says so.
///
/// # Errors
/// The manager does not answer any more.
pub(super) fn await_displays_unless(
    client: &Client,
    wait: Option<Duration>,
    progress: &ProgressReport,
    is_over: impl Fn() -> bool,
) -> anyhow::Result<()> {
    let began = Instant::now();
    let arrival_ms = wait.unwrap_or(ARRIVAL_TIME_MAX).as_millis();
    let may_get_ready = |channel: &&ChannelStatus| match channel.state {
        ChannelState::Joining => true,
        // One with a reason has said that it cannot.
        ChannelState::Preparing => channel.reason.is_none() || wait.is_some(),
        ChannelState::Lost => wait.is_some() || u128::from(channel.since_ms) < arrival_ms,
        ChannelState::Ready | ChannelState::Live | ChannelState::Late => false,
    };
    while began.elapsed() < wait.unwrap_or(READY_TIME_MAX) && !is_over() {
        let status = client.status()?;
        let awaited: Vec<&ChannelStatus> = status.channels.iter().filter(may_get_ready).collect();
        if awaited.is_empty() {
            break;
        }
        let (all, named) = (status.channels.len(), awaited.iter().take(3));
        let named: Vec<_> =
            named.map(|c| format!("{} is {}", printable(&c.name), c.state)).collect();
        let more = awaited.len().checked_sub(named.len()).filter(|more| *more > 0);
        let more = more.map_or_else(String::new, |more| format!(" and {more} more"));
        let ready = (all - awaited.len()) * 100 / all.max(1);
        let what = format!("waiting for displays: {}{more}", named.join(", "));
        progress.say(&what, u8::try_from(ready).ok());
        std::thread::sleep(LOOK_PERIOD);
    }
    Ok(())
}
