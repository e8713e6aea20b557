//! A whole piece, for those who simplify parts of it.

use std::collections::HashMap;

use glam::DVec3;
use meshopt::{SimplifyVertex, VertexDataAdapter};

use super::surface::Surface;

/// A surface with what the simplifier asks of it.
#[derive(Debug)]
pub(super) struct Source<'a> {
    pub surface: Surface<'a>,
    /// The positions times a power of two, which makes the largest coordinate about 1: exact, and
    /// far from where f32 ends.
    pub scaled: Vec<[f32; 3]>,
    /// The first vertex at the position of each.
    pub welded: Vec<u32>,
    /// `true` for each vertex at a seam: another at its position has other texture coordinates.
    pub seams: Vec<bool>,
}

impl<'a> Source<'a> {
    /// Looks at a whole surface.
    pub fn new(surface: Surface<'a>) -> Self {
        let vertices = 0..surface.vertex_count() as u32;
        let magnitude = vertices.clone().map(|vertex| surface.position(vertex).abs().max_element());
        let magnitude = magnitude.fold(0.0, f64::max);
        let factor = if magnitude > 0.0 { (-magnitude.log2().floor()).exp2() } else { 1.0 };
        let scaled = |vertex| (surface.position(vertex) * factor).as_vec3().to_array();
        let scaled: Vec<[f32; 3]> = vertices.clone().map(scaled).collect();
        // By the positions as they are: two that only the factor made one remain two.
        let mut first_at = HashMap::with_capacity(scaled.len());
        let weld = |vertex| {
            // Adding zero makes -0 and 0 one.
            let position = (surface.position(vertex) + DVec3::ZERO).to_array().map(f64::to_bits);
            *first_at.entry(position).or_insert(vertex)
        };
        let welded: Vec<u32> = vertices.clone().map(weld).collect();
        let mut is_at_seam = vec![false; welded.len()];
        for vertex in vertices.clone() {
            let first = welded[vertex as usize];
            let differs = |offset| surface.uv(vertex, offset) != surface.uv(first, offset);
            is_at_seam[first as usize] |= surface.uv_offsets().any(differs);
        }
        let seams = welded.iter().map(|first| is_at_seam[*first as usize]).collect();
        Self { surface, scaled, welded, seams }
    }

    /// Returns the scaled positions as meshoptimizer takes them.
    pub fn adapter(&self) -> Option<VertexDataAdapter<'_>> {
        adapter(&self.scaled)
    }

    /// Returns the flags of a vertex for the simplifier.
    pub fn flags(&self, vertex: u32, is_locked: bool) -> SimplifyVertex {
        let vertex = vertex as usize;
        let lock = is_locked || self.surface.is_locked[vertex];
        let seam = if self.seams[vertex] { SimplifyVertex::Protect } else { SimplifyVertex::None };
        if lock { seam | SimplifyVertex::Lock } else { seam }
    }
}

/// Returns positions as meshoptimizer takes them.
pub(super) fn adapter(positions: &[[f32; 3]]) -> Option<VertexDataAdapter<'_>> {
    VertexDataAdapter::new(meshopt::typed_to_bytes(positions), size_of::<[f32; 3]>(), 0).ok()
}
