//! The place of a single node of a scene's file in the space of its parent, at any time.

use glam::DAffine3;
use serde::{Deserialize, Serialize};

use crate::Scene;
use crate::animation::{AnimatedPath, Animations, Channel, Clip, ClipTime};
use crate::edit::NodeId;

/// The place of a node in the file, and the way that clips move it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FilePlace {
    /// Parent space from its space, without any clip.
    rest: DAffine3,
    /// The part of the scene's animations that moves it: as many clips, and no other node.
    animations: Animations,
}

impl FilePlace {
    /// The place of a node that no clip moves.
    pub fn still(rest: DAffine3) -> Self {
        Self { rest, animations: Animations::default() }
    }

    /// The place of a node of a scene. `None` if its file has no such node. Joints are nodes here;
    /// a mesh with a skin stands where its node does.
    pub fn of(scene: &Scene, node: NodeId) -> Option<Self> {
        let node = u32::try_from(node.0).ok()?;
        let rest = scene.nodes.get(node as usize)?.local;
        Some(Self { rest, animations: scene.animations.of_node(node) })
    }

    /// Parent space from its space while these clips are played; one that was put elsewhere moves
    /// from there, as what is drawn does.
    pub fn local(&self, edited: Option<DAffine3>, clips: &[ClipTime]) -> DAffine3 {
        let still = edited.unwrap_or(self.rest);
        match self.animations.pose(clips).first() {
            Some(pose) => pose.local_from(self.rest, still),
            None => still,
        }
    }
}

impl Animations {
    /// Returns the part of them that moves this node; clips keep their numbers.
    fn of_node(&self, node: u32) -> Self {
        let Ok(at) = self.nodes.binary_search_by_key(&node, |of| of.node) else {
            return Self::default();
        };
        let mut all = Self { nodes: vec![self.nodes[at].clone()], ..Self::default() };
        for clip in &self.clips {
            let moves = |of: &&Channel| {
                let is_place = !matches!(of.path, AnimatedPath::Weights | AnimatedPath::Property);
                of.target as usize == at && is_place
            };
            let channels = clip.channels.iter().filter(moves);
            let channels = channels.map(|of| Channel { target: 0, ..of.clone() }).collect();
            all.clips.push(Clip { name: String::new(), channels });
        }
        all
    }
}
