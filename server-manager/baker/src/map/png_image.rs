//! PNG pictures of 16 bits a component, with what the file says of their gamma.

use std::io::Cursor;

use glam::UVec2;
use png::{BitDepth, ColorType, Decoder, Limits, Transformations};
use polyptych_wall::limits::CHANNEL_SIDE_MAX;

use super::super::error::BakeError;

/// Most memory that a decoder may take beside the picture.
const DECODE_BYTES_MAX: usize = 512 << 20;

/// Pictures of so many pixels are decoded however small their files are.
const PIXELS_UNASKED: u64 = 1 << 24;

/// Most pixels per byte of file beyond that: deflate reaches about 1,000 bytes per byte, of up to
/// eight pixels each.
const PIXELS_PER_BYTE_MAX: u64 = 8192;

/// A decoded picture.
#[derive(Debug)]
pub(super) struct PngImage {
    pub size: UVec2,
    /// 1 grey, 2 grey and alpha, 3 colour, 4 colour and alpha.
    pub components: usize,
    /// Bits of a component in the file, 1 to 16; fewer than 16 are spread over all of u16.
    pub bits: u8,
    /// Rows from the top.
    pub texels: Vec<u16>,
    /// The exponent of the `gAMA` chunk: stored = light^gamma. `None` means sRGB.
    pub gamma: Option<f64>,
}

/// Decodes a PNG.
pub(super) fn decode(bytes: &[u8]) -> Result<PngImage, BakeError> {
    let bad = |what: String| {
        let right = format!("a PNG of at most {CHANNEL_SIDE_MAX} × {CHANNEL_SIDE_MAX} pixels");
        BakeError::at("PNG", what, format!("{right} would be right"))
    };
    let cannot = |error: png::DecodingError| bad(format!("it can't be decoded: {error}"));
    let mut decoder =
        Decoder::new_with_limits(Cursor::new(bytes), Limits { bytes: DECODE_BYTES_MAX });
    decoder.set_transformations(Transformations::EXPAND);
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    let mut reader = decoder.read_info().map_err(cannot)?;
    let info = reader.info();
    let size = UVec2::new(info.width, info.height);
    if size.min_element() == 0 || size.max_element() > CHANNEL_SIDE_MAX {
        return Err(bad(format!("it has {} × {} pixels", size.x, size.y)));
    }
    let pixels = u64::from(size.x) * u64::from(size.y);
    if pixels > PIXELS_UNASKED && pixels / PIXELS_PER_BYTE_MAX > bytes.len() as u64 {
        let what = format!("{} bytes can't hold {} × {} pixels", bytes.len(), size.x, size.y);
        return Err(bad(what));
    }
    let bits = info.bit_depth as u8;
    // An sRGB chunk outranks a gamma that stands beside it: PNG, third edition, 4.3.
    let gamma = info.gama_chunk.map(|gamma| f64::from(gamma.into_value()));
    let gamma = gamma.or_else(|| has_zero_gamma(bytes).then_some(0.0));
    let gamma = gamma.filter(|_| info.srgb.is_none());
    if let Some(gamma) = gamma.filter(|gamma| !(0.01..=10.0).contains(gamma)) {
        return Err(bad(format!("its gAMA is {gamma}, where 0.45 is usual")));
    }
    let (color, depth) = reader.output_color_type();
    let components = match color {
        ColorType::Grayscale => 1,
        ColorType::GrayscaleAlpha => 2,
        ColorType::Rgb => 3,
        ColorType::Rgba => 4,
        ColorType::Indexed => return Err(bad("its palette can't be read".to_owned())),
    };
    let length = reader.output_buffer_size().ok_or_else(|| bad("it is too large".to_owned()))?;
    let mut raw = vec![0; length];
    let frame = reader.next_frame(&mut raw).map_err(cannot)?;
    raw.truncate(frame.buffer_size());
    let texels = match depth {
        BitDepth::Sixteen => {
            raw.chunks_exact(2).map(|two| u16::from_be_bytes([two[0], two[1]])).collect()
        }
        _ => raw.iter().map(|&byte| u16::from(byte) * 257).collect::<Vec<_>>(),
    };
    if texels.len() as u64 != pixels * components as u64 {
        return Err(bad("it ends before its last pixel".to_owned()));
    }
    Ok(PngImage { size, components, bits, texels, gamma })
}

/// Returns whether there is a `gAMA` chunk of 0 before the pixels: the decoder passes over it, and
/// the picture would be taken for sRGB.
fn has_zero_gamma(bytes: &[u8]) -> bool {
    const SIGNATURE_BYTES: usize = 8;
    const CHECKSUM_BYTES: usize = 4;
    let mut rest = bytes.get(SIGNATURE_BYTES..).unwrap_or_default();
    // Each chunk is a length, a kind, so many bytes, and a checksum.
    while let Some((length, after)) = rest.split_first_chunk::<4>()
        && let Some((kind, data)) = after.split_first_chunk::<4>()
        && kind != b"IDAT"
    {
        if kind == b"gAMA" {
            return data.first_chunk() == Some(&[0; 4]);
        }
        let length = u32::from_be_bytes(*length) as usize;
        rest = data.get(length.saturating_add(CHECKSUM_BYTES)..).unwrap_or_default();
    }
    false
}

impl PngImage {
    /// Alpha of a pixel, where there is any.
    pub fn alpha(&self, pixel: usize) -> Option<u16> {
        let last = pixel * self.components + self.components - 1;
        self.components.is_multiple_of(2).then(|| self.texels[last])
    }
}

/// The PNG that reads back as these 16-bit values of linear light.
pub(super) fn encode_linear(
    size: UVec2,
    components: u8,
    texels: &[u16],
) -> Result<Vec<u8>, BakeError> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, size.x, size.y);
    encoder.set_color(if components == 3 { ColorType::Rgb } else { ColorType::Grayscale });
    encoder.set_depth(BitDepth::Sixteen);
    encoder.set_source_gamma(png::ScaledFloat::new(1.0));
    let bytes: Vec<u8> = texels.iter().flat_map(|texel| texel.to_be_bytes()).collect();
    let written = encoder.write_header().and_then(|mut writer| {
        writer.write_image_data(&bytes)?;
        writer.finish()
    });
    let cannot = |error| BakeError::at("PNG", format!("it can't be encoded: {error}"), "a bug");
    written.map_err(cannot)?;
    Ok(out)
}
