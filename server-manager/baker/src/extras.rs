//! The facts of a file about its nodes beside their picture: `KHR_node_visibility`, and `extras`,
//! which are attributes here.

use std::collections::BTreeMap;

use polyptych_scene::limits::EXTRAS_BYTES_MAX;
use polyptych_scene::{Attribute, NodeExtras, NodeId, Scene, SceneEdits, check_attribute};
use polyptych_text::counted;
use serde_json::Value;

use super::{BakeJob, document};

/// The key of `extras` that are no object.
const WHOLE_KEY: &str = "extras";

/// The facts about the nodes of a scene, in their order.
#[derive(Debug, Default)]
pub(super) struct ExtrasList {
    list: Vec<NodeExtras>,
    /// Entries of `extras` that are no attributes, since they break a limit.
    left_out: u64,
}

impl ExtrasList {
    /// Adds the attributes of a node of the file, which is at this place of the scene, and hidden
    /// or not. The attribute of its camera takes precedence over an entry of the same name.
    pub(super) fn add(
        &mut self,
        (place, is_hidden): (u32, bool),
        node: &document::Node,
        camera: Option<(String, Attribute)>,
    ) {
        let mut attributes = BTreeMap::from_iter(camera);
        self.add_attributes(&mut attributes, &node.extras);
        if is_hidden || !attributes.is_empty() {
            self.list.push(NodeExtras { node: place, is_hidden, attributes });
        }
    }

    /// Hides a node that the file has not.
    pub(super) fn hide(&mut self, place: u32) {
        self.list.push(NodeExtras { node: place, is_hidden: true, attributes: BTreeMap::new() });
    }

    fn add_attributes(&mut self, attributes: &mut BTreeMap<String, Attribute>, extras: &Value) {
        let whole;
        let entries: Box<dyn Iterator<Item = (&String, &Value)>> = match extras {
            Value::Null => return,
            Value::Object(entries) => Box::new(entries.iter()),
            other => {
                whole = WHOLE_KEY.to_owned();
                Box::new(std::iter::once((&whole, other)))
            }
        };
        for (key, value) in entries {
            let Some(value) = attribute(value) else { continue };
            let is_free = !attributes.contains_key(key);
            if is_free && check_attribute(Some(attributes), key, Some(&value)).is_ok() {
                attributes.insert(key.clone(), value);
            } else {
                self.left_out += 1;
            }
        }
    }

    /// Returns what fits into a scene; notes what does not. Hidden nodes go before attributes.
    pub(super) fn into_list(mut self, job: &mut BakeJob<'_>) -> Vec<NodeExtras> {
        let mut edits = SceneEdits::default();
        let mut shown = 0u64;
        for of in &mut self.list {
            let attributes = std::mem::take(&mut of.attributes);
            // Before the attributes of any node are counted.
            if of.is_hidden && !fits(&mut edits, of) {
                (of.is_hidden, shown) = (false, shown + 1);
            }
            of.attributes = attributes;
        }
        for of in &mut self.list {
            let count = of.attributes.len() as u64;
            if count > 0 && !fits(&mut edits, of) {
                of.attributes.clear();
                self.left_out += count;
            }
        }
        if shown > 0 {
            let nodes = counted(shown, "node");
            job.warn(&format!("nodes: {nodes} more are hidden than can be, and are shown"));
        }
        if self.left_out > 0 {
            let left_out = counted(self.left_out, "value");
            job.warn(&format!("nodes: {left_out} of extras are beyond the limits of attributes"));
        }
        self.list.retain(|of| of.is_hidden || !of.attributes.is_empty());
        self.list
    }
}

/// Returns for each node whether its file hides it, by itself or with what it hangs from. One that
/// clips show is not: they play from the start.
pub(super) fn hidden_nodes(scene: &Scene) -> Vec<bool> {
    let mut hidden = vec![false; scene.nodes.len()];
    for of in scene.extras.iter().filter(|of| of.is_hidden) {
        if let Some(is_hidden) = hidden.get_mut(of.node as usize) {
            *is_hidden = true;
        }
    }
    // Parents stand before their children.
    for (at, node) in scene.nodes.iter().enumerate() {
        let above = node.parent.and_then(|parent| hidden.get(parent as usize)).copied();
        hidden[at] |= above.unwrap_or_default();
    }
    hidden
}

/// Adds the edits that say this of a node, if there is room for them.
fn fits(edits: &mut SceneEdits, of: &NodeExtras) -> bool {
    let node = NodeId(of.node.into());
    let before = edits.clone();
    of.edits(node).for_each(|edit| edits.apply(edit));
    let has_room = edits.bytes() <= EXTRAS_BYTES_MAX as u64;
    if !has_room {
        *edits = before;
    }
    has_room
}

/// The attribute that a value is; lists and objects are their JSON text. `None` for null.
fn attribute(value: &Value) -> Option<Attribute> {
    Some(match value {
        Value::Null => return None,
        Value::Bool(value) => Attribute::Bool(*value),
        Value::Number(number) => Attribute::Number(number.as_f64()?),
        Value::String(text) => Attribute::Text(text.clone()),
        Value::Array(_) | Value::Object(_) => Attribute::Text(value.to_string()),
    })
}
