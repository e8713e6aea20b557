//! Animations: transforms and weights of nodes, and other properties, as functions of time
//! (glTF 2.0, 3.11; `KHR_animation_pointer`).
//!
//! All is computed in f64 with sines of `libm`, which are the same on every machine: a pose is the
//! same to the bit wherever it is made.

use glam::{DAffine3, DQuat, DVec3, DVec4};
use serde::{Deserialize, Serialize};

use crate::AnimatedProperty;

/// Maximum number of clips of a scene: libraries of motions have some hundreds.
pub const CLIPS_MAX: usize = 4096;

/// All that moves by itself in a scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Animations {
    /// Played alone or together.
    pub clips: Vec<Clip>,
    /// The nodes that clips move, as they stand without; rising by node.
    pub nodes: Vec<AnimatedNode>,
    /// Other properties that clips change, with their values without clips.
    pub properties: Vec<AnimatedProperty>,
}

/// A motion that is played as one.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Clip {
    /// The source's name; may be empty or stand twice.
    pub name: String,
    /// One for each property that it moves.
    pub channels: Vec<Channel>,
}

/// A node that a clip moves, at rest.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AnimatedNode {
    /// An index into the scene's nodes.
    pub node: u32,
    /// Along the axes of its parent.
    pub translation: DVec3,
    /// A unit quaternion.
    pub rotation: DQuat,
    /// Along its own axes.
    pub scale: DVec3,
    /// The weights of the morph targets of its mesh.
    pub weights: Vec<f64>,
}

/// One property over time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Channel {
    /// An index into [`Animations::nodes`]; of [`AnimatedPath::Property`] one into
    /// [`Animations::properties`].
    pub target: u32,
    /// The property of a node, or another one.
    pub path: AnimatedPath,
    /// The way from one key to the next.
    pub interpolation: Interpolation,
    /// The time of each key in seconds, rising; of keys at one time the last counts.
    pub times: Vec<f32>,
    /// The value of each key; of splines three, the first and the last of which are tangents.
    pub values: Vec<f32>,
}

/// The kind of what a clip changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum AnimatedPath {
    /// In the space of its parent.
    Translation,
    /// A quaternion.
    Rotation,
    /// Along its own axes.
    Scale,
    /// The weights of its morph targets.
    Weights,
    /// A property that is no place or shape of a node.
    Property,
}

/// The way from one key to the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Interpolation {
    /// The value of the key before.
    Step,
    /// Evenly; of rotations around one axis, by the shorter way.
    Linear,
    /// A cubic Hermite spline.
    CubicSpline,
}

/// A clip in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ClipTime {
    /// An index into [`Animations::clips`].
    pub clip: u32,
    /// Seconds since its beginning.
    pub time_s: f64,
    /// Its part beside the other clips: 0 for none. Where all parts of a property together are
    /// less than 1, the rest is as without animation.
    pub weight: f32,
}

/// The pose of an animated node.
#[derive(Clone, Debug, PartialEq)]
pub struct NodePose {
    translation: DVec3,
    rotation: DQuat,
    scale: DVec3,
    /// The weights of the morph targets of its mesh.
    pub weights: Vec<f64>,
    /// `true` where a clip moves it.
    pub is_moved: bool,
}

impl AnimatedPath {
    /// Numbers of one value; `count` is the number of morph targets, or that of the property.
    pub fn width(self, count: usize) -> usize {
        match self {
            Self::Translation | Self::Scale => 3,
            Self::Rotation => 4,
            Self::Weights | Self::Property => count,
        }
    }
}

impl Clip {
    /// The time of its last key, in seconds.
    pub fn duration_s(&self) -> f64 {
        let last = self.channels.iter().filter_map(|channel| channel.times.last());
        last.map(|time| f64::from(*time)).fold(0.0, f64::max)
    }
}

impl Channel {
    /// Returns whether a number of the channel, of three at each time, may be below 0 at some time.
    /// A spline stays within the Bézier points of each of its pieces.
    pub(super) fn may_be_negative(&self) -> bool {
        if self.interpolation != Interpolation::CubicSpline {
            return self.values.iter().any(|value| *value < 0.0);
        }
        let keys: Vec<_> = self.values.as_chunks::<9>().0.iter().zip(&self.times).collect();
        let point = |[_, _, _, x, y, z, _, _, _]: &[f32; 9]| [*x, *y, *z];
        let is_negative = |value: f32, tangent: f32, s: f32| value + tangent * s / 3.0 < 0.0;
        let bends = keys.windows(2).any(|pair| {
            let [(from, start), (to, end)] = pair else { return false };
            let s = *end - *start;
            (0..3).any(|axis| {
                is_negative(point(from)[axis], from[6 + axis], s)
                    || is_negative(point(to)[axis], -to[axis], s)
            })
        });
        bends || keys.iter().any(|(key, _)| point(key).iter().any(|value| *value < 0.0))
    }

    /// Returns the numbers of a value: of a key, a tangent or between two keys.
    fn width(&self) -> usize {
        let of_key = if self.interpolation == Interpolation::CubicSpline { 3 } else { 1 };
        self.values.len() / (self.times.len().max(1) * of_key)
    }

    /// Returns what is wrong with it, if anything; `count` is the number of morph targets, or that
    /// of the property's numbers.
    fn fault(&self, count: usize) -> Option<&'static str> {
        let of_key = if self.interpolation == Interpolation::CubicSpline { 3 } else { 1 };
        let wanted = self.times.len().checked_mul(self.path.width(count) * of_key);
        if self.times.is_empty() || wanted != Some(self.values.len()) || self.values.is_empty() {
            return Some("as many values as its keys need would be right");
        }
        let is_rising = self.times.windows(2).all(|pair| pair[0] <= pair[1]);
        let is_finite = self.times.iter().chain(&self.values).all(|number| number.is_finite());
        (!is_rising || !is_finite).then_some("finite numbers and rising times would be right")
    }

    /// Gives the value at a time; before the first key that of the first, and so at the end.
    fn sample(&self, time_s: f64, value: &mut Vec<f64>) {
        value.clear();
        let width = self.width();
        let next = self.times.partition_point(|time| f64::from(*time) <= time_s);
        let is_spline = self.interpolation == Interpolation::CubicSpline;
        // A spline has three: 0 comes in, 1 is the value, 2 goes out.
        let part = |key: usize, of: usize| {
            let at = if is_spline { key * 3 + of } else { key } * width;
            self.values[at..at + width].iter().map(|number| f64::from(*number))
        };
        if next == 0 || next == self.times.len() || self.interpolation == Interpolation::Step {
            value.extend(part(next.saturating_sub(1), 1));
            return;
        }
        let (from, to) = (f64::from(self.times[next - 1]), f64::from(self.times[next]));
        let step = to - from;
        let t = (time_s - from) / step;
        let (a, b) = (part(next - 1, 1), part(next, 1));
        if is_spline {
            let (t2, t3) = (t * t, t * t * t);
            let ends = a.zip(b).zip(part(next - 1, 2).zip(part(next, 0)));
            value.extend(ends.map(|((a, b), (leave, arrive))| {
                (2.0 * t3 - 3.0 * t2 + 1.0) * a
                    + step * (t3 - 2.0 * t2 + t) * leave
                    + (3.0 * t2 - 2.0 * t3) * b
                    + step * (t3 - t2) * arrive
            }));
        } else if self.path == AnimatedPath::Rotation {
            let (a, b) = (quaternion(a), quaternion(b));
            value.extend(slerp(a, b, t).to_array());
        } else {
            value.extend(a.zip(b).map(|(a, b)| a + (b - a) * t));
        }
    }
}

/// A unit quaternion of four numbers; the identity where they have no direction.
fn quaternion(numbers: impl Iterator<Item = f64>) -> DQuat {
    let mut array = [0.0; 4];
    for (slot, number) in array.iter_mut().zip(numbers) {
        *slot = number;
    }
    let unit = DVec4::from_array(array).try_normalize();
    unit.map_or(DQuat::IDENTITY, DQuat::from_vec4)
}

/// The rotation between two unit quaternions at `t` from 0 to 1, by the shorter way: Shoemake,
/// "Animating Rotation with Quaternion Curves" (1985).
fn slerp(a: DQuat, b: DQuat, t: f64) -> DQuat {
    /// The cosine beyond which the sine of an angle is the angle to the last bit but some.
    const NEAR: f64 = 1.0 - 1e-12;
    let (a, b) = (DVec4::from(a), DVec4::from(b));
    let cosine = a.dot(b);
    let (b, cosine) = if cosine < 0.0 { (-b, -cosine) } else { (b, cosine) };
    if cosine > NEAR {
        return DQuat::from_vec4((a + (b - a) * t).normalize());
    }
    // By the half angle, whose tangent is exact where the cosine is near 1.
    let angle = 2.0 * libm::atan2((b - a).length(), (b + a).length());
    let [from, to] = [libm::sin((1.0 - t) * angle), libm::sin(t * angle)];
    DQuat::from_vec4(((a * from + b * to) / libm::sin(angle)).normalize())
}

/// A property of a node while clips are added: its value, and their parts so far.
#[derive(Clone, Debug, Default)]
struct Blend {
    value: Vec<f64>,
    total: f64,
}

impl Blend {
    /// Adds the value of a clip.
    fn add(&mut self, path: AnimatedPath, value: &[f64], weight: f64) {
        if self.total == 0.0 {
            self.value.clear();
            self.value.extend_from_slice(value);
        } else {
            mix(path, &mut self.value, value, weight / (self.total + weight));
        }
        self.total += weight;
    }

    /// The value, of which what is missing to a whole is that at rest.
    fn finish(&mut self, path: AnimatedPath, rest: &[f64]) -> &[f64] {
        if self.total < 1.0 {
            let missing = 1.0 - self.total;
            mix(path, &mut self.value, rest, missing);
        }
        &self.value
    }
}

/// Moves a value towards another by a part from 0 to 1.
fn mix(path: AnimatedPath, value: &mut [f64], to: &[f64], part: f64) {
    if path == AnimatedPath::Rotation {
        let [a, b] = [quaternion(value.iter().copied()), quaternion(to.iter().copied())];
        value.copy_from_slice(&slerp(a, b, part).to_array());
        return;
    }
    for (value, to) in value.iter_mut().zip(to) {
        *value += (to - *value) * part;
    }
}

impl NodePose {
    fn at_rest(node: &AnimatedNode) -> Self {
        Self {
            translation: node.translation,
            rotation: node.rotation,
            scale: node.scale,
            weights: node.weights.clone(),
            is_moved: false,
        }
    }

    fn set(&mut self, path: AnimatedPath, value: &[f64]) {
        self.is_moved |= path != AnimatedPath::Weights;
        match (path, value) {
            (AnimatedPath::Translation, &[x, y, z]) => self.translation = DVec3::new(x, y, z),
            (AnimatedPath::Scale, &[x, y, z]) => self.scale = DVec3::new(x, y, z),
            (AnimatedPath::Rotation, of) => self.rotation = quaternion(of.iter().copied()),
            (AnimatedPath::Weights, of) => self.weights.copy_from_slice(of),
            _ => {}
        }
    }

    fn numbers(&self, path: AnimatedPath) -> Vec<f64> {
        match path {
            AnimatedPath::Translation => self.translation.to_array().to_vec(),
            AnimatedPath::Scale => self.scale.to_array().to_vec(),
            AnimatedPath::Rotation => self.rotation.to_array().to_vec(),
            AnimatedPath::Weights => self.weights.clone(),
            AnimatedPath::Property => Vec::new(),
        }
    }

    /// Parent space from the node's space.
    pub fn local(&self) -> DAffine3 {
        let Self { translation, rotation, scale, .. } = self;
        DAffine3::from_scale_rotation_translation(*scale, *rotation, *translation)
    }

    /// Parent space from the space of a node that stands at `rest` in its file, and was put to
    /// `still`: it moves from there.
    pub(crate) fn local_from(&self, rest: DAffine3, still: DAffine3) -> DAffine3 {
        if !self.is_moved {
            return still;
        }
        edited_from_rest(rest, still).map_or_else(|| self.local(), |change| change * self.local())
    }
}

/// Returns the edited transform of an animated node, seen from that at rest.
pub(crate) fn edited_from_rest(rest: DAffine3, edited: DAffine3) -> Option<DAffine3> {
    if edited == rest {
        return None;
    }
    let change = edited * rest.inverse();
    // One that was flat at rest cannot be told from where it was: it moves as in its file.
    change.is_finite().then_some(change)
}

impl Animations {
    /// The pose of every animated node where these clips are played, in the order of the nodes.
    /// Clips that are not there, and those without a part, move nothing.
    pub fn pose(&self, clips: &[ClipTime]) -> Vec<NodePose> {
        self.at(clips).0
    }

    /// The pose of every animated node and the value of every other property where these clips are
    /// played, in the order of the nodes and of the properties.
    pub fn at(&self, clips: &[ClipTime]) -> (Vec<NodePose>, Vec<Vec<f64>>) {
        let mut poses: Vec<NodePose> = self.nodes.iter().map(NodePose::at_rest).collect();
        let mut values: Vec<Vec<f64>> = self.properties.iter().map(|of| of.rest.clone()).collect();
        let mut blends: std::collections::BTreeMap<(u32, AnimatedPath), Blend> =
            std::collections::BTreeMap::new();
        let mut value = Vec::new();
        for played in clips.iter().filter(|played| played.weight > 0.0) {
            let Some(clip) = self.clips.get(played.clip as usize) else { continue };
            for channel in &clip.channels {
                channel.sample(played.time_s, &mut value);
                let blend = blends.entry((channel.target, channel.path)).or_default();
                blend.add(channel.path, &value, f64::from(played.weight));
            }
        }
        for ((target, path), mut blend) in blends {
            if path == AnimatedPath::Property {
                let value = &mut values[target as usize];
                *value = blend.finish(path, value).to_vec();
                continue;
            }
            let pose = &mut poses[target as usize];
            let rest = pose.numbers(path);
            pose.set(path, blend.finish(path, &rest));
        }
        (poses, values)
    }

    /// The clips that a scene plays by itself: each in order that moves nothing that one before it
    /// moves, so that of several motions of one figure the first is shown.
    pub fn played_unasked(&self) -> Vec<u32> {
        let mut taken = std::collections::BTreeSet::new();
        let mut played = Vec::new();
        for (index, clip) in (0..).zip(&self.clips) {
            let of_clip = || clip.channels.iter().map(|channel| (channel.target, channel.path));
            if clip.channels.is_empty() || of_clip().any(|one| taken.contains(&one)) {
                continue;
            }
            taken.extend(of_clip());
            played.push(index);
        }
        played
    }

    /// Returns what is wrong, if anything, in a scene of so many nodes.
    pub(crate) fn fault(&self, nodes: usize) -> Option<String> {
        if self.clips.len() > CLIPS_MAX {
            let count = self.clips.len();
            return Some(format!("it has {count} animations, where {CLIPS_MAX} can be"));
        }
        let is_rising = self.nodes.windows(2).all(|pair| pair[0].node < pair[1].node);
        let is_there = |of: &AnimatedNode| (of.node as usize) < nodes;
        let is_finite = |of: &AnimatedNode| {
            let weights = of.weights.iter().all(|weight| weight.is_finite());
            weights && of.translation.is_finite() && of.rotation.is_finite() && of.scale.is_finite()
        };
        if !is_rising || !self.nodes.iter().all(|of| is_there(of) && is_finite(of)) {
            return Some("an animated node is not there, or not in order".to_owned());
        }
        for (at, clip) in self.clips.iter().enumerate() {
            for channel in &clip.channels {
                if channel.path == AnimatedPath::Property {
                    let Some(target) = self.properties.get(channel.target as usize) else {
                        return Some(format!("animation {at} changes what is not there"));
                    };
                    if let Some(right) = channel.fault(target.rest.len()) {
                        return Some(format!("animation {at}, {:?}: {right}", target.kind));
                    }
                    continue;
                }
                let Some(target) = self.nodes.get(channel.target as usize) else {
                    return Some(format!("animation {at} moves a node that is not there"));
                };
                if let Some(right) = channel.fault(target.weights.len()) {
                    return Some(format!("animation {at}, node {}: {right}", target.node));
                }
            }
        }
        None
    }
}

#[cfg(test)]
mod tests;
