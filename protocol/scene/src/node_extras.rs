//! Facts of a file about a node beside its picture: whether it is hidden, and its attributes.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::edit::{Attribute, Edit, NodeId};
use crate::limits::EXTRAS_BYTES_MAX;
use crate::outline::check_attribute;
use crate::scene_edits::SceneEdits;
use crate::{EditError, Scene};

/// The facts of a file about one node. A scene is opened with it as its first edits, so that it
/// can be asked for, changed and taken back as what clients say of nodes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct NodeExtras {
    /// An index into [`Scene::nodes`].
    pub node: u32,
    /// `true` hides it, with all that hangs from it (`KHR_node_visibility`).
    pub is_hidden: bool,
    /// Attributes by key, within the limits of [`Edit::SetAttribute`].
    pub attributes: BTreeMap<String, Attribute>,
}

impl NodeExtras {
    /// Returns the edits that say the same of a node of another number.
    pub fn edits(&self, node: NodeId) -> impl Iterator<Item = Edit> + '_ {
        let hide = self.is_hidden.then_some(Edit::SetVisible { node, visible: false });
        let attribute = move |(key, value): (&String, &Attribute)| {
            let (key, value) = (key.clone(), Some(value.clone()));
            Edit::SetAttribute { node, key, value }
        };
        hide.into_iter().chain(self.attributes.iter().map(attribute))
    }
}

impl Scene {
    /// Returns the edits with which the scene is opened: what its file says of nodes.
    pub fn first_edits(&self) -> SceneEdits {
        let mut edits = SceneEdits::default();
        for of in &self.extras {
            of.edits(NodeId(of.node.into())).for_each(|edit| edits.apply(edit));
        }
        edits
    }
}

/// Returns why the extras of a scene of this many nodes cannot be; `None` if they can.
pub(crate) fn fault(extras: &[NodeExtras], nodes: usize) -> Option<String> {
    let mut edits = SceneEdits::default();
    let mut before = None;
    for of in extras {
        if of.node as usize >= nodes || before.is_some_and(|before| of.node <= before) {
            return Some(format!("the extras of node {} stand in the wrong place", of.node));
        }
        before = Some(of.node);
        let node = NodeId(of.node.into());
        for edit in of.edits(node) {
            if let Edit::SetAttribute { key, value, .. } = &edit {
                let known = edits.node(node).map(|of| &of.attributes);
                if let Err(what) = check_attribute(known, key, value.as_ref()) {
                    return Some(EditError::Value { node, what }.to_string());
                }
            }
            edits.apply(edit);
        }
        if edits.bytes() > EXTRAS_BYTES_MAX as u64 {
            return Some(format!("the extras of nodes take more than {EXTRAS_BYTES_MAX} bytes"));
        }
    }
    None
}
