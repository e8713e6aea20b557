//! The nodes that the wall's own picture shows, their layers and their kinds.

use polyptych_protocol::node_query::{LayerInfo, NodeKind};
use polyptych_scene::{Attribute, SceneSubset, Topology};

use super::SceneIndex;

impl SceneIndex {
    /// For each node, whether a part of the scene shows it: it is in that part, and neither it nor
    /// a node above it is hidden or left out by a switch.
    pub fn shown(&self, subset: &SceneSubset) -> Vec<bool> {
        // Without layers, since a node can have a layer of its own in a hidden one.
        let mut present: Vec<bool> = Vec::with_capacity(self.nodes.len());
        for (at, node) in self.nodes.iter().enumerate() {
            let is_hidden = self.edits.node(self.id(at)).is_some_and(|edits| edits.is_hidden);
            let above = node.parent.map(|parent| self.id(parent as usize));
            let is_chosen = self.edits.is_switched_on(above, self.id(at));
            let is_above = node.parent.is_none_or(|parent| present[parent as usize]);
            present.push(is_above && !is_hidden && is_chosen);
        }
        let in_layer = |(name, is_hidden): &(String, bool)| subset.shows_layer(name, *is_hidden);
        let layers: Vec<bool> = self.traits.layers.iter().map(in_layer).collect();
        for (is_shown, layer) in present.iter_mut().zip(&self.traits.layer_of) {
            *is_shown &= layer.is_none_or(|layer| layers[usize::from(layer)]);
        }
        if let Some(root) = subset.root {
            // A view whose root is gone shows nothing.
            let below = self.below(root).unwrap_or_else(|_| vec![false; present.len()]);
            for (is_shown, is_below) in present.iter_mut().zip(below) {
                *is_shown &= is_below;
            }
        }
        present
    }

    /// The name of the layer that a node is in, by its index.
    pub(super) fn layer(&self, at: usize) -> Option<&str> {
        let layer = self.traits.layer_of.get(at).copied().flatten()?;
        Some(&self.traits.layers[usize::from(layer)].0)
    }

    /// All layers, with the number of nodes in each.
    pub fn layers(&self) -> Vec<LayerInfo> {
        let info = |(name, is_hidden): &(String, bool)| LayerInfo {
            name: name.clone(),
            nodes: 0,
            visible: !is_hidden,
        };
        let mut layers: Vec<LayerInfo> = self.traits.layers.iter().map(info).collect();
        for layer in self.traits.layer_of.iter().flatten() {
            layers[usize::from(*layer)].nodes += 1;
        }
        layers
    }

    /// Returns whether a node is of a kind, by its index.
    pub(super) fn is_of_kind(&self, at: usize, kind: NodeKind) -> bool {
        let has = |topology| self.primitives(at).iter().any(|of| of.topology == topology);
        let node = &self.nodes[at];
        match kind {
            NodeKind::Mesh => has(Topology::Triangles),
            NodeKind::Lines => has(Topology::Lines),
            NodeKind::Points => has(Topology::Points),
            NodeKind::Light => node.light.is_some(),
            NodeKind::Label => {
                let edits = self.edits.node(self.id(at));
                let text = edits.and_then(|edits| edits.attributes.get("label"));
                node.mesh.is_some() && matches!(text, Some(Attribute::Text(_)))
            }
            NodeKind::Empty => node.mesh.is_none() && node.light.is_none(),
        }
    }
}
