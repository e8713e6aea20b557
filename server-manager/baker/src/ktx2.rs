//! Pictures in KTX2 files: of Basis Universal (`KHR_texture_basisu`), and of plain bytes, as they
//! are, with Zstandard or with zlib. Khronos, "KTX File Format Specification", version 2.0.

use basisu::{DecodeFlags, TargetFormat, Transcoder};
use ruzstd::FrameDecoder;

use super::mip::Rgba8Image;

/// The first bytes of every KTX2 file (KTX 2.0, 3.1).
const MAGIC: &[u8] = b"\xabKTX 20\xbb\r\n\x1a\n";

/// Places of numbers in such a file, of 32 bits each; the height follows the width.
const FORMAT_AT: usize = 12;
const WIDTH_AT: usize = 20;
const SUPERCOMPRESSION_AT: usize = 44;

/// The place of the offset and the length of the largest picture, of 64 bits each.
const LEVEL_AT: usize = 80;

/// The remedy that notes name: a format that is read.
const RIGHT: &str = "KTX2 of Basis Universal or of 8 bits a channel, a PNG or JPEG would be right";

/// Returns whether these are the first bytes of a KTX2 file.
pub(super) fn is_ktx2(encoded: &[u8]) -> bool {
    encoded.starts_with(MAGIC)
}

/// The width and height of a KTX2 file, as its head says.
pub(super) fn size(encoded: &[u8]) -> Option<[u32; 2]> {
    Some([word(encoded, WIDTH_AT)?, word(encoded, WIDTH_AT + 4)?])
}

fn word(encoded: &[u8], at: usize) -> Option<u32> {
    encoded.get(at..at + 4)?.try_into().ok().map(u32::from_le_bytes)
}

fn long_word(encoded: &[u8], at: usize) -> Option<usize> {
    let bytes = encoded.get(at..at + 8)?.try_into().ok()?;
    usize::try_from(u64::from_le_bytes(bytes)).ok()
}

/// Decodes the largest picture of a file whose size was checked.
pub(super) fn decode(encoded: &[u8]) -> Result<Rgba8Image, String> {
    match word(encoded, FORMAT_AT) {
        // Undefined: the blocks of Basis Universal have no format of Vulkan.
        None | Some(0) => decode_basis(encoded),
        Some(format) => {
            let channels = Channels::of_format(format).ok_or_else(|| {
                format!("it is KTX2 of Vulkan's format {format}, which is not read; {RIGHT}")
            })?;
            decode_plain(encoded, channels).map_err(|what| format!("it is KTX2 {what}; {RIGHT}"))
        }
    }
}

/// The bytes of a pixel.
#[derive(Clone, Copy)]
struct Channels {
    count: usize,
    /// Blue comes first, not red.
    is_reversed: bool,
}

impl Channels {
    /// The channels of a format of 8 bits each (`VkFormat`), unsigned and normalised, linear or
    /// sRGB.
    fn of_format(format: u32) -> Option<Self> {
        let (count, is_reversed) = match format {
            9 | 15 => (1, false),
            16 | 22 => (2, false),
            23 | 29 => (3, false),
            30 | 36 => (3, true),
            37 | 43 => (4, false),
            44 | 50 => (4, true),
            _ => return None,
        };
        Some(Self { count, is_reversed })
    }

    /// The pixel of such bytes, as a GPU reads it: black where there is no channel, and opaque.
    fn pixel(self, bytes: &[u8]) -> [u8; 4] {
        let mut pixel = [0, 0, 0, u8::MAX];
        pixel[..self.count].copy_from_slice(bytes);
        if self.is_reversed {
            pixel.swap(0, 2);
        }
        pixel
    }
}

/// Decodes plain pixels. An error says what is wrong with the file.
fn decode_plain(encoded: &[u8], channels: Channels) -> Result<Rgba8Image, String> {
    const CUT: &str = "that is cut off";
    let [width, height] = size(encoded).ok_or(CUT)?;
    let scheme = word(encoded, SUPERCOMPRESSION_AT).ok_or(CUT)?;
    let start = long_word(encoded, LEVEL_AT).ok_or(CUT)?;
    let length = long_word(encoded, LEVEL_AT + 8).ok_or(CUT)?;
    let end = start.checked_add(length).ok_or(CUT)?;
    let level = encoded.get(start..end).ok_or(CUT)?;
    let pixels = (width as usize).checked_mul(height as usize).ok_or(CUT)?;
    let wanted = pixels.checked_mul(channels.count).ok_or(CUT)?;
    let bytes = match scheme {
        0 => level.to_vec(),
        2 => {
            let mut bytes = vec![0; wanted];
            let read = FrameDecoder::new().decode_all(level, &mut bytes);
            let read = read.map_err(|error| format!("whose Zstandard is broken: {error}"))?;
            bytes.truncate(read);
            bytes
        }
        3 => fdeflate::decompress_to_vec_bounded(level, wanted)
            .map_err(|_| "whose zlib is broken".to_owned())?,
        other => return Err(format!("of the supercompression {other}, which is not read")),
    };
    // Further layers, faces and slices of a depth follow the picture.
    let bytes = bytes.get(..wanted).ok_or_else(|| {
        format!("of {} bytes where {width} × {height} pixels take {wanted}", bytes.len())
    })?;
    let rgba = bytes.chunks_exact(channels.count).flat_map(|of| channels.pixel(of)).collect();
    Ok(Rgba8Image { width, height, rgba })
}

fn decode_basis(encoded: &[u8]) -> Result<Rgba8Image, String> {
    let cannot = |error: basisu::Error| format!("it is KTX2 that can't be decoded: {error:?}");
    let file = Transcoder::new(encoded).map_err(|error| match error {
        basisu::Error::InvalidData => format!("it is KTX2 that can't be read; {RIGHT}"),
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
