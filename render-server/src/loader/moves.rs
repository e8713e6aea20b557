//! Moves of nodes, laid over the scene as it was laid out.

use std::sync::Arc;
use std::time::Instant;

use polyptych_renderer::{MovedItems, MovedNode};
use polyptych_scene::{Instance, Motion, NodeId, Scene, SceneEdits};

use super::ReadyScene;

/// The items that were moved since a scene was laid out, and the scene's motion with these edits;
/// `None` where it must be laid out anew.
pub(super) fn moved_items(
    ready: &ReadyScene,
    edits: &SceneEdits,
) -> Option<(MovedItems, Option<Arc<Motion>>)> {
    let start = Instant::now();
    let places = ready.placed.moved(&ready.base, edits)?;
    // Each light may reach other items then.
    if ready.placed.has_light(&places) {
        return None;
    }
    let motion = Motion::new(&ready.base, &ready.placed, edits).map(Arc::new);
    // A layout has other batches then: those of a server that joins later would not be the same.
    let may_mirror = |of: &Option<Arc<Motion>>| of.as_ref().is_some_and(|of| of.may_mirror());
    if may_mirror(&motion) != may_mirror(&ready.motion) {
        return None;
    }
    let nodes = places
        .iter()
        .map(|place| MovedNode::new(place.index, place.world, instances(&ready.base, place.node)));
    let moved = MovedItems::new(&ready.layout, nodes)?;
    let (nodes, items, move_us) = (places.len(), moved.len(), start.elapsed().as_micros() as u64);
    tracing::debug!(nodes, items, move_us, "nodes were moved");
    Some((moved, motion))
}

/// The copies of the mesh of a node; nodes that were made by edits have none.
pub(super) fn instances(base: &Scene, node: NodeId) -> &[Instance] {
    let index = usize::try_from(node.0).ok();
    index.and_then(|index| base.nodes.get(index)).map_or(&[][..], |node| &node.instances)
}
