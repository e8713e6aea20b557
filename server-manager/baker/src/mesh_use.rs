//! The meshes that nodes draw: each in each of its poses, and once for each node where clips or
//! edits bend it.

use std::collections::BTreeMap;

use glam::{DAffine3, DVec3};
use polyptych_scene::Deformation;

use super::BakeJob;
use super::animation::ClipTargets;
use super::deformation::{self, BentMesh};
use super::document::{self, Document, Mesh, Primitive};
use super::error::BakeError;
use super::node::Tree;
use super::pose::{Pose, has_joints, joints, median};

/// Most vertices of all meshes with skins, counted for each node that draws one, if edits are to
/// bend them where no clip does: some detailed figures. What is bent has no levels of detail, and
/// shares nothing with its copies, which a crowd that stands still must.
const EDITED_VERTICES_MAX: u64 = 1 << 18;

/// Most joints that the vertices of a bent mesh can name.
const JOINTS_MAX: usize = 1 << 16;

/// A mesh of the file as nodes draw it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct MeshUse {
    /// An index into the file's meshes.
    pub mesh: u32,
    /// An index into [`Meshes::poses`]; `None` for a mesh that stays as it is.
    pub pose: Option<u32>,
    /// An index into [`Meshes::bent`]; `None` for a mesh that is never bent.
    pub bent: Option<u32>,
}

/// The meshes that nodes draw, each in each of its poses.
#[derive(Debug, Default)]
pub(super) struct Meshes {
    pub uses: Vec<MeshUse>,
    pub poses: Vec<Pose>,
    pub bent: Vec<BentMesh>,
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

    /// The bent mesh of a use, with its pose at rest, if anything bends it.
    pub(super) fn bent(&self, of: MeshUse) -> Option<(&BentMesh, Pose)> {
        let bent = self.bent.get(of.bent? as usize)?;
        let pose = of.pose.and_then(|pose| self.poses.get(pose as usize));
        Some((bent, pose.cloned().unwrap_or_default()))
    }

    /// The deformations of the scene's meshes, from the indices of uses in the scene's meshes, and
    /// of nodes of the file among the animated ones.
    pub(super) fn deformations(
        &self,
        mesh_of: &BTreeMap<u32, u32>,
        animated: &BTreeMap<u32, u32>,
        meshes: &[polyptych_scene::Mesh],
    ) -> Vec<Deformation> {
        let one = |(number, used): (u32, &MeshUse)| {
            let (bent, mesh) = (self.bent.get(used.bent? as usize)?, *mesh_of.get(&number)?);
            let is_drawn = meshes.get(mesh as usize).is_some_and(|of| !of.primitives.is_empty());
            let animated = animated.get(&bent.file_node).copied();
            let weights_of = animated.filter(|_| !bent.keeps_weights);
            is_drawn.then(|| bent.deformation(mesh, weights_of))
        };
        (0..).zip(&self.uses).filter_map(one).collect()
    }

    /// Tells each bent mesh which node of the scene draws it.
    pub(super) fn set_nodes(&mut self, nodes: &[polyptych_scene::Node]) {
        for (place, node) in (0..).zip(nodes) {
            let used = node.mesh.and_then(|used| self.uses.get(used as usize));
            if let Some(bent) = used.and_then(|used| self.bent.get_mut(used.bent? as usize)) {
                bent.node = place;
            }
        }
    }

    fn add(&mut self, mesh: u32, pose: Pose, bent: Option<BentMesh>) -> u32 {
        let bent = bent.map(|bent| {
            self.bent.push(bent);
            self.bent.len() as u32 - 1
        });
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
        let used = MeshUse { mesh, pose, bent };
        *self.known_uses.entry(used).or_insert_with(|| {
            self.uses.push(used);
            self.uses.len() as u32 - 1
        })
    }

    /// Adds the mesh of `nodes[index]`, which has no skin. Gives its index among the uses.
    pub(super) fn of_node(
        &mut self,
        job: &BakeJob<'_>,
        (node, index): (&document::Node, u32),
        mesh: u32,
        is_morphing: bool,
    ) -> Result<u32, BakeError> {
        let json = job.source.document.meshes.at(mesh, &format!("nodes[{index}].mesh"))?;
        let pose = Pose { weights: weights(node, json), ..Pose::default() };
        let bent = is_morphing.then(|| BentMesh::new(index, &pose, target_count(json)));
        Ok(self.add(mesh, pose, bent))
    }

    /// Adds the mesh of a node with a skin, whose joints edits may bend, too. Gives its index among
    /// the uses, and where it stands.
    pub(super) fn of_skinned_node(
        &mut self,
        job: &mut BakeJob<'_>,
        tree: &Tree<'_>,
        (index, mesh): (u32, u32),
        (clips, edits_bend): (&ClipTargets, bool),
        place_of: &[Option<u32>],
    ) -> Result<(u32, SkinnedPlace), BakeError> {
        let node = &tree.nodes[index as usize];
        let is_morphing = clips.change_weights_of(index);
        let unmoved = |this: &mut Self, job: &BakeJob<'_>| {
            let used = this.of_node(job, (node, index), mesh, is_morphing)?;
            Ok((used, SkinnedPlace::AtItsNode))
        };
        let Some(skin) = node.skin else { return unmoved(self, job) };
        let json = job.source.document.meshes.at(mesh, &format!("nodes[{index}].mesh"))?;
        let place = format!("nodes[{index}].skin");
        let json_skin = job.source.document.skins.at(skin, &place)?;
        let with_joints = json.primitives.iter().filter(|primitive| has_joints(primitive)).count();
        if with_joints == 0 {
            job.warn(&format!("{place}: its mesh has no JOINTS_0 and WEIGHTS_0 and is not moved"));
            return unmoved(self, job);
        }
        let is_mixed = with_joints < json.primitives.len();
        // What hides the skeleton alone must not hide the mesh: it hangs above that.
        let own = tree.chain(index);
        let is_hidden = |at: u32| !tree.nodes[at as usize].extensions.visibility.visible;
        let ends_chain =
            |at: u32| is_mixed || (is_hidden(at) || clips.hide(at)) && !own.contains(&at);
        let mut bound = joints(job, tree, skin, json_skin, ends_chain)?;
        let points: Vec<DVec3> = bound.matrices.iter().map(|matrix| matrix.translation).collect();
        let anchor = median(&points);
        for matrix in &mut bound.matrices {
            matrix.translation -= anchor;
        }
        let weights = weights(node, json);
        let mut pose = Pose { weights, joints: bound.matrices, rigid: DAffine3::IDENTITY };
        if is_mixed {
            pose.rigid = tree.below(None, index)?;
            pose.rigid.translation -= anchor;
        }
        let place_of = |node: u32| place_of.get(node as usize).copied().flatten();
        let bones = json_skin.joints.iter().copied().chain(is_mixed.then_some(index));
        let is_moved = is_morphing || clips.move_below(tree, bound.top, bones);
        let is_bent = is_moved || (edits_bend && json_skin.joints.len() <= JOINTS_MAX);
        let rigid = is_mixed.then_some(index);
        let skin = || {
            let (top, binds) = (bound.top, &bound.inverse_binds);
            deformation::skin((top, rigid), &json_skin.joints, binds, place_of)
        };
        let bent = is_bent.then(skin).flatten().map(|skin| {
            // Edits change no weights: targets without one are of no use.
            let targets = if is_moved { target_count(json) } else { pose.weights.len() };
            let bent = BentMesh::new(index, &pose, targets);
            BentMesh { skin: Some(skin), keeps_weights: !is_moved, ..bent }
        });
        if is_moved && bent.is_none() {
            job.warn(&format!("{place}: its joints are not in the shown scene and do not move"));
        }
        let below = bound.top.and_then(place_of);
        let frame = if below.is_some() { DAffine3::IDENTITY } else { bound.frame };
        let local = frame * DAffine3::from_translation(anchor);
        Ok((self.add(mesh, pose, bent), SkinnedPlace::Below(below, local)))
    }
}

/// Returns whether edits may bend the meshes that nodes with skins draw, given for each node.
pub(super) fn can_edits_bend(document: &Document, meshes: impl Iterator<Item = u32>) -> bool {
    let mut left = EDITED_VERTICES_MAX;
    let parts = meshes.filter_map(|mesh| document.meshes.get(mesh as usize));
    for part in parts.flat_map(|mesh| &mesh.primitives) {
        let positions = part.attributes.get("POSITION").copied();
        let accessor = positions.and_then(|index| document.accessors.get(index as usize));
        // One at least, so that a small file is not walked through for long.
        let count = accessor.map_or(1, |accessor| accessor.count.max(1));
        let Some(rest) = left.checked_sub(count) else { return false };
        left = rest;
    }
    true
}

/// The place of a mesh whose node has a skin.
pub(super) enum SkinnedPlace {
    /// The place of the node: its skin moves nothing.
    AtItsNode,
    /// In the space of a node of the scene, or of the scene itself.
    Below(Option<u32>, DAffine3),
}

/// The most morph targets that a part of a mesh has.
fn target_count(json: &Mesh) -> usize {
    json.primitives.iter().map(|primitive| primitive.targets.len()).max().unwrap_or(0)
}

/// The weights of a node, or else of its mesh; none beyond the last that is not 0.
fn weights(node: &document::Node, mesh: &Mesh) -> Vec<f64> {
    let given = node.weights.as_ref().unwrap_or(&mesh.weights);
    let mut weights: Vec<f64> = given.iter().copied().take(target_count(mesh)).collect();
    while weights.last() == Some(&0.0) {
        weights.pop();
    }
    weights
}
