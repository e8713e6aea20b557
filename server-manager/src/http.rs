//! The manager over HTTP: the second transport, beside TCP, and the page for browsers.
//!
//! ```text
//! acceptor -> connection -> trust   who asks, from which page
//!                        -> route   which request that is
//!                        -> client  a client of the event loop, as a TCP connection is one
//! ```
//!
//! A connection becomes a client of the event loop with its first request that needs one. So
//! limits, refusals, order and recording are those of TCP, and there is no second path into the
//! core. What many browsers watch, they watch together ([`live_wall`]).

mod acceptor;
mod answer;
mod archive;
mod body;
mod client;
mod connection;
mod console;
mod events;
mod file_stream;
mod live_wall;
pub mod login;
mod openapi;
mod picture;
mod request_examples;
mod resources;
mod route;
mod scene_pictures;
mod trust;
mod websocket;

use std::net::SocketAddr;
use std::sync::Arc;

use polyptych_protocol::handshake::Welcome;
use polyptych_scene::Bounds;
use polyptych_tls::Credentials;
use polyptych_wall::Wall;
use polyptych_wall::camera::Camera;
use tokio::sync::{Semaphore, mpsc, oneshot};
use tokio_util::sync::{CancellationToken, DropGuard};

use crate::acceptor::RejectionLog;
use crate::requests::RequestQueues;
use crate::session::{ClientHandle, Event};

/// The port at which `polyptych login` looks for the manager's pages.
pub const PORT_DEFAULT: u16 = 7880;

/// Maximum number of connections that have shown who they are: those of 50 browsers, and programs.
/// One more is told so.
const CONNECTIONS_MAX: usize = 384;

/// The manager's options for HTTP.
#[derive(Debug)]
pub struct HttpOptions {
    /// The socket on which it listens.
    pub listener: std::net::TcpListener,
    /// Names by which browsers may reach it, beside addresses and `localhost`.
    pub hosts: Vec<String>,
    /// Encodes pictures as JPEG.
    pub encode_jpeg: JpegEncoder,
    /// The camera that shows a whole scene.
    pub fit_camera: CameraFit,
}

/// Encodes RGB pixels, rows from the top, of a width and a height.
pub type JpegEncoder = fn(rgb: &[u8], width: u32, height: u32) -> Result<Vec<u8>, String>;

/// Returns the camera that shows all of a scene from a heading in radians around +Y.
pub type CameraFit = fn(&Wall, &Bounds, f64) -> Camera;

/// The state that all connections share.
struct HttpContext {
    gate: trust::Gate,
    events: mpsc::Sender<Event>,
    queues: RequestQueues,
    rejections: RejectionLog,
    live: live_wall::LiveWall,
    admitted: Arc<Semaphore>,
    captures: Arc<Semaphore>,
    encode_jpeg: JpegEncoder,
    fit_camera: CameraFit,
    /// The wall as its file has it: screens stay, while calibrations of channels change.
    wall: Arc<Wall>,
}

/// The way to the event loop.
pub(crate) struct Wiring {
    pub events: mpsc::Sender<Event>,
    pub queues: RequestQueues,
    /// The wall's token; empty with keys.
    pub token: String,
    pub keys: Option<Credentials>,
    pub wall: Arc<Wall>,
}

/// Answers on a thread of its own until the guard is dropped.
///
/// # Errors
/// The system gave no thread, or does not take the socket.
pub(crate) fn start(options: HttpOptions, wiring: Wiring) -> std::io::Result<DropGuard> {
    let HttpOptions { listener, hosts, encode_jpeg, fit_camera } = options;
    listener.set_nonblocking(true)?;
    let address = listener.local_addr()?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let Wiring { events, queues, token, keys, wall } = wiring;
    let context = HttpContext {
        gate: trust::Gate::new(&token, keys, hosts, address.port()),
        live: live_wall::LiveWall::new(events.clone(), queues.clone()),
        events,
        queues,
        rejections: RejectionLog::new(),
        admitted: Arc::new(Semaphore::new(CONNECTIONS_MAX)),
        captures: Arc::new(Semaphore::new(resources::pictures::CAPTURES_MAX)),
        encode_jpeg,
        fit_camera,
        wall,
    };
    let stop = CancellationToken::new();
    let stopped = stop.clone();
    let work = move || {
        runtime.block_on(async {
            tokio::select! {
                () = acceptor::accept(listener, Arc::new(context)) => {}
                () = stopped.cancelled() => {}
            }
        });
    };
    std::thread::Builder::new().name("http".into()).spawn(work)?;
    Ok(stop.drop_guard())
}

/// Asks the event loop to take a client in.
///
/// # Errors
/// Why there is no place for it, or that the manager ends.
async fn join(
    events: &mpsc::Sender<Event>,
    name: String,
    address: Option<SocketAddr>,
    link: ClientHandle,
) -> Result<Welcome, String> {
    const ENDS: &str = "the manager ends";
    let (verdict, answer) = oneshot::channel();
    let is_local = address.is_none_or(|address| address.ip().to_canonical().is_loopback());
    let joins = Event::ClientJoins { name, is_local, link, verdict };
    events.send(joins).await.map_err(|_| ENDS)?;
    answer.await.map_err(|_| ENDS)?
}
