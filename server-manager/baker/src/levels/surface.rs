//! The vertices and triangles of one piece, as its blob holds them.

use glam::{DVec2, DVec3};
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
}

impl Surface<'_> {
    /// Returns the number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.vertices.len() / self.stride()
    }

    /// Returns the position of a vertex, in the primitive's space.
    pub fn position(&self, vertex: u32) -> DVec3 {
        let row = self.row(vertex);
        DVec3::new(row[0].into(), row[1].into(), row[2].into())
    }

    /// Returns the normal of a vertex, of unit length.
    pub fn normal(&self, vertex: u32) -> DVec3 {
        let row = self.row(vertex);
        DVec3::new(row[3].into(), row[4].into(), row[5].into())
    }

    /// Returns the texture coordinates of a vertex, of each of two sets; zero for one that is
    /// missing.
    pub fn uvs(&self, vertex: u32) -> [DVec2; 2] {
        let row = self.row(vertex);
        let VertexLayout { uv0, uv1, .. } = self.layout;
        let set = |is_there: bool, bytes: u32| {
            let at = bytes as usize / 4;
            if is_there { DVec2::new(row[at].into(), row[at + 1].into()) } else { DVec2::ZERO }
        };
        [set(uv0, self.layout.uv0_offset()), set(uv1, self.layout.uv1_offset())]
    }

    /// Returns the linear RGBA of a vertex, if it has one.
    pub fn color(&self, vertex: u32) -> Option<&[f32]> {
        let offset = self.layout.color_offset() as usize / 4;
        self.layout.color.then(|| &self.row(vertex)[offset..offset + 4])
    }

    fn stride(&self) -> usize {
        self.layout.stride() as usize / 4
    }

    fn row(&self, vertex: u32) -> &[f32] {
        &self.vertices[vertex as usize * self.stride()..][..self.stride()]
    }
}
