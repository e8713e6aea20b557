//! The first messages of a connection: each side's protocol version and role.
//!
//! ```text
//! peer     -> "PLYP" | version u16 LE | role u8 | 0     8 bytes, the same in every version
//! manager  -> "PLYP" | version u16 LE | role u8 | 0
//! manager  -> 32 random bytes, if the versions agree
//! peer     -> frame: Introduction    (if the versions agree)
//! manager  -> frame: Answer          (Refused if they don't: its form never changes)
//! ```
//!
//! The token itself never travels. Each end proves that it knows it by a keyed BLAKE3 hash over
//! the random bytes of both: neither learns anything from the other that it could use again.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::ids::{Epoch, Term};
use crate::limits::PROTOCOL_VERSION;

/// Bytes of a [`Preamble`].
pub const PREAMBLE_BYTES: usize = 8;

const MAGIC: [u8; 4] = *b"PLYP";

/// The role of a peer in the wall.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Role {
    /// Decides.
    Manager,
    /// Asks.
    Client,
    /// Draws: its control connection.
    Server,
    /// A server's second connection, for blobs and pictures.
    Bulk,
}

impl Role {
    fn code(self) -> u8 {
        match self {
            Self::Manager => 0,
            Self::Client => 1,
            Self::Server => 2,
            Self::Bulk => 3,
        }
    }

    /// Returns the role's name for logs and errors.
    pub fn name(self) -> &'static str {
        match self {
            Self::Manager => "manager",
            Self::Client => "client",
            Self::Server => "render server",
            Self::Bulk => "render server (bulk)",
        }
    }
}

/// The first eight bytes in each direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Preamble {
    /// The sender's version of the protocol.
    pub version: u16,
    /// The sender's role.
    pub role: Role,
}

/// The reason why eight bytes are no preamble, or not one to continue with.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PreambleError {
    /// Some other protocol.
    #[error(
        "the peer does not speak the Polyptych protocol: it began with \"{}\"",
        .0.escape_ascii()
    )]
    NotOurs([u8; 8]),
    /// Ours, but another version.
    #[error(
        "the peer speaks version {theirs} of the protocol, and this program version \
         {PROTOCOL_VERSION}; install the same release on both"
    )]
    Version {
        /// The peer's.
        theirs: u16,
    },
    /// Ours, but a role that this version does not know.
    #[error("the peer's role {0} is none of client, render server, bulk and manager")]
    Role(u8),
}

impl Preamble {
    /// The preamble of this version.
    pub fn current(role: Role) -> Self {
        Self { version: PROTOCOL_VERSION, role }
    }

    /// Returns the preamble's bytes on the wire.
    pub fn to_bytes(self) -> [u8; PREAMBLE_BYTES] {
        let [low, high] = self.version.to_le_bytes();
        let [m0, m1, m2, m3] = MAGIC;
        [m0, m1, m2, m3, low, high, self.role.code(), 0]
    }

    /// The preamble that these bytes are.
    ///
    /// # Errors
    /// [`PreambleError`] where they are none, or of a version that this program does not speak.
    pub fn from_bytes(bytes: [u8; PREAMBLE_BYTES]) -> Result<Self, PreambleError> {
        let [m0, m1, m2, m3, low, high, role, _] = bytes;
        if [m0, m1, m2, m3] != MAGIC {
            return Err(PreambleError::NotOurs(bytes));
        }
        let version = u16::from_le_bytes([low, high]);
        if version != PROTOCOL_VERSION {
            return Err(PreambleError::Version { theirs: version });
        }
        let role = match role {
            0 => Role::Manager,
            1 => Role::Client,
            2 => Role::Server,
            3 => Role::Bulk,
            other => return Err(PreambleError::Role(other)),
        };
        Ok(Self { version, role })
    }
}

/// The token, which only this wall's processes know; never printed, and never sent. It is empty
/// over TLS, where certificates prove more.
#[derive(Clone, PartialEq, Eq)]
pub struct Secret(pub String);

/// Random bytes of one end of a connection, used once.
pub type Nonce = [u8; 32];

/// The proof of one end that it knows the token; compared in constant time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Proof([u8; 32]);

/// The random bytes of both ends.
#[derive(Clone, Copy, Debug)]
pub struct Nonces {
    /// The manager's.
    pub manager: Nonce,
    /// The other end's.
    pub peer: Nonce,
}

impl Nonces {
    /// The proof of the peer, for what it says of itself.
    pub fn proof_of_peer(&self, secret: &Secret, hello: &Hello) -> Proof {
        self.proof(secret, 1, &polyptych_codec::encode(hello))
    }

    /// The proof of the manager.
    pub fn proof_of_manager(&self, secret: &Secret) -> Proof {
        self.proof(secret, 0, &[])
    }

    /// `end` keeps one end from giving the other's proof back.
    fn proof(&self, Secret(token): &Secret, end: u8, said: &[u8]) -> Proof {
        let key = blake3::derive_key("polyptych 2026-11 proof of the token", token.as_bytes());
        let mut hasher = blake3::Hasher::new_keyed(&key);
        hasher.update(&[end]).update(&self.manager).update(&self.peer).update(said);
        Proof(*hasher.finalize().as_bytes())
    }
}

impl Proof {
    /// Returns whether two proofs are the same, without telling by its time how much was right.
    pub fn is(&self, other: &Self) -> bool {
        blake3::Hash::from_bytes(self.0) == blake3::Hash::from_bytes(other.0)
    }
}

impl fmt::Debug for Secret {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Secret(..)")
    }
}

/// The first message of a peer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Introduction {
    /// The peer's hello.
    pub hello: Hello,
    /// Its random bytes, which the manager answers.
    pub nonce: Nonce,
    /// [`Nonces::proof_of_peer`].
    pub proof: Proof,
}

/// A peer's description of itself, for its role.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Hello {
    /// A client's.
    Client(ClientHello),
    /// A render server's, on its control connection.
    Server(ServerHello),
    /// A render server's, on its bulk connection.
    Bulk(BulkHello),
}

/// A client introduces itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ClientHello {
    /// For logs and status.
    pub name: String,
}

/// A render server introduces itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ServerHello {
    /// For logs and status.
    pub name: String,
    /// The channels that it claims, by name.
    pub channels: Vec<String>,
    /// Its process id, for an operator.
    pub pid: u32,
    /// The server's graphics adapter.
    pub adapter: Adapter,
}

/// A render server's second connection says which first one it belongs to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BulkHello {
    /// The session number from the [`Welcome`] of the control connection.
    pub session: u64,
}

/// A GPU and its driver.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Adapter {
    /// The adapter's name from its driver.
    pub name: String,
    /// The driver and its version.
    pub driver: String,
    /// Vulkan or GL.
    pub backend: String,
    /// Longest side of a texture or target, in pixels.
    pub texture_side_max: u32,
}

/// The manager's answer to a [`Hello`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum HelloReply {
    /// No, and why. It is the first variant in every version, so that all can read it.
    Refused(Rejection),
    /// Come in.
    Welcome(Welcome, Proof),
}

/// The reason why a peer is refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rejection {
    /// For the log and the operator.
    pub reason: String,
}

/// The data that a peer needs to begin.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Welcome {
    /// This life of the manager.
    pub epoch: Epoch,
    /// The manager's term; a render server refuses a smaller one than it has seen.
    pub term: Term,
    /// Names this connection; a server's bulk connection gives it back.
    pub session: u64,
    /// The wall's name.
    pub wall: String,
    /// A peer silent for this long is lost, in milliseconds.
    pub heartbeat_ms: u32,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_preamble_round_trips_and_strangers_are_named() {
        for role in [Role::Manager, Role::Client, Role::Server, Role::Bulk] {
            let preamble = Preamble::current(role);
            assert_eq!(Preamble::from_bytes(preamble.to_bytes()), Ok(preamble));
        }
        let http = Preamble::from_bytes(*b"GET / HT");
        assert!(matches!(http, Err(PreambleError::NotOurs(_))));
        let newer = Preamble::from_bytes(*b"PLYP\x63\x00\x01\x00");
        assert_eq!(newer, Err(PreambleError::Version { theirs: 99 }));
        let odd = Preamble::from_bytes([b'P', b'L', b'Y', b'P', PROTOCOL_VERSION as u8, 0, 9, 0]);
        assert_eq!(odd, Err(PreambleError::Role(9)));
    }
}
