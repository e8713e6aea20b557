//! Changes of the open scene that belong together.

use bytes::Bytes;
use glam::DAffine3;
use polyptych_files::blob::BlobHash;
use polyptych_scene::{Attribute, Edit, Facing, Light, Material, NewNode, NodeId, NodeStyle};
use polyptych_text::text_of_peer;
use serde::{Deserialize, Serialize};

use crate::ids::Revision;

/// Changes of the scene that are seen from one frame on, on all displays, or not at all.
///
/// ```
/// use polyptych_protocol::transaction::Transaction;
/// use polyptych_scene::{NewNode, NodeId};
///
/// let mut transaction = Transaction::default();
/// let arm = transaction.create(NewNode { name: "arm".into(), ..NewNode::default() });
/// transaction.create(NewNode { parent: Some(arm), mesh: Some(0), ..NewNode::default() });
/// transaction.set_visible(NodeId(3), false);
/// assert_eq!(transaction.edits.len(), 3);
/// ```
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Transaction {
    /// The revision that the client has seen: a node or material that was changed since is not
    /// changed again, and the transaction refused. Where `None`, the last one wins.
    pub base: Option<Revision>,
    /// In order. What they create has provisional numbers.
    pub edits: Vec<Edit>,
    /// `true` if the nodes that it makes are removed when the connection of the client that made
    /// them ends, or with the manager: pointers, highlights, or content that another client draws
    /// again.
    pub is_temporary: bool,
    /// Meshes, materials and textures that come with it. Its edits name them by
    /// [`polyptych_scene::provisional_asset`]. They stay for as long as anything of the scene uses
    /// them. A file that is added again has other numbers, and so materials of its own to change;
    /// what it has in common with the first takes no memory again.
    pub assets: Option<NewAssets>,
}

/// Assets for the open scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NewAssets {
    /// The source of the assets.
    pub source: AssetSource,
    /// The node below which the source's nodes are made too, if given, behind all that the
    /// transaction makes otherwise.
    pub below: Option<Box<NewNode>>,
}

/// A source of assets.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum AssetSource {
    /// The bytes of a binary glTF file. Meshes that no node of its scene shows are left out, and
    /// not counted.
    Glb(Bytes),
    /// A glTF file in one of the manager's scene folders, as of
    /// [`Request::OpenScene`](crate::request::Request::OpenScene).
    File(#[serde(deserialize_with = "text_of_peer")] String),
    /// Blobs that the manager made of either. A client that sends it is refused.
    Baked(BakedAssets),
}

/// Assets as blobs of the manager.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct BakedAssets {
    /// See [`polyptych_scene::AssetSet`], as all of these.
    pub manifest: BlobHash,
    /// The number of primitives of each mesh.
    pub primitives: Vec<u32>,
    /// The number of materials.
    pub materials: u32,
    /// The number of textures.
    pub textures: u32,
    /// Parts of their file that are not drawn, or not as there; see
    /// [`polyptych_scene::Scene::notes`].
    #[serde(deserialize_with = "text_of_peer")]
    pub notes: Vec<String>,
}

impl NewAssets {
    /// Returns whether it may bring meshes. What was made of a file without any brings its notes
    /// alone, beside the nodes that the transaction makes.
    pub fn has_meshes(&self) -> bool {
        match &self.source {
            AssetSource::Baked(baked) => !baked.primitives.is_empty(),
            AssetSource::Glb(_) | AssetSource::File(_) => true,
        }
    }

    /// Takes the notes out of assets that were baked.
    pub fn take_notes(&mut self) -> Vec<String> {
        match &mut self.source {
            AssetSource::Baked(baked) => std::mem::take(&mut baked.notes),
            AssetSource::Glb(_) | AssetSource::File(_) => Vec::new(),
        }
    }
}

/// The numbers that assets got: the first of each kind; the others follow. Meshes are in the order
/// in which the nodes of their file show them. Once nothing uses the assets any more, others may
/// get the numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct AssetNumbers {
    /// The number of its first mesh, as [`NewNode::mesh`].
    pub first_mesh: u32,
    /// The number of its first material, as in [`Edit::SetMaterial`]. Materials are in the order of
    /// their file, those without a use too.
    pub first_material: u32,
    /// The number of its first texture, as in [`polyptych_scene::TextureRef`]. Only textures of
    /// materials that meshes use have numbers, in the order in which meshes first use them; one
    /// that is read as a colour and as data has two.
    pub first_texture: u32,
}

impl Transaction {
    /// Changes of a scene as it was at this revision.
    pub fn based_on(base: Revision) -> Self {
        Self { base: Some(base), ..Self::default() }
    }

    /// Changes of which the nodes that are made end with this client's connection.
    pub fn temporary() -> Self {
        Self { is_temporary: true, ..Self::default() }
    }

    /// Returns the transaction with these assets.
    #[must_use]
    pub fn with_assets(self, source: AssetSource) -> Self {
        Self { assets: Some(NewAssets { source, below: None }), ..self }
    }

    /// Returns the transaction with all of a file, below a node that is made for it.
    #[must_use]
    pub fn with_scene(self, source: AssetSource, below: NewNode) -> Self {
        Self { assets: Some(NewAssets { source, below: Some(below.into()) }), ..self }
    }

    /// Makes a node; returns its provisional number, which later edits of this transaction can
    /// use. `Edited::node` says its own number once the transaction is done.
    pub fn create(&mut self, new: NewNode) -> NodeId {
        let node = NodeId::provisional(self.creations());
        self.edits.push(Edit::Create { node, new: Box::new(new) });
        node
    }

    /// Returns the number of nodes that it makes.
    pub fn creations(&self) -> u64 {
        let last = self.edits.iter().rev().find_map(|edit| match edit {
            Edit::Create { node, .. } => node.provisional_index(),
            _ => None,
        });
        last.map_or(0, |last| last + 1)
    }

    /// Takes a node away with all that hangs from it.
    pub fn remove(&mut self, node: NodeId) {
        self.edits.push(Edit::Remove(node));
    }

    /// Hangs a node from another, or from the scene itself; its transform stays as it is.
    pub fn set_parent(&mut self, node: NodeId, parent: Option<NodeId>) {
        self.edits.push(Edit::SetParent { node, parent });
    }

    /// Places a node in its parent's space.
    pub fn set_transform(&mut self, node: NodeId, local: DAffine3) {
        self.edits.push(Edit::SetTransform { node, local });
    }

    /// Shows a node with all that hangs from it, or does not.
    pub fn set_visible(&mut self, node: NodeId, visible: bool) {
        self.edits.push(Edit::SetVisible { node, visible });
    }

    /// Names a node.
    pub fn set_name(&mut self, node: NodeId, name: impl Into<String>) {
        self.edits.push(Edit::SetName { node, name: name.into() });
    }

    /// Gives a node another mesh of the scene, by its index, or none.
    pub fn set_mesh(&mut self, node: NodeId, mesh: Option<u32>) {
        self.edits.push(Edit::SetMesh { node, mesh });
    }

    /// Gives a node another light, or none.
    pub fn set_light(&mut self, node: NodeId, light: Option<Light>) {
        self.edits.push(Edit::SetLight { node, light });
    }

    /// Notes something about a node; `None` forgets it.
    pub fn set_attribute(
        &mut self,
        node: NodeId,
        key: impl Into<String>,
        value: Option<Attribute>,
    ) {
        self.edits.push(Edit::SetAttribute { node, key: key.into(), value });
    }

    /// Puts a node, with all that hangs from it and has no layer of its own, into a layer; `None`
    /// into that of its parent.
    pub fn set_layer(&mut self, node: NodeId, layer: Option<&str>) {
        self.edits.push(Edit::SetLayer { node, layer: layer.map(str::to_owned) });
    }

    /// Shows or hides all nodes of a layer, but in views that choose layers of their own.
    pub fn set_layer_visible(&mut self, layer: impl Into<String>, visible: bool) {
        self.edits.push(Edit::SetLayerVisible { layer: layer.into(), visible });
    }

    /// Shows only one of the nodes that hang from a node; `None` for all.
    pub fn set_switch(&mut self, node: NodeId, shown: Option<NodeId>) {
        self.edits.push(Edit::SetSwitch { node, shown });
    }

    /// Draws a node, with all that hangs from it and has no style of its own, in another way.
    pub fn set_style(&mut self, node: NodeId, style: NodeStyle) {
        self.edits.push(Edit::SetStyle { node, style });
    }

    /// Lets a node, with all that hangs from it, turn towards the viewer.
    pub fn set_facing(&mut self, node: NodeId, facing: Option<Facing>) {
        self.edits.push(Edit::SetFacing { node, facing });
    }

    /// Shows a variant of the scene's file, by its name or its number from 0 on; `None` for none.
    pub fn set_variant(&mut self, variant: Option<&str>) {
        self.edits.push(Edit::SetVariant(variant.map(str::to_owned)));
    }

    /// Gives a material of the scene, by its index, another look.
    pub fn set_material(&mut self, material: u32, to: Material) {
        self.edits.push(Edit::SetMaterial { material, to: Box::new(to) });
    }
}
