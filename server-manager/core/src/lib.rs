//! The core of the wall: what the manager decides, without sockets and without a clock.
//!
//! What arrives goes as an [`Input`] into [`Cluster::handle`], with `now` in microseconds of the
//! manager's time. [`Cluster::poll_effect`] says what is to be done, and [`Cluster::poll_timeout`]
//! when [`Input::Timeout`] is due. This makes every failure a short deterministic test.

mod aggregate;
mod auto_exposure;
mod barrier;
mod calibrate;
mod change;
mod change_queue;
mod checkpoint;
mod clips;
mod counters;
mod deadline;
mod detail;
mod devices;
mod dispatch;
mod environment;
mod follow;
mod frame_request;
mod frame_start_times;
mod head_return;
mod imported_scene;
mod input;
mod light_effects;
pub mod log_limiter;
mod membership;
mod navigate;
mod outcome;
mod pace;
mod persistent_state;
mod pipeline;
mod presentation;
mod progress;
mod rate_bound;
mod reduction;
mod registry;
mod residency;
mod rest;
mod scene_editing;
mod sessions;
mod skew;
mod snapshot;
mod span;
mod statistics;
mod stored_views;
mod supersede;
#[cfg(test)]
mod tests;
mod tours;
mod variants;

use std::collections::{BTreeMap, VecDeque};
use std::num::NonZeroU32;

use barrier::Barrier;
use change_queue::{ChangeQueue, StateChange};
use frame_request::FrameRequest;
use polyptych_protocol::command::{Command, Pong};
use polyptych_protocol::ids::{Digest, Epoch, FrameId, RequestId};
use polyptych_protocol::presentation::Presentation;
use polyptych_protocol::progress::OpenProgress;
use polyptych_protocol::request::{MessageToClient, RequestError, Response};
use polyptych_protocol::server_message::ServerMessage;
use polyptych_protocol::state_log::{Operation, Replica};
use polyptych_protocol::stored_view::StoredView;
use polyptych_wall::{ChannelId, Wall};
use serde::{Deserialize, Serialize};

use crate::log_limiter::LogLimiter;
pub use checkpoint::{Checkpoint, CheckpointOf};
pub use clips::PlayedClips;
pub use counters::{ChannelCounters, Counters, Histogram};
pub use follow::FollowedNode;
pub use imported_scene::{EditedScene, ImportedScene};
pub use input::Input;
use pace::Pacer;
pub use persistent_state::PersistentState;
use pipeline::Pipeline;
use registry::Registry;
pub use scene_editing::EditTarget;
pub use sessions::ImportedSession;
use skew::SkewTracker;
pub use snapshot::Snapshot;
use statistics::StatisticsCollector;
pub use tours::{PlayedTour, TourClock};

/// Microseconds since the manager started.
pub type Micros = u64;

/// One connection, of a server or a client. Numbers are not used twice.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize,
)]
pub struct SessionId(pub u64);

/// Most requests of one client that wait for a frame: they keep a wall busy, and fill no memory.
pub const FRAME_ORDERS_MAX: usize = 64;

/// Longest reason of a server that is kept and passed on: it stands in every status.
const REASON_BYTES_MAX: usize = 1024;

/// A side effect that the core requests. Effects are carried out in order.
#[derive(Clone, Debug, PartialEq)]
pub enum Effect {
    /// Send this to these servers.
    Command {
        /// The control connections.
        to: Vec<SessionId>,
        /// The command to send.
        command: Box<Command>,
    },
    /// Send this to a client.
    Answer {
        /// Its connection.
        to: SessionId,
        /// The message to send.
        answer: MessageToClient,
    },
    /// Bake this scene and come back with [`Input::Import`].
    Import {
        /// The request that asks for it; names the import.
        job: ClientRequest,
        /// The path of the scene's file, as the client gave it.
        path: String,
        /// The scene of the file, as the client gave it.
        scene: Option<String>,
    },
    /// Read this session and come back with [`Input::Session`].
    OpenSession {
        /// The request that asks for it; names the import.
        job: ClientRequest,
        /// The name that the client gave, checked.
        name: String,
    },
    /// Collect the pictures of a frame from these channels, stitch them and answer the client.
    Collect {
        /// The request that asks for it.
        job: ClientRequest,
        /// The frame.
        frame: FrameId,
        /// The side of the squares of pixels that the pictures have the mean light of.
        side: NonZeroU32,
        /// The channels that are sent it, and will send its picture once they have drawn it.
        channels: Vec<ChannelId>,
        /// The others, with the reason.
        missing: Vec<(String, String)>,
    },
    /// Close a connection, telling the peer why.
    Close {
        /// Which.
        session: SessionId,
        /// Why.
        reason: String,
    },
    /// Keep this for the next life of the manager, before anything that follows.
    Remember(Box<PersistentState>),
    /// End the manager.
    Stop,
    /// End all servers, answer this request with what became of them, and end the manager.
    StopServers {
        /// The client's request.
        job: ClientRequest,
    },
}

/// A request and the client that waits for its answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct ClientRequest {
    /// The client's connection.
    pub client: SessionId,
    /// The client's number.
    pub id: RequestId,
}

/// A scene that is being baked.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Importing {
    job: ClientRequest,
    scene: String,
    progress: OpenProgress,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct ClientState {
    name: String,
    is_subscribed: bool,
}

/// The core of the wall.
///
/// All of it can be written down, see [`Checkpoint`].
#[derive(Debug, Serialize, Deserialize)]
pub struct Cluster {
    epoch: Epoch,
    /// The wall as its file describes it.
    file: Wall,
    /// The wall as it is tuned, in the state that frames name.
    wall: Wall,
    /// The keys that were tuned, though some may have the file's value again.
    #[serde(default)]
    tuned: calibrate::TunedChannels,
    /// The state that frames name: live channels can draw it.
    shown: Replica,
    shown_digest: Digest,
    features: Vec<String>,
    /// Notes on what is not drawn of the shown scene.
    #[serde(default)]
    notes: Vec<String>,
    changes: ChangeQueue,
    tuners: calibrate::CalibrationWaiters,
    editing: scene_editing::SceneEditing,
    /// Scenes that are being baked.
    imports: Vec<Importing>,
    #[serde(default)]
    outcomes: outcome::Outcomes,
    registry: Registry,
    clients: BTreeMap<SessionId, ClientState>,
    orders: VecDeque<FrameRequest>,
    pipeline: Pipeline,
    beginnings: frame_start_times::FrameStartTimes,
    /// The last frame that was begun.
    frame: FrameId,
    /// The last frame that was swapped.
    swapped: FrameId,
    /// The presentation that the next frame has.
    presentation: Presentation,
    navigator: navigate::Navigator,
    /// The wall goes on from another manager's state, and no client has asked for a frame yet.
    is_going_on: bool,
    /// A frame that nobody has ordered, for channels that would see none otherwise.
    wants_frame: bool,
    /// Scene time of the last frame that was begun.
    time_s: f64,
    /// By name.
    #[serde(default)]
    stored_views: Vec<StoredView>,
    #[serde(default)]
    tour: Option<PlayedTour>,
    #[serde(default)]
    following: Option<follow::Following>,
    #[serde(default)]
    clips: PlayedClips,
    #[serde(default)]
    rest: rest::Rest,
    pacer: Pacer,
    deadline: deadline::Deadline,
    #[serde(default)]
    rate_bound: rate_bound::RateBound,
    #[serde(default)]
    auto_exposure: auto_exposure::AutoExposure,
    #[serde(default)]
    devices: devices::Devices,
    #[serde(default)]
    residency: residency::Residency,
    /// Pixel densities of the last views and head that frames were bounded for.
    #[serde(skip)]
    densities: Option<detail::Densities>,
    /// The error bound in force and the largest error of the last frame, in pixels.
    #[serde(skip)]
    drawn_error_px: [f64; 2],
    /// Measurements decide nothing, and take more room than all else.
    #[serde(skip)]
    gathered: StatisticsCollector,
    #[serde(skip)]
    present_calls: SkewTracker,
    remembered: Option<PersistentState>,
    remembered_at: Micros,
    #[serde(skip)]
    repetitions: LogLimiter,
    /// Empty whenever the core is written down.
    #[serde(skip)]
    outputs: VecDeque<Effect>,
}

impl Cluster {
    /// The core of this wall, in a new life of the manager.
    pub fn new(wall: Wall, epoch: Epoch) -> Self {
        let mut shown = Replica::default();
        shown.apply(Operation::SetWall(Box::new(wall.clone())));
        let heartbeat_us = Micros::from(wall.heartbeat_ms) * 1000;
        Self {
            epoch,
            shown_digest: shown.digest(),
            shown,
            features: Vec::new(),
            notes: Vec::new(),
            changes: ChangeQueue::default(),
            tuned: calibrate::TunedChannels::default(),
            tuners: calibrate::CalibrationWaiters::default(),
            editing: scene_editing::SceneEditing::default(),
            imports: Vec::new(),
            outcomes: outcome::Outcomes::default(),
            registry: Registry::new(&wall, heartbeat_us),
            clients: BTreeMap::new(),
            orders: VecDeque::new(),
            pipeline: Pipeline::default(),
            beginnings: frame_start_times::FrameStartTimes::default(),
            frame: FrameId(0),
            swapped: FrameId(0),
            presentation: Presentation::new(wall.head()),
            navigator: navigate::Navigator::default(),
            is_going_on: false,
            wants_frame: false,
            time_s: 0.0,
            stored_views: Vec::new(),
            tour: None,
            following: None,
            clips: PlayedClips::default(),
            rest: rest::Rest::default(),
            pacer: Pacer::default(),
            deadline: deadline::Deadline::new(wall.deadline),
            rate_bound: rate_bound::RateBound::default(),
            auto_exposure: auto_exposure::AutoExposure::default(),
            devices: devices::Devices::new(&wall),
            residency: residency::Residency::default(),
            densities: None,
            drawn_error_px: [0.0; 2],
            gathered: StatisticsCollector::new(wall.channels.len()),
            present_calls: SkewTracker::new(wall.channels.len()),
            remembered: None,
            remembered_at: 0,
            repetitions: LogLimiter::default(),
            outputs: VecDeque::new(),
            file: wall.clone(),
            wall,
        }
    }

    /// This life of the manager.
    pub fn epoch(&self) -> Epoch {
        self.epoch
    }

    /// A render server reports.
    pub(crate) fn handle_status(&mut self, now: Micros, from: SessionId, status: ServerMessage) {
        if !self.registry.record_heartbeat(from, now) {
            return;
        }
        let status = truncate_reason(status);
        match status {
            ServerMessage::Prepared(prepared) => self.handle_prepared(now, from, &prepared),
            ServerMessage::PrepareFailed { epoch, revision, reason } => {
                if epoch == self.epoch {
                    self.handle_prepare_failed(now, from, revision, &reason);
                }
            }
            ServerMessage::Drawn(drawn) => self.handle_drawn(now, from, &drawn),
            ServerMessage::DrawFailed { channel, frame, reason } => {
                self.handle_draw_failed(now, from, channel, frame, reason);
            }
            ServerMessage::Shown(shown) => {
                let is_real = shown.epoch == self.epoch && shown.frame <= self.frame;
                if is_real && self.registry.owns_channel(from, shown.channel) {
                    self.registry.shown(&shown);
                    self.gathered.add_shown(&shown);
                    if let Some(compared) = self.present_calls.add(&shown, now) {
                        self.gathered.add_skews(&compared);
                    }
                }
            }
            ServerMessage::Display { channel, warning } => {
                if self.registry.owns_channel(from, channel) {
                    self.registry.set_display_warning(channel, warning);
                }
            }
            ServerMessage::Luminance(of) => self.handle_luminance(now, from, &of),
            ServerMessage::Storage { warning } => self.registry.set_storage_warning(from, warning),
            ServerMessage::StateLost { reason } => self.handle_divergence(now, from, &reason),
            ServerMessage::Navigate(navigation) => self.handle_navigation(now, from, &navigation),
            ServerMessage::Goodbye { reason } => {
                self.close(from, "goodbye".into());
                self.handle_server_gone(now, from, &format!("it left: {reason}"));
            }
            ServerMessage::Ping(ping) => {
                self.registry.set_memory(from, ping.memory_bytes);
                let pong = Pong { sent_us: ping.sent_us, received_us: now, answered_us: now };
                self.command(vec![from], Command::Pong(pong));
            }
        }
    }

    /// A message of this server came at `at`, and waits to be read: it is not silent.
    pub(crate) fn handle_life(&mut self, from: SessionId, at: Micros) {
        let _ = self.registry.record_heartbeat(from, at);
    }

    /// Returns the time at which the next server will have been silent for too long, if ever.
    pub fn next_silence(&self) -> Option<Micros> {
        self.registry.next_heartbeat_timeout()
    }

    /// Returns whether this client wants to hear of every frame, or waits for a scene, a frame or a
    /// tuning.
    pub fn expects_more(&self, client: SessionId) -> bool {
        let jobs = self.imports.iter().map(|import| import.job);
        let jobs = jobs.chain(self.orders.iter().map(|order| order.job));
        let jobs = jobs.chain(self.changes.jobs()).chain(self.tuners.jobs());
        let jobs = jobs.chain(self.editing.jobs());
        let is_subscribed = self.clients.get(&client).is_some_and(|of| of.is_subscribed);
        is_subscribed || jobs.into_iter().any(|job| job.client == client)
    }

    /// Time has passed; see [`Cluster::poll_timeout`].
    pub(crate) fn handle_timeout(&mut self, now: Micros) {
        for session in self.registry.timed_out(now) {
            let reason = format!("silent for more than {} ms", self.wall.heartbeat_ms);
            self.close(session, reason.clone());
            self.handle_server_gone(now, session, &reason);
        }
        let to_retry = self.registry.take_retries(now);
        self.send_due_prepares(to_retry);
        self.expire_change(now);
        self.remember_navigation(now);
        self.meter_at_last(now);
        self.end_temporary_at_last(now);
        self.update_rest(now);
        self.update_head_return(now);
        self.update_residency(now);
        self.advance_frame(now);
    }

    /// Returns the time at which [`Input::Timeout`] is due next, if ever.
    pub fn poll_timeout(&self) -> Option<Micros> {
        let begins = if !self.may_begin() {
            None
        } else if self.is_asked_for_a_frame() {
            Some(0)
        } else {
            self.pacer.next_start()
        };
        [
            begins,
            self.pipeline.oldest().map(Barrier::deadline),
            self.registry.next_heartbeat_timeout(),
            self.registry.next_retry(),
            self.changes.next_expiry(),
            self.navigator.remember_at,
            self.next_metering(),
            self.next_temporary_end(),
            self.next_rest(),
            self.devices.next_head_place(),
            self.next_residency(),
        ]
        .into_iter()
        .flatten()
        .min()
    }

    /// Returns the next effect that is to be carried out.
    pub fn poll_effect(&mut self) -> Option<Effect> {
        self.outputs.pop_front()
    }

    /// Moves the frame on as far as it goes now: ends the present one, begins the next.
    fn advance_frame(&mut self, now: Micros) {
        let is_over = |barrier: &Barrier| barrier.is_complete() || now >= barrier.deadline();
        if self.pipeline.oldest().is_some_and(is_over) {
            self.finish_frame(now);
            // A frame that was drawn ahead of its turn may be shown now.
            if self.pipeline.oldest().is_some_and(Barrier::is_complete) {
                self.finish_frame(now);
            }
            // The next begins once the swap is on its way, which `poll_timeout` asks for at once:
            // its own time then counts from its own command.
            return;
        }
        // One frame begins at most: a wall without channels would otherwise never let go.
        if self.may_begin() && (self.is_asked_for_a_frame() || self.pacer.is_due(now)) {
            self.begin_frame(now);
        }
    }

    fn command(&mut self, to: Vec<SessionId>, command: Command) {
        if !to.is_empty() {
            self.outputs.push_back(Effect::Command { to, command: Box::new(command) });
        }
    }

    fn send_reply(&mut self, to: ClientRequest, reply: Result<Response, RequestError>) {
        let answer = MessageToClient::Reply { id: to.id, reply };
        self.outputs.push_back(Effect::Answer { to: to.client, answer });
    }
}

/// Returns the message with its reason cut to `REASON_BYTES_MAX` bytes: it stands in every status.
pub fn truncate_reason(mut status: ServerMessage) -> ServerMessage {
    if let ServerMessage::PrepareFailed { reason, .. }
    | ServerMessage::DrawFailed { reason, .. }
    | ServerMessage::Display { warning: Some(reason), .. }
    | ServerMessage::Storage { warning: Some(reason) }
    | ServerMessage::StateLost { reason }
    | ServerMessage::Goodbye { reason } = &mut status
    {
        reason.truncate(reason.floor_char_boundary(REASON_BYTES_MAX));
    }
    status
}
