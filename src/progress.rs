//! Progress of long commands: a moving line on a terminal, and else a line for each step.

mod terminal;

use std::fmt::Display;
use std::io::IsTerminal;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::logging;
use terminal::ProgressTerminal;

/// Between two movements of a line.
const TICK: Duration = Duration::from_millis(100);

/// The steps of a command whose number is known.
#[derive(Debug)]
pub(crate) struct Steps {
    bar: ProgressBar,
    count: u64,
    begun: u64,
}

fn on_terminal() -> ProgressDrawTarget {
    if std::io::stderr().is_terminal() {
        ProgressDrawTarget::term_like(Box::new(ProgressTerminal::default()))
    } else {
        ProgressDrawTarget::hidden()
    }
}

/// Returns the target that progress is drawn on: hidden if the log is for programs, since progress
/// is for people.
pub(crate) fn target() -> ProgressDrawTarget {
    if logging::is_json() { ProgressDrawTarget::hidden() } else { on_terminal() }
}

impl Steps {
    /// So many steps, none of which has begun.
    pub fn new(count: u64) -> Self {
        let bar = ProgressBar::with_draw_target(Some(count), target());
        let style =
            ProgressStyle::with_template("{spinner} step {prefix} of {len}: {msg} ({elapsed})");
        if let Ok(style) = style {
            bar.set_style(style);
        }
        bar.enable_steady_tick(TICK);
        Self { bar, count, begun: 0 }
    }

    /// The next step begins.
    pub fn begin(&mut self, what: impl Display) {
        self.begun += 1;
        let (step, count) = (self.begun, self.count);
        self.bar.set_prefix(step.to_string());
        self.bar.set_message(what.to_string());
        if logging::is_json() {
            tracing::info!(step, count, "{what}");
        } else if !std::io::stderr().is_terminal() {
            logging::say_progress(&format!("step {step} of {count}: {what}"));
        }
    }
}

impl Drop for Steps {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
