//! Changes that stand in the way of others: scenes that nobody waits for any more, as another one
//! was asked for while they were prepared, and parts of a scene, for which nobody waits at all.
//!
//! A heavy scene may take servers minutes. Once another scene waits behind it, it is given a
//! moment to be ready all the same, and is then refused; so is a part behind which any change
//! waits. Servers that still work on it are sent what is wanted now, and stop.

use polyptych_files::blob::BlobHash;
use polyptych_protocol::ids::Revision;
use polyptych_protocol::state_log::Operation;

use super::change_queue::{ChangeOrigin, ChangeQueue, StateChange};
use super::scene_editing::EditWaiter;
use super::{ClientRequest, Cluster, Micros};

/// Maximum time for which a scene may still become ready once another one waits behind it: most
/// take less, and are shown in their turn. The client that opened the next one waits no longer than
/// this.
const OBSOLETE_TIME_MAX: Micros = 500_000;

/// A state that a server was sent and has not answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub(super) struct Owed {
    pub revision: Revision,
    /// The manifest of its scene: what takes long to prepare.
    pub scene: Option<BlobHash>,
}

impl StateChange {
    /// Returns the scene that it opens or, by `Some(None)`, that it closes one.
    #[expect(clippy::option_option, reason = "no change of the scene, no scene, a scene")]
    fn scene(&self) -> Option<Option<BlobHash>> {
        self.operations.iter().rev().find_map(|operation| match operation {
            Operation::OpenScene(scene) => Some(Some(scene.manifest)),
            Operation::CloseScene => Some(None),
            _ => None,
        })
    }
}

impl ChangeQueue {
    /// The requests that wait for a change.
    pub fn jobs(&self) -> impl Iterator<Item = ClientRequest> {
        let purposes = self.queued().chain(self.current()).map(|change| &change.purpose);
        let scenes = purposes.filter_map(|purpose| match purpose {
            ChangeOrigin::Scene { job, .. }
            | ChangeOrigin::Environment { job }
            | ChangeOrigin::LightEffect { job, .. } => Some(*job),
            _ => None,
        });
        let edits = self.editors().map(EditWaiter::job);
        scenes.chain(self.tuners().map(|tuner| tuner.job)).chain(edits)
    }

    /// Returns whether the scene on its way is to be replaced by another one that waits.
    fn is_obsolete(&self) -> bool {
        let Some(Some(scene)) = self.current().and_then(StateChange::scene) else { return false };
        self.queued().filter_map(StateChange::scene).any(|waiting| waiting != Some(scene))
    }

    /// Returns whether a change waits behind a part of the scene.
    fn waits_for_part(&self) -> bool {
        let current = self.current().map(|change| &change.purpose);
        matches!(current, Some(ChangeOrigin::Residency)) && self.waiting() > 0
    }

    /// What waits behind a part of a scene, or for a server that catches up, waits no longer.
    pub fn end_holds(&mut self, now: Micros) {
        if self.waits_for_part() {
            self.expire_by(now);
        }
        self.end_catch_up_by(now);
    }
}

impl Cluster {
    /// Lets the change on its way expire soon if it is a scene that is obsolete, or a part of one
    /// behind which others wait.
    pub(super) fn hasten_expiry(&mut self, now: Micros) {
        if self.changes.is_obsolete() {
            self.changes.expire_by(now + OBSOLETE_TIME_MAX);
        } else if self.changes.waits_for_part() {
            let end = now + self.part_hold();
            self.changes.expire_by(end);
        }
    }

    /// Refuses the scene on its way if it is obsolete. Returns whether it was.
    pub(super) fn refuse_obsolete(&mut self, now: Micros) -> bool {
        if !self.changes.is_obsolete() {
            return false;
        }
        let Some((purpose, revision)) = self.changes.take_current() else { return false };
        tracing::info!(revision = revision.0, "a scene was replaced before it was ready");
        self.refuse(&purpose, "another scene was opened before this one was ready on the displays");
        self.stay(now, revision);
        true
    }
}
