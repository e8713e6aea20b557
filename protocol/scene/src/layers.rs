//! Layers: named groups of nodes that are shown or hidden together.
//!
//! A node without a layer of its own is in that of its parent. Nodes that are in no layer are
//! always shown.

use std::borrow::Cow;
use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::limits::LAYERS_MAX;
use crate::{Facing, Material, MaterialProperty, Node, NodeEdits, NodeId, NodeStyle, SceneEdits};

/// The layers of an edited scene, by name.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Layers(BTreeMap<String, Layer>);

/// A layer that nodes were put into, or that is hidden.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Layer {
    /// The number of nodes that have it as their own.
    nodes: u32,
    is_hidden: bool,
}

impl Layers {
    /// Returns whether there are none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Returns their number.
    pub fn count(&self) -> usize {
        self.0.len()
    }

    /// Returns their names, in order, and whether each is hidden.
    pub fn all(&self) -> impl Iterator<Item = (&str, bool)> {
        self.0.iter().map(|(name, layer)| (name.as_str(), layer.is_hidden))
    }

    /// Returns whether there is a layer of this name.
    pub fn has(&self, name: &str) -> bool {
        self.0.contains_key(name)
    }

    /// Returns whether a layer is hidden.
    pub fn is_hidden(&self, name: &str) -> bool {
        self.0.get(name).is_some_and(|layer| layer.is_hidden)
    }

    /// Returns their names with commas between them, for errors.
    pub fn list(&self) -> String {
        if self.0.is_empty() {
            return "there is none".to_owned();
        }
        let names: Vec<&str> = self.0.keys().map(String::as_str).collect();
        format!("there are {}", names.join(", "))
    }

    /// Counts a node that was put into a layer.
    pub(crate) fn enter(&mut self, name: &str) {
        self.change(name, |layer| layer.nodes += 1);
    }

    /// Counts a node that was taken out of a layer.
    pub(crate) fn leave(&mut self, name: &str) {
        self.change(name, |layer| layer.nodes = layer.nodes.saturating_sub(1));
    }

    /// Hides a layer, or does not; returns whether it was hidden.
    pub(crate) fn hide(&mut self, name: &str, is_hidden: bool) -> bool {
        let mut was_hidden = false;
        self.change(name, |layer| {
            was_hidden = std::mem::replace(&mut layer.is_hidden, is_hidden);
        });
        was_hidden
    }

    /// A layer that is shown and has no nodes needs no entry.
    fn change(&mut self, name: &str, change: impl FnOnce(&mut Layer)) {
        let mut layer = self.0.get(name).copied().unwrap_or_default();
        change(&mut layer);
        if layer == Layer::default() {
            self.0.remove(name);
        } else {
            self.0.insert(name.to_owned(), layer);
        }
    }
}

/// The part of a scene that a view shows. Lights outside of it shine into it, but for those of
/// layers that it does not show.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneSubset {
    /// Only what hangs from this node is shown, the node itself among it; all if `None`, nothing if
    /// there is no such node.
    pub root: Option<NodeId>,
    /// Names of the layers that are shown; those that the scene shows if `None`. What is in no
    /// layer is always shown.
    pub layers: Option<Vec<String>>,
}

impl SceneSubset {
    /// Returns whether a layer is shown, which the scene hides or does not.
    pub fn shows_layer(&self, name: &str, is_hidden: bool) -> bool {
        match &self.layers {
            Some(layers) => layers.iter().any(|layer| layer == name),
            None => !is_hidden,
        }
    }
}

/// Traits of the nodes of an edited scene that its manifest has no place for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NodeTraits {
    /// The number of each node, in the order of the scene's nodes.
    pub ids: Vec<NodeId>,
    /// The names of the layers, in order, and whether each is hidden; at most [`LAYERS_MAX`].
    pub layers: Vec<(String, bool)>,
    /// For each node the index of its layer, its own or inherited. Empty if there are no layers.
    pub layer_of: Vec<Option<u8>>,
    /// For each node the style in which it is drawn, its own or inherited. Empty if all are drawn
    /// as they are.
    pub styles: Vec<NodeStyle>,
    /// For each node the way in which it turns towards the viewer by itself. Empty if none does.
    pub facings: Vec<Option<Facing>>,
    /// Indices of the nodes that clips may move, rising.
    pub moving: Vec<u32>,
    /// `true` where a clip may turn some of them inside out.
    pub may_mirror: bool,
    /// Indices of the nodes with lights that clips may change, rising.
    pub changing_lights: Vec<u32>,
    /// The materials that clips may change, rising, with each of the properties.
    pub changing_materials: Vec<(u32, MaterialProperty)>,
}

impl NodeTraits {
    /// Returns whether a clip may move a node.
    pub fn is_moving(&self, node: usize) -> bool {
        u32::try_from(node).is_ok_and(|node| self.moving.binary_search(&node).is_ok())
    }

    /// Returns whether clips may change the light of a node.
    pub fn has_changing_light(&self, node: usize) -> bool {
        u32::try_from(node).is_ok_and(|node| self.changing_lights.binary_search(&node).is_ok())
    }

    /// A material as one that asks of a renderer all that it may ask while clips change it.
    pub fn with_changes<'a>(&self, index: u32, material: &'a Material) -> Cow<'a, Material> {
        let first = self.changing_materials.partition_point(|(of, _)| *of < index);
        let changes = self.changing_materials[first..].iter();
        let mut material = Cow::Borrowed(material);
        for (_, property) in changes.take_while(|(of, _)| *of == index) {
            property.ask_for_most(material.to_mut());
        }
        material
    }

    /// The traits of a scene that was not edited: its nodes have their indices as numbers.
    pub fn of_file(nodes: usize) -> Self {
        Self { ids: (0..nodes as u64).map(NodeId).collect(), ..Self::default() }
    }
}

impl SceneEdits {
    /// The traits of nodes that [`SceneEdits::apply_to`] or [`SceneEdits::all_nodes`] made.
    pub fn traits(&self, nodes: &[Node], ids: Vec<NodeId>) -> NodeTraits {
        let layers = self.layers().all().take(LAYERS_MAX);
        let layers: Vec<_> = layers.map(|(name, hidden)| (name.to_owned(), hidden)).collect();
        let mut layer_of = Vec::new();
        if !layers.is_empty() {
            layer_of.reserve(nodes.len());
            for (node, id) in nodes.iter().zip(&ids) {
                let own = self.node(*id).and_then(|edits| edits.layer.as_ref());
                let own = own.and_then(|own| layers.binary_search_by(|of| of.0.cmp(own)).ok());
                let inherited = || node.parent.and_then(|parent| layer_of[parent as usize]);
                layer_of.push(own.map(|index| index as u8).or_else(inherited));
            }
        }
        let styles = self.inherited(nodes, &ids, |of| of.style, NodeStyle::below);
        let facings = self.inherited(nodes, &ids, |of| of.facing, |own, _| own);
        NodeTraits { ids, layers, layer_of, styles, facings, ..NodeTraits::default() }
    }

    /// For each node what `below` makes of what it has of its own and of what the node above it
    /// has. Empty if no node has any of its own.
    fn inherited<T: Copy + Default + PartialEq>(
        &self,
        nodes: &[Node],
        ids: &[NodeId],
        own: impl Fn(&NodeEdits) -> T,
        below: impl Fn(T, T) -> T,
    ) -> Vec<T> {
        if self.nodes().all(|(_, edits)| own(edits) == T::default()) {
            return Vec::new();
        }
        let mut all: Vec<T> = Vec::with_capacity(nodes.len());
        for (node, id) in nodes.iter().zip(ids) {
            let own = self.node(*id).map_or_else(T::default, &own);
            let above = node.parent.map_or_else(T::default, |parent| all[parent as usize]);
            all.push(below(own, above));
        }
        all
    }
}

#[cfg(test)]
mod tests;
