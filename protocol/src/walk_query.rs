//! A query for the way of a walker through the open scene, on the ground or in flight.

use glam::DVec3;
use polyptych_scene::NodeId;
use polyptych_text::text_of_peer;
use serde::{Deserialize, Serialize};

use crate::ids::Revision;

/// Maximum number of points of a way, asked for or given.
pub const WAY_POINTS_MAX: usize = 4096;

/// A question for how far one comes on a way through the open scene, over its ground and up to
/// what stands in the way. Nodes that are hidden are not there.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WalkQuery {
    /// The way of the eye, in world space, in straight lines: 2 to [`WAY_POINTS_MAX`] points.
    /// Above ground their Y does not count, but for the first one's, below which the ground is.
    pub way: Vec<DVec3>,
    /// The walker. One without a height and without a radius is refused: nothing can stop it.
    pub walker: Walker,
}

/// A body that walks or flies; all in world units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Walker {
    /// The height of the eye above the ground, which it keeps, above 0; `None` flies.
    pub eye_height: Option<f64>,
    /// The distance that is kept from everything, to a thirtieth of it, above 0 and below
    /// `eye_height`: by the eye and, above ground, by the body below it down to `step_height`.
    /// `None` passes through.
    pub radius: Option<f64>,
    /// Greatest rise or fall of the ground within a sixteenth of `eye_height`, from 0 to
    /// `eye_height`; a greater one ends the way. Ignored in flight.
    pub step_height: f64,
}

/// The way that is possible.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WalkedWay {
    /// The state since which the scene is as it was looked at.
    pub revision: Revision,
    /// The way of the eye in straight lines, in world space; between them it is at most a
    /// hundredth of the height, or a tenth of the radius, from the way that was found. The first
    /// point is where it begins, above ground at the height of the eye.
    pub points: Vec<DVec3>,
    /// The reason why it ends.
    pub end: WalkEnd,
}

impl WalkedWay {
    /// Returns the length of the way, in world units.
    pub fn length(&self) -> f64 {
        self.points.windows(2).map(|pair| pair[0].distance(pair[1])).sum()
    }
}

/// The reason why a way ends.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum WalkEnd {
    /// The last point that was asked for is reached.
    Arrived,
    /// Something is in the way.
    Obstacle(Touched),
    /// The ground rises too much.
    Rise(Touched),
    /// The ground falls too much.
    Fall(Touched),
    /// There is no ground ahead.
    NoGround,
}

/// A place of the scene that ends a way.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Touched {
    /// The node that has the mesh.
    pub node: NodeId,
    /// The name of that node; may be empty.
    #[serde(deserialize_with = "text_of_peer")]
    pub name: String,
    /// The place, in world space.
    pub position: DVec3,
}
