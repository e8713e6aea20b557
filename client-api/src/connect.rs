//! The client's connection to its manager: address, token, handshake.

use std::future::Ready;
use std::net::{IpAddr, SocketAddr};
use std::path::{Path, PathBuf};
use std::time::Duration;
use std::{fmt, io};

use polyptych_protocol::handshake::{ClientHello, Hello, Role, Secret};
use polyptych_protocol::handshake_io::{ConnectionError, send_hello};
use polyptych_protocol::limits::{HANDSHAKE_TIME_MAX, MANAGER_SILENCE_MAX};
use polyptych_protocol::manager_addresses::ManagerAddresses;
use polyptych_protocol::request::Request;
use polyptych_protocol::stall_limit::StallLimit;
use polyptych_protocol::stream::Stream;
use polyptych_protocol::token;
use polyptych_text::make_printable;
use polyptych_wall::limits::{NAME_BYTES_MAX, PORT_DEFAULT};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::time::{sleep, timeout};

use crate::connection::{WRITE_TIME_MAX, run_connection};
use crate::connection_handle::ConnectionHandle;
use crate::dial::dial;
use crate::error::ClientError;
use crate::image::CAPTURE_BYTES_MAX;
use crate::reconnect::{HandshakeResult, ReconnectPolicy, Reconnector};

/// Names a client's folder of keys. Servers and managers are told by `--keys` only: one
/// environment may start several nodes, and each has its own.
pub const KEYS_VARIABLE: &str = "POLYPTYCH_KEYS";

/// Further attempts where a connection ends without a word, and the wait before the first; before
/// each other one it is as much longer.
const FLOOD_TRIES: u32 = 4;
const FLOOD_WAIT: Duration = Duration::from_millis(20);

/// Options of a connection: the manager's address, this client's name and keys, and limits.
///
/// ```
/// use polyptych_client::ConnectOptions;
///
/// let options = ConnectOptions { name: "planner".into(), ..ConnectOptions::new("wall-3") };
/// assert_eq!(options.address, "wall-3");
/// ```
#[derive(Clone)]
pub struct ConnectOptions {
    /// The manager's host and port; the port is 7878 where none is given. Where managers share the
    /// wall, the addresses of all, separated by commas: the client finds the one that leads, and
    /// leaves one from which nothing comes for five seconds, or for the wall's heartbeat limit.
    pub address: String,
    /// The manager's secret itself; goes before `token_file`.
    pub token: Option<String>,
    /// The file that holds the secret; where `None`, `POLYPTYCH_TOKEN_FILE` or
    /// `polyptych/token` in the user's state folder.
    pub token_file: Option<PathBuf>,
    /// This client's folder of keys, as `polyptych keys` makes it: all is encrypted, both sides
    /// prove who they are, and no token is needed. [`ConnectOptions::new`] takes it from
    /// `POLYPTYCH_KEYS`. It must be there where the manager is on another machine, and the program
    /// must be built with this crate's feature `tls`.
    pub keys: Option<PathBuf>,
    /// Goes over a network without keys, where the token can be read by all who listen there.
    pub insecure: bool,
    /// For logs and status; cut to the protocol's 64 bytes. With keys it is the certificate's.
    pub name: String,
    /// The time limits of requests.
    pub timeouts: Timeouts,
    /// Maximum bytes that the pictures of one capture may take; [`CAPTURE_BYTES_MAX`] by default.
    pub capture_bytes_max: usize,
    /// The policy when the connection ends. By default the client reconnects indefinitely: requests
    /// that were open fail once, later ones wait a little, and feedback goes on. `None` ends the
    /// client with its connection, which suits a program that makes one request.
    ///
    /// Only connections that [`crate::Client::connect_with`] makes can be made again.
    pub reconnect: Option<ReconnectPolicy>,
}

/// The time limits of the answers to requests.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timeouts {
    /// For opening a scene, which includes baking it, for exporting one, and for surroundings and
    /// effects of light, which displays get ready for: two minutes by default from each message
    /// about its progress on.
    pub open_scene: Duration,
    /// For a capture with its pictures: one minute by default.
    pub capture: Duration,
    /// For everything else: half a minute by default, many times the longest frame deadline, from
    /// each message on that its files are still being baked.
    pub other: Duration,
}

impl Default for Timeouts {
    fn default() -> Self {
        let [open_scene, capture, other] = [120, 60, 30].map(Duration::from_secs);
        Self { open_scene, capture, other }
    }
}

impl Timeouts {
    pub(crate) fn of(&self, request: &Request) -> Duration {
        match request {
            Request::OpenScene { .. }
            | Request::OpenOutcome { .. }
            | Request::OpenSession { .. }
            | Request::ExportScene { .. }
            | Request::SetEnvironment(_)
            | Request::SetFog(_)
            | Request::SetGlow(_)
            | Request::SetAmbientOcclusion(_)
            | Request::SetDepthOfField(_) => self.open_scene,
            Request::Capture { .. } | Request::Preview { .. } => self.capture,
            _ => self.other,
        }
    }
}

impl ConnectOptions {
    /// The manager at this address, with the user's own token and the program's name.
    pub fn new(address: impl Into<String>) -> Self {
        let program = std::env::args_os().next();
        let stem = program.as_deref().and_then(|path| Path::new(path).file_stem());
        Self {
            address: address.into(),
            token: None,
            token_file: None,
            keys: std::env::var_os(KEYS_VARIABLE).filter(|v| !v.is_empty()).map(PathBuf::from),
            insecure: false,
            name: stem.map_or_else(|| "client".into(), |s| s.to_string_lossy().into_owned()),
            timeouts: Timeouts::default(),
            capture_bytes_max: CAPTURE_BYTES_MAX,
            reconnect: Some(ReconnectPolicy::default()),
        }
    }

    fn read_token(&self) -> Result<String, ClientError> {
        if let Some(token) = &self.token {
            return Ok(token.clone());
        }
        let path = self.token_file.clone().map_or_else(token::default_path, Ok)?;
        Ok(token::read(&path)?)
    }
}

impl fmt::Debug for ConnectOptions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ConnectOptions")
            .field("address", &self.address)
            .field("token", &self.token.as_ref().map(|_| "(secret)"))
            .field("token_file", &self.token_file)
            .field("keys", &self.keys)
            .field("insecure", &self.insecure)
            .field("name", &self.name)
            .field("timeouts", &self.timeouts)
            .field("capture_bytes_max", &self.capture_bytes_max)
            .field("reconnect", &self.reconnect)
            .finish()
    }
}

/// Connects over TCP; the future that comes with the link runs the connection.
pub(crate) async fn connect_tcp(
    mut options: ConnectOptions,
) -> Result<(ConnectionHandle, impl Future<Output = ()> + Send + 'static), ClientError> {
    let with_ports = |list: &str| list.split(',').map(|a| with_port(a.trim())).collect::<Vec<_>>();
    options.address = with_ports(&options.address).join(",");
    let mut managers = ManagerAddresses::new(&options.address);
    let has_standby = managers.len() > 1;
    let connected = dial_each(&options, &mut managers).await?;
    let (frames, welcome) = limit_silence(connected, has_standby);
    let dialled = options.clone();
    // What was given is kept only where it is needed again.
    options.token = None;
    let redial = options.reconnect.map(|reconnect| {
        let dial = move || {
            managers.advance();
            let options =
                ConnectOptions { address: managers.current().to_owned(), ..dialled.clone() };
            async move {
                let connected = dial_and_introduce(&options).await;
                connected.map(|connected| limit_silence(connected, has_standby))
            }
        };
        Reconnector { reconnect, dial, has_standby }
    });
    let (link, messages) = ConnectionHandle::new(options, welcome);
    let driver = run_connection(frames, link.shared.clone(), messages, redial);
    Ok((link, driver))
}

/// Ends the connection once nothing has come from its manager for too long, if there is another
/// that may lead. The only manager of a wall is waited for: no other could answer, and what was
/// sent to it may yet be done.
pub(crate) fn limit_silence<S>(
    (mut frames, welcome): HandshakeResult<S>,
    has_standby: bool,
) -> HandshakeResult<S> {
    if has_standby {
        let heartbeat = Duration::from_millis(u64::from(welcome.heartbeat_ms));
        frames.get_mut().limit_silence(MANAGER_SILENCE_MAX.max(heartbeat));
    }
    (frames, welcome)
}

/// Connects to the first of the managers that lets this client in. The error is one of a manager
/// that answered, if any did: a standby refuses connections while it does not lead.
async fn dial_each(
    options: &ConnectOptions,
    managers: &mut ManagerAddresses,
) -> Result<HandshakeResult<Stream>, ClientError> {
    let at = |address: &str| ConnectOptions { address: address.to_owned(), ..options.clone() };
    let mut failed = match dial_through_a_flood(&at(managers.current())).await {
        Ok(connected) => return Ok(connected),
        Err(error) => error,
    };
    while !managers.advance() {
        match dial_through_a_flood(&at(managers.current())).await {
            Ok(connected) => return Ok(connected),
            Err(error) if matches!(failed, ClientError::NoManager { .. }) => failed = error,
            Err(_) => {}
        }
    }
    Err(failed)
}

/// Connects, though a manager that is flooded with connections may end this one before it has
/// spoken.
async fn dial_through_a_flood(
    options: &ConnectOptions,
) -> Result<HandshakeResult<Stream>, ClientError> {
    let first = match dial_and_introduce(options).await {
        Err(error) if was_torn(&error) => error,
        other => return other,
    };
    for try_number in 1..=FLOOD_TRIES {
        sleep(FLOOD_WAIT * try_number).await;
        match dial_and_introduce(options).await {
            Err(error) if was_torn(&error) => {}
            // Whatever else goes wrong now, the first reason is the one to tell.
            other => return other.map_err(|_| first),
        }
    }
    Err(first)
}

/// Returns whether the other end closed a connection without a word.
fn was_torn(error: &ClientError) -> bool {
    let ClientError::Handshake { source, .. } = error else { return false };
    match source {
        ConnectionError::Closed => true,
        ConnectionError::Io(error) => {
            matches!(error.kind(), io::ErrorKind::ConnectionReset | io::ErrorKind::BrokenPipe)
        }
        _ => false,
    }
}

/// One attempt to connect, with the token as its file has it now.
async fn dial_and_introduce(
    options: &ConnectOptions,
) -> Result<HandshakeResult<Stream>, ClientError> {
    let address = &options.address;
    let connecting = async {
        let mut options = options.clone();
        let stream = dial(&mut options).await?;
        // Only now: where nobody listens, that is the better thing to say. A certificate stands for
        // the token.
        let token = if options.keys.is_some() { String::new() } else { options.read_token()? };
        handshake(stream, &options, token).await
    };
    let after = HANDSHAKE_TIME_MAX;
    let timed_out = |_| ClientError::NoIntroduction { address: address.clone(), after };
    timeout(after, connecting).await.map_err(timed_out)?
}

/// A way to connect again where there is none.
type NoReconnect<S> = fn() -> Ready<Result<HandshakeResult<S>, ClientError>>;

/// Connects over a stream that is open already; otherwise like [`connect_tcp`].
pub(crate) async fn connect_over<S>(
    stream: S,
    mut options: ConnectOptions,
) -> Result<(ConnectionHandle, impl Future<Output = ()> + Send + 'static), ClientError>
where
    S: AsyncRead + AsyncWrite + Send + Unpin + 'static,
{
    let address = options.address.clone();
    let token = options.read_token()?;
    let after = HANDSHAKE_TIME_MAX;
    let timed_out = |_| ClientError::NoIntroduction { address, after };
    let introduced = timeout(after, handshake(stream, &options, token)).await;
    let (frames, welcome) = introduced.map_err(timed_out)??;
    // Where the stream came from there may be no other.
    (options.token, options.reconnect) = (None, None);
    let (link, messages) = ConnectionHandle::new(options, welcome);
    let no_redial: Option<Reconnector<NoReconnect<S>>> = None;
    let driver = run_connection(frames, link.shared.clone(), messages, no_redial);
    Ok((link, driver))
}

async fn handshake<S>(
    stream: S,
    options: &ConnectOptions,
    token: String,
) -> Result<HandshakeResult<S>, ClientError>
where
    S: AsyncRead + AsyncWrite + Unpin,
{
    let mut name = options.name.clone();
    name.truncate(name.floor_char_boundary(NAME_BYTES_MAX));
    let hello = Hello::Client(ClientHello { name });
    let address = options.address.clone();
    let stream = StallLimit::new(stream, WRITE_TIME_MAX);
    let introduced = send_hello(stream, Role::Client, &hello, &Secret(token)).await;
    let (frames, mut welcome) = introduced.map_err(|error| match error {
        ConnectionError::Refused(mut reason) => {
            make_printable(&mut reason);
            ClientError::Refused { address, reason }
        }
        source => ClientError::Handshake { address, source },
    })?;
    make_printable(&mut welcome.wall);
    tracing::debug!(address = options.address, wall = welcome.wall, "connected");
    Ok((frames, welcome))
}

/// The address with a port: a host alone means the manager's usual one.
fn with_port(address: &str) -> String {
    let bare = address.trim_start_matches('[').trim_end_matches(']');
    match bare.parse::<IpAddr>() {
        Ok(ip) => SocketAddr::new(ip, PORT_DEFAULT).to_string(),
        Err(_) if address.contains(':') => address.to_owned(),
        Err(_) => format!("{address}:{PORT_DEFAULT}"),
    }
}

/// The error of a blocking client whose thread gave no sign.
pub(crate) fn thread_ended() -> ClientError {
    ClientError::Thread(io::Error::other("it ended before it connected"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_host_alone_means_the_usual_port() {
        for (given, expected) in [
            ("wall-3", "wall-3:7878"),
            ("wall-3:80", "wall-3:80"),
            ("127.0.0.1", "127.0.0.1:7878"),
            ("127.0.0.1:1", "127.0.0.1:1"),
            ("::1", "[::1]:7878"),
            ("[::1]", "[::1]:7878"),
            ("[::1]:9", "[::1]:9"),
        ] {
            assert_eq!(with_port(given), expected);
        }
    }

    #[test]
    fn the_token_is_never_printed() {
        let token = Some("0123456789abcdef".to_owned());
        let options = ConnectOptions { token, ..ConnectOptions::new("x") };
        assert!(!format!("{options:?}").contains("0123456789abcdef"));
    }
}
