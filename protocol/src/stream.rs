//! The bytes under a connection: TCP, or TLS over it.
//!
//! This is the one place that decides whether a connection is encrypted. On addresses that other
//! machines reach it is, with both sides authenticated, unless somebody said `--insecure`.

use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use socket2::{SockRef, TcpKeepalive};
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt, ReadBuf};
use tokio::net::TcpStream;
use tokio_rustls::TlsStream;

use crate::credentials::Credentials;
use crate::handshake_io;
use crate::identity::NodeIdentity;
use crate::limits::HANDSHAKE_BYTES_MAX;
use crate::tls;

/// First byte of every TLS connection: a record with a handshake message.
const TLS_FIRST_BYTE: u8 = 0x16;

/// The fatal alert `unexpected_message`: how somebody who speaks TLS is told that we don't.
const TLS_ALERT: [u8; 7] = [0x15, 3, 3, 0, 2, 2, 10];

/// A connection's bytes.
#[derive(Debug)]
pub enum Stream {
    /// In the clear.
    Plain(TcpStream),
    /// Encrypted, with both sides authenticated.
    Tls(Box<TlsStream<LimitedStream>>),
}

/// How long a connection may be idle before the system asks whether the other end is there, how
/// often it asks, and how many times in vain: after half a minute a machine that lost its power
/// is gone, for clients and blobs too, which have no heartbeat.
const KEEPALIVE_IDLE: Duration = Duration::from_secs(15);
const KEEPALIVE_PERIOD: Duration = Duration::from_secs(5);
const KEEPALIVE_TRIES: u32 = 3;

/// Maximum number of connections that wait to be accepted: what Linux allows by default.
const WAITING_MAX: i32 = 4096;

fn tune(tcp: &TcpStream) -> io::Result<()> {
    // A camera must not wait for the answer to the one before it.
    tcp.set_nodelay(true)?;
    let keepalive = TcpKeepalive::new()
        .with_time(KEEPALIVE_IDLE)
        .with_interval(KEEPALIVE_PERIOD)
        .with_retries(KEEPALIVE_TRIES);
    SockRef::from(tcp).set_tcp_keepalive(&keepalive)
}

impl Stream {
    /// This end's address.
    ///
    /// # Errors
    /// The system does not know it any more.
    pub fn local_addr(&self) -> io::Result<SocketAddr> {
        match self {
            Self::Plain(tcp) => tcp.local_addr(),
            Self::Tls(tls) => tls.get_ref().0.tcp.local_addr(),
        }
    }
}

/// Makes room for connections that wait to be accepted: the 128 of the standard library are gone
/// in milliseconds of a flood, and whoever comes then waits for a second or more.
///
/// # Errors
/// The system does not take it.
pub fn deepen_queue(listener: &std::net::TcpListener) -> io::Result<()> {
    SockRef::from(listener).listen(WAITING_MAX)
}

/// Why no manager was reached.
#[derive(Debug, thiserror::Error)]
pub enum ConnectError {
    /// The address names no machine.
    #[error("{0}")]
    Unresolved(io::Error),
    /// The address leads over a network, and there are no keys.
    #[error("{}", in_the_clear(.0))]
    InTheClear(SocketAddr),
    /// Nobody listens there.
    #[error("{0}")]
    Unreachable(io::Error),
    /// These keys are not for connecting.
    #[error("a manager's keys are for its own side only; use a server's or a client's")]
    ManagersKeys,
    /// The two ends did not agree on TLS.
    #[error("{}", tls::describe(.0))]
    Tls(io::Error),
}

fn in_the_clear(address: &SocketAddr) -> String {
    format!(
        "{address} leads over a network, and without keys nothing is encrypted, the token neither; \
         make keys with polyptych keys WALL.toml and say --keys FOLDER, or say --insecure on a \
         network that you trust"
    )
}

/// Connects to a manager: over TLS with keys; in the clear without, where it stays on this machine
/// or `is_insecure` says that the network is trusted.
///
/// # Errors
/// [`ConnectError`].
pub async fn connect(
    address: &str,
    keys: Option<&Credentials>,
    is_insecure: bool,
) -> Result<Stream, ConnectError> {
    let found = tokio::net::lookup_host(address).await.map_err(ConnectError::Unresolved)?;
    let found: Vec<SocketAddr> = found.collect();
    check_addresses(&found, keys.is_some() || is_insecure)?;
    let tcp = TcpStream::connect(&found[..]).await.map_err(ConnectError::Unreachable)?;
    tune(&tcp).map_err(ConnectError::Unreachable)?;
    let Some(keys) = keys else { return Ok(Stream::Plain(tcp)) };
    let (connector, manager) = keys.connector().ok_or(ConnectError::ManagersKeys)?;
    let connected = connector.connect(manager.clone(), LimitedStream::new(tcp)).await;
    let mut tls = connected.map_err(ConnectError::Tls)?;
    tls.get_mut().0.lift();
    Ok(Stream::Tls(Box::new(TlsStream::Client(tls))))
}

/// That none of these addresses leads over a network, where it must not.
///
/// # Errors
/// [`ConnectError::InTheClear`].
pub fn check_addresses(addresses: &[SocketAddr], may_leave: bool) -> Result<(), ConnectError> {
    match addresses.iter().find(|address| !address.ip().to_canonical().is_loopback()) {
        Some(&open) if !may_leave => Err(ConnectError::InTheClear(open)),
        _ => Ok(()),
    }
}

/// Takes a connection in, on the manager's side: with keys only over TLS, and whoever comes must
/// have shown a certificate; without only in the clear. Who it is comes with the stream.
///
/// The caller puts [`crate::limits::HANDSHAKE_TIME_MAX`] around it.
///
/// # Errors
/// Why the peer may not come in; it was told so, as far as it can understand.
pub async fn accept(
    mut tcp: TcpStream,
    keys: Option<&Credentials>,
) -> Result<(Stream, Option<NodeIdentity>), String> {
    tune(&tcp).map_err(|error| error.to_string())?;
    let mut first = [0];
    let seen = tcp.peek(&mut first).await.map_err(|error| error.to_string())?;
    let is_tls = seen == 1 && first == [TLS_FIRST_BYTE];
    match keys.map(Credentials::acceptor) {
        None if is_tls => {
            // Whether it hears it is its own affair.
            let _ = tcp.write_all(&TLS_ALERT).await;
            linger(tcp).await;
            Err("it speaks TLS, and this manager runs without --keys".into())
        }
        None => Ok((Stream::Plain(tcp), None)),
        Some(None) => Err("this manager's keys are another node's".into()),
        Some(Some(_)) if !is_tls => Err(turn_away(tcp).await),
        Some(Some(acceptor)) => {
            let accepted = acceptor.accept(LimitedStream::new(tcp)).into_fallible().await;
            let mut tls = match accepted {
                Ok(tls) => tls,
                Err((error, metered)) => {
                    // The reason is on its way as an alert.
                    linger(metered.tcp).await;
                    return Err(tls::describe(&error));
                }
            };
            let (metered, session) = tls.get_mut();
            metered.lift();
            let shown = session.peer_certificates().and_then(|chain| chain.first());
            let shown = shown.ok_or("the peer shows no certificate")?;
            let identity = NodeIdentity::from_certificate(shown)
                .map_err(|what| format!("the peer's certificate is refused: {what}"))?;
            Ok((Stream::Tls(Box::new(TlsStream::Server(tls))), Some(identity)))
        }
    }
}

/// Tells a peer of ours that comes in the clear what to do, and others nothing.
async fn turn_away(mut tcp: TcpStream) -> String {
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
async fn linger(mut tcp: TcpStream) {
    let _ = tcp.shutdown().await;
    let mut rest = tcp.take(HANDSHAKE_BYTES_MAX as u64);
    let _ = tokio::io::copy(&mut rest, &mut tokio::io::sink()).await;
}

/// A TCP stream from which only so much comes until its peer has shown who it is.
#[derive(Debug)]
pub struct LimitedStream {
    tcp: TcpStream,
    /// Bytes that may still come; any number once the meter is lifted.
    left: Option<usize>,
}

impl LimitedStream {
    fn new(tcp: TcpStream) -> Self {
        Self { tcp, left: Some(HANDSHAKE_BYTES_MAX) }
    }

    fn lift(&mut self) {
        self.left = None;
    }
}

impl AsyncRead for LimitedStream {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let Some(left) = self.left else {
            return Pin::new(&mut self.tcp).poll_read(context, buffer);
        };
        if left == 0 {
            let what = format!("more than {HANDSHAKE_BYTES_MAX} bytes, and still a stranger");
            return Poll::Ready(Err(io::Error::new(io::ErrorKind::FileTooLarge, what)));
        }
        // No more than that is read: a peer's hello may come together with the last of its
        // handshake, and is none of a stranger's bytes.
        let room = left.min(buffer.remaining());
        let mut part = ReadBuf::new(buffer.initialize_unfilled_to(room));
        ready!(Pin::new(&mut self.tcp).poll_read(context, &mut part))?;
        let came = part.filled().len();
        buffer.advance(came);
        self.left = Some(left - came);
        Poll::Ready(Ok(()))
    }
}

impl AsyncWrite for LimitedStream {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.tcp).poll_write(context, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.tcp).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.tcp).poll_shutdown(context)
    }
}

impl AsyncRead for Stream {
    fn poll_read(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        match self.get_mut() {
            Self::Plain(tcp) => Pin::new(tcp).poll_read(context, buffer),
            // A process that is killed says no goodbye. Messages have lengths: whoever cuts a
            // connection cannot pass a part of one for the whole.
            Self::Tls(tls) => match ready!(Pin::new(tls).poll_read(context, buffer)) {
                Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Poll::Ready(Ok(())),
                read => Poll::Ready(read),
            },
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
            Self::Tls(tls) => Pin::new(tls).poll_write(context, bytes),
        }
    }

    fn poll_flush(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        match self.get_mut() {
            Self::Plain(tcp) => Pin::new(tcp).poll_flush(context),
            Self::Tls(tls) => Pin::new(tls).poll_flush(context),
        }
    }

    fn poll_shutdown(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        match self.get_mut() {
            Self::Plain(tcp) => Pin::new(tcp).poll_shutdown(context),
            Self::Tls(tls) => Pin::new(tls).poll_shutdown(context),
        }
    }
}
