//! The change of the replicated state that is on its way, and those that wait behind it.

mod catch_up;

use std::collections::{BTreeSet, VecDeque};
use std::sync::Arc;

use catch_up::CatchUps;
use polyptych_files::blob::BlobHash;
use polyptych_protocol::ids::{Digest, Revision};
use polyptych_protocol::request::SceneSummary;
use polyptych_protocol::state_log::{Operation, Replica};
use polyptych_scene::{Edit, SceneOutline};
use polyptych_wall::Wall;
use serde::{Deserialize, Serialize};

use super::calibrate::CalibrationWaiter;
use super::change::CHANGES_MAX;
use super::light_effects::EffectSetting;
use super::scene_editing::EditWaiter;
use super::{ClientRequest, ImportedScene, ImportedSession, Micros, SessionId, progress};

/// Maximum number of edits that different transactions bring to one change: together they must fit
/// into a message, and an edit takes at most 1.4 KiB.
const MERGED_EDITS_MAX: usize = 1000;

/// A change that was asked for.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct StateChange {
    /// The operations for servers. Those of a tuning or an effect are empty until its turn comes.
    pub operations: Vec<Operation>,
    pub purpose: ChangeOrigin,
}

/// The origin of a change: the requests that wait for it, and what they need.
#[derive(Debug, Serialize, Deserialize)]
pub(super) enum ChangeOrigin {
    /// Another scene, or none.
    Scene {
        job: ClientRequest,
        summary: Option<SceneSummary>,
        /// The outline, which is needed to edit it; `None` without a scene.
        outline: Option<Arc<SceneOutline>>,
        /// The number that its next node gets at least.
        next_node: u64,
        /// The session that is shown with it, if it is the scene of one.
        session: Option<Box<ImportedSession>>,
    },
    /// An edit of the open scene.
    Edit { waiters: Vec<EditWaiter> },
    /// A tuned wall; the scene stays.
    Tuning { wall: Box<Wall>, tuners: Vec<CalibrationWaiter> },
    /// Another environment; the scene stays.
    Environment { job: ClientRequest },
    /// An effect of light, which frames have once servers have its pipelines.
    LightEffect { job: ClientRequest, setting: EffectSetting },
    /// Another part of the scene is held. Nobody waits for it.
    Residency,
}

impl StateChange {
    /// Returns the change to no scene, for a client that asks for it.
    pub fn closing(job: ClientRequest) -> Self {
        let operations = vec![Operation::CloseScene];
        let (summary, outline, session) = (None, None, None);
        let purpose = ChangeOrigin::Scene { job, summary, outline, next_node: 0, session };
        Self { operations, purpose }
    }

    /// Returns the change to a scene, for a client that opens it.
    pub fn opening(job: ClientRequest, imported: ImportedScene) -> Self {
        let ImportedScene { scene, summary, outline, edits, next_node } = imported;
        let mut operations = vec![Operation::OpenScene(scene)];
        if !edits.is_empty() {
            operations.push(Operation::SetEdits(Box::new(edits)));
        }
        let (summary, outline) = (Some(*summary), Some(outline));
        let purpose = ChangeOrigin::Scene { job, summary, outline, next_node, session: None };
        Self { operations, purpose }
    }

    /// The wall that it leads to, where it is a tuning, and who waits for that.
    pub fn tuning(&mut self) -> Option<(&mut Box<Wall>, &mut Vec<CalibrationWaiter>)> {
        match &mut self.purpose {
            ChangeOrigin::Tuning { wall, tuners } => Some((wall, tuners)),
            _ => None,
        }
    }

    /// Returns the request that opens a scene by it, and the scene's name.
    pub fn opened(&self) -> Option<(ClientRequest, String)> {
        match &self.purpose {
            ChangeOrigin::Scene { job, summary: Some(summary), .. } => {
                Some((*job, progress::name_of(&summary.name)))
            }
            _ => None,
        }
    }

    /// Returns whether it changes the open scene; by one operation.
    pub fn is_edit(&self) -> bool {
        matches!(self.purpose, ChangeOrigin::Edit { .. })
    }

    pub fn wall(&self) -> Option<&Wall> {
        match &self.purpose {
            ChangeOrigin::Tuning { wall, .. } => Some(wall),
            _ => None,
        }
    }

    pub fn tuners(&self) -> &[CalibrationWaiter] {
        match &self.purpose {
            ChangeOrigin::Tuning { tuners, .. } => tuners,
            _ => &[],
        }
    }
}

/// The change on its way and those behind it.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct ChangeQueue {
    pub(super) current: Option<InFlightChange>,
    pub(super) queue: VecDeque<StateChange>,
    /// The last revision that was refused. Its number is not given again: a server may still be at
    /// work on it.
    #[serde(default)]
    pub(super) refused: Option<Revision>,
    /// The servers that hold a refused state, of those that go on with the shown one, of which no
    /// frame was swapped since.
    #[serde(default)]
    pub(super) refused_unseen: BTreeSet<SessionId>,
    #[serde(default)]
    catch_ups: CatchUps,
}

/// A change that servers prepare.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct InFlightChange {
    pub change: StateChange,
    pub replica: Replica,
    pub digest: Digest,
    /// The time at which servers were sent it first.
    pub begun: Micros,
    pub expires: Micros,
    /// Servers that cannot draw it, with the reason.
    pub failed: Vec<(SessionId, String)>,
    /// The progress that its client was told last, in percent; `None` before it was told any.
    #[serde(default)]
    pub told_percent: Option<u8>,
}

impl ChangeQueue {
    /// The time at which the change on its way expires, or no longer waits for a server.
    pub fn next_expiry(&self) -> Option<Micros> {
        let expires = self.current.as_ref().map(|underway| underway.expires);
        expires.into_iter().chain(self.catch_ups.end()).min()
    }

    /// Returns whether the change on its way has expired.
    pub fn has_expired(&self, now: Micros) -> bool {
        self.current.as_ref().is_some_and(|underway| now >= underway.expires)
    }

    /// The revision that the change on its way leads to.
    pub fn revision(&self) -> Option<Revision> {
        self.current.as_ref().map(|underway| underway.replica.revision)
    }

    pub fn current(&self) -> Option<&StateChange> {
        self.current.as_ref().map(|underway| &underway.change)
    }

    pub fn queued(&self) -> impl Iterator<Item = &StateChange> {
        self.queue.iter()
    }

    /// Shortens the time that the change on its way has.
    pub fn expire_by(&mut self, at: Micros) {
        if let Some(underway) = &mut self.current {
            underway.expires = underway.expires.min(at);
        }
    }

    /// Takes the change on its way out; returns who waits for it, and its revision.
    pub fn take_current(&mut self) -> Option<(ChangeOrigin, Revision)> {
        let underway = self.current.take()?;
        Some((underway.change.purpose, underway.replica.revision))
    }

    /// The scene that the change on its way leads to.
    pub fn scene(&self) -> Option<BlobHash> {
        let replica = self.current.as_ref().map(|underway| &underway.replica);
        replica.and_then(|replica| replica.scene.as_ref()).map(|scene| scene.manifest)
    }

    /// Returns whether this server has reported that it cannot prepare the change on its way.
    pub fn has_failed_on(&self, session: SessionId) -> bool {
        let mut failed = self.current.iter().flat_map(|underway| &underway.failed);
        failed.any(|(id, _)| *id == session)
    }

    /// A server cannot prepare the change on its way. Said once, however often: who repeats itself
    /// fills no memory.
    pub fn add_failure(&mut self, session: SessionId, reason: String) {
        if !self.has_failed_on(session)
            && let Some(underway) = &mut self.current
        {
            underway.failed.push((session, reason));
        }
    }

    /// Checks that another change may wait.
    ///
    /// # Errors
    /// Returns an error if [`CHANGES_MAX`] changes are waiting already.
    pub fn expect_room(&self) -> Result<(), String> {
        if self.queue.len() < CHANGES_MAX {
            return Ok(());
        }
        Err(format!("{CHANGES_MAX} changes are waiting already; ask again later"))
    }

    /// Returns the number of changes that wait for their turn.
    pub fn waiting(&self) -> usize {
        self.queue.len()
    }

    /// The wall as it will be once all is done that waits.
    pub fn latest_wall(&self) -> Option<&Wall> {
        self.queue.iter().rev().chain(self.current()).find_map(StateChange::wall)
    }

    /// The walls that are on their way.
    pub fn pending_walls(&self) -> impl Iterator<Item = &Wall> {
        self.queue.iter().chain(self.current()).filter_map(StateChange::wall)
    }

    /// Returns the requests that wait for a tuning.
    pub fn tuners(&self) -> impl Iterator<Item = &CalibrationWaiter> {
        self.queue.iter().chain(self.current()).flat_map(StateChange::tuners)
    }

    /// The scenes that wait for their turn, by name.
    pub fn waiting_scenes(&self) -> impl Iterator<Item = String> {
        self.queue.iter().filter_map(StateChange::opened).map(|(_, scene)| scene)
    }

    /// Returns whether this share of the change on its way is news to its client.
    pub fn is_news(&mut self, percent: u8) -> bool {
        let told = self.current.as_mut().map(|underway| underway.told_percent.replace(percent));
        told.is_some_and(|told| told != Some(percent))
    }

    /// Puts the wall in the place of the one that waits for its turn, if there is one: tunings
    /// come faster than they are shown, and only the last one is to be seen.
    ///
    /// # Errors
    /// The wall, if none waits.
    pub fn replace_waiting_wall(
        &mut self,
        wall: Box<Wall>,
        tuner: CalibrationWaiter,
    ) -> Result<(), Box<Wall>> {
        let Some((waiting, tuners)) = self.queue.iter_mut().find_map(StateChange::tuning) else {
            return Err(wall);
        };
        *waiting = wall;
        tuners.push(tuner);
        Ok(())
    }

    /// Returns whether this revision was refused, and so is no state of the wall.
    pub fn is_refused(&self, shown: Revision, revision: Revision) -> bool {
        shown < revision && self.refused.is_some_and(|refused| revision <= refused)
    }

    /// A frame of the shown state was swapped: servers hold it before all that comes.
    pub fn note_swap(&mut self) {
        self.refused_unseen.clear();
    }

    /// Takes the tunings out that wait for their turn, and gives who waits for them.
    pub fn take_waiting_tuners(&mut self) -> Vec<CalibrationWaiter> {
        let (tunings, others) =
            self.queue.drain(..).partition::<VecDeque<_>, _>(|change| change.wall().is_some());
        self.queue = others;
        tunings.iter().flat_map(StateChange::tuners).copied().collect()
    }

    pub fn digest_of(&self, revision: Revision) -> Option<Digest> {
        let underway = self.current.as_ref();
        underway.filter(|u| u.replica.revision == revision).map(|u| u.digest)
    }
}

impl ChangeQueue {
    /// Returns whether a scene is on its way, or waits.
    pub fn has_scene_underway(&self) -> bool {
        let changes = self.queued().chain(self.current());
        changes.into_iter().any(|change| matches!(change.purpose, ChangeOrigin::Scene { .. }))
    }

    /// Returns the requests that wait for an edit that is not in the shown state yet.
    pub fn editors(&self) -> impl Iterator<Item = &EditWaiter> {
        self.queued().chain(self.current()).flat_map(|change| match &change.purpose {
            ChangeOrigin::Edit { waiters } => &waiters[..],
            _ => &[],
        })
    }

    /// Puts edits behind those that wait for their turn, so that one frame shows all.
    ///
    /// # Errors
    /// Both, where none wait, or they would be too many.
    pub fn join_waiting_edits(
        &mut self,
        edits: Vec<Edit>,
        waiter: Option<EditWaiter>,
    ) -> Result<(), (Vec<Edit>, Option<EditWaiter>)> {
        // Assets are as long as their meshes are many.
        let is_small = !edits.iter().any(|edit| matches!(edit, Edit::AddAssets(_)));
        let waiting = self.queue.iter_mut().rev().find_map(|change| {
            match (&mut change.purpose, &mut change.operations[..]) {
                (ChangeOrigin::Edit { waiters }, [Operation::EditScene(of)]) => Some((of, waiters)),
                _ => None,
            }
        });
        match waiting {
            Some((of, waiters)) if is_small && of.len() + edits.len() <= MERGED_EDITS_MAX => {
                Arc::make_mut(of).extend(edits);
                waiters.extend(waiter);
                Ok(())
            }
            _ => Err((edits, waiter)),
        }
    }

    /// Takes the edits out that wait for their turn, and gives who waits for them.
    pub fn take_waiting_edits(&mut self) -> Vec<EditWaiter> {
        let (edits, others) = self.queue.drain(..).partition::<Vec<_>, _>(StateChange::is_edit);
        self.queue = others.into();
        let waiters = edits.into_iter().filter_map(|change| match change.purpose {
            ChangeOrigin::Edit { waiters } => Some(waiters),
            _ => None,
        });
        waiters.flatten().collect()
    }
}
