//! Questions about the nodes of the open scene.

use std::collections::BTreeMap;

use glam::{DAffine3, DVec3};
use polyptych_scene::{Attribute, Bounds, Facing, Light, NodeId, NodeStyle, SceneSubset};
use polyptych_text::text_of_peer;
use polyptych_wall::pick_ray::Ray;
use polyptych_wall::region::{Region, Relation};
use serde::{Deserialize, Serialize};

use crate::ids::Revision;

/// Most nodes of one answer: about 400 KiB where their names are of usual length.
pub const NODES_MAX: u32 = 1000;

/// Most bytes of the names and attributes of one answer; where they are long, it has fewer nodes.
pub const NODE_TEXT_BYTES_MAX: usize = 1 << 20;

/// Conditions of the nodes to find. All that are given must hold.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NodeQuery {
    /// The exact name of the nodes.
    pub name: Option<String>,
    /// This one, and what hangs from it at any depth.
    pub below: Option<NodeId>,
    /// An attribute's key, and its value if given, that the nodes have.
    pub attribute: Option<(String, Option<Attribute>)>,
    /// In this layer, their own or that of the nearest node above them that has one.
    pub layer: Option<String>,
    /// Only nodes of this kind.
    pub kind: Option<NodeKind>,
    /// The number of found nodes to skip, from the first: the next page begins there.
    pub skip: u64,
    /// The maximum number of nodes to return; never more than [`NODES_MAX`].
    pub count: u32,
}

/// A kind of node, by what it shows. A node with a mesh and a light is of both kinds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum NodeKind {
    /// It has a mesh with triangles.
    Mesh,
    /// It has a mesh with lines.
    Lines,
    /// It has a mesh with points.
    Points,
    /// It has a light.
    Light,
    /// It has neither a mesh nor a light.
    Empty,
    /// It has a mesh, and its text as the attribute `label`.
    Label,
}

/// A node as it stands.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NodeInfo {
    /// Its number.
    pub id: NodeId,
    /// The node that it hangs from; `None` for the scene itself.
    pub parent: Option<NodeId>,
    /// The node's name; may be empty.
    #[serde(deserialize_with = "text_of_peer")]
    pub name: String,
    /// The number of nodes above it.
    pub depth: u32,
    /// Parent space from this node's space.
    pub local: DAffine3,
    /// World space from this node's space.
    pub world: DAffine3,
    /// `true` if it is shown when its parents are.
    pub visible: bool,
    /// An index into the meshes of the scene.
    pub mesh: Option<u32>,
    /// It shines along −Z of the node.
    pub light: Option<Light>,
    /// The node's attributes.
    pub attributes: BTreeMap<String, Attribute>,
    /// Around its mesh in all its places, in world space.
    pub bounds: Option<Bounds>,
    /// The layer that it was put into itself.
    #[serde(deserialize_with = "text_of_peer")]
    pub own_layer: Option<String>,
    /// The layer that it is in: its own, or that of the nearest node above it that has one.
    #[serde(deserialize_with = "text_of_peer")]
    pub layer: Option<String>,
    /// The only one of its children that is shown; `None` for all.
    pub switch: Option<NodeId>,
    /// The style that it has of its own.
    pub style: NodeStyle,
    /// The way in which it turns towards the viewer by itself; its places here are without that.
    pub facing: Option<Facing>,
}

/// A layer of the open scene.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LayerInfo {
    /// Its name.
    #[serde(deserialize_with = "text_of_peer")]
    pub name: String,
    /// The number of nodes in it, those that inherit it among them.
    pub nodes: u64,
    /// `true` where the wall's own picture shows it.
    pub visible: bool,
}

/// A question for what a ray meets.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RayQuery {
    /// In world space.
    pub ray: Ray,
    /// The length of the ray, in world units; endless where `None`.
    pub max_distance: Option<f64>,
    /// The part of the scene that it can meet.
    pub subset: SceneSubset,
}

impl RayQuery {
    /// A question for what an endless ray meets of what the wall's own picture shows.
    pub fn new(ray: Ray) -> Self {
        Self { ray, max_distance: None, subset: SceneSubset::default() }
    }
}

/// The first triangle that a ray meets, from either side.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RayHit {
    /// The state since which the scene is as it was looked at.
    pub revision: Revision,
    /// The node that has the mesh.
    pub node: NodeId,
    /// The node's name.
    #[serde(deserialize_with = "text_of_peer")]
    pub name: String,
    /// The place, in world space.
    pub position: DVec3,
    /// Out of the front of the triangle, of length 1, in world space; 0 of one without an area.
    pub normal: DVec3,
    /// From the ray's origin, in world units.
    pub distance: f64,
    /// `true` if the ray comes from the front.
    pub is_front: bool,
    /// An index into the materials of the scene; `None` is glTF's default material.
    pub material: Option<u32>,
}

/// A question for nodes by how their geometry lies to a region. Only nodes that are shown and whose
/// own mesh has triangles are found, whatever hangs from them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RegionQuery {
    /// The part of the world.
    pub region: Region,
    /// The relation of the triangles of a node to it, in all places of its mesh together.
    pub relation: Relation,
    /// The other demands on the nodes, and the page of them that is given.
    pub nodes: NodeQuery,
}

/// A question for the point of the scene's triangles that is nearest to a point.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NearestQuery {
    /// In world space.
    pub point: DVec3,
    /// Maximum distance, in world units, 0 or more; unlimited if `None`.
    pub within: Option<f64>,
}

/// The point of the scene's triangles that is nearest to another point.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NearestPoint {
    /// The state since which the scene is as it was looked at.
    pub revision: Revision,
    /// The node whose mesh has the point; one of them if several do.
    pub node: NodeId,
    /// The name of that node; may be empty.
    #[serde(deserialize_with = "text_of_peer")]
    pub name: String,
    /// The nearest point, in world space.
    pub position: DVec3,
    /// The distance between the two points, in world units.
    pub distance: f64,
}

/// Nodes that were found, parents before their children.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NodePage {
    /// The state since which the scene is as it was looked at.
    pub revision: Revision,
    /// The number of all nodes found.
    pub found: u64,
    /// Those from [`NodeQuery::skip`] on, as many as fit.
    pub nodes: Vec<NodeInfo>,
}
