//! Servers that catch up: changes wait for them a while before they are shown.
//!
//! A server that joins, or was late, is sent the shown state whole. Where changes come without
//! end, as an edit at each frame, that is an earlier state by the time it is prepared, again and
//! again: the server would never be ready. Once it is, changes wait for it as for any other.

use std::collections::{BTreeMap, BTreeSet};

use polyptych_files::blob::BlobHash;
use serde::{Deserialize, Serialize};

use super::ChangeQueue;
use crate::{Cluster, Micros, SessionId};

/// Time for which changes wait for a server that catches up, twice as long after each wait in vain:
/// one that has the scene needs little more than for a change.
const CATCH_UP_TIME_FIRST: Micros = 2_000_000;

/// Maximum of that time.
const CATCH_UP_TIME_MAX: Micros = 32_000_000;

/// Changes do not wait again for as many times as long as they have waited: a server that falls
/// behind again and again takes at most a fifth of the time of those who edit.
const CATCH_UP_FACTOR: Micros = 4;

/// Servers that changes wait for though they are not ready yet.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct CatchUps {
    current: Option<CatchUp>,
    /// The time before which no other wait begins.
    not_before: Micros,
    /// Time to wait for those that were waited for in vain.
    longer: BTreeMap<SessionId, Micros>,
}

/// A wait.
#[derive(Debug, Serialize, Deserialize)]
struct CatchUp {
    begun: Micros,
    ends: Micros,
    sessions: BTreeSet<SessionId>,
}

impl CatchUps {
    /// Returns the time at which the wait ends, if there is one.
    pub fn end(&self) -> Option<Micros> {
        self.current.as_ref().map(|wait| wait.ends)
    }

    fn begin(&mut self, now: Micros, session: SessionId) {
        if let Some(wait) = &mut self.current {
            wait.sessions.insert(session);
        } else if now >= self.not_before {
            let time = self.longer.get(&session).copied().unwrap_or(CATCH_UP_TIME_FIRST);
            let sessions = BTreeSet::from([session]);
            self.current = Some(CatchUp { begun: now, ends: now + time, sessions });
        }
    }

    /// Ends a wait that is over: it has lasted long enough, or is for nobody any more. Returns
    /// whether there was one.
    fn end_overdue(&mut self, now: Micros) -> bool {
        let is_over = |wait: &mut CatchUp| wait.ends <= now || wait.sessions.is_empty();
        let Some(wait) = self.current.take_if(is_over) else { return false };
        self.not_before = now + (now - wait.begun).saturating_mul(CATCH_UP_FACTOR);
        for session in wait.sessions {
            let time = self.longer.entry(session).or_insert(CATCH_UP_TIME_FIRST);
            *time = (*time * 2).min(CATCH_UP_TIME_MAX);
        }
        true
    }

    fn remove(&mut self, now: Micros, session: SessionId) {
        if let Some(wait) = &mut self.current {
            wait.sessions.remove(&session);
        }
        self.end_overdue(now);
    }
}

impl ChangeQueue {
    /// A server is ready: changes wait for it as for any other.
    pub fn end_catch_up(&mut self, now: Micros, session: SessionId) {
        self.catch_ups.remove(now, session);
    }

    /// Ends the wait at this time at the latest.
    pub fn end_catch_up_by(&mut self, at: Micros) {
        if let Some(wait) = &mut self.catch_ups.current {
            wait.ends = wait.ends.min(at);
        }
    }

    /// A server is gone.
    pub fn forget_catch_up(&mut self, now: Micros, session: SessionId) {
        self.catch_ups.remove(now, session);
        self.catch_ups.longer.remove(&session);
    }

    /// Ends a wait that has lasted long enough. Returns whether there was one.
    pub fn end_overdue_catch_up(&mut self, now: Micros) -> bool {
        self.catch_ups.end_overdue(now)
    }
}

impl Cluster {
    /// A server that is not ready has prepared an earlier state, of this scene. If that is the
    /// shown one, changes wait for the server now.
    pub(crate) fn begin_catch_up(
        &mut self,
        now: Micros,
        session: SessionId,
        scene: Option<BlobHash>,
    ) {
        if scene == self.shown_manifest() {
            self.changes.catch_ups.begin(now, session);
        }
    }

    /// Returns whether the change on its way waits for a server that catches up: one that is at
    /// work on the shown state. A change to another scene does not.
    pub(crate) fn awaits_catch_up(&self) -> bool {
        let owes_shown = |session: &SessionId| {
            let owed = self.registry.server(*session).and_then(|server| server.owes);
            owed.is_some_and(|owed| owed.revision == self.shown.revision)
        };
        self.changes.scene() == self.shown_manifest()
            && self.changes.catch_ups.current.iter().flat_map(|wait| &wait.sessions).any(owes_shown)
    }

    fn shown_manifest(&self) -> Option<BlobHash> {
        self.shown.scene.as_ref().map(|scene| scene.manifest)
    }
}
