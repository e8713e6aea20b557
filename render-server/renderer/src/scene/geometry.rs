//! Vertices and indices on the GPU.

use std::borrow::Cow;
use std::sync::Arc;

use polyptych_scene::{IndexFormat, Primitive};

use super::bent_vertices::BentVertices;
use super::geometry_room::GeometryRoom;
use super::meshlet::Meshlets;
use super::triangle_order::TriangleOrder;
use crate::gpu::Gpu;

/// Vertices, and the indices that are drawn of them.
#[derive(Clone, Debug)]
pub(crate) struct Geometry {
    pub vertices: wgpu::Buffer,
    /// The first of them in their buffer, whose vertices all are as large.
    pub first_vertex: u32,
    pub indices: wgpu::Buffer,
    /// The first of them in their buffer, whose indices all have one format.
    pub first_index: u32,
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
    pub(super) fn upload(
        gpu: &Gpu,
        desc: &Primitive,
        (bytes, room): (&[u8], &mut GeometryRoom),
        meshlets: Option<Meshlets>,
    ) -> Self {
        let (vertices, rest) = bytes.split_at(desc.vertex_bytes() as usize);
        let index_bytes = (desc.geometry_bytes() - desc.vertex_bytes()) as usize;
        let index_width = index_bytes / desc.index_count_of_all().max(1) as usize;
        let in_blob = &rest[..index_bytes];
        let indices = meshlets.as_ref().map_or(Cow::Borrowed(in_blob), |meshlets| {
            meshlets.in_draw_order(in_blob, index_width)
        });
        let [vertex_place, index_place] = room.places(gpu, desc);
        vertex_place.write(gpu, vertices);
        index_place.write(gpu, &indices);
        let index_format = if desc.index_format == IndexFormat::U32 {
            wgpu::IndexFormat::Uint32
        } else {
            wgpu::IndexFormat::Uint16
        };
        let first = |byte: u64, size: u64| (byte / size) as u32;
        Self {
            first_vertex: first(vertex_place.first_byte, desc.layout.stride().into()),
            vertices: vertex_place.buffer,
            first_index: first(index_place.first_byte, index_format.byte_size() as u64),
            indices: index_place.buffer,
            index_count: desc.index_count,
            index_format,
            meshlets: meshlets.map(Arc::new),
            bent: None,
            order: None,
        }
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
            first_index: 0,
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
