//! The handshake on a byte stream, from both ends.
//!
//! Neither end has a time limit here: callers apply [`crate::limits::HANDSHAKE_TIME_MAX`].

use futures_util::{SinkExt, StreamExt};
use polyptych_codec::DecodeError;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio_util::codec::{Framed, LengthDelimitedCodec};

use crate::handshake::{
    Hello, HelloReply, Introduction, Nonce, Nonces, PREAMBLE_BYTES, Preamble, PreambleError, Proof,
    Rejection, Role, Secret, Welcome,
};
use crate::limits::{BULK_BYTES_MAX, HANDSHAKE_BYTES_MAX, MESSAGE_BYTES_MAX};

/// A byte stream cut into messages.
pub type MessageStream<S> = Framed<S, LengthDelimitedCodec>;

/// The reason why a handshake failed.
#[derive(Debug, thiserror::Error)]
pub enum ConnectionError {
    /// The stream failed.
    #[error("the connection failed: {0}")]
    Io(#[from] std::io::Error),
    /// The other end closed the stream.
    #[error("the peer closed the connection during the handshake")]
    Closed,
    /// The other end is not one of ours.
    #[error(transparent)]
    Preamble(#[from] PreambleError),
    /// A message was malformed.
    #[error(transparent)]
    Decode(#[from] DecodeError),
    /// The manager says no.
    #[error("refused: {0}")]
    Refused(String),
    /// The peer that answers does not know the token.
    #[error(
        "what answers there does not know this wall's token: another program or user holds the \
         port, or the manager has another token file; it has learnt nothing of the token"
    )]
    Unproven,
    /// The system gave no random bytes.
    #[error("the system gives no random numbers: {0}")]
    Random(getrandom::Error),
    /// The other end has another role than it must have.
    #[error("a {found} answered where a {wanted} was expected; is the address right?")]
    WrongRole {
        /// The expected role.
        wanted: &'static str,
        /// The role of the peer that answered.
        found: &'static str,
    },
}

/// Introduces this end to a manager, waits for its answer, and makes sure that it knows the token.
///
/// # Errors
/// [`ConnectionError`], with the manager's own reason where it refused.
pub async fn send_hello<S>(
    mut stream: S,
    role: Role,
    hello: &Hello,
    secret: &Secret,
) -> Result<(MessageStream<S>, Welcome), ConnectionError>
where
    S: AsyncRead + AsyncWrite + Unpin,
{
    stream.write_all(&Preamble::current(role).to_bytes()).await?;
    let theirs = read_preamble(&mut stream).await?;
    let version_error = match Preamble::from_bytes(theirs) {
        Ok(Preamble { role: Role::Manager, .. }) => None,
        Ok(Preamble { role, .. }) => {
            return Err(ConnectionError::WrongRole { wanted: "manager", found: role.name() });
        }
        // A manager of another version still says why, in a form that never changes.
        Err(error @ PreambleError::Version { .. }) => Some(error),
        Err(error) => return Err(error.into()),
    };
    let mut nonces = Nonces { manager: [0; 32], peer: nonce()? };
    if version_error.is_none() {
        read_exactly(&mut stream, &mut nonces.manager).await?;
    }
    let mut frames = Framed::new(stream, crate::framing::frames(HANDSHAKE_BYTES_MAX));
    // A manager that refuses early may close before the hello is written; its reason is there
    // to be read all the same.
    let sent = match version_error {
        None => {
            let (nonce, proof) = (nonces.peer, nonces.proof_of_peer(secret, hello));
            let introduction = Introduction { hello: hello.clone(), nonce, proof };
            frames.send(polyptych_codec::encode(&introduction)).await
        }
        Some(_) => Ok(()),
    };
    let answer = match (frames.next().await, sent) {
        (None | Some(Err(_)), Err(error)) => Err(error.into()),
        (answer, _) => answer.ok_or(ConnectionError::Closed),
    };
    if let Some(error) = version_error {
        return Err(error.into());
    }
    match crate::framing::decode::<HelloReply>(&answer??)? {
        HelloReply::Refused(Rejection { reason }) => Err(ConnectionError::Refused(reason)),
        HelloReply::Welcome(_, proof) if !proof.is(&nonces.proof_of_manager(secret)) => {
            Err(ConnectionError::Unproven)
        }
        HelloReply::Welcome(welcome, _) => Ok((widen(frames, role), welcome)),
    }
}

/// A peer that has introduced itself, on the manager's side.
#[derive(Debug)]
pub struct Introduced<S> {
    /// Its connection.
    pub frames: MessageStream<S>,
    /// The peer's hello.
    pub hello: Hello,
    /// `true` if the peer proved that it knows the token.
    pub is_proven: bool,
    /// The proof of this end, for [`accept`].
    pub proof: Proof,
}

/// Waits for a peer's introduction, on the manager's side.
///
/// # Errors
/// [`ConnectionError`]; a peer of another version was told so before.
pub async fn receive_hello<S>(
    mut stream: S,
    secret: &Secret,
) -> Result<Introduced<S>, ConnectionError>
where
    S: AsyncRead + AsyncWrite + Unpin,
{
    let theirs = read_preamble(&mut stream).await?;
    let parsed = Preamble::from_bytes(theirs);
    let manager = nonce()?;
    let ours = Preamble::current(Role::Manager).to_bytes();
    match parsed {
        Ok(_) => stream.write_all(&[&ours[..], &manager].concat()).await?,
        Err(PreambleError::NotOurs(_)) => {}
        Err(_) => stream.write_all(&ours).await?,
    }
    let mut frames = Framed::new(stream, crate::framing::frames(HANDSHAKE_BYTES_MAX));
    let role = match parsed {
        Ok(preamble) => preamble.role,
        Err(error @ PreambleError::NotOurs(_)) => return Err(error.into()),
        Err(error) => {
            reject(&mut frames, refusal_of(&error)).await?;
            return Err(error.into());
        }
    };
    let introduction = frames.next().await.ok_or(ConnectionError::Closed)??;
    let Introduction { hello, nonce, proof } = crate::framing::decode(&introduction)?;
    let found = match (&hello, role) {
        (Hello::Client(_), Role::Client)
        | (Hello::Server(_), Role::Server)
        | (Hello::Bulk(_), Role::Bulk) => {
            let nonces = Nonces { manager, peer: nonce };
            let is_proven = proof.is(&nonces.proof_of_peer(secret, &hello));
            let (frames, proof) = (widen(frames, role), nonces.proof_of_manager(secret));
            return Ok(Introduced { frames, hello, is_proven, proof });
        }
        _ => role.name(),
    };
    let error = ConnectionError::WrongRole { wanted: "peer whose hello fits its role", found };
    reject(&mut frames, error.to_string()).await?;
    Err(error)
}

fn refusal_of(error: &PreambleError) -> String {
    match error {
        PreambleError::Version { theirs } => format!(
            "you speak version {theirs} of the protocol, and this manager version {}; \
             install the same release on both",
            crate::limits::PROTOCOL_VERSION
        ),
        other => other.to_string(),
    }
}

/// Tells a peer that it may not come in, and why.
///
/// # Errors
/// [`ConnectionError::Io`] where it can't be told.
pub async fn reject<S>(frames: &mut MessageStream<S>, reason: String) -> Result<(), ConnectionError>
where
    S: AsyncRead + AsyncWrite + Unpin,
{
    let answer = HelloReply::Refused(Rejection { reason });
    frames.send(polyptych_codec::encode(&answer)).await?;
    Ok(())
}

/// Refuses a peer of any version before it has introduced itself.
///
/// # Errors
/// [`ConnectionError`] where it is none of ours, and was told nothing.
pub async fn reject_unread<S>(mut stream: S, reason: &str) -> Result<(), ConnectionError>
where
    S: AsyncRead + AsyncWrite + Unpin,
{
    let parsed = Preamble::from_bytes(read_preamble(&mut stream).await?);
    if let Err(error @ PreambleError::NotOurs(_)) = parsed {
        return Err(error.into());
    }
    let ours = Preamble::current(Role::Manager).to_bytes();
    // A peer of this version reads random bytes before the answer.
    let nonce = if parsed.is_ok() { nonce()?.to_vec() } else { Vec::new() };
    stream.write_all(&[&ours[..], &nonce].concat()).await?;
    let mut frames = Framed::new(stream, crate::framing::frames(HANDSHAKE_BYTES_MAX));
    reject(&mut frames, reason.to_owned()).await
}

/// Lets a peer in, and proves to it that this end knows the token.
///
/// # Errors
/// [`ConnectionError::Io`] where it can't be told.
pub async fn accept<S>(
    frames: &mut MessageStream<S>,
    welcome: Welcome,
    proof: Proof,
) -> Result<(), ConnectionError>
where
    S: AsyncRead + AsyncWrite + Unpin,
{
    frames.send(polyptych_codec::encode(&HelloReply::Welcome(welcome, proof))).await?;
    Ok(())
}

fn nonce() -> Result<Nonce, ConnectionError> {
    let mut nonce = [0; 32];
    getrandom::fill(&mut nonce).map_err(ConnectionError::Random)?;
    Ok(nonce)
}

async fn read_preamble<S: AsyncRead + Unpin>(
    stream: &mut S,
) -> Result<[u8; PREAMBLE_BYTES], ConnectionError> {
    let mut bytes = [0; PREAMBLE_BYTES];
    read_exactly(stream, &mut bytes).await?;
    Ok(bytes)
}

async fn read_exactly<S: AsyncRead + Unpin>(
    stream: &mut S,
    bytes: &mut [u8],
) -> Result<(), ConnectionError> {
    match stream.read_exact(bytes).await {
        Ok(_) => Ok(()),
        Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => {
            Err(ConnectionError::Closed)
        }
        Err(error) => Err(error.into()),
    }
}

/// After the handshake a peer is trusted with larger messages.
fn widen<S>(mut frames: MessageStream<S>, role: Role) -> MessageStream<S> {
    let bytes_max = if role == Role::Bulk { BULK_BYTES_MAX } else { MESSAGE_BYTES_MAX };
    frames.codec_mut().set_max_frame_length(bytes_max);
    frames
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::handshake::{ClientHello, Secret};
    use crate::ids::{Epoch, Term};

    fn hello() -> Hello {
        Hello::Client(ClientHello { name: "test".into() })
    }

    fn secret() -> Secret {
        Secret("0123456789abcdef".into())
    }

    fn run<F: Future>(future: F) -> F::Output {
        tokio::runtime::Builder::new_current_thread().build().expect("a runtime").block_on(future)
    }

    #[test]
    fn two_ends_come_together() {
        let (ours, theirs) = tokio::io::duplex(4096);
        let given = Welcome {
            epoch: Epoch(7),
            term: Term(3),
            session: 1,
            wall: "w".into(),
            heartbeat_ms: 2000,
        };
        let expected = given.clone();
        run(async {
            let manager = async {
                let mut peer = receive_hello(theirs, &secret()).await.expect("introduced");
                assert!(matches!(peer.hello, Hello::Client(_)) && peer.is_proven);
                accept(&mut peer.frames, given, peer.proof).await.expect("welcomed");
            };
            let (hello, secret) = (hello(), secret());
            let ((), answer) =
                tokio::join!(manager, send_hello(ours, Role::Client, &hello, &secret));
            assert_eq!(answer.expect("welcome").1, expected);
        });
    }

    #[test]
    fn another_version_is_named_on_both_sides() {
        let (mut ours, theirs) = tokio::io::duplex(4096);
        run(async {
            ours.write_all(b"PLYP\x63\x00\x01\x00").await.expect("written");
            let error = receive_hello(theirs, &secret()).await.expect_err("refused");
            assert!(error.to_string().contains("version 99"), "{error}");
            let mut answer = Vec::new();
            ours.read_to_end(&mut answer).await.expect("an answer");
            assert!(String::from_utf8_lossy(&answer).contains("you speak version 99"));
        });
    }

    #[test]
    fn a_stranger_gets_nothing() {
        let (mut ours, theirs) = tokio::io::duplex(4096);
        run(async {
            ours.write_all(b"GET / HTTP/1.1\r\n\r\n").await.expect("written");
            assert!(receive_hello(theirs, &secret()).await.is_err());
            let mut answer = Vec::new();
            ours.read_to_end(&mut answer).await.expect("the end");
            assert!(answer.is_empty());
        });
    }
}
