//! Gives the brain sockets and a clock: accepts connections, carries messages, ends in order.

mod beginning;
mod ending;
mod importing;
mod sample;

use std::collections::BTreeMap;
use std::future::Future;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use polyptych_protocol::blob::BlobFolder;
use polyptych_protocol::codec;
use polyptych_protocol::command::{Command, Goodbye};
use polyptych_protocol::handshake::Welcome;
use polyptych_protocol::identity::Identity;
use polyptych_protocol::ids::Epoch;
use polyptych_protocol::keys::{Keys, KeysError};
use polyptych_protocol::request::{Answer, Failure};
use polyptych_protocol::status::Status;
use polyptych_protocol::wall::Wall;
use tokio::net::TcpListener;
use tokio::sync::{Semaphore, mpsc};
use tokio::time::Instant;

use crate::brain::Brain;
use crate::bulk::AllowedBlobs;
use crate::capture::{Collection, PictureMemory, WallShapes};
use crate::cluster::{self, Input, Micros, Output, RequestOf, SessionId};
use crate::delivery;
use crate::door;
use crate::gate::Gate;
use crate::import::Baker;
use crate::memory::{self, StateFile};
use crate::metrics;
use crate::record::Recorder;
use crate::repetition::Repetitions;
use crate::server_session::ServerLink;
use crate::session::{EVENTS_MAX, Event, Link};
use crate::traffic::Traffic;
use importing::{Baking, Imported};

/// Events that are handled in one turn, before timers are looked at again.
const EVENTS_PER_TURN: usize = 64;

/// How long a capture waits for its pictures, once the frame was swapped.
const CAPTURE_TIME_MAX: Duration = Duration::from_secs(30);

/// Scenes that are baked at a time: each may take all cores, and the memory that a baker may.
const BAKES_MAX: usize = 2;

/// Most clients at a time: control desks, dashboards and scripts of the largest wall. Each may
/// hold an outbox full of answers.
const CLIENTS_MAX: usize = 256;

/// What a manager needs.
#[derive(Debug)]
pub struct ManagerOptions {
    /// The wall that it drives; its files are baked: [`crate::import::bake_wall_files`].
    pub wall: Wall,
    /// What every peer must know that comes in the clear.
    pub token: String,
    /// The manager's folder of keys: with it every connection is TLS, and a certificate stands
    /// for the token.
    pub keys: Option<PathBuf>,
    /// Folders from which scenes may be opened.
    pub scene_roots: Vec<PathBuf>,
    /// How scenes are baked, and where to.
    pub baker: Baker,
    /// The file in which the open scene and the camera are remembered over a restart; `None` for
    /// a wall that begins afresh each time.
    pub memory: Option<PathBuf>,
    /// Whether the mouse over a window of a server moves the wall's camera.
    pub is_navigable: bool,
    /// Where all that the brain is told is recorded, if anywhere.
    pub recorder: Option<Recorder>,
    /// Where metrics are read over HTTP, if anywhere.
    pub metrics: Option<std::net::TcpListener>,
}

/// Why a manager could not run.
#[derive(Debug, thiserror::Error)]
pub enum ManagerError {
    /// The system gave no random number for the epoch.
    #[error("the system gives no random numbers: {0}")]
    Random(getrandom::Error),
    /// Its keys are not to be used.
    #[error(transparent)]
    Keys(#[from] KeysError),
    /// A file of its wall was not baked.
    #[error("the wall's file {0} was not baked")]
    WallFile(String),
    /// What it would remember in is another's.
    #[error("{0}")]
    State(String),
    /// The listening socket failed.
    #[error("the listening socket failed: {0}")]
    Listener(std::io::Error),
    /// The metrics could not be offered.
    #[error("the metrics cannot be offered: {0}")]
    Metrics(std::io::Error),
}

/// Runs a manager until a client stops it or `shutdown` is ready.
///
/// # Errors
/// [`ManagerError`] where it cannot begin.
pub async fn run(
    listener: std::net::TcpListener,
    mut options: ManagerOptions,
    shutdown: impl Future<Output = ()>,
) -> Result<(), ManagerError> {
    if let Some(path) = &options.memory {
        memory::check(path).map_err(ManagerError::State)?;
    }
    if let Some(file) = options.wall.files.iter().find(|file| file.blob.is_none()) {
        return Err(ManagerError::WallFile(file.path.clone()));
    }
    let keys = options.keys.as_deref().map(load_keys).transpose()?;
    let mut epoch = [0; 8];
    getrandom::fill(&mut epoch).map_err(ManagerError::Random)?;
    listener.set_nonblocking(true).map_err(ManagerError::Listener)?;
    let listener = TcpListener::from_std(listener).map_err(ManagerError::Listener)?;
    let (events, mut inbox) = mpsc::channel(EVENTS_MAX);
    let epoch = Epoch(u64::from_le_bytes(epoch));
    let metrics = options.metrics.take().map(|at| metrics::start(at, events.clone()));
    let metrics = metrics.transpose().map_err(ManagerError::Metrics)?;
    let mut hub = Hub::new(options, epoch, events);
    let door = door::Door {
        refusals: door::Refusals::new(),
        gate: Gate::new(hub.options.token.clone(), keys, &hub.options.wall),
        events: hub.events.clone(),
        folder: BlobFolder::new(hub.options.baker.store.join("blobs")),
        allowed: hub.allowed.clone(),
        traffic: hub.traffic.clone(),
        welcome: hub.welcome(SessionId(0)),
    };
    let accepting = tokio::spawn(door::accept(listener, door));
    let goodbye = hub.turn(&mut inbox, shutdown).await;
    accepting.abort();
    drop(metrics);
    if let Some(Stopping::WithServers(job)) = hub.stopping {
        hub.stop_servers(job, &mut inbox).await;
    }
    hub.say_goodbye(&goodbye).await;
    Ok(())
}

/// The manager's own keys, fit for use now.
fn load_keys(folder: &Path) -> Result<Keys, KeysError> {
    let keys = Keys::load(folder)?;
    keys.require(&Identity::Manager)?;
    for warning in keys.warnings() {
        tracing::warn!("{warning}");
    }
    Ok(keys)
}

/// The brain and what it holds on to.
struct Hub {
    options: ManagerOptions,
    cluster: Brain,
    state: Option<StateFile>,
    events: mpsc::Sender<Event>,
    imported: (mpsc::Sender<Imported>, mpsc::Receiver<Imported>),
    /// What bakers say of their progress.
    progress: (mpsc::Sender<Baking>, mpsc::Receiver<Baking>),
    allowed: AllowedBlobs,
    traffic: Traffic,
    repetitions: Repetitions,
    started: Instant,
    next_session: u64,
    servers: BTreeMap<SessionId, ServerLink>,
    clients: BTreeMap<SessionId, Link>,
    collections: Vec<(Instant, Collection)>,
    pictures: PictureMemory,
    shapes: WallShapes,
    bakes: Arc<Semaphore>,
    stopping: Option<Stopping>,
}

/// What a client has stopped.
#[derive(Clone, Copy, Debug)]
enum Stopping {
    Manager,
    /// Answered once the servers have ended.
    WithServers(RequestOf),
}

impl Hub {
    fn new(mut options: ManagerOptions, epoch: Epoch, events: mpsc::Sender<Event>) -> Self {
        let allowed = AllowedBlobs::default();
        allowed.allow(&options.wall.blobs().collect::<Vec<_>>());
        let blobs = BlobFolder::new(options.baker.store.join("blobs"));
        let (cluster, state) = beginning::begin(&mut options, epoch, &allowed);
        Self {
            cluster,
            state,
            options,
            events,
            imported: mpsc::channel(16),
            progress: mpsc::channel(16),
            allowed,
            traffic: Traffic::default(),
            repetitions: Repetitions::default(),
            started: Instant::now(),
            next_session: 1,
            servers: BTreeMap::new(),
            clients: BTreeMap::new(),
            collections: Vec::new(),
            pictures: PictureMemory::default(),
            shapes: WallShapes::new(blobs),
            bakes: Arc::new(Semaphore::new(BAKES_MAX)),
            stopping: None,
        }
    }

    /// The loop of the manager. Returns why it ended.
    async fn turn(
        &mut self,
        inbox: &mut mpsc::Receiver<Event>,
        shutdown: impl Future<Output = ()>,
    ) -> Goodbye {
        tokio::pin!(shutdown);
        let timer = tokio::time::sleep_until(self.wake());
        tokio::pin!(timer);
        let mut waiting = Vec::with_capacity(EVENTS_PER_TURN);
        loop {
            // Moving a timer costs more than a turn for nothing, and every report of a frame moves
            // the time to wake at: so it is only brought forward, or set anew once it has rung.
            let wake = self.wake();
            if wake < timer.deadline() || timer.is_elapsed() {
                timer.as_mut().reset(wake);
            }
            tokio::select! {
                biased;
                () = &mut shutdown => return Goodbye::Ended,
                // The reports of a frame come together; a turn for each would cost more than
                // they do.
                _ = inbox.recv_many(&mut waiting, EVENTS_PER_TURN) => {
                    for event in waiting.drain(..) {
                        self.handle(event);
                        self.carry_out();
                    }
                }
                Some(imported) = self.imported.1.recv() => self.handle_imported(imported),
                Some((job, progress)) = self.progress.1.recv() => {
                    self.tell(self.now(), Input::Progress { job, progress });
                }
                () = &mut timer => {}
            }
            // Events come first above; however many there are, a bake that has ended is heard.
            while let Ok(imported) = self.imported.1.try_recv() {
                self.handle_imported(imported);
            }
            let now = self.now();
            if self.cluster.poll_timeout().is_some_and(|due| due <= now) {
                self.tell(now, Input::Timeout);
            }
            self.finish_collections();
            self.carry_out();
            match self.stopping {
                None => {}
                Some(Stopping::Manager) => return Goodbye::Stopped,
                Some(Stopping::WithServers(_)) => return Goodbye::StoppedWithServers,
            }
        }
    }

    fn now(&self) -> Micros {
        self.started.elapsed().as_micros() as Micros
    }

    fn wake(&self) -> Instant {
        let due = self.cluster.poll_timeout();
        let due = due.map(|micros| self.started + Duration::from_micros(micros));
        let capture = self.collections.iter().map(|(expires, _)| *expires).min();
        let an_hour = Instant::now() + Duration::from_hours(1);
        due.into_iter().chain(capture).min().unwrap_or(an_hour)
    }

    fn welcome(&self, session: SessionId) -> Welcome {
        Welcome {
            epoch: self.cluster.epoch(),
            session: session.0,
            wall: self.options.wall.name.clone(),
            heartbeat_ms: self.options.wall.heartbeat_ms,
        }
    }

    fn new_session(&mut self) -> SessionId {
        self.next_session += 1;
        SessionId(self.next_session)
    }

    fn handle(&mut self, event: Event) {
        let now = self.now();
        match event {
            Event::ServerJoins { hello, address, link, verdict } => {
                let session = self.new_session();
                // The link must be there before the brain's first command.
                self.servers.insert(session, link);
                let input = Input::Server { session, hello, address };
                let joined = self.cluster.handle(now, input);
                match (&joined, self.servers.get_mut(&session)) {
                    (Ok(()), Some(link)) => link.channels = self.cluster.channels_of(session),
                    _ => drop(self.servers.remove(&session)),
                }
                let _ = verdict.send(joined.map(|()| self.welcome(session)));
            }
            Event::ServerSays { from, status, bytes } => {
                self.traffic.control_received(bytes);
                let status = cluster::shortened(status);
                self.note_drawing(from, &status);
                let wire_bytes = bytes as u32;
                self.tell(now, Input::Status { from, status, wire_bytes });
            }
            Event::ClientJoins { name, link, verdict } => {
                if self.clients.len() >= CLIENTS_MAX {
                    let reason = format!("{CLIENTS_MAX} clients are connected, and no more may be");
                    let _ = verdict.send(Err(reason));
                    return;
                }
                let session = self.new_session();
                self.clients.insert(session, link);
                self.tell(now, Input::Client { session, name });
                let _ = verdict.send(Ok(self.welcome(session)));
            }
            Event::ClientAsks { from, id, request } => {
                self.tell(now, Input::Request { client: from, id, request });
            }
            Event::BulkJoins { session, proven, is_known } => {
                let link = self.servers.get_mut(&session);
                let link = link.filter(|link| link.is_of(proven.as_ref()));
                let _ = is_known.send(link.map(ServerLink::begin_bulk));
            }
            Event::PictureComes { from, chunk } => {
                if !self.cluster.channels_of(from).contains(&chunk.channel) {
                    let what = format!("session {}: picture", from.0);
                    if let Some(times) = self.repetitions.note(now, &what) {
                        let tell = || tracing::warn!(times, "a picture of another's channel");
                        self.cluster.span_of(from).in_scope(tell);
                    }
                    return;
                }
                for (_, collection) in &mut self.collections {
                    if let Err(reason) = collection.add(&chunk) {
                        let what = format!("session {}: a picture does not fit", from.0);
                        if let Some(times) = self.repetitions.note(now, &what) {
                            let tell = || tracing::warn!(reason, times, "a picture does not fit");
                            self.cluster.span_of(from).in_scope(tell);
                        }
                        collection.give_up_on(&[chunk.channel], &reason);
                    }
                }
            }
            Event::Watched { answer } => {
                // Who asked may have given up.
                let _ = answer.send(self.sample());
            }
            Event::Gone { session, reason } => self.forget(session, &reason),
        }
    }

    /// Tells the brain what it cannot refuse.
    fn tell(&mut self, now: Micros, input: Input) {
        // Only servers are refused, where they join.
        let _ = self.cluster.handle(now, input);
    }

    /// Captures hear which channels have drawn what, or could not.
    fn note_drawing(&mut self, from: SessionId, status: &Status) {
        if self.collections.is_empty() {
            return;
        }
        let channels = self.cluster.channels_of(from);
        for (_, collection) in &mut self.collections {
            match status {
                Status::Drawn(drawn) if channels.contains(&drawn.channel) => {
                    collection.note_drawn(drawn.channel, drawn.frame);
                }
                Status::DrawFailed { channel, frame, reason }
                    if channels.contains(channel) && *frame == collection.frame =>
                {
                    collection.give_up_on(&[*channel], reason);
                }
                _ => {}
            }
        }
    }

    fn forget(&mut self, session: SessionId, reason: &str) {
        let now = self.now();
        if let Some(link) = self.servers.remove(&session) {
            link.close.cancel();
            self.tell(now, Input::ServerGone { session, reason: reason.to_owned() });
            // Where the brain has let it go, it does not know them any more.
            for (_, collection) in &mut self.collections {
                collection.give_up_on(&link.channels, reason);
            }
        }
        if let Some(link) = self.clients.remove(&session) {
            let tell = || tracing::info!(reason, "client leaves");
            self.cluster.span_of(session).in_scope(tell);
            link.close.cancel();
            self.tell(now, Input::ClientGone { session });
        }
    }

    /// Does what the brain wants done.
    fn carry_out(&mut self) {
        while let Some(output) = self.cluster.poll_output() {
            match output {
                Output::Command { to, bytes } => {
                    let frame = codec::framed(&bytes);
                    for session in to {
                        let Some(link) = self.servers.get(&session) else { continue };
                        self.traffic.control_sent(bytes.len());
                        if !link.send(&frame) {
                            self.forget(session, "it reads too slowly, or not at all");
                        }
                    }
                }
                Output::Answer { to, answer } => self.answer(to, &answer),
                Output::Import { job, path } => self.import(job, path),
                Output::Collect { job, frame, channels, missing } => {
                    // As it is tuned now: that is what the frame shows.
                    let wall = self.cluster.wall();
                    let room = self.pictures.room_for(wall);
                    match room {
                        Ok(room) => {
                            let wall = (wall, &self.shapes);
                            let collection =
                                Collection::new(job, frame, &channels, missing, wall, room);
                            let expires = Instant::now() + CAPTURE_TIME_MAX;
                            self.collections.push((expires, collection));
                            self.finish_collections();
                        }
                        Err(reason) => {
                            let reply = Err(Failure::new(reason));
                            self.answer(job.client, &Answer::Reply { id: job.id, reply });
                        }
                    }
                }
                Output::Close { session, reason } => {
                    if let Some(link) = self.servers.get(&session) {
                        let goodbye = Command::Goodbye(Goodbye::closed(reason.as_str()));
                        link.send(&codec::framed(&codec::encode(&goodbye)));
                    }
                    self.forget(session, &reason);
                }
                Output::Remember(memory) => {
                    if let Some(state) = &self.state
                        && let Err(error) = state.save(&memory)
                    {
                        let path = state.path().display();
                        tracing::warn!(%path, %error, "cannot remember the state");
                    }
                }
                Output::Stop => self.stopping = Some(Stopping::Manager),
                Output::StopServers { job } => self.stopping = Some(Stopping::WithServers(job)),
            }
        }
    }

    fn answer(&mut self, to: SessionId, answer: &Answer) {
        let Some(link) = self.clients.get(&to) else { return };
        if link.outbox.try_send(codec::encode(answer)).is_err() {
            // Feedback and progress that nobody reads may be lost; an answer may not.
            if !matches!(answer, Answer::Feedback(_) | Answer::Progress { .. }) {
                let reason = "it does not read its answers";
                // Behind them, for one that reads on after all.
                let goodbye = Answer::Goodbye(Goodbye::closed(reason));
                let _ = link.pieces.try_send(codec::encode(&goodbye));
                self.forget(to, reason);
            }
        }
    }

    fn finish_collections(&mut self) {
        let now = Instant::now();
        for (expires, collection) in &mut self.collections {
            if *expires <= now {
                collection.expire();
            }
        }
        let finished = self.collections.extract_if(.., |(_, collection)| collection.is_complete());
        for (_, collection) in finished {
            let Some(link) = self.clients.get(&collection.job.client) else { continue };
            tokio::spawn(delivery::send_pictures(collection, link.clone()));
        }
    }
}
