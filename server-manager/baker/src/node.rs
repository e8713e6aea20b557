//! Nodes: from glTF's tree to a list in which parents stand before their children.
//!
//! Transforms are composed in f64 from the JSON's own numbers. Nothing recurses: a tree may be
//! as deep as the file is long.

use std::collections::{BTreeMap, BTreeSet};

use glam::{DAffine3, DMat4, DQuat, DVec3, Quat, Vec3};
use polyptych_scene::limits::DRAWS_MAX;
use polyptych_scene::{Instance, Node};
use polyptych_text::counted;

use super::accessor::Accessor;
use super::animation::ClipTargets;
use super::document::{self, Instancing};
use super::error::BakeError;
use super::extras::ExtrasList;
use super::mesh_use::{Meshes, SkinnedPlace, can_edits_bend};
use super::{BakeJob, camera, uri};

/// Maximum difference of a matrix's last row from 0, 0, 0, 1.
const AFFINE_TOLERANCE: f64 = 1e-5;

/// The nodes of the shown scene, and the meshes that they draw.
#[derive(Debug, Default)]
pub(super) struct Placed {
    /// Their meshes are indices into [`Meshes::uses`], their lights the file's own.
    pub nodes: Vec<Node>,
    /// The node of the file that each of `nodes` comes from.
    pub file_nodes: Vec<u32>,
    pub meshes: Meshes,
    pub extras: ExtrasList,
    /// The place among `nodes` of each node of the file that is there.
    pub place_of: Vec<Option<u32>>,
    /// For each node of the file that clips hide and show the places of itself and of all that is
    /// hidden with it and does not hang from it here; rising.
    pub hidden_with: BTreeMap<u32, Vec<u32>>,
}

/// A mesh whose node has a skin: where it stands is known once all nodes are.
struct Skinned {
    /// The node of the file.
    node: u32,
    mesh: u32,
    /// The node of the scene.
    place: u32,
    is_hidden: bool,
}

/// Reads the shown scene. A mesh that stands elsewhere than its node becomes a node of its own,
/// behind all others. Edits bend meshes with skins only if `edits_bend`.
pub(super) fn read(
    job: &mut BakeJob<'_>,
    clips: &ClipTargets,
    edits_bend: bool,
) -> Result<Placed, BakeError> {
    let json: &[document::Node] = &job.source.document.nodes;
    let parents = parents(json)?;
    check_cycles(json, &parents)?;
    let roots = roots(job, &parents)?;
    let tree = Tree { nodes: json, parents: &parents };
    let mut is_seen = vec![false; json.len()];
    let mut placed = Placed { place_of: vec![None; json.len()], ..Placed::default() };
    let mut skinned = Vec::new();
    // Each copy is a draw at least, and 44 bytes of the manifest.
    let mut instances_left = DRAWS_MAX as usize;
    let mut stack: Vec<(u32, Option<u32>, bool)> =
        roots.iter().rev().map(|&r| (r, None, false)).collect();
    while let Some((index, parent, is_below_hidden)) = stack.pop() {
        if placed.nodes.len().is_multiple_of(1024) {
            job.step("nodes", placed.nodes.len() as u64, json.len() as u64)?;
        }
        let Some(node) = json.get(index as usize) else {
            return Err(BakeError::beyond("scenes.nodes", "nodes", index.into(), json.len()));
        };
        if std::mem::replace(&mut is_seen[index as usize], true) {
            let what = format!("it has {} twice, or below another root", title(json, index));
            return Err(BakeError::at("scenes.nodes", what, "each root once would be right"));
        }
        let place = placed.nodes.len() as u32;
        let mut made = convert(job, node, index, parent, instances_left)?;
        instances_left -= made.instances.len();
        let camera = camera::attribute(job, index, node);
        // What clips hide is hidden by them also where none is played.
        let is_off = !node.extensions.visibility.visible && !clips.hide(index);
        placed.extras.add((place, is_off), node, camera);
        let is_hidden = is_below_hidden || is_off;
        if clips.hide(index) {
            placed.hidden_with.insert(index, vec![place]);
        }
        if let Some(mesh) = made.mesh.take_if(|_| node.skin.is_some()) {
            skinned.push(Skinned { node: index, mesh, place, is_hidden });
        } else {
            let is_morphing = clips.change_weights_of(index);
            let used = |mesh| placed.meshes.of_node(job, (node, index), mesh, is_morphing);
            made.mesh = made.mesh.map(used).transpose()?;
        }
        placed.place_of[index as usize] = Some(place);
        placed.nodes.push(made);
        placed.file_nodes.push(index);
        let children = node.children.iter().rev();
        stack.extend(children.map(|&child| (child, Some(place), is_hidden)));
    }
    let skinned_meshes = skinned.iter().map(|one| one.mesh);
    let edits_bend = edits_bend && can_edits_bend(&job.source.document, skinned_meshes);
    for one in skinned {
        placed.add_skinned(job, &tree, (clips, edits_bend), &one)?;
    }
    placed.meshes.set_nodes(&placed.nodes);
    Ok(placed)
}

impl Placed {
    /// Adds the mesh of a node with a skin, as a node of its own where it stands elsewhere.
    fn add_skinned(
        &mut self,
        job: &mut BakeJob<'_>,
        tree: &Tree<'_>,
        bending: (&ClipTargets, bool),
        one: &Skinned,
    ) -> Result<(), BakeError> {
        let (node, place_of) = ((one.node, one.mesh), &self.place_of);
        let (used, place) = self.meshes.of_skinned_node(job, tree, node, bending, place_of)?;
        let at_node = &mut self.nodes[one.place as usize];
        let SkinnedPlace::Below(parent, local) = place else {
            at_node.mesh = Some(used);
            return Ok(());
        };
        if !std::mem::take(&mut at_node.instances).is_empty() {
            let index = one.node;
            job.warn(&format!("nodes[{index}]: a mesh with a skin is drawn once only"));
        }
        let name = at_node.name.clone();
        let place = self.nodes.len() as u32;
        if one.is_hidden {
            self.extras.hide(place);
        }
        for above in tree.chain(one.node) {
            if let Some(places) = self.hidden_with.get_mut(&above) {
                places.push(place);
            }
        }
        self.nodes.push(Node { name, parent, local, mesh: Some(used), ..Node::default() });
        self.file_nodes.push(one.node);
        Ok(())
    }
}

/// The file's nodes, a tree without cycles.
pub(super) struct Tree<'a> {
    pub nodes: &'a [document::Node],
    parents: &'a [Option<u32>],
}

impl Tree<'_> {
    /// The node that a node of the file hangs from.
    pub(super) fn parent(&self, index: u32) -> Option<u32> {
        self.parents.get(index as usize).copied().flatten()
    }

    /// The nodes from a root down to this one, which is the last.
    pub(super) fn chain(&self, index: u32) -> Vec<u32> {
        let parent = |&at: &u32| self.parents.get(at as usize).copied().flatten();
        let mut chain: Vec<u32> = std::iter::successors(Some(index), parent).collect();
        chain.reverse();
        chain
    }

    /// The space of `top`, or the world, from the space of a node below it.
    pub(super) fn below(&self, top: Option<u32>, index: u32) -> Result<DAffine3, BakeError> {
        let chain = self.chain(index);
        let first = top.and_then(|top| chain.iter().position(|&at| at == top)).map_or(0, |i| i + 1);
        let mut product = DAffine3::IDENTITY;
        for (i, &at) in chain[first..].iter().enumerate() {
            let local = local(&self.nodes[at as usize], &format!("nodes[{at}]"))?;
            product = if i == 0 { local } else { product * local };
        }
        Ok(product)
    }
}

/// Returns the name of a node in messages.
fn title(json: &[document::Node], index: u32) -> String {
    let name = json.get(index as usize).map_or("", |node| node.name.as_str());
    format!("nodes[{index}] '{}'", uri::shorten(name))
}

fn parents(json: &[document::Node]) -> Result<Vec<Option<u32>>, BakeError> {
    let mut parents = vec![None; json.len()];
    for (i, node) in json.iter().enumerate() {
        for &child in &node.children {
            let Some(slot) = parents.get_mut(child as usize) else {
                let place = format!("nodes[{i}].children");
                return Err(BakeError::beyond(place, "nodes", child.into(), json.len()));
            };
            if let Some(other) = slot.replace(i as u32) {
                let (a, b) = (title(json, other), title(json, i as u32));
                let what = format!("it has two parents, {a} and {b}");
                return Err(BakeError::at(title(json, child), what, "one would be right"));
            }
        }
    }
    Ok(parents)
}

/// Walks up from each node; a walk that meets itself is a cycle.
fn check_cycles(json: &[document::Node], parents: &[Option<u32>]) -> Result<(), BakeError> {
    let mut walk_of = vec![usize::MAX; parents.len()];
    for start in 0..parents.len() {
        let mut at = Some(start as u32);
        while let Some(index) = at {
            match walk_of[index as usize] {
                usize::MAX => walk_of[index as usize] = start,
                walk if walk == start => return Err(cycle(json, parents, index)),
                _ => break,
            }
            at = parents[index as usize];
        }
    }
    Ok(())
}

fn cycle(json: &[document::Node], parents: &[Option<u32>], index: u32) -> BakeError {
    const NAMED_MAX: usize = 6;
    let mut names = vec![title(json, index)];
    let mut at = parents[index as usize];
    while let Some(next) = at.filter(|&next| next != index && names.len() < NAMED_MAX) {
        names.push(title(json, next));
        at = parents[next as usize];
    }
    let what = format!("the tree has a cycle: {} stands below itself", names.join(", below "));
    BakeError::at(format!("nodes[{index}]"), what, "a tree would be right")
}

fn roots(job: &mut BakeJob<'_>, parents: &[Option<u32>]) -> Result<Vec<u32>, BakeError> {
    if let Some(index) = job.choice.index {
        return Ok(job.source.document.scenes.at(index, "scene")?.nodes.clone());
    }
    // Coarser levels of a node stand in its place, not beside it.
    let coarser = job.source.document.nodes.iter().flat_map(|node| node.extensions.coarser());
    let coarser: BTreeSet<u32> = coarser.collect();
    let roots = (0u32..).zip(parents).filter(|(_, parent)| parent.is_none());
    let roots = roots.map(|(index, _)| index).filter(|index| !coarser.contains(index));
    let roots: Vec<u32> = roots.collect();
    if !roots.is_empty() {
        job.warn("scenes: there is none, so all nodes are shown");
    }
    Ok(roots)
}

fn convert(
    job: &mut BakeJob<'_>,
    node: &document::Node,
    index: u32,
    parent: Option<u32>,
    instances_left: usize,
) -> Result<Node, BakeError> {
    let place = format!("nodes[{index}]");
    let document = &job.source.document;
    let light = node.extensions.light.as_ref().map(|light| light.light);
    if let Some(light) = light {
        let place = format!("{place}.extensions.KHR_lights_punctual");
        document.extensions.lights.lights.at(light, &place)?;
    }
    let mut mesh = node.mesh;
    let instances = match &node.extensions.instancing {
        Some(instancing) if mesh.is_some() => {
            let instances = instances(job, instancing, &place, instances_left)?;
            if instances.is_empty() {
                let place = format!("{place}.extensions.EXT_mesh_gpu_instancing");
                job.leave_out(&place, "it has no instances", "one instance draws the mesh once");
                mesh = None;
            }
            instances
        }
        _ => Vec::new(),
    };
    let local = local(node, &place)?;
    // Which crowd it and its copies are in, and what is a sky, is found once all nodes are there.
    let name = node.name.clone();
    Ok(Node { name, parent, local, mesh, light, instances, ..Node::default() })
}

fn local(node: &document::Node, place: &str) -> Result<DAffine3, BakeError> {
    let local = if let Some(matrix) = &node.matrix {
        let matrix = DMat4::from_cols_array(matrix);
        let row = matrix.row(3) - glam::DVec4::W;
        if row.abs().max_element() > AFFINE_TOLERANCE {
            let place = format!("{place}.matrix");
            let what = "its last row is not 0, 0, 0, 1";
            return Err(BakeError::at(place, what, "an affine matrix would be right"));
        }
        DAffine3::from_mat4(matrix)
    } else {
        let translation = node.translation.map_or(DVec3::ZERO, DVec3::from);
        let scale = node.scale.map_or(DVec3::ONE, DVec3::from);
        let rotation = node.rotation.map_or(DQuat::IDENTITY, DQuat::from_array);
        let rotation = unit(rotation, &format!("{place}.rotation"))?;
        DAffine3::from_scale_rotation_translation(scale, rotation, translation)
    };
    if local.is_finite() {
        return Ok(local);
    }
    Err(BakeError::at(place, "its transform overflows", "finite numbers would be right"))
}

fn unit(rotation: DQuat, place: &str) -> Result<DQuat, BakeError> {
    // Scaled first, so that the squares of large and small components stay in range.
    let largest = rotation.to_array().into_iter().fold(0.0f64, |a, b| a.max(b.abs()));
    if !largest.is_normal() {
        let what = "the quaternion has no direction";
        return Err(BakeError::at(place, what, "a unit quaternion would be right"));
    }
    Ok((rotation * (1.0 / largest)).normalize())
}

fn instances(
    job: &mut BakeJob<'_>,
    instancing: &Instancing,
    place: &str,
    left: usize,
) -> Result<Vec<Instance>, BakeError> {
    let place = format!("{place}.extensions.EXT_mesh_gpu_instancing");
    let mut count = None;
    for (name, &index) in &instancing.attributes {
        let accessor = Accessor::open(job.source, index, &format!("{place}.{name}"))?;
        let expected = *count.get_or_insert(accessor.count);
        if accessor.count != expected {
            let what =
                format!("{name} has {}, another {expected}", counted(accessor.count, "element"));
            return Err(BakeError::at(place, what, "equal counts would be right"));
        }
        if expected > left {
            let before = DRAWS_MAX as usize - left;
            let what = format!("{expected} instances, {before} before them");
            let right = format!("a scene can have {DRAWS_MAX}");
            return Err(BakeError::at(place, what, right));
        }
    }
    let translations = floats::<3>(job, instancing, "TRANSLATION", &place)?;
    let rotations = floats::<4>(job, instancing, "ROTATION", &place)?;
    let scales = floats::<3>(job, instancing, "SCALE", &place)?;
    let one = |i: usize| {
        let rotation = match &rotations {
            Some(values) => unit(Quat::from_array(values[i]).as_dquat(), &place)?.as_quat(),
            None => Quat::IDENTITY,
        };
        Ok(Instance {
            translation: translations.as_ref().map_or(Vec3::ZERO, |values| values[i].into()),
            rotation,
            scale: scales.as_ref().map_or(Vec3::ONE, |values| values[i].into()),
            crowd: 0.0,
        })
    };
    (0..count.unwrap_or(0)).map(one).collect()
}

fn floats<const N: usize>(
    job: &BakeJob<'_>,
    instancing: &Instancing,
    name: &str,
    place: &str,
) -> Result<Option<Vec<[f32; N]>>, BakeError> {
    let Some(&index) = instancing.attributes.get(name) else { return Ok(None) };
    let accessor = Accessor::open(job.source, index, place)?;
    let values = accessor.floats::<N>()?;
    match values.iter().flatten().position(|value| !value.is_finite()) {
        None => Ok(Some(values)),
        Some(at) => {
            let what = format!("element {} of {name} is not finite", at / N);
            Err(BakeError::at(accessor.place, what, "finite numbers would be right"))
        }
    }
}
