//! The pixels that a correction draws: a mesh on the GPU, with the uniforms of who reads it.

use std::cell::RefCell;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use polyptych_wall::warp_mesh::{WarpMesh, WarpVertex};
use wgpu::util::DeviceExt;

use super::CorrectionUniform;
use super::cells::{Parts, Triangles};
use crate::gpu::Gpu;

/// A corner of the warp mesh as the vertex stage reads it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct WarpVertexRecord {
    pixel: [f32; 2],
    /// From the mesh's origin.
    point: [f32; 3],
}

/// The pixels that a correction draws, and the points that they show of its source.
#[derive(Debug)]
pub struct CorrectionMesh {
    /// Near the mesh, so that f32 suffices from there.
    pub(super) origin_in_display: DVec3,
    pub(super) corners: wgpu::Buffer,
    /// All of it, as one part.
    pub(super) whole: Parts,
    /// The triangles of the warp mesh; empty without one.
    pub(super) triangles: Vec<[u32; 3]>,
    /// The parts that were drawn last, and of which triangles they are.
    pub(super) known: RefCell<Option<(Triangles, Parts)>>,
    pub(super) uniform: wgpu::Buffer,
}

impl CorrectionMesh {
    pub(super) fn new(gpu: &Gpu, upright: [u32; 2], warp: Option<&WarpMesh>) -> Self {
        let (corners, indices, origin_in_display) = mesh(upright, warp);
        let buffer = |label, contents: &[u8], usage| {
            let descriptor =
                wgpu::util::BufferInitDescriptor { label: Some(label), contents, usage };
            gpu.device.create_buffer_init(&descriptor)
        };
        let bytes = bytemuck::cast_slice(&corners);
        let corners = buffer("correct/corners", bytes, wgpu::BufferUsages::VERTEX);
        Self {
            origin_in_display,
            corners,
            whole: Parts::whole(gpu, &indices),
            triangles: warp.map_or_else(Vec::new, |warp| warp.triangles.clone()),
            known: RefCell::default(),
            uniform: gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("correct/uniform"),
                size: size_of::<CorrectionUniform>() as u64,
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            }),
        }
    }
}

/// Corners, indices and origin of the mesh; without one, two triangles over the picture.
fn mesh(upright: [u32; 2], warp: Option<&WarpMesh>) -> (Vec<WarpVertexRecord>, Vec<u32>, DVec3) {
    let Some(warp) = warp else {
        let [width, height] = upright.map(|side| side as f32);
        let corners = [[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]];
        let corners = corners.map(|pixel| WarpVertexRecord { pixel, point: [0.0, 0.0, -1.0] });
        return (corners.to_vec(), vec![0, 1, 2, 2, 1, 3], DVec3::ZERO);
    };
    let count = warp.vertices.len().max(1) as f64;
    let origin: DVec3 = warp.vertices.iter().map(|vertex| vertex.point / count).sum();
    let corner = |vertex: &WarpVertex| WarpVertexRecord {
        pixel: vertex.pixel.as_vec2().to_array(),
        point: (vertex.point - origin).as_vec3().to_array(),
    };
    let corners = warp.vertices.iter().map(corner).collect();
    (corners, warp.triangles.iter().flatten().copied().collect(), origin)
}
