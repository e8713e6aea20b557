//! Meshes that clips and edits bend: what moves each vertex is kept beside the vertices at rest.

use polyptych_files::blob::BlobHash;
use polyptych_scene::deformation::{
    DeformedPrimitive, Deformer, Deltas, Influence, Joint, MORPHED_ATTRIBUTES, Shape, Skin,
};
use polyptych_scene::{Deformation, VertexLayout};

use super::BakeJob;
use super::accessor::Accessor;
use super::document::Primitive;
use super::error::BakeError;
use super::geometry::{Geometry, Tangents};
use super::material::VertexRequirements;
use super::pose::Pose;

/// A mesh that is bent for one node.
#[derive(Clone, Debug, Default)]
pub(super) struct BentMesh {
    /// The node that draws it, in the scene.
    pub node: u32,
    /// The node of the file that has the mesh.
    pub file_node: u32,
    /// Nodes of the scene, if it has a skin.
    pub skin: Option<Skin>,
    /// At rest.
    pub rest: Shape,
    /// Only edits bend it: its weights stay as they are.
    pub keeps_weights: bool,
}

impl BentMesh {
    /// A mesh with a pose, which is its shape at rest, and so many morph targets.
    pub(super) fn new(file_node: u32, pose: &Pose, target_count: usize) -> Self {
        let mut weights = pose.weights.clone();
        weights.resize(target_count, 0.0);
        let rest = Shape { joints: pose.joints.clone(), rigid: pose.rigid, weights };
        Self { file_node, rest, ..Self::default() }
    }

    /// The deformation of the scene, of which this is the index of the mesh.
    pub(super) fn deformation(&self, mesh: u32, weights_of: Option<u32>) -> Deformation {
        let (skin, weights) = (self.skin.clone(), self.rest.weights.clone());
        Deformation { mesh, node: self.node, skin, weights, weights_of }
    }
}

/// The joints of a skin, by the places of its nodes in the scene; `None` if one is not there.
pub(super) fn skin(
    (top, rigid): (Option<u32>, Option<u32>),
    joints: &[u32],
    inverse_binds: &[glam::DAffine3],
    place_of: impl Fn(u32) -> Option<u32>,
) -> Option<Skin> {
    let joint = |(node, inverse_bind): (&u32, &glam::DAffine3)| {
        Some(Joint { node: place_of(*node)?, inverse_bind: *inverse_bind })
    };
    let joints = joints.iter().zip(inverse_binds).map(joint).collect::<Option<Vec<_>>>()?;
    let place = |node: Option<u32>| node.map_or(Some(None), |node| place_of(node).map(Some));
    Some(Skin { top: place(top)?, joints, rigid: place(rigid)? })
}

/// Joints and morph targets of a primitive's vertices, by the numbers that they have in the file.
#[derive(Debug)]
pub(super) struct Bindings {
    /// The joints of all vertices, for each set.
    sets: Vec<Vec<Influence>>,
    /// Numbers of all vertices, for each attribute that a target changes.
    targets: Vec<[Option<Vec<f32>>; MORPHED_ATTRIBUTES]>,
    pub rest: Shape,
    is_flat: bool,
}

impl Bindings {
    /// Reads what moves a primitive of a mesh.
    ///
    /// # Errors
    /// An accessor is not as it should be, or a vertex follows a joint that is not there.
    pub(super) fn read(
        job: &BakeJob<'_>,
        json: &Primitive,
        (bent, pose): (&BentMesh, &Pose),
        (geometry, needs): (&Geometry, &VertexRequirements),
        place: &str,
    ) -> Result<Self, BakeError> {
        let count = geometry.positions.len();
        let sets = pose.influences(job, json, count, place)?;
        let is_flat = geometry.normals.is_none();
        let tangents = matches!(geometry.tangents, Tangents::Vertex(_)).then(|| "TANGENT".into());
        let uv = |set: Option<u32>| set.map(|set| format!("TEXCOORD_{set}"));
        let normal = Some("NORMAL".to_owned()).filter(|_| !is_flat);
        let color = geometry.colors.as_ref().map(|_| "COLOR_0".to_owned());
        let [uv0, uv1] = needs.uv_sets;
        let names: [Option<String>; MORPHED_ATTRIBUTES] =
            [Some("POSITION".into()), normal, tangents, uv(uv0), uv(uv1), color];
        let mut targets = Vec::new();
        for (target, weight) in bent.rest.weights.iter().enumerate() {
            let mut all: [Option<Vec<f32>>; MORPHED_ATTRIBUTES] = Default::default();
            // A target that never counts may be broken.
            let counts = !bent.keeps_weights || *weight != 0.0;
            for (slot, name) in all.iter_mut().zip(&names).filter(|_| counts) {
                let Some(name) = name else { continue };
                *slot = deltas(job, json, (target, name), count, place)?;
            }
            targets.push(all);
        }
        Ok(Self { sets, targets, rest: bent.rest.clone(), is_flat })
    }

    /// A deformer of a piece's vertices, whose numbers in the file are given.
    pub(super) fn deformer(
        &self,
        layout: VertexLayout,
        vertices: Vec<f32>,
        sources: &[u32],
    ) -> Deformer {
        let of_set = |set: &Vec<Influence>| -> Vec<Influence> {
            sources.iter().map(|source| set[*source as usize]).collect()
        };
        let of_target = |target: &[Option<Vec<f32>>; MORPHED_ATTRIBUTES]| {
            std::array::from_fn(|which| sparse(target[which].as_deref(), which, sources))
        };
        Deformer {
            layout,
            vertices,
            influences: self.sets.iter().flat_map(of_set).collect(),
            targets: self.targets.iter().map(of_target).collect(),
            is_flat: self.is_flat,
        }
    }
}

/// Numbers of an attribute's delta.
fn width(which: usize) -> usize {
    [3, 3, 3, 2, 2, 4][which]
}

/// The deltas of these vertices, without those that change nothing.
fn sparse(all: Option<&[f32]>, which: usize, sources: &[u32]) -> Deltas {
    let mut deltas = Deltas::default();
    let Some(all) = all else { return deltas };
    let width = width(which);
    for (vertex, source) in (0..).zip(sources) {
        let of = &all[*source as usize * width..][..width];
        if of.iter().any(|delta| *delta != 0.0) {
            deltas.vertices.push(vertex);
            deltas.values.extend_from_slice(of);
        }
    }
    deltas
}

/// The numbers that a morph target adds to an attribute, vertex by vertex; `None` if none.
fn deltas(
    job: &BakeJob<'_>,
    json: &Primitive,
    (target, name): (usize, &str),
    count: usize,
    place: &str,
) -> Result<Option<Vec<f32>>, BakeError> {
    let Some(&index) = json.targets.get(target).and_then(|target| target.get(name)) else {
        return Ok(None);
    };
    job.check()?;
    let place = format!("{place}.targets[{target}].{name}");
    let accessor = Accessor::open(job.source, index, &place)?;
    if accessor.count != count {
        let what = format!("it has {} elements, POSITION {count}", accessor.count);
        return Err(BakeError::at(place, what, "equal counts would be right"));
    }
    let numbers: Vec<f32> = match name {
        "COLOR_0" => accessor.colors(0.0)?.into_flattened(),
        name if name.starts_with("TEXCOORD") => accessor.floats::<2>()?.into_flattened(),
        _ => accessor.floats::<3>()?.into_flattened(),
    };
    if let Some(at) = numbers.iter().position(|number| !number.is_finite()) {
        let what = format!("element {} is not finite", at * count / numbers.len());
        return Err(BakeError::at(place, what, "finite numbers would be right"));
    }
    Ok(Some(numbers))
}

/// A deformer with its vertices in another order, which has the old number of each.
pub(super) fn reordered(deformer: &Deformer, order: &[u32]) -> Deformer {
    let stride = deformer.layout.stride() as usize / 4;
    let count = deformer.vertex_count();
    let vertices =
        order.iter().flat_map(|old| &deformer.vertices[*old as usize * stride..][..stride]);
    let sets = deformer.influences.chunks_exact(count.max(1));
    let influences = sets.flat_map(|set| order.iter().map(|old| set[*old as usize]));
    let mut new_of = vec![u32::MAX; count];
    for (new, old) in (0..).zip(order) {
        new_of[*old as usize] = new;
    }
    let moved = |deltas: &Deltas| Deltas {
        vertices: deltas.vertices.iter().map(|old| new_of[*old as usize]).collect(),
        values: deltas.values.clone(),
    };
    Deformer {
        layout: deformer.layout,
        vertices: vertices.copied().collect(),
        influences: influences.collect(),
        targets: deformer.targets.iter().map(|target| target.each_ref().map(moved)).collect(),
        is_flat: deformer.is_flat,
    }
}

/// The description of a deformer's blob.
pub(super) fn described(deformer: &Deformer, bytes: u64, joint_count: usize) -> DeformedPrimitive {
    DeformedPrimitive {
        blob: BlobHash([0; 32]),
        bytes,
        joint_sets: deformer.joint_sets() as u32,
        joint_count: joint_count as u32,
        target_count: deformer.targets.len() as u32,
        is_flat: deformer.is_flat,
    }
}
