//! Decoded files of a wall: warp maps, screen meshes and masks, and the blobs that they travel in.
//!
//! The baker makes these of foreign files; everyone else reads blobs:
//!
//! ```text
//! "ppwf" version=1 kind extra 0     kind 1 grid, 2 mesh, 3 mask; extra: space, or components
//! a: u32, b: u32                    width and height; or how many vertices and triangles
//! grid   a·b × 3 f32                values, rows from the top; NaN where unlit
//! mesh   a × 6 f32, b × 3 u32       place u v, value x y z, light; corners of triangles
//! mask   a·b·components × u16       linear light, rows from the top
//! ```
//!
//! All numbers are little-endian. Values are f32 although display space is f64: they are points
//! of a room, at most [`WARP_REACH_M_MAX`] from its origin, so that rounding moves a point by at
//! most 0.03 mm there and by 0.5 µm in a room of 10 m, a hundredth of the smallest pixels. Where
//! the scene lies in the world plays no part: the eye is subtracted in display space.

mod light;
mod lit_blocks;
mod sample;

use glam::{UVec2, Vec2, Vec3};
use lit_blocks::LitBlocks;

use super::blend::MaskTexels;
use crate::limits::CHANNEL_SIDE_MAX;

/// Farthest that a point of a map lies from the origin of display space, in metres: no room is
/// larger, and f32 is exact to 0.03 mm there.
pub const WARP_REACH_M_MAX: f32 = 1000.0;

/// Most vertices of a mesh: one for each second pixel of the largest 4K projector, both ways.
pub const MAP_VERTICES_MAX: u32 = 1 << 21;

/// Most triangles of a mesh: a closed grid has two for each vertex.
pub const MAP_TRIANGLES_MAX: u32 = 1 << 22;

/// Maximum distance of a vertex from the channel's picture, in pictures: meshes of measured walls
/// begin a little outside.
pub const PLACE_REACH_MAX: f32 = 16.0;

const MAGIC: &[u8] = b"ppwf";
const VERSION: u8 = 1;
const HEAD_BYTES: usize = 16;

/// A decoded file of a wall.
#[derive(Clone, Debug, PartialEq)]
pub enum CalibrationMap {
    /// The point for each place of a picture.
    Warp(WarpMap),
    /// The factor or the minimum of the light of each pixel of a channel.
    Mask(Mask),
}

/// The coordinates of a map's values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MapCoordinates {
    /// (u, v, 0) on the screen's canvas: (0, 0) its upper left corner, (1, 1) its lower right.
    /// It holds for one eye only, so walls that use it refuse tracking.
    Canvas,
    /// Points of display space, in metres: right for every eye.
    Display,
}

/// For places of a picture, the points that they show.
#[derive(Clone, Debug, PartialEq)]
pub struct WarpMap {
    /// The coordinates of the values.
    pub space: MapCoordinates,
    /// The values and their places.
    pub shape: WarpGeometry,
}

/// The places of a map's values.
#[derive(Clone, Debug, PartialEq)]
pub enum WarpGeometry {
    /// At pixel centres.
    Grid(WarpGrid),
    /// At the vertices of triangles, linear between them in the picture.
    Mesh(ImportedMesh),
}

/// Values at the centres of equal cells that fill a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct WarpGrid {
    /// Cells across and down; not necessarily as many as the channel has pixels.
    pub size: UVec2,
    /// Rows from the top; all three components NaN where unlit. Where they are lit was noted when
    /// the grid was made: another grid is made for other values.
    pub values: Vec<Vec3>,
    lit: LitBlocks,
}

/// Values at the vertices of triangles; unlit where none lies.
#[derive(Clone, Debug, PartialEq)]
pub struct ImportedMesh {
    /// In the order of the file.
    pub vertices: Vec<ImportedVertex>,
    /// Indices into the vertices. No two triangles lie over each other in the picture.
    pub triangles: Vec<[u32; 3]>,
}

/// A vertex of an [`ImportedMesh`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImportedVertex {
    /// In the channel's picture (a screen mesh: on the screen's canvas): (0, 0) the upper left
    /// corner, (1, 1) the lower right.
    pub place: Vec2,
    /// The point that it shows, in the map's space.
    pub value: Vec3,
    /// Factor of linear light, 0 to 1.
    pub light: f32,
}

/// Factors of a channel's pixels, or light that it has anyway.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mask {
    /// Pixels across and down; not necessarily as many as the channel has.
    pub size: UVec2,
    /// 1 for all colours together, or 3 for red, green and blue.
    pub components: u8,
    /// Linear light, 65,535 is all; rows from the top, components of a pixel together.
    pub texels: Vec<u16>,
}

impl WarpGrid {
    /// The grid of this size with these values, rows from the top.
    pub fn new(size: UVec2, values: Vec<Vec3>) -> Self {
        let lit = LitBlocks::new(size, &values);
        Self { size, values, lit }
    }
}

impl CalibrationMap {
    /// The bytes of its blob.
    pub fn encode(&self) -> Vec<u8> {
        let (kind, extra, a, b) = self.head();
        let mut out = Vec::with_capacity(HEAD_BYTES + self.body_bytes());
        out.extend_from_slice(MAGIC);
        out.extend_from_slice(&[VERSION, kind, extra, 0]);
        out.extend_from_slice(&a.to_le_bytes());
        out.extend_from_slice(&b.to_le_bytes());
        let mut put = |numbers: &[f32]| {
            for number in numbers {
                out.extend_from_slice(&number.to_le_bytes());
            }
        };
        match self {
            Self::Warp(WarpMap { shape: WarpGeometry::Grid(grid), .. }) => {
                grid.values.iter().for_each(|value| put(&value.to_array()));
            }
            Self::Warp(WarpMap { shape: WarpGeometry::Mesh(mesh), .. }) => {
                for ImportedVertex { place, value, light } in &mesh.vertices {
                    put(&[place.x, place.y, value.x, value.y, value.z, *light]);
                }
                for corner in mesh.triangles.iter().flatten() {
                    out.extend_from_slice(&corner.to_le_bytes());
                }
            }
            Self::Mask(mask) => {
                mask.texels.iter().for_each(|texel| out.extend_from_slice(&texel.to_le_bytes()));
            }
        }
        out
    }

    /// The map that these bytes are.
    ///
    /// # Errors
    /// One line that says what is wrong with them. Nothing is allocated before as many bytes as
    /// it takes are known to be there.
    pub fn decode(bytes: &[u8]) -> Result<Self, String> {
        let head = bytes.first_chunk::<HEAD_BYTES>().ok_or("a map of a wall is cut short")?;
        if !head.starts_with(MAGIC) || head[4] != VERSION || head[7] != 0 {
            return Err("it is no map of a wall, or one of another version".to_owned());
        }
        let word =
            |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
        let (kind, extra, a, b) = (head[5], head[6], word(8), word(12));
        let body = &bytes[HEAD_BYTES..];
        let (count_a, count_b) = (u64::from(a), u64::from(b));
        let due = match kind {
            1 => count_a.checked_mul(count_b).and_then(|cells| cells.checked_mul(12)),
            2 => Some(count_a * 24 + count_b * 12),
            3 => count_a.checked_mul(count_b).and_then(|n| n.checked_mul(2 * u64::from(extra))),
            _ => return Err(format!("a map of a wall is of kind {kind}, which is unknown")),
        };
        if due != Some(body.len() as u64) {
            return Err(format!("a map of a wall has {} bytes for {a} and {b}", body.len()));
        }
        let map = if kind == 3 {
            let texel = |two: &[u8]| u16::from_le_bytes([two[0], two[1]]);
            let texels = body.chunks_exact(2).map(texel).collect();
            Self::Mask(Mask { size: UVec2::new(a, b), components: extra, texels })
        } else {
            let space = match extra {
                0 => MapCoordinates::Canvas,
                1 => MapCoordinates::Display,
                _ => return Err(format!("a map of a wall is in space {extra}, which is unknown")),
            };
            let shape = if kind == 1 {
                let values = body.chunks_exact(12).map(|cell| Vec3::from_array(floats(cell)));
                WarpGeometry::Grid(WarpGrid::new(UVec2::new(a, b), values.collect()))
            } else {
                WarpGeometry::Mesh(decode_mesh(body, a as usize * 24))
            };
            Self::Warp(WarpMap { space, shape })
        };
        map.fault().map_or(Ok(map), Err)
    }

    /// Returns the fault of the map, if any: a size beyond the limits, an invalid number, an index
    /// that points nowhere.
    pub fn fault(&self) -> Option<String> {
        match self {
            Self::Warp(warp) => warp.fault(),
            Self::Mask(mask) => mask.fault(),
        }
    }

    fn head(&self) -> (u8, u8, u32, u32) {
        match self {
            Self::Warp(WarpMap { space, shape }) => {
                let extra = u8::from(*space == MapCoordinates::Display);
                match shape {
                    WarpGeometry::Grid(grid) => (1, extra, grid.size.x, grid.size.y),
                    WarpGeometry::Mesh(mesh) => {
                        (2, extra, mesh.vertices.len() as u32, mesh.triangles.len() as u32)
                    }
                }
            }
            Self::Mask(mask) => (3, mask.components, mask.size.x, mask.size.y),
        }
    }

    fn body_bytes(&self) -> usize {
        match self {
            Self::Warp(WarpMap { shape: WarpGeometry::Grid(grid), .. }) => grid.values.len() * 12,
            Self::Warp(WarpMap { shape: WarpGeometry::Mesh(mesh), .. }) => {
                mesh.vertices.len() * 24 + mesh.triangles.len() * 12
            }
            Self::Mask(mask) => mask.texels.len() * 2,
        }
    }
}

fn decode_mesh(body: &[u8], vertex_bytes: usize) -> ImportedMesh {
    let (vertices, triangles) = body.split_at(vertex_bytes.min(body.len()));
    let vertex = |bytes: &[u8]| {
        let [u, v, x, y, z, light] = floats(bytes);
        ImportedVertex { place: Vec2::new(u, v), value: Vec3::new(x, y, z), light }
    };
    let corner = |four: &[u8]| u32::from_le_bytes([four[0], four[1], four[2], four[3]]);
    let triangle = |b: &[u8]| [corner(&b[..4]), corner(&b[4..8]), corner(&b[8..12])];
    ImportedMesh {
        vertices: vertices.chunks_exact(24).map(vertex).collect(),
        triangles: triangles.chunks_exact(12).map(triangle).collect(),
    }
}

/// Reads as many little-endian floats as the array has; `bytes` has four times as many bytes.
fn floats<const N: usize>(bytes: &[u8]) -> [f32; N] {
    std::array::from_fn(|i| {
        let four = &bytes[i * 4..i * 4 + 4];
        f32::from_le_bytes([four[0], four[1], four[2], four[3]])
    })
}

/// Returns the fault of a picture's size or of its number of values, if any.
fn size_fault(size: UVec2, len: usize, components: usize) -> Option<String> {
    let is_sound = size.min_element() > 0 && size.max_element() <= CHANNEL_SIDE_MAX;
    let due = size.x as usize * size.y as usize * components;
    let fault = format!("it is {} × {}, where 1 to {CHANNEL_SIDE_MAX} can be", size.x, size.y);
    (!is_sound || due != len).then_some(fault)
}

impl WarpMap {
    fn fault(&self) -> Option<String> {
        let reach = match self.space {
            MapCoordinates::Canvas => PLACE_REACH_MAX,
            MapCoordinates::Display => WARP_REACH_M_MAX,
        };
        // Not `abs() > reach`: NaN has to be false.
        let is_near = |value: &Vec3| value.abs().max_element() <= reach && value.is_finite();
        let is_flat = |value: &Vec3| self.space == MapCoordinates::Display || value.z == 0.0;
        match &self.shape {
            WarpGeometry::Grid(grid) => {
                let is_unlit = |value: &Vec3| value.to_array().iter().all(|n| n.is_nan());
                let is_bad = |v: &&Vec3| !(is_unlit(v) || (is_near(v) && is_flat(v)));
                let bad = grid.values.iter().find(is_bad);
                size_fault(grid.size, grid.values.len(), 1)
                    .or_else(|| bad.map(|value| format!("a value is {value}, beyond {reach}")))
            }
            WarpGeometry::Mesh(mesh) => mesh.fault(|value| is_near(value) && is_flat(value)),
        }
    }
}

impl ImportedMesh {
    fn fault(&self, is_value: impl Fn(&Vec3) -> bool) -> Option<String> {
        let (vertices, triangles) = (self.vertices.len(), self.triangles.len());
        let is_large = vertices > MAP_VERTICES_MAX as usize;
        if is_large || triangles > MAP_TRIANGLES_MAX as usize || triangles == 0 {
            return Some(format!(
                "it has {vertices} vertices and {triangles} triangles, where {MAP_VERTICES_MAX} \
                 and 1 to {MAP_TRIANGLES_MAX} can be"
            ));
        }
        let is_bad = |vertex: &&ImportedVertex| {
            let is_placed = vertex.place.is_finite()
                && vertex.place.abs().max_element() <= PLACE_REACH_MAX
                && (0.0..=1.0).contains(&vertex.light);
            !is_placed || !is_value(&vertex.value)
        };
        if let Some(vertex) = self.vertices.iter().find(is_bad) {
            return Some(format!("a vertex at {} is out of reach", vertex.place));
        }
        let beyond = self.triangles.iter().flatten().find(|&&i| i as usize >= vertices);
        beyond.map(|i| format!("a triangle names vertex {i} of {vertices}"))
    }
}

impl Mask {
    /// Its texels, as blends take them.
    pub fn texels(&self) -> Option<MaskTexels<'_>> {
        MaskTexels::new(self.size, usize::from(self.components), &self.texels)
    }

    /// Red, green and blue of a pixel, which must lie in it.
    pub fn at(&self, x: u32, y: u32) -> [u16; 3] {
        let pixel = y as usize * self.size.x as usize + x as usize;
        match self.components {
            3 => std::array::from_fn(|i| self.texels[pixel * 3 + i]),
            _ => [self.texels[pixel]; 3],
        }
    }

    fn fault(&self) -> Option<String> {
        if self.components != 1 && self.components != 3 {
            return Some(format!("{} components, where 1 or 3 can be", self.components));
        }
        size_fault(self.size, self.texels.len(), usize::from(self.components))
    }
}

#[cfg(test)]
mod tests;
