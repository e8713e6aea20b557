//! A whole wall on this machine: the manager on a thread, a child process for each server.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use polyptych_client::blocking::Client;
use polyptych_client::{ChannelState, ConnectOptions};
use polyptych_manager::http::HttpOptions;
use polyptych_manager::import::Baker;
use polyptych_manager::recorder::Recorder;
use polyptych_manager::{ManagerOptions, run as run_manager};
use polyptych_protocol::token;
use polyptych_wall::Wall;
use tokio_util::sync::CancellationToken;

use crate::cli::shutdown_signal::watch_shutdown_signals;
use crate::logging;
use crate::simulator::ending::{EndRequest, Ending};
use crate::simulator::faults::{FaultHooks, FaultProxy};
use crate::supervisor::{ChildCommand, ChildState, OnLine, RestartPolicy, Supervisor};

/// Maximum time for all servers together to connect: a machine with two cores opens sixteen
/// software devices in about ten seconds.
const START_TIME_MAX: Duration = Duration::from_secs(90);

/// Between two looks at who has come.
const LOOK_PERIOD: Duration = Duration::from_millis(50);

/// Servers come back so long after they ended: a report of faults counts on it.
const RESTARTS: RestartPolicy = RestartPolicy::even(Duration::from_secs(1));

/// Longest wait for a scene: it is baked first.
const OPEN_TIME_MAX: Duration = Duration::from_mins(30);

/// The beginning of a line of standard output by which a server tells its parent that the user has
/// closed a window; the channel's name follows.
pub(crate) const WINDOW_CLOSED: &str = "window closed:";

/// The exit code of an interrupted process: 128 and the number of SIGINT.
pub(crate) const INTERRUPTED: u8 = 130;

/// The options of a local wall.
#[derive(Debug)]
pub(crate) struct LocalWallOptions {
    /// Its files are baked.
    pub wall: Wall,
    pub scene_roots: Vec<PathBuf>,
    pub baker: Baker,
    pub windows: bool,
    pub recorder: Option<Recorder>,
    /// Servers leave out what others hide, where that is faster.
    pub culls_occluded: bool,
    /// The hooks that its faults need.
    pub needs: FaultHooks,
    /// The address at which its manager serves HTTP.
    pub http: Option<HttpOptions>,
}

/// The fault hooks of a server, beside its process.
#[derive(Debug, Default)]
struct FaultHook {
    relay: Option<Arc<FaultProxy>>,
    /// The file that says by how much every frame is slowed.
    slow_file: Option<PathBuf>,
}

/// A running wall; dropping it ends its manager and its children.
#[derive(Debug)]
pub(crate) struct LocalWall {
    pub client: Client,
    supervisor: Supervisor,
    stop: CancellationToken,
    manager: Option<JoinHandle<()>>,
    pub end: Arc<EndRequest>,
    /// Its own token, which ends with it.
    pub token: String,
    /// By server.
    hurts: BTreeMap<String, FaultHook>,
    /// Holds the token, and what slows servers.
    #[expect(dead_code, reason = "it is removed when this ends")]
    folder: tempfile::TempDir,
}

impl LocalWall {
    /// Starts manager and servers, and waits until all channels could draw.
    ///
    /// # Errors
    /// A thread or a process did not start; the error says which and why. [`Ending`] if the work
    /// was to end meanwhile.
    pub fn start(options: LocalWallOptions) -> anyhow::Result<Self> {
        let LocalWallOptions { mut wall, scene_roots, baker, recorder, needs, http, .. } = options;
        let LocalWallOptions { windows, culls_occluded, .. } = options;
        let folder = tempfile::Builder::new().prefix("polyptych-").tempdir()?;
        let token_file = folder.path().join("token");
        let mut secret = [0; 16];
        getrandom::fill(&mut secret).map_err(|error| anyhow::anyhow!("no random: {error}"))?;
        let token = token::read_or_create(&token_file, secret)?;
        let listener = std::net::TcpListener::bind("127.0.0.1:0").context("no port is free")?;
        let socket = listener.local_addr()?;
        let address = socket.to_string();
        // All on one disk: what the baker wrote, the servers read where it lies.
        wall.stores.push(baker.store.join("blobs").display().to_string());
        let hurts = hurts(&needs, socket, folder.path())?;
        let mut commands = server_commands(&wall, &address, &token_file, windows, &hurts)?;
        if !culls_occluded {
            for server in &mut commands {
                server.arguments.push("--no-occlusion".into());
            }
        }
        let stop = CancellationToken::new();
        let token_given = token.clone();
        let options = ManagerOptions {
            wall,
            token: token_given,
            keys: None,
            scene_roots,
            baker,
            memory: None,
            leadership: None,
            is_navigable: windows,
            recorder,
            metrics: None,
            http,
            notifier: None,
        };
        let manager = start_manager(listener, options, stop.clone())?;
        let end = Arc::new(EndRequest::default());
        // Before there are processes: until then a signal ends this one on the spot.
        end_on_interrupt(&end, folder.path())?;
        let supervisor = Supervisor::start(commands, RESTARTS, on_line(&end))?;
        end.add_stop(stop.clone());
        end.add_stop(supervisor.stop_token());
        let mut connect = ConnectOptions::new(address);
        connect.token = Some(token.clone());
        connect.keys = None;
        connect.name = "simulate".into();
        // Its manager is in this process, and does not come back.
        connect.reconnect = None;
        connect.timeouts.open_scene = OPEN_TIME_MAX;
        let asked = Arc::clone(&end);
        let started = Client::connect_with(connect).map_err(Into::into).and_then(|client| {
            let manager = Some(manager);
            let wall = Self { client, supervisor, stop, manager, end, token, hurts, folder };
            wall.await_channels()?;
            Ok(wall)
        });
        // What else failed then failed for that reason.
        match asked.ending() {
            Some(ending) => Err(ending.into()),
            None => started,
        }
    }

    /// Times that a server was started again.
    pub fn restarts(&self) -> u64 {
        self.supervisor.states().iter().map(|state| state.restarts).sum()
    }

    fn child(&self, server: &str) -> Option<ChildState> {
        self.supervisor.states().into_iter().find(|state| state.name == server)
    }

    /// The process of a server, where it is running.
    pub fn pid_of(&self, server: &str) -> Option<u32> {
        self.child(server)?.pid
    }

    /// A function that gives the process of a server while it is running, from any thread.
    pub fn pid_watch(&self, server: &str) -> Box<dyn Fn() -> Option<u32> + Send> {
        self.supervisor.pid_watch(server)
    }

    /// Times that this server was started again and came to run.
    pub fn restarts_of(&self, server: &str) -> u64 {
        let Some(ChildState { pid, restarts, .. }) = self.child(server) else { return 0 };
        // One that has ended is counted when it ends.
        if pid.is_some() { restarts } else { restarts.saturating_sub(1) }
    }

    /// The relay that this server's connections go through.
    pub fn relay(&self, server: &str) -> Option<&Arc<FaultProxy>> {
        self.hurts.get(server)?.relay.as_ref()
    }

    /// The file that says by how many milliseconds this server's frames are slowed.
    pub fn slow_file(&self, server: &str) -> Option<PathBuf> {
        self.hurts.get(server)?.slow_file.clone()
    }

    /// Waits until all channels could draw.
    ///
    /// # Errors
    /// A server ended, one is not ready in time, or the program is to end.
    pub fn await_channels(&self) -> anyhow::Result<()> {
        let deadline = Instant::now() + START_TIME_MAX;
        loop {
            let status = self.client.status()?;
            let is_there = |state| {
                matches!(state, ChannelState::Ready | ChannelState::Live | ChannelState::Late)
            };
            let absent: Vec<_> = status.channels.iter().filter(|c| !is_there(c.state)).collect();
            if absent.is_empty() {
                return Ok(());
            }
            // A server that ends at its first start has said why on standard error.
            for child in self.supervisor.states() {
                if let Some(end) = child.last_end {
                    bail!("the server {} ended ({end}); its last words stand above", child.name);
                }
            }
            if Instant::now() > deadline {
                let list: Vec<_> = absent
                    .iter()
                    .map(|c| format!("{} ({})", c.name, c.reason.as_deref().unwrap_or("no reason")))
                    .collect();
                let seconds = START_TIME_MAX.as_secs();
                bail!("not ready after {seconds} s: {}", list.join(", "));
            }
            if let Some(ending) = self.end.wait_until(Instant::now() + LOOK_PERIOD) {
                return Err(ending.into());
            }
        }
    }
}

impl Drop for LocalWall {
    fn drop(&mut self) {
        self.stop.cancel();
        self.supervisor.stop_token().cancel();
        if let Some(manager) = self.manager.take() {
            // Its error was logged; there is nothing more to do about it now.
            let _ = manager.join();
        }
    }
}

fn start_manager(
    listener: std::net::TcpListener,
    options: ManagerOptions,
    stop: CancellationToken,
) -> anyhow::Result<JoinHandle<()>> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let work = move || {
        let shutdown = async move { stop.cancelled().await };
        if let Err(error) = runtime.block_on(run_manager(listener, options, shutdown)) {
            tracing::error!(%error, "the manager failed");
        }
    };
    Ok(std::thread::Builder::new().name("manager".into()).spawn(work)?)
}

fn hurts(
    needs: &FaultHooks,
    manager: SocketAddr,
    folder: &Path,
) -> anyhow::Result<BTreeMap<String, FaultHook>> {
    let mut hurts: BTreeMap<String, FaultHook> = BTreeMap::new();
    for server in &needs.relayed {
        let relay = FaultProxy::start(manager).context("no relay can be had")?;
        hurts.entry(server.clone()).or_default().relay = Some(Arc::new(relay));
    }
    for (index, server) in needs.slowed.iter().enumerate() {
        let file = folder.join(format!("slow-{index}"));
        hurts.entry(server.clone()).or_default().slow_file = Some(file);
    }
    Ok(hurts)
}

/// One child for each server of the wall file, with all its channels.
fn server_commands(
    wall: &Wall,
    address: &str,
    token_file: &Path,
    windows: bool,
    hurts: &BTreeMap<String, FaultHook>,
) -> anyhow::Result<Vec<ChildCommand>> {
    let program = std::env::current_exe().context("this program's own file is not known")?;
    let mut servers: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for channel in &wall.channels {
        servers.entry(&channel.server).or_default().push(&channel.name);
    }
    let command = |(name, channels): (&str, Vec<&str>)| {
        let mut arguments: Vec<OsString> =
            ["server", "--with-parent", "--tell-closed", "--manager"].map(Into::into).to_vec();
        let hurt = hurts.get(name);
        let relay = hurt.and_then(|hurt| hurt.relay.as_ref());
        arguments.push(relay.map_or(address.into(), |relay| relay.address().to_string().into()));
        arguments.extend(["--name", name].map(OsString::from));
        if let Some(file) = hurt.and_then(|hurt| hurt.slow_file.as_ref()) {
            arguments.extend(["--slow-draw".into(), file.into()]);
        }
        for channel in channels {
            arguments.extend(["--channel", channel].map(OsString::from));
        }
        arguments.push(if windows { "--window" } else { "--headless" }.into());
        arguments.extend(["--log".into(), logging::of_children().into()]);
        let mut environment: Vec<(OsString, OsString)> =
            vec![(token::TOKEN_FILE_VARIABLE.into(), token_file.into())];
        // Drivers complain once for each process where this is missing, as it is in containers.
        if std::env::var_os("XDG_RUNTIME_DIR").is_none() {
            let folder = token_file.parent().unwrap_or(token_file);
            environment.push(("XDG_RUNTIME_DIR".into(), folder.into()));
        }
        let program = program.clone();
        ChildCommand {
            name: name.to_owned(),
            program,
            arguments,
            environment,
            gate: None,
            reports_errors: false,
            signs_of_life: None,
        }
    };
    Ok(servers.into_iter().map(command).collect())
}

/// Hears of windows that the user closes.
fn on_line(end: &Arc<EndRequest>) -> OnLine {
    let end = Arc::clone(end);
    Arc::new(move |line| {
        if line.text.starts_with(WINDOW_CLOSED) {
            end.request(Ending::WindowClosed);
        }
    })
}

/// The work of this process on walls, and what a Ctrl-C does to it: one watcher for all walls, of
/// which a benchmark starts hundreds.
#[derive(Debug, Default)]
struct InterruptWatch {
    is_running: bool,
    is_interrupted: bool,
    /// Requests to end of work that goes on, with the folder of its wall.
    work: Vec<(Weak<EndRequest>, PathBuf)>,
}

static INTERRUPTS: Mutex<InterruptWatch> =
    Mutex::new(InterruptWatch { is_running: false, is_interrupted: false, work: Vec::new() });

fn interrupts() -> MutexGuard<'static, InterruptWatch> {
    INTERRUPTS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Asks the work to end at the first request, and ends this process at the second.
fn end_on_interrupt(end: &Arc<EndRequest>, folder: &Path) -> anyhow::Result<()> {
    let mut watch = interrupts();
    watch.work.retain(|(end, _)| end.strong_count() > 0);
    watch.work.push((Arc::downgrade(end), folder.to_owned()));
    // The user has asked while no wall was there.
    if watch.is_interrupted {
        end.request(Ending::Interrupted);
    }
    if !watch.is_running {
        watch_shutdown_signals(None, interrupt)?;
        watch.is_running = true;
    }
    Ok(())
}

/// Returns whether the user has asked all work on walls to end.
pub(crate) fn is_interrupted() -> bool {
    interrupts().is_interrupted
}

fn interrupt() {
    let mut watch = interrupts();
    if !std::mem::replace(&mut watch.is_interrupted, true) {
        let work = watch.work.iter().filter_map(|(end, _)| end.upgrade());
        work.for_each(|end| end.request(Ending::Interrupted));
        return;
    }
    logging::say_failure("simulate", "interrupted again: ending at once");
    logging::finish();
    // The token is in it. Children end when their standard input does.
    for (_, folder) in &watch.work {
        let _ = std::fs::remove_dir_all(folder);
    }
    std::process::exit(i32::from(INTERRUPTED));
}
