//! Buffers that are written once a frame.

use crate::gpu::Gpu;

/// The factor of what a frame needs that is kept for the next ones: a camera that looks away and
/// back costs nothing, and a heavy scene leaves its memory when another one is shown.
const KEPT_FACTOR: u64 = 16;

/// Bytes that are kept in any case.
const KEPT_BYTES: u64 = 1 << 20;

pub(super) fn is_too_large(bytes: u64, needed: u64) -> bool {
    bytes > KEPT_BYTES && bytes / KEPT_FACTOR > needed
}

/// A buffer that is written once a frame. It grows to twice what is needed when it is too small,
/// and shrinks to that when it is far too large.
#[derive(Debug)]
pub(super) struct FrameBuffer {
    label: &'static str,
    usage: wgpu::BufferUsages,
    buffer: Option<wgpu::Buffer>,
}

impl FrameBuffer {
    pub fn new(label: &'static str, usage: wgpu::BufferUsages) -> Self {
        Self { label, usage: usage | wgpu::BufferUsages::COPY_DST, buffer: None }
    }

    /// Writes numbers if there are any.
    pub fn write_any(&mut self, gpu: &Gpu, numbers: &[u32]) -> Option<&wgpu::Buffer> {
        (!numbers.is_empty()).then(|| self.write(gpu, bytemuck::cast_slice(numbers)))
    }

    pub fn write(&mut self, gpu: &Gpu, bytes: &[u8]) -> &wgpu::Buffer {
        let needed = bytes.len().max(4) as u64;
        let buffer = match self.buffer.take() {
            Some(buffer) if buffer.size() >= needed && !is_too_large(buffer.size(), needed) => {
                buffer
            }
            _ => gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(self.label),
                size: (needed * 2).next_multiple_of(wgpu::COPY_BUFFER_ALIGNMENT),
                usage: self.usage,
                mapped_at_creation: false,
            }),
        };
        if !bytes.is_empty() {
            gpu.queue.write_buffer(&buffer, 0, bytes);
        }
        self.buffer.insert(buffer)
    }

    /// The buffer, with the bytes that were written last; `None` before any were.
    pub fn buffer(&self) -> Option<&wgpu::Buffer> {
        self.buffer.as_ref()
    }

    /// Bytes that it holds on the GPU.
    #[cfg(test)]
    pub fn size(&self) -> u64 {
        self.buffer.as_ref().map_or(0, wgpu::Buffer::size)
    }
}
