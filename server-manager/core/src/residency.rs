//! The part of a scene that servers hold where all of it is more than their budget: it follows
//! where the wall is seen from.
//!
//! Servers say how far an eye may move before another part serves better. Once it has, the place
//! joins the replicated state as any change does, so that a finer level is drawn only when every
//! server has it, and until then all is drawn as before.

use polyptych_protocol::ids::{FrameId, Revision};
use polyptych_protocol::state_log::Operation;
use polyptych_scene::residency::SeenFrom;
use polyptych_wall::view::ViewProjection;
use serde::{Deserialize, Serialize};

use super::change::PREPARE_TIME_MAX;
use super::change_queue::ChangeOrigin;
use super::{Cluster, Micros, SessionId, StateChange};

/// Minimum time between two parts.
const CHANGE_PERIOD: Micros = 500_000;

/// Minimum time between two parts as a multiple of the time that servers took for the last one with
/// its first frame, on a wall that draws by itself: where a camera flies past everything, they have
/// the rest for frames. Who asks a paused wall for frames, as a film does, may wait for detail.
const CHANGE_FACTOR: Micros = 4;

/// Time after which a part is asked for again that servers could not get ready.
const RETRY_PERIOD: Micros = 10_000_000;

/// Maximum time for which another part is waited for at first: there is one that is shown until
/// then. It is twice as long behind each that was not ready, as servers begin anew with each, up to
/// the time that any change has.
const PART_TIME_MAX: Micros = 10_000_000;

/// Maximum time for which another part may still become ready once another change waits behind it,
/// at first: most take less, and what was read for it is in the servers' caches when it is tried
/// again. It is twice as long behind each that was not ready, up to [`PART_TIME_MAX`]: where
/// changes come without end, one that takes longer would never come.
const PART_HOLD_FIRST: Micros = 2_000_000;

/// Time after which such a part is asked for again as a multiple of that for which other changes
/// waited in vain: they lose at most a fifth of their time.
const HELD_RETRY_FACTOR: Micros = RETRY_PERIOD / PART_HOLD_FIRST;

/// What frames are seen from, and when servers are told.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct Residency {
    /// The places that the last frame was seen from; none where no budget limits what is held.
    places: Vec<SeenFrom>,
    /// The time at which servers were asked for the last part.
    asked_at: Micros,
    /// No other part is asked for before.
    not_before: Micros,
    /// Nor before this, on a wall that draws by itself: servers have the time for frames.
    #[serde(default)]
    frames_until: Micros,
    /// Number of parts in a row that servers could not get ready in time, though no change waited
    /// for it.
    #[serde(default)]
    failures: u32,
    /// Number of parts in a row that servers could not get ready in time while changes waited for
    /// them.
    #[serde(default)]
    held_failures: u32,
    /// It was said that parts of this scene could not be shown.
    #[serde(default)]
    is_failure_told: bool,
    /// No frame of the part that is held has begun.
    is_new: bool,
    /// The first frame of the part that is held, while it is on its way.
    first_frame: Option<FrameId>,
}

impl Residency {
    /// The next part has the time of a first one.
    fn forget_failures(&mut self) {
        (self.failures, self.held_failures, self.is_failure_told) = (0, 0, false);
    }

    /// Servers are asked for another part now: it has waited for its turn.
    pub(super) fn begin_part(&mut self, now: Micros) {
        self.asked_at = now;
    }

    /// Another scene is shown: nothing that was learnt of the parts of the last one holds for it.
    pub(super) fn end_scene(&mut self) {
        self.forget_failures();
        (self.not_before, self.frames_until) = (0, 0);
        (self.is_new, self.first_frame) = (false, None);
    }
}

impl Cluster {
    /// The places that frames are seen from; none where the wall has no budget of GPU memory.
    /// `densities` are those of the views; a view that no channel shows has none.
    pub(super) fn seen_places(&self, densities: &[f64]) -> Vec<SeenFrom> {
        let views = self.presentation.all_views().into_iter().zip(densities);
        let is_limited = self.wall.budget.gpu_mib.is_some() && self.shown.scene.is_some();
        let shown = views.filter(|(_, density)| is_limited && **density > 0.0);
        let place = |(view, &density): (polyptych_wall::view::View, &f64)| {
            let camera = &view.camera;
            match view.projection {
                ViewProjection::Wall => {
                    let position = camera.world_from_display(self.presentation.head.position);
                    SeenFrom { position, density, is_parallel: false }
                }
                ViewProjection::Perspective { .. } => {
                    SeenFrom { position: camera.position, density, is_parallel: false }
                }
                ViewProjection::Orthographic { .. } => SeenFrom {
                    position: camera.position,
                    density: density / camera.scale,
                    is_parallel: true,
                },
            }
        };
        shown.map(place).collect()
    }

    /// The frame that begins is seen with these densities.
    pub(super) fn note_places(&mut self, densities: &[f64]) {
        self.residency.places = self.seen_places(densities);
    }

    /// Returns whether a frame of this revision has less detail than the same will have, as another
    /// part is about to come, or has come since.
    pub(super) fn awaits_detail(&self, drawn: Revision) -> bool {
        self.detail_reach().is_some()
            && (drawn != self.shown.revision || self.is_choosing_part() || !self.is_served())
    }

    /// Returns whether the frame that begins is the first of another part: shadows are drawn anew.
    pub(super) fn begins_part(&mut self) -> bool {
        let is_new = std::mem::take(&mut self.residency.is_new);
        if is_new {
            self.residency.first_frame = Some(self.frame);
        }
        is_new
    }

    /// This frame was drawn, or was waited for as long as can be: of a part it may be the first.
    pub(super) fn end_part_frame(&mut self, now: Micros, frame: FrameId) {
        if self.residency.first_frame.take_if(|first| *first == frame).is_some() {
            self.space_parts(now);
        }
    }

    /// Leaves some time before another part is asked for.
    fn space_parts(&mut self, now: Micros) {
        let taken = now.saturating_sub(self.residency.asked_at);
        self.residency.not_before = now + CHANGE_PERIOD;
        self.residency.frames_until = now.saturating_add(taken.saturating_mul(CHANGE_FACTOR));
    }

    /// Returns the time at which servers are told of other places, if they are to be.
    pub(super) fn next_residency(&self) -> Option<Micros> {
        let _ = self.detail_reach()?;
        // Behind a scene it would be of no use, and a scene that another change waits behind is
        // given up sooner.
        let is_free = self.changes.expect_room().is_ok() && !self.changes.has_scene_underway();
        let is_due = is_free && !self.is_choosing_part() && !self.is_served();
        let Residency { not_before, frames_until, .. } = self.residency;
        let is_paused = self.pacer.pace().is_none();
        is_due.then_some(if is_paused { not_before } else { not_before.max(frames_until) })
    }

    /// Tells servers where the wall is seen from, if that is due.
    pub(super) fn update_residency(&mut self, now: Micros) {
        if self.next_residency().is_none_or(|at| now < at) {
            return;
        }
        let operations = vec![Operation::SetSeenFrom(self.residency.places.clone())];
        self.request_change(now, StateChange { operations, purpose: ChangeOrigin::Residency });
    }

    /// The state that frames name has another part of the scene.
    pub(super) fn commit_residency(&mut self, now: Micros, failed: &[(SessionId, String)]) {
        self.residency.is_new = true;
        self.residency.forget_failures();
        self.space_parts(now);
        self.demote_unprepared(now, failed);
        // A wall that is paused shows it too.
        self.wants_frame |= !self.pacer.is_soon(now);
    }

    /// The part that served the last places of another life of the manager is held again.
    pub(super) fn restore_places(&mut self) {
        let detail = self.detail_bound();
        let places = self.seen_places(&detail.densities);
        if !places.is_empty() {
            let revision = self.shown.revision;
            self.shown.apply(Operation::SetSeenFrom(places));
            self.shown.revision = revision;
            self.shown_digest = self.shown.digest();
        }
    }

    /// The time for which the next part is waited for.
    pub(super) fn part_time(&self) -> Micros {
        doubled(PART_TIME_MAX, self.residency.failures).min(PREPARE_TIME_MAX)
    }

    /// The time for which other changes wait behind the next part.
    pub(super) fn part_hold(&self) -> Micros {
        doubled(PART_HOLD_FIRST, self.residency.held_failures).min(PART_TIME_MAX)
    }

    /// Servers could not get another part ready, or not in time; they go on with the one that they
    /// have.
    pub(super) fn postpone_residency(&mut self, now: Micros, is_overdue: bool, reason: &str) {
        // One that others were waiting for had little time.
        if is_overdue && self.changes.waiting() > 0 {
            self.residency.not_before = now + HELD_RETRY_FACTOR * self.part_hold();
            // However often it is tried again.
            if self.residency.held_failures == 0 {
                tracing::warn!(
                    reason,
                    "another part of the scene could not be shown while other changes waited"
                );
            }
            self.residency.held_failures = self.residency.held_failures.saturating_add(1);
            return;
        }
        self.residency.not_before = now + RETRY_PERIOD;
        if !std::mem::replace(&mut self.residency.is_failure_told, true) {
            tracing::warn!(reason, "another part of the scene could not be shown");
        }
        self.residency.failures += u32::from(is_overdue);
    }

    /// Returns whether another part is on its way, or waits for its turn.
    fn is_choosing_part(&self) -> bool {
        let mut changes = self.changes.queued().chain(self.changes.current());
        changes.any(|change| matches!(change.purpose, ChangeOrigin::Residency))
    }

    /// Returns whether the part that is held serves the places of the last frame.
    fn is_served(&self) -> bool {
        let (places, held) = (&self.residency.places, &self.shown.seen_from);
        let reach = self.detail_reach().unwrap_or(f64::INFINITY);
        let mut pairs = places.iter().zip(held);
        places.is_empty()
            || (places.len() == held.len() && pairs.all(|(place, of)| place.is_near(of, reach)))
    }

    /// The distance by which places may move, as the servers of the shown state say; `None` where
    /// they hold all of the scene.
    fn detail_reach(&self) -> Option<f64> {
        let servers = self.registry.servers().map(|(_, server)| server);
        let holders = servers.filter(|server| server.prepared == Some(self.shown.revision));
        let reach = holders.filter_map(|server| server.detail_reach).reduce(f64::min)?;
        // A server may say what it wants.
        Some(reach.max(0.0))
    }
}

/// Returns a time that is twice as long after each of so many failures.
fn doubled(time: Micros, failures: u32) -> Micros {
    time.saturating_mul(1_u64.checked_shl(failures).unwrap_or(Micros::MAX))
}
