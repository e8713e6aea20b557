//! Child processes: started, started again after they end, ended with their parent.
//!
//! A child reads its standard input, which ends when this process does, however it ends: no
//! orphan is left even by SIGKILL. Children have process groups of their own: what is typed at a
//! terminal reaches this process only, which decides when they end.

mod restarts;

use std::collections::VecDeque;
use std::ffi::OsString;
use std::path::PathBuf;
use std::process::Stdio;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use tokio::io::{AsyncBufReadExt, AsyncRead, AsyncReadExt, AsyncWriteExt, BufReader};
use tokio::process::{Child, ChildStdin, Command};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio_util::sync::CancellationToken;

pub(crate) use restarts::RestartPolicy;
use restarts::Restarts;

/// Maximum time for a child to end by itself when it is asked to.
const END_TIME_MAX: Duration = Duration::from_secs(2);

/// Maximum time for the beginning of a start behind a gate: others wait for it.
const GATED_TIME_MAX: Duration = Duration::from_secs(30);

/// Maximum bytes of a line of a child that are read; the rest of a longer one is dropped.
const LINE_BYTES_MAX: u64 = 4096;

/// Maximum number of lines of a child's standard error that are kept to say why it ended.
const LAST_LINES_MAX: usize = 3;

/// Maximum wait for the last lines of a child that has ended: its own children may hold the pipe
/// open.
const LAST_WORDS_TIME_MAX: Duration = Duration::from_millis(200);

/// The command that starts a child, and what its supervisor reads of it.
#[derive(Clone, Debug)]
pub(crate) struct ChildCommand {
    pub name: String,
    pub program: PathBuf,
    pub arguments: Vec<OsString>,
    pub environment: Vec<(OsString, OsString)>,
    /// Limits the number of children that are at the beginning of their start. It ends with the
    /// first line on standard output or with the child, which is ended after [`GATED_TIME_MAX`].
    pub gate: Option<Arc<Semaphore>>,
    /// `true` if its standard error goes to [`OnLine`]; otherwise to that of this process.
    pub reports_errors: bool,
    /// Time between two bytes on its standard input, for a child on another machine: a network
    /// that breaks does not end its input. `None` to write nothing.
    pub signs_of_life: Option<Duration>,
}

/// The state of a child.
#[derive(Clone, Debug, Default)]
pub(crate) struct ChildState {
    pub name: String,
    pub pid: Option<u32>,
    pub restarts: u64,
    /// The way in which it ended the last time.
    pub last_end: Option<String>,
    /// The last lines of its standard error since it was started.
    pub last_lines: VecDeque<String>,
    /// The time since which it runs, or that of its first line on standard output if it has a gate;
    /// `None` while it does not run.
    pub begun: Option<Instant>,
    /// The time of its next start, if it has ended.
    pub next_start: Option<Instant>,
}

/// A line that a child wrote, without its end.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ChildLine<'l> {
    pub child: &'l str,
    pub is_error: bool,
    pub text: &'l str,
}

/// The function that is called with each line that a child writes.
pub(crate) type OnLine = Arc<dyn Fn(ChildLine<'_>) + Send + Sync>;

/// Children on a thread of their own; dropping it ends them.
#[derive(Debug)]
pub(crate) struct Supervisor {
    states: Arc<Mutex<Vec<ChildState>>>,
    stop: CancellationToken,
    thread: Option<JoinHandle<()>>,
}

impl Supervisor {
    /// Starts the children.
    ///
    /// # Errors
    /// The system gave no thread.
    pub fn start(
        commands: Vec<ChildCommand>,
        policy: RestartPolicy,
        on_line: OnLine,
    ) -> std::io::Result<Self> {
        let state = |c: &ChildCommand| ChildState { name: c.name.clone(), ..Default::default() };
        let states = Arc::new(Mutex::new(commands.iter().map(state).collect::<Vec<_>>()));
        let stop = CancellationToken::new();
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let (kept, until) = (Arc::clone(&states), stop.clone());
        let work = move || {
            runtime.block_on(async {
                let mut tasks = tokio::task::JoinSet::new();
                for (index, command) in commands.into_iter().enumerate() {
                    let (states, on_line) = (Arc::clone(&kept), Arc::clone(&on_line));
                    let child = SupervisedChild { command, index, states, on_line };
                    tasks.spawn(keep_alive(child, policy, until.clone()));
                }
                while tasks.join_next().await.is_some() {}
            });
        };
        let thread = std::thread::Builder::new().name("supervisor".into()).spawn(work)?;
        Ok(Self { states, stop, thread: Some(thread) })
    }

    /// Returns the present states of the children.
    pub fn states(&self) -> Vec<ChildState> {
        self.states.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Returns a function that gives the process of a child while it runs, from any thread.
    pub fn pid_watch(&self, child: &str) -> Box<dyn Fn() -> Option<u32> + Send> {
        let (states, child) = (Arc::clone(&self.states), child.to_owned());
        Box::new(move || {
            let states = states.lock().unwrap_or_else(PoisonError::into_inner);
            states.iter().find(|state| state.name == child)?.pid
        })
    }

    /// Ends the children from another thread; they are gone when the supervisor is dropped.
    pub fn stop_token(&self) -> CancellationToken {
        self.stop.clone()
    }
}

impl Drop for Supervisor {
    fn drop(&mut self) {
        self.stop.cancel();
        if let Some(thread) = self.thread.take() {
            // A thread that panicked has let its children go, which ends them too.
            let _ = thread.join();
        }
    }
}

/// A child with all that its tasks share.
#[derive(Clone)]
struct SupervisedChild {
    command: ChildCommand,
    index: usize,
    states: Arc<Mutex<Vec<ChildState>>>,
    on_line: OnLine,
}

impl SupervisedChild {
    fn note(&self, change: impl FnOnce(&mut ChildState)) {
        let mut states = self.states.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(state) = states.get_mut(self.index) {
            change(state);
        }
    }

    fn begun(&self) -> Option<Instant> {
        let states = self.states.lock().unwrap_or_else(PoisonError::into_inner);
        states.get(self.index)?.begun
    }
}

async fn keep_alive(child: SupervisedChild, policy: RestartPolicy, stop: CancellationToken) {
    let mut restarts = Restarts::new(policy);
    while !stop.is_cancelled() {
        let Some(end) = run_once(&child, &stop).await else { return };
        let wait = restarts.wait_after(child.begun(), Instant::now());
        // Elsewhere the owner says it, with the last lines.
        if !child.command.reports_errors {
            let name = &child.command.name;
            tracing::warn!(child = name, end, "a child process ended; starting it again");
        }
        child.note(|state| {
            state.pid = None;
            state.restarts += 1;
            state.last_end = Some(end);
            state.begun = None;
            state.next_start = Some(Instant::now() + wait);
        });
        tokio::select! {
            () = tokio::time::sleep(wait) => {}
            () = stop.cancelled() => {}
        }
    }
}

/// Runs a child until it ends, and returns how; `None` if it was ended.
async fn run_once(shared: &SupervisedChild, stop: &CancellationToken) -> Option<String> {
    let command = &shared.command;
    let permit = match &command.gate {
        None => None,
        Some(gate) => tokio::select! {
            permit = Arc::clone(gate).acquire_owned() => permit.ok(),
            () = stop.cancelled() => return None,
        },
    };
    let mut child = match start(command) {
        Err(error) => return Some(format!("could not be started: {error}")),
        Ok(child) => child,
    };
    shared.note(|state| {
        state.pid = child.id();
        state.next_start = None;
        state.last_lines.clear();
        state.begun = command.gate.is_none().then(Instant::now);
    });
    // Held here: waiting for a child closes the input that it still has.
    let mut input = child.stdin.take();
    let output = child.stdout.take();
    let output = output.map(|output| tokio::spawn(read_output(output, shared.clone(), permit)));
    let errors = child.stderr.take();
    let errors = errors.map(|errors| tokio::spawn(read_errors(errors, shared.clone())));
    tokio::select! {
        status = child.wait() => {
            for mut reader in [output, errors].into_iter().flatten() {
                // Then its last words are those that have come, and others may start.
                if tokio::time::timeout(LAST_WORDS_TIME_MAX, &mut reader).await.is_err() {
                    reader.abort();
                }
            }
            Some(status.map_or_else(|error| error.to_string(), |status| status.to_string()))
        }
        never = send_signs_of_life(input.as_mut(), command.signs_of_life) => never,
        () = overdue(shared) => {
            drop(input);
            end(child).await;
            Some(format!("did not answer within {} s", GATED_TIME_MAX.as_secs()))
        }
        () = stop.cancelled() => {
            drop(input);
            end(child).await;
            None
        }
    }
}

/// Writes signs of life to a child, and never returns. Nothing waits for a child that reads none or
/// has closed its input.
async fn send_signs_of_life<T>(input: Option<&mut ChildStdin>, period: Option<Duration>) -> T {
    if let (Some(input), Some(period)) = (input, period) {
        loop {
            tokio::time::sleep(period).await;
            // An empty line means nothing to whatever reads it.
            if input.write_all(b"\n").await.is_err() {
                break;
            }
        }
    }
    std::future::pending().await
}

/// Returns when the beginning of a start has taken too long; never without a gate.
async fn overdue(shared: &SupervisedChild) {
    if shared.command.gate.is_none() {
        return std::future::pending().await;
    }
    tokio::time::sleep(GATED_TIME_MAX).await;
    if shared.begun().is_some() {
        std::future::pending::<()>().await;
    }
}

fn start(command: &ChildCommand) -> std::io::Result<Child> {
    let errors = if command.reports_errors { Stdio::piped() } else { Stdio::inherit() };
    Command::new(&command.program)
        .args(&command.arguments)
        .envs(command.environment.iter().cloned())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(errors)
        .process_group(0)
        .kill_on_drop(true)
        .spawn()
}

async fn read_output(
    output: impl AsyncRead + Unpin,
    shared: SupervisedChild,
    mut permit: Option<OwnedSemaphorePermit>,
) {
    let child = shared.command.name.as_str();
    read_lines(output, |text| {
        if permit.take().is_some() {
            shared.note(|state| state.begun = Some(Instant::now()));
        }
        (shared.on_line)(ChildLine { child, is_error: false, text });
    })
    .await;
}

async fn read_errors(errors: impl AsyncRead + Unpin, shared: SupervisedChild) {
    let child = shared.command.name.as_str();
    read_lines(errors, |text| {
        shared.note(|state| {
            if state.last_lines.len() == LAST_LINES_MAX {
                state.last_lines.pop_front();
            }
            state.last_lines.push_back(text.to_owned());
        });
        (shared.on_line)(ChildLine { child, is_error: true, text });
    })
    .await;
}

/// Passes on what a child writes line by line, until it closes its output.
async fn read_lines(output: impl AsyncRead + Unpin, mut on_line: impl FnMut(&str)) {
    let mut reader = BufReader::new(output);
    let mut bytes = Vec::new();
    // What follows in a line that was too long is no line.
    let mut is_rest = false;
    loop {
        bytes.clear();
        let read = (&mut reader).take(LINE_BYTES_MAX).read_until(b'\n', &mut bytes).await;
        if !matches!(read, Ok(1..)) {
            return;
        }
        let is_whole = bytes.last() == Some(&b'\n');
        let text = String::from_utf8_lossy(&bytes);
        let text = text.trim_end_matches(['\n', '\r']);
        if !is_rest && !text.is_empty() {
            on_line(text);
        }
        is_rest = !is_whole;
    }
}

/// Waits for a child whose input has ended, and kills it where it does not end.
async fn end(mut child: Child) {
    if tokio::time::timeout(END_TIME_MAX, child.wait()).await.is_err() {
        // Gone already is as good.
        let _ = child.kill().await;
    }
}

#[cfg(test)]
mod tests;
