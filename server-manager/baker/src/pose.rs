//! Poses: the shapes that skins and morph targets give meshes at rest. What clips and edits bend
//! has more, see `deformation`.
//!
//! A mesh with a skin stands where its joints are; its node's own transform says nothing (glTF
//! 2.0, 3.7.3.3). It becomes a mesh of its own, in a frame near its joints, so that vertices stay
//! small numbers wherever the scene stands. Nodes whose poses are equal share one.
//!
//! ```text
//! world = frame · Σ wᵢ · (frame⁻¹ · jointᵢ · inverseBindᵢ) · (position + Σ weightₖ · deltaₖ)
//! ```

use glam::{DAffine3, DMat3, DMat4, DVec3, DVec4};

use polyptych_scene::deformation::Influence;

use super::BakeJob;
use super::accessor::Accessor;
use super::bounds::stretch;
use super::document::{self, Primitive};
use super::error::BakeError;
use super::node::Tree;

/// Largest difference of the last row of an inverse bind matrix from 0, 0, 0, 1: exporters write
/// products of f32.
const AFFINE_TOLERANCE: f64 = 1e-3;

/// A shape at rest.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Pose {
    /// The weight of each morph target; 0 beyond the end.
    pub weights: Vec<f64>,
    /// The frame from the mesh, for each joint; empty without a skin.
    pub joints: Vec<DAffine3>,
    /// The frame from the mesh, for primitives that no joint moves.
    pub rigid: DAffine3,
}

pub(super) fn has_joints(primitive: &Primitive) -> bool {
    let has = |name: &str| primitive.attributes.contains_key(name);
    has("JOINTS_0") && has("WEIGHTS_0")
}

/// The component-wise median: most joints of a skin stand near each other, whatever one does.
pub(super) fn median(points: &[DVec3]) -> DVec3 {
    let component = |axis: usize| {
        let mut values: Vec<f64> = points.iter().map(|point| point[axis]).collect();
        values.sort_unstable_by(f64::total_cmp);
        values.get(values.len() / 2).copied().filter(|value| value.is_finite()).unwrap_or(0.0)
    };
    DVec3::new(component(0), component(1), component(2))
}

/// A skin's joints at rest.
pub(super) struct Bound {
    /// The last node that all joints stand below, or are: the frame.
    pub top: Option<u32>,
    /// The world from the frame.
    pub frame: DAffine3,
    /// The frame from the mesh, for each joint.
    pub matrices: Vec<DAffine3>,
    /// Each joint's space from the mesh's.
    pub inverse_binds: Vec<DAffine3>,
}

/// Joint · inverse bind matrix of each joint of a skin, in the frame of their last common parent
/// before the first one at which the chain from the root ends, or in the world. Below equal
/// parents, copies of a skeleton give equal bits.
pub(super) fn joints(
    job: &BakeJob<'_>,
    tree: &Tree<'_>,
    skin: u32,
    json: &document::Skin,
    ends_chain: impl Fn(u32) -> bool,
) -> Result<Bound, BakeError> {
    let place = format!("skins[{skin}]");
    if json.joints.is_empty() {
        return Err(BakeError::at(place, "it has no joints", "at least one would be right"));
    }
    let inverse_binds = inverse_binds(job, json, &place)?;
    let mut common: Option<Vec<u32>> = None;
    for &joint in &json.joints {
        if joint as usize >= tree.nodes.len() {
            let place = format!("{place}.joints");
            return Err(BakeError::beyond(place, "nodes", joint.into(), tree.nodes.len()));
        }
        let chain = tree.chain(joint);
        // A small file cannot ask for hours of walking up and down.
        job.source.reserve_elements(chain.len() as u64, &place)?;
        common = Some(match common {
            None => chain,
            Some(mut common) => {
                let equal = common.iter().zip(&chain).take_while(|(a, b)| a == b).count();
                common.truncate(equal);
                common
            }
        });
    }
    let common = common.unwrap_or_default();
    let top = common.into_iter().take_while(|&at| !ends_chain(at)).last();
    let frame = match top {
        Some(top) => tree.below(None, top)?,
        None => DAffine3::IDENTITY,
    };
    let mut matrices = Vec::with_capacity(json.joints.len());
    for (i, &joint) in json.joints.iter().enumerate() {
        let matrix = tree.below(top, joint)? * inverse_binds.get(i).copied().unwrap_or_default();
        if !matrix.is_finite() {
            let place = format!("{place}.joints[{i}]");
            let right = "smaller numbers would be right";
            return Err(BakeError::at(place, "its transform overflows", right));
        }
        matrices.push(matrix);
    }
    Ok(Bound { top, frame, matrices, inverse_binds })
}

/// Returns the matrices that take a mesh into the space of each joint; identities if the skin has
/// none.
fn inverse_binds(
    job: &BakeJob<'_>,
    json: &document::Skin,
    place: &str,
) -> Result<Vec<DAffine3>, BakeError> {
    let place = format!("{place}.inverseBindMatrices");
    let Some(index) = json.inverse_bind_matrices else {
        return Ok(vec![DAffine3::IDENTITY; json.joints.len()]);
    };
    let accessor = Accessor::open(job.source, index, &place)?;
    if accessor.count < json.joints.len() {
        let what = format!("{} matrices for {} joints", accessor.count, json.joints.len());
        return Err(BakeError::at(place, what, "one for each joint would be right"));
    }
    let given = accessor.floats::<16>()?;
    let convert = |(i, columns): (usize, &[f32; 16])| {
        let matrix = DMat4::from_cols_array(&columns.map(f64::from));
        let off = (matrix.row(3) - DVec4::W).abs().max_element();
        if matrix.is_finite() && off <= AFFINE_TOLERANCE {
            return Ok(DAffine3::from_mat4(matrix));
        }
        let what = format!("matrix {i} is not affine, or not finite");
        let right = "finite numbers, with 0, 0, 0, 1 for a last row, would be right";
        Err(BakeError::at(&accessor.place, what, right))
    };
    given.iter().take(json.joints.len()).enumerate().map(convert).collect()
}

/// The vertices of a primitive that a pose changes.
pub(super) struct Vertices<'a> {
    pub positions: &'a mut [[f32; 3]],
    pub normals: Option<&'a mut [[f32; 3]]>,
    pub tangents: Option<&'a mut [[f32; 4]]>,
}

impl Pose {
    /// Returns the most that it lengthens any line of a primitive by its skin, or a little more.
    pub(super) fn stretch(&self, json: &Primitive) -> f64 {
        if self.joints.is_empty() {
            return 1.0;
        }
        let rigid = std::slice::from_ref(&self.rigid);
        let matrices = if has_joints(json) { &self.joints[..] } else { rigid };
        matrices.iter().map(|matrix| stretch(matrix.matrix3)).fold(0.0, f64::max)
    }

    /// Moves vertices to where they stand at rest, in f64, rounded once. Gives which of them were
    /// mirrored: triangles of such must be turned, or they would show their backs.
    pub(super) fn apply(
        &self,
        job: &BakeJob<'_>,
        json: &Primitive,
        vertices: Vertices<'_>,
        place: &str,
    ) -> Result<Vec<bool>, BakeError> {
        let Vertices { positions, normals, tangents } = vertices;
        let count = positions.len();
        let sums = |name: &str| self.deltas::<3>(job, json, name, count, place);
        let moved = [sums("POSITION")?, sums("NORMAL")?, sums("TANGENT")?];
        let delta = |of: usize, i: usize| {
            moved[of].as_ref().map_or(DVec3::ZERO, |deltas| DVec3::from(deltas[i]))
        };
        let skin = if self.joints.is_empty() { None } else { Some(self.skin(job, json, place)?) };
        let mut mirrored = Vec::new();
        let (mut normals, mut tangents) = (normals, tangents);
        for (i, position) in positions.iter_mut().enumerate() {
            let matrix = match &skin {
                Some(skin) => skin.matrix(i)?,
                None => DAffine3::IDENTITY,
            };
            let point = DVec3::from(position.map(f64::from)) + delta(0, i);
            *position = matrix.transform_point3(point).as_vec3().to_array();
            if position.iter().any(|value| !value.is_finite()) {
                let what = format!("vertex {i} of the mesh at rest is not finite");
                return Err(BakeError::at(place, what, "smaller numbers would be right"));
            }
            let linear = matrix.matrix3;
            let sign = if linear.determinant() < 0.0 { -1.0 } else { 1.0 };
            if let Some(normal) = normals.as_deref_mut().and_then(|normals| normals.get_mut(i)) {
                let given = DVec3::from(normal.map(f64::from)) + delta(1, i);
                // Of any length: what has none is repaired later.
                let turned = (cofactors(linear) * given * sign).normalize_or_zero();
                *normal = turned.as_vec3().to_array();
            }
            if let Some(tangent) = tangents.as_deref_mut().and_then(|list| list.get_mut(i)) {
                let [x, y, z, w] = tangent.map(f64::from);
                let turned = (linear * (DVec3::new(x, y, z) + delta(2, i))).normalize_or_zero();
                let turned = turned.as_vec3();
                *tangent = [turned.x, turned.y, turned.z, (w * sign) as f32];
            }
            if skin.is_some() {
                mirrored.push(sign < 0.0);
            }
        }
        Ok(mirrored)
    }

    /// The sums of weighted deltas of an attribute, if any target has it.
    pub(super) fn deltas<const N: usize>(
        &self,
        job: &BakeJob<'_>,
        json: &Primitive,
        name: &str,
        count: usize,
        place: &str,
    ) -> Result<Option<Vec<[f64; N]>>, BakeError> {
        let read = |accessor: &Accessor<'_>| accessor.floats::<N>();
        self.sums(job, json, (name, count), read, place)
    }

    /// The sums of weighted deltas of `COLOR_0`, if any target has it; those without alpha leave
    /// it as it is.
    pub(super) fn color_deltas(
        &self,
        job: &BakeJob<'_>,
        json: &Primitive,
        count: usize,
        place: &str,
    ) -> Result<Option<Vec<[f64; 4]>>, BakeError> {
        self.sums(job, json, ("COLOR_0", count), |accessor| accessor.colors(0.0), place)
    }

    fn sums<const N: usize>(
        &self,
        job: &BakeJob<'_>,
        json: &Primitive,
        (name, count): (&str, usize),
        read: impl Fn(&Accessor<'_>) -> Result<Vec<[f32; N]>, BakeError>,
        place: &str,
    ) -> Result<Option<Vec<[f64; N]>>, BakeError> {
        let mut sums: Option<Vec<[f64; N]>> = None;
        for (i, (target, &weight)) in json.targets.iter().zip(&self.weights).enumerate() {
            let Some(&index) = target.get(name).filter(|_| weight != 0.0) else { continue };
            job.check()?;
            let place = format!("{place}.targets[{i}].{name}");
            let accessor = Accessor::open(job.source, index, &place)?;
            if accessor.count != count {
                let what = format!("it has {} elements, POSITION {count}", accessor.count);
                return Err(BakeError::at(place, what, "equal counts would be right"));
            }
            let sums = sums.get_or_insert_with(|| vec![[0.0; N]; count]);
            for (at, (sum, delta)) in sums.iter_mut().zip(read(&accessor)?).enumerate() {
                for (sum, delta) in sum.iter_mut().zip(delta) {
                    *sum += weight * f64::from(delta);
                }
                if sum.iter().any(|value| !value.is_finite()) {
                    let what = format!("element {at} is not finite");
                    return Err(BakeError::at(place, what, "finite numbers would be right"));
                }
            }
        }
        Ok(sums)
    }

    /// Four joints of each vertex, for each set that a primitive of `count` vertices has, with
    /// parts that make 1.
    pub(super) fn influences(
        &self,
        job: &BakeJob<'_>,
        json: &Primitive,
        count: usize,
        place: &str,
    ) -> Result<Vec<Vec<Influence>>, BakeError> {
        if self.joints.is_empty() {
            return Ok(Vec::new());
        }
        let skin = self.skin(job, json, place)?;
        let mut sets = vec![vec![Influence::default(); count]; skin.sets.len()];
        for (vertex, parts) in (0..count).map(|vertex| (vertex, skin.parts(vertex))) {
            for (set, at, joint, part) in parts? {
                let influence = &mut sets[set][vertex];
                influence.joints[at] = u16::try_from(joint).map_err(|_| {
                    let what = format!("vertex {vertex} follows joint {joint}");
                    BakeError::at(&skin.place, what, "below 65536 would be right")
                })?;
                influence.weights[at] = part as f32;
            }
        }
        Ok(sets)
    }

    fn skin(
        &self,
        job: &BakeJob<'_>,
        json: &Primitive,
        place: &str,
    ) -> Result<Skin<'_>, BakeError> {
        let mut skin = Skin { pose: self, place: format!("{place}.attributes"), sets: Vec::new() };
        if !has_joints(json) {
            return Ok(skin);
        }
        let count = json.attributes.get("POSITION");
        let count = count.map(|&index| job.source.document.accessors.at(index, place));
        let count = count.transpose()?.map_or(0, |accessor| accessor.count);
        for set in 0.. {
            let index = |name: &str| json.attributes.get(&format!("{name}_{set}"));
            let (Some(&joints), Some(&weights)) = (index("JOINTS"), index("WEIGHTS")) else {
                break;
            };
            job.check()?;
            let joints = Accessor::open(job.source, joints, &format!("{place}.JOINTS_{set}"))?;
            let weights = Accessor::open(job.source, weights, &format!("{place}.WEIGHTS_{set}"))?;
            for (name, accessor) in [("JOINTS", &joints), ("WEIGHTS", &weights)] {
                if accessor.count as u64 != count {
                    let what =
                        format!("{name}_{set} has {} elements, POSITION {count}", accessor.count);
                    return Err(BakeError::at(place, what, "equal counts would be right"));
                }
            }
            skin.sets.push((joints.unsigned::<4>()?, weights.floats::<4>()?));
        }
        Ok(skin)
    }
}

/// Four of each vertex.
type Joints = Vec<[u32; 4]>;
type Weights = Vec<[f32; 4]>;

/// The joints and weights of a primitive's vertices.
struct Skin<'a> {
    pose: &'a Pose,
    place: String,
    /// The joints and weights of `JOINTS_0` and `WEIGHTS_0`, `JOINTS_1` and `WEIGHTS_1`, and so on.
    sets: Vec<(Joints, Weights)>,
}

impl Skin<'_> {
    /// The matrix that moves a vertex: the mean of its joints' matrices by their parts.
    fn matrix(&self, vertex: usize) -> Result<DAffine3, BakeError> {
        if self.sets.is_empty() {
            return Ok(self.pose.rigid);
        }
        let (mut linear, mut translation) = (DMat3::ZERO, DVec3::ZERO);
        for (_, _, joint, part) in self.parts(vertex)? {
            let matrix = self.joint(vertex, joint)?;
            linear += matrix.matrix3 * part;
            translation += matrix.translation * part;
        }
        Ok(DAffine3 { matrix3: linear, translation })
    }

    /// The joints of a vertex: set, place in it, joint and part. Parts are weights, which are made
    /// to sum to 1. A vertex without weights follows the first joint that it names.
    fn parts(&self, vertex: usize) -> Result<Vec<(usize, usize, u32, f64)>, BakeError> {
        let mut parts = Vec::new();
        let mut total = 0.0;
        for (set, (joints, weights)) in self.sets.iter().enumerate() {
            for (at, (joint, weight)) in joints[vertex].iter().zip(weights[vertex]).enumerate() {
                if weight > 0.0 && weight.is_finite() {
                    self.joint(vertex, *joint)?;
                    parts.push((set, at, *joint, f64::from(weight)));
                    total += f64::from(weight);
                }
            }
        }
        let Some((first, _)) = self.sets.first() else { return Ok(parts) };
        if parts.is_empty() {
            self.joint(vertex, first[vertex][0])?;
            return Ok(vec![(0, 0, first[vertex][0], 1.0)]);
        }
        for (.., part) in &mut parts {
            *part /= total;
        }
        Ok(parts)
    }

    fn joint(&self, vertex: usize, joint: u32) -> Result<&DAffine3, BakeError> {
        let count = self.pose.joints.len();
        self.pose.joints.get(joint as usize).ok_or_else(|| {
            let what = format!("vertex {vertex} follows joint {joint}, the skin has {count}");
            BakeError::at(&self.place, what, format!("below {count} would be right"))
        })
    }
}

/// The matrix of cofactors, which turns normals as the matrix turns surfaces: it is the inverse
/// transpose times the determinant, and exists for singular ones too.
fn cofactors(matrix: DMat3) -> DMat3 {
    let [x, y, z] = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
    DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y))
}
