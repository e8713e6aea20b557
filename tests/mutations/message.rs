//! One message of any kind: decoded, encoded, decoded again, and handed to who it is for.

use std::fmt::Debug;

use bytes::Bytes;
use polyptych_protocol::bulk::{BulkToManager, BulkToServer};
use polyptych_protocol::command::Command;
use polyptych_protocol::handshake::{HelloReply as Greeting, Introduction};
use polyptych_protocol::request::{MessageToClient, RequestMessage};
use polyptych_protocol::server_message::ServerMessage;
use polyptych_scene::Scene;
use serde::Serialize;

/// The kind of message that bytes are decoded as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Introduction,
    Greeting,
    Command,
    Status,
    Call,
    Answer,
    BulkUp,
    BulkDown,
    Manifest,
}

/// All kinds.
pub const KINDS: [Kind; 9] = [
    Kind::Introduction,
    Kind::Greeting,
    Kind::Command,
    Kind::Status,
    Kind::Call,
    Kind::Answer,
    Kind::BulkUp,
    Kind::BulkDown,
    Kind::Manifest,
];

/// A message that was decoded.
#[derive(Clone, Debug)]
pub enum Message {
    Introduction(Introduction),
    Greeting(Greeting),
    Command(Box<Command>),
    Status(ServerMessage),
    Call(RequestMessage),
    Answer(Box<MessageToClient>),
    BulkUp(BulkToManager),
    BulkDown(BulkToServer),
    Manifest(Box<Scene>),
}

impl Message {
    /// Decodes a message of this kind; `None` if the bytes are not one.
    pub fn decode(kind: Kind, bytes: &[u8]) -> Option<Self> {
        match kind {
            Kind::Introduction => {
                polyptych_protocol::framing::decode(bytes).ok().map(Self::Introduction)
            }
            Kind::Greeting => polyptych_protocol::framing::decode(bytes).ok().map(Self::Greeting),
            Kind::Command => {
                polyptych_protocol::framing::decode(bytes).ok().map(|m| Self::Command(Box::new(m)))
            }
            Kind::Status => polyptych_protocol::framing::decode(bytes).ok().map(Self::Status),
            Kind::Call => polyptych_protocol::framing::decode(bytes).ok().map(Self::Call),
            Kind::Answer => {
                polyptych_protocol::framing::decode(bytes).ok().map(|m| Self::Answer(Box::new(m)))
            }
            Kind::BulkUp => polyptych_protocol::framing::decode(bytes).ok().map(Self::BulkUp),
            Kind::BulkDown => polyptych_protocol::framing::decode(bytes).ok().map(Self::BulkDown),
            Kind::Manifest => {
                polyptych_scene::decode(bytes).ok().map(|m| Self::Manifest(Box::new(m)))
            }
        }
    }

    /// Returns the bytes of the message on the wire.
    pub fn encode(&self) -> Bytes {
        fn bytes<T: Serialize + Debug>(message: &T) -> Bytes {
            polyptych_codec::encode(message)
        }
        match self {
            Self::Introduction(message) => bytes(message),
            Self::Greeting(message) => bytes(message),
            Self::Command(message) => bytes(message),
            Self::Status(message) => bytes(message),
            Self::Call(message) => bytes(message),
            Self::Answer(message) => bytes(message),
            Self::BulkUp(message) => bytes(message),
            Self::BulkDown(message) => bytes(message),
            Self::Manifest(message) => bytes(message),
        }
    }

    /// Checks that decoding the encoded message and encoding it again gives equal bytes. Messages
    /// themselves are not compared, as NaN is not equal to itself.
    pub fn check_stable(&self, kind: Kind) {
        let once = self.encode();
        let again = Self::decode(kind, &once).map(|message| message.encode());
        assert_eq!(again.as_ref(), Some(&once), "{kind:?} {self:?}");
    }
}
