//! Vertices and indices on the GPU.

use std::borrow::Cow;
use std::sync::Arc;

use polyptych_scene::{IndexFormat, Primitive};

use super::bent_vertices::BentVertices;
use super::meshlet::Meshlets;
use super::triangle_order::TriangleOrder;
use crate::gpu::Gpu;

/// Vertices, and the indices that are drawn of them.
#[derive(Clone, Debug)]
pub(crate) struct Geometry {
    pub vertices: wgpu::Buffer,
    /// Bytes of the vertices, which come first in their buffer.
    pub vertex_bytes: u64,
    /// The buffer of the vertices, or another one.
    pub indices: wgpu::Buffer,
    /// The place of the first index in their buffer, in bytes.
    pub first_index_byte: u64,
    /// Those of its finest level; indices of coarser levels follow them.
    pub index_count: u32,
    pub index_format: wgpu::IndexFormat,
    /// `None` where it is always drawn whole.
    pub meshlets: Option<Arc<Meshlets>>,
    /// The vertices as clips bend them, if they do.
    pub bent: Option<Arc<BentVertices>>,
    /// Its triangles, if it is blended and their order can be seen.
    pub order: Option<Arc<TriangleOrder>>,
}

impl Geometry {
    /// Copies the vertices and indices of checked bytes to the GPU.
    pub fn upload(
        gpu: &Gpu,
        desc: &Primitive,
        bytes: &[u8],
        meshlets: Option<Meshlets>,
    ) -> Result<Self, String> {
        let (vertices, rest) = bytes.split_at(desc.vertex_bytes() as usize);
        let index_bytes = (desc.geometry_bytes() - desc.vertex_bytes()) as usize;
        let index_width = index_bytes / desc.index_count_of_all().max(1) as usize;
        let in_blob = &rest[..index_bytes];
        let indices = meshlets.as_ref().map_or(Cow::Borrowed(in_blob), |meshlets| {
            meshlets.in_draw_order(in_blob, index_width)
        });
        let rewritten = match desc.deformed {
            Some(_) => wgpu::BufferUsages::COPY_DST,
            None => wgpu::BufferUsages::empty(),
        };
        let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("geometry/buffer"),
            // An odd number of short indices ends between two multiples of 4.
            size: desc.geometry_bytes().next_multiple_of(wgpu::COPY_BUFFER_ALIGNMENT),
            usage: wgpu::BufferUsages::VERTEX | wgpu::BufferUsages::INDEX | rewritten,
            mapped_at_creation: true,
        });
        {
            let mut view = buffer.get_mapped_range_mut(..).map_err(|error| error.to_string())?;
            view.slice(..vertices.len()).copy_from_slice(vertices);
            let end = vertices.len() + indices.len();
            view.slice(vertices.len()..end).copy_from_slice(&indices);
        }
        buffer.unmap();
        let index_format = if desc.index_format == IndexFormat::U32 {
            wgpu::IndexFormat::Uint32
        } else {
            wgpu::IndexFormat::Uint16
        };
        let (vertex_bytes, index_count) = (desc.vertex_bytes(), desc.index_count);
        Ok(Self {
            vertices: buffer.clone(),
            vertex_bytes,
            indices: buffer,
            first_index_byte: vertex_bytes,
            index_count,
            index_format,
            meshlets: meshlets.map(Arc::new),
            bent: None,
            order: None,
        })
    }

    /// Returns it to be blended: with its triangles if their order can be seen.
    pub fn blended(&self, desc: &Primitive, bytes: &[u8]) -> Self {
        let (vertices, rest) = bytes.split_at(desc.vertex_bytes() as usize);
        let indices = &rest[..(desc.geometry_bytes() - desc.vertex_bytes()) as usize];
        let width = indices.len() / desc.index_count_of_all().max(1) as usize;
        let indices = self
            .meshlets
            .as_ref()
            .map_or(Cow::Borrowed(indices), |meshlets| meshlets.in_draw_order(indices, width));
        let order = TriangleOrder::new(desc, vertices, &indices).map(Arc::new);
        Self { order, ..self.clone() }
    }

    /// These vertices with other indices, which are drawn whole.
    ///
    /// # Errors
    /// They take more bytes than a buffer of this GPU has.
    pub fn with_indices(&self, gpu: &Gpu, indices: &[u32]) -> Result<Self, String> {
        // A buffer has at least one element.
        let size = size_of_val(indices).max(size_of::<u32>()) as u64;
        let bytes_max = gpu.device.limits().max_buffer_size;
        if size > bytes_max {
            return Err(format!("its edges or points take {size} bytes, where {bytes_max} can be"));
        }
        let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("geometry/outline"),
            size,
            usage: wgpu::BufferUsages::INDEX | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        gpu.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(indices));
        Ok(Self {
            indices: buffer,
            first_index_byte: 0,
            index_count: indices.len() as u32,
            index_format: wgpu::IndexFormat::Uint32,
            meshlets: None,
            ..self.clone()
        })
    }
}

/// The largest index of all levels in the bytes, where it points beyond the vertices.
pub(crate) fn index_beyond(desc: &Primitive, bytes: &[u8]) -> Option<u32> {
    let indices = bytes.get(desc.vertex_bytes() as usize..desc.geometry_bytes() as usize)?;
    desc.index_format.largest(indices).filter(|&index| index >= desc.vertex_count)
}
