//! Pictures in KTX2 files of Basis Universal: `KHR_texture_basisu`.

use basisu::{DecodeFlags, TargetFormat, Transcoder};

use super::mip::Rgba8Image;

/// The first bytes of every KTX2 file (KTX 2.0, 3.1).
const MAGIC: &[u8] = b"\xabKTX 20\xbb\r\n\x1a\n";

/// The place of the width in such a file, after the format and the size of its elements; the
/// height follows.
const WIDTH_AT: usize = 20;

/// Returns whether these are the first bytes of a KTX2 file.
pub(super) fn is_ktx2(encoded: &[u8]) -> bool {
    encoded.starts_with(MAGIC)
}

/// The width and height of a KTX2 file, as its head says.
pub(super) fn size(encoded: &[u8]) -> Option<[u32; 2]> {
    let word = |at: usize| {
        let bytes = encoded.get(at..at + 4)?;
        bytes.try_into().ok().map(u32::from_le_bytes)
    };
    Some([word(WIDTH_AT)?, word(WIDTH_AT + 4)?])
}

/// Decodes the largest picture of a file whose size was checked.
pub(super) fn decode(encoded: &[u8]) -> Result<Rgba8Image, String> {
    const RIGHT: &str = "KTX2 of Basis Universal, a PNG or JPEG would be right";
    let cannot = |error: basisu::Error| format!("it is KTX2 that can't be decoded: {error:?}");
    let file = Transcoder::new(encoded).map_err(|error| match error {
        basisu::Error::InvalidData => format!("it is KTX2, but not Basis Universal; {RIGHT}"),
        error => format!("{}; {RIGHT}", cannot(error)),
    })?;
    let (width, height) = file.base_dimensions();
    let rgba = file.transcode(0, TargetFormat::Rgba32, DecodeFlags::NONE);
    let rgba = rgba.map_err(|error| format!("{}; {RIGHT}", cannot(error)))?;
    let wanted = u64::from(width) * u64::from(height) * 4;
    if rgba.len() as u64 != wanted {
        return Err(format!("it is KTX2 of {} bytes where {wanted} are said; {RIGHT}", rgba.len()));
    }
    Ok(Rgba8Image { width, height, rgba })
}
