//! Pictures of the file.

use super::ExportError;

/// The largest level of a texture, of 8-bit RGBA, as a PNG file.
pub(super) fn png(width: u32, height: u32, levels: &[u8]) -> Result<Vec<u8>, ExportError> {
    let pixels = levels.get(..width as usize * height as usize * 4).unwrap_or_default();
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, width, height);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    let written = encoder.write_header().and_then(|mut writer| {
        writer.write_image_data(pixels)?;
        writer.finish()
    });
    written.map_err(|error| ExportError::Other(format!("a texture is no picture: {error}")))?;
    Ok(file)
}

/// The sRGB value of a linear one, both from 0 to 1: IEC 61966-2-1.
pub(super) fn srgb_of_linear(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}
