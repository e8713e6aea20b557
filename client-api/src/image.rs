//! Pictures of the wall, and how they come together from their pieces.

use std::fmt;

use bytes::Bytes;
use polyptych_protocol::ids::FrameId;
use polyptych_protocol::request::CaptureInfo;
use polyptych_wall::limits::{CHANNELS_MAX, SCREENS_MAX};
use tokio::sync::mpsc;

use crate::error::ClientError;

/// Maximum bytes that the pictures of one capture take by default: a stitched screen of 16,384 ×
/// 16,384 pixels and the same pixels once more as channels.
pub const CAPTURE_BYTES_MAX: usize = 2 << 30;

/// Maximum number of pictures of one capture: each screen and each channel.
const PICTURES_MAX: usize = SCREENS_MAX + CHANNELS_MAX;

/// One frame, as all channels showed it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Capture {
    /// The frame.
    pub frame: FrameId,
    /// One for each screen, in the wall's order: its channels as they hang on the wall, and dark
    /// where there is a bezel or a channel is missing.
    pub screens: Vec<Image>,
    /// One for each channel that sent a picture, in the wall's order.
    pub channels: Vec<Image>,
    /// The channels that sent none, or whose place on the screen could not be read, by name, each
    /// with the reason.
    pub missing: Vec<(String, String)>,
}

/// A picture of a screen or channel.
#[derive(Clone, PartialEq, Eq)]
pub struct Image {
    /// The name of the screen or channel.
    pub name: String,
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// sRGB RGBA8, rows from the top, without padding: `width * height * 4` bytes.
    pub rgba: Vec<u8>,
}

impl fmt::Debug for Image {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, width, height, rgba } = self;
        write!(f, "Picture({name}, {width} x {height}, {} bytes)", rgba.len())
    }
}

/// The place for the pieces that come before a reply.
#[derive(Debug)]
pub(crate) enum ChunkSink {
    /// Pictures of a capture.
    Pictures(ImageAssembler),
    /// The pieces of a file, in order, for the caller to write.
    File(mpsc::Sender<Bytes>),
}

/// The pieces of a capture's pictures, which come before their description does.
#[derive(Debug)]
pub(crate) struct ImageAssembler {
    pictures: Vec<Vec<u8>>,
    bytes: usize,
    bytes_max: usize,
}

impl ImageAssembler {
    /// None yet.
    pub fn new(bytes_max: usize) -> Self {
        Self { pictures: Vec::new(), bytes: 0, bytes_max }
    }

    /// Appends a piece to its picture.
    ///
    /// # Errors
    /// [`ClientError::CaptureTooLarge`] and [`ClientError::MalformedPicture`], after which the
    /// capture is over.
    pub fn add(&mut self, index: u32, piece: &[u8]) -> Result<(), ClientError> {
        let index = index as usize;
        if index >= PICTURES_MAX {
            let reason = format!("a piece of picture {index}, of at most {PICTURES_MAX}");
            return Err(ClientError::MalformedPicture { reason });
        }
        self.bytes = self.bytes.saturating_add(piece.len());
        if self.bytes > self.bytes_max {
            return Err(ClientError::CaptureTooLarge { limit: self.bytes_max });
        }
        if self.pictures.len() <= index {
            self.pictures.resize_with(index + 1, Vec::new);
        }
        self.pictures[index].extend_from_slice(piece);
        Ok(())
    }

    /// The pictures that the pieces make.
    ///
    /// # Errors
    /// [`ClientError::MalformedPicture`] where a picture has more or fewer bytes than it says.
    pub fn assemble(self, captured: CaptureInfo) -> Result<Capture, ClientError> {
        let CaptureInfo { frame, pictures, missing } = captured;
        if self.pictures.len() > pictures.len() {
            let (sent, said) = (self.pictures.len(), pictures.len());
            let reason = format!("pieces of {sent} pictures came, and {said} are described");
            return Err(ClientError::MalformedPicture { reason });
        }
        let mut capture = Capture { frame, screens: Vec::new(), channels: Vec::new(), missing };
        let bytes = self.pictures.into_iter().chain(std::iter::repeat_with(Vec::new));
        for (info, rgba) in pictures.into_iter().zip(bytes) {
            let (width, height) = (info.width, info.height);
            let expected = u64::from(width).saturating_mul(u64::from(height)).saturating_mul(4);
            if rgba.len() as u64 != expected {
                let reason = format!(
                    "{} came with {} bytes; {width} x {height} pixels have {expected}",
                    info.name,
                    rgba.len()
                );
                return Err(ClientError::MalformedPicture { reason });
            }
            let list = if info.is_screen { &mut capture.screens } else { &mut capture.channels };
            list.push(Image { name: info.name, width, height, rgba });
        }
        Ok(capture)
    }
}

#[cfg(test)]
mod tests {
    use polyptych_protocol::request::ImageInfo;

    use super::*;

    fn captured(sizes: &[(bool, u32, u32)]) -> CaptureInfo {
        let pictures = sizes.iter().enumerate().map(|(i, &(is_screen, width, height))| ImageInfo {
            name: format!("p{i}"),
            is_screen,
            width,
            height,
        });
        CaptureInfo { frame: FrameId(7), pictures: pictures.collect(), missing: Vec::new() }
    }

    #[test]
    fn pieces_of_several_pictures_may_be_mixed() {
        let mut parts = ImageAssembler::new(100);
        for (index, piece) in [(1, [5; 4]), (0, [1; 4]), (1, [6; 4]), (0, [2; 4])] {
            parts.add(index, &piece).expect("taken");
        }
        let said = captured(&[(true, 2, 1), (false, 1, 2), (false, 0, 9)]);
        let capture = parts.assemble(said).expect("whole");
        assert_eq!(capture.screens[0].rgba, [1, 1, 1, 1, 2, 2, 2, 2]);
        assert_eq!(capture.channels[0].rgba, [5, 5, 5, 5, 6, 6, 6, 6]);
        assert!(capture.channels[1].rgba.is_empty());
        assert_eq!(format!("{:?}", capture.screens[0]), "Picture(p0, 2 x 1, 8 bytes)");
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let check = |pieces: &[(u32, usize)], said: CaptureInfo, expected: &str| {
            let mut parts = ImageAssembler::new(100);
            let taken = pieces.iter().try_for_each(|&(i, len)| parts.add(i, &vec![0; len]));
            let error = taken.and_then(|()| parts.assemble(said)).expect_err("refused");
            assert!(error.to_string().contains(expected), "{error}");
        };
        check(&[(0, 7)], captured(&[(true, 2, 1)]), "7 bytes; 2 x 1 pixels have 8");
        check(&[(0, 8), (1, 4)], captured(&[(true, 2, 1)]), "pieces of 2 pictures came");
        check(&[(0, 60), (1, 41)], captured(&[]), "more than 100 bytes");
        check(&[(u32::MAX, 1)], captured(&[]), "of at most 1280");
        check(&[], captured(&[(true, u32::MAX, u32::MAX)]), "0 bytes");
    }
}
