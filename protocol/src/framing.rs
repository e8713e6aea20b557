//! Messages on a byte stream.
//!
//! A length above the connection's limit ends the connection before anything is allocated.

use polyptych_codec::{DecodeError, decode_within};
use serde::de::DeserializeOwned;
use tokio_util::codec::LengthDelimitedCodec;

use crate::limits::MESSAGE_BYTES_MAX;

/// Splits a byte stream into frames of at most `bytes_max` bytes.
pub fn frames(bytes_max: usize) -> LengthDelimitedCodec {
    LengthDelimitedCodec::builder().little_endian().max_frame_length(bytes_max).new_codec()
}

/// Decodes a message from all of these bytes.
///
/// # Errors
/// [`DecodeError`] if they are not a `T`, or more than one.
pub fn decode<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, DecodeError> {
    decode_within::<T, MESSAGE_BYTES_MAX>(bytes)
}

#[cfg(test)]
mod tests;
