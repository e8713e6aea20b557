//! Taking a connection in, on the manager's side.

use polyptych_protocol::stream::{Stream, expect_plain, linger, reject_plain, speaks_tls, tune};
use tokio::net::TcpStream;
use tokio_rustls::TlsStream;

use crate::credentials::Credentials;
use crate::describe::describe;
use crate::encrypted_stream::EncryptedStream;
use crate::identity::NodeIdentity;
use crate::limited_stream::LimitedStream;

/// Accepts a connection: with keys only over TLS and from peers with a certificate, without keys
/// only in the clear. Returns the stream, with the peer's identity if there are keys.
///
/// The caller puts [`polyptych_protocol::limits::HANDSHAKE_TIME_MAX`] around it.
///
/// # Errors
/// The reason why the peer is refused; it was told so, as far as it can understand.
pub async fn accept(
    tcp: TcpStream,
    keys: Option<&Credentials>,
) -> Result<(Stream, Option<NodeIdentity>), String> {
    tune(&tcp).map_err(|error| error.to_string())?;
    let Some(keys) = keys else { return Ok((Stream::Plain(expect_plain(tcp).await?), None)) };
    let local = tcp.local_addr().map_err(|error| error.to_string())?;
    let acceptor = keys.acceptor().ok_or("this manager's keys are another node's")?;
    if !speaks_tls(&tcp).await.map_err(|error| error.to_string())? {
        return Err(reject_plain(tcp).await);
    }
    let accepted = acceptor.accept(LimitedStream::new(tcp)).into_fallible().await;
    let mut tls = match accepted {
        Ok(tls) => tls,
        Err((error, limited)) => {
            // The reason is on its way as an alert.
            linger(limited.into_inner()).await;
            return Err(describe(&error));
        }
    };
    let (limited, session) = tls.get_mut();
    limited.lift();
    let shown = session.peer_certificates().and_then(|chain| chain.first());
    let shown = shown.ok_or("the peer shows no certificate")?;
    let identity = NodeIdentity::from_certificate(shown)
        .map_err(|what| format!("the peer's certificate is refused: {what}"))?;
    let bytes = Box::new(EncryptedStream(TlsStream::Server(tls)));
    Ok((Stream::Encrypted { bytes, local }, Some(identity)))
}
