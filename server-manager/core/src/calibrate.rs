//! Tuning of the running wall: a change as others are, but many may come for one frame.

use polyptych_protocol::calibration_marker::{CalibrationMarker, MarkedPoint};
use polyptych_protocol::feedback::{FrameFeedback, Tuned};
use polyptych_protocol::ids::{FrameId, Revision};
use polyptych_protocol::request::Response;
use polyptych_protocol::state_log::{Operation, check_wall_size};
use polyptych_protocol::tuned_channel::TunedChannel;
use polyptych_wall::calibration_change::keys::differing_keys;
use polyptych_wall::{ChannelCalibration, ChannelId, Wall, calibration_change};
use serde::{Deserialize, Serialize};

use super::change_queue::ChangeOrigin;
use super::{ClientRequest, Cluster, Micros, SessionId, StateChange};

/// Maximum number of tunings of one client that wait for their frame: a slider's, 50 a second, of a
/// wall that stands still for five seconds.
pub(super) const TUNERS_MAX: usize = 256;

/// One who waits until a tuning is seen.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct CalibrationWaiter {
    pub job: ClientRequest,
    /// The last frame that was begun when it asked.
    pub asked_at: FrameId,
}

/// Those whose tuning is in the state that frames name.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct CalibrationWaiters(Vec<(Revision, CalibrationWaiter)>);

impl CalibrationWaiters {
    /// Returns whether any waits for a state that a frame of revision `drawing` does not show.
    pub fn wait_beyond(&self, drawing: Option<Revision>) -> bool {
        self.0.iter().any(|(of, _)| Some(*of) > drawing)
    }

    /// The requests that wait.
    pub fn jobs(&self) -> impl Iterator<Item = ClientRequest> {
        self.0.iter().map(|(_, tuner)| tuner.job)
    }

    pub fn forget(&mut self, client: SessionId) {
        self.0.retain(|(_, tuner)| tuner.job.client != client);
    }
}

/// The keys of channels that were tuned in this life of the manager, or in one whose tunings it
/// took over. `wall save` writes these and leaves hand edits of the rest alone.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct TunedChannels(Vec<TunedChannel>);

impl TunedChannels {
    /// Notes the keys in which two walls differ as tuned.
    pub fn note(&mut self, from: &Wall, to: &Wall) {
        for (before, now) in from.channels.iter().zip(&to.channels) {
            let keys = differing_keys(&before.adjustment, &now.adjustment);
            if keys.is_empty() {
                continue;
            }
            let known = self.0.iter().position(|tuned| tuned.channel == now.name);
            let at = known.unwrap_or_else(|| {
                self.0.push(TunedChannel { channel: now.name.clone(), keys: Vec::new() });
                self.0.len() - 1
            });
            for key in keys {
                if self.0[at].keys.iter().all(|known| known != key) {
                    self.0[at].keys.push(key.to_owned());
                }
            }
        }
    }

    /// All, in the order in which they were tuned first.
    pub fn list(&self) -> Vec<TunedChannel> {
        self.0.clone()
    }
}

/// The operations that make one wall of the other, which differs in adjustments only: points of
/// bends alone where nothing else differs. At least one, since every tuning has a revision.
pub(super) fn operations(from: &Wall, to: &Wall) -> Vec<Operation> {
    let pairs = from.channels.iter().zip(&to.channels);
    let changed = pairs.enumerate().filter_map(|(index, (from, to))| {
        let channel = ChannelId(index as u16);
        operation(channel, &from.adjustment, &to.adjustment)
    });
    let mut operations: Vec<_> = changed.collect();
    if operations.is_empty() {
        operations.push(Operation::MoveBend { channel: ChannelId(0), moves: Vec::new() });
    }
    operations
}

fn operation(
    channel: ChannelId,
    from: &ChannelCalibration,
    to: &ChannelCalibration,
) -> Option<Operation> {
    if from == to {
        return None;
    }
    if let (Some(before), Some(after)) = (&from.bend, &to.bend)
        && before.points == after.points
        && *from == (ChannelCalibration { bend: from.bend.clone(), ..to.clone() })
    {
        let pairs = (0u32..).zip(before.moves.iter().zip(&*after.moves));
        let moves = pairs.filter(|(_, (before, after))| before != after);
        let moves = moves.map(|(index, (_, after))| (index, *after)).collect();
        return Some(Operation::MoveBend { channel, moves });
    }
    Some(Operation::Adjust { channel, adjustment: Box::new(to.clone()) })
}

impl Cluster {
    /// A client adjusts a channel.
    pub(super) fn calibrate(
        &mut self,
        now: Micros,
        job: ClientRequest,
        channel: &str,
        changes: &[calibration_change::CalibrationChange],
    ) -> Result<Option<Response>, String> {
        let settled = self.tuners.0.iter().map(|(_, tuner)| tuner);
        let waiting = self.changes.tuners().chain(settled);
        if waiting.filter(|tuner| tuner.job.client == job.client).count() >= TUNERS_MAX {
            return Err(format!(
                "{TUNERS_MAX} tunings of this client are waiting already; await some first"
            ));
        }
        let present = self.changes.latest_wall().unwrap_or(&self.wall);
        let wall = Box::new(calibration_change::apply_changes(present, channel, changes)?);
        check_wall_size(&wall)?;
        self.check_presentation(&wall).map_err(|reason| format!("{channel}: {reason}"))?;
        let tuner = CalibrationWaiter { job, asked_at: self.frame };
        if let Err(wall) = self.changes.replace_waiting_wall(wall, tuner) {
            let purpose = ChangeOrigin::Tuning { wall, tuners: vec![tuner] };
            self.request_change(now, StateChange { operations: Vec::new(), purpose });
        }
        Ok(None)
    }

    /// Lights a point that calibration moves, or none.
    ///
    /// # Errors
    /// There is no such channel, or its bend has no such point.
    pub(super) fn mark_point(&mut self, marker: Option<CalibrationMarker>) -> Result<(), String> {
        if let Some(CalibrationMarker { channel: name, point }) = &marker {
            let Some((_, channel)) = self.wall.channel_by_name(name) else {
                let names: Vec<_> = self.wall.channels.iter().map(|of| of.name.as_str()).collect();
                return Err(format!(
                    "this wall has no channel {name:?}; it has {}",
                    names.join(", ")
                ));
            };
            let points = channel.adjustment.bend.as_ref().map(|bend| bend.points);
            if let MarkedPoint::Bend { column, row } = *point
                && points.is_none_or(|points| column >= points.x || row >= points.y)
            {
                let bend = points.map_or("no bend".to_owned(), |of| format!("{}x{}", of.x, of.y));
                return Err(format!("{name} has no point {column}.{row} of a bend; it has {bend}"));
            }
        }
        self.presentation.marker = marker;
        self.wants_frame = true;
        Ok(())
    }

    /// The state that is shown from the next frame on has a tuned wall. Nothing is loaded for it,
    /// so neither deadline nor warm-up begin anew.
    pub(super) fn commit_calibration(
        &mut self,
        now: Micros,
        wall: Wall,
        tuners: Vec<CalibrationWaiter>,
        failed: &[(SessionId, String)],
    ) {
        let revision = self.shown.revision;
        self.tuned.note(&self.wall, &wall);
        self.wall = wall;
        self.end_densities();
        self.tuners.0.extend(tuners.into_iter().map(|tuner| (revision, tuner)));
        self.wants_frame |= !self.pacer.is_soon(now);
        self.demote_unprepared(now, failed);
        self.persist();
        tracing::debug!(revision = revision.0, "the wall is tuned");
    }

    /// A frame of this state was swapped: who waits for it, or for one before, is told.
    pub(super) fn answer_waiters(&mut self, feedback: &FrameFeedback) {
        let (frame, revision) = (feedback.frame, feedback.revision);
        if revision == self.shown.revision {
            self.changes.note_swap();
        }
        let seen: Vec<_> = self.tuners.0.extract_if(.., |(of, _)| *of <= revision).collect();
        for (revision, tuner) in seen {
            let frames = frame.0.saturating_sub(tuner.asked_at.0);
            let tuned = Tuned { revision, frames, feedback: feedback.clone() };
            self.reply(tuner.job, Ok(Response::Tuned(tuned)));
        }
        self.answer_editors(feedback);
    }
}
