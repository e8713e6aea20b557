//! Animations: clips of the file as functions of time.
//!
//! A channel that is not as it should be is left out with a note, and the rest of its clip is
//! played.

use std::collections::{BTreeMap, BTreeSet};

use glam::{DQuat, DVec3};
use polyptych_scene::limits::NODE_NAME_BYTES_MAX;
use polyptych_scene::{
    AnimatedNode, AnimatedPath, Animations, CLIPS_MAX, Channel, Clip, Interpolation, Node,
};

use super::BakeJob;
use super::accessor::Accessor;
use super::document::{self, AnimationChannel, AnimationSampler};
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
}

impl ClipTargets {
    /// The nodes that clips of a file name, whether or not they can be played.
    pub(super) fn of(document: &document::Document) -> Self {
        let mut targets = Self::default();
        for channel in document.animations.iter().flat_map(|clip| &clip.channels) {
            let Some(node) = channel.target.node else { continue };
            let is_morphed = channel.target.path == "weights";
            if is_morphed { &mut targets.morphed } else { &mut targets.moved }.insert(node);
        }
        targets
    }

    /// Returns whether a clip changes the weights of a node's morph targets.
    pub(super) fn change_weights_of(&self, node: u32) -> bool {
        self.morphed.contains(&node)
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

/// The clips of a file, whose nodes have these places in the scene.
pub(super) fn read(
    job: &mut BakeJob<'_>,
    place_of: &[Option<u32>],
    nodes: &[Node],
) -> Result<(Animations, BTreeMap<u32, u32>), BakeError> {
    let document = &job.source.document;
    let mut targets: BTreeMap<u32, AnimatedNode> = BTreeMap::new();
    let mut drafts = Vec::new();
    if document.animations.len() > CLIPS_MAX {
        let count = document.animations.len();
        job.warn(&format!("animations: {count}, of which the first {CLIPS_MAX} can be played"));
    }
    for (at, json) in document.animations.iter().take(CLIPS_MAX).enumerate() {
        let mut channels = BTreeMap::new();
        for (number, channel) in json.channels.iter().enumerate() {
            let place = format!("animations[{at}].channels[{number}]");
            match read_channel(job, json, channel, place_of, &place) {
                Ok(None) => {}
                Ok(Some((node, draft))) => {
                    let weights = target_weights(job, node);
                    let rest = || at_rest(&document.nodes[node as usize], nodes, place_of, node);
                    let target = targets.entry(node).or_insert_with(rest);
                    if draft.path == AnimatedPath::Weights {
                        target.weights = weights;
                    }
                    if channels.insert((node, draft.path), draft).is_some() {
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
    // In the order of the scene's nodes.
    let mut sorted: Vec<(u32, AnimatedNode)> = targets.into_iter().collect();
    sorted.sort_by_key(|(_, target)| target.node);
    let index_of: BTreeMap<u32, u32> = sorted.iter().map(|(node, _)| *node).zip(0..).collect();
    let clip = |(name, channels): (String, BTreeMap<(u32, AnimatedPath), Channel>)| {
        let numbered = channels.into_iter().filter_map(|((node, _), channel)| {
            Some(Channel { target: *index_of.get(&node)?, ..channel })
        });
        Clip { name, channels: numbered.collect() }
    };
    let clips = drafts.into_iter().map(clip).collect();
    let nodes = sorted.into_iter().map(|(_, target)| target).collect();
    Ok((Animations { clips, nodes }, index_of))
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

/// Reads a channel, with the node of the file that it moves; `None` for one that moves nothing that
/// is shown.
fn read_channel(
    job: &BakeJob<'_>,
    clip: &document::Animation,
    channel: &AnimationChannel,
    place_of: &[Option<u32>],
    place: &str,
) -> Result<Option<(u32, Channel)>, BakeError> {
    let Some(node) = channel.target.node else { return Ok(None) };
    let Some(json) = job.source.document.nodes.get(node as usize) else {
        let count = job.source.document.nodes.len();
        return Err(BakeError::beyond(format!("{place}.target.node"), "nodes", node.into(), count));
    };
    if place_of.get(node as usize).copied().flatten().is_none() {
        return Ok(None);
    }
    let path = match channel.target.path.as_str() {
        "translation" => AnimatedPath::Translation,
        "rotation" => AnimatedPath::Rotation,
        "scale" => AnimatedPath::Scale,
        "weights" => AnimatedPath::Weights,
        other => {
            let what = format!("path '{}' does not exist", uri::shorten(other));
            let right = "translation, rotation, scale or weights would be right";
            return Err(BakeError::at(format!("{place}.target"), what, right));
        }
    };
    if path != AnimatedPath::Weights && json.matrix.is_some_and(|matrix| is_sheared(&matrix)) {
        let what = format!("nodes[{node}] has a matrix with a shear");
        return Err(BakeError::at(place, what, "translation, rotation and scale would be right"));
    }
    let Some(sampler) = clip.samplers.get(channel.sampler as usize) else {
        let (sampler, count) = (channel.sampler.into(), clip.samplers.len());
        return Err(BakeError::beyond(format!("{place}.sampler"), "samplers", sampler, count));
    };
    let weights = target_weights(job, node).len();
    if path == AnimatedPath::Weights && weights == 0 {
        let what = format!("the mesh of nodes[{node}] has no morph targets");
        return Err(BakeError::at(place, what, "a mesh with targets would be right"));
    }
    let (interpolation, times, values) = read_sampler(job, sampler, path, weights, place)?;
    Ok(Some((node, Channel { target: 0, path, interpolation, times, values })))
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
    path: AnimatedPath,
    weights: usize,
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
    let input = Accessor::open(job.source, sampler.input, &format!("{place}.input"))?;
    let times = input.floats::<1>()?.into_flattened();
    let is_rising = times.windows(2).all(|pair| pair[0] <= pair[1]);
    let is_time = |time: &f32| time.is_finite() && *time >= 0.0;
    if times.is_empty() || !is_rising || !times.iter().all(is_time) {
        let what = "its times do not rise, or are not finite";
        return Err(BakeError::at(input.place, what, "rising seconds from 0 on would be right"));
    }
    let output = Accessor::open(job.source, sampler.output, &format!("{place}.output"))?;
    let values = match path {
        AnimatedPath::Rotation => output.floats::<4>()?.into_flattened(),
        AnimatedPath::Weights => output.floats::<1>()?.into_flattened(),
        _ => output.floats::<3>()?.into_flattened(),
    };
    let of_key = if interpolation == Interpolation::CubicSpline { 3 } else { 1 };
    let wanted = times.len() * path.width(weights) * of_key;
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
