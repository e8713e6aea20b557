//! Invariants of frames, states and channels: an observer that keeps its own books, from the
//! messages alone, and compares.

use std::collections::{BTreeMap, BTreeSet};

use polyptych_files::blob::BlobHash;
use polyptych_protocol::command::{Command, Frame, Prepare, Swap};
use polyptych_protocol::feedback::ChannelState;
use polyptych_protocol::ids::{Digest, Epoch, FrameId, Revision};
use polyptych_protocol::quality_bounds::RESOLUTION_STEPS_MAX;
use polyptych_protocol::server_message::ServerMessage;
use polyptych_protocol::state_log::Operation;
use polyptych_wall::{ChannelId, Wall};

use super::super::change::HOLDS_REFUSED;
use super::super::reduction::RESOLUTION_FROM_PX;
use super::super::{Cluster, FRAME_ORDERS_MAX, Micros, SessionId};
use super::coverage::Coverage;
use super::manager::Manager;
use super::playback::SWAP_SPIN_US;
use super::promise::DurabilityChecker;
use super::server::{DrawnImage, State};
use super::world::Check;

/// Maximum number of outputs of one input: all that waits may settle at once on a wall without
/// servers.
const OUTPUTS_MAX: usize = 3 * 64 + 256;

/// Most changes in the core's queue; its own limit is private to its module.
const CHANGES_MAX: usize = 64;

/// `WARM_UP_FRAMES` of the core, and a few: it does not count what it can't tell to be of the
/// present state.
const WARM_UP_FRAMES: u32 = 3 + 3;

/// A frame as it went over the wires.
#[derive(Debug, Default)]
struct Record {
    revision: Revision,
    is_capture: bool,
    /// Channels that were live when it began, and are since.
    live: BTreeSet<ChannelId>,
    /// Channels whose right report has reached the manager.
    drawn: BTreeSet<ChannelId>,
    failed: BTreeSet<ChannelId>,
    /// Servers that drew something else, and the manager was told.
    disbelieved: BTreeSet<SessionId>,
    /// In manager time.
    not_after_us: Option<Micros>,
}

/// A session as the messages tell.
#[derive(Debug, Default)]
struct Joined {
    owes: Option<Revision>,
    /// The scene of the state that it owes; `obsolete` is owed beside it, though it is not wanted
    /// any more.
    scene: Option<BlobHash>,
    obsolete: Option<Revision>,
    prepared: BTreeSet<Revision>,
}

impl Joined {
    fn has_answered(&mut self, revision: Revision) {
        if self.obsolete.take_if(|obsolete| *obsolete == revision).is_none() {
            self.owes.take_if(|owed| *owed == revision);
        }
    }
}

/// The observer.
#[derive(Debug)]
pub struct InvariantChecker {
    pub epoch: Epoch,
    started: Micros,
    longest_us: Micros,
    frames: BTreeMap<FrameId, Record>,
    last: FrameId,
    pub swapped: FrameId,
    joined: BTreeMap<SessionId, Joined>,
    truths: BTreeMap<(u64, Revision), Digest>,
    /// The last picture of each channel.
    pub shown: BTreeMap<ChannelId, DrawnImage>,
    drawn_since: BTreeMap<ChannelId, u32>,
    last_revision: Revision,
    progress: Micros,
    pub promises: DurabilityChecker,
    /// The manager was killed between an output and the next.
    pub is_cut_short: bool,
    pub shows: u64,
    pub wrong_shows: u64,
    pub feedback_sent: u64,
    pub frames_sent: u64,
    channels: usize,
    /// Begun and swapped.
    brain_frames: (FrameId, FrameId),
}

impl InvariantChecker {
    pub fn new(wall: &Wall) -> Self {
        Self {
            epoch: Epoch(0),
            started: 0,
            longest_us: Micros::from(wall.deadline.max_ms) * 1000,
            frames: BTreeMap::new(),
            last: FrameId(0),
            swapped: FrameId(0),
            joined: BTreeMap::new(),
            truths: BTreeMap::new(),
            shown: BTreeMap::new(),
            drawn_since: BTreeMap::new(),
            last_revision: Revision(0),
            progress: 0,
            promises: DurabilityChecker::default(),
            is_cut_short: false,
            shows: 0,
            wrong_shows: 0,
            feedback_sent: 0,
            frames_sent: 0,
            channels: wall.channels.len(),
            brain_frames: (FrameId(0), FrameId(0)),
        }
    }

    pub fn begin_life(&mut self, epoch: Epoch, started: Micros) {
        self.started = started;
        self.epoch = epoch;
        self.frames.clear();
        (self.last, self.swapped) = (FrameId(0), FrameId(0));
        self.joined.clear();
        self.progress = started;
        self.brain_frames = (FrameId(0), FrameId(0));
    }

    pub fn server_joins(&mut self, session: SessionId, channels: &[ChannelId]) {
        for &channel in channels {
            self.drawn_since.insert(channel, 0);
        }
        // What it was sent while it joined is in the core's outputs still.
        self.joined.insert(session, Joined::default());
    }

    pub fn revision_of(&self, frame: FrameId) -> Option<Revision> {
        self.frames.get(&frame).map(|record| record.revision)
    }

    pub fn was_drawn_wrong(&self, frame: FrameId) -> bool {
        self.frames.get(&frame).is_some_and(|record| !record.disbelieved.is_empty())
    }

    /// A server has folded a state: equal revisions have equal states.
    pub fn folded(&mut self, state: &State) -> Check {
        let truth = state.replica.digest();
        let known = *self.truths.entry((state.epoch.0, state.revision())).or_insert(truth);
        if known != truth {
            return Err(format!("revision {} is two different states", state.revision()));
        }
        Ok(())
    }

    /// A server's report reaches the core.
    pub fn hears(
        &mut self,
        cluster: &Cluster,
        session: SessionId,
        status: &ServerMessage,
        coverage: &mut Coverage,
    ) {
        let Some(joined) = self.joined.get_mut(&session) else { return };
        match status {
            ServerMessage::Prepared(prepared) if prepared.epoch == self.epoch => {
                let truth = self.truths.get(&(self.epoch.0, prepared.revision));
                joined.has_answered(prepared.revision);
                if truth == Some(&prepared.digest) {
                    joined.prepared.insert(prepared.revision);
                } else {
                    coverage.count("prepared with a wrong digest");
                }
            }
            ServerMessage::PrepareFailed { epoch, revision, .. } if *epoch == self.epoch => {
                coverage.count("prepare failed");
                joined.has_answered(*revision);
            }
            ServerMessage::Drawn(drawn) if drawn.epoch == self.epoch => {
                let truth = self.truths.get(&(self.epoch.0, drawn.revision));
                let Some(record) = self.frames.get_mut(&drawn.frame) else { return };
                if truth != Some(&drawn.digest) {
                    coverage.count("drawn with a wrong digest");
                    record.disbelieved.insert(session);
                    // It would draw the present frame as wrong, where that is of the same state.
                    for barrier in cluster.pipeline.iter() {
                        if let Some(record) = self.frames.get_mut(&barrier.frame)
                            && barrier.revision == drawn.revision
                        {
                            record.disbelieved.insert(session);
                        }
                    }
                } else if cluster.registry.owns_channel(session, drawn.channel) {
                    record.drawn.insert(drawn.channel);
                    let is_present = drawn.revision == self.last_revision;
                    *self.drawn_since.entry(drawn.channel).or_default() += u32::from(is_present);
                }
            }
            ServerMessage::DrawFailed { channel, frame, .. } => {
                coverage.count("draw failed");
                if let Some(record) = self.frames.get_mut(frame) {
                    record.failed.insert(*channel);
                }
            }
            _ => {}
        }
    }

    /// The core sends a command to these servers.
    pub fn commanded(
        &mut self,
        now: Micros,
        cluster: &Cluster,
        before: &[ChannelState],
        to: &[SessionId],
        command: &Command,
    ) -> Check {
        match command {
            Command::Prepare(prepare) => self.prepare_sent(cluster, to, prepare),
            Command::Frame(frame) => self.frame_sent(cluster, to, frame),
            Command::Swap(swap) => self.swap_sent(now, cluster, before, to, swap),
            Command::Pong(_) | Command::Goodbye(_) => Ok(()),
        }
    }

    fn prepare_sent(&mut self, cluster: &Cluster, to: &[SessionId], prepare: &Prepare) -> Check {
        let scene = prepare.operations.iter().rev().find_map(|operation| match operation {
            Operation::OpenScene(scene) => Some(Some(scene.manifest)),
            Operation::CloseScene => Some(None),
            Operation::Adjust { .. }
            | Operation::MoveBend { .. }
            | Operation::EditScene(_)
            | Operation::SetEdits(_)
            | Operation::SetEnvironment(_)
            | Operation::SetEffects(_)
            | Operation::SetSeenFrom(_) => None,
            Operation::SetWall(_) => prepare.base.is_none().then_some(None),
        });
        for session in to {
            let Some(joined) = self.joined.get_mut(session) else { continue };
            let scene = scene.unwrap_or(joined.scene);
            if let Some(owed) = joined.owes.replace(prepare.revision) {
                // But for another scene, or a refused change: then it stops, and what it does is of
                // no use.
                let is_refused = cluster.changes.is_refused(cluster.shown.revision, owed);
                let is_useful = scene == joined.scene && !is_refused;
                if is_useful || joined.obsolete.replace(owed).is_some() {
                    return Err(format!(
                        "{session:?} is sent revision {} while it owes {owed}",
                        prepare.revision
                    ));
                }
            }
            joined.scene = scene;
            joined.prepared.remove(&prepare.revision);
            // Servers may forget the others.
            joined.prepared.retain(|revision| *revision <= prepare.shown);
        }
        Ok(())
    }

    fn frame_sent(&mut self, cluster: &Cluster, to: &[SessionId], frame: &Frame) -> Check {
        self.frames_sent += 1;
        if frame.frame <= self.last {
            return Err(format!("frame {} comes after frame {}", frame.frame, self.last));
        }
        self.last = frame.frame;
        let (detail, bounds) = (&frame.detail, &frame.presentation.bounds);
        let is_lowered = detail.resolution_steps > 0;
        let may_be = bounds.rate_fps.is_some() && detail.error_px >= RESOLUTION_FROM_PX;
        if detail.resolution_steps > RESOLUTION_STEPS_MAX || (is_lowered && !may_be) {
            return Err(format!("frame {} has fewer pixels: {detail:?}, {bounds:?}", frame.frame));
        }
        if frame.revision != self.last_revision {
            self.last_revision = frame.revision;
            self.drawn_since.clear();
        }
        for session in to {
            let joined = self.joined.get(session);
            if joined.is_some_and(|joined| !joined.prepared.contains(&frame.revision)) {
                return Err(format!(
                    "{session:?} is sent frame {} of revision {}, which it has not prepared",
                    frame.frame, frame.revision
                ));
            }
        }
        let live = (cluster.registry.channels()).filter(|(_, c)| c.state == ChannelState::Live);
        let record = Record {
            revision: frame.revision,
            is_capture: frame.capture.is_some(),
            live: live.map(|(id, _)| id).collect(),
            ..Record::default()
        };
        self.frames.insert(frame.frame, record);
        Ok(())
    }

    fn swap_sent(
        &mut self,
        now: Micros,
        cluster: &Cluster,
        before: &[ChannelState],
        to: &[SessionId],
        swap: &Swap,
    ) -> Check {
        self.count_frame();
        let frame = swap.frame;
        if frame <= self.swapped {
            return Err(format!("frame {frame} is swapped after frame {}", self.swapped));
        }
        self.swapped = frame;
        let Some(record) = self.frames.get_mut(&frame) else {
            return Err(format!("frame {frame} is swapped, which was never begun"));
        };
        record.not_after_us = Some(swap.not_after_us);
        let lead_us = Micros::from(cluster.wall.sync.swap_lead_ms) * 1000;
        if swap.not_after_us > now - self.started + lead_us + self.longest_us {
            return Err(format!("frame {frame} may be shown for longer than any frame waits"));
        }
        if let Some(session) = to.iter().find(|session| record.disbelieved.contains(session)) {
            return Err(format!("{session:?} is to show frame {frame}, which it drew wrong"));
        }
        for (id, channel) in cluster.registry.channels() {
            let was_live = before.get(usize::from(id.0)) == Some(&ChannelState::Live);
            let is_live = channel.state == ChannelState::Live;
            let was_there = record.live.contains(&id);
            if was_there && was_live && is_live && !record.drawn.contains(&id) {
                return Err(format!(
                    "frame {frame} is swapped, but live channel {id} has not drawn"
                ));
            }
        }
        Ok(())
    }

    /// The core has answered an input whole.
    pub fn settled(
        &mut self,
        now: Micros,
        manager: &Manager,
        cluster: &Cluster,
        outputs: usize,
        coverage: &mut Coverage,
    ) -> Check {
        if outputs > OUTPUTS_MAX {
            return Err(format!("one input made {outputs} outputs"));
        }
        let clients = cluster.clients.len();
        if cluster.orders.len() > FRAME_ORDERS_MAX * clients {
            return Err(format!("{} orders of {clients} clients wait", cluster.orders.len()));
        }
        if cluster.changes.waiting() > CHANGES_MAX {
            return Err(format!("{} changes wait", cluster.changes.waiting()));
        }
        let newest = cluster.pipeline.newest().map(|barrier| barrier.frame);
        if cluster.pipeline.iter().count() > 1 && newest > manager.frames_before.last().copied() {
            coverage.count("frame sent ahead");
        }
        self.check_states(manager, cluster, coverage)?;
        self.check_barrier(manager, cluster)?;
        self.check_progress(now, manager, cluster)
    }

    fn check_states(
        &mut self,
        manager: &Manager,
        cluster: &Cluster,
        coverage: &mut Coverage,
    ) -> Check {
        let is_refused = std::mem::take(&mut self.promises.is_tuning_refused);
        if is_refused {
            coverage.count("tuning refused by a server");
        }
        for ((id, channel), &before) in cluster.registry.channels().zip(&manager.before) {
            if channel.state == before {
                continue;
            }
            coverage.changes[before as usize][channel.state as usize] += 1;
            let under_way: Vec<_> =
                manager.frames_before.iter().filter_map(|frame| self.frames.get(frame)).collect();
            let has_failed = under_way.iter().any(|record| record.failed.contains(&id));
            if is_refused
                && (before, channel.state) == (ChannelState::Live, ChannelState::Preparing)
            {
                coverage.count("given the state anew for a refusal");
                if channel.reason.as_deref() != Some(HOLDS_REFUSED) {
                    return Err(format!(
                        "channel {id} is dark for a refusal: {:?}",
                        channel.reason
                    ));
                }
            }
            if (before, channel.state) == (ChannelState::Live, ChannelState::Late)
                && under_way.first().is_some_and(|r| r.drawn.contains(&id) && !has_failed)
            {
                return Err(format!(
                    "channel {id} is called late, but it drew the first of {:?} in time",
                    manager.frames_before
                ));
            }
            if before == ChannelState::Live {
                for frame in &manager.frames_before {
                    if let Some(record) = self.frames.get_mut(frame) {
                        record.live.remove(&id);
                    }
                }
            }
        }
        Ok(())
    }

    fn check_barrier(&self, manager: &Manager, cluster: &Cluster) -> Check {
        let under_way = cluster.pipeline.iter().count();
        if under_way > 1 + cluster.wall.sync.pipeline_depth as usize {
            return Err(format!("{under_way} frames are on their way"));
        }
        for barrier in cluster.pipeline.iter() {
            let Some(record) = self.frames.get(&barrier.frame) else {
                return Err(format!("frame {} was sent to nobody", barrier.frame));
            };
            if let Some(id) = barrier.pending().iter().find(|id| record.drawn.contains(id)) {
                let frame = barrier.frame;
                return Err(format!("frame {frame} waits for channel {id}, which has drawn"));
            }
            if record.is_capture && under_way > 1 {
                return Err(format!("capture {} has not the wall for itself", barrier.frame));
            }
        }
        if let Some(barrier) = cluster.pipeline.oldest().filter(|oldest| oldest.is_complete()) {
            return Err(format!("frame {} is complete, but not swapped", barrier.frame));
        }
        let Some(barrier) = cluster.pipeline.newest() else { return Ok(()) };
        let Some(record) = self.frames.get(&barrier.frame) else { return Ok(()) };
        if manager.frames_before.contains(&barrier.frame) {
            return Ok(());
        }
        // A new frame waits for as long as the wall's draws ask, or for the reasons that we know,
        // beside the time until its servers may draw.
        let lead_us = Micros::from(cluster.wall.sync.swap_lead_ms) * 1000;
        let wait = barrier.length() - lead_us;
        let is_warming = barrier
            .participants()
            .iter()
            .any(|id| self.drawn_since.get(id).is_none_or(|drawn| *drawn <= WARM_UP_FRAMES));
        let has_live = (cluster.registry.channels()).any(|(_, c)| c.state == ChannelState::Live);
        if wait > self.longest_us
            || (wait > cluster.deadline.length() && !is_warming && has_live && !record.is_capture)
        {
            return Err(format!(
                "frame {} waits {wait} µs for no reason: {:?} drew {:?}",
                barrier.frame,
                barrier.participants(),
                self.drawn_since
            ));
        }
        Ok(())
    }

    fn check_progress(&mut self, now: Micros, manager: &Manager, cluster: &Cluster) -> Check {
        let brain_now = now - self.started;
        let is_wanted = !cluster.orders.is_empty() || cluster.pacer.is_due(brain_now);
        let frames = (cluster.frame, cluster.swapped);
        let has_moved = frames != self.brain_frames;
        if has_moved || (cluster.pipeline.is_empty() && !is_wanted) {
            self.brain_frames = frames;
            self.progress = now;
        }
        let since = self.progress.max(manager.stopped_until);
        let lead_us = Micros::from(cluster.wall.sync.swap_lead_ms) * 1000;
        if now.saturating_sub(since) > self.longest_us + lead_us + 1 {
            return Err(format!("the wall stands still for {} µs", now - since));
        }
        Ok(())
    }

    /// A server presents at `now` of the simulation what its swap stated another instant for, in
    /// manager time, which it knows up to this error.
    pub fn shown_at(
        &self,
        now: Micros,
        epoch: Epoch,
        stated_us: Micros,
        clock_error_us: u32,
    ) -> Check {
        // Like in `shown`, and by how much it may be woken late.
        let slack_us = Micros::from(clock_error_us) + 1_000 + SWAP_SPIN_US;
        let off_us = (now - self.started).abs_diff(stated_us);
        if epoch == self.epoch && off_us > slack_us {
            return Err(format!("a frame is shown {off_us} µs off its instant"));
        }
        Ok(())
    }

    /// A channel has shown a frame, and this is what stood there.
    pub fn shown(
        &mut self,
        now: Micros,
        channel: ChannelId,
        (epoch, frame): (Epoch, FrameId),
        picture: Option<DrawnImage>,
        slack_us: Micros,
    ) -> Check {
        self.shows += 1;
        let Some(picture) = picture.filter(|p| (p.epoch, p.frame) == (epoch, frame)) else {
            return Err(format!("channel {channel} shows frame {frame} but holds {picture:?}"));
        };
        let last = self.shown.insert(channel, picture);
        if let Some(last) = last.filter(|last| last.epoch == epoch && last.frame >= frame) {
            return Err(format!("channel {channel} shows frame {frame} after {}", last.frame));
        }
        if self.truths.get(&(epoch.0, picture.revision)) != Some(&picture.digest) {
            self.wrong_shows += 1;
        }
        if epoch != self.epoch {
            return Ok(());
        }
        let record = self.frames.get(&frame);
        let Some(not_after_us) = record.and_then(|record| record.not_after_us) else {
            return Err(format!("channel {channel} shows frame {frame}, which was not swapped"));
        };
        // Its clock drifts by 50 µs a second at most, for the eight pings it remembers.
        let slack_us = slack_us + 1_000;
        let late_us = (now - self.started).saturating_sub(not_after_us);
        if late_us > slack_us {
            return Err(format!("channel {channel} shows frame {frame} {late_us} µs too late"));
        }
        if record.is_some_and(|record| record.revision != picture.revision) {
            return Err(format!("channel {channel} shows frame {frame} of another revision"));
        }
        Ok(())
    }

    pub fn wall_channels(&self) -> usize {
        self.channels
    }
}
