//! Gives the core sockets and a clock: accepts connections, carries messages, ends in order.

mod capturing;
mod clients;
mod day_clock;
mod error;
mod exporting;
mod importing;
mod life_signs;
mod metrics_snapshot;
mod network;
mod querying;
mod saving;
mod shutdown;
mod startup;
mod transaction_queue;

use std::collections::BTreeMap;
use std::future::Future;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use clients::{ClientSeat, progress_of, wait_for_news};
pub use error::ManagerError;
use importing::{Baked, BakedRequest, Baking, Imported};
use life_signs::LifeSigns;
use network::Network;
use polyptych_core::log_limiter::LogLimiter;
use polyptych_core::{self, ClientRequest, Effect, Input, Micros, SessionId};
use polyptych_files::blob::BlobStore;
use polyptych_protocol::command::{Command, Goodbye};
use polyptych_protocol::handshake::Welcome;
use polyptych_protocol::ids::Epoch;
use polyptych_protocol::server_message::ServerMessage;
use polyptych_protocol::service_notifier::ServiceNotifier;
use polyptych_wall::Wall;
use querying::Queries;
use tokio::sync::{Semaphore, mpsc};
use tokio::time::Instant;
use transaction_queue::TransactionQueue;

use crate::authenticator::Authenticator;
use crate::bulk::{BlobAllowlist, PictureOf};
use crate::capture::{CaptureBudget, CaptureJob, GeometryCache};
use crate::http::HttpOptions;
use crate::import::Baker;
use crate::leadership::{self, Leadership};
use crate::recorded_cluster::RecordedCluster;
use crate::recorder::Recorder;
use crate::requests::Turns;
use crate::server_session::ServerHandle;
use crate::session::{EVENTS_MAX, Event};
use crate::state_file::keeper::Keeper;
use crate::state_file::{Found, StateFile};
use crate::traffic::Traffic;
use crate::{acceptor, http, metrics};

/// Events that are handled in one turn, before timers are looked at again.
const EVENTS_PER_TURN: usize = 64;

/// Turns of full queues after which the core is told of the time all the same.
const BUSY_TURNS_MAX: u32 = 16;

/// Maximum number of pieces of pictures that wait, each of at most a mebibyte.
const PICTURE_PIECES_MAX: usize = 8;

/// Scenes that are baked at a time: each may take all cores, and the memory that a baker may.
const BAKES_MAX: usize = 2;

/// The options of a manager.
#[derive(Debug)]
pub struct ManagerOptions {
    /// The wall that it drives; its files are baked: [`crate::import::bake_wall_files`].
    pub wall: Wall,
    /// The token that every peer without TLS must know.
    pub token: String,
    /// The manager's folder of keys: with it every connection is TLS, and a certificate stands
    /// for the token.
    pub keys: Option<PathBuf>,
    /// Folders from which scenes may be opened.
    pub scene_roots: Vec<PathBuf>,
    /// The baker of scenes, with the folder of its store.
    pub baker: Baker,
    /// The file in which the open scene and the camera are remembered over a restart; `None` for
    /// a wall that begins afresh each time.
    pub memory: Option<PathBuf>,
    /// The lease of a wall that several managers share: when it is lost, this manager commands and
    /// writes nothing more. `None` for the only manager of a wall.
    pub leadership: Option<Leadership>,
    /// `true` if the mouse over a window of a server moves the wall's camera.
    pub is_navigable: bool,
    /// The recorder of all that the core is told, if there is one.
    pub recorder: Option<Recorder>,
    /// The listener on which metrics are read over HTTP, if there is one.
    pub metrics: Option<std::net::TcpListener>,
    /// The second transport, if there is one.
    pub http: Option<HttpOptions>,
    /// The supervisor that is told that the manager listens, works and ends, if there is one.
    pub notifier: Option<ServiceNotifier>,
}

/// Runs a manager until a client stops it or `shutdown` is ready, and returns which.
///
/// # Errors
/// [`ManagerError`] where it cannot begin.
pub async fn run(
    listener: std::net::TcpListener,
    mut options: ManagerOptions,
    shutdown: impl Future<Output = ()>,
) -> Result<Goodbye, ManagerError> {
    if let Some(file) = options.wall.files.iter().find(|file| file.blob.is_none()) {
        return Err(ManagerError::WallFile(file.path.clone()));
    }
    let keys = options.keys.as_deref().map(startup::load_keys).transpose()?;
    let state = startup::load_state(&options).await?;
    let mut epoch = [0; 8];
    getrandom::fill(&mut epoch).map_err(ManagerError::Random)?;
    listener.set_nonblocking(true).map_err(ManagerError::Listener)?;
    let (events, mut inbox) = mpsc::channel(EVENTS_MAX);
    let epoch = Epoch(u64::from_le_bytes(epoch));
    let metrics = options.metrics.take().map(|at| metrics::start(at, events.clone()));
    let metrics = metrics.transpose().map_err(ManagerError::Metrics)?;
    let http = options.http.take();
    let mut hub = EventLoop::new(options, state, epoch, events)?;
    let wiring = || http::Wiring {
        events: hub.events.clone(),
        queues: hub.turns.queues().clone(),
        token: hub.options.token.clone(),
        keys: keys.clone(),
        wall: Arc::new(hub.options.wall.clone()),
    };
    let http = http.map(|options| http::start(options, wiring()));
    let http = http.transpose().map_err(ManagerError::Http)?;
    let door = acceptor::AcceptContext {
        refusals: acceptor::RejectionLog::new(),
        gate: Authenticator::new(hub.options.token.clone(), keys, &hub.options.wall),
        events: hub.events.clone(),
        pictures: hub.pictures_of_servers.0.clone(),
        queues: hub.turns.queues().clone(),
        heartbeats: hub.life_signs.heartbeats(),
        started: hub.started,
        folder: BlobStore::new(hub.options.baker.store.join("blobs")),
        allowed: hub.allowed.clone(),
        traffic: hub.traffic.clone(),
        welcome: hub.welcome(SessionId(0)),
    };
    let network = Network::start(listener, door).map_err(ManagerError::Listener)?;
    hub.life_signs.ready();
    let leadership = hub.options.leadership.clone();
    let shutdown = leadership::until_lost(leadership.as_ref(), shutdown);
    let goodbye = hub.turn(&mut inbox, shutdown).await;
    hub.life_signs.stopping();
    network.close_door();
    drop(metrics);
    if let Some(reason) = leadership.as_ref().and_then(Leadership::lost_reason) {
        Box::pin(hub.shut_down(&Goodbye::closed(reason))).await;
        return Err(ManagerError::LeaseLost(reason.to_owned()));
    }
    if let Some(Stopping::WithServers(job)) = hub.stopping {
        hub.stop_servers(job, &mut inbox).await;
    }
    hub.settle_answers().await;
    Box::pin(hub.shut_down(&goodbye)).await;
    drop((http, network));
    if let Some(leadership) = leadership {
        leadership.release_after(&goodbye);
    }
    Ok(goodbye)
}

/// The core and what it holds on to.
struct EventLoop {
    options: ManagerOptions,
    cluster: RecordedCluster,
    keeper: Option<Keeper>,
    events: mpsc::Sender<Event>,
    imported: (mpsc::Sender<Imported>, mpsc::Receiver<Imported>),
    baked_assets: (mpsc::Sender<BakedRequest>, mpsc::Receiver<BakedRequest>),
    /// Requests whose files are being baked.
    asset_bakes: Vec<ClientRequest>,
    /// Transactions that wait for such, or behind one that does.
    transactions: TransactionQueue<Baked>,
    /// The progress that bakers report.
    progress: (mpsc::Sender<Baking>, mpsc::Receiver<Baking>),
    queries: Queries,
    stores: Option<saving::Stores>,
    day_clock: day_clock::DayClock,
    /// Exports that may begin.
    exports: Arc<Semaphore>,
    life_signs: LifeSigns,
    allowed: BlobAllowlist,
    traffic: Traffic,
    /// Control bytes of frames in both directions, since the statistics were last reset.
    frame_bytes: u64,
    repetitions: LogLimiter,
    started: Instant,
    next_session: u64,
    servers: BTreeMap<SessionId, ServerHandle>,
    clients: BTreeMap<SessionId, ClientSeat>,
    /// The requests of clients.
    turns: Turns,
    /// Pieces of pictures that servers send.
    pictures_of_servers: (mpsc::Sender<PictureOf>, mpsc::Receiver<PictureOf>),
    /// Turns since the queue of events was last seen empty.
    busy_turns: u32,
    collections: Vec<(Instant, CaptureJob)>,
    pictures: CaptureBudget,
    shapes: GeometryCache,
    bakes: Arc<Semaphore>,
    stopping: Option<Stopping>,
}

/// The processes that a client has asked to stop.
#[derive(Clone, Copy, Debug)]
enum Stopping {
    Manager,
    /// Answered once the servers have ended.
    WithServers(ClientRequest),
}

impl EventLoop {
    fn new(
        mut options: ManagerOptions,
        state: Option<(StateFile, Found)>,
        epoch: Epoch,
        events: mpsc::Sender<Event>,
    ) -> Result<Self, ManagerError> {
        let allowed = BlobAllowlist::default();
        allowed.allow(&options.wall.blobs().collect::<Vec<_>>());
        let blobs = BlobStore::new(options.baker.store.join("blobs"));
        let stores = options.memory.as_deref().map(saving::Stores::beside);
        let life_signs = LifeSigns::new(options.notifier.take());
        let (cluster, state) = startup::start_cluster(&mut options, state, epoch, &allowed)?;
        let keeper = state.map(Keeper::of).transpose().map_err(ManagerError::Thread)?;
        Ok(Self {
            cluster,
            keeper,
            options,
            events,
            imported: mpsc::channel(16),
            baked_assets: mpsc::channel(16),
            asset_bakes: Vec::new(),
            transactions: TransactionQueue::new(),
            progress: mpsc::channel(16),
            queries: Queries::new(blobs.clone()),
            stores,
            day_clock: day_clock::DayClock::default(),
            exports: Arc::new(Semaphore::new(exporting::EXPORTS_MAX)),
            life_signs,
            allowed,
            traffic: Traffic::default(),
            frame_bytes: 0,
            repetitions: LogLimiter::default(),
            started: Instant::now(),
            next_session: 1,
            servers: BTreeMap::new(),
            clients: BTreeMap::new(),
            turns: Turns::default(),
            pictures_of_servers: mpsc::channel(PICTURE_PIECES_MAX),
            busy_turns: 0,
            collections: Vec::new(),
            pictures: CaptureBudget::default(),
            shapes: GeometryCache::new(blobs),
            bakes: Arc::new(Semaphore::new(BAKES_MAX)),
            stopping: None,
        })
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
                Some((from, chunk)) = self.pictures_of_servers.1.recv() => {
                    self.take_picture(from, &chunk);
                }
                Some(imported) = self.imported.1.recv() => self.handle_imported(imported),
                Some(baked) = self.baked_assets.1.recv() => self.handle_baked_assets(baked),
                Some(baking) = self.progress.1.recv() => self.handle_progress(baking),
                Some(found) = self.queries.found() => self.handle_found(found),
                () = progress_of(&mut self.keeper) => {}
                () = wait_for_news(self.turns.queues().clone()) => {}
                () = &mut timer => {}
            }
            // Events come first above; however many there are, a bake that has ended is heard.
            while let Ok(imported) = self.imported.1.try_recv() {
                self.handle_imported(imported);
            }
            self.tell_minute();
            self.pass_time(inbox.is_empty());
            self.finish_collections();
            self.follow_scene();
            self.carry_out();
            self.serve_clients();
            self.place_nodes();
            self.release_answers();
            self.show_life();
            match self.stopping {
                None => {}
                Some(Stopping::Manager) => return Goodbye::Stopped,
                Some(Stopping::WithServers(_)) => return Goodbye::StoppedWithServers,
            }
        }
    }

    /// Tells the core of the time, unless servers have reports waiting: whoever reports in time is
    /// neither late nor silent because the manager was busy.
    fn pass_time(&mut self, is_idle: bool) {
        self.busy_turns = if is_idle { 0 } else { self.busy_turns + 1 };
        let now = self.now();
        let is_due = self.cluster.poll_timeout().is_some_and(|due| due <= now);
        if !is_due || (!is_idle && self.busy_turns < BUSY_TURNS_MAX) {
            return;
        }
        if self.cluster.next_silence().is_some_and(|due| due <= now) {
            let heard = self.servers.iter().map(|(from, link)| (*from, link.heard()));
            for (from, at) in heard.collect::<Vec<_>>() {
                self.tell(now, Input::Heard { from, at });
            }
        }
        self.tell(now, Input::Timeout);
    }

    fn now(&self) -> Micros {
        self.started.elapsed().as_micros() as Micros
    }

    fn wake(&self) -> Instant {
        let due = [self.cluster.poll_timeout(), self.turns.due()].into_iter().flatten().min();
        let due = due.map(|micros| self.started + Duration::from_micros(micros));
        let held = self.keeper.as_ref().and_then(Keeper::due).map(Instant::from_std);
        let capture = self.collections.iter().map(|(expires, _)| *expires).min();
        let an_hour = Instant::now() + Duration::from_hours(1);
        let sign = self.life_signs.due(!self.clients.is_empty());
        let look = self.next_look();
        due.into_iter().chain(held).chain(capture).chain(sign).chain(look).min().unwrap_or(an_hour)
    }

    fn welcome(&self, session: SessionId) -> Welcome {
        Welcome {
            epoch: self.cluster.epoch(),
            term: self.options.leadership.as_ref().map(Leadership::term).unwrap_or_default(),
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
                // The link must be there before the core's first command.
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
                let status = polyptych_core::truncate_reason(status);
                self.note_drawing(from, &status);
                if matches!(status, ServerMessage::Drawn(_) | ServerMessage::Shown(_)) {
                    self.frame_bytes += bytes as u64;
                }
                self.tell(now, Input::Status { from, status });
            }
            Event::ClientJoins { name, is_local, link, verdict } => {
                // Who asked may have given up.
                if let Err(Ok(welcome)) =
                    verdict.send(self.let_client_in(now, name, is_local, link))
                {
                    self.forget(SessionId(welcome.session), "it was gone before it was let in");
                }
            }
            Event::BulkJoins { session, proven, is_known } => {
                let link = self.servers.get_mut(&session);
                let link = link.filter(|link| link.is_of(proven.as_ref()));
                let _ = is_known.send(link.map(ServerHandle::begin_bulk));
            }
            Event::Watched { answer } => {
                // Who asked may have given up.
                let _ = answer.send(self.metrics_snapshot());
            }
            Event::Gone { session, reason } => self.forget(session, &reason),
        }
    }

    /// Returns whether this manager may command; otherwise the loop ends at its next turn.
    fn leads(&self) -> bool {
        self.options.leadership.as_ref().is_none_or(Leadership::is_held)
    }

    /// Returns whether another manager leads instead, as far as the lease can be looked at.
    fn is_replaced(&self) -> bool {
        let leadership = self.options.leadership.as_ref();
        leadership.is_some_and(|of| !of.is_held() && of.lost_reason().is_some())
    }

    /// Tells the core what it cannot refuse.
    fn tell(&mut self, now: Micros, input: Input) {
        // Only servers are refused, where they join.
        let _ = self.cluster.handle(now, input);
    }

    fn forget(&mut self, session: SessionId, reason: &str) {
        let now = self.now();
        if let Some(link) = self.servers.remove(&session) {
            link.close.cancel();
            self.tell(now, Input::ServerGone { session, reason: reason.to_owned() });
            // Where the core has let it go, it does not know them any more.
            for (_, collection) in &mut self.collections {
                collection.mark_missing(&link.channels, reason);
            }
        }
        self.forget_client(now, session, reason);
    }

    /// Does what the core wants done, as long as this manager leads.
    fn carry_out(&mut self) {
        while self.leads()
            && let Some(output) = self.cluster.poll_effect()
        {
            match output {
                Effect::Command { to, command } => {
                    // Once for all of them.
                    let bytes = polyptych_codec::encode(&*command);
                    if matches!(*command, Command::Frame(_) | Command::Swap(_)) {
                        self.frame_bytes += (bytes.len() * to.len()) as u64;
                    }
                    let frame = polyptych_codec::framed(&bytes);
                    for session in to {
                        let Some(link) = self.servers.get(&session) else { continue };
                        self.traffic.control_sent(bytes.len());
                        if !link.send(&frame) {
                            self.forget(session, "it reads too slowly, or not at all");
                        }
                    }
                }
                Effect::Answer { to, answer } => self.answer(to, answer),
                Effect::Import { job, path, scene } => self.import(job, path, scene),
                Effect::OpenSession { job, name } => self.read_session(job, name),
                Effect::Collect { job, frame, side, channels, missing } => {
                    self.begin_collection(job, (frame, side), &channels, missing);
                }
                Effect::Close { session, reason } => {
                    if let Some(link) = self.servers.get(&session) {
                        let goodbye = Command::Goodbye(Goodbye::closed(reason.as_str()));
                        link.send(&polyptych_codec::framed(&polyptych_codec::encode(&goodbye)));
                    }
                    self.forget(session, &reason);
                }
                Effect::Remember(memory) => {
                    if let Some(keeper) = &mut self.keeper {
                        keeper.keep(*memory);
                    }
                }
                Effect::Stop => self.stopping = Some(Stopping::Manager),
                Effect::StopServers { job } => self.stopping = Some(Stopping::WithServers(job)),
            }
        }
    }
}
