//! The nodes of a scene as they were placed, to find all that stands elsewhere after some of them
//! were moved.

use std::sync::OnceLock;

use glam::DAffine3;

use crate::edit::NodeId;
use crate::scene_edits::SceneEdits;
use crate::{Node, Scene};

/// Stands for the parent of a node that hangs from the scene itself.
const NONE: u32 = u32::MAX;

/// The nodes of a scene with the edits of a moment, in the order in which
/// [`SceneEdits::apply_to`] places them: parents before their children.
#[derive(Debug)]
pub struct PlacedNodes {
    /// The edits with which they were placed.
    edits: SceneEdits,
    ids: Vec<NodeId>,
    /// The index of each node's parent, or [`NONE`].
    parents: Vec<u32>,
    /// Indices of the nodes that have a light, rising.
    lit: Vec<u32>,
    /// Made where nodes are moved for the first time.
    tree: OnceLock<Tree>,
}

/// Children of each node.
#[derive(Debug)]
struct Tree {
    /// Indices in the order of the nodes' numbers.
    by_id: Vec<u32>,
    /// Place of each node's first child in `children`, and the number of all behind the last.
    first: Vec<u32>,
    /// Indices, rising for each parent.
    children: Vec<u32>,
}

/// A node that stands elsewhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MovedPlace {
    /// Its index among the placed nodes.
    pub index: u32,
    /// Its number.
    pub node: NodeId,
    /// Parent space from its space.
    pub local: DAffine3,
    /// World space from its space.
    pub world: DAffine3,
}

impl PlacedNodes {
    /// Nodes as they were placed with these edits, and the number of each.
    pub fn new(nodes: &[Node], ids: Vec<NodeId>, edits: SceneEdits) -> Self {
        let lit = (0..).zip(nodes).filter(|(_, node)| node.light.is_some());
        Self {
            edits,
            ids,
            parents: nodes.iter().map(|node| node.parent.unwrap_or(NONE)).collect(),
            lit: lit.map(|(index, _)| index).collect(),
            tree: OnceLock::new(),
        }
    }

    /// The index of a node among those that were placed, if it was.
    pub fn index_of(&self, node: NodeId) -> Option<u32> {
        self.tree().index_of(&self.ids, node)
    }

    /// The number of a placed node.
    pub(crate) fn id(&self, index: u32) -> NodeId {
        self.ids[index as usize]
    }

    /// The index of the node that a placed node hangs from.
    pub(crate) fn parent(&self, index: u32) -> Option<u32> {
        Some(self.parents[index as usize]).filter(|parent| *parent != NONE)
    }

    /// The indices of the nodes that hang from a placed node.
    pub(crate) fn children(&self, index: u32) -> impl Iterator<Item = u32> + '_ {
        self.tree().children(index).iter().copied()
    }

    /// World space from a placed node's space, with these edits.
    pub(crate) fn world_of(
        &self,
        base: &Scene,
        edits: &SceneEdits,
        index: u32,
    ) -> Option<DAffine3> {
        self.world(base, edits, index).flatten()
    }

    /// The nodes are placed with these edits from now on, which move no more than [`Self::moved`]
    /// says.
    pub fn follow(&mut self, edits: SceneEdits) {
        self.edits = edits;
    }

    /// Returns whether one of these nodes has a light.
    pub fn has_light(&self, moved: &[MovedPlace]) -> bool {
        !self.lit.is_empty()
            && moved.iter().any(|moved| self.lit.binary_search(&moved.index).is_ok())
    }

    fn tree(&self) -> &Tree {
        self.tree.get_or_init(|| Tree::new(&self.ids, &self.parents))
    }

    /// The nodes that stand elsewhere in the world with other edits of the same scene, which may
    /// differ in nothing else that is drawn, in the order of their indices. `None` where more
    /// differs. What is hidden is not placed, and may move unseen.
    pub fn moved(&self, base: &Scene, edits: &SceneEdits) -> Option<Vec<MovedPlace>> {
        let changed = edits.moved_since(&self.edits)?;
        let tree = self.tree();
        let mut tops = Vec::with_capacity(changed.len());
        for node in changed {
            let local = edits.local_of(base, node)?;
            if !local.is_finite() {
                return None;
            }
            // Renamed nodes stand where they were.
            let is_elsewhere = self.edits.local_of(base, node) != Some(local);
            tops.extend(tree.index_of(&self.ids, node).filter(|_| is_elsewhere));
        }
        tops.sort_unstable();
        let mut moved: Vec<MovedPlace> = Vec::with_capacity(tops.len());
        let mut is_moved = vec![0u64; self.ids.len().div_ceil(64)];
        let mut open = Vec::new();
        for top in tops {
            // Parents have lower indices: what hangs from another one is there already.
            let is_known = is_moved[top as usize / 64] >> (top % 64) & 1 == 1;
            if is_known {
                continue;
            }
            let parent = self.parents[top as usize];
            open.push((top, self.world(base, edits, parent)?));
            while let Some((index, above)) = open.pop() {
                let node = self.ids[index as usize];
                let local = edits.local_of(base, node)?;
                let world = above.map_or(local, |above| above * local);
                is_moved[index as usize / 64] |= 1 << (index % 64);
                moved.push(MovedPlace { index, node, local, world });
                open.extend(tree.children(index).iter().map(|child| (*child, Some(world))));
            }
        }
        moved.sort_unstable_by_key(|moved| moved.index);
        Some(moved)
    }

    /// World space from a node's space, multiplied from the top as all are.
    #[expect(clippy::option_option, reason = "no node, and no such node")]
    fn world(&self, base: &Scene, edits: &SceneEdits, index: u32) -> Option<Option<DAffine3>> {
        let up =
            std::iter::successors(Some(index), |index| self.parents.get(*index as usize).copied());
        let above: Vec<u32> = up.take_while(|index| *index != NONE).collect();
        let mut world = None;
        for index in above.into_iter().rev() {
            let local = edits.local_of(base, self.ids[index as usize])?;
            world = Some(world.map_or(local, |world: DAffine3| world * local));
        }
        Some(world)
    }
}

impl Tree {
    fn new(ids: &[NodeId], parents: &[u32]) -> Self {
        let mut by_id: Vec<u32> = (0..ids.len() as u32).collect();
        by_id.sort_unstable_by_key(|index| ids[*index as usize]);
        let mut first = vec![0u32; ids.len() + 1];
        for parent in parents.iter().filter(|parent| **parent != NONE) {
            first[*parent as usize + 1] += 1;
        }
        for at in 0..ids.len() {
            first[at + 1] += first[at];
        }
        let mut next = first.clone();
        let mut children = vec![0; first.last().map_or(0, |count| *count as usize)];
        for (index, parent) in (0..).zip(parents).filter(|(_, parent)| **parent != NONE) {
            let at = &mut next[*parent as usize];
            children[*at as usize] = index;
            *at += 1;
        }
        Self { by_id, first, children }
    }

    fn index_of(&self, ids: &[NodeId], node: NodeId) -> Option<u32> {
        let at = self.by_id.binary_search_by_key(&node, |index| ids[*index as usize]);
        at.ok().map(|at| self.by_id[at])
    }

    fn children(&self, index: u32) -> &[u32] {
        let index = index as usize;
        &self.children[self.first[index] as usize..self.first[index + 1] as usize]
    }
}

#[cfg(test)]
mod tests;
