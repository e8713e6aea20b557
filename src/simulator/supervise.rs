//! Child processes: started, started again a second after they end, ended with their parent.
//!
//! A child reads its standard input, which ends when this process does, however it ends: no
//! orphan is left even by SIGKILL. Children have process groups of their own: what is typed at a
//! terminal reaches this process only, which decides when they end.

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::Stdio;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use tokio::io::{AsyncBufReadExt, BufReader};
use tokio::process::{Child, ChildStdout, Command};
use tokio_util::sync::CancellationToken;

/// Between the end of a child and its next start.
const RESTART_WAIT: Duration = Duration::from_secs(1);

/// Maximum time for a child to end by itself when it is asked to.
const END_TIME_MAX: Duration = Duration::from_secs(2);

/// The command that starts a child.
#[derive(Clone, Debug)]
pub(crate) struct ChildCommand {
    pub name: String,
    pub program: PathBuf,
    pub arguments: Vec<OsString>,
    pub environment: Vec<(OsString, OsString)>,
}

/// The state of a child.
#[derive(Clone, Debug, Default)]
pub(crate) struct ChildState {
    pub name: String,
    pub pid: Option<u32>,
    pub restarts: u64,
    /// The way in which it ended the last time.
    pub last_end: Option<String>,
}

/// A callback for each line that a child writes to its standard output.
pub(crate) type OnLine = Arc<dyn Fn(&str) + Send + Sync>;

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
    pub fn start(commands: Vec<ChildCommand>, on_line: OnLine) -> std::io::Result<Self> {
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
                    tasks.spawn(keep_alive(command, index, states, until.clone(), on_line));
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

async fn keep_alive(
    command: ChildCommand,
    index: usize,
    states: Arc<Mutex<Vec<ChildState>>>,
    stop: CancellationToken,
    on_line: OnLine,
) {
    let note = |change: &dyn Fn(&mut ChildState)| {
        let mut states = states.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(state) = states.get_mut(index) {
            change(state);
        }
    };
    while !stop.is_cancelled() {
        let end = match start(&command) {
            Err(error) => format!("could not be started: {error}"),
            Ok(mut child) => {
                note(&|state| state.pid = child.id());
                // Held here: waiting for a child closes the input that it still has.
                let input = child.stdin.take();
                if let Some(output) = child.stdout.take() {
                    tokio::spawn(read_lines(output, Arc::clone(&on_line)));
                }
                tokio::select! {
                    status = child.wait() => {
                        status.map_or_else(|error| error.to_string(), |status| status.to_string())
                    }
                    () = stop.cancelled() => {
                        drop(input);
                        end(child).await;
                        return;
                    }
                }
            }
        };
        if stop.is_cancelled() {
            return;
        }
        tracing::warn!(child = command.name, end, "a child process ended; starting it again");
        note(&|state| {
            state.pid = None;
            state.restarts += 1;
            state.last_end = Some(end.clone());
        });
        tokio::select! {
            () = tokio::time::sleep(RESTART_WAIT) => {}
            () = stop.cancelled() => {}
        }
    }
}

fn start(command: &ChildCommand) -> std::io::Result<Child> {
    Command::new(&command.program)
        .args(&command.arguments)
        .envs(command.environment.iter().cloned())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .process_group(0)
        .kill_on_drop(true)
        .spawn()
}

/// Passes on what a child writes, until it closes its output.
async fn read_lines(output: ChildStdout, on_line: OnLine) {
    let mut lines = BufReader::new(output).lines();
    while let Ok(Some(line)) = lines.next_line().await {
        on_line(&line);
    }
}

/// Waits for a child whose input has ended, and kills it where it does not end.
async fn end(mut child: Child) {
    if tokio::time::timeout(END_TIME_MAX, child.wait()).await.is_err() {
        // Gone already is as good.
        let _ = child.kill().await;
    }
}
