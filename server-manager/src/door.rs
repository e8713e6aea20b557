//! The door: accepts connections, hears who they are, and hands them to their sessions.

use std::net::SocketAddr;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use polyptych_protocol::blob::BlobFolder;
use polyptych_protocol::connection;
use polyptych_protocol::handshake::{Hello, Welcome};
use polyptych_protocol::identity::Identity;
use polyptych_protocol::limits::HANDSHAKE_TIME_MAX;
use polyptych_protocol::stream::{self, Stream};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Semaphore, mpsc};

use crate::bulk::{self, AllowedBlobs};
use crate::client_session;
use crate::cluster::Micros;
use crate::gate::Gate;
use crate::repetition::Repetitions;
use crate::server_session;
use crate::session::Event;
use crate::traffic::Traffic;

/// Connections that may be in the handshake at once: strangers get no more of the manager.
const HANDSHAKES_MAX: usize = 512;

/// Who was refused, and why: each is said once and then counted.
#[derive(Clone, Debug)]
pub(crate) struct Refusals {
    since: Instant,
    repetitions: Arc<Mutex<Repetitions>>,
}

impl Refusals {
    pub fn new() -> Self {
        Self { since: Instant::now(), repetitions: Arc::default() }
    }

    /// Notes one by the peer's machine, since every try comes from another port. `Some` where it
    /// is to be said now, with the times that it has come.
    pub fn note(&self, address: SocketAddr, reason: &str) -> Option<u64> {
        let now = self.since.elapsed().as_micros() as Micros;
        let what = format!("{} {reason}", address.ip());
        self.repetitions.lock().unwrap_or_else(PoisonError::into_inner).note(now, &what)
    }
}

/// What a stranger meets.
#[derive(Clone)]
pub(crate) struct Door {
    pub refusals: Refusals,
    pub gate: Gate,
    pub events: mpsc::Sender<Event>,
    pub folder: BlobFolder,
    pub allowed: AllowedBlobs,
    pub traffic: Traffic,
    pub welcome: Welcome,
}

/// Lets peers in, for ever.
pub(crate) async fn accept(listener: TcpListener, door: Door) {
    let permits = Arc::new(Semaphore::new(HANDSHAKES_MAX));
    loop {
        // The permit comes first, so that a flood waits in the system's queue.
        let Ok(permit) = permits.clone().acquire_owned().await else { return };
        match listener.accept().await {
            Ok((stream, address)) => {
                let door = door.clone();
                tokio::spawn(async move {
                    let let_in = let_in(stream, &door);
                    let outcome = tokio::time::timeout(HANDSHAKE_TIME_MAX, let_in).await;
                    drop(permit);
                    let refused = |reason: &str| door.refusals.note(address, reason);
                    match outcome {
                        Ok(Ok(introduced)) => serve(introduced, address, door).await,
                        Ok(Err(reason)) => {
                            if let Some(times) = refused(&reason) {
                                tracing::warn!(peer = %address, reason, times, "a peer is refused");
                            }
                        }
                        Err(_) => {
                            if let Some(times) = refused("silent") {
                                let peer = address;
                                tracing::warn!(%peer, times, "a peer did not introduce itself");
                            }
                        }
                    }
                });
            }
            // Out of file descriptors, most likely: others end, and then it goes on.
            Err(error) => {
                let here = SocketAddr::from(([0, 0, 0, 0], 0));
                if let Some(times) = door.refusals.note(here, &error.to_string()) {
                    tracing::error!(%error, times, "cannot accept a connection");
                }
                tokio::time::sleep(Duration::from_millis(100)).await;
            }
        }
    }
}

/// A peer that may come in: its connection, what it says, and who it has proven to be.
type Guest = (connection::Introduced<Stream>, Option<Identity>);

async fn let_in(tcp: TcpStream, door: &Door) -> Result<Guest, String> {
    let (stream, proven) = stream::accept(tcp, door.gate.keys.as_ref()).await?;
    let introduced = connection::receive_introduction(stream, &door.gate.secret).await;
    let mut peer = introduced.map_err(|error| error.to_string())?;
    if let Err(reason) = door.gate.check(&peer.hello, peer.is_proven, proven.as_ref()) {
        // It may be gone already.
        let _ = connection::refuse(&mut peer.frames, reason.clone()).await;
        return Err(reason);
    }
    Ok((peer, proven))
}

async fn serve((peer, proven): Guest, address: SocketAddr, door: Door) {
    let connection::Introduced { frames, hello, proof, .. } = peer;
    match hello {
        Hello::Client(hello) => {
            client_session::serve((frames, proof), hello.name, door.events).await
        }
        Hello::Server(hello) => {
            server_session::serve((frames, proof), hello, address, door.events, door.refusals)
                .await;
        }
        Hello::Bulk(hello) => {
            let welcome = Welcome { session: hello.session, ..door.welcome };
            let store = bulk::Store { folder: door.folder, allowed: door.allowed };
            let who = bulk::Claim { welcome, proven };
            bulk::serve((frames, proof), who, door.events, store, door.traffic).await;
        }
    }
}
