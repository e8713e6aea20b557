//! Compressed bytes of a file, unpacked before anything of them is read.
//!
//! Unpacked bytes stand in a buffer and a view of their own behind those of the file, and views,
//! accessors and primitives are made to name that, so that nothing else knows of compression.

mod draco;
mod meshopt_view;

use std::sync::atomic::AtomicBool;

use super::error::BakeError;
use super::source::GltfSource;

/// Bytes that are unpacked however small a file is: a mesh of four million vertices.
const UNPACKED_UNASKED: u64 = 256 << 20;

/// Most bytes per byte of the files beyond that. Flat grids of triangles reach about 100.
const UNPACKED_PER_BYTE_MAX: u64 = 256;

/// Most bytes that are unpacked, beside the file's own: as many as a plain file may have.
const UNPACKED_BYTES_MAX: u64 = super::source::FILE_BYTES_MAX;

/// Unpacks all that is compressed and has no uncompressed form beside it.
///
/// # Errors
/// A stream that is broken, is not as its JSON says, or unpacks to more than files of this size can
/// hold; [`BakeError::Cancelled`].
pub(super) fn unpack(source: &mut GltfSource, cancel: &AtomicBool) -> Result<(), BakeError> {
    let allowed = UNPACKED_UNASKED.saturating_add(UNPACKED_PER_BYTE_MAX * source.bytes);
    let mut room = Room { left: allowed.min(UNPACKED_BYTES_MAX) };
    meshopt_view::unpack(source, &mut room, cancel)?;
    draco::unpack(source, &mut room, cancel)
}

/// The bytes that may still be unpacked.
#[derive(Debug)]
struct Room {
    left: u64,
}

impl Room {
    fn take(&mut self, bytes: u64, place: &str) -> Result<(), BakeError> {
        self.left = self.left.checked_sub(bytes).ok_or_else(|| {
            let what = format!("it unpacks to {bytes} bytes");
            let right = format!("at most {} more can be unpacked from such files", self.left);
            BakeError::at(place, what, right)
        })?;
        Ok(())
    }
}
