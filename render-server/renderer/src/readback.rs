//! Pictures back from the GPU.

use super::gpu::{GPU_WAIT_MAX, Gpu};
use super::output_texture::{ImageEncoding, OutputTexture};
use super::target::Target;

/// Why a picture did not come back.
#[derive(Debug, thiserror::Error)]
#[error("the picture could not be read back: {0}")]
pub struct ReadError(String);

/// The finished picture: RGBA8 as sRGB, or as the target's content is, rows from the top, without
/// padding.
///
/// # Errors
/// The GPU is lost, hangs, or is out of memory.
pub fn read_pixels(gpu: &Gpu, target: &Target) -> Result<Vec<u8>, ReadError> {
    read_picture(gpu, target.picture())
}

/// Reads any picture as [`read_pixels`] does; codes of ten bits are rounded to eight.
///
/// # Errors
/// The GPU is lost, hangs, or is out of memory.
pub fn read_picture(gpu: &Gpu, picture: &OutputTexture) -> Result<Vec<u8>, ReadError> {
    let mut pixels = read_raw(gpu, picture)?;
    if picture.content() == ImageEncoding::FineCodes {
        pixels.chunks_exact_mut(4).for_each(round_fine);
    }
    Ok(pixels)
}

/// The bytes of a picture, rows from the top, without padding.
pub(crate) fn read_raw(gpu: &Gpu, picture: &OutputTexture) -> Result<Vec<u8>, ReadError> {
    read_texture(gpu, picture.texture())
}

/// The bytes of a texture of one level, rows from the top, without padding.
pub(crate) fn read_texture(gpu: &Gpu, texture: &wgpu::Texture) -> Result<Vec<u8>, ReadError> {
    // Nothing more is asked of a GPU that is lost or hangs.
    if let Some(reason) = gpu.take_error() {
        return Err(ReadError(reason));
    }
    let descriptor = wgpu::CommandEncoderDescriptor { label: Some("readback") };
    let mut encoder = gpu.device.create_command_encoder(&descriptor);
    let copy = TextureCopy::encode(gpu, &mut encoder, texture);
    gpu.queue.submit([encoder.finish()]);
    copy.read(gpu, None)
}

/// A copy of a texture of one level that the processor can read, once the GPU has made it.
#[derive(Debug)]
pub(crate) struct TextureCopy {
    buffer: wgpu::Buffer,
    row_bytes: usize,
    /// Bytes from one row to the next.
    padded: usize,
}

impl TextureCopy {
    /// Encodes the copy.
    pub fn encode(gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, texture: &wgpu::Texture) -> Self {
        let (width, height) = (texture.width(), texture.height());
        let pixel_bytes = texture.format().block_copy_size(None).unwrap_or(4);
        let row_bytes = width as usize * pixel_bytes as usize;
        let padded = row_bytes.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT as usize);
        let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("readback/buffer"),
            size: padded as u64 * u64::from(height),
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        encoder.copy_texture_to_buffer(
            texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &buffer,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(padded as u32),
                    rows_per_image: None,
                },
            },
            wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        );
        Self { buffer, row_bytes, padded }
    }

    /// Waits for the copy, which was submitted so, or for all that was submitted. Returns the bytes
    /// of its rows from the top, without padding.
    ///
    /// # Errors
    /// The GPU is lost, hangs, or is out of memory.
    pub fn read(
        &self,
        gpu: &Gpu,
        submission: Option<wgpu::SubmissionIndex>,
    ) -> Result<Vec<u8>, ReadError> {
        let (sender, receiver) = std::sync::mpsc::sync_channel(1);
        self.buffer.slice(..).map_async(wgpu::MapMode::Read, move |result| {
            // The receiver is gone only when waiting failed, which is reported there.
            let _ = sender.send(result);
        });
        let failed = |reason: &dyn std::fmt::Display| {
            ReadError(gpu.take_error().unwrap_or_else(|| reason.to_string()))
        };
        gpu.wait(submission).map_err(|fault| ReadError(fault.reason))?;
        let mapped = receiver.recv_timeout(GPU_WAIT_MAX).map_err(|error| failed(&error))?;
        mapped.map_err(|error| failed(&error))?;
        let view = self.buffer.get_mapped_range(..).map_err(|error| failed(&error))?;
        let rows = view.chunks_exact(self.padded);
        let mut pixels = Vec::with_capacity(rows.len() * self.row_bytes);
        rows.for_each(|row| pixels.extend_from_slice(&row[..self.row_bytes]));
        Ok(pixels)
    }
}

/// RGB10A2 to RGBA8, each code to the nearest.
fn round_fine(pixel: &mut [u8]) {
    let bits = pixel.iter().rev().fold(0, |bits, byte| bits << 8 | u32::from(*byte));
    for (at, byte) in pixel.iter_mut().enumerate() {
        let code = bits >> (10 * at) & 1023;
        *byte = if at == 3 { 255 } else { ((code * 255 + 511) / 1023) as u8 };
    }
}
