//! The bytes under a connection: TCP, or what a transport of ours lays over it.
//!
//! Addresses that other machines reach are connected to in the clear only with `--insecure`:
//! [`connect`] refuses them otherwise.

use std::fmt;
use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::task::{Context, Poll};
use std::time::Duration;

use socket2::{SockRef, TcpKeepalive};
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt, ReadBuf};
use tokio::net::TcpStream;
use tokio::time::timeout;

use crate::handshake_io;
use crate::limits::{HANDSHAKE_BYTES_MAX, HANDSHAKE_TIME_MAX};

/// First byte of every TLS connection: a record with a handshake message.
const TLS_FIRST_BYTE: u8 = 0x16;

/// The fatal alert `unexpected_message`: tells a peer that speaks TLS that this end does not.
const TLS_ALERT: [u8; 7] = [0x15, 3, 3, 0, 2, 2, 10];

/// The idle time before the system probes whether the other end is there, the period of the probes,
/// and the number of unanswered ones that end a connection. A machine that lost its power is gone
/// after half a minute, for clients and blobs too, which have no heartbeat.
const KEEPALIVE_IDLE: Duration = Duration::from_secs(15);
const KEEPALIVE_PERIOD: Duration = Duration::from_secs(5);
const KEEPALIVE_TRIES: u32 = 3;

/// Maximum number of connections that wait to be accepted: what Linux allows by default.
const WAITING_MAX: i32 = 4096;

/// Bytes that go both ways.
pub trait DuplexBytes: AsyncRead + AsyncWrite + Send + Sync + Unpin {}

impl<B: AsyncRead + AsyncWrite + Send + Sync + Unpin> DuplexBytes for B {}

/// A connection's bytes.
pub enum Stream {
    /// In the clear; frames go into the socket itself, from the thread that makes them.
    Plain(TcpStream),
    /// Over a layer on TCP that encrypts.
    Encrypted {
        /// The byte stream of the TLS layer.
        bytes: Box<dyn DuplexBytes>,
        /// This end's address.
        local: SocketAddr,
    },
}

impl Stream {
    /// This end's address.
    ///
    /// # Errors
    /// The system does not know it any more.
    pub fn local_addr(&self) -> io::Result<SocketAddr> {
        match self {
            Self::Plain(tcp) => tcp.local_addr(),
            Self::Encrypted { local, .. } => Ok(*local),
        }
    }
}

impl fmt::Debug for Stream {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Plain(tcp) => f.debug_tuple("Plain").field(tcp).finish(),
            Self::Encrypted { local, .. } => {
                f.debug_struct("Encrypted").field("local", local).finish_non_exhaustive()
            }
        }
    }
}

/// Sets up a connection for small messages that must not wait, and notices where the other machine
/// has gone.
///
/// # Errors
/// The system does not take it.
pub fn tune(tcp: &TcpStream) -> io::Result<()> {
    // A camera must not wait for the answer to the one before it.
    tcp.set_nodelay(true)?;
    let keepalive = TcpKeepalive::new()
        .with_time(KEEPALIVE_IDLE)
        .with_interval(KEEPALIVE_PERIOD)
        .with_retries(KEEPALIVE_TRIES);
    let socket = SockRef::from(tcp);
    // Nothing is probed while sent bytes are not acknowledged: without this limit the system sends
    // them for a quarter of an hour.
    #[cfg(target_os = "linux")]
    socket.set_tcp_user_timeout(Some(KEEPALIVE_IDLE + KEEPALIVE_PERIOD * KEEPALIVE_TRIES))?;
    socket.set_tcp_keepalive(&keepalive)
}

/// Makes room for connections that wait to be accepted: a flood fills the 128 of the standard
/// library within milliseconds, and later peers wait for a second or more.
///
/// # Errors
/// The system does not take it.
pub fn deepen_queue(listener: &std::net::TcpListener) -> io::Result<()> {
    SockRef::from(listener).listen(WAITING_MAX)
}

/// The reason why no manager was reached.
#[derive(Debug, thiserror::Error)]
pub enum ConnectError {
    /// The address names no machine.
    #[error("{0}")]
    Unresolved(io::Error),
    /// The address leads over a network, and there are no keys.
    #[error("{}", in_the_clear(.0))]
    InTheClear(SocketAddr),
    /// No program listens there.
    #[error("{0}")]
    Unreachable(io::Error),
}

fn in_the_clear(address: &SocketAddr) -> String {
    format!(
        "{address} leads over a network, and without keys nothing is encrypted, the token neither; \
         make keys with polyptych keys WALL.toml and say --keys FOLDER, or say --insecure on a \
         network that you trust"
    )
}

/// Connects to a manager by TCP; to another machine only where `may_leave` says so.
///
/// # Errors
/// [`ConnectError`].
pub async fn connect(address: &str, may_leave: bool) -> Result<TcpStream, ConnectError> {
    let found = tokio::net::lookup_host(address).await.map_err(ConnectError::Unresolved)?;
    let found: Vec<SocketAddr> = found.collect();
    check_addresses(&found, may_leave)?;
    // Callers give the whole handshake this time: the last address has two shares of it.
    let limit = HANDSHAKE_TIME_MAX / (found.len() as u32 + 1);
    let connected = connect_first(&found, limit, TcpStream::connect::<SocketAddr>).await;
    let tcp = connected.map_err(ConnectError::Unreachable)?;
    tune(&tcp).map_err(ConnectError::Unreachable)?;
    Ok(tcp)
}

/// Connects to the first address that answers; the error is the last one's. All but the last have a
/// limit of time, since one that leads nowhere would take it from those behind it.
async fn connect_first<T, F>(
    addresses: &[SocketAddr],
    limit: Duration,
    connect: impl Fn(SocketAddr) -> F,
) -> io::Result<T>
where
    F: Future<Output = io::Result<T>>,
{
    let Some((&last, others)) = addresses.split_last() else {
        return Err(io::Error::new(io::ErrorKind::NotFound, "the name has no address"));
    };
    for &address in others {
        if let Ok(Ok(connected)) = timeout(limit, connect(address)).await {
            return Ok(connected);
        }
    }
    connect(last).await
}

/// Checks that none of these addresses leads over a network, where it must not.
///
/// # Errors
/// [`ConnectError::InTheClear`].
pub fn check_addresses(addresses: &[SocketAddr], may_leave: bool) -> Result<(), ConnectError> {
    match addresses.iter().find(|address| !address.ip().to_canonical().is_loopback()) {
        Some(&open) if !may_leave => Err(ConnectError::InTheClear(open)),
        _ => Ok(()),
    }
}

/// Returns whether a peer that has just connected begins with TLS; waits for its first byte.
///
/// # Errors
/// The connection failed.
pub async fn speaks_tls(tcp: &TcpStream) -> io::Result<bool> {
    let mut first = [0];
    Ok(tcp.peek(&mut first).await? == 1 && first == [TLS_FIRST_BYTE])
}

/// The connection of a peer that comes in the clear, as it must to a manager without keys.
///
/// # Errors
/// It speaks TLS, and was told that this manager does not; or the connection failed.
pub async fn expect_plain(mut tcp: TcpStream) -> Result<TcpStream, String> {
    if !speaks_tls(&tcp).await.map_err(|error| error.to_string())? {
        return Ok(tcp);
    }
    // Whether it hears it is its own affair.
    let _ = tcp.write_all(&TLS_ALERT).await;
    linger(tcp).await;
    Err("it speaks TLS, and this manager runs without --keys".into())
}

/// Tells a peer of ours that comes in the clear to a manager with keys what to do, and others
/// nothing. Returns why it is refused, for the log.
pub async fn reject_plain(mut tcp: TcpStream) -> String {
    let reason = "this manager speaks TLS only: start this peer with --keys FOLDER, as polyptych \
                  keys WALL.toml makes it";
    match handshake_io::reject_unread(&mut tcp, reason).await {
        Ok(()) => {
            linger(tcp).await;
            "it came in the clear, and this manager speaks TLS only; start it with --keys".into()
        }
        Err(error) => format!("it does not speak TLS: {error}"),
    }
}

/// Reads on for a while: what lies unread when a socket is closed would take our last words with
/// it. The time is the handshake's.
pub async fn linger(mut tcp: TcpStream) {
    let _ = tcp.shutdown().await;
    let mut rest = tcp.take(HANDSHAKE_BYTES_MAX as u64);
    let _ = tokio::io::copy(&mut rest, &mut tokio::io::sink()).await;
}

impl AsyncRead for Stream {
    fn poll_read(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        match self.get_mut() {
            Self::Plain(tcp) => Pin::new(tcp).poll_read(context, buffer),
            Self::Encrypted { bytes: layer, .. } => Pin::new(layer).poll_read(context, buffer),
        }
    }
}

impl AsyncWrite for Stream {
    fn poll_write(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        match self.get_mut() {
            Self::Plain(tcp) => Pin::new(tcp).poll_write(context, bytes),
            Self::Encrypted { bytes: layer, .. } => Pin::new(layer).poll_write(context, bytes),
        }
    }

    fn poll_flush(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        match self.get_mut() {
            Self::Plain(tcp) => Pin::new(tcp).poll_flush(context),
            Self::Encrypted { bytes: layer, .. } => Pin::new(layer).poll_flush(context),
        }
    }

    fn poll_shutdown(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        match self.get_mut() {
            Self::Plain(tcp) => Pin::new(tcp).poll_shutdown(context),
            Self::Encrypted { bytes: layer, .. } => Pin::new(layer).poll_shutdown(context),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_that_leads_nowhere_leaves_time_for_the_next() {
        let [nowhere, refused, manager] = [1, 2, 3].map(|n| SocketAddr::from(([127, 0, 0, n], 1)));
        let connect = |address: SocketAddr| async move {
            if address == nowhere {
                std::future::pending::<()>().await;
            }
            if address == refused {
                return Err(io::Error::from(io::ErrorKind::ConnectionRefused));
            }
            Ok(address)
        };
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build();
        runtime.expect("a runtime").block_on(async {
            let all = [nowhere, refused, manager];
            let reached = connect_first(&all, Duration::ZERO, connect).await;
            assert_eq!(reached.expect("the last one answers"), manager);
            let failed = connect_first(&all[..2], Duration::ZERO, connect).await;
            assert_eq!(failed.expect_err("none").kind(), io::ErrorKind::ConnectionRefused);
        });
    }
}
