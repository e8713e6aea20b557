//! A child process whose output is kept, and which never outlives its test.

use std::io::{BufRead, BufReader, Read};
use std::os::unix::process::ExitStatusExt;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::Builder;
use std::time::Duration;

use rustix::process::Signal;
use serde_json::Value;

use super::wait;

/// A running program.
#[derive(Debug)]
pub struct Process {
    name: String,
    child: Child,
    log: Arc<Mutex<Vec<Line>>>,
}

#[derive(Debug)]
struct Line {
    text: String,
    /// Whether it came through standard output.
    is_result: bool,
}

/// The exit status of a program, and all its output.
#[derive(Debug)]
pub struct Finished {
    pub status: ExitStatus,
    pub output: String,
    /// What came through standard output alone.
    results: String,
}

impl Process {
    /// Starts the program. Both of its outputs go into one log; its input stays open.
    pub fn start(name: &str, command: &mut Command) -> Self {
        let command = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap_or_else(|error| panic!("{name}: {error}"));
        let log = Arc::default();
        keep(&log, child.stdout.take(), true);
        keep(&log, child.stderr.take(), false);
        Self { name: name.to_owned(), child, log }
    }

    /// The system's number of it.
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// All that it has said.
    pub fn output(&self) -> String {
        self.joined(|_| true)
    }

    fn joined(&self, is_wanted: impl Fn(&&Line) -> bool) -> String {
        let log = self.log.lock().unwrap_or_else(PoisonError::into_inner);
        let lines: Vec<&str> = log.iter().filter(is_wanted).map(|it| it.text.as_str()).collect();
        lines.join("\n")
    }

    /// Waits until it says a line with all these parts; gives the line.
    #[track_caller]
    pub fn await_line(&mut self, parts: &[&str]) -> String {
        let has_parts = |line: &&String| parts.iter().all(|part| line.contains(part));
        let seen = wait::look_for(wait::LIMIT, || {
            let log = self.log.lock().unwrap_or_else(PoisonError::into_inner);
            log.iter().map(|line| &line.text).find(has_parts).cloned()
        });
        seen.unwrap_or_else(|| panic!("{} did not say {parts:?}:\n{}", self.name, self.output()))
    }

    /// Returns whether it has ended.
    pub fn has_ended(&mut self) -> bool {
        self.child.try_wait().expect("the child can be asked").is_some()
    }

    /// Sends a signal.
    pub fn signal(&self, signal: Signal) {
        super::signals::send(self.pid(), signal);
    }

    /// Ends it at once, as a power failure would.
    pub fn kill(&mut self) {
        // It may have ended by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }

    /// Waits until it has ended by itself.
    #[track_caller]
    pub fn finish(&mut self, limit: Duration) -> Finished {
        let status = wait::look_for(limit, || self.child.try_wait().expect("can be asked"));
        let Some(status) = status else {
            let threads = super::signals::threads_of(self.pid());
            panic!("{} did not end within {limit:?} ({threads}):\n{}", self.name, self.output());
        };
        // The rest of its output is in the pipes; descendants may hold them open a little longer.
        let is_read = || (Arc::strong_count(&self.log) == 1).then_some(());
        let _ = wait::look_for(Duration::from_secs(2), is_read);
        Finished { status, output: self.output(), results: self.joined(|line| line.is_result) }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.kill();
        if std::thread::panicking() {
            eprintln!("--- {} said:\n{}", self.name, self.output());
        }
    }
}

impl Finished {
    /// Returns the exit code as a shell would see it in `$?`.
    pub fn code(&self) -> i32 {
        let by_signal = || self.status.signal().map(|signal| 128 + signal);
        self.status.code().or_else(by_signal).unwrap_or(-1)
    }

    /// Checks that it succeeded; returns its output.
    #[track_caller]
    pub fn succeeded(self) -> String {
        assert_eq!(self.code(), 0, "{}", self.output);
        self.output
    }

    /// Checks that it succeeded; returns the JSON that it printed. A slow machine adds lines of
    /// progress to standard error, which are no part of it.
    #[track_caller]
    pub fn json(self) -> Value {
        assert_eq!(self.code(), 0, "{}", self.output);
        serde_json::from_str(&self.results).unwrap_or_else(|e| panic!("{e}: {}", self.output))
    }

    /// Checks that it failed with an error that has these parts; returns the line of the error.
    #[track_caller]
    pub fn failed(self, parts: &[&str]) -> String {
        assert_eq!(self.code(), 1, "{}", self.output);
        let last = self.output.lines().rev().find(|line| line.starts_with("error: "));
        let last = last.unwrap_or_else(|| panic!("no error is said: {}", self.output)).to_owned();
        for part in parts {
            assert!(last.contains(part), "{part:?} is not in {last:?}");
        }
        last
    }
}

/// Keeps what comes through a pipe, on a thread that ends with the pipe.
fn keep(log: &Arc<Mutex<Vec<Line>>>, pipe: Option<impl Read + Send + 'static>, is_result: bool) {
    let (log, pipe) = (Arc::clone(log), pipe.expect("the output is a pipe"));
    let read = move || {
        for line in BufReader::new(pipe).split(b'\n') {
            let Ok(line) = line else { return };
            let text = String::from_utf8_lossy(&line).into_owned();
            let line = Line { text, is_result };
            log.lock().unwrap_or_else(PoisonError::into_inner).push(line);
        }
    };
    Builder::new().name("output".into()).spawn(read).expect("a thread");
}
