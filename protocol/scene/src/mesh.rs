//! Meshes: what a vertex holds and how a mesh's blob is laid out.

use glam::{DVec3, Vec3};
use polyptych_files::blob::BlobHash;
use serde::{Deserialize, Serialize};

use super::deformation::DeformedPrimitive;
use super::level_cut::LevelCut;
use super::meshlet::Meshlet;

/// Parts that are drawn together under one node.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Mesh {
    /// The source's name; may be empty.
    pub name: String,
    /// Each has one material.
    pub primitives: Vec<Primitive>,
}

/// Geometry with one material.
///
/// Its blob holds `vertex_count` vertices of [`VertexLayout::stride`] bytes, then the indices of
/// all levels, zeros up to a multiple of 4 bytes if it has meshlets, and the [`Meshlet`]s; all
/// little-endian, nothing else. Meshlets that stay longest when levels are left out stand first,
/// indices are in the order of the meshlets, and vertices in that of the indices: [`LevelCut`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Primitive {
    /// The bytes.
    pub blob: BlobHash,
    /// The attributes of each vertex.
    pub layout: VertexLayout,
    /// Number of vertices, of all levels.
    pub vertex_count: u32,
    /// Number of indices of the finest level; never 0.
    pub index_count: u32,
    /// Number of indices of all coarser levels of detail.
    pub coarser_index_count: u32,
    /// Number of meshlets, of all levels; 0 for what is always drawn whole.
    pub meshlet_count: u32,
    /// The width of an index.
    pub index_format: IndexFormat,
    /// The shapes that the indices make.
    pub topology: Topology,
    /// An index into the scene's materials; `None` is glTF's default material.
    pub material: Option<u32>,
    /// The position of the vertices' origin in the mesh's space. 0 for vertices that stay as their
    /// file has them, which is exact.
    pub origin: DVec3,
    /// The least corner of the vertices, relative to `origin`.
    pub min: Vec3,
    /// The greatest corner of the vertices, relative to `origin`.
    pub max: Vec3,
    /// The coarser levels that can be held without the finer ones, the coarsest first.
    pub cuts: Vec<LevelCut>,
    /// The level that is drawn as the finest one: 0, unless it is limited to a cut.
    pub finest_level: u32,
    /// The data by which its vertices move, if they do; its own blob has them at rest then, and no
    /// levels.
    pub deformed: Option<DeformedPrimitive>,
}

/// The attributes of a vertex. Position and normal are always there.
///
/// A vertex is interleaved, in this order, all f32: position 3, normal 3, then as present:
/// tangent 4, uv0 2, uv1 2, color 4 (linear RGBA).
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize,
)]
pub struct VertexLayout {
    /// xyz along +u of the normal map, w the sign of the bitangent.
    pub tangent: bool,
    /// First set of texture coordinates.
    pub uv0: bool,
    /// Second set of texture coordinates.
    pub uv1: bool,
    /// Multiplies the base colour.
    pub color: bool,
}

impl VertexLayout {
    /// Bytes before the tangent.
    pub const TANGENT_OFFSET: u32 = 24;

    /// Bytes before the first texture coordinates.
    pub fn uv0_offset(self) -> u32 {
        Self::TANGENT_OFFSET + 16 * u32::from(self.tangent)
    }

    /// Bytes before the second texture coordinates.
    pub fn uv1_offset(self) -> u32 {
        self.uv0_offset() + 8 * u32::from(self.uv0)
    }

    /// Bytes before the colour.
    pub fn color_offset(self) -> u32 {
        self.uv1_offset() + 8 * u32::from(self.uv1)
    }

    /// Bytes of one vertex.
    pub fn stride(self) -> u32 {
        self.color_offset() + 16 * u32::from(self.color)
    }
}

/// The width of an index.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum IndexFormat {
    /// 2 bytes, where there are at most 65,535 vertices.
    U16,
    /// 4 bytes.
    U32,
}

impl IndexFormat {
    /// Returns the largest of these indices, which are little-endian; `None` without one.
    pub fn largest(self, bytes: &[u8]) -> Option<u32> {
        self.numbers(bytes).max()
    }

    /// The numbers of these indices, which are little-endian.
    pub fn numbers(self, bytes: &[u8]) -> impl Iterator<Item = u32> {
        let words = bytes.chunks_exact(self.width());
        words.map(|word| match *word {
            [a, b, c, d] => u32::from_le_bytes([a, b, c, d]),
            [a, b] => u16::from_le_bytes([a, b]).into(),
            _ => 0,
        })
    }

    /// Bytes of an index.
    fn width(self) -> usize {
        match self {
            Self::U16 => 2,
            Self::U32 => 4,
        }
    }
}

/// The shapes that indices make. The baker turns strips, loops and fans into these.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum Topology {
    /// Each index a point of one pixel.
    Points,
    /// Each two indices a line of one pixel.
    Lines,
    /// Each three indices a triangle, counter-clockwise from its front.
    Triangles,
}

impl Primitive {
    /// Bytes of the vertices, which come first in the blob.
    pub fn vertex_bytes(&self) -> u64 {
        u64::from(self.vertex_count) * u64::from(self.layout.stride())
    }

    /// Bytes of the indices of the finest level.
    pub fn index_bytes(&self) -> u64 {
        u64::from(self.index_count) * self.index_width()
    }

    /// Number of indices of all levels.
    pub fn index_count_of_all(&self) -> u64 {
        u64::from(self.index_count) + u64::from(self.coarser_index_count)
    }

    /// Bytes of the vertices and of the indices of all levels: what is drawn of the blob.
    pub fn geometry_bytes(&self) -> u64 {
        self.vertex_bytes() + self.index_count_of_all() * self.index_width()
    }

    /// The place of the first meshlet in the blob, in bytes.
    pub fn first_meshlet_byte(&self) -> u64 {
        let bytes = self.geometry_bytes();
        if self.meshlet_count == 0 { bytes } else { bytes.next_multiple_of(4) }
    }

    /// Bytes of the whole blob.
    pub fn bytes(&self) -> u64 {
        self.first_meshlet_byte() + u64::from(self.meshlet_count) * Meshlet::BYTES as u64
    }

    /// Returns whether it has levels of detail that no blob can hold, or levels of what are not
    /// triangles.
    pub(super) fn has_unusable_levels(&self) -> bool {
        let is_plain = self.coarser_index_count == 0 && self.meshlet_count == 0;
        let is_short = u32::try_from(self.index_count_of_all()).is_ok();
        let is_drawn = self.topology == Topology::Triangles && self.meshlet_count > 0;
        !(is_plain || (is_short && is_drawn))
    }

    /// Bytes of an index.
    pub(super) fn index_width(&self) -> u64 {
        self.index_format.width() as u64
    }

    /// Triangles that it draws.
    pub fn triangles(&self) -> u64 {
        match self.topology {
            Topology::Triangles => u64::from(self.index_count) / 3,
            Topology::Points | Topology::Lines => 0,
        }
    }
}
