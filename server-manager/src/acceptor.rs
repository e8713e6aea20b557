//! The door: accepts connections, hears who they are, and hands them to their sessions.

use std::net::SocketAddr;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use polyptych_core::Micros;
use polyptych_core::log_limiter::LogLimiter;
use polyptych_files::blob::BlobStore;
use polyptych_protocol::handshake::{Hello, Welcome};
use polyptych_protocol::handshake_io;
use polyptych_protocol::limits::HANDSHAKE_TIME_MAX;
use polyptych_protocol::stream::Stream;
use polyptych_tls::NodeIdentity;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{mpsc, watch};

use crate::authenticator::Authenticator;
use crate::bulk::{self, BlobAllowlist, PictureOf};
use crate::client_session::{self, Visitor};
use crate::requests::RequestQueues;
use crate::server_session;
use crate::session::Event;
use crate::strangers::{Guest, Strangers};
use crate::traffic::Traffic;

/// Maximum time until the first bytes of a connection: peers of ours speak at once.
const FIRST_BYTES_TIME_MAX: Duration = Duration::from_millis(500);

/// Who was refused, and why: each is said once and then counted.
#[derive(Clone, Debug)]
pub(crate) struct RejectionLog {
    since: Instant,
    repetitions: Arc<Mutex<LogLimiter>>,
}

impl RejectionLog {
    pub fn new() -> Self {
        Self { since: Instant::now(), repetitions: Arc::default() }
    }

    /// Notes one by the peer's machine, since every try comes from another port. `Some` where it
    /// is to be said now, with the times that it has come.
    pub fn record(&self, address: SocketAddr, reason: &str) -> Option<u64> {
        let now = self.since.elapsed().as_micros() as Micros;
        let what = format!("{} {reason}", address.ip());
        self.repetitions.lock().unwrap_or_else(PoisonError::into_inner).should_log(now, &what)
    }
}

/// The context of the accept loop: everything that a new connection needs.
#[derive(Clone)]
pub(crate) struct AcceptContext {
    pub refusals: RejectionLog,
    pub gate: Authenticator,
    pub events: mpsc::Sender<Event>,
    pub pictures: mpsc::Sender<PictureOf>,
    pub queues: RequestQueues,
    /// Heartbeats of the event loop, which connections of clients pass on.
    pub heartbeats: watch::Receiver<()>,
    /// The start of the manager's clock.
    pub started: tokio::time::Instant,
    pub folder: BlobStore,
    pub allowed: BlobAllowlist,
    pub traffic: Traffic,
    pub welcome: Welcome,
}

/// Lets peers in, for ever.
pub(crate) async fn accept(listener: TcpListener, door: AcceptContext) {
    let strangers = Strangers::default();
    loop {
        match listener.accept().await {
            Ok((stream, address)) => {
                let guest = strangers.admit(address.ip());
                tokio::spawn(meet(stream, address, guest, door.clone()));
            }
            // Out of file descriptors, most likely.
            Err(error) => {
                strangers.make_room();
                let here = SocketAddr::from(([0, 0, 0, 0], 0));
                if let Some(times) = door.refusals.record(here, &error.to_string()) {
                    tracing::error!(%error, times, "cannot accept a connection");
                }
                tokio::time::sleep(Duration::from_millis(100)).await;
            }
        }
    }
}

/// Hears who a connection is, and serves it if it may come in.
async fn meet(stream: TcpStream, address: SocketAddr, guest: Guest, door: AcceptContext) {
    let introduced = async {
        let first = tokio::time::timeout(FIRST_BYTES_TIME_MAX, stream.readable()).await;
        if first.is_err() {
            return None;
        }
        guest.has_spoken();
        tokio::time::timeout(HANDSHAKE_TIME_MAX, let_in(stream, &door)).await.ok()
    };
    let outcome = tokio::select! {
        outcome = introduced => outcome,
        () = guest.end.cancelled() => None,
    };
    match outcome {
        Some(Ok(introduced)) => {
            guest.is_let_in();
            drop(guest);
            serve(introduced, address, door).await;
        }
        Some(Err(reason)) => {
            if let Some(times) = door.refusals.record(address, &reason) {
                tracing::warn!(peer = %address, reason, times, "a peer is refused");
            }
        }
        None => {
            if let Some(times) = door.refusals.record(address, "silent") {
                tracing::warn!(peer = %address, times, "a peer did not introduce itself");
            }
        }
    }
}

/// A peer that may come in: its connection, what it says, and who it has proven to be.
type LetIn = (handshake_io::Introduced<Stream>, Option<NodeIdentity>);

async fn let_in(tcp: TcpStream, door: &AcceptContext) -> Result<LetIn, String> {
    let (stream, proven) = polyptych_tls::accept(tcp, door.gate.keys.as_ref()).await?;
    let introduced = handshake_io::receive_hello(stream, &door.gate.secret).await;
    let mut peer = introduced.map_err(|error| error.to_string())?;
    if let Err(reason) = door.gate.authenticate(&peer.hello, peer.is_proven, proven.as_ref()) {
        // It may be gone already.
        let _ = handshake_io::reject(&mut peer.frames, reason.clone()).await;
        return Err(reason);
    }
    Ok((peer, proven))
}

async fn serve((peer, proven): LetIn, address: SocketAddr, door: AcceptContext) {
    let handshake_io::Introduced { frames, hello, proof, .. } = peer;
    match hello {
        Hello::Client(hello) => {
            let is_local = address.ip().to_canonical().is_loopback();
            let visitor = Visitor { frames, proof, name: hello.name, is_local };
            client_session::serve(visitor, door.events, door.queues, door.heartbeats).await;
        }
        Hello::Server(hello) => {
            server_session::serve((frames, proof), hello, address, door).await;
        }
        Hello::Bulk(hello) => {
            let welcome = Welcome { session: hello.session, ..door.welcome };
            let store = bulk::ServedBlobs { folder: door.folder, allowed: door.allowed };
            let who = bulk::BulkPeer { welcome, proven };
            bulk::serve((frames, proof), who, (door.events, door.pictures), store, door.traffic)
                .await;
        }
    }
}
