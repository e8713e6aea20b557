//! Animations: clips of the file as functions of time.
//!
//! A channel that is not as it should be is left out with a note, and the rest of its clip is
//! played.

use std::collections::{BTreeMap, BTreeSet};

use glam::{DQuat, DVec3};
use polyptych_scene::limits::NODE_NAME_BYTES_MAX;
use polyptych_scene::{
    AnimatedNode, AnimatedPath, AnimatedProperty, Animations, CLIPS_MAX, Channel, Clip,
    Interpolation, Node, PropertyKind,
};

use super::BakeJob;
use super::accessor::Accessor;
use super::animated_property::{SceneParts, together};
use super::animation_json::{Animation, AnimationChannel, AnimationSampler, AnimationTarget};
use super::animation_pointer::{self, ChannelTarget};
use super::document;
use super::error::BakeError;
use super::node::Tree;
use super::uri;

/// Largest difference of a matrix from its translation, rotation and scale, in parts of its largest
/// number: exporters write f32.
const SHEAR_TOLERANCE: f64 = 1e-5;

/// The nodes of the file that clips name.
#[derive(Debug, Default)]
pub(super) struct ClipTargets {
    moved: BTreeSet<u32>,
    morphed: BTreeSet<u32>,
    /// Those that are hidden and shown.
    blinking: BTreeSet<u32>,
    /// Materials of the file, each with an extension of which a property is changed.
    extended: BTreeSet<(u32, &'static str)>,
}

impl ClipTargets {
    /// The nodes that clips of a file name, whether or not they can be played.
    pub(super) fn of(document: &document::Document) -> Self {
        let mut targets = Self::default();
        for channel in document.animations.iter().flat_map(|clip| &clip.channels) {
            // What is wrong with others is said where they are read.
            let Ok(Some(target)) = target_of(&channel.target, "") else { continue };
            match target {
                ChannelTarget::Node(node, AnimatedPath::Weights) => {
                    targets.morphed.insert(node);
                }
                ChannelTarget::Node(node, _) => {
                    targets.moved.insert(node);
                }
                ChannelTarget::Property(PropertyKind::Visible, node) => {
                    targets.blinking.insert(node);
                }
                ChannelTarget::Property(PropertyKind::Material(property), material) => {
                    let name = animation_pointer::extension_of(property);
                    targets.extended.extend(name.map(|name| (material, name)));
                }
                ChannelTarget::Property(PropertyKind::Light(_), _) => {}
            }
        }
        targets
    }

    /// Returns whether a clip changes the weights of a node's morph targets.
    pub(super) fn change_weights_of(&self, node: u32) -> bool {
        self.morphed.contains(&node)
    }

    /// Returns whether a clip hides or shows a node.
    pub(super) fn hide(&self, node: u32) -> bool {
        self.blinking.contains(&node)
    }

    /// Returns whether a clip changes a property of an extension of a material.
    pub(super) fn change_extension(&self, material: u32, name: &'static str) -> bool {
        self.extended.contains(&(material, name))
    }

    /// Returns whether a clip moves one of these nodes, or one between them and `top`.
    pub(super) fn move_below(
        &self,
        tree: &Tree<'_>,
        top: Option<u32>,
        nodes: impl Iterator<Item = u32>,
    ) -> bool {
        let mut seen = BTreeSet::new();
        for node in nodes {
            let mut next = Some(node).filter(|_| Some(node) != top);
            while let Some(node) = next.filter(|node| seen.insert(*node)) {
                if self.moved.contains(&node) {
                    return true;
                }
                next = tree.parent(node).filter(|parent| Some(*parent) != top);
            }
        }
        false
    }
}

/// The target of a channel; `None` if it changes nothing.
///
/// # Errors
/// A path or pointer that is none, or that names what is not changed here.
fn target_of(target: &AnimationTarget, place: &str) -> Result<Option<ChannelTarget>, BakeError> {
    let place = format!("{place}.target");
    let path = match target.path.as_str() {
        "pointer" => {
            let Some(pointer) = &target.extensions.pointer else {
                let right = "KHR_animation_pointer would be right";
                return Err(BakeError::at(place, "it names no pointer", right));
            };
            return animation_pointer::parse(&pointer.pointer, &place).map(Some);
        }
        "translation" => AnimatedPath::Translation,
        "rotation" => AnimatedPath::Rotation,
        "scale" => AnimatedPath::Scale,
        "weights" => AnimatedPath::Weights,
        other => {
            let what = format!("path '{}' does not exist", uri::shorten(other));
            let right = "translation, rotation, scale, weights or pointer would be right";
            return Err(BakeError::at(place, what, right));
        }
    };
    Ok(target.node.map(|node| ChannelTarget::Node(node, path)))
}

/// The clips of a file that has these parts in the scene.
pub(super) fn read(
    job: &mut BakeJob<'_>,
    parts: SceneParts<'_>,
    nodes: &[Node],
) -> Result<(Animations, BTreeMap<u32, u32>), BakeError> {
    let (document, place_of) = (&job.source.document, parts.place_of);
    let mut targets: BTreeMap<u32, AnimatedNode> = BTreeMap::new();
    let mut properties: BTreeMap<(PropertyKind, u32), AnimatedProperty> = BTreeMap::new();
    let mut drafts = Vec::new();
    if document.animations.len() > CLIPS_MAX {
        let count = document.animations.len();
        job.warn(&format!("animations: {count}, of which the first {CLIPS_MAX} can be played"));
    }
    for (at, json) in document.animations.iter().take(CLIPS_MAX).enumerate() {
        let mut channels = BTreeMap::new();
        for (number, channel) in json.channels.iter().enumerate() {
            let place = format!("animations[{at}].channels[{number}]");
            match read_channel(job, json, channel, parts, &place) {
                Ok(None) => {}
                Ok(Some((target, draft, changed))) => {
                    if let ChannelTarget::Node(node, _) = target {
                        let json = &document.nodes[node as usize];
                        let rest = || AnimatedNode {
                            weights: target_weights(job, node),
                            ..at_rest(json, nodes, place_of, node)
                        };
                        targets.entry(node).or_insert_with(rest);
                    }
                    properties.extend(changed);
                    if channels.insert(target, draft).is_some() {
                        job.warn(&format!("{place}: its clip moves this twice; the last counts"));
                    }
                }
                Err(BakeError::Cancelled) => return Err(BakeError::Cancelled),
                Err(error) => job.warn(&format!("{place}: not played: {error}")),
            }
        }
        // It stands in every list of clips.
        let end = json.name.floor_char_boundary(NODE_NAME_BYTES_MAX);
        drafts.push((json.name[..end].to_owned(), channels));
    }
    keep_hidden(job, parts, &mut properties)?;
    // In the order of the scene's nodes.
    let mut sorted: Vec<(u32, AnimatedNode)> = targets.into_iter().collect();
    sorted.sort_by_key(|(_, target)| target.node);
    let index_of: BTreeMap<u32, u32> = sorted.iter().map(|(node, _)| *node).zip(0..).collect();
    let property_of: BTreeMap<(PropertyKind, u32), u32> =
        properties.keys().copied().zip(0..).collect();
    let clip = |(name, channels): (String, BTreeMap<ChannelTarget, Channel>)| {
        let numbered = channels.into_iter().filter_map(|(target, channel)| {
            let target = match target {
                ChannelTarget::Node(node, _) => *index_of.get(&node)?,
                ChannelTarget::Property(kind, source) => *property_of.get(&(kind, source))?,
            };
            Some(Channel { target, ..channel })
        });
        Clip { name, channels: numbered.collect() }
    };
    let clips = drafts.into_iter().map(clip).collect();
    let nodes = sorted.into_iter().map(|(_, target)| target).collect();
    let properties = properties.into_values().collect();
    Ok((Animations { clips, nodes, properties }, index_of))
}

/// Adds what hides nodes that are hidden in the file although no clip that could show them is
/// played.
fn keep_hidden(
    job: &BakeJob<'_>,
    parts: SceneParts<'_>,
    properties: &mut BTreeMap<(PropertyKind, u32), AnimatedProperty>,
) -> Result<(), BakeError> {
    for node in parts.hidden_with.keys() {
        let property = parts.property(job, PropertyKind::Visible, *node, "nodes")?;
        if let Some(hidden) = property.filter(|of| of.rest == [0.0]) {
            properties.entry((PropertyKind::Visible, *node)).or_insert(hidden);
        }
    }
    Ok(())
}

/// The weights at rest of all morph targets of a node's mesh.
fn target_weights(job: &BakeJob<'_>, node: u32) -> Vec<f64> {
    let document = &job.source.document;
    let Some(json) = document.nodes.get(node as usize) else { return Vec::new() };
    let Some(mesh) = json.mesh.and_then(|mesh| document.meshes.get(mesh as usize)) else {
        return Vec::new();
    };
    let count = mesh.primitives.iter().map(|primitive| primitive.targets.len()).max();
    let given = json.weights.as_ref().unwrap_or(&mesh.weights);
    let mut weights: Vec<f64> = given.clone();
    weights.resize(count.unwrap_or(0), 0.0);
    weights
}

/// A node as it stands without clips. One that has a matrix is taken apart.
fn at_rest(
    json: &document::Node,
    nodes: &[Node],
    place_of: &[Option<u32>],
    node: u32,
) -> AnimatedNode {
    let place = place_of.get(node as usize).copied().flatten().unwrap_or(0);
    let local = nodes.get(place as usize).map(|node| node.local).unwrap_or_default();
    let (scale, rotation, translation) = if json.matrix.is_some() {
        local.to_scale_rotation_translation()
    } else {
        let rotation = json.rotation.map_or(DQuat::IDENTITY, DQuat::from_array).normalize();
        let scale = json.scale.map_or(DVec3::ONE, DVec3::from);
        (scale, rotation, local.translation)
    };
    let rotation = if rotation.is_finite() { rotation } else { DQuat::IDENTITY };
    AnimatedNode { node: place, translation, rotation, scale, weights: Vec::new() }
}

/// The properties that a channel changes, and those that are not used without them.
type ChangedProperties = Vec<((PropertyKind, u32), AnimatedProperty)>;

/// Reads a channel, with what it changes; `None` for one that changes nothing that is shown.
fn read_channel(
    job: &BakeJob<'_>,
    clip: &Animation,
    channel: &AnimationChannel,
    parts: SceneParts<'_>,
    place: &str,
) -> Result<Option<(ChannelTarget, Channel, ChangedProperties)>, BakeError> {
    let Some(target) = target_of(&channel.target, place)? else { return Ok(None) };
    let mut changed = Vec::new();
    let (path, count) = match target {
        ChannelTarget::Node(node, path) => {
            let Some(count) = check_node(job, (node, path), parts.place_of, place)? else {
                return Ok(None);
            };
            (path, count)
        }
        ChannelTarget::Property(kind, source) => {
            for kind in together(kind) {
                let at = format!("{place}.target");
                let property = parts.property(job, kind, source, &at)?;
                let Some(property) = property else { return Ok(None) };
                changed.push(((kind, source), property));
            }
            (AnimatedPath::Property, kind.width())
        }
    };
    let Some(sampler) = clip.samplers.get(channel.sampler as usize) else {
        let (sampler, count) = (channel.sampler.into(), clip.samplers.len());
        return Err(BakeError::beyond(format!("{place}.sampler"), "samplers", sampler, count));
    };
    let is_switch = matches!(target, ChannelTarget::Property(PropertyKind::Visible, _));
    let (interpolation, times, values) =
        read_sampler(job, sampler, (path, count, is_switch), place)?;
    Ok(Some((target, Channel { target: 0, path, interpolation, times, values }, changed)))
}

/// Returns the number of morph targets of a node that a clip moves; `None` if it is not shown.
///
/// # Errors
/// It cannot be moved in this way.
fn check_node(
    job: &BakeJob<'_>,
    (node, path): (u32, AnimatedPath),
    place_of: &[Option<u32>],
    place: &str,
) -> Result<Option<usize>, BakeError> {
    let json = job.source.document.nodes.at(node, &format!("{place}.target"))?;
    if place_of.get(node as usize).copied().flatten().is_none() {
        return Ok(None);
    }
    if path != AnimatedPath::Weights && json.matrix.is_some_and(|matrix| is_sheared(&matrix)) {
        let what = format!("nodes[{node}] has a matrix with a shear");
        return Err(BakeError::at(place, what, "translation, rotation and scale would be right"));
    }
    let weights = target_weights(job, node).len();
    if path == AnimatedPath::Weights && weights == 0 {
        let what = format!("the mesh of nodes[{node}] has no morph targets");
        return Err(BakeError::at(place, what, "a mesh with targets would be right"));
    }
    Ok(Some(weights))
}

/// Returns whether a matrix is more than a translation, a rotation and a scale.
fn is_sheared(columns: &[f64; 16]) -> bool {
    let [x, y, z] = [0, 4, 8].map(|at| DVec3::new(columns[at], columns[at + 1], columns[at + 2]));
    let largest = x.length() * y.length() + y.length() * z.length() + z.length() * x.length();
    let off = x.dot(y).abs().max(y.dot(z).abs()).max(z.dot(x).abs());
    off > SHEAR_TOLERANCE * largest
}

fn read_sampler(
    job: &BakeJob<'_>,
    sampler: &AnimationSampler,
    (path, count, is_switch): (AnimatedPath, usize, bool),
    place: &str,
) -> Result<(Interpolation, Vec<f32>, Vec<f32>), BakeError> {
    job.check()?;
    let interpolation = match sampler.interpolation.as_deref() {
        None | Some("LINEAR") => Interpolation::Linear,
        Some("STEP") => Interpolation::Step,
        Some("CUBICSPLINE") => Interpolation::CubicSpline,
        Some(other) => {
            let what = format!("interpolation '{}' does not exist", uri::shorten(other));
            let right = "LINEAR, STEP or CUBICSPLINE would be right";
            return Err(BakeError::at(place, what, right));
        }
    };
    if is_switch && interpolation != Interpolation::Step {
        let what = "there is nothing between shown and hidden";
        return Err(BakeError::at(place, what, "interpolation STEP would be right"));
    }
    let input = Accessor::open(job.source, sampler.input, &format!("{place}.input"))?;
    let times = input.floats::<1>()?.into_flattened();
    let is_rising = times.windows(2).all(|pair| pair[0] <= pair[1]);
    let is_time = |time: &f32| time.is_finite() && *time >= 0.0;
    if times.is_empty() || !is_rising || !times.iter().all(is_time) {
        let what = "its times do not rise, or are not finite";
        return Err(BakeError::at(input.place, what, "rising seconds from 0 on would be right"));
    }
    let output = Accessor::open(job.source, sampler.output, &format!("{place}.output"))?;
    let values = match (path, count) {
        (AnimatedPath::Property, 1) if is_switch => switches(&output)?,
        (AnimatedPath::Rotation, _) | (AnimatedPath::Property, 4) => {
            output.floats::<4>()?.into_flattened()
        }
        (AnimatedPath::Weights, _) | (AnimatedPath::Property, 1) => {
            output.floats::<1>()?.into_flattened()
        }
        (AnimatedPath::Property, 2) => output.floats::<2>()?.into_flattened(),
        _ => output.floats::<3>()?.into_flattened(),
    };
    let of_key = if interpolation == Interpolation::CubicSpline { 3 } else { 1 };
    let wanted = times.len() * path.width(count) * of_key;
    if values.len() != wanted {
        let what = format!("it has {} numbers for {} keys", values.len(), times.len());
        return Err(BakeError::at(output.place, what, format!("{wanted} would be right")));
    }
    if let Some(at) = values.iter().position(|value| !value.is_finite()) {
        let what = format!("number {at} is not finite");
        return Err(BakeError::at(output.place, what, "finite numbers would be right"));
    }
    Ok((interpolation, times, values))
}

/// The values of an accessor, each of which is 1 for any number but 0.
fn switches(output: &Accessor<'_>) -> Result<Vec<f32>, BakeError> {
    let of = |is_on: bool| if is_on { 1.0 } else { 0.0 };
    if let Ok(values) = output.unsigned::<1>() {
        return Ok(values.into_iter().map(|[value]| of(value != 0)).collect());
    }
    Ok(output.floats::<1>()?.into_iter().map(|[value]| of(value != 0.0)).collect())
}
