//! Planes that show triangles of their own: each has its eye, and its part of the indices.

use std::ops::Range;
use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use wgpu::util::DeviceExt;

use super::{CorrectionMesh, PlaneRecord, row};
use crate::correction::EyeAtlas;
use crate::gpu::Gpu;

/// The triangles of each plane.
pub(super) type Triangles = Arc<Vec<Vec<u32>>>;

/// Twin of `Cell` in `correct.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(crate) struct CellRecord {
    pub position: [f32; 4],
    pub across: [f32; 4],
    pub down: [f32; 4],
    pub depth: [f32; 4],
}

/// Indices on the GPU, part by part.
#[derive(Clone, Debug)]
pub(super) struct Parts {
    pub indices: wgpu::Buffer,
    pub ranges: Vec<Range<u32>>,
}

impl Parts {
    /// One part of all.
    pub fn whole(gpu: &Gpu, indices: &[u32]) -> Self {
        Self::new(gpu, indices, std::iter::once(0..indices.len() as u32).collect())
    }

    fn new(gpu: &Gpu, indices: &[u32], ranges: Vec<Range<u32>>) -> Self {
        let indices = gpu.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some("correct/indices"),
            contents: bytemuck::cast_slice(indices),
            usage: wgpu::BufferUsages::INDEX,
        });
        Self { indices, ranges }
    }
}

impl CorrectionMesh {
    /// Returns the parts to draw for these eyes: one for each plane with triangles of its own, or
    /// all of the mesh. Parts stay on the GPU until the eyes' planes have other triangles.
    pub(super) fn parts(&self, gpu: &Gpu, eyes: &[EyeAtlas]) -> Parts {
        let Some(owned) = eyes.first().and_then(|eye| eye.triangles.as_ref()) else {
            return self.whole.clone();
        };
        if let Some((of, parts)) = &*self.known.borrow()
            && Arc::ptr_eq(of, owned)
        {
            return parts.clone();
        }
        let (mut indices, mut ranges) = (Vec::new(), Vec::with_capacity(owned.len()));
        for triangles in owned.iter() {
            let begin = indices.len() as u32;
            let corners = triangles.iter().filter_map(|at| self.triangles.get(*at as usize));
            indices.extend(corners.flatten());
            ranges.push(begin..indices.len() as u32);
        }
        let parts = Parts::new(gpu, &indices, ranges);
        *self.known.borrow_mut() = Some((Arc::clone(owned), parts.clone()));
        parts
    }
}

/// The planes of all eyes that have triangles of their own; without such, one that nobody reads.
pub(super) fn records(gpu: &Gpu, eyes: &[EyeAtlas], origin_in_display: DVec3) -> wgpu::Buffer {
    let planes = eyes.iter().filter(|eye| eye.triangles.is_some()).flat_map(|eye| &eye.planes);
    let record = |plane: &crate::AtlasViewDesc| {
        let PlaneRecord { across, down, depth, .. } = plane.record(false);
        let position = row((plane.eye_in_display - origin_in_display).extend(0.0));
        CellRecord { position, across, down, depth }
    };
    let mut records: Vec<CellRecord> = planes.map(record).collect();
    if records.is_empty() {
        records.push(CellRecord::default());
    }
    gpu.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
        label: Some("correct/cells"),
        contents: bytemuck::cast_slice(&records),
        usage: wgpu::BufferUsages::STORAGE,
    })
}
