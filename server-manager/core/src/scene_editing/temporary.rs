//! Nodes that end with a client's connection.

use std::collections::BTreeMap;

use polyptych_scene::{Edit, NodeId, SceneEdits};
use serde::{Deserialize, Serialize};

use super::EditTarget;
use crate::{Cluster, Micros, SessionId};

/// Time after which nodes are taken away that could not be, since a change was refused or others
/// were on their way.
const RETRY_TIME: Micros = 1_000_000;

/// The temporary nodes of clients, until the wall does not show them any more.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct TemporaryNodes {
    by_client: BTreeMap<SessionId, Vec<NodeId>>,
    /// The time at which those of clients that are gone are to be taken away; `None` if there is
    /// nothing to do, or a change on its way does so.
    #[serde(default)]
    retry_at: Option<Micros>,
}

impl TemporaryNodes {
    /// Adds nodes of a client.
    pub fn add(&mut self, client: SessionId, nodes: &[NodeId]) {
        self.by_client.entry(client).or_default().extend(nodes);
    }

    /// Returns all of them.
    pub fn nodes(&self) -> impl Iterator<Item = NodeId> {
        self.by_client.values().flatten().copied()
    }
}

impl Cluster {
    /// Takes the nodes away that ended with their clients' connections. Where the scene cannot be
    /// edited now, this is tried again later.
    pub(crate) fn end_temporary(&mut self, now: Micros) {
        self.forget_ended_nodes();
        let (editing, clients) = (&mut self.editing, &self.clients);
        editing.temporary.retry_at = None;
        let of_gone = editing.temporary.by_client.iter();
        let of_gone = of_gone.filter(|(client, _)| !clients.contains_key(client));
        let is_left = |node: &NodeId| editing.accepted.node(*node).is_some();
        let gone: Vec<NodeId> = of_gone.flat_map(|(_, nodes)| nodes).copied().collect();
        if !gone.iter().any(is_left) {
            return;
        }
        if self.changes.has_scene_underway() || self.changes.expect_room().is_err() {
            editing.temporary.retry_at = Some(now + RETRY_TIME);
            return;
        }
        let mut edits = Vec::new();
        let mut remove = |accepted: &mut SceneEdits, node: NodeId| {
            // Somebody may have taken it away before.
            if accepted.node(node).is_some() {
                accepted.apply(Edit::Remove(node));
                edits.push(Edit::Remove(node));
            }
        };
        for node in gone {
            remove(&mut editing.accepted, node);
        }
        if let Some(outline) = &editing.outline {
            for node in outline.orphans(&editing.accepted) {
                remove(&mut editing.accepted, node);
            }
        }
        for unused in editing.accepted.unused_assets() {
            editing.accepted.apply(Edit::RemoveAssets(unused));
            edits.push(Edit::RemoveAssets(unused));
        }
        for target in edits.iter().filter_map(EditTarget::of) {
            editing.changed.insert(target, None);
        }
        self.request_edits(now, edits, None);
    }

    /// Returns the time at which nodes of clients that are gone are taken away after all; `None` if
    /// there are none, or a change on its way does so.
    pub(crate) fn next_temporary_end(&self) -> Option<Micros> {
        self.editing.temporary.retry_at
    }

    /// Takes nodes away after all, where it is time.
    pub(crate) fn end_temporary_at_last(&mut self, now: Micros) {
        if self.next_temporary_end().is_some_and(|at| now >= at) {
            self.end_temporary(now);
        }
    }

    /// A change was refused, and perhaps with it that which took nodes away.
    pub(crate) fn retry_temporary_end(&mut self, now: Micros) {
        let mut clients = self.editing.temporary.by_client.keys();
        if clients.any(|client| !self.clients.contains_key(client)) {
            self.editing.temporary.retry_at = Some(now + RETRY_TIME);
        }
    }

    /// Forgets nodes that neither the wall shows nor a change on its way does.
    pub(super) fn forget_ended_nodes(&mut self) {
        let (accepted, shown) = (&self.editing.accepted, &self.shown.edits);
        let is_there = |node: &NodeId| accepted.node(*node).or(shown.node(*node)).is_some();
        self.editing.temporary.by_client.retain(|_, nodes| {
            nodes.retain(is_there);
            !nodes.is_empty()
        });
    }
}
