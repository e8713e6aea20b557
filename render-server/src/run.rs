//! Starts the threads of a render server, and carries messages between the manager and them.

use std::collections::BTreeMap;
use std::future::Future;
use std::path::PathBuf;
use std::pin::Pin;
use std::sync::Arc;
use std::thread::{Builder, JoinHandle};
use std::time::Duration;

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, bounded};
use polyptych_files::blob::BlobStore;
use polyptych_protocol::handshake::Adapter;
use polyptych_protocol::manager_addresses::ManagerAddresses;
use polyptych_protocol::service_notifier::ServiceNotifier;
use polyptych_protocol::token::{self, TokenError};
use polyptych_renderer::{Gpu, GpuError};
use tokio::sync::mpsc;
use winit::event_loop::EventLoopProxy;

use crate::channel_output::ChannelOutput;
use crate::clock::Clock;
use crate::connection_status::ServerInfo;
use crate::desktop;
use crate::draw_delay::DrawDelay;
use crate::ending::{Ending, PanicGuard};
use crate::fullscreen::Fullscreen;
use crate::loader::{LoadOrder, Loader, ORDERS_MAX, UPLOADS_MAX};
use crate::monitor::Monitor;
use crate::network::{self, Network};
use crate::render_event::RenderEvent;
use crate::render_thread::{
    DrawOptions, JOBS_MAX, Queues, RenderTask, RenderThread, SendMonitorNames,
};
use crate::term_guard::TermGuard;
use crate::window::{self, Ended, Links, Message, WindowWish, Windows};

/// Reports that wait for the network.
const REPORTS_MAX: usize = 512;

/// Maximum time for the render thread to end: the driver may be compiling for seconds, or hang, and
/// a process that was told to end must not stay for that.
const RENDER_END_TIME_MAX: Duration = Duration::from_secs(1);

/// Longest delay of showing a frame. The next one is drawn later by as much, and a display that
/// is earlier than two refreshes at 20 Hz is not early but broken.
pub const PRESENT_DELAY_MAX: Duration = Duration::from_millis(100);

/// A future that ends a server from outside when it completes.
pub type Shutdown = Pin<Box<dyn Future<Output = ()> + Send>>;

/// The options of a render server.
#[derive(Clone, Debug)]
pub struct ServerOptions {
    /// The manager's address, `HOST:PORT`.
    pub manager: String,
    /// The channels that it drives, by name.
    pub channels: Vec<String>,
    /// For logs and status.
    pub name: String,
    /// The source of the manager's secret; not read with keys.
    pub token: TokenSource,
    /// This server's folder of keys, read anew for every connection: they may be renewed. With it
    /// all is encrypted, and `name` must be the certificate's.
    pub keys: Option<PathBuf>,
    /// Goes over a network without keys.
    pub insecure: bool,
    /// The folder of this machine's blobs.
    pub cache: PathBuf,
    /// The destination of the pictures.
    pub output: OutputKind,
    /// A part of the name of the GPU to draw with, or its PCI address; `None` for the best one.
    pub gpu: Option<String>,
    /// The monitors that channels fill in full screen, by channel; before those of the wall file.
    pub monitors: BTreeMap<String, String>,
    /// Ends with the reason instead of trying again.
    pub once: bool,
    /// Every frame is shown this much later than the manager says: for displays whose scan-out
    /// is known to be early, and to test what is measured. At most [`PRESENT_DELAY_MAX`].
    pub present_delay: Duration,
    /// Called with a channel's name when the user closes its window, in the place of the server's
    /// end: for one whose parent decides what follows.
    pub on_close: Option<fn(&str)>,
    /// The file with the milliseconds that every frame is to take longer, for tests of a wall.
    pub slow_draw: Option<PathBuf>,
    /// Leaves out of frames what others hide, where that is faster. It changes no pixel.
    pub culls_occluded: bool,
    /// The supervisor that is told that this server has joined, works and ends, if there is one.
    pub notifier: Option<Arc<ServiceNotifier>>,
}

/// The destination of a server's pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OutputKind {
    /// Nowhere but to captures.
    Headless,
    /// To a window for each channel.
    Window,
    /// To a window for each channel that fills a monitor.
    Fullscreen,
}

/// The source of the manager's secret.
#[derive(Clone, Debug)]
pub enum TokenSource {
    /// The secret itself.
    Given(String),
    /// A file, read anew for every connection: the manager may make it later.
    File(PathBuf),
}

impl TokenSource {
    pub(crate) fn read(&self) -> Result<String, TokenError> {
        match self {
            Self::Given(token) => Ok(token.clone()),
            Self::File(path) => token::read(path),
        }
    }
}

/// Why a render server ended.
#[derive(Debug, thiserror::Error)]
pub enum ServerError {
    /// Nothing to draw with.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The GPU failed while it drew.
    #[error("the GPU failed: {0}")]
    GpuFault(String),
    /// A fault of this program, which the log describes.
    #[error("the {thread} thread panicked; the log says where")]
    Panicked {
        /// The thread.
        thread: &'static str,
    },
    /// It was to end, and its render thread is still inside the driver, whose clean-up at the
    /// exit of the process would crash there: end the process without.
    #[error("the driver is still busy, {} s after the end", RENDER_END_TIME_MAX.as_secs())]
    DriverBusy,
    /// Windows could not be opened.
    #[error("{0}")]
    Window(String),
    /// It was to try once only.
    #[error("manager {manager}: {reason}")]
    GaveUp {
        /// Its address.
        manager: String,
        /// Why it did not go on.
        reason: String,
    },
    /// The system gave no thread or socket.
    #[error("the system refused: {0}")]
    System(#[from] std::io::Error),
}

/// Runs a render server on the main thread until `shutdown` is ready, a window is closed, or it
/// cannot go on.
///
/// # Errors
/// [`ServerError`].
pub fn run(options: ServerOptions, shutdown: Shutdown) -> Result<(), ServerError> {
    // Every line of every thread says who it is: a wall's logs are read together.
    let channel = options.channels.join(",");
    let _server = tracing::error_span!("server", server = options.name, channel).entered();
    match options.output {
        OutputKind::Headless => {
            let gpu = Gpu::open(Gpu::headless_instance(), None, options.gpu.as_deref())?;
            let output = |name: &String| ChannelOutput::new(name.clone(), None, None);
            let outputs = options.channels.iter().map(output).collect();
            let own = OwnThread { on_end: Arc::new(|| {}), monitor_names: None };
            let threads = Threads::start(options, gpu, outputs, shutdown, own)?;
            threads.join()
        }
        OutputKind::Window | OutputKind::Fullscreen => run_windows(options, shutdown),
    }
}

/// Returns the monitors of this machine's X display, in the order in which channels take them.
///
/// # Errors
/// [`ServerError::Window`]: there is no X display, or it lists no monitors.
pub fn monitors() -> Result<Vec<Monitor>, ServerError> {
    desktop::monitors().map_err(|error| ServerError::Window(error.to_string()))
}

/// Returns a line for each GPU of this machine: name, driver and PCI address.
///
/// # Errors
/// [`ServerError::Gpu`]: there is no driver.
pub fn gpus() -> Result<Vec<String>, ServerError> {
    let found = Gpu::list();
    if found.is_empty() {
        return Err(GpuError::NoAdapter.into());
    }
    Ok(found.iter().map(ToString::to_string).collect())
}

fn run_windows(mut options: ServerOptions, shutdown: Shutdown) -> Result<(), ServerError> {
    let (event_loop, proxy) = window::event_loop().map_err(ServerError::Window)?;
    let channels = options.channels.clone();
    let fullscreen = if options.output == OutputKind::Fullscreen {
        let named = std::mem::take(&mut options.monitors);
        let fullscreen = Fullscreen::open(&channels, named).map_err(ServerError::Window)?;
        let changed = proxy.clone();
        let watched = desktop::watch(move || {
            // The loop may have ended.
            let _ = changed.send_event(Message::MonitorsChanged);
        });
        if let Err(error) = watched {
            tracing::warn!(%error, "changes of monitors will not be followed");
        }
        Some(fullscreen)
    } else {
        None
    };
    let wish = WindowWish { channels, fullscreen, on_close: options.on_close };
    let (started, threads) = bounded::<Threads>(1);
    let start = move |windows: Windows| {
        let Windows { instance, displays } = windows;
        let surface = displays.first().map(|(_, display, _)| display.surface());
        let gpu = Gpu::open(instance, surface, options.gpu.as_deref())
            .map_err(|error| error.to_string())?;
        let output =
            |(name, display, assignment)| ChannelOutput::new(name, Some(display), assignment);
        let outputs = displays.into_iter().map(output).collect();
        let threads = Threads::start(options, gpu, outputs, shutdown, OwnThread::of(proxy))
            .map_err(|error| error.to_string())?;
        let links = Links { jobs: threads.jobs.clone(), reports: threads.reports.clone() };
        // Its receiver stands below, and there is room for one.
        let _ = started.send(threads);
        Ok(links)
    };
    let served = window::serve(event_loop, wish, Box::new(start));
    let reason = match &served {
        Ok(Ended::Closed) => "its window was closed",
        // Those who asked have said why, to the manager too.
        Ok(Ended::Asked) => "it ends",
        Err(fault) => fault,
    };
    if served == Ok(Ended::Closed) {
        tracing::info!("a window was closed: the server ends");
    }
    let ended = threads.try_recv().map(|threads| threads.end(reason));
    served.map_err(ServerError::Window)?;
    ended.unwrap_or(Ok(()))
}

/// The other threads' messages to the main one.
struct OwnThread {
    on_end: Arc<dyn Fn() + Send + Sync>,
    monitor_names: Option<SendMonitorNames>,
}

impl OwnThread {
    /// The window system's thread, which may have ended by itself, by a closed window.
    fn of(proxy: EventLoopProxy<Message>) -> Self {
        let names = proxy.clone();
        let send = move |named| {
            let _ = names.send_event(Message::MonitorNames(named));
        };
        let on_end = move || {
            let _ = proxy.send_event(Message::End);
        };
        Self { on_end: Arc::new(on_end), monitor_names: Some(Box::new(send)) }
    }
}

/// What the manager is told of a GPU.
fn adapter_of(gpu: &Gpu) -> Adapter {
    let facts = gpu.info();
    Adapter {
        name: facts.name,
        driver: format!("{} {}", facts.driver, facts.driver_info),
        backend: facts.backend,
        texture_side_max: facts.texture_side_max,
    }
}

/// The threads beside the main one.
struct Threads {
    jobs: Sender<RenderTask>,
    reports: mpsc::Sender<RenderEvent>,
    ending: Arc<Ending>,
    network: JoinHandle<Result<(), ServerError>>,
    /// The result of the render thread, once it has ended.
    rendered: Receiver<Result<(), String>>,
}

impl Threads {
    fn start(
        options: ServerOptions,
        gpu: Gpu,
        outputs: Vec<ChannelOutput>,
        shutdown: Shutdown,
        own: OwnThread,
    ) -> Result<Self, ServerError> {
        let clock = Arc::new(Clock::default());
        let (jobs, waiting_jobs) = bounded(JOBS_MAX);
        let (uploads, waiting_uploads) = bounded(UPLOADS_MAX);
        let (orders, waiting_orders): (_, Receiver<LoadOrder>) = bounded(ORDERS_MAX);
        let (reports, waiting_reports) = mpsc::channel(REPORTS_MAX);
        let channels = outputs.iter().map(|output| output.name.clone()).collect();
        let (adapter, losses) = (adapter_of(&gpu), gpu.losses());
        let OwnThread { on_end, monitor_names } = own;
        let span = tracing::Span::current();
        let identity = ServerInfo { server: options.name.clone(), adapter: adapter.name.clone() };

        let queues = Queues {
            jobs: waiting_jobs,
            uploads: waiting_uploads,
            reports: reports.clone(),
            monitor_names,
        };
        let ending = Arc::new(Ending::default());
        let drawing = DrawOptions {
            present_delay: options.present_delay.min(PRESENT_DELAY_MAX),
            slowness: DrawDelay::new(options.slow_draw.clone()),
            culls_occluded: options.culls_occluded,
        };
        let (render_clock, stop, end) = (clock.clone(), ending.clone(), on_end.clone());
        let (render_result, rendered) = bounded(1);
        let server = span.clone();
        let guard = PanicGuard::new("render", &ending, &on_end, ());
        Builder::new().name("render".into()).spawn(move || {
            let _guard = guard;
            let _server = server.entered();
            let thread = RenderThread::new(gpu, outputs, queues, render_clock, identity, drawing);
            let result = thread.and_then(RenderThread::run);
            stop.end(result.as_ref().err().map_or("it ends", String::as_str));
            // Nobody asks for it only where the process ends anyway.
            let _ = render_result.send(result);
            end();
        })?;

        let guard = PanicGuard::new("loader", &ending, &on_end, uploads.clone());
        let loader =
            Loader::new(BlobStore::new(&options.cache), waiting_orders, uploads, losses, channels);
        let server = span.clone();
        let load = move || {
            let _guard = guard;
            server.in_scope(|| loader.run());
        };
        Builder::new().name("loader".into()).spawn(load)?;

        let (render_jobs, stop) = (jobs.clone(), ending.clone());
        let window_reports = reports.clone();
        let guard = PanicGuard::new("network", &ending, &on_end, ());
        let network = Builder::new().name("network".into()).spawn(move || {
            let _guard = guard;
            let _server = span.entered();
            let managers = ManagerAddresses::new(&options.manager);
            let network = Network {
                options,
                adapter,
                jobs: render_jobs.clone(),
                orders,
                reports,
                waiting_reports,
                clock,
                managers,
                terms: TermGuard::default(),
                address: None,
            };
            let result = network::run(network, shutdown, &stop);
            // The render thread ends with the process at the latest.
            let _ = render_jobs.send_timeout(RenderTask::Stop, RENDER_END_TIME_MAX);
            on_end();
            result
        })?;
        Ok(Self { jobs, reports: window_reports, ending, network, rendered })
    }

    /// Ends the threads, for a reason that the manager is told, and waits for them.
    fn end(self, reason: &str) -> Result<(), ServerError> {
        self.ending.end(reason);
        self.join()
    }

    fn join(self) -> Result<(), ServerError> {
        let panicked = |thread| ServerError::Panicked { thread };
        let network = self.network.join().unwrap_or_else(|_| Err(panicked("network")));
        let rendered = self.rendered.recv_timeout(RENDER_END_TIME_MAX);
        let ended = self.ending.panicked().map_or(network, |thread| Err(panicked(thread)));
        match rendered {
            Err(RecvTimeoutError::Timeout) => {
                if let Err(error) = ended {
                    tracing::error!(%error, "the server ends");
                }
                Err(ServerError::DriverBusy)
            }
            Err(RecvTimeoutError::Disconnected) => ended.and(Err(panicked("render"))),
            Ok(rendered) => rendered.map_err(ServerError::GpuFault).and(ended),
        }
    }
}
