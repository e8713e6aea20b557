//! `polyptych manager`: the one process of a wall that decides.

mod standby;

use std::io::ErrorKind;
use std::net::{SocketAddr, TcpListener, ToSocketAddrs};
use std::os::fd::AsFd;
use std::path::{Path, PathBuf};
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use anyhow::{Context, bail};
use polyptych_manager::http::HttpOptions;
use polyptych_manager::lease::LEASE_TIME_DEFAULT;
use polyptych_manager::recorder::Recorder;
use polyptych_manager::recorder::ring::RingError;
use polyptych_manager::{ManagerOptions, run as run_manager};
use polyptych_protocol::command::Goodbye;
use polyptych_protocol::service_notifier::ServiceNotifier;
use polyptych_protocol::token;
use polyptych_tls::{Credentials, CredentialsError, NodeIdentity};
use polyptych_wall::Wall;

use super::bake_arguments::BakeArguments;
use super::shutdown_signal::{ParentEnd, SILENCE_MAX, shutdown_signal, watch_input};
use super::{bake_files, cache_folder, http, load_wall, log_file_warnings, say};
use crate::logging;
use crate::state_lock::{self, StateLock};

/// The way to more memory for bakes of a manager, for whoever opens a scene.
const MEMORY_REMEDY: &str = "start the manager with --bake-memory-mib N to allow more";

/// The same for a manager that `polyptych up` has started.
const MEMORY_REMEDY_OF_UP: &str = "write manager_arguments = [\"--bake-memory-mib\", \"N\"] under \
                                   [launch] of the wall file to allow more";

/// Time between two looks at keys that are not valid yet.
const CLOCK_PERIOD: Duration = Duration::from_secs(1);

#[derive(Debug, clap::Args)]
pub(super) struct Arguments {
    /// The wall file
    wall: PathBuf,
    /// Where to listen, instead of the wall file's address
    #[arg(long, value_name = "ADDR")]
    listen: Option<String>,
    /// A folder from which scenes may be opened, beside the wall file's; may be given again
    #[arg(long, value_name = "DIR")]
    scenes: Vec<PathBuf>,
    /// Where baked scenes are kept [default: in this user's cache folder]
    #[arg(long, value_name = "DIR")]
    store: Option<PathBuf>,
    /// The file with the token, made where it is not there
    #[arg(long, value_name = "FILE", env = token::TOKEN_FILE_VARIABLE)]
    token_file: Option<PathBuf>,
    /// Where the open scene and the camera are remembered over a restart [default: in this
    /// user's state folder, by the wall's name and the port]
    #[arg(long, value_name = "FILE", conflicts_with = "afresh")]
    state: Option<PathBuf>,
    /// Share the wall with other managers that have the same state file, on any machines: one
    /// leads, the others wait and take over once it is gone. Give each this flag, and servers and
    /// clients the addresses of all
    #[arg(long, requires = "state")]
    standby: bool,
    /// Seconds after which a leader of which nothing is heard is replaced, from 0.2 to 60
    /// [default: 1]
    #[arg(long, value_name = "SECONDS", value_parser = standby::lease_time, requires = "standby")]
    lease_time: Option<Duration>,
    /// Begin without a scene, whatever the last manager of this wall showed
    #[arg(long)]
    afresh: bool,
    /// Record what the manager is told, to be replayed: a ring of 128 MiB at most
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    #[command(flatten)]
    bake: BakeArguments,
    /// Offer metrics for Prometheus at http://ADDR/metrics
    #[arg(long, value_name = "ADDR")]
    metrics: Option<String>,
    /// Serve the page for browsers and the HTTP interface at http://ADDR/, or https with keys
    #[arg(long, value_name = "ADDR", value_parser = http::address)]
    http: Option<String>,
    /// A name by which browsers may reach the page, beside addresses and localhost; may be given
    /// again
    #[arg(long, value_name = "NAME", requires = "http")]
    http_host: Vec<String>,
    /// The manager's folder of keys, as `polyptych keys` makes it: all connections are encrypted,
    /// and every peer shows a certificate
    #[arg(long, value_name = "FOLDER")]
    keys: Option<PathBuf>,
    /// Listen on an address that other machines reach without keys, though nothing is encrypted
    #[arg(long)]
    insecure: bool,
    /// Let the mouse over the windows of servers move the camera, and fingers on their displays; in
    /// full screen fingers only
    /// [default: true on an address of this machine without keys, else false]
    #[arg(long, value_name = "BOOL", num_args = 0..=1, default_missing_value = "true")]
    #[arg(require_equals = true)]
    navigate: Option<bool>,
    /// A file that holds "starting" or "ready" and is touched every 2 s while the manager works,
    /// for probes; systemd is told without it
    #[arg(long, value_name = "FILE")]
    alive: Option<PathBuf>,
    /// End when standard input ends, as it does when the parent process does, and tell the parent
    /// if a client stops the wall
    #[arg(long, hide = true)]
    with_parent: bool,
}

/// The line of standard output by which a manager tells its parent that a client has stopped it.
pub(super) const WALL_STOPPED: &str = "wall stopped";

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let mut wall = load_wall(&arguments.wall)?;
    let listen = arguments.listen.clone().unwrap_or_else(|| wall.listen.clone());
    let is_running = Arc::new(AtomicBool::new(false));
    let parent = arguments.with_parent.then(|| end_with_parent(&is_running)).transpose()?;
    if let Some(folder) = &arguments.keys {
        let keys = load_keys(|| Credentials::load(folder), || thread::sleep(CLOCK_PERIOD))?;
        keys.expect_identity(&NodeIdentity::Manager)?;
    }
    let listeners = Listeners::inherit_or_bind(arguments, &listen)?;
    let address = listeners.main.local_addr()?;
    let mut listeners = Some(listeners);
    let token = match &arguments.token_file {
        Some(path) => path.clone(),
        None => token::default_path()?,
    };
    let scene_roots = scene_roots(&wall, &arguments.scenes)?;
    let store = match &arguments.store {
        Some(store) => store.clone(),
        None => cache_folder()?.join("store"),
    };
    let remedy = if arguments.with_parent { MEMORY_REMEDY_OF_UP } else { MEMORY_REMEDY };
    let baker = arguments.bake.baker_in(store, remedy)?;
    log_file_warnings(&bake_files(&mut wall, &arguments.wall, &baker)?);
    let memory = state_file(arguments, &token, &wall.name, address.port())?;
    let lock = if arguments.standby { StateLock::share } else { StateLock::take };
    let _lock = memory.as_deref().map(lock).transpose()?;
    let notifier = ServiceNotifier::from_environment(arguments.alive.as_deref())?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let mut is_asked_to_end = pin!(shutdown_signal(parent)?);
    is_running.store(true, Ordering::Relaxed);
    // Whoever sits before a display of another machine is not asked for the camera.
    let is_own = address.ip().is_loopback() && arguments.keys.is_none();
    let mut options = ManagerOptions {
        wall,
        token: String::new(),
        keys: arguments.keys.clone(),
        scene_roots,
        baker,
        memory,
        leadership: None,
        is_navigable: arguments.navigate.unwrap_or(is_own),
        recorder: None,
        metrics: None,
        http: None,
        notifier,
    };
    if let Some(state) = options.memory.as_deref().filter(|_| arguments.standby) {
        // Who does not lead accepts nothing, so that peers go on to the manager that does.
        drop(listeners.take());
        let time = arguments.lease_time.unwrap_or(LEASE_TIME_DEFAULT);
        let (notifier, end) = (options.notifier.as_ref(), is_asked_to_end.as_mut());
        let leadership = standby::wait(&runtime, state, address, time, notifier, end)?;
        if leadership.is_none() {
            return Ok(());
        }
        options.leadership = leadership;
    }
    let leadership = options.leadership.clone();
    let opened = open(arguments, &listen, listeners, &token, &mut options);
    let listener = standby::or_release(leadership.as_ref(), opened)?;
    let goodbye = runtime.block_on(run_manager(listener, options, is_asked_to_end));
    // A folder or a resolver of names that does not answer is not waited for.
    runtime.shutdown_background();
    let goodbye = standby::or_release(leadership.as_ref(), goodbye)?;
    if arguments.with_parent && goodbye != Goodbye::Ended {
        say(WALL_STOPPED)?;
    }
    Ok(())
}

/// Opens the token, the recording and the sockets that are not open yet, for a manager that leads
/// its wall or is the only one; returns the socket of its peers.
fn open(
    arguments: &Arguments,
    listen: &str,
    listeners: Option<Listeners>,
    token: &Path,
    options: &mut ManagerOptions,
) -> anyhow::Result<TcpListener> {
    let Listeners { main: listener, metrics, http } = match listeners {
        Some(listeners) => listeners,
        None => Listeners::bind(arguments, listen, None)?,
    };
    (options.metrics, options.http) = (metrics, http);
    // With keys nobody is asked for it.
    if arguments.keys.is_none() {
        options.token = make_token(token)?;
    }
    if let Some(path) = &arguments.record {
        options.recorder = Some(match Recorder::open(path) {
            Ok(recorder) => recorder,
            // The leader before may hang with the file open, and the wall goes on all the same.
            Err(error @ (RingError::Busy { .. } | RingError::Io { .. }))
                if options.leadership.is_some() =>
            {
                tracing::warn!(%error, "the wall goes on without its recording");
                Recorder::without_file(&error)
            }
            Err(error) => return Err(error.into()),
        });
    }
    log_addresses(options, listener.local_addr()?, token)?;
    Ok(listener)
}

/// Ends this process if its parent ends before `is_running`: a bake takes minutes, in which no
/// event loop notices. Bakers end by their own standard input.
fn end_with_parent(is_running: &Arc<AtomicBool>) -> std::io::Result<ParentEnd> {
    watch_early(std::io::stdin(), Arc::clone(is_running), || {
        logging::finish();
        std::process::exit(0);
    })
}

/// Calls `end`, on a thread of its own, if the parent at the input is gone before `is_running`.
fn watch_early(
    input: impl AsFd + Send + 'static,
    is_running: Arc<AtomicBool>,
    end: impl FnOnce() + Send + 'static,
) -> std::io::Result<ParentEnd> {
    watch_input(input, SILENCE_MAX, move || {
        if !is_running.load(Ordering::Relaxed) {
            end();
        }
    })
}

/// Loads the manager's keys. Machines without a battery start in the past: until their time has
/// begun, `pause` is called between two attempts. No supervisor counts signs of life before the
/// first one.
fn load_keys<T>(
    mut load: impl FnMut() -> Result<T, CredentialsError>,
    mut pause: impl FnMut(),
) -> Result<T, CredentialsError> {
    let mut is_told = false;
    loop {
        match load() {
            Err(error @ CredentialsError::NotYetValid { identity: NodeIdentity::Manager, .. }) => {
                if !std::mem::replace(&mut is_told, true) {
                    tracing::warn!(%error, "waiting for the right time");
                }
                pause();
            }
            loaded => return loaded,
        }
    }
}

/// The file in which the open scene and the camera are remembered; `None` to remember nothing.
fn state_file(
    arguments: &Arguments,
    token: &Path,
    wall: &str,
    port: u16,
) -> anyhow::Result<Option<PathBuf>> {
    if arguments.afresh {
        return Ok(None);
    }
    // Beside the token: what a user's managers keep stands in one folder. Two managers of one wall
    // have two ports.
    let beside = || token.with_file_name(format!("{}-{port}.state", file_name(wall)));
    let path = arguments.state.clone().unwrap_or_else(beside);
    let resolved = state_lock::resolve(&path);
    resolved.map(Some).with_context(|| format!("--state {}", path.display()))
}

/// Logs where this manager is reached, and by what.
fn log_addresses(
    options: &ManagerOptions,
    address: SocketAddr,
    token: &Path,
) -> anyhow::Result<()> {
    let secret = options.keys.as_deref().unwrap_or(token).display();
    let peers_need = if options.keys.is_some() { "keys" } else { "token" };
    let wall = &options.wall.name;
    tracing::info!(%address, wall, peers_need, %secret, "manager listens");
    if let Some(metrics) = &options.metrics {
        let address = metrics.local_addr()?;
        tracing::info!(url = %format_args!("http://{address}/metrics"), "metrics are offered");
    }
    if let Some(http) = &options.http {
        let url = http::url(http.listener.local_addr()?, options.keys.is_some());
        tracing::info!(%url, "HTTP is offered; polyptych login prints a link");
    }
    Ok(())
}

/// The sockets of a manager.
struct Listeners {
    main: TcpListener,
    metrics: Option<TcpListener>,
    http: Option<HttpOptions>,
}

impl Listeners {
    fn inherit_or_bind(arguments: &Arguments, listen: &str) -> anyhow::Result<Self> {
        let inherited = inherited_listener(arguments.keys.is_some() || arguments.insecure)?;
        if inherited.is_some() && arguments.standby {
            bail!(
                "a socket of the service manager takes connections while --standby waits; remove \
                 the socket unit, or --standby"
            );
        }
        if let (Some(listener), Some(asked)) = (&inherited, &arguments.listen) {
            expect_address(listener.local_addr()?, asked)?;
        }
        Self::bind(arguments, listen, inherited)
    }

    fn bind(
        arguments: &Arguments,
        listen: &str,
        inherited: Option<TcpListener>,
    ) -> anyhow::Result<Self> {
        let may_be_open = arguments.keys.is_some() || arguments.insecure;
        let main = match inherited {
            Some(listener) => listener,
            None => bind(listen, may_be_open)?,
        };
        let metrics = arguments.metrics.as_ref().map(|at| bind_metrics(at, arguments.insecure));
        let hosts = || arguments.http_host.clone();
        let http = arguments.http.as_ref().map(|at| http::bind(at, may_be_open, hosts()));
        Ok(Self { main, metrics: metrics.transpose()?, http: http.transpose()? })
    }
}

/// The socket that a service manager has bound for this process, if there is one.
fn inherited_listener(may_be_open: bool) -> anyhow::Result<Option<TcpListener>> {
    let mut sockets = listenfd::ListenFd::from_env();
    if sockets.len() > 1 {
        bail!(
            "the service manager hands over {} sockets; write one ListenStream into the unit",
            sockets.len()
        );
    }
    let listener = sockets.take_tcp_listener(0).context(
        "the socket of the service manager is none of TCP; write ListenStream=ADDRESS:PORT into \
         the socket unit",
    )?;
    if let Some(listener) = &listener {
        refuse_open_address(&[listener.local_addr()?], may_be_open)?;
    }
    Ok(listener)
}

/// Checks that the socket of the service manager is where `--listen` says.
fn expect_address(found: SocketAddr, asked: &str) -> anyhow::Result<()> {
    let mut addresses = asked
        .to_socket_addrs()
        .with_context(|| format!("cannot listen on {asked}; an address is HOST:PORT"))?;
    if !addresses.any(|address| address == found) {
        bail!(
            "--listen is {asked}, and the socket of the service manager listens on {found}; write \
             one address into both, or leave --listen out"
        );
    }
    Ok(())
}

/// The folders of the wall file and those of the command.
fn scene_roots(wall: &Wall, asked: &[PathBuf]) -> anyhow::Result<Vec<PathBuf>> {
    let mut roots: Vec<PathBuf> = wall.scenes.iter().map(PathBuf::from).collect();
    for folder in roots.iter().filter(|folder| !folder.is_dir()) {
        tracing::warn!(
            folder = %folder.display(),
            "a scene folder of the wall file does not exist; no scene in it can be opened"
        );
    }
    if let Some(folder) = asked.iter().find(|folder| !folder.is_dir()) {
        bail!("--scenes {}: not a folder", folder.display());
    }
    roots.extend_from_slice(asked);
    Ok(roots)
}

/// A wall's name as a part of a file's: names of walls may hold anything.
fn file_name(wall: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || "-_".contains(c) { c } else { '_' };
    wall.chars().map(plain).collect()
}

/// The token in this file, which is made where it is not there.
pub(super) fn make_token(path: &Path) -> anyhow::Result<String> {
    let mut secret = [0; 16];
    getrandom::fill(&mut secret).map_err(|error| anyhow::anyhow!("no random numbers: {error}"))?;
    Ok(token::read_or_create(path, secret)?)
}

pub(super) fn bind(listen: &str, may_be_open: bool) -> anyhow::Result<TcpListener> {
    let resolved = listen.to_socket_addrs();
    let addresses: Vec<SocketAddr> = resolved
        .with_context(|| format!("cannot listen on {listen}; an address is HOST:PORT"))?
        .collect();
    refuse_open_address(&addresses, may_be_open)?;
    TcpListener::bind(&addresses[..]).map_err(|error| match error.kind() {
        ErrorKind::AddrInUse => anyhow::anyhow!(
            "{listen} is in use; end the manager that runs there (polyptych stop --manager \
             {listen}) or choose another address with --listen"
        ),
        _ => anyhow::anyhow!("cannot listen on {listen}: {error}"),
    })
}

/// Refuses addresses that other machines reach, without keys.
fn refuse_open_address(addresses: &[SocketAddr], may_be_open: bool) -> anyhow::Result<()> {
    if let Some(open) = addresses.iter().find(|address| !address.ip().is_loopback())
        && !may_be_open
    {
        bail!(
            "{open} can be reached from other machines, and without keys nothing is encrypted; \
             make keys with polyptych keys WALL.toml and say --keys FOLDER, or listen on \
             127.0.0.1, or say --insecure on a network that you trust"
        );
    }
    Ok(())
}

/// Metrics are plain HTTP without a password.
fn bind_metrics(at: &str, insecure: bool) -> anyhow::Result<TcpListener> {
    let resolved = at.to_socket_addrs();
    let addresses: Vec<SocketAddr> =
        resolved.with_context(|| format!("--metrics {at}: an address is HOST:PORT"))?.collect();
    if let Some(open) = addresses.iter().find(|address| !address.ip().is_loopback())
        && !insecure
    {
        bail!(
            "--metrics {at}: {open} can be reached from other machines, and metrics are neither \
             encrypted nor behind a password; use 127.0.0.1, or say --insecure on a network that \
             you trust"
        );
    }
    TcpListener::bind(&addresses[..])
        .map_err(|error| anyhow::anyhow!("--metrics {at}: cannot listen there: {error}"))
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    #[test]
    fn the_end_of_the_parent_ends_a_manager_that_does_not_run_yet() {
        for runs in [false, true] {
            let (end, has_ended) = std::sync::mpsc::sync_channel(1);
            let end = move || end.send(()).expect("heard");
            let (input, _) = std::io::pipe().expect("a pipe");
            let ends = watch_early(input, Arc::new(AtomicBool::new(runs)), end);
            ends.expect("a thread").blocking_recv().expect_err("nobody is there to say it");
            assert_eq!(has_ended.try_recv().is_ok(), !runs);
        }
    }

    #[test]
    fn keys_that_are_not_valid_yet_are_waited_for() {
        let early = |identity| CredentialsError::NotYetValid { path: "k".into(), identity };
        let clock = Cell::new(0);
        let is_right = || (clock.get() == 3).then_some(());
        let pause = || clock.set(clock.get() + 1);
        load_keys(|| is_right().ok_or_else(|| early(NodeIdentity::Manager)), pause)
            .expect("the clock is right");
        // Those of another node are good at no time.
        let of_client = || Err::<(), _>(early(NodeIdentity::Client("c".into())));
        load_keys(of_client, pause).expect_err("not the manager's");
        assert_eq!(clock.get(), 3);
    }

    #[test]
    fn a_socket_elsewhere_than_asked_is_refused_with_both_addresses() {
        let found = SocketAddr::from(([127, 0, 0, 1], 7878));
        expect_address(found, "127.0.0.1:7878").expect("the same");
        for asked in ["127.0.0.1:7879", "0.0.0.0:7878"] {
            let error = expect_address(found, asked).expect_err(asked).to_string();
            assert!(error.contains(asked) && error.contains("127.0.0.1:7878"), "{error}");
        }
        assert!(expect_address(found, "7878").is_err());
    }
}
