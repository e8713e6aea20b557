//! Changes of the replicated state: prepare, prepared, and then the next frame names it.
//!
//! One change is on its way at a time; others wait in order. Until every live channel can draw
//! the new state, everything is drawn as before.

use polyptych_protocol::command::{Command, Prepare};
use polyptych_protocol::feedback::ChannelState;
use polyptych_protocol::ids::Revision;
use polyptych_protocol::progress::{OpenProgress, OpenStage, Opening};
use polyptych_protocol::request::{RequestError, Response, SceneSummary};
use polyptych_protocol::state_log::Replica;
use polyptych_wall::ChannelId;

use super::calibrate;
use super::change_queue::{ChangeOrigin, InFlightChange, StateChange};
use super::registry::ChannelEntry;
use super::scene_editing::EditWaiter;
use super::{
    ClientRequest, Cluster, ImportedScene, ImportedSession, Micros, PlayedClips, SessionId,
};

/// Maximum time for which a change waits for a server: enough for a large scene on a slow link.
/// After this the wall goes on without its channels until they are ready.
pub(super) const PREPARE_TIME_MAX: Micros = 120_000_000;

/// Maximum time for which a scene that no display is ready for is waited for while no other change
/// waits behind it, for the wall would be dark with it: ten GiB take an hour at 25 Mbit/s.
const SCENE_TIME_MAX: Micros = 3_600_000_000;

/// Time after which a client that waits for a scene is told that it is still prepared: a quarter of
/// that after which clients give up.
const OPEN_PROGRESS_PERIOD: Micros = 30_000_000;

/// The states of channels that a change waits for.
const ON_TIME: [ChannelState; 2] = [ChannelState::Live, ChannelState::Ready];

/// Maximum number of changes that wait for their turn.
pub(super) const CHANGES_MAX: usize = 64;

/// The reason for which a scene is not shown that no display was ready for.
const NOT_READY_IN_TIME: &str =
    "no display was ready for the scene in time; open it again: what displays have fetched is kept";

/// The reason for which another part of the scene is not shown that a display was not ready for.
const PART_NOT_READY: &str = "a display was not ready for another part of the scene in time";

/// The reason for which a server is given the shown state anew.
pub(super) const HOLDS_REFUSED: &str = "it has prepared a change that was refused";

impl Cluster {
    /// A bake has ended.
    pub(crate) fn handle_import(
        &mut self,
        now: Micros,
        job: ClientRequest,
        imported: Result<ImportedScene, String>,
    ) {
        self.end_import(job);
        match imported {
            Err(reason) => {
                let tell = || tracing::warn!(reason, "a scene could not be opened");
                self.request_span(job).in_scope(tell);
                self.reply(job, Err(RequestError::new(reason)));
            }
            Ok(scene) => self.request_change(now, StateChange::opening(job, scene)),
        }
    }

    /// Forgets what was read or baked for a client: it has come, or will not.
    pub(super) fn end_import(&mut self, job: ClientRequest) {
        // One of them, where a client gives several the same number.
        if let Some(at) = self.imports.iter().position(|of| of.job == job) {
            self.imports.remove(at);
        }
    }

    pub(super) fn request_change(&mut self, now: Micros, change: StateChange) {
        if let Err(reason) = self.changes.expect_room() {
            self.refuse(&change.purpose, &reason);
            return;
        }
        self.changes.queue.push_back(change);
        self.hasten_expiry(now);
        self.advance_change(now);
    }

    pub(super) fn send_change_to(&mut self, to: Vec<SessionId>) {
        let Some(underway) = &self.changes.current else { return };
        let revision = underway.replica.revision;
        // Behind a change that was refused servers differ in what they built last.
        let is_whole = revision.0 > self.shown.revision.0 + underway.change.operations.len() as u64;
        let prepare = Prepare {
            epoch: self.epoch,
            base: (!is_whole).then_some(self.shown.revision),
            revision,
            shown: self.shown.revision,
            operations: if is_whole {
                underway.replica.snapshot()
            } else {
                underway.change.operations.clone()
            },
        };
        self.command(to, Command::Prepare(prepare));
    }

    pub(super) fn expire_change(&mut self, now: Micros) {
        let is_wait_over = self.changes.end_overdue_catch_up(now);
        let has_expired = self.changes.has_expired(now);
        if has_expired && !self.refuse_obsolete(now) && !self.wait_longer(now) {
            self.settle_change(now);
        }
        if has_expired || is_wait_over {
            self.advance_change(now);
        }
    }

    /// Gives a scene on its way more time: all as much as a change has, and one that no display is
    /// ready for as long as no other change waits behind it. Returns whether it was given.
    fn wait_longer(&mut self, now: Micros) -> bool {
        let is_alone = self.changes.waiting() == 0;
        let Some(underway) = &self.changes.current else { return false };
        if underway.change.opened().is_none() {
            return false;
        }
        let is_dark = !self.is_prepared_by_one(underway);
        let longest = if is_dark && is_alone { SCENE_TIME_MAX } else { PREPARE_TIME_MAX };
        let is_given = now.saturating_sub(underway.begun) < longest;
        if let Some(underway) = self.changes.current.as_mut().filter(|_| is_given) {
            underway.expires = now + OPEN_PROGRESS_PERIOD;
            // As news, though it may be no other number.
            underway.told_percent = None;
            self.tell_preparing();
        }
        is_given
    }

    /// Takes the change on its way as far as it goes now, and begins the next.
    pub(super) fn advance_change(&mut self, now: Micros) {
        loop {
            if let Some(underway) = &self.changes.current {
                if !self.is_answered(underway) || self.awaits_catch_up() {
                    return;
                }
                self.settle_change(now);
                // A frame that ended with it may have begun the next.
                continue;
            }
            let Some(mut change) = self.changes.queue.pop_front() else { return };
            if let Some(wall) = change.wall() {
                change.operations = calibrate::operations(&self.wall, wall);
            }
            if let ChangeOrigin::LightEffect { setting, .. } = &change.purpose {
                change.operations = setting.operations(self.shown.effects);
            }
            let mut replica = self.replica_after(&change);
            if let Some(refused) = self.changes.refused.filter(|r| *r > self.shown.revision) {
                replica.revision.0 += refused.0 - self.shown.revision.0;
            }
            let digest = replica.digest();
            let is_part = matches!(change.purpose, ChangeOrigin::Residency);
            if is_part {
                self.residency.begin_part(now);
            }
            let expires = now
                + match change.opened() {
                    Some(_) => OPEN_PROGRESS_PERIOD,
                    None if is_part => self.part_time(),
                    None => PREPARE_TIME_MAX,
                };
            let (failed, told_percent) = (Vec::new(), None);
            let begun = now;
            let underway =
                InFlightChange { change, replica, digest, begun, expires, failed, told_percent };
            self.changes.current = Some(underway);
            self.hasten_expiry(now);
            let everyone = self.registry.servers().map(|(id, _)| id).collect();
            self.send_due_prepares(everyone);
            self.tell_preparing();
        }
    }

    /// The state that a change leads to, which is no longer among those that wait.
    fn replica_after(&self, change: &StateChange) -> Replica {
        let folded = || {
            let mut replica = self.shown.clone();
            for operation in change.operations.clone() {
                replica.apply(operation);
            }
            replica
        };
        if !(change.is_edit() && self.changes.queued().all(|waiting| !waiting.is_edit())) {
            return folded();
        }
        // All that was accepted is folded already: nothing else of it waits.
        let replica = self.shown.with_edits(self.editing.accepted().clone());
        debug_assert_eq!(replica, folded(), "what was accepted is not what is shown next");
        replica
    }

    /// Returns whether the server of every channel that is waited for has answered. Where all are
    /// late, the first that is ready must not be held up by those that hang.
    fn is_answered(&self, underway: &InFlightChange) -> bool {
        let (answered, asked) = self.answered(underway);
        let is_ready = |session| self.has_prepared(session, underway);
        let mut late = self.channels_in(&[ChannelState::Late]);
        answered == asked
            || self.channels_in(&ON_TIME).next().is_none()
                && late.any(|channel| channel.server.is_some_and(is_ready))
    }

    /// Returns the number of channels that a change waits for whose server has answered (or that
    /// have none), and the number of all that it waits for: live and ready ones, or late ones where
    /// there are no others.
    fn answered(&self, underway: &InFlightChange) -> (usize, usize) {
        let has_any = self.channels_in(&ON_TIME).next().is_some();
        let has_answered = |session: SessionId| {
            self.has_prepared(session, underway) || self.changes.has_failed_on(session)
        };
        let asked = self.channels_in(if has_any { &ON_TIME } else { &[ChannelState::Late] });
        asked.fold((0, 0), |(answered, asked), channel| {
            (answered + usize::from(channel.server.is_none_or(has_answered)), asked + 1)
        })
    }

    fn is_prepared_by_one(&self, underway: &InFlightChange) -> bool {
        self.registry.servers().any(|(session, _)| self.has_prepared(session, underway))
    }

    fn has_prepared(&self, session: SessionId, underway: &InFlightChange) -> bool {
        let prepared = self.registry.server(session).and_then(|server| server.prepared);
        prepared == Some(underway.replica.revision)
    }

    fn channels_in<'a>(
        &'a self,
        states: &'a [ChannelState],
    ) -> impl Iterator<Item = &'a ChannelEntry> {
        let channels = self.registry.channels().map(|(_, channel)| channel);
        channels.filter(|channel| states.contains(&channel.state))
    }

    /// Returns the scene whose change is on its way with the share of channels that are ready for
    /// it, and who opens it.
    pub(super) fn preparing(&self) -> Option<(ClientRequest, Opening)> {
        let underway = self.changes.current.as_ref()?;
        let (answered, asked) = self.answered(underway);
        let (job, scene) = underway.change.opened()?;
        let progress = OpenProgress::of_parts(OpenStage::Preparing, answered, asked);
        Some((job, Opening { scene, progress }))
    }

    /// Ends the change on its way: it is shown from the next frame on, or refused: a scene where no
    /// server could prepare it, a tuning where one could not.
    fn settle_change(&mut self, now: Micros) {
        let Some(underway) = self.changes.current.take() else { return };
        let is_residency = matches!(underway.change.purpose, ChangeOrigin::Residency);
        let has_one = self.is_prepared_by_one(&underway);
        let is_dark = underway.change.opened().is_some() && !has_one;
        let is_overdue = (is_residency || is_dark) && !self.is_answered(&underway);
        let InFlightChange { change, replica, digest, failed, .. } = underway;
        // A scene is worth more than a channel that cannot draw it; a tuning is not, nor detail.
        let is_tuning = matches!(change.purpose, ChangeOrigin::Tuning { .. });
        if is_overdue || !failed.is_empty() && (!has_one || is_tuning || is_residency) {
            let mut reasons: Vec<_> = failed.into_iter().map(|(_, reason)| reason).collect();
            if is_overdue {
                let reason = if is_residency { PART_NOT_READY } else { NOT_READY_IN_TIME };
                reasons.push(reason.to_owned());
            }
            let reason = format!("nothing has changed, since {}", reasons.join("; "));
            self.refuse(&change.purpose, &reason);
            if matches!(change.purpose, ChangeOrigin::Edit { .. }) {
                self.refuse_waiting_edits(&reason);
            }
            if is_residency {
                self.postpone_residency(now, is_overdue, &reason);
            }
            if is_tuning {
                // They were made of the one that failed.
                for tuner in self.changes.take_waiting_tuners() {
                    self.reply(tuner.job, Err(RequestError::new(reason.as_str())));
                }
            }
            self.stay(now, replica.revision);
            return;
        }
        self.shown = replica;
        self.shown_digest = digest;
        match change.purpose {
            ChangeOrigin::Scene { job, summary, outline, next_node, session } => {
                self.residency.end_scene();
                self.editing.restart(self.shown.revision, outline);
                self.editing.restore(self.shown.edits.clone(), next_node);
                self.settle_scene(now, job, (summary, session), &failed);
            }
            ChangeOrigin::Edit { waiters } => {
                self.commit_edits(now, &change.operations, waiters, &failed);
            }
            ChangeOrigin::Tuning { wall, tuners } => {
                self.commit_calibration(now, *wall, tuners, &failed);
            }
            ChangeOrigin::Environment { job } => self.commit_environment(now, job, &failed),
            ChangeOrigin::LightEffect { job, setting } => {
                self.commit_effect(now, (job, setting), &failed);
            }
            ChangeOrigin::Residency => self.commit_residency(now, &failed),
        }
        self.end_temporary(now);
    }

    fn settle_scene(
        &mut self,
        now: Micros,
        job: ClientRequest,
        (summary, session): (Option<SceneSummary>, Option<Box<ImportedSession>>),
        failed: &[(SessionId, String)],
    ) {
        self.deadline.restart();
        self.rate_bound.restart();
        self.pipeline.end_scene();
        self.registry.restart_warm_up();
        let revision = self.shown.revision;
        let tell = || tracing::info!(revision = revision.0, "the wall shows a new revision");
        self.request_span(job).in_scope(tell);
        self.features.clear();
        self.notes.clear();
        // What suited another scene may make this one black or white.
        self.presentation.exposure = summary.as_ref().map_or(1.0, |summary| summary.exposure);
        self.auto_exposure.restart(summary.as_ref().map(|summary| summary.exposure));
        let clips = summary.as_ref().map_or(&[][..], |summary| &summary.clips);
        self.clips = PlayedClips::new(clips);
        self.end_motion();
        self.end_subsets();
        self.navigator.bounds = summary.as_ref().and_then(|summary| summary.bounds);
        let opened = summary.map(|mut summary| {
            summary.revision = self.shown.revision;
            self.notes.clone_from(&summary.notes);
            let scene = &summary.name;
            for note in &summary.notes {
                let tell = || tracing::warn!(scene, note, "not drawn as the file has it");
                self.request_span(job).in_scope(tell);
            }
            self.features.extend(summary.features.names().into_iter().map(String::from));
            summary
        });
        let reply = match (session, opened) {
            (Some(session), opened) => self.show_session(now, *session, opened),
            (None, Some(summary)) => Response::SceneOpened(summary),
            (None, None) => Response::Done,
        };
        // This may begin a frame, which has all of the above.
        self.demote_unprepared(now, failed);
        self.persist();
        self.reply(job, Ok(reply));
    }

    /// Tells all who wait for a change that it is not done.
    pub(super) fn refuse(&mut self, purpose: &ChangeOrigin, reason: &str) {
        let jobs: Vec<_> = match purpose {
            ChangeOrigin::Scene { job, .. }
            | ChangeOrigin::Environment { job }
            | ChangeOrigin::LightEffect { job, .. } => vec![*job],
            ChangeOrigin::Tuning { tuners, .. } => tuners.iter().map(|tuner| tuner.job).collect(),
            ChangeOrigin::Edit { waiters } => waiters.iter().map(EditWaiter::job).collect(),
            ChangeOrigin::Residency => Vec::new(),
        };
        for job in jobs {
            self.reply(job, Err(RequestError::new(reason)));
        }
    }

    /// The wall goes on with what it shows. Servers that have prepared the refused revision hold
    /// the shown state beside it, and are live as before; but who may not have drawn that yet, or
    /// holds more than one that was refused, is given it anew: servers keep few states.
    pub(super) fn stay(&mut self, now: Micros, refused: Revision) {
        self.changes.refused = Some(refused);
        self.retry_temporary_end(now);
        let holders = self.registry.servers().filter(|(_, s)| s.prepared == Some(refused));
        let holders: Vec<_> = holders.map(|(id, _)| id).collect();
        // Drawn once more, it stands before all that comes, on a wall that is paused too.
        self.wants_frame |= !self.pacer.is_soon(now);
        let anew: Vec<_> = holders.into_iter().filter(|id| !self.goes_on(*id)).collect();
        if !anew.is_empty() {
            self.resynchronise(now, &anew, HOLDS_REFUSED);
        }
    }

    /// Returns whether a server that holds a refused state is live as before, with the shown state:
    /// if it may have drawn that, and holds no other refused one.
    fn goes_on(&mut self, session: SessionId) -> bool {
        let shown = self.shown.revision;
        let state = |id: &ChannelId| self.registry.channel(*id).map(|channel| channel.state);
        let is_live = self.registry.server(session).is_some_and(|server| {
            server.channels.iter().all(|id| state(id) == Some(ChannelState::Live))
        });
        if !is_live || !self.changes.refused_unseen.insert(session) {
            return false;
        }
        if let Some(server) = self.registry.server_mut(session)
            && server.prepared.replace(shown) != Some(shown)
        {
            (server.scene_bytes, server.detail_reach) = server.held_before;
        }
        true
    }

    /// Returns whether a server has prepared a change that was refused before, as in
    /// [`Self::stay`]: if it does not go on with what is shown, it is resynchronised.
    pub(super) fn is_rejected(&mut self, now: Micros, from: SessionId, revision: Revision) -> bool {
        let is_refused = self.changes.is_refused(self.shown.revision, revision)
            && self.changes.digest_of(revision).is_none();
        if !is_refused {
            return false;
        }
        let holds_shown = self
            .registry
            .server(from)
            .is_some_and(|server| server.prepared == Some(self.shown.revision));
        if holds_shown && self.goes_on(from) {
            self.wants_frame |= !self.pacer.is_soon(now);
        } else {
            self.resynchronise(now, &[from], HOLDS_REFUSED);
        }
        true
    }

    /// Channels that cannot draw the shown revision yet are not waited for.
    pub(super) fn demote_unprepared(&mut self, now: Micros, failed: &[(SessionId, String)]) {
        let unprepared: Vec<_> = self
            .registry
            .servers()
            .filter(|(_, server)| server.prepared != Some(self.shown.revision))
            .map(|(id, server)| (id, server.channels.clone()))
            .collect();
        for (session, channels) in &unprepared {
            let reason = failed.iter().find(|(id, _)| id == session).map(|(_, r)| r.as_str());
            self.registry.set_states(channels, ChannelState::Preparing, reason, now);
        }
        let (sessions, channels): (Vec<_>, Vec<_>) = unprepared.into_iter().unzip();
        self.send_due_prepares(sessions);
        let ready: Vec<_> = self
            .registry
            .channels()
            .filter(|(_, c)| c.state == ChannelState::Preparing)
            .filter(|(_, c)| {
                let server = c.server.and_then(|session| self.registry.server(session));
                server.is_some_and(|s| s.prepared == Some(self.shown.revision))
            })
            .map(|(id, _)| id)
            .collect();
        for id in ready {
            self.registry.set_prepared(id, now);
        }
        // Last: this may begin a frame, which goes to those that can draw it, and to no other.
        self.stop_waiting_for(&channels.concat(), now);
    }
}
