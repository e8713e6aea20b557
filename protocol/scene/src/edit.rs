//! Changes of a scene while it is shown.

use std::fmt;
use std::ops::Range;

use glam::DAffine3;
use serde::de::{self, Unexpected, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use crate::{Facing, Light, Material, NodeStyle};
use polyptych_files::blob::BlobHash;

/// A node of the open scene, for as long as the scene is open, restarts of the manager included.
/// Nodes of the file have their index in [`Scene::nodes`](crate::Scene::nodes); those that were
/// made since count on from there, and no number is given twice.
///
/// A number on the wire. JSON may also have the number as text, and `"new:0"` for the node that the
/// first creation of a transaction makes: readers whose numbers are doubles, such as browsers,
/// cannot tell provisional numbers apart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
pub struct NodeId(pub u64);

/// The first provisional number of nodes, for nodes without a number.
const PROVISIONAL: u64 = 1 << 63;

/// The text before the index of a creation.
const PROVISIONAL_PREFIX: &str = "new:";

/// The first provisional number of meshes and textures.
const PROVISIONAL_ASSET: u32 = 1 << 31;

impl NodeId {
    /// Stands in a transaction for the node that its `index`th creation makes.
    pub fn provisional(index: u64) -> Self {
        Self(PROVISIONAL | index)
    }

    /// The index of the creation that this stands for, if it does.
    pub fn provisional_index(self) -> Option<u64> {
        (self.0 >= PROVISIONAL).then_some(self.0 & !PROVISIONAL)
    }
}

impl<'de> Deserialize<'de> for NodeId {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        if !deserializer.is_human_readable() {
            return u64::deserialize(deserializer).map(Self);
        }
        deserializer.deserialize_any(NodeIdVisitor)
    }
}

/// Reads a number, or a text in its place.
struct NodeIdVisitor;

impl Visitor<'_> for NodeIdVisitor {
    type Value = NodeId;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the number of a node, or \"new:0\" for the first that is made")
    }

    fn visit_u64<E: de::Error>(self, number: u64) -> Result<NodeId, E> {
        Ok(NodeId(number))
    }

    fn visit_i64<E: de::Error>(self, number: i64) -> Result<NodeId, E> {
        let unsigned = u64::try_from(number).map(NodeId);
        unsigned.map_err(|_| E::invalid_value(Unexpected::Signed(number), &self))
    }

    fn visit_str<E: de::Error>(self, text: &str) -> Result<NodeId, E> {
        let node = match text.strip_prefix(PROVISIONAL_PREFIX) {
            Some(index) => {
                let index = index.parse::<u64>().ok().filter(|index| *index < PROVISIONAL);
                index.map(NodeId::provisional)
            }
            // Keys of objects are texts.
            None => text.parse::<u64>().ok().map(NodeId),
        };
        node.ok_or_else(|| E::invalid_value(Unexpected::Str(text), &self))
    }
}

impl fmt::Display for NodeId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.provisional_index() {
            Some(index) => write!(f, "new node {index}"),
            None => write!(f, "node {}", self.0),
        }
    }
}

/// One addition of assets to a scene: two of the same manifest have two. Others hardly ever share
/// it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct AssetSetId(pub BlobHash);

/// Meshes, materials and textures that were added to a scene: those of another manifest. They stay
/// for as long as anything of the scene uses them.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct AssetSet {
    /// A [`Scene`](crate::Scene) of which the nodes and lights do not count.
    pub manifest: BlobHash,
    /// The number of its first mesh among those of the open scene; the others follow.
    pub first_mesh: u32,
    /// The number of primitives of each of its meshes.
    pub primitives: Vec<u32>,
    /// The number of its first material, as `first_mesh`.
    pub first_material: u32,
    /// The number of its materials.
    pub materials: u32,
    /// The number of its first texture, as `first_mesh`.
    pub first_texture: u32,
    /// The number of its textures.
    pub textures: u32,
}

impl AssetSet {
    /// Its id: no two sets of a scene have the same first mesh.
    pub fn id(&self) -> AssetSetId {
        let mut name = self.manifest.0.to_vec();
        name.extend(self.first_mesh.to_le_bytes());
        AssetSetId(BlobHash::of(&name))
    }

    /// The numbers of its meshes.
    pub fn mesh_range(&self) -> Range<u32> {
        self.first_mesh..self.first_mesh.saturating_add(self.primitives.len() as u32)
    }

    /// The numbers of its materials.
    pub fn material_range(&self) -> Range<u32> {
        self.first_material..self.first_material.saturating_add(self.materials)
    }

    /// Returns the number of one of its materials, by its index in the manifest.
    pub(crate) fn material_number(&self, index: u32) -> u32 {
        self.first_material.saturating_add(index)
    }

    /// The numbers of its textures.
    pub fn texture_range(&self) -> Range<u32> {
        self.first_texture..self.first_texture.saturating_add(self.textures)
    }
}

/// Stands in a transaction for a mesh or texture that it adds, by its index among those.
pub fn provisional_asset(index: u32) -> u32 {
    PROVISIONAL_ASSET | index
}

/// The index that stands for a mesh or texture of the same transaction, if it does.
pub fn provisional_asset_index(number: u32) -> Option<u32> {
    (number >= PROVISIONAL_ASSET).then_some(number & !PROVISIONAL_ASSET)
}

/// An application's data about a node, beside its picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Attribute {
    /// Yes or no.
    Bool(bool),
    /// A number; finite.
    Number(f64),
    /// At most [`crate::limits::ATTRIBUTE_BYTES_MAX`] bytes.
    Text(String),
}

/// A node as it is made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NewNode {
    /// The node that it hangs from; `None` for the scene itself.
    pub parent: Option<NodeId>,
    /// May be empty or stand twice; at most [`crate::limits::NODE_NAME_BYTES_MAX`] bytes.
    pub name: String,
    /// Parent space from this node's space.
    pub local: DAffine3,
    /// An index into the meshes of the scene: two nodes with one mesh are two instances of it.
    pub mesh: Option<u32>,
    /// It shines along −Z of the node.
    pub light: Option<Light>,
}

impl Default for NewNode {
    /// A node without a name that shows nothing, at the scene's origin.
    fn default() -> Self {
        let (name, local) = (String::new(), DAffine3::IDENTITY);
        Self { parent: None, name, local, mesh: None, light: None }
    }
}

/// One change of a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum Edit {
    /// Makes a node.
    Create {
        /// Its number; in a transaction on its way to the manager the provisional one.
        node: NodeId,
        /// The node's data.
        new: Box<NewNode>,
    },
    /// Takes a node away with all that hangs from it.
    Remove(NodeId),
    /// Hangs a node, with all that hangs from it, from another; its transform stays as it is.
    SetParent {
        /// The node.
        node: NodeId,
        /// `None` for the scene itself.
        parent: Option<NodeId>,
    },
    /// Places a node in its parent's space.
    SetTransform {
        /// The node.
        node: NodeId,
        /// Parent space from this node's space; finite and not singular.
        local: DAffine3,
    },
    /// Shows a node with all that hangs from it, or does not.
    SetVisible {
        /// The node.
        node: NodeId,
        /// `true` if it is shown when its parents are.
        visible: bool,
    },
    /// Names a node.
    SetName {
        /// The node.
        node: NodeId,
        /// The new name; see [`NewNode::name`].
        name: String,
    },
    /// Gives a node another mesh, or none.
    SetMesh {
        /// The node.
        node: NodeId,
        /// The new mesh; see [`NewNode::mesh`].
        mesh: Option<u32>,
    },
    /// Gives a node another light, or none.
    SetLight {
        /// The node.
        node: NodeId,
        /// The new light; see [`NewNode::light`].
        light: Option<Light>,
    },
    /// Notes something about a node, or forgets it.
    SetAttribute {
        /// The node.
        node: NodeId,
        /// At most [`crate::limits::NODE_NAME_BYTES_MAX`] bytes, and not empty.
        key: String,
        /// `None` forgets it.
        value: Option<Attribute>,
    },
    /// Gives a material of the scene another look, on all that has it.
    SetMaterial {
        /// An index into the materials of the scene.
        material: u32,
        /// All of it.
        to: Box<Material>,
    },
    /// Adds meshes, materials and textures. No client can ask for it as such: the manager makes it
    /// of what a transaction brings.
    AddAssets(Box<AssetSet>),
    /// Takes a set of them away; nothing uses it any more.
    RemoveAssets(AssetSetId),
    /// Puts a node, with all that hangs from it and has no layer of its own, into a layer.
    SetLayer {
        /// The node.
        node: NodeId,
        /// The name of the layer, not empty, at most [`crate::limits::NODE_NAME_BYTES_MAX`] bytes;
        /// `None` for the layer of the node's parent.
        layer: Option<String>,
    },
    /// Shows the nodes of a layer, or does not, in the wall's own picture and in views that choose
    /// no layers of their own.
    SetLayerVisible {
        /// The name of a layer that nodes are in.
        layer: String,
        /// `true` shows its nodes, where nothing else hides them.
        visible: bool,
    },
    /// Shows only one of the nodes that hang from a node.
    SetSwitch {
        /// The node.
        node: NodeId,
        /// The child that is shown; `None` for all. Once it is removed or hangs elsewhere, none is
        /// shown.
        shown: Option<NodeId>,
    },
    /// Draws a node, with all that hangs from it and has no style of its own, in another way.
    SetStyle {
        /// The node.
        node: NodeId,
        /// All of its style.
        style: NodeStyle,
    },
    /// Lets a node turn towards the viewer. Questions about the scene find it as it stands without
    /// that.
    SetFacing {
        /// The node.
        node: NodeId,
        /// `None` for one that stays as it is.
        facing: Option<Facing>,
    },
    /// Shows a variant of the scene's file, by its name or its number from 0 on; `None` for the
    /// materials that its parts have without one. Materials that were changed stay changed.
    SetVariant(Option<String>),
}

impl Edit {
    /// The node that it changes; `None` for a material, for assets, for a variant and for the
    /// visibility of a layer.
    pub fn node(&self) -> Option<NodeId> {
        match self {
            Self::Create { node, .. }
            | Self::Remove(node)
            | Self::SetParent { node, .. }
            | Self::SetTransform { node, .. }
            | Self::SetVisible { node, .. }
            | Self::SetName { node, .. }
            | Self::SetMesh { node, .. }
            | Self::SetLight { node, .. }
            | Self::SetAttribute { node, .. }
            | Self::SetLayer { node, .. }
            | Self::SetSwitch { node, .. }
            | Self::SetStyle { node, .. }
            | Self::SetFacing { node, .. } => Some(*node),
            Self::SetMaterial { .. }
            | Self::AddAssets(_)
            | Self::RemoveAssets(_)
            | Self::SetVariant(_)
            | Self::SetLayerVisible { .. } => None,
        }
    }

    /// Returns whether other nodes, meshes, lights or textures may be in use after it.
    pub fn changes_contents(&self) -> bool {
        !matches!(
            self,
            Self::SetTransform { .. }
                | Self::SetVisible { .. }
                | Self::SetName { .. }
                | Self::SetAttribute { .. }
        )
    }

    /// Returns the edit with other numbers of nodes.
    ///
    /// # Errors
    /// The error of `number`.
    pub fn with_nodes<E>(
        mut self,
        mut number: impl FnMut(NodeId) -> Result<NodeId, E>,
    ) -> Result<Self, E> {
        match &mut self {
            Self::Create { node, new } => {
                *node = number(*node)?;
                new.parent = new.parent.map(&mut number).transpose()?;
            }
            Self::SetParent { node, parent } => {
                *node = number(*node)?;
                *parent = parent.map(&mut number).transpose()?;
            }
            Self::Remove(node)
            | Self::SetTransform { node, .. }
            | Self::SetVisible { node, .. }
            | Self::SetName { node, .. }
            | Self::SetMesh { node, .. }
            | Self::SetLight { node, .. }
            | Self::SetAttribute { node, .. }
            | Self::SetLayer { node, .. }
            | Self::SetStyle { node, .. }
            | Self::SetFacing { node, .. } => *node = number(*node)?,
            Self::SetSwitch { node, shown } => {
                *node = number(*node)?;
                *shown = shown.map(&mut number).transpose()?;
            }
            Self::SetMaterial { .. }
            | Self::AddAssets(_)
            | Self::RemoveAssets(_)
            | Self::SetVariant(_)
            | Self::SetLayerVisible { .. } => {}
        }
        Ok(self)
    }

    /// Returns the edit with other numbers of meshes and textures.
    ///
    /// # Errors
    /// The errors of `mesh` and `texture`.
    pub fn with_assets<E>(
        mut self,
        mesh: impl Fn(u32) -> Result<u32, E>,
        texture: impl Fn(u32) -> Result<u32, E>,
    ) -> Result<Self, E> {
        match &mut self {
            Self::Create { new, .. } => new.mesh = new.mesh.map(mesh).transpose()?,
            Self::SetMesh { mesh: of, .. } => *of = of.map(mesh).transpose()?,
            Self::SetMaterial { to, .. } => {
                for of in to.textures_mut() {
                    of.texture = texture(of.texture)?;
                }
            }
            _ => {}
        }
        Ok(self)
    }
}
