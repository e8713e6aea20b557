//! The data that all parts of a mesh share while its levels are made.

use std::collections::HashMap;

use glam::{DVec2, DVec3};
use meshopt::{SimplifyVertex, VertexDataAdapter};

use super::surface::Surface;

/// The surfaces of a mesh, whose vertices are numbered one after another, with what the simplifier
/// asks of them.
#[derive(Debug)]
pub(super) struct Source<'a> {
    surfaces: &'a [Surface<'a>],
    /// The first vertex of each surface.
    firsts: Vec<u32>,
    /// The surface of each vertex.
    surface_of: Vec<u32>,
    /// The positions times a power of two, which makes the largest coordinate about 1: exact, and
    /// far from where f32 ends.
    pub scaled: Vec<[f32; 3]>,
    /// The first vertex at the position of each.
    pub welded: Vec<u32>,
    /// `true` for each vertex at a seam: another at its position has other texture coordinates.
    seams: Vec<bool>,
    /// `true` for each vertex where surfaces meet: another surface has its position.
    borders: Vec<bool>,
}

impl<'a> Source<'a> {
    /// Looks at all surfaces of a mesh.
    pub fn new(surfaces: &'a [Surface<'a>]) -> Self {
        let (mut firsts, mut surface_of) = (Vec::new(), Vec::new());
        for (number, surface) in (0..).zip(surfaces) {
            firsts.push(surface_of.len() as u32);
            surface_of.resize(surface_of.len() + surface.vertex_count(), number);
        }
        let mut source = Self {
            surfaces,
            firsts,
            surface_of,
            scaled: Vec::new(),
            welded: Vec::new(),
            seams: Vec::new(),
            borders: Vec::new(),
        };
        source.weld();
        source
    }

    /// Finds the vertices that have one position, and what differs between them.
    fn weld(&mut self) {
        let vertices = 0..self.surface_of.len() as u32;
        let magnitude = vertices.clone().map(|vertex| self.position(vertex).abs().max_element());
        let magnitude = magnitude.fold(0.0, f64::max);
        let factor = if magnitude > 0.0 { (-magnitude.log2().floor()).exp2() } else { 1.0 };
        let scaled = |vertex| (self.position(vertex) * factor).as_vec3().to_array();
        let scaled: Vec<[f32; 3]> = vertices.clone().map(scaled).collect();
        // By the positions as they are: two that only the factor made one remain two.
        let mut first_at = HashMap::with_capacity(scaled.len());
        let weld = |vertex| {
            // Adding zero makes -0 and 0 one.
            let position = (self.position(vertex) + DVec3::ZERO).to_array().map(f64::to_bits);
            *first_at.entry(position).or_insert(vertex)
        };
        let welded: Vec<u32> = vertices.clone().map(weld).collect();
        let (mut at_seam, mut at_border) = (vec![false; scaled.len()], vec![false; scaled.len()]);
        for vertex in vertices {
            let first = welded[vertex as usize];
            let is_border = self.surface_of(vertex) != self.surface_of(first);
            at_border[first as usize] |= is_border;
            at_seam[first as usize] |= is_border || self.uvs(vertex) != self.uvs(first);
        }
        self.seams = welded.iter().map(|first| at_seam[*first as usize]).collect();
        self.borders = welded.iter().map(|first| at_border[*first as usize]).collect();
        (self.scaled, self.welded) = (scaled, welded);
    }

    /// Returns the surfaces.
    pub fn surfaces(&self) -> &'a [Surface<'a>] {
        self.surfaces
    }

    /// Returns whether the triangles of all levels are drawn in the order of the file, which then
    /// are those of one surface. A surface of several that is drawn so has no coarser levels.
    pub fn keeps_order(&self) -> bool {
        matches!(self.surfaces, [surface] if surface.keeps_order)
    }

    /// Gives the triangles of a surface, as the mesh numbers vertices.
    pub fn triangles_of(&self, surface: usize) -> Vec<u32> {
        let first = self.firsts[surface];
        self.surfaces[surface].indices.iter().map(|vertex| first + vertex).collect()
    }

    /// Returns the number of a vertex in its surface.
    pub fn vertex_in_surface(&self, vertex: u32) -> u32 {
        vertex - self.firsts[self.surface_of(vertex) as usize]
    }

    /// Returns the surface of a vertex.
    pub fn surface_of(&self, vertex: u32) -> u32 {
        self.surface_of[vertex as usize]
    }

    fn locate(&self, vertex: u32) -> (&Surface<'a>, u32) {
        let surface = &self.surfaces[self.surface_of(vertex) as usize];
        (surface, self.vertex_in_surface(vertex))
    }

    /// Returns the position of a vertex.
    pub fn position(&self, vertex: u32) -> DVec3 {
        let (surface, vertex) = self.locate(vertex);
        surface.position(vertex)
    }

    /// Returns the normal of a vertex, of unit length.
    pub fn normal(&self, vertex: u32) -> DVec3 {
        let (surface, vertex) = self.locate(vertex);
        surface.normal(vertex)
    }

    /// Returns the texture coordinates of a vertex; see [`Surface::uvs`].
    pub fn uvs(&self, vertex: u32) -> [DVec2; 2] {
        let (surface, vertex) = self.locate(vertex);
        surface.uvs(vertex)
    }

    /// Returns the linear RGBA of a vertex; white if it has none.
    pub fn color(&self, vertex: u32) -> [f64; 4] {
        let (surface, vertex) = self.locate(vertex);
        let color: Option<[f32; 4]> = surface.color(vertex).and_then(|color| color.try_into().ok());
        color.map_or([1.0; 4], |color| color.map(f64::from))
    }

    /// Returns the flags of a vertex for the simplifier. Seams of textures may be given up if
    /// nothing can be spared otherwise, borders of surfaces never.
    pub fn flags(&self, vertex: u32, is_locked: bool, keeps_seams: bool) -> SimplifyVertex {
        let vertex = vertex as usize;
        let is_protected = self.borders[vertex] || (keeps_seams && self.seams[vertex]);
        let protect = if is_protected { SimplifyVertex::Protect } else { SimplifyVertex::None };
        if is_locked { protect | SimplifyVertex::Lock } else { protect }
    }
}

/// Returns positions as meshoptimizer takes them.
pub(super) fn adapter(positions: &[[f32; 3]]) -> Option<VertexDataAdapter<'_>> {
    VertexDataAdapter::new(meshopt::typed_to_bytes(positions), size_of::<[f32; 3]>(), 0).ok()
}
