//! Pictures and files on their way to a client.

use bytes::Bytes;
use polyptych_text::text_of_peer;
use serde::{Deserialize, Serialize};

use crate::ids::{FrameId, RequestId};

/// The pictures of one frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CaptureInfo {
    /// The frame that they all show.
    pub frame: FrameId,
    /// One for each screen, then one for each channel.
    pub pictures: Vec<ImageInfo>,
    /// Channels that sent none, or whose place on the screen could not be read, with the reason;
    /// their part of the screen is left dark.
    #[serde(deserialize_with = "text_of_peer")]
    pub missing: Vec<(String, String)>,
}

/// The subject and the size of a picture.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ImageInfo {
    /// The name of the screen or channel.
    #[serde(deserialize_with = "text_of_peer")]
    pub name: String,
    /// `true` for a whole screen, stitched.
    pub is_screen: bool,
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
}

/// At most [`polyptych_files::blob::CHUNK_BYTES_MAX`] bytes of a picture (sRGB RGBA8, rows from
/// the top) or of a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReplyChunk {
    /// The request that it answers.
    pub id: RequestId,
    /// Its place in [`CaptureInfo::pictures`]; 0 for a file.
    pub index: u32,
    /// The bytes, following those that came before.
    pub bytes: Bytes,
}
