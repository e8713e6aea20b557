//! Vertices that clips bend: computed on the processor, in f64, and written where the GPU reads.
//!
//! On the processor, since so all displays have the same bits, whatever their GPUs, and all that
//! draws reads them as any vertices. Vertices that stay as they were are not written again.

use std::sync::{Mutex, PoisonError};

use glam::Vec3;
use polyptych_scene::deformation::{Deformer, Shape};

use crate::gpu::Gpu;

/// The vertices of a primitive that is bent.
#[derive(Debug)]
pub(crate) struct BentVertices {
    deformer: Deformer,
    written: Mutex<Written>,
}

/// The contents of the buffer.
#[derive(Debug, Default)]
struct Written {
    /// `None` where it is not known.
    shape: Option<Shape>,
    bounds: (Vec3, Vec3),
    floats: Vec<f32>,
}

impl BentVertices {
    pub fn new(deformer: Deformer) -> Self {
        Self { deformer, written: Mutex::default() }
    }

    /// Writes the vertices in a shape to a buffer, from this one on. Returns the box around them,
    /// in the space of their mesh.
    pub fn bend(
        &self,
        gpu: &Gpu,
        (buffer, first_vertex): (&wgpu::Buffer, u32),
        shape: &Shape,
    ) -> (Vec3, Vec3) {
        let mut written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        if written.shape.as_ref() == Some(shape) {
            return written.bounds;
        }
        self.deformer.apply(shape, &mut written.floats);
        let stride = self.deformer.layout.stride() as usize / 4;
        let positions =
            written.floats.chunks_exact(stride).map(|of| Vec3::new(of[0], of[1], of[2]));
        let around = |(min, max): (Vec3, Vec3), at: Vec3| (min.min(at), max.max(at));
        written.bounds = positions.fold((Vec3::MAX, Vec3::MIN), around);
        let first_byte = u64::from(first_vertex) * u64::from(self.deformer.layout.stride());
        gpu.queue.write_buffer(buffer, first_byte, bytemuck::cast_slice(&written.floats));
        written.shape = Some(shape.clone());
        written.bounds
    }

    /// Returns the positions of the vertices as they were written last; `None` before that.
    pub fn positions(&self) -> Option<Vec<Vec3>> {
        let written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        written.shape.as_ref()?;
        let stride = self.deformer.layout.stride() as usize / 4;
        let vertices = written.floats.chunks_exact(stride);
        Some(vertices.map(|of| Vec3::new(of[0], of[1], of[2])).collect())
    }
}
