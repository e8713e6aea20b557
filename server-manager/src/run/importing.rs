//! Scenes that are baked beside the loop of the manager, and what is told of them.

use std::sync::Arc;
use std::time::Duration;

use polyptych_core::{ClientRequest, ImportedSession, Input, SessionId};
use polyptych_files::blob::{BlobHash, BlobStore};
use polyptych_protocol::environment::EnvironmentSource;
use polyptych_protocol::ids::RequestId;
use polyptych_protocol::progress::{OpenProgress, OpenStage};
use polyptych_protocol::request::{MessageToClient, Request, RequestError};
use polyptych_protocol::saved_scene::SAVED_PREFIX;
use polyptych_protocol::transaction::Transaction;
use tokio::sync::Semaphore;
use tokio_util::sync::CancellationToken;
use tracing::Instrument;

use super::EventLoop;
use super::saving::{NO_STORE, Stores};
use super::transaction_queue::{Ticket, Turn};
use crate::import::{self, Baker, Import, SILENCE_MAX};
use crate::{assets, environment};

/// Maximum number of requests of one client whose files are being baked, or that wait for their
/// turn behind such.
const ASSET_BAKES_MAX: usize = 16;

/// The reason where a transaction has waited for files, and its scene is gone.
const REPLACED: &str = "the scene was replaced while the files of a transaction were read; read \
                        the scene that is open now, and decide anew";

/// A request that waits for a bake, and the progress of that bake.
pub(super) type Baking = (ClientRequest, OpenProgress);

/// Reads a scene that was saved.
async fn open_saved(stores: Option<Stores>, name: String, baker: &Baker) -> Result<Import, String> {
    let stores = stores.ok_or(NO_STORE)?;
    let folder = BlobStore::new(baker.store.join("blobs"));
    let read = move || {
        let mut scene = stores.scenes.load(&name)?.scene;
        scene.scene.name.clone_from(&name);
        import::read_edited(&folder, scene)
            .map_err(|reason| format!("the saved scene {name} is not whole any more: {reason}"))
    };
    let read = tokio::task::spawn_blocking(read).await;
    read.map_err(|error| error.to_string())?
}

/// Bakes in turn until the client's connection is closed: then a baker ends with its future, since
/// the result is for this client alone.
async fn bake_while_connected<T>(
    close: &CancellationToken,
    turns: &Semaphore,
    bake: impl Future<Output = Result<T, String>>,
) -> Result<T, String> {
    let work = async {
        // Nobody closes it, so there is always a turn.
        let _turn = turns.acquire().await;
        bake.await
    };
    let gone = || Err("the client has closed its connection".into());
    close.run_until_cancelled(work).await.unwrap_or_else(gone)
}

/// Does work, and calls `tell` after each `period` until it is done: a client that waits can tell
/// a long queue from a manager that hangs.
async fn tell_while<T>(work: impl Future<Output = T>, period: Duration, tell: impl Fn()) -> T {
    let mut work = std::pin::pin!(work);
    loop {
        match tokio::time::timeout(period, &mut work).await {
            Ok(done) => return done,
            Err(_) => tell(),
        }
    }
}

/// A request whose files were baked.
pub(super) struct BakedRequest {
    job: ClientRequest,
    /// The number of a transaction, which waits for its turn.
    ticket: Option<Ticket>,
    result: Baked,
}

/// A request after its bakes, or the reason why they failed.
pub(super) type Baked = Result<BakedFiles, String>;

/// A request after its bakes.
pub(super) struct BakedFiles {
    /// The request that the core gets instead.
    request: Request,
    /// The blobs that servers may now ask for.
    blobs: Vec<BlobHash>,
    /// The warning of them for the client.
    warning: Option<String>,
}

impl BakedFiles {
    /// A request that brings no files.
    fn none(request: Request) -> Self {
        Self { request, blobs: Vec::new(), warning: None }
    }
}

/// A bake that has ended.
pub(super) struct Imported {
    job: ClientRequest,
    result: Imports,
}

/// The outcome of a bake, by its subject.
enum Imports {
    Scene(Box<Result<Import, String>>),
    /// A session, with the blobs that servers may now ask for.
    Session(Result<(Box<ImportedSession>, Vec<BlobHash>), String>),
}

impl EventLoop {
    pub(super) fn handle_imported(&mut self, imported: Imported) {
        let job = imported.job;
        let input = match imported.result {
            Imports::Scene(result) => {
                let imported = (*result).map(|import| {
                    self.allowed.allow(&import.blobs);
                    import.scene
                });
                Input::Import { job, imported }
            }
            Imports::Session(result) => {
                let session = result.map(|(session, blobs)| {
                    self.allowed.allow(&blobs);
                    session
                });
                Input::Session { job, session }
            }
        };
        self.tell(self.now(), input);
    }

    /// Takes a transaction of a client: bakes the files that it brings, and lets it wait for its
    /// turn. One without files goes at once, unless one that waits changes the same.
    pub(super) fn edit(&mut self, client: SessionId, id: RequestId, mut transaction: Transaction) {
        let job = ClientRequest { client, id };
        let assets = transaction.assets.take();
        if assets.is_none() && !self.transactions.holds(client, &transaction) {
            let request = Request::Edit(transaction);
            return self.tell(self.now(), Input::Request { client, id, request });
        }
        if !self.may_wait(job) {
            return;
        }
        let scene = self.cluster.scene_opened_at();
        let Some(assets) = assets else {
            let held = BakedFiles::none(Request::Edit(transaction.clone()));
            return self.transactions.add_held(job, scene, &transaction, Ok(held));
        };
        let ticket = self.transactions.add_reading(job, scene, &transaction);
        let (roots, baker) = (self.options.scene_roots.clone(), self.options.baker.clone());
        self.bake_request(job, Some(ticket), async move {
            let (transaction, blobs) = assets::bake(transaction, assets, &roots, &baker).await?;
            Ok(BakedFiles { blobs, ..BakedFiles::none(Request::Edit(transaction)) })
        });
    }

    /// Bakes what is to surround scenes; then it is a request as any.
    pub(super) fn bake_environment(
        &mut self,
        client: SessionId,
        id: RequestId,
        source: EnvironmentSource,
    ) {
        let job = ClientRequest { client, id };
        if !self.may_wait(job) {
            return;
        }
        let (roots, baker) = (self.options.scene_roots.clone(), self.options.baker.clone());
        let shown =
            self.cluster.shown_scene().map(|(scene, edits)| (scene.manifest, edits.clone()));
        self.bake_request(job, None, async move {
            let (environment, warning) = environment::bake(source, &roots, &baker, shown).await?;
            let blobs = vec![environment.blob];
            let request = Request::SetEnvironment(EnvironmentSource::Baked(environment));
            Ok(BakedFiles { request, blobs, warning })
        });
    }

    /// Returns whether one more request of a client may wait for files, or behind such; refuses it
    /// if not.
    fn may_wait(&mut self, job: ClientRequest) -> bool {
        let client = job.client;
        let baking = self.asset_bakes.iter().filter(|of| of.client == client).count();
        let is_room = baking + self.transactions.held(client).count() < ASSET_BAKES_MAX;
        if !is_room {
            let reason = format!(
                "files of {ASSET_BAKES_MAX} requests of this client are being read already, or \
                 requests wait behind them; await some first"
            );
            self.refuse(job, reason);
        }
        is_room && self.clients.contains_key(&client)
    }

    /// Bakes the files of a request in their turn.
    fn bake_request(
        &mut self,
        job: ClientRequest,
        ticket: Option<Ticket>,
        bake: impl Future<Output = Baked> + Send + 'static,
    ) {
        let Some(seat) = self.clients.get(&job.client) else { return };
        let close = seat.link.close.clone();
        let baking = self.progress.0.clone();
        self.asset_bakes.push(job);
        let (done, turns) = (self.baked_assets.0.clone(), Arc::clone(&self.bakes));
        let work = async move {
            let tell = || {
                let progress = OpenProgress { stage: OpenStage::Baking, percent: 0 };
                // Where the manager is behind, the next one is as good.
                let _ = baking.try_send((job, progress));
            };
            let bake = bake_while_connected(&close, &turns, bake);
            let result = tell_while(bake, SILENCE_MAX, tell).await;
            // The manager may have ended meanwhile.
            let _ = done.send(BakedRequest { job, ticket, result }).await;
        };
        tokio::spawn(work.instrument(self.cluster.request_span(job)));
    }

    /// Passes on how far a bake has come, to those too that wait behind it. The core knows those of
    /// scenes only.
    pub(super) fn handle_progress(&mut self, (job, progress): Baking) {
        if !self.asset_bakes.contains(&job) {
            return self.tell(self.now(), Input::Progress { job, progress });
        }
        let waiting: Vec<_> =
            std::iter::once(job).chain(self.transactions.held(job.client)).collect();
        for ClientRequest { client, id } in waiting {
            self.answer(client, MessageToClient::Progress { id, progress });
        }
    }

    pub(super) fn handle_baked_assets(&mut self, baked: BakedRequest) {
        let BakedRequest { job, ticket, result } = baked;
        // One of them, where a client gives several the same number.
        if let Some(at) = self.asset_bakes.iter().position(|of| *of == job) {
            self.asset_bakes.remove(at);
        }
        let Some(ticket) = ticket else { return self.request_baked(job, result) };
        self.transactions.set_ready(ticket, result);
        while let Some(Turn { job, scene, ready }) = self.transactions.pop(job.client) {
            let is_there = scene == self.cluster.scene_opened_at();
            let ready = if is_there { ready } else { ready.and(Err(REPLACED.to_owned())) };
            self.request_baked(job, ready);
        }
    }

    /// Asks the core for what a request has come to.
    fn request_baked(&mut self, job: ClientRequest, baked: Baked) {
        let ClientRequest { client, id } = job;
        if !self.clients.contains_key(&client) {
            return;
        }
        match baked {
            Ok(BakedFiles { request, blobs, warning }) => {
                self.allowed.allow(&blobs);
                if let Some(warning) = warning {
                    self.answer(client, MessageToClient::Warning { id, warning });
                }
                self.tell(self.now(), Input::Request { client, id, request });
            }
            Err(reason) => self.refuse(job, reason),
        }
    }

    /// Answers a request with the reason why it is not done.
    pub(super) fn refuse(&mut self, job: ClientRequest, reason: String) {
        let reply = Err(RequestError::new(reason));
        self.answer(job.client, MessageToClient::Reply { id: job.id, reply });
    }

    /// Bakes a scene, or finds that it was baked. A bake goes on if its client is gone, which may
    /// come back and ask for the outcome.
    pub(super) fn import(&self, job: ClientRequest, path: String, scene: Option<String>) {
        let roots = self.options.scene_roots.clone();
        let baker = self.options.baker.clone();
        let done = self.imported.0.clone();
        let baking = self.progress.0.clone();
        let (turns, saved) = (Arc::clone(&self.bakes), self.stores.clone());
        let work = async move {
            let tell = |percent| {
                let progress = OpenProgress { stage: OpenStage::Baking, percent };
                // Where the manager is behind, the next one is as good.
                let _ = baking.try_send((job, progress));
            };
            // Nobody closes it, so there is always a turn.
            let _turn = tell_while(turns.acquire(), SILENCE_MAX, || tell(0)).await;
            let result = match path.strip_prefix(SAVED_PREFIX) {
                Some(_) if scene.is_some() => Err(format!(
                    "{path} is one scene, as it was saved; open it without the name of another"
                )),
                Some(name) => open_saved(saved, name.to_owned(), &baker).await,
                None => import::import((&path, scene.as_deref()), &roots, &baker, tell).await,
            };
            // The manager may have ended meanwhile.
            let result = Imports::Scene(Box::new(result));
            let _ = done.send(Imported { job, result }).await;
        };
        tokio::spawn(work.instrument(self.cluster.request_span(job)));
    }

    /// Reads a session as this wall can show it.
    pub(super) fn read_session(&self, job: ClientRequest, name: String) {
        let (stores, wall) = (self.stores.clone(), self.options.wall.clone());
        let blobs = BlobStore::new(self.options.baker.store.join("blobs"));
        let (done, turns) = (self.imported.0.clone(), Arc::clone(&self.queries.store_turns));
        let work = async move {
            // Nobody closes it, so there is always a turn. What is baked has turns of its own.
            let _turn = turns.acquire().await;
            let read = move || {
                let stored = stores.ok_or(NO_STORE)?.sessions.load(&name)?;
                let (session, blobs) = stored.read(&name, &wall, &blobs)?;
                Ok((Box::new(session), blobs))
            };
            let read = tokio::task::spawn_blocking(read).await;
            let read = read.unwrap_or_else(|error| Err(error.to_string()));
            // The manager may have ended meanwhile.
            let _ = done.send(Imported { job, result: Imports::Session(read) }).await;
        };
        tokio::spawn(work.instrument(self.cluster.request_span(job)));
    }
}

#[cfg(test)]
pub(super) mod tests {
    use std::cell::Cell;

    use glam::{DAffine3, DVec2, DVec3, UVec2};
    use polyptych_core::ImportedScene;
    use polyptych_protocol::framing;
    use polyptych_protocol::ids::{Epoch, Revision};
    use polyptych_protocol::request::SceneSummary;
    use polyptych_protocol::state_log::SceneRef;
    use polyptych_protocol::transaction::AssetSource;
    use polyptych_scene::{Node, NodeId, Scene, SceneFeatures, SceneOutline};
    use polyptych_wall::surface::Plane;
    use polyptych_wall::{Channel, Screen, Surface, Wall};
    use tokio::sync::mpsc;

    use super::*;
    use crate::run::ManagerOptions;
    use crate::session::{ClientHandle, EVENTS_MAX, OutboxReceiver};

    #[tokio::test]
    async fn a_wait_for_a_turn_is_told_of_again_and_again_and_keeps_its_place() {
        let turns = Semaphore::new(1);
        let first = turns.acquire().await.expect("a turn");
        let told = Cell::new(0);
        let tell = || told.set(told.get() + 1);
        let second = tell_while(turns.acquire(), Duration::from_millis(1), tell);
        let others = async {
            while told.get() < 3 {
                tokio::task::yield_now().await;
            }
            assert!(turns.try_acquire().is_err());
            drop(first);
            assert!(turns.try_acquire().is_err(), "it is the second one's");
        };
        let (turn, ()) = tokio::join!(second, others);
        assert!(turn.is_ok());
    }

    #[tokio::test]
    async fn a_bake_ends_and_gives_up_its_turn_once_its_client_is_gone() {
        let (close, turns) = (CancellationToken::new(), Semaphore::new(1));
        let baker = Arc::new(());
        let held = Arc::clone(&baker);
        let bake = async move {
            let never = std::future::pending::<Result<(), String>>().await;
            drop(held);
            never
        };
        let (result, ()) = tokio::join!(bake_while_connected(&close, &turns, bake), async {
            assert_eq!(turns.available_permits(), 0, "it is being baked");
            close.cancel();
        });
        assert!(result.is_err());
        assert_eq!((turns.available_permits(), Arc::strong_count(&baker)), (1, 1));
    }

    /// The loop of a wall whose only display is not there, with a client and an open scene.
    pub(in crate::run) fn start() -> (EventLoop, SessionId, OutboxReceiver) {
        let plane = Plane::upright(DVec3::NEG_Z, DVec2::splat(2.0));
        let size = UVec2::splat(64);
        let screens = vec![Screen::new("front", Surface::Plane(plane), size)];
        let wall = Wall::new("w", screens, vec![Channel::tile("a", 0, UVec2::ZERO, size)]);
        let (program, store) = ("none".into(), "none".into());
        let baker = Baker { program, memory_mib: 1, memory_remedy: "", store };
        let options = ManagerOptions {
            wall,
            token: String::new(),
            keys: None,
            scene_roots: Vec::new(),
            baker,
            memory: None,
            leadership: None,
            is_navigable: false,
            recorder: None,
            metrics: None,
            http: None,
            notifier: None,
        };
        let (events, _) = mpsc::channel(EVENTS_MAX);
        let mut hub = EventLoop::new(options, None, Epoch(1), events).expect("it begins");
        let (link, answers) = ClientHandle::new();
        let welcome = hub.let_client_in(0, "ann".into(), true, link).expect("let in");
        let client = SessionId(welcome.session);
        open(&mut hub, client);
        (hub, client, answers)
    }

    /// Opens a scene of two nodes.
    fn open(hub: &mut EventLoop, client: SessionId) {
        let nodes = vec![Node::default(); 2];
        let outline = Arc::new(SceneOutline::from(&Scene { nodes, ..Scene::default() }));
        let scene = SceneRef { name: "scene".into(), manifest: BlobHash([7; 32]) };
        let summary = SceneSummary {
            name: "scene".into(),
            revision: Revision(0),
            bounds: None,
            triangles: 0,
            features: SceneFeatures::default(),
            notes: Vec::new(),
            exposure: 1.0,
            clips: Vec::new(),
        };
        let imported = Ok(ImportedScene::of_file(scene, summary, outline));
        let job = ClientRequest { client, id: RequestId(0) };
        hub.tell(0, Input::Import { job, imported });
    }

    fn moving(node: u64, x: f64) -> Transaction {
        let mut transaction = Transaction::default();
        transaction.set_transform(NodeId(node), DAffine3::from_translation(DVec3::X * x));
        transaction
    }

    fn with_file(transaction: Transaction) -> Transaction {
        transaction.with_assets(AssetSource::File("none.glb".into()))
    }

    /// Waits for the end of a bake, and takes it for one that has led to this.
    async fn end_bake(hub: &mut EventLoop, transaction: Transaction) {
        let mut baked = hub.baked_assets.1.recv().await.expect("a bake");
        baked.result = Ok(BakedFiles::none(Request::Edit(transaction)));
        hub.handle_baked_assets(baked);
    }

    /// The X coordinate of a node, if it was moved.
    fn place(hub: &EventLoop, node: u64) -> Option<f64> {
        let (_, edits) = hub.cluster.shown_scene()?;
        edits.node(NodeId(node)).and_then(|of| of.local).map(|local| local.translation.x)
    }

    #[tokio::test]
    async fn what_a_client_does_to_a_node_is_done_in_its_order() {
        let (mut hub, client, _answers) = start();
        hub.edit(client, RequestId(1), with_file(moving(0, 1.0)));
        hub.edit(client, RequestId(2), moving(0, 2.0));
        hub.edit(client, RequestId(3), moving(1, 3.0));
        assert_eq!([place(&hub, 0), place(&hub, 1)], [None, Some(3.0)], "another one goes at once");
        end_bake(&mut hub, moving(0, 1.0)).await;
        assert_eq!([place(&hub, 0), place(&hub, 1)], [Some(2.0), Some(3.0)]);
        hub.edit(client, RequestId(4), moving(0, 4.0));
        assert_eq!(place(&hub, 0), Some(4.0), "nothing waits any more");
    }

    #[tokio::test]
    async fn a_transaction_is_for_the_scene_that_was_open_when_it_came() {
        let (mut hub, client, mut answers) = start();
        hub.edit(client, RequestId(1), with_file(moving(0, 1.0)));
        hub.edit(client, RequestId(2), moving(0, 2.0));
        open(&mut hub, client);
        end_bake(&mut hub, moving(0, 1.0)).await;
        assert_eq!(place(&hub, 0), None);
        for id in [1, 2].map(RequestId) {
            let bytes = answers.next().await.expect("an answer");
            match framing::decode(&bytes) {
                Ok(MessageToClient::Reply { id: of, reply: Err(error) }) => {
                    assert_eq!(of, id);
                    assert!(error.reason.starts_with("the scene was replaced while"), "{error:?}");
                }
                other => panic!("{other:?}"),
            }
        }
        hub.edit(client, RequestId(3), moving(0, 3.0));
        assert_eq!(place(&hub, 0), Some(3.0));
    }
}
