//! The JSON of animations.

use serde::Deserialize;

/// A clip.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Animation {
    pub name: String,
    pub channels: Vec<AnimationChannel>,
    pub samplers: Vec<AnimationSampler>,
}

/// A sampler and its target.
#[derive(Debug, Deserialize)]
pub(super) struct AnimationChannel {
    pub sampler: u32,
    pub target: AnimationTarget,
}

/// A property of a node, or any that a pointer names.
#[derive(Debug, Deserialize)]
pub(super) struct AnimationTarget {
    pub node: Option<u32>,
    pub path: String,
    #[serde(default)]
    pub extensions: TargetExtensions,
}

/// Extensions of what an animation changes.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct TargetExtensions {
    #[serde(rename = "KHR_animation_pointer")]
    pub pointer: Option<AnimationPointer>,
}

/// `KHR_animation_pointer`: a JSON pointer into the file.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct AnimationPointer {
    pub pointer: String,
}

/// Times, values, and what is between them.
#[derive(Debug, Deserialize)]
pub(super) struct AnimationSampler {
    pub input: u32,
    pub output: u32,
    #[serde(default)]
    pub interpolation: Option<String>,
}
