//! The data of a scene that suffice to check an edit of it.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::edit::{AssetSet, Edit, NewNode, NodeId};
use crate::layers::{Layers, SceneSubset};
use crate::limits::{
    ASSET_SETS_MAX, DEPTH_MAX, DRAWS_MAX, EDITS_BYTES_MAX, LIT_DRAWS_MAX, NODE_NAME_BYTES_MAX,
};
use crate::node_edits::NodeEdits;
use crate::scene_edits::SceneEdits;
use crate::{AlphaMode, Material, Scene, endless_lights, find_variant};

mod assets;
mod values;

pub use values::{CAMERA_KEY, check_attribute};
use values::{check_layer, check_light, check_text, check_transform};

/// A scene without what it looks like: some bytes for each node.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SceneOutline {
    /// The index of each node's parent.
    parents: Vec<Option<u32>>,
    /// Primitives of each mesh.
    meshes: Vec<u32>,
    materials: u32,
    textures: u32,
    /// Nodes with a light that has no range.
    lights: u64,
    /// The number of places of each node that stands in several.
    copies: BTreeMap<u32, u32>,
    /// Primitives, each in every place.
    draws: u64,
    /// Names of variants.
    variants: Vec<String>,
}

/// The reason why an edit is refused. The scene is as it was.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EditError {
    /// There is no such node.
    #[error("there is no {0}; it was removed, or never made")]
    NoNode(NodeId),
    /// More nodes stand above it than an edit looks at.
    #[error("{0} stands too deep: below at most {DEPTH_MAX} nodes, each hanging from the next")]
    TooDeep(NodeId),
    /// A node would hang from itself.
    #[error("{node} cannot hang from {parent}, which hangs from it")]
    Circle {
        /// The node.
        node: NodeId,
        /// The node that it was to hang from.
        parent: NodeId,
    },
    /// A number is not one that can be.
    #[error("{node}: {what}")]
    Value {
        /// The node.
        node: NodeId,
        /// The fault, and the fix.
        what: String,
    },
    /// A material that is not there, or cannot be.
    #[error("material {material}: {what}")]
    Material {
        /// Its index.
        material: u32,
        /// The fault, and the fix.
        what: String,
    },
    /// A layer that no node is in, or an invalid name.
    #[error("layer {layer}: {what}")]
    Layer {
        /// Its name.
        layer: String,
        /// The fault, and the fix.
        what: String,
    },
    /// A variant that is not there; the text says which are.
    #[error("{0}")]
    Variant(String),
    /// The scene would be too large.
    #[error("{0}")]
    TooLarge(String),
}

impl From<&Scene> for SceneOutline {
    fn from(scene: &Scene) -> Self {
        Self {
            parents: scene.nodes.iter().map(|node| node.parent).collect(),
            meshes: scene.meshes.iter().map(|mesh| mesh.primitives.len() as u32).collect(),
            materials: scene.materials.len() as u32,
            textures: scene.textures.len() as u32,
            lights: endless_lights(&scene.nodes, &scene.lights),
            copies: (0..)
                .zip(scene.nodes.iter().map(|node| node.instances.len() as u32))
                .filter(|(_, copies)| *copies > 1)
                .collect(),
            draws: scene.draws(),
            variants: scene.variants.iter().map(|of| of.name.clone()).collect(),
        }
    }
}

impl SceneOutline {
    /// The names of the variants of the scene's file, in the order of their numbers.
    pub fn variants(&self) -> &[String] {
        &self.variants
    }

    /// Returns the number of nodes in the scene's file.
    pub fn nodes(&self) -> u64 {
        self.parents.len() as u64
    }

    /// Checks that this edit is valid after `edits`; a new node or asset must have its number
    /// already.
    ///
    /// # Errors
    /// [`EditError`].
    pub fn check(&self, edits: &SceneEdits, edit: &Edit) -> Result<(), EditError> {
        let fault = |node: NodeId| move |what: String| EditError::Value { node, what };
        match edit {
            Edit::Create { node, new } => {
                if let Some(parent) = new.parent {
                    self.expect_parent(edits, parent)?;
                }
                self.check_new(edits, new).map_err(fault(*node))
            }
            Edit::SetParent { node, parent } => {
                self.expect_node(edits, *node)?;
                let Some(parent) = *parent else { return Ok(()) };
                self.expect_parent(edits, parent)?;
                if self.hangs_from(edits, parent, *node) {
                    return Err(EditError::Circle { node: *node, parent });
                }
                Ok(())
            }
            Edit::SetMaterial { material, to } => {
                let error = |what| EditError::Material { material: *material, what };
                let is_added = |set: &AssetSet| set.material_range().contains(material);
                if *material >= self.materials && !edits.assets().any(is_added) {
                    return Err(error("the scene has no such material".to_owned()));
                }
                self.check_material(edits, to).map_err(error)
            }
            Edit::Remove(node) | Edit::SetVisible { node, .. } | Edit::SetFacing { node, .. } => {
                self.expect_node(edits, *node)
            }
            Edit::SetTransform { node, local } => {
                self.expect_node(edits, *node)?;
                check_transform(local).map_err(fault(*node))
            }
            Edit::SetName { node, name } => {
                self.expect_node(edits, *node)?;
                check_text("a name", name, NODE_NAME_BYTES_MAX).map_err(fault(*node))
            }
            Edit::SetMesh { node, mesh } => {
                self.expect_node(edits, *node)?;
                self.check_mesh(edits, *mesh).map_err(fault(*node))
            }
            Edit::SetLight { node, light } => {
                self.expect_node(edits, *node)?;
                check_light(light.as_ref()).map_err(fault(*node))
            }
            Edit::SetAttribute { node, key, value } => {
                self.expect_node(edits, *node)?;
                let known = edits.node(*node).map(|edits| &edits.attributes);
                check_attribute(known, key, value.as_ref()).map_err(fault(*node))
            }
            Edit::AddAssets(_) if edits.assets().count() >= ASSET_SETS_MAX => {
                Err(EditError::TooLarge(format!(
                    "assets of {ASSET_SETS_MAX} transactions are in the scene already; put more \
                     of them into one, or show meshes that are there by their numbers"
                )))
            }
            Edit::AddAssets(_) | Edit::RemoveAssets(_) | Edit::SetVariant(None) => Ok(()),
            Edit::SetVariant(Some(name)) => {
                find_variant(&self.variants, name).map(drop).map_err(EditError::Variant)
            }
            Edit::SetLayer { .. }
            | Edit::SetLayerVisible { .. }
            | Edit::SetSwitch { .. }
            | Edit::SetStyle { .. } => self.check_shown(edits, edit),
        }
    }

    /// The part of [`Self::check`] for edits that choose what is shown, and how.
    fn check_shown(&self, edits: &SceneEdits, edit: &Edit) -> Result<(), EditError> {
        match edit {
            Edit::SetLayer { node, layer } => {
                self.expect_node(edits, *node)?;
                let Some(layer) = layer else { return Ok(()) };
                let fault = |what| EditError::Value { node: *node, what };
                check_layer(edits.layers(), layer).map_err(fault)
            }
            Edit::SetLayerVisible { layer, visible } => {
                if *visible || edits.layers().has(layer) {
                    return Ok(());
                }
                Err(no_such_layer(edits.layers(), layer))
            }
            Edit::SetSwitch { node, shown } => {
                self.expect_node(edits, *node)?;
                let Some(child) = *shown else { return Ok(()) };
                self.expect_node(edits, child)?;
                if self.parent_of(edits, child) == Some(*node) {
                    return Ok(());
                }
                let what = format!("its switch shows one of its children, and {child} is none");
                Err(EditError::Value { node: *node, what })
            }
            Edit::SetStyle { node, style } => {
                self.expect_node(edits, *node)?;
                let fault = |what| EditError::Value { node: *node, what };
                style.fault().map_or(Ok(()), |what| Err(fault(what)))
            }
            _ => Ok(()),
        }
    }

    /// Checks that all edits together are of a size that can be held, sent and drawn.
    ///
    /// # Errors
    /// [`EditError::TooLarge`].
    pub fn check_size(&self, edits: &SceneEdits) -> Result<(), EditError> {
        self.check_bytes(edits)?;
        self.check_draws(edits)
    }

    /// Checks that all that was changed can be held and sent.
    ///
    /// # Errors
    /// [`EditError::TooLarge`].
    pub fn check_bytes(&self, edits: &SceneEdits) -> Result<(), EditError> {
        if edits.bytes() > EDITS_BYTES_MAX as u64 {
            return Err(EditError::TooLarge(format!(
                "all changes of the scene would take {} bytes, where {EDITS_BYTES_MAX} can be kept",
                edits.bytes()
            )));
        }
        Ok(())
    }

    /// Checks that all that is drawn can be.
    fn check_draws(&self, edits: &SceneEdits) -> Result<(), EditError> {
        // What was taken away or hidden is not subtracted: it may come back.
        let (mut draws, mut lights) = (self.draws, self.lights);
        // Sorted once: there may be thousands of them, and of nodes far more.
        let sets = edits.sets_in_order();
        for (node, of) in edits.nodes() {
            let made = of.created.as_ref();
            let copies = u32::try_from(node.0).ok().and_then(|node| self.copies.get(&node));
            let mesh = of.mesh.unwrap_or(made.and_then(|new| new.mesh));
            let primitives = mesh.and_then(|mesh| self.primitives(&sets, mesh));
            let primitives = u64::from(primitives.unwrap_or(0));
            draws = draws.saturating_add(primitives * u64::from(*copies.unwrap_or(&1)));
            let made_with = || made.and_then(|new| new.light.as_ref());
            let light = of.light.as_ref().map_or_else(made_with, Option::as_ref);
            lights += u64::from(light.is_some_and(|light| light.finite_range().is_none()));
        }
        if draws > DRAWS_MAX {
            return Err(EditError::TooLarge(format!(
                "the scene would draw {draws} primitives, where {DRAWS_MAX} can be drawn"
            )));
        }
        if draws.saturating_mul(lights) > LIT_DRAWS_MAX {
            return Err(EditError::TooLarge(format!(
                "{lights} lights without a range would shine on {draws} primitives, where the \
                 product can be {LIT_DRAWS_MAX}"
            )));
        }
        Ok(())
    }

    /// The nodes that were made and hang from one that is not there any more. Looks at each node
    /// that was edited once.
    pub fn orphans(&self, edits: &SceneEdits) -> Vec<NodeId> {
        // Whether a node is there, with all that it hangs from.
        let mut known: BTreeMap<NodeId, bool> = BTreeMap::new();
        let (mut orphans, mut way) = (Vec::new(), Vec::new());
        for (node, of) in edits.nodes() {
            let mut next = Some(node);
            let is_there = loop {
                let Some(at) = next else { break true };
                if let Some(is_there) = known.get(&at) {
                    break *is_there;
                }
                if !self.has(edits, at) {
                    known.insert(at, false);
                    break false;
                }
                // A circle ends here; there is none.
                known.insert(at, false);
                way.push(at);
                next = self.parent_of(edits, at);
            };
            known.extend(way.drain(..).map(|at| (at, is_there)));
            if of.created.is_some() && !is_there {
                orphans.push(node);
            }
        }
        orphans
    }

    /// A node and all that it hangs from, from below; `None` if one of them is not there. It may
    /// be more than an edit looks at: files may be deeper.
    pub fn way_up(&self, edits: &SceneEdits, node: NodeId) -> Option<Vec<NodeId>> {
        // Ends a circle, too, though there is none: each node that was edited takes some bytes.
        let nodes_max = self.nodes().saturating_add(edits.bytes()).max(1) as usize;
        let up = std::iter::successors(Some(node), |node| self.parent_of(edits, *node));
        let way: Vec<NodeId> = up.take(nodes_max).collect();
        way.iter().all(|node| self.has(edits, *node)).then_some(way)
    }

    /// Checks that a part of the edited scene can be asked for.
    ///
    /// # Errors
    /// Its root is not there, or no node is in one of its layers.
    pub fn check_subset(&self, edits: &SceneEdits, subset: &SceneSubset) -> Result<(), EditError> {
        if let Some(root) = subset.root {
            self.expect_node(edits, root)?;
        }
        let layers = edits.layers();
        let mut asked = subset.layers.iter().flatten();
        let unknown = asked.find(|layer| !layers.has(layer));
        unknown.map_or(Ok(()), |layer| Err(no_such_layer(layers, layer)))
    }

    /// Returns whether a node was not taken away itself.
    fn has(&self, edits: &SceneEdits, node: NodeId) -> bool {
        self.is_there(node, edits.node(node))
    }

    /// Returns whether a node with these edits was not taken away itself.
    fn is_there(&self, node: NodeId, of: Option<&NodeEdits>) -> bool {
        match of {
            Some(of) => !of.is_removed && (of.created.is_some() || node.0 < self.nodes()),
            None => node.0 < self.nodes(),
        }
    }

    fn parent_of(&self, edits: &SceneEdits, node: NodeId) -> Option<NodeId> {
        self.parent(node, edits.node(node))
    }

    /// The parent of a node with these edits.
    fn parent(&self, node: NodeId, of: Option<&NodeEdits>) -> Option<NodeId> {
        let of_file = || {
            let index = usize::try_from(node.0).ok()?;
            self.parents.get(index).copied().flatten().map(|parent| NodeId(parent.into()))
        };
        let Some(of) = of else { return of_file() };
        of.parent.unwrap_or_else(|| match &of.created {
            Some(made) => made.parent,
            None => of_file(),
        })
    }

    /// Returns whether `node` is `from` or hangs from it.
    fn hangs_from(&self, edits: &SceneEdits, node: NodeId, from: NodeId) -> bool {
        let up = std::iter::successors(Some(node), |node| self.parent_of(edits, *node));
        up.take(DEPTH_MAX + 1).any(|node| node == from)
    }

    /// Checks that a node is there, with all that it hangs from.
    fn expect_node(&self, edits: &SceneEdits, node: NodeId) -> Result<(), EditError> {
        self.expect_within(edits, node, DEPTH_MAX)
    }

    /// Checks that a node is there and that another may hang from it.
    fn expect_parent(&self, edits: &SceneEdits, node: NodeId) -> Result<(), EditError> {
        self.expect_within(edits, node, DEPTH_MAX - 1)
    }

    fn expect_within(
        &self,
        edits: &SceneEdits,
        node: NodeId,
        above_max: usize,
    ) -> Result<(), EditError> {
        let (mut next, mut depth) = (Some(node), 0);
        while let Some(above) = next {
            // Looked up once for both questions.
            let of = edits.node(above);
            if !self.is_there(above, of) {
                return Err(EditError::NoNode(node));
            }
            if depth > above_max {
                return Err(EditError::TooDeep(node));
            }
            (next, depth) = (self.parent(above, of), depth + 1);
        }
        Ok(())
    }

    fn check_new(&self, edits: &SceneEdits, new: &NewNode) -> Result<(), String> {
        check_text("a name", &new.name, NODE_NAME_BYTES_MAX)?;
        check_transform(&new.local)?;
        self.check_mesh(edits, new.mesh)?;
        check_light(new.light.as_ref())
    }

    fn check_mesh(&self, edits: &SceneEdits, mesh: Option<u32>) -> Result<(), String> {
        match mesh.filter(|mesh| !self.has_mesh(edits, *mesh)) {
            Some(mesh) => {
                Err(format!("there is no mesh {mesh}; the scene's file has {}", self.meshes.len()))
            }
            None => Ok(()),
        }
    }

    fn check_material(&self, edits: &SceneEdits, material: &Material) -> Result<(), String> {
        check_text("a name", &material.name, NODE_NAME_BYTES_MAX)?;
        let is_there = |texture: u32| {
            texture < self.textures
                || edits.assets().any(|set| set.texture_range().contains(&texture))
        };
        if let Some(texture) = material.textures().find(|of| !is_there(of.texture)) {
            let (texture, count) = (texture.texture, self.textures);
            return Err(format!("there is no texture {texture}; the scene's file has {count}"));
        }
        let share = |what: &str, value: f32| {
            if (0.0..=1.0).contains(&value) {
                return Ok(());
            }
            Err(format!("{what} is 0 to 1, not {value}"))
        };
        share("metallic", material.metallic)?;
        share("roughness", material.roughness)?;
        share("occlusion_strength", material.occlusion_strength)?;
        let color = material.base_color;
        if !(color.is_finite() && color.min_element() >= 0.0 && color.max_element() <= 1.0) {
            return Err(format!("base_color is 0 to 1 in all four, not {color}"));
        }
        let emissive = material.emissive;
        if !(emissive.is_finite() && emissive.min_element() >= 0.0) {
            return Err(format!("emissive is 0 or more in all three, not {emissive}"));
        }
        if !material.normal_scale.is_finite() {
            return Err("normal_scale is a finite number".to_owned());
        }
        if matches!(material.alpha_mode, AlphaMode::Mask(cutoff) if !cutoff.is_finite()) {
            return Err("a mask's cutoff is a finite number".to_owned());
        }
        if material.textures().any(|of| !of.uv_transform.is_finite()) {
            return Err("a uv_transform is of finite numbers".to_owned());
        }
        if let Some(fault) = material.extensions.as_ref().and_then(|of| of.fault()) {
            return Err(fault);
        }
        Ok(())
    }
}

fn no_such_layer(layers: &Layers, layer: &str) -> EditError {
    let what = format!("no node is in it; of layers {}", layers.list());
    EditError::Layer { layer: layer.to_owned(), what }
}
