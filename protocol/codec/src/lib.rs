//! Values as bytes, on the wire and in files: bincode, which only this crate names.
//! A message is framed by its length:
//!
//! ```text
//! +----------------+---------------------+
//! | length u32 LE  | message, length B   |   bincode 2, varint, little-endian
//! +----------------+---------------------+
//! ```

use bytes::Bytes;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// The reason why bytes are not a message.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DecodeError {
    /// They don't have the message's form.
    #[error("these {bytes} bytes are not a {what}: {reason}")]
    Malformed {
        /// The message's type.
        what: &'static str,
        /// The number of bytes received.
        bytes: usize,
        /// Bincode's reason.
        reason: String,
    },
    /// The message ended before the bytes did.
    #[error("{extra} bytes stand behind a {what}")]
    Trailing {
        /// The message's type.
        what: &'static str,
        /// The number of surplus bytes.
        extra: usize,
    },
}

/// Most messages are smaller, frame commands among them.
const MESSAGE_BYTES_USUAL: usize = 256;

/// The bytes of a message.
///
/// Our messages are plain data without maps or lengths unknown beforehand, for which bincode
/// cannot fail; should it, an empty frame goes out, which every decoder refuses.
pub fn encode<T: Serialize>(message: &T) -> Bytes {
    // Room for a frame command: growing byte by byte would cost more than encoding does.
    let mut bytes = Vec::with_capacity(MESSAGE_BYTES_USUAL);
    let into = Growing(&mut bytes);
    match bincode::serde::encode_into_writer(message, into, bincode::config::standard()) {
        Ok(()) => Bytes::from(bytes),
        Err(_) => Bytes::new(),
    }
}

/// Encodes a value into `room`, which is emptied before: for many small values, without memory of
/// its own for each. Fails as [`encode`] does, with nothing in `room`.
pub fn encode_into<T: Serialize>(value: &T, room: &mut Vec<u8>) {
    room.clear();
    let config = bincode::config::standard();
    if bincode::serde::encode_into_writer(value, Growing(room), config).is_err() {
        room.clear();
    }
}

/// Puts a message with its length before it behind what `frames` holds, as [`framed`] would:
/// for a file of many small ones, without memory of its own for each.
pub fn append_framed<T: Serialize>(message: &T, frames: &mut Vec<u8>) {
    let start = frames.len();
    frames.extend_from_slice(&[0; 4]);
    let config = bincode::config::standard();
    if bincode::serde::encode_into_writer(message, Growing(frames), config).is_err() {
        // As with `encode`: what cannot fail leaves an empty frame, should it.
        frames.truncate(start + 4);
    }
    let length = u32::try_from(frames.len() - start - 4).unwrap_or(u32::MAX);
    frames[start..start + 4].copy_from_slice(&length.to_le_bytes());
}

/// A writer for bincode that grows a vector; bincode's own one begins without capacity.
struct Growing<'a>(&'a mut Vec<u8>);

impl bincode::enc::write::Writer for Growing<'_> {
    fn write(&mut self, bytes: &[u8]) -> Result<(), bincode::error::EncodeError> {
        self.0.extend_from_slice(bytes);
        Ok(())
    }
}

/// An encoded message with its length before it: a whole frame, as it stands on the wire.
///
/// For a message that goes to many peers: it is put together once.
pub fn framed(message: &Bytes) -> Bytes {
    // Longer messages are refused by every peer's decoder; they are not made.
    let length = u32::try_from(message.len()).unwrap_or(u32::MAX);
    let mut frame = Vec::with_capacity(4 + message.len());
    frame.extend_from_slice(&length.to_le_bytes());
    frame.extend_from_slice(message);
    Bytes::from(frame)
}

/// Maximum memory in bytes that a short message's values may claim; see [`decode_within`].
const CLAIM_SHORT_MAX: usize = 64 << 10;

/// Maximum memory in bytes that the values of a message of middle length may claim.
const CLAIM_MIDDLE_MAX: usize = 1 << 20;

/// Maximum memory in bytes that a long manifest's values may claim.
const CLAIM_LONG_MAX: usize = 32 << 20;

/// Decodes a value from all of these bytes, which may take `BYTES_MAX` of memory.
///
/// The limit fits the bytes that are there: bincode makes room for a string before it looks whether
/// there is one, and ten bytes can say that they are four mebibytes.
///
/// # Errors
/// [`DecodeError`] if they are not a `T`, or more than one.
pub fn decode_within<T: DeserializeOwned, const BYTES_MAX: usize>(
    bytes: &[u8],
) -> Result<T, DecodeError> {
    // bincode counts what values take in memory; a varint of one byte stands for at most eight.
    let claim = bytes.len().saturating_mul(8);
    if claim <= CLAIM_SHORT_MAX {
        decode_claiming::<T, CLAIM_SHORT_MAX>(bytes)
    } else if claim <= CLAIM_MIDDLE_MAX {
        decode_claiming::<T, CLAIM_MIDDLE_MAX>(bytes)
    } else if claim <= CLAIM_LONG_MAX && CLAIM_LONG_MAX < BYTES_MAX {
        decode_claiming::<T, CLAIM_LONG_MAX>(bytes)
    } else {
        decode_claiming::<T, BYTES_MAX>(bytes)
    }
}

fn decode_claiming<T: DeserializeOwned, const BYTES_MAX: usize>(
    bytes: &[u8],
) -> Result<T, DecodeError> {
    // Only asked where something is wrong: finding it costs as much as decoding a report.
    let what = || std::any::type_name::<T>().rsplit("::").next().unwrap_or("message");
    let config = bincode::config::standard().with_limit::<BYTES_MAX>();
    match bincode::serde::decode_from_slice(bytes, config) {
        Ok((message, used)) if used == bytes.len() => Ok(message),
        Ok((_, used)) => Err(DecodeError::Trailing { what: what(), extra: bytes.len() - used }),
        Err(error) => {
            let reason = error.to_string();
            Err(DecodeError::Malformed { what: what(), bytes: bytes.len(), reason })
        }
    }
}
