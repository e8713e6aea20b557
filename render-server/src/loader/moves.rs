//! Moves of nodes, laid over the scene as it was laid out.

use std::time::Instant;

use polyptych_renderer::{MovedItems, MovedNode};
use polyptych_scene::{Instance, NodeId, Scene, SceneEdits};

use super::ReadyScene;

/// The items that were moved since a scene was laid out; `None` where it must be laid out anew.
pub(super) fn moved_items(ready: &ReadyScene, edits: &SceneEdits) -> Option<MovedItems> {
    let start = Instant::now();
    let places = ready.placed.moved(&ready.base, edits)?;
    // Each light may reach other items then.
    if ready.placed.has_light(&places) {
        return None;
    }
    let nodes = places
        .iter()
        .map(|place| MovedNode::new(place.index, place.world, instances(&ready.base, place.node)));
    let moved = MovedItems::new(&ready.layout, nodes)?;
    let (nodes, items, move_us) = (places.len(), moved.len(), start.elapsed().as_micros() as u64);
    tracing::debug!(nodes, items, move_us, "nodes were moved");
    Some(moved)
}

/// The copies of the mesh of a node; nodes that were made by edits have none.
pub(super) fn instances(base: &Scene, node: NodeId) -> &[Instance] {
    let index = usize::try_from(node.0).ok();
    index.and_then(|index| base.nodes.get(index)).map_or(&[][..], |node| &node.instances)
}
