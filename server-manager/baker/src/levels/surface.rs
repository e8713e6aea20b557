//! The vertices and triangles of one piece, as its blob holds them.

use glam::{DVec2, DVec3, DVec4};
use polyptych_scene::VertexLayout;

/// A list of triangles over vertices, and what must not be changed of it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Surface<'a> {
    /// The attributes of each vertex.
    pub layout: VertexLayout,
    /// The vertices, each of `layout.stride()` bytes; all finite.
    pub vertices: &'a [f32],
    /// Three for each triangle; all name a vertex.
    pub indices: &'a [u32],
    /// `true` if the triangles of a level are drawn in the order of `indices`.
    pub keeps_order: bool,
    /// Vertices that stay in all levels.
    pub locked: &'a [u32],
}

impl Surface<'_> {
    /// Returns the number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.vertices.len() / self.stride()
    }

    /// Gives the bits of each vertex's position, those of 0 for -0.
    pub fn position_bits(&self) -> impl Iterator<Item = [u32; 3]> {
        let rows = self.vertices.chunks_exact(self.stride());
        rows.map(|row| [row[0], row[1], row[2]].map(|number| (number + 0.0).to_bits()))
    }

    fn stride(&self) -> usize {
        self.layout.stride() as usize / 4
    }
}

/// A vertex as its blob holds it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct VertexRow<'a> {
    pub layout: VertexLayout,
    /// The numbers, in the order of `layout`.
    pub floats: &'a [f32],
}

impl<'a> VertexRow<'a> {
    /// Returns the position, in the primitive's space.
    pub fn position(self) -> DVec3 {
        DVec3::new(self.floats[0].into(), self.floats[1].into(), self.floats[2].into())
    }

    /// Returns the normal, of unit length.
    pub fn normal(self) -> DVec3 {
        DVec3::new(self.floats[3].into(), self.floats[4].into(), self.floats[5].into())
    }

    /// Returns the tangent, with the side of the bitangent in w, if there is one.
    pub fn tangent(self) -> Option<DVec4> {
        let first = VertexLayout::TANGENT_OFFSET as usize / 4;
        let number = |axis: usize| f64::from(self.floats[first + axis]);
        self.layout.tangent.then(|| DVec4::from_array([0, 1, 2, 3].map(number)))
    }

    /// Returns the texture coordinates of each of two sets; zero for one that is missing.
    pub fn uvs(self) -> [DVec2; 2] {
        let set = |at: Option<usize>| {
            at.map_or(DVec2::ZERO, |at| {
                DVec2::new(self.floats[at].into(), self.floats[at + 1].into())
            })
        };
        uv_places(self.layout).map(set)
    }

    /// Returns the linear RGBA, if there is one.
    pub fn color(self) -> Option<&'a [f32]> {
        let offset = self.layout.color_offset() as usize / 4;
        self.layout.color.then(|| &self.floats[offset..offset + 4])
    }
}

/// Returns the first number of each of two sets of texture coordinates in a vertex that has them.
pub(super) fn uv_places(layout: VertexLayout) -> [Option<usize>; 2] {
    let first = layout.uv0.then_some(layout.uv0_offset() as usize / 4);
    [first, layout.uv1.then_some(layout.uv1_offset() as usize / 4)]
}
