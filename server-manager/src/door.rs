//! The door: accepts connections, hears who they are, and hands them to their sessions.

use std::time::Duration;

use polyptych_protocol::blob::BlobFolder;
use polyptych_protocol::connection;
use polyptych_protocol::handshake::{Hello, Welcome};
use polyptych_protocol::limits::{HANDSHAKE_TIME_MAX, NAME_BYTES_MAX};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Semaphore, mpsc};

use crate::bulk::{self, AllowedBlobs};
use crate::client_session;
use crate::server_session;
use crate::session::Event;

/// Connections that may be in the handshake at once: strangers get no more of the manager.
const HANDSHAKES_MAX: usize = 512;

/// What a stranger meets.
#[derive(Clone)]
pub(crate) struct Door {
    pub token: String,
    pub events: mpsc::Sender<Event>,
    pub folder: BlobFolder,
    pub allowed: AllowedBlobs,
    pub welcome: Welcome,
}

/// Lets peers in, for ever.
pub(crate) async fn accept(listener: TcpListener, door: Door) {
    let permits = std::sync::Arc::new(Semaphore::new(HANDSHAKES_MAX));
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
                    match outcome {
                        Ok(Ok((frames, hello))) => {
                            serve(frames, hello, address.to_string(), door).await;
                        }
                        Ok(Err(reason)) => tracing::warn!(%address, reason, "a peer is refused"),
                        Err(_) => tracing::warn!(%address, "a peer did not introduce itself"),
                    }
                });
            }
            // Out of file descriptors, most likely: others end, and then it goes on.
            Err(error) => {
                tracing::error!(%error, "cannot accept a connection");
                tokio::time::sleep(Duration::from_millis(100)).await;
            }
        }
    }
}

type Introduced = (connection::Frames<TcpStream>, Hello);

async fn let_in(stream: TcpStream, door: &Door) -> Result<Introduced, String> {
    stream.set_nodelay(true).map_err(|error| error.to_string())?;
    let introduced = connection::receive_introduction(stream).await;
    let (mut frames, hello) = introduced.map_err(|error| error.to_string())?;
    let (token, name) = match &hello {
        Hello::Client(hello) => (&hello.token, hello.name.as_str()),
        Hello::Server(hello) => (&hello.token, hello.name.as_str()),
        Hello::Bulk(hello) => (&hello.token, ""),
    };
    let reason = if !is_same_secret(&token.0, &door.token) {
        "the token is not this manager's; give the peer a copy of the manager's token file"
    } else if name.len() > NAME_BYTES_MAX || name.chars().any(char::is_control) {
        "a name has at most 64 bytes and no control characters"
    } else {
        return Ok((frames, hello));
    };
    let _ = connection::refuse(&mut frames, reason.to_owned()).await;
    Err(reason.to_owned())
}

/// Compares without telling by its time how much was right.
fn is_same_secret(given: &str, ours: &str) -> bool {
    let pairs = given.bytes().zip(ours.bytes());
    given.len() == ours.len() && pairs.fold(0, |sum, (a, b)| sum | (a ^ b)) == 0
}

async fn serve(frames: connection::Frames<TcpStream>, hello: Hello, address: String, door: Door) {
    match hello {
        Hello::Client(hello) => client_session::serve(frames, hello.name, door.events).await,
        Hello::Server(hello) => server_session::serve(frames, hello, address, door.events).await,
        Hello::Bulk(hello) => {
            let welcome = Welcome { session: hello.session, ..door.welcome };
            bulk::serve(frames, welcome, door.events, door.folder, door.allowed).await;
        }
    }
}
