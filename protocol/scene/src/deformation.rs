//! Meshes whose vertices follow joints and morph targets (glTF 2.0, 3.7.2.2 and 3.7.3).
//!
//! ```text
//! vertex = Σ wᵢ · jointᵢ · inverseBindᵢ · (position + Σ weightₖ · deltaₖ)
//! ```
//!
//! Computed in f64 and rounded once, in the space of the node that draws the mesh. The primitive's
//! own blob has its vertices at rest, so that what knows nothing of deformation shows that.

use glam::{DAffine3, DMat3, DVec3, Vec3};
use polyptych_files::blob::BlobHash;
use serde::{Deserialize, Serialize};

use crate::mesh::{Primitive, Topology, VertexLayout};

/// Joints and morph targets that move the vertices of a mesh, which is that of one node.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Deformation {
    /// An index into the scene's meshes.
    pub mesh: u32,
    /// The node that draws it.
    pub node: u32,
    /// The skin, if it has one.
    pub skin: Option<Skin>,
    /// The weight of each morph target at rest.
    pub weights: Vec<f64>,
    /// The index into [`Animations::nodes`](crate::Animations) of the node whose weights clips
    /// change.
    pub weights_of: Option<u32>,
}

/// Joints of a mesh.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Skin {
    /// The node in whose space the joints are added up: one that all of them stand below, or are;
    /// the scene itself where `None`. The node that draws the mesh hangs from it.
    pub top: Option<u32>,
    /// The joints; never empty.
    pub joints: Vec<Joint>,
    /// The node that moves primitives without joints, if there are such. `top` is `None` then.
    pub rigid: Option<u32>,
}

/// A joint of a skin.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Joint {
    /// Its node, below the skin's top.
    pub node: u32,
    /// The joint's space from the mesh's.
    pub inverse_bind: DAffine3,
}

/// The vertices of a primitive before they are moved, and what moves each. The blob has, all
/// little-endian:
///
/// - the vertices, as [`Primitive`] says,
/// - for each set, for each vertex: four joints (u16), four weights (f32),
/// - for each morph target, for position, normal, tangent, both texture coordinates and colour in
///   turn: a count (u32), so many vertices (u32), and what is added to each of them (f32).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DeformedPrimitive {
    /// The bytes.
    pub blob: BlobHash,
    /// Their number.
    pub bytes: u64,
    /// Sets of four joints at each vertex; 0 for a primitive that moves as a whole.
    pub joint_sets: u32,
    /// Joints of the mesh's skin.
    pub joint_count: u32,
    /// Morph targets of the mesh.
    pub target_count: u32,
    /// `true` where each triangle has the normal of its plane, and three vertices of its own.
    pub is_flat: bool,
}

/// Four joints of a vertex, and their parts, all of which make 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Influence {
    /// Indices into the skin's joints.
    pub joints: [u16; 4],
    /// From 0 to 1.
    pub weights: [f32; 4],
}

/// The bytes of an [`Influence`] in a blob.
const INFLUENCE_BYTES: usize = 24;

/// The part of a morph target that concerns one attribute.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Deltas {
    /// The vertices that it changes.
    pub vertices: Vec<u32>,
    /// The numbers that are added to each of them.
    pub values: Vec<f32>,
}

/// Attributes that morph targets change, in the order of a blob.
pub const MORPHED_ATTRIBUTES: usize = 6;

/// A primitive whose vertices can be moved.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Deformer {
    /// The attributes of each vertex.
    pub layout: VertexLayout,
    /// Vertices before anything moves them.
    pub vertices: Vec<f32>,
    /// The joints of all vertices, set after set.
    pub influences: Vec<Influence>,
    /// The morph targets.
    pub targets: Vec<[Deltas; MORPHED_ATTRIBUTES]>,
    /// See [`DeformedPrimitive::is_flat`].
    pub is_flat: bool,
}

/// A mesh's joints and weights at a moment.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Shape {
    /// The drawing node's space from the mesh's, as each joint moves it; empty without a skin.
    pub joints: Vec<DAffine3>,
    /// The matrix of primitives without joints.
    pub rigid: DAffine3,
    /// The weight of each morph target.
    pub weights: Vec<f64>,
}

/// The place of an attribute in a vertex and its number of floats; `None` if it is not there.
fn attribute(layout: VertexLayout, which: usize) -> Option<(usize, usize)> {
    let (is_there, byte, width) = match which {
        0 => (true, 0, 3),
        1 => (true, 12, 3),
        // The sign of the bitangent is not morphed.
        2 => (layout.tangent, VertexLayout::TANGENT_OFFSET, 3),
        3 => (layout.uv0, layout.uv0_offset(), 2),
        4 => (layout.uv1, layout.uv1_offset(), 2),
        _ => (layout.color, layout.color_offset(), 4),
    };
    is_there.then_some((byte as usize / 4, width))
}

impl Deformer {
    fn stride(&self) -> usize {
        self.layout.stride() as usize / 4
    }

    /// Number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.vertices.len() / self.stride()
    }

    /// Number of sets of four joints at each vertex.
    pub fn joint_sets(&self) -> usize {
        self.influences.len().checked_div(self.vertex_count()).unwrap_or(0)
    }

    /// The bytes of its blob; see [`DeformedPrimitive`].
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes: Vec<u8> = Vec::with_capacity(self.vertices.len() * 4);
        bytes.extend(self.vertices.iter().flat_map(|number| number.to_le_bytes()));
        for Influence { joints, weights } in &self.influences {
            bytes.extend(joints.iter().flat_map(|joint| joint.to_le_bytes()));
            bytes.extend(weights.iter().flat_map(|weight| weight.to_le_bytes()));
        }
        for Deltas { vertices, values } in self.targets.iter().flatten() {
            bytes.extend((vertices.len() as u32).to_le_bytes());
            bytes.extend(vertices.iter().flat_map(|vertex| vertex.to_le_bytes()));
            bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        }
        bytes
    }

    /// Reads a blob.
    ///
    /// # Errors
    /// The part that is not as it is described.
    pub fn parse(
        primitive: &Primitive,
        described: &DeformedPrimitive,
        bytes: &[u8],
    ) -> Result<Self, String> {
        let mut reader = Reader(bytes);
        let layout = primitive.layout;
        let vertex_count = primitive.vertex_count as usize;
        let floats = vertex_count.saturating_mul(layout.stride() as usize / 4);
        let vertices = reader.floats(floats)?;
        let influences = vertex_count.saturating_mul(described.joint_sets as usize);
        let influences = reader.influences(influences, described.joint_count as usize)?;
        let mut all_targets = Vec::new();
        for _ in 0..described.target_count {
            let mut deltas: [Deltas; MORPHED_ATTRIBUTES] = Default::default();
            for (which, deltas) in deltas.iter_mut().enumerate() {
                let width = attribute(layout, which).map_or(0, |(_, width)| width);
                *deltas = reader.deltas(width, vertex_count)?;
            }
            all_targets.push(deltas);
        }
        let is_flat = described.is_flat;
        let is_triangles = primitive.topology == Topology::Triangles;
        if is_flat && !(is_triangles && vertex_count == primitive.index_count as usize) {
            return Err("its triangles do not have three vertices each".to_owned());
        }
        if !reader.0.is_empty() {
            return Err(format!("it has {} bytes too many", reader.0.len()));
        }
        Ok(Self { layout, vertices, influences, targets: all_targets, is_flat })
    }

    /// Moves the vertices into `out`, which has them in the order of the layout.
    pub fn apply(&self, shape: &Shape, out: &mut Vec<f32>) {
        out.clear();
        out.extend_from_slice(&self.vertices);
        let stride = self.stride();
        for (target, &weight) in self.targets.iter().zip(&shape.weights) {
            if weight != 0.0 {
                self.morph(target, weight, out);
            }
        }
        if let Some((at, _)) = attribute(self.layout, 5).filter(|_| !self.targets.is_empty()) {
            for vertex in out.chunks_exact_mut(stride) {
                vertex[at..at + 4].iter_mut().for_each(|of| *of = of.clamp(0.0, 1.0));
            }
        }
        for (index, vertex) in out.chunks_exact_mut(stride).enumerate() {
            self.place(&self.matrix(shape, index), vertex);
        }
        if self.is_flat {
            flatten(stride, out);
        }
    }

    /// Returns which vertices a shape turns inside out.
    pub fn mirrored(&self, shape: &Shape) -> Vec<bool> {
        let is_mirrored = |index| self.matrix(shape, index).matrix3.determinant() < 0.0;
        (0..self.vertex_count()).map(is_mirrored).collect()
    }

    fn morph(&self, target: &[Deltas; MORPHED_ATTRIBUTES], weight: f64, out: &mut [f32]) {
        for (which, deltas) in target.iter().enumerate() {
            let Some((at, width)) = attribute(self.layout, which) else { continue };
            for (vertex, values) in deltas.vertices.iter().zip(deltas.values.chunks_exact(width)) {
                let at = *vertex as usize * self.stride() + at;
                for (value, delta) in out[at..at + width].iter_mut().zip(values) {
                    *value = (f64::from(*value) + weight * f64::from(*delta)) as f32;
                }
            }
        }
    }

    /// The drawing node's space from a vertex's.
    fn matrix(&self, shape: &Shape, vertex: usize) -> DAffine3 {
        if self.influences.is_empty() {
            return shape.rigid;
        }
        let (mut linear, mut translation) = (DMat3::ZERO, DVec3::ZERO);
        let of_sets = self.influences.iter().skip(vertex).step_by(self.vertex_count());
        for Influence { joints, weights } in of_sets {
            for (joint, weight) in joints.iter().zip(weights).filter(|(_, weight)| **weight > 0.0) {
                let (matrix, weight) = (&shape.joints[usize::from(*joint)], f64::from(*weight));
                linear += matrix.matrix3 * weight;
                translation += matrix.translation * weight;
            }
        }
        DAffine3 { matrix3: linear, translation }
    }

    /// Moves one vertex.
    fn place(&self, matrix: &DAffine3, vertex: &mut [f32]) {
        let vector = |of: &[f32]| Vec3::new(of[0], of[1], of[2]).as_dvec3();
        let point = matrix.transform_point3(vector(&vertex[..3]));
        vertex[..3].copy_from_slice(&point.as_vec3().to_array());
        let linear = matrix.matrix3;
        let sign = if linear.determinant() < 0.0 { -1.0 } else { 1.0 };
        let normal = (cofactors(linear) * vector(&vertex[3..6]) * sign).try_normalize();
        vertex[3..6].copy_from_slice(&normal.unwrap_or(DVec3::Z).as_vec3().to_array());
        if let Some((at, _)) = attribute(self.layout, 2) {
            let tangent = linear * vector(&vertex[at..at + 3]);
            let tangent = tangent.normalize_or_zero().as_vec3();
            vertex[at..at + 3].copy_from_slice(&tangent.to_array());
            vertex[at + 3] *= sign as f32;
        }
    }
}

/// Gives each triangle, of three vertices each, the normal of its plane.
fn flatten(stride: usize, vertices: &mut [f32]) {
    for corners in vertices.chunks_exact_mut(3 * stride) {
        let at = |corner: usize| {
            let of = &corners[corner * stride..];
            Vec3::new(of[0], of[1], of[2]).as_dvec3()
        };
        let normal = (at(1) - at(0)).cross(at(2) - at(0)).try_normalize().unwrap_or(DVec3::Z);
        for corner in corners.chunks_exact_mut(stride) {
            corner[3..6].copy_from_slice(&normal.as_vec3().to_array());
        }
    }
}

/// The matrix of cofactors, which turns normals as the matrix turns surfaces: it is the inverse
/// transpose times the determinant, and exists for singular ones too.
fn cofactors(matrix: DMat3) -> DMat3 {
    let [x, y, z] = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
    DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y))
}

impl Deformation {
    /// Returns what is wrong with it, if anything, where its mesh has these primitives, and the
    /// scene so many nodes and so many of them animated.
    pub(crate) fn fault(
        &self,
        primitives: &[Primitive],
        nodes: usize,
        animated: usize,
    ) -> Option<&'static str> {
        let of_skin = self.skin.iter().flat_map(|skin| {
            let joints = skin.joints.iter().map(|joint| joint.node);
            joints.chain(skin.top).chain(skin.rigid)
        });
        if of_skin.chain([self.node]).any(|node| node as usize >= nodes) {
            return Some("names a node that is not there");
        }
        if self.weights_of.is_some_and(|of| of as usize >= animated) {
            return Some("names an animated node that is not there");
        }
        let is_finite = |skin: &Skin| {
            let joints = &skin.joints;
            !joints.is_empty() && joints.iter().all(|joint| joint.inverse_bind.is_finite())
        };
        let weights_are_finite = self.weights.iter().all(|weight| weight.is_finite());
        if !self.skin.as_ref().is_none_or(is_finite) || !weights_are_finite {
            return Some("has a skin without joints, or numbers that are not finite");
        }
        let joints = self.skin.as_ref().map_or(0, |skin| skin.joints.len());
        let is_mine = |of: &DeformedPrimitive| {
            of.joint_count as usize == joints && of.target_count as usize == self.weights.len()
        };
        let all = primitives.iter().all(|of| of.deformed.as_ref().is_some_and(is_mine));
        (!all).then_some("has other joints or morph targets than its mesh")
    }
}

impl DeformedPrimitive {
    /// Returns what is wrong with it, if anything.
    pub(crate) fn fault(&self, primitive: &Primitive) -> Option<&'static str> {
        if self.joint_sets > 0 && self.joint_count == 0 {
            return Some("follows joints, but has no skin");
        }
        let is_whole = primitive.meshlet_count == 0 && primitive.coarser_index_count == 0;
        (!is_whole).then_some("is deformed and has levels of detail")
    }
}

/// The bytes of a blob that are left to read.
struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn take(&mut self, count: usize, width: usize) -> Result<&'a [u8], String> {
        let bytes = count.checked_mul(width).and_then(|bytes| self.0.split_at_checked(bytes));
        let (taken, rest) = bytes.ok_or("it ends too early")?;
        self.0 = rest;
        Ok(taken)
    }

    fn words(&mut self, count: usize) -> Result<impl Iterator<Item = [u8; 4]> + use<'a>, String> {
        Ok(self.take(count, 4)?.as_chunks::<4>().0.iter().copied())
    }

    fn floats(&mut self, count: usize) -> Result<Vec<f32>, String> {
        let floats: Vec<f32> = self.words(count)?.map(f32::from_le_bytes).collect();
        let is_finite = floats.iter().all(|number| number.is_finite());
        if is_finite { Ok(floats) } else { Err("it has numbers that are not finite".to_owned()) }
    }

    fn influences(&mut self, count: usize, joints: usize) -> Result<Vec<Influence>, String> {
        let bytes = self.take(count, INFLUENCE_BYTES)?.as_chunks::<INFLUENCE_BYTES>().0;
        let read = |bytes: &[u8; INFLUENCE_BYTES]| {
            let (named, weights) = bytes.split_at(8);
            let mut influence = Influence::default();
            for (joint, bytes) in influence.joints.iter_mut().zip(named.as_chunks::<2>().0) {
                *joint = u16::from_le_bytes(*bytes);
            }
            for (weight, bytes) in influence.weights.iter_mut().zip(weights.as_chunks::<4>().0) {
                *weight = f32::from_le_bytes(*bytes);
            }
            let is_there = influence.joints.iter().all(|joint| usize::from(*joint) < joints);
            let is_part = influence.weights.iter().all(|weight| (0.0..=1.0).contains(weight));
            (is_there && is_part).then_some(influence)
        };
        let all: Option<Vec<Influence>> = bytes.iter().map(read).collect();
        all.ok_or_else(|| "a vertex follows a joint that is not there, or too much".to_owned())
    }

    fn deltas(&mut self, width: usize, vertex_count: usize) -> Result<Deltas, String> {
        let count = self.words(1)?.next().map_or(0, u32::from_le_bytes) as usize;
        let vertices: Vec<u32> = self.words(count)?.map(u32::from_le_bytes).collect();
        if vertices.iter().any(|vertex| *vertex as usize >= vertex_count) {
            return Err("a morph target moves a vertex that is not there".to_owned());
        }
        let values = self.floats(count.checked_mul(width).ok_or("it ends too early")?)?;
        Ok(Deltas { vertices, values })
    }
}

#[cfg(test)]
mod tests;
