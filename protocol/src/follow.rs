//! A camera that follows a node of the open scene.

use glam::DVec3;
use polyptych_scene::NodeId;
use polyptych_wall::camera::Camera;
use serde::{Deserialize, Serialize};

/// A node that the camera follows, and where the camera is to it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Follow {
    /// The node.
    pub node: NodeId,
    /// The place of display space relative to the node, in world units: from the origin of the
    /// node, along its axes if the camera turns with it, else along those of the world. `None`
    /// keeps what it is when the camera begins to follow.
    pub camera: Option<Camera>,
    /// `true` turns the camera with the node. Scale, shear and mirroring of the node do not count.
    pub is_turning: bool,
    /// Radians in a second of scene time by which the camera goes around the node, about the Y of
    /// the same axes: counterclockwise as seen from above. 0 stays.
    pub orbit_rad_per_s: f64,
}

impl Follow {
    /// The camera with the eye, a point of display space in metres, at the origin of a node, which
    /// looks along the node's −Z as glTF's cameras do, and moves and turns with it. `scale` is in
    /// world units per metre.
    pub fn standing_at(node: NodeId, eye: DVec3, scale: f64) -> Self {
        let camera = Camera::IDENTITY.with_scale(scale).with_eye_at(eye, DVec3::ZERO);
        Self { node, camera: Some(camera), is_turning: true, orbit_rad_per_s: 0.0 }
    }
}
