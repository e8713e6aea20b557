//! The data that all parts of a mesh share while its levels are made.

use foldhash::{HashMap, HashMapExt};
use glam::{DVec2, DVec3, DVec4};
use meshopt::VertexDataAdapter;

use super::clustering::MovedVertex;
use super::surface::{Surface, VertexRow, uv_places};

/// Tangents are alike if the cosine between them is at least this: that of 60°.
const TANGENT_COSINE_MIN: f64 = 0.5;

/// The vertices of the surfaces of a mesh, which are numbered one after another, and behind them
/// those that only coarser levels have.
#[derive(Clone, Debug)]
pub(super) struct Source<'a> {
    surfaces: &'a [Surface<'a>],
    /// `true` for a part, which has none of the surfaces' own vertices in their place.
    is_part: bool,
    /// Vertices behind those of each surface, as its blob holds them.
    added: Vec<Vec<f32>>,
    /// The surface of each vertex.
    surface_of: Vec<u32>,
    /// The number of each vertex in its surface.
    row_of: Vec<u32>,
    /// The positions times a power of two, which makes the largest coordinate about 1: exact, and
    /// far from where f32 ends.
    pub scaled: Vec<[f32; 3]>,
    /// The first vertex at the position of each.
    pub welded: Vec<u32>,
}

impl<'a> Source<'a> {
    /// Looks at all surfaces of a mesh.
    pub fn new(surfaces: &'a [Surface<'a>]) -> Self {
        let (mut surface_of, mut row_of) = (Vec::new(), Vec::new());
        for (number, surface) in (0..).zip(surfaces) {
            row_of.extend(0..surface.vertex_count() as u32);
            surface_of.resize(row_of.len(), number);
        }
        let (scaled, welded, added) = (Vec::new(), Vec::new(), vec![Vec::new(); surfaces.len()]);
        let is_part = false;
        let mut source = Self { surfaces, is_part, added, surface_of, row_of, scaled, welded };
        source.weld();
        source
    }

    /// Finds the vertices that have one position.
    fn weld(&mut self) {
        let vertices = 0..self.vertex_count() as u32;
        let magnitude = vertices.clone().map(|vertex| self.position(vertex).abs().max_element());
        let magnitude = magnitude.fold(0.0, f64::max);
        let factor = if magnitude > 0.0 { (-magnitude.log2().floor()).exp2() } else { 1.0 };
        let scaled = |vertex| (self.position(vertex) * factor).as_vec3().to_array();
        self.scaled = vertices.clone().map(scaled).collect();
        // By the positions as they are: two that only the factor made one remain two.
        let mut first_at = HashMap::with_capacity(self.scaled.len());
        let weld = |vertex| {
            // Adding zero makes -0 and 0 one.
            let position = (self.position(vertex) + DVec3::ZERO).to_array().map(f64::to_bits);
            *first_at.entry(position).or_insert(vertex)
        };
        self.welded = vertices.map(weld).collect();
    }

    /// Returns these vertices alone, numbered in the order of the list.
    pub fn part(&self, vertices: &[u32]) -> Self {
        let mut part = Self {
            surfaces: self.surfaces,
            is_part: true,
            added: vec![Vec::new(); self.surfaces.len()],
            surface_of: vertices.iter().map(|vertex| self.surface_of(*vertex)).collect(),
            row_of: Vec::with_capacity(vertices.len()),
            scaled: vertices.iter().map(|vertex| self.scaled[*vertex as usize]).collect(),
            welded: Vec::with_capacity(vertices.len()),
        };
        let mut first_at = HashMap::with_capacity(vertices.len());
        for (number, vertex) in (0..).zip(vertices) {
            let row = self.row(*vertex);
            let rows = &mut part.added[self.surface_of(*vertex) as usize];
            part.row_of.push((rows.len() / row.floats.len()) as u32);
            rows.extend_from_slice(row.floats);
            let at = self.welded[*vertex as usize];
            part.welded.push(*first_at.entry(at).or_insert(number));
        }
        part
    }

    /// Adds a vertex; returns its number.
    pub fn add(&mut self, moved: &MovedVertex) -> u32 {
        let row = self.row(moved.from);
        let mut floats = row.floats.to_vec();
        floats[..3].copy_from_slice(&self.row(moved.at).floats[..3]);
        for (at, uv) in uv_places(row.layout).into_iter().zip(moved.uvs) {
            if let Some(at) = at {
                floats[at..at + 2].copy_from_slice(&uv.as_vec2().to_array());
            }
        }
        let surface = self.surface_of(moved.from);
        let own = self.own_vertices(surface as usize).len();
        let rows = &mut self.added[surface as usize];
        self.row_of.push(((own + rows.len()) / floats.len()) as u32);
        rows.extend(floats);
        self.surface_of.push(surface);
        self.scaled.push(self.scaled[moved.at as usize]);
        self.welded.push(self.welded[moved.at as usize]);
        self.vertex_count() as u32 - 1
    }

    /// Returns the number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.surface_of.len()
    }

    /// Returns the vertices of a surface that only coarser levels have.
    pub fn added_to(&self, surface: usize) -> &[f32] {
        &self.added[surface]
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

    /// Gives the triangles of each surface in turn, as the mesh numbers vertices.
    pub fn triangles(&self) -> impl Iterator<Item = Vec<u32>> + use<'a> {
        self.surfaces.iter().scan(0_u32, |first, surface| {
            let before = *first;
            *first += surface.vertex_count() as u32;
            Some(surface.indices.iter().map(|vertex| before + vertex).collect::<Vec<u32>>())
        })
    }

    /// Returns for each vertex whether it stays in all levels, at the first one at its position.
    pub fn locked(&self) -> Vec<bool> {
        let mut locked = vec![false; self.vertex_count()];
        let mut first = 0;
        for surface in self.surfaces {
            for vertex in surface.locked {
                locked[self.welded[(first + vertex) as usize] as usize] = true;
            }
            first += surface.vertex_count() as u32;
        }
        locked
    }

    /// Returns the number of a vertex in its surface.
    pub fn vertex_in_surface(&self, vertex: u32) -> u32 {
        self.row_of[vertex as usize]
    }

    /// Returns the surface of a vertex.
    pub fn surface_of(&self, vertex: u32) -> u32 {
        self.surface_of[vertex as usize]
    }

    fn row(&self, vertex: u32) -> VertexRow<'_> {
        let surface = self.surface_of(vertex) as usize;
        let layout = self.surfaces[surface].layout;
        let stride = layout.stride() as usize / 4;
        let first = self.row_of[vertex as usize] as usize * stride;
        let own = self.own_vertices(surface);
        let floats = match first.checked_sub(own.len()) {
            None => &own[first..first + stride],
            Some(first) => &self.added[surface][first..first + stride],
        };
        VertexRow { layout, floats }
    }

    /// The vertices of a surface that stand before those of `added`.
    fn own_vertices(&self, surface: usize) -> &'a [f32] {
        if self.is_part { &[] } else { self.surfaces[surface].vertices }
    }

    /// Returns the position of a vertex.
    pub fn position(&self, vertex: u32) -> DVec3 {
        self.row(vertex).position()
    }

    /// Returns the normal of a vertex, of unit length.
    pub fn normal(&self, vertex: u32) -> DVec3 {
        self.row(vertex).normal()
    }

    /// Returns whether a texture is mirrored at one of two vertices and not at the other one, as
    /// their tangents say.
    pub fn is_mirrored(&self, one: u32, other: u32) -> bool {
        let is_left = |vertex| self.row(vertex).tangent().is_some_and(|of| of.w < 0.0);
        is_left(one) != is_left(other)
    }

    /// Returns whether two vertices have tangents of nearly one direction; `true` without tangents.
    pub fn has_tangents_alike(&self, one: u32, other: u32) -> bool {
        let [one, other] = [one, other].map(|vertex| self.row(vertex).tangent());
        let (Some(one), Some(other)) = (one, other) else { return true };
        let [one, other] = [one, other].map(DVec4::truncate);
        one.dot(other) >= TANGENT_COSINE_MIN * one.length() * other.length()
    }

    /// Returns the texture coordinates of a vertex; see [`VertexRow::uvs`].
    pub fn uvs(&self, vertex: u32) -> [DVec2; 2] {
        self.row(vertex).uvs()
    }

    /// Returns the linear RGBA of a vertex; white if it has none.
    pub fn color(&self, vertex: u32) -> [f64; 4] {
        let color: Option<[f32; 4]> = self.row(vertex).color().and_then(|of| of.try_into().ok());
        color.map_or([1.0; 4], |color| color.map(f64::from))
    }
}

/// Returns positions as meshoptimizer takes them.
pub(super) fn adapter(positions: &[[f32; 3]]) -> Option<VertexDataAdapter<'_>> {
    VertexDataAdapter::new(meshopt::typed_to_bytes(positions), size_of::<[f32; 3]>(), 0).ok()
}
