//! Poses: the shapes that skins and morph targets give meshes at rest.
//!
//! A mesh with a skin stands where its joints are; its node's own transform says nothing (glTF
//! 2.0, 3.7.3.3). It becomes a mesh of its own, in a frame near its joints, so that vertices stay
//! small numbers wherever the scene stands. Nodes whose poses are equal share one.
//!
//! ```text
//! world = frame · Σ wᵢ · (frame⁻¹ · jointᵢ · inverseBindᵢ) · (position + Σ weightₖ · deltaₖ)
//! ```

use std::collections::BTreeMap;

use glam::{DAffine3, DMat3, DMat4, DVec3, DVec4};

use super::BakeJob;
use super::accessor::Accessor;
use super::document::{self, Mesh, Primitive};
use super::error::BakeError;
use super::node::Tree;

/// Largest difference of the last row of an inverse bind matrix from 0, 0, 0, 1: exporters write
/// products of f32.
const AFFINE_TOLERANCE: f64 = 1e-3;

/// A mesh of the file as nodes draw it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct MeshUse {
    /// An index into the file's meshes.
    pub mesh: u32,
    /// An index into [`Meshes::poses`]; `None` for a mesh that stays as it is.
    pub pose: Option<u32>,
}

/// A shape at rest.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Pose {
    /// The weight of each morph target; 0 beyond the end.
    pub weights: Vec<f64>,
    /// The frame from the mesh, for each joint; empty without a skin.
    pub joints: Vec<DAffine3>,
    /// The same for primitives that no joint moves.
    pub rigid: DAffine3,
}

/// The meshes that nodes draw, each in each of its poses.
#[derive(Debug, Default)]
pub(super) struct Meshes {
    pub uses: Vec<MeshUse>,
    pub poses: Vec<Pose>,
    known_uses: BTreeMap<MeshUse, u32>,
    known_poses: BTreeMap<Vec<u64>, u32>,
}

impl Meshes {
    /// The pose of a use, if it has any effect on this primitive.
    pub(super) fn pose(&self, of: MeshUse, primitive: &Primitive) -> Option<(u32, &Pose)> {
        let index = of.pose?;
        let pose = self.poses.get(index as usize)?;
        let moves = |(target, weight): (_, &f64)| *weight != 0.0 && !BTreeMap::is_empty(target);
        let is_morphed = primitive.targets.iter().zip(&pose.weights).any(moves);
        (is_morphed || !pose.joints.is_empty()).then_some((index, pose))
    }

    fn add(&mut self, mesh: u32, pose: Pose) -> u32 {
        let has_pose = !pose.joints.is_empty() || pose.weights.iter().any(|&weight| weight != 0.0);
        let pose = has_pose.then(|| {
            let matrices = pose.joints.iter().chain([&pose.rigid]);
            let numbers = matrices.flat_map(DAffine3::to_cols_array);
            let bits = numbers.chain(pose.weights.iter().copied()).map(f64::to_bits);
            let key = std::iter::once(pose.joints.len() as u64).chain(bits).collect();
            *self.known_poses.entry(key).or_insert_with(|| {
                self.poses.push(pose);
                self.poses.len() as u32 - 1
            })
        });
        let used = MeshUse { mesh, pose };
        *self.known_uses.entry(used).or_insert_with(|| {
            self.uses.push(used);
            self.uses.len() as u32 - 1
        })
    }

    /// Adds the mesh of `nodes[index]`. Gives its index among the uses, and where it stands in the
    /// world, if that is not where the node stands.
    pub(super) fn of_node(
        &mut self,
        job: &mut BakeJob<'_>,
        tree: &Tree<'_>,
        index: u32,
        mesh: u32,
    ) -> Result<(u32, Option<DAffine3>), BakeError> {
        let node = &tree.nodes[index as usize];
        let json = job.source.document.meshes.at(mesh, &format!("nodes[{index}].mesh"))?;
        let weights = weights(node, json);
        let mut pose = Pose { weights, ..Pose::default() };
        let Some(skin) = node.skin else { return Ok((self.add(mesh, pose), None)) };
        let place = format!("nodes[{index}].skin");
        let json_skin = job.source.document.skins.at(skin, &place)?;
        let with_joints = json.primitives.iter().filter(|primitive| has_joints(primitive)).count();
        if with_joints == 0 {
            job.warn(&format!("{place}: its mesh has no JOINTS_0 and WEIGHTS_0 and is not moved"));
            return Ok((self.add(mesh, pose), None));
        }
        let is_mixed = with_joints < json.primitives.len();
        let mut bound = joints(job, tree, skin, json_skin, is_mixed)?;
        let points: Vec<DVec3> = bound.matrices.iter().map(|matrix| matrix.translation).collect();
        let anchor = median(&points);
        for matrix in &mut bound.matrices {
            matrix.translation -= anchor;
        }
        pose.joints = bound.matrices;
        if is_mixed {
            pose.rigid = tree.below(None, index)?;
            pose.rigid.translation -= anchor;
        }
        let frame = bound.frame * DAffine3::from_translation(anchor);
        Ok((self.add(mesh, pose), Some(frame)))
    }
}

/// The weights of a node, or else of its mesh; none beyond the last that is not 0.
fn weights(node: &document::Node, mesh: &Mesh) -> Vec<f64> {
    let given = node.weights.as_ref().unwrap_or(&mesh.weights);
    let count = mesh.primitives.iter().map(|primitive| primitive.targets.len()).max().unwrap_or(0);
    let mut weights: Vec<f64> = given.iter().copied().take(count).collect();
    while weights.last() == Some(&0.0) {
        weights.pop();
    }
    weights
}

fn has_joints(primitive: &Primitive) -> bool {
    let has = |name: &str| primitive.attributes.contains_key(name);
    has("JOINTS_0") && has("WEIGHTS_0")
}

/// The component-wise median: most joints of a skin stand near each other, whatever one does.
fn median(points: &[DVec3]) -> DVec3 {
    let component = |axis: usize| {
        let mut values: Vec<f64> = points.iter().map(|point| point[axis]).collect();
        values.sort_unstable_by(f64::total_cmp);
        values.get(values.len() / 2).copied().filter(|value| value.is_finite()).unwrap_or(0.0)
    };
    DVec3::new(component(0), component(1), component(2))
}

/// A skin's joints at rest.
struct Bound {
    /// The world from the frame: the last node that all joints stand below, or are.
    frame: DAffine3,
    /// The frame from the mesh, for each joint.
    matrices: Vec<DAffine3>,
}

/// Joint · inverse bind matrix of each joint of a skin, in the frame of their last common parent,
/// or in the world. Below equal parents, copies of a skeleton give equal bits.
fn joints(
    job: &BakeJob<'_>,
    tree: &Tree<'_>,
    skin: u32,
    json: &document::Skin,
    in_world: bool,
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
    let top = common.and_then(|common| common.last().copied()).filter(|_| !in_world);
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
    Ok(Bound { frame, matrices })
}

/// What takes a mesh into the space of each joint; identities if the skin has none.
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
            for (at, (sum, delta)) in sums.iter_mut().zip(accessor.floats::<N>()?).enumerate() {
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
    /// Of JOINTS_0 and WEIGHTS_0, and so on.
    sets: Vec<(Joints, Weights)>,
}

impl Skin<'_> {
    /// What moves a vertex: the mean of its joints' matrices by their weights, which are made to
    /// sum to 1. A vertex without weights follows the first joint that it names.
    fn matrix(&self, vertex: usize) -> Result<DAffine3, BakeError> {
        let Some((first, _)) = self.sets.first() else { return Ok(self.pose.rigid) };
        let used = self.sets.iter().flat_map(|(joints, weights)| {
            let weights = weights[vertex].map(|weight| weight.max(0.0));
            joints[vertex].into_iter().zip(weights)
        });
        let used = used.filter(|(_, weight)| *weight > 0.0 && weight.is_finite());
        let (mut linear, mut translation, mut total) = (DMat3::ZERO, DVec3::ZERO, 0.0);
        for (joint, weight) in used {
            let (matrix, weight) = (self.joint(vertex, joint)?, f64::from(weight));
            linear += matrix.matrix3 * weight;
            translation += matrix.translation * weight;
            total += weight;
        }
        if total == 0.0 {
            return self.joint(vertex, first[vertex][0]).copied();
        }
        let share = total.recip();
        Ok(DAffine3 { matrix3: linear * share, translation: translation * share })
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
