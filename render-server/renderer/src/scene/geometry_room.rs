//! Room on the GPU for the vertices and indices of geometries.
//!
//! Geometries share buffers, so that one command can draw many of them: a GPU takes longer to turn
//! to another buffer than to draw a small mesh. A shared buffer lives as long as anything in it.

use std::collections::HashMap;

use polyptych_scene::{IndexFormat, Primitive};

use crate::gpu::Gpu;

/// Bytes of a shared buffer at most.
const SHARED_BYTES_MAX: u64 = 64 << 20;

/// Vertices or indices of more bytes have a buffer of their own: what they do not fit into any more
/// would stay empty, so that buffers took up to twice what is in them, and not an eighth more.
const SHARING_BYTES_MAX: u64 = SHARED_BYTES_MAX / 8;

/// The content of a buffer: elements of one size, so that each geometry begins at a whole number of
/// them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Elements {
    /// Vertices of so many bytes.
    Vertices(u32),
    Indices(IndexFormat),
}

/// A place in a buffer.
#[derive(Clone, Debug)]
pub(super) struct Place {
    pub buffer: wgpu::Buffer,
    pub first_byte: u64,
}

/// A buffer that is being filled.
#[derive(Debug)]
struct OpenBuffer {
    buffer: wgpu::Buffer,
    used: u64,
}

/// Room for the geometries of one scene.
#[derive(Debug)]
pub(super) enum GeometryRoom {
    /// In buffers that they share.
    Shared(SharedRoom),
    /// In a buffer for each, for scenes of which parts come and go.
    Separate,
}

/// Buffers that geometries share.
#[derive(Debug, Default)]
pub(super) struct SharedRoom {
    open: HashMap<Elements, OpenBuffer>,
    /// Bytes that will be asked for of what shares: no buffer is larger.
    to_come: HashMap<Elements, u64>,
}

impl SharedRoom {
    /// Room for these geometries.
    pub fn new<'a>(geometries: impl Iterator<Item = &'a Primitive>) -> Self {
        let mut to_come = HashMap::new();
        for of in geometries {
            for (elements, bytes) in elements_of(of) {
                if padded(bytes) <= SHARING_BYTES_MAX {
                    *to_come.entry(elements).or_default() += padded(bytes);
                }
            }
        }
        Self { open: HashMap::new(), to_come }
    }

    fn place(&mut self, gpu: &Gpu, (elements, bytes): (Elements, u64)) -> Place {
        let bytes = padded(bytes);
        if bytes > SHARING_BYTES_MAX {
            return Place { buffer: buffer(gpu, bytes), first_byte: 0 };
        }
        let to_come = self.to_come.entry(elements).or_default();
        let size_max = SHARED_BYTES_MAX.min(gpu.device.limits().max_buffer_size).min(*to_come);
        *to_come = to_come.saturating_sub(bytes);
        let fits = |open: &OpenBuffer| open.buffer.size() - open.used >= bytes;
        let open = self.open.remove(&elements).filter(fits);
        let mut open = open
            .unwrap_or_else(|| OpenBuffer { buffer: buffer(gpu, size_max.max(bytes)), used: 0 });
        let place = Place { buffer: open.buffer.clone(), first_byte: open.used };
        open.used += bytes;
        self.open.insert(elements, open);
        place
    }
}

impl GeometryRoom {
    /// Makes room for the vertices and for the indices of a geometry.
    pub fn places(&mut self, gpu: &Gpu, desc: &Primitive) -> [Place; 2] {
        let [vertices, indices] = elements_of(desc);
        match self {
            Self::Shared(room) => [room.place(gpu, vertices), room.place(gpu, indices)],
            Self::Separate => {
                let buffer = buffer(gpu, padded(vertices.1) + padded(indices.1));
                let first_byte = padded(vertices.1);
                [Place { buffer: buffer.clone(), first_byte: 0 }, Place { buffer, first_byte }]
            }
        }
    }
}

impl Place {
    /// Writes its bytes.
    pub fn write(&self, gpu: &Gpu, bytes: &[u8]) {
        let whole = bytes.len() & !(wgpu::COPY_BUFFER_ALIGNMENT as usize - 1);
        let (bytes, rest) = bytes.split_at(whole);
        gpu.queue.write_buffer(&self.buffer, self.first_byte, bytes);
        if !rest.is_empty() {
            // An odd number of short indices ends between two multiples of 4.
            let mut last = [0; wgpu::COPY_BUFFER_ALIGNMENT as usize];
            last[..rest.len()].copy_from_slice(rest);
            gpu.queue.write_buffer(&self.buffer, self.first_byte + whole as u64, &last);
        }
    }
}

/// The vertices and the indices of a geometry, and how many bytes they take.
fn elements_of(desc: &Primitive) -> [(Elements, u64); 2] {
    let vertices = (Elements::Vertices(desc.layout.stride()), desc.vertex_bytes());
    let indices = desc.geometry_bytes() - desc.vertex_bytes();
    [vertices, (Elements::Indices(desc.index_format), indices)]
}

/// The bytes that a place takes: copies begin at multiples of 4, as all vertices do.
fn padded(bytes: u64) -> u64 {
    bytes.next_multiple_of(wgpu::COPY_BUFFER_ALIGNMENT)
}

fn buffer(gpu: &Gpu, size: u64) -> wgpu::Buffer {
    use wgpu::BufferUsages;
    gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("geometry/buffer"),
        size,
        usage: BufferUsages::VERTEX | BufferUsages::INDEX | BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec3};
    use polyptych_files::blob::BlobHash;
    use polyptych_scene::{Topology, VertexLayout};

    use super::*;

    fn vertices(vertex_count: u32) -> Primitive {
        Primitive {
            blob: BlobHash([0; 32]),
            layout: VertexLayout::default(),
            vertex_count,
            index_count: 0,
            coarser_index_count: 0,
            meshlet_count: 0,
            cuts: Vec::new(),
            finest_level: 0,
            deformed: None,
            index_format: IndexFormat::U32,
            topology: Topology::Triangles,
            material: None,
            origin: DVec3::ZERO,
            min: Vec3::ZERO,
            max: Vec3::ONE,
        }
    }

    #[test]
    fn a_large_geometry_takes_its_own_bytes_and_small_ones_go_on_sharing() {
        let gpu = Gpu::headless().expect("a GPU");
        let all = [100, 500_000, 200].map(vertices);
        let mut room = SharedRoom::new(all.iter());
        let [first, large, last] = all.each_ref().map(|of| room.place(&gpu, elements_of(of)[0]));
        assert_eq!(large.buffer.size(), all[1].vertex_bytes());
        assert!(first.buffer == last.buffer && first.buffer != large.buffer);
        let [before, after] = [&all[0], &all[2]].map(Primitive::vertex_bytes);
        assert_eq!((last.first_byte, last.buffer.size()), (before, before + after));
    }
}
