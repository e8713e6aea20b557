//! Connections over networks: TLS 1.3 over the wire's TCP, with both sides proving who they are.
//!
//! The wire itself knows only streams of bytes; programs that stay on one machine need none of
//! this. A node's keys are [`Credentials`], its name in them a [`NodeIdentity`]. [`connect()`] and
//! [`accept()`] do as they do in [`polyptych_protocol::stream`], over TLS where there are keys.

mod accept;
mod connect;
mod credentials;
mod describe;
mod encrypted_stream;
mod identity;
mod limited_stream;

pub use accept::accept;
pub use connect::{ConnectError, connect};
pub use credentials::{
    AUTHORITY_FILE, CERTIFICATE_FILE, Credentials, CredentialsError, KEY_FILE, certificate,
};
pub use describe::describe;
pub use identity::NodeIdentity;
