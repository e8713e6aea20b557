//! Vertices and indices on the GPU.

use polyptych_scene::{IndexFormat, Primitive};

use super::meshlet::{Meshlet, meshlets};
use crate::gpu::Gpu;

/// One buffer that holds the vertices and, behind them, the indices.
#[derive(Clone, Debug)]
pub(crate) struct Geometry {
    pub buffer: wgpu::Buffer,
    /// Where the indices begin.
    pub vertex_bytes: u64,
    pub index_count: u32,
    pub index_format: wgpu::IndexFormat,
    /// Empty where it is always drawn whole.
    pub clusters: Vec<Meshlet>,
}

impl Geometry {
    /// Copies checked bytes to the GPU.
    pub fn upload(gpu: &Gpu, desc: &Primitive, bytes: &[u8]) -> Result<Self, String> {
        let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("geometry/buffer"),
            // An odd number of short indices ends between two multiples of 4.
            size: desc.bytes().next_multiple_of(wgpu::COPY_BUFFER_ALIGNMENT),
            usage: wgpu::BufferUsages::VERTEX | wgpu::BufferUsages::INDEX,
            mapped_at_creation: true,
        });
        {
            let mut view = buffer.get_mapped_range_mut(..).map_err(|error| error.to_string())?;
            view.slice(..bytes.len()).copy_from_slice(bytes);
        }
        buffer.unmap();
        let index_format = if desc.index_format == IndexFormat::U32 {
            wgpu::IndexFormat::Uint32
        } else {
            wgpu::IndexFormat::Uint16
        };
        let (vertex_bytes, index_count) = (desc.vertex_bytes(), desc.index_count);
        let clusters = meshlets(desc, bytes);
        Ok(Self { buffer, vertex_bytes, index_count, index_format, clusters })
    }
}

/// The largest index in the bytes, where it points beyond the vertices.
pub(crate) fn index_beyond(desc: &Primitive, bytes: &[u8]) -> Option<u32> {
    let indices = bytes.get(desc.vertex_bytes() as usize..)?;
    let largest = if desc.index_format == IndexFormat::U32 {
        let (words, _) = indices.as_chunks::<4>();
        words.iter().map(|word| u32::from_le_bytes(*word)).max()
    } else {
        let (words, _) = indices.as_chunks::<2>();
        words.iter().map(|word| u32::from(u16::from_le_bytes(*word))).max()
    };
    largest.filter(|&index| index >= desc.vertex_count)
}
