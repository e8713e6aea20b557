//! How a command that takes long says how far it has come: a bar on a terminal, else a line now
//! and then; nothing where standard error is a log for programs.

use std::io::IsTerminal;
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};

use crate::{logging, progress};

/// Time between two lines; what is done sooner says nothing.
const LINE_PERIOD: Duration = Duration::from_secs(2);

/// Time between two pictures of the spinner.
const TICK_PERIOD: Duration = Duration::from_millis(100);

/// The progress of one command; a bar is gone when this is dropped.
#[derive(Debug)]
pub(super) enum ProgressReport {
    Bar(ProgressBar),
    Lines(Lines),
    Silent,
}

impl ProgressReport {
    /// Begins to say how far the command has come.
    pub fn start() -> Self {
        if logging::is_json() {
            return Self::Silent;
        }
        if !std::io::stderr().is_terminal() {
            return Lines::start().map_or(Self::Silent, Self::Lines);
        }
        let bar = ProgressBar::with_draw_target(Some(100), progress::target());
        if let Ok(style) = ProgressStyle::with_template("{spinner} {msg} {wide_bar}") {
            bar.set_style(style);
        }
        bar.enable_steady_tick(TICK_PERIOD);
        Self::Bar(bar)
    }

    /// Says what is done, and how much of it where that is known, in percent.
    pub fn say(&self, what: &str, percent: Option<u8>) {
        match self {
            Self::Bar(bar) => {
                bar.set_position(u64::from(percent.unwrap_or(0)));
                bar.set_message(what.to_owned());
            }
            Self::Lines(lines) => lines.say(what),
            Self::Silent => {}
        }
    }
}

impl Drop for ProgressReport {
    fn drop(&mut self) {
        if let Self::Bar(bar) = self {
            bar.finish_and_clear();
        }
    }
}

/// A thread that writes the newest line to standard error, where it has changed.
#[derive(Debug)]
pub(super) struct Lines {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Debug, Default)]
struct Shared {
    state: Mutex<State>,
    ended: Condvar,
}

#[derive(Debug, Default)]
struct State {
    newest: String,
    is_over: bool,
}

impl Lines {
    /// `None` where the system gives no thread: then the command is silent.
    fn start() -> Option<Self> {
        let shared = Arc::<Shared>::default();
        let kept = Arc::clone(&shared);
        let thread =
            std::thread::Builder::new().name("progress".into()).spawn(move || kept.write());
        Some(Self { shared, thread: Some(thread.ok()?) })
    }

    fn say(&self, what: &str) {
        what.clone_into(&mut self.shared.lock().newest);
    }
}

impl Shared {
    fn lock(&self) -> std::sync::MutexGuard<'_, State> {
        // Each change is one assignment, so that what a panic leaves is whole.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Writes lines until it is over.
    fn write(&self) {
        let mut said = String::new();
        loop {
            let waited = self.ended.wait_timeout_while(self.lock(), LINE_PERIOD, |s| !s.is_over);
            let (state, _) = waited.unwrap_or_else(PoisonError::into_inner);
            if state.is_over {
                return;
            }
            if state.newest != said {
                said.clone_from(&state.newest);
                logging::say_progress(&said);
            }
        }
    }
}

impl Drop for Lines {
    fn drop(&mut self) {
        self.shared.lock().is_over = true;
        self.shared.ended.notify_one();
        if let Some(thread) = self.thread.take() {
            // It only writes; where that has panicked there is nothing to do about it.
            let _ = thread.join();
        }
    }
}
