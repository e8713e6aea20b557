//! Edits of the open scene: each transaction is checked against all that was accepted before it,
//! and seen from one frame on, or not at all.

mod edit_target;
mod subset;
mod temporary;

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

pub use edit_target::EditTarget;
use polyptych_protocol::feedback::{Edited, FrameFeedback};
use polyptych_protocol::ids::{FrameId, Revision};
use polyptych_protocol::request::{RequestError, Response};
use polyptych_protocol::state_log::Operation;
use polyptych_protocol::transaction::{
    AssetNumbers, AssetSource, BakedAssets, NewAssets, Transaction,
};
use polyptych_scene::{
    AssetSet, AssetSetId, Edit, NodeId, SceneEdits, SceneOutline, provisional_asset_index,
};
use serde::{Deserialize, Serialize};
use temporary::TemporaryNodes;

use super::change_queue::ChangeOrigin;
use super::{ClientRequest, Cluster, Micros, SessionId, StateChange};

/// Most transactions of one client that wait for their frame: those of four seconds of a wall that
/// stands still, where a program sends 60 a second.
pub(super) const TRANSACTIONS_MAX: usize = 256;

/// Transactions that a client may still ask for when what they wait for is waited for no longer.
const SPARE_TRANSACTIONS: usize = 32;

/// One who waits until a transaction is seen.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct EditWaiter {
    job: ClientRequest,
    /// The last frame that was begun when it asked.
    asked_at: FrameId,
    /// The nodes that it makes, in order.
    created: Vec<NodeId>,
    /// The numbers of the assets that it brings.
    assets: Option<AssetNumbers>,
    /// Parts of their file that are not drawn.
    notes: Vec<String>,
}

/// The accepted edits of the open scene, shown or not yet.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct SceneEditing {
    /// `None` where no scene is open, or what it holds is not known.
    outline: Option<Arc<SceneOutline>>,
    /// The state since which changes are known: that in which the scene was opened, or with which
    /// this manager began.
    since: Revision,
    /// The state since which the scene is as it is: walls change, and what is held of a scene.
    #[serde(default)]
    latest: Revision,
    /// All that was accepted; frames may show less as yet.
    accepted: SceneEdits,
    /// The number that the next node gets at least.
    next_node: u64,
    /// The state from which on each target is as it was last changed; `None` where no frame names
    /// it yet.
    changed: BTreeMap<EditTarget, Option<Revision>>,
    /// Those whose transaction is in the state that frames name.
    waiters: Vec<(Revision, EditWaiter)>,
    /// Nodes that end with a client's connection.
    temporary: TemporaryNodes,
}

impl SceneEditing {
    /// Another scene is shown from this state on, or none.
    pub fn restart(&mut self, since: Revision, outline: Option<Arc<SceneOutline>>) {
        let waiters = std::mem::take(&mut self.waiters);
        *self = Self { outline, since, latest: since, waiters, ..Self::default() };
    }

    /// Returns the outline of the open scene, where it is known.
    pub fn outline(&self) -> Option<&SceneOutline> {
        self.outline.as_deref()
    }

    /// Nothing is known of changes before this state.
    pub fn begin_at(&mut self, since: Revision) {
        (self.since, self.latest) = (since, since);
    }

    /// The nodes that end with a client's connection.
    pub fn temporary(&self) -> Vec<NodeId> {
        self.temporary.nodes().collect()
    }

    /// Goes on with what was remembered.
    pub fn restore(&mut self, edits: SceneEdits, next_node: u64) {
        (self.accepted, self.next_node) = (edits, next_node);
    }

    /// All that was accepted, shown or not yet.
    pub fn accepted(&self) -> &SceneEdits {
        &self.accepted
    }

    pub fn next_node(&self) -> u64 {
        self.next_node
    }

    /// Returns whether any waits for a state that a frame of revision `drawing` does not show.
    pub fn wait_beyond(&self, drawing: Option<Revision>) -> bool {
        self.waiters.iter().any(|(of, _)| Some(*of) > drawing)
    }

    /// The requests that wait.
    pub fn jobs(&self) -> impl Iterator<Item = ClientRequest> {
        self.waiters.iter().map(|(_, waiter)| waiter.job)
    }

    pub fn forget(&mut self, client: SessionId) {
        self.waiters.retain(|(_, waiter)| waiter.job.client != client);
    }

    /// Applies a transaction to what is accepted: all of it, or nothing. Gives what servers are to
    /// do for it.
    ///
    /// # Errors
    /// Says which edit is invalid, why, and what would be right.
    fn accept(&mut self, transaction: Transaction) -> Result<Accepted, String> {
        let outline = self.outline.clone().ok_or(
            "no scene is open that can be edited; open one first, or again after a restart",
        )?;
        let before = self.accepted.clone();
        let done = self.accept_each(&outline, transaction);
        if done.is_err() {
            self.accepted = before;
        }
        done
    }

    fn accept_each(
        &mut self,
        outline: &SceneOutline,
        Transaction { base, edits, assets, .. }: Transaction,
    ) -> Result<Accepted, String> {
        let first = self.next_node.max(outline.nodes());
        let (mut created, mut numbered) = (Vec::new(), Vec::with_capacity(edits.len() + 1));
        let assets = assets.map(|assets| self.place_assets(outline, assets)).transpose()?;
        if let Some(set) = &assets {
            let edit = Edit::AddAssets(Box::new(set.clone()));
            self.accepted.apply(edit.clone());
            numbered.push(edit);
        }
        let own = assets.as_ref().map(AssetSet::id);
        let (mesh, texture) = (
            |number| own_number(number, assets.as_ref(), "mesh", AssetSet::mesh_range),
            |number| own_number(number, assets.as_ref(), "texture", AssetSet::texture_range),
        );
        for (index, edit) in edits.into_iter().enumerate() {
            let fault = |what: String| format!("edit {index}: {what}");
            if let Edit::Create { node, .. } = &edit {
                let wanted = NodeId::provisional(created.len() as u64);
                if *node != wanted {
                    return Err(fault(format!("it makes {node}, where {wanted} is next")));
                }
                created.push(NodeId(first + created.len() as u64));
            }
            let number = |node: NodeId| match node.provisional_index() {
                None => Ok(node),
                Some(at) => {
                    let known = usize::try_from(at).ok().and_then(|at| created.get(at)).copied();
                    known.ok_or_else(|| fault(format!("{node} is used before it is made")))
                }
            };
            let edit = edit.with_nodes(number)?.with_assets(mesh, texture).map_err(fault)?;
            if matches!(edit, Edit::AddAssets(_) | Edit::RemoveAssets(_)) {
                return Err(fault(
                    "assets come beside the edits of a transaction, and go when \
                                  nothing uses them"
                        .to_owned(),
                ));
            }
            self.check_conflict(base, own, &edit).map_err(fault)?;
            outline.check(&self.accepted, &edit).map_err(|error| fault(error.to_string()))?;
            self.accepted.apply(edit.clone());
            numbered.push(edit);
        }
        self.complete(outline, &mut numbered)?;
        self.next_node = first + created.len() as u64;
        for target in numbered.iter().filter_map(EditTarget::of) {
            self.changed.insert(target, None);
        }
        let assets = assets.map(|set| AssetNumbers {
            first_mesh: set.first_mesh,
            first_material: set.first_material,
            first_texture: set.first_texture,
        });
        Ok(Accepted { edits: numbered, created, assets })
    }

    /// Adds what follows of a transaction's edits, and checks what they come to.
    fn complete(&mut self, outline: &SceneOutline, numbered: &mut Vec<Edit>) -> Result<(), String> {
        if !numbered.iter().any(Edit::changes_contents) {
            return outline.check_bytes(&self.accepted).map_err(|error| error.to_string());
        }
        let mut follows = Vec::new();
        if numbered.iter().any(|edit| matches!(edit, Edit::Remove(_))) {
            // What hung from what was taken away, so that nothing is left behind.
            follows.extend(outline.orphans(&self.accepted).into_iter().map(Edit::Remove));
        }
        for edit in &follows {
            self.accepted.apply(edit.clone());
        }
        let added = match numbered.first() {
            Some(Edit::AddAssets(set)) => Some(set.id()),
            _ => None,
        };
        for unused in self.accepted.unused_assets() {
            if added == Some(unused) {
                return Err(
                    "nothing of the scene would use the assets that it brings; let a node \
                            show one of their meshes"
                        .to_owned(),
                );
            }
            self.accepted.apply(Edit::RemoveAssets(unused));
            follows.push(Edit::RemoveAssets(unused));
        }
        numbered.extend(follows);
        outline.check_size(&self.accepted).map_err(|error| error.to_string())
    }

    /// The places of the assets of a transaction: numbers of their own, also where the same file
    /// was added before, since who added that may change its materials.
    fn place_assets(&self, outline: &SceneOutline, assets: NewAssets) -> Result<AssetSet, String> {
        let AssetSource::Baked(baked) = assets.source else {
            return Err("its assets were not read yet".to_owned());
        };
        let BakedAssets { manifest, primitives, materials, textures, .. } = baked;
        let counts = [materials, textures];
        let set = outline.place_assets(&self.accepted, manifest, primitives, counts);
        let set = set.map_err(|error| error.to_string())?;
        let edit = Edit::AddAssets(Box::new(set.clone()));
        outline.check(&self.accepted, &edit).map_err(|error| error.to_string())?;
        Ok(set)
    }

    /// Checks that the target of an edit was not changed since `base`, the revision that the client
    /// has seen. `own` are the assets of its transaction: nobody else has changed these, though the
    /// same file may have had the same numbers before.
    fn check_conflict(
        &self,
        base: Option<Revision>,
        own: Option<AssetSetId>,
        edit: &Edit,
    ) -> Result<(), String> {
        let (Some(base), Some(target)) = (base, EditTarget::of(edit)) else { return Ok(()) };
        if base < self.since {
            return Err(format!(
                "it builds on revision {base}, before the scene was opened or the manager started \
                 (revision {}); read {target} again, and decide anew",
                self.since
            ));
        }
        // Assets that came since may have the number of another that the client has seen.
        let of_others = self.accepted.assets_named_by(edit).filter(|id| Some(*id) != own);
        let came_with: Vec<EditTarget> = of_others.map(EditTarget::Assets).collect();
        for changed in std::iter::once(&target).chain(&came_with) {
            let what = match changed {
                EditTarget::Assets(_) => format!("what {target} shows"),
                _ => target.to_string(),
            };
            match self.changed.get(changed) {
                Some(Some(revision)) if *revision > base => {
                    return Err(format!(
                        "{what} was changed at revision {revision}, and this builds on {base}; \
                         read it again, and decide anew"
                    ));
                }
                Some(None) => {
                    return Err(format!(
                        "{what} is being changed by another transaction, and this builds on \
                         {base}; read it again, and decide anew"
                    ));
                }
                _ => {}
            }
        }
        Ok(())
    }
}

/// A transaction that was accepted.
struct Accepted {
    /// With the numbers of what they make, and what follows of them.
    edits: Vec<Edit>,
    created: Vec<NodeId>,
    assets: Option<AssetNumbers>,
}

/// The number of what a transaction brings, where a provisional one stands for it.
fn own_number(
    number: u32,
    assets: Option<&AssetSet>,
    what: &str,
    range: fn(&AssetSet) -> Range<u32>,
) -> Result<u32, String> {
    let Some(index) = provisional_asset_index(number) else { return Ok(number) };
    let range = assets.map(range).unwrap_or_default();
    let own = range.start.checked_add(index).filter(|own| range.contains(own));
    own.ok_or_else(|| {
        format!("the transaction brings no {what} {index}; it brings {}", range.len())
    })
}

/// Returns the edits of the scene in these operations.
fn edits_of(operations: &[Operation]) -> impl Iterator<Item = &Edit> {
    operations.iter().flat_map(|operation| match operation {
        Operation::EditScene(edits) => &edits[..],
        _ => &[],
    })
}

impl Cluster {
    /// Sets the outline of the open scene, for a state that was restored: without it, the scene
    /// cannot be edited.
    pub fn set_outline(&mut self, outline: Option<Arc<SceneOutline>>) {
        self.editing.outline = outline.filter(|_| self.shown.scene.is_some());
    }

    /// The open scene in the state that frames name, and what was changed of it.
    pub fn shown_scene(&self) -> Option<(&polyptych_protocol::state_log::SceneRef, &SceneEdits)> {
        self.shown.scene.as_ref().map(|scene| (scene, &self.shown.edits))
    }

    /// The state since which the scene that frames show is as it is.
    pub fn scene_revision(&self) -> Revision {
        self.editing.latest
    }

    /// The state in which the scene that frames show was opened, or with which this manager began:
    /// another one for each time that a scene is opened or closed.
    pub fn scene_opened_at(&self) -> Revision {
        self.editing.since
    }

    /// Returns a fingerprint of all accepted edits.
    #[cfg(test)]
    pub(super) fn editing_fingerprint(&self) -> u64 {
        self.editing.accepted.fingerprint()
    }

    /// A client edits the scene.
    pub(super) fn edit_scene(
        &mut self,
        now: Micros,
        job: ClientRequest,
        mut transaction: Transaction,
    ) -> Result<Option<Response>, String> {
        if transaction.edits.is_empty() && transaction.assets.is_none() {
            return Err("a transaction has one edit or more".into());
        }
        if self.changes.has_scene_underway() {
            return Err("another scene is being opened; edit it once it is shown".into());
        }
        let waiting = self.changes.editors().map(EditWaiter::job).chain(self.editing.jobs());
        let waiting = waiting.filter(|of| of.client == job.client).count();
        if waiting == TRANSACTIONS_MAX - SPARE_TRANSACTIONS {
            // They come faster than what they wait for: none is to be lost for that.
            self.changes.end_holds(now);
        }
        if waiting >= TRANSACTIONS_MAX {
            return Err(format!(
                "{TRANSACTIONS_MAX} transactions of this client are waiting already; await some \
                 first"
            ));
        }
        if let Some(base) = transaction.base.filter(|base| *base > self.shown.revision) {
            let shown = self.shown.revision;
            return Err(format!("it builds on revision {base}, and the wall shows {shown}"));
        }
        self.changes.expect_room()?;
        let is_temporary = transaction.is_temporary;
        let notes = transaction.assets.as_mut().map(NewAssets::take_notes).unwrap_or_default();
        transaction.assets = transaction.assets.filter(NewAssets::has_meshes);
        let Accepted { edits, created, assets } = self.editing.accept(transaction)?;
        if is_temporary && !created.is_empty() {
            self.editing.temporary.add(job.client, &created);
        }
        let waiter = EditWaiter { job, asked_at: self.frame, created, assets, notes };
        self.request_edits(now, edits, Some(waiter));
        Ok(None)
    }

    fn request_edits(&mut self, now: Micros, edits: Vec<Edit>, waiter: Option<EditWaiter>) {
        if let Err((edits, waiter)) = self.changes.join_waiting_edits(edits, waiter) {
            let purpose = ChangeOrigin::Edit { waiters: waiter.into_iter().collect() };
            let operations = vec![Operation::EditScene(edits.into())];
            self.request_change(now, StateChange { operations, purpose });
        }
    }

    /// The state that is shown from the next frame on has an edited scene. Nothing is loaded for
    /// it, so neither deadline nor warm-up begin anew.
    pub(super) fn commit_edits(
        &mut self,
        now: Micros,
        operations: &[Operation],
        waiters: Vec<EditWaiter>,
        failed: &[(SessionId, String)],
    ) {
        let revision = self.shown.revision;
        self.editing.latest = revision;
        for target in edits_of(operations).filter_map(EditTarget::of) {
            // The number of a node that was made and is gone is not given again.
            let is_gone = |node: NodeId| {
                let of_file = self.editing.outline.as_ref().is_some_and(|of| node.0 < of.nodes());
                !of_file && self.shown.edits.node(node).is_none()
            };
            let is_gone = match &target {
                EditTarget::Node(node) => is_gone(*node),
                EditTarget::Assets(id) => !self.shown.edits.has_assets(*id),
                _ => false,
            };
            if is_gone {
                self.editing.changed.remove(&target);
            } else {
                self.editing.changed.insert(target, Some(revision));
            }
        }
        let waiting = self.changes.queued().flat_map(|change| edits_of(&change.operations));
        for target in waiting.filter_map(EditTarget::of) {
            self.editing.changed.insert(target, None);
        }
        let waiters = waiters.into_iter().map(|waiter| (revision, waiter));
        self.editing.waiters.extend(waiters);
        self.wants_frame |= !self.pacer.is_soon(now);
        self.demote_unprepared(now, failed);
        self.forget_ended_nodes();
        self.persist();
        tracing::debug!(revision = revision.0, "the scene is edited");
    }

    /// A change of edits was refused: those that were made of it are too.
    pub(super) fn refuse_waiting_edits(&mut self, reason: &str) {
        for waiter in self.changes.take_waiting_edits() {
            self.reply(waiter.job, Err(RequestError::new(reason)));
        }
        self.editing.accepted = self.shown.edits.clone();
        let revision = self.editing.latest;
        for changed in self.editing.changed.values_mut() {
            changed.get_or_insert(revision);
        }
    }

    /// A frame of this state was swapped: who waits for it, or for one before, is told.
    pub(super) fn answer_editors(&mut self, feedback: &FrameFeedback) {
        let (frame, shown) = (feedback.frame, feedback.revision);
        let waiters = &mut self.editing.waiters;
        let seen: Vec<_> = waiters.extract_if(.., |(of, _)| *of <= shown).collect();
        for (revision, EditWaiter { job, asked_at, created, assets, notes }) in seen {
            let frames = frame.0.saturating_sub(asked_at.0);
            let feedback = feedback.clone();
            let edited = Edited { revision, created, assets, frames, feedback, notes };
            self.reply(job, Ok(Response::Edited(edited)));
        }
    }
}

impl EditWaiter {
    pub fn job(&self) -> ClientRequest {
        self.job
    }
}
