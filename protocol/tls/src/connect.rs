//! Connecting to a manager, with keys or without.

use std::io;

use polyptych_protocol::stream::{self, Stream};
use tokio_rustls::TlsStream;

use crate::credentials::Credentials;
use crate::describe::describe;
use crate::encrypted_stream::EncryptedStream;
use crate::limited_stream::LimitedStream;

/// The reason why no manager was reached.
#[derive(Debug, thiserror::Error)]
pub enum ConnectError {
    /// There is no connection, encrypted or not.
    #[error(transparent)]
    Stream(#[from] stream::ConnectError),
    /// These keys are not for connecting.
    #[error("a manager's keys are for its own side only; use a server's or a client's")]
    ManagersKeys,
    /// The two ends did not agree on TLS.
    #[error("{}", describe(.0))]
    Tls(io::Error),
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
    let tcp = stream::connect(address, keys.is_some() || is_insecure).await?;
    let Some(keys) = keys else { return Ok(Stream::Plain(tcp)) };
    let local = tcp.local_addr().map_err(stream::ConnectError::Unreachable)?;
    let (connector, manager) = keys.connector().ok_or(ConnectError::ManagersKeys)?;
    let connected = connector.connect(manager.clone(), LimitedStream::new(tcp)).await;
    let mut tls = connected.map_err(ConnectError::Tls)?;
    tls.get_mut().0.lift();
    let bytes = Box::new(EncryptedStream(TlsStream::Client(tls)));
    Ok(Stream::Encrypted { bytes, local })
}
