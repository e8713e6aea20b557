//! The messages of a bulk connection: blobs to a server, pictures to the manager.

use bytes::Bytes;
use polyptych_files::blob::BlobHash;
use polyptych_wall::ChannelId;
use serde::{Deserialize, Serialize};

use crate::ids::FrameId;

/// Messages of a server over its bulk connection.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum BulkToManager {
    /// Asks for a blob of a scene that it was sent.
    Want(BlobHash),
    /// A piece of the picture that a channel drew for a frame.
    Picture(CaptureChunk),
    /// Asks for the rest of a blob whose beginning the server has.
    WantRest {
        /// The blob.
        hash: BlobHash,
        /// Bytes that the server has: a multiple of
        /// [`polyptych_files::blob::CHUNK_BYTES_MAX`] below the blob's size.
        offset: u64,
    },
    /// Ends the blob that comes, as nobody wants it any more; answered by
    /// [`BulkToServer::Stopped`], whether the blob has come whole meanwhile or not.
    Stop,
}

/// Messages of the manager over a server's bulk connection.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum BulkToServer {
    /// A piece of a blob, whose bytes are the next message: so they are copied by neither end.
    /// Pieces come in order.
    Chunk(BlobChunk),
    /// It is not to be had, and why.
    Missing {
        /// The requested blob.
        hash: BlobHash,
        /// The reason.
        reason: String,
    },
    /// No more comes of the blob before.
    Stopped,
}

/// The place of a piece of a blob: of at most [`polyptych_files::blob::CHUNK_BYTES_MAX`] bytes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BlobChunk {
    /// The blob.
    pub hash: BlobHash,
    /// Bytes of the whole blob.
    pub total: u64,
    /// The offset of its bytes in the blob.
    pub offset: u64,
}

/// At most [`polyptych_files::blob::CHUNK_BYTES_MAX`] bytes of a picture: sRGB RGBA8, rows
/// from the top.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CaptureChunk {
    /// The channel that drew it.
    pub channel: ChannelId,
    /// The frame that it shows.
    pub frame: FrameId,
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// The offset of these bytes in the picture.
    pub offset: u64,
    /// The bytes.
    pub bytes: Bytes,
}
