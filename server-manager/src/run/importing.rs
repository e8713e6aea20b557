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
use polyptych_protocol::transaction::{NewAssets, Transaction};
use tokio::sync::Semaphore;
use tokio_util::sync::CancellationToken;
use tracing::Instrument;

use super::EventLoop;
use super::saving::{NO_STORE, Stores};
use crate::import::{self, Baker, Import, SILENCE_MAX};
use crate::{assets, environment};

/// Maximum number of requests of one client whose files are being baked.
const ASSET_BAKES_MAX: usize = 16;

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
    result: Result<BakedFiles, String>,
}

/// A request after its bakes.
struct BakedFiles {
    /// The request that the core gets instead.
    request: Request,
    /// The blobs that servers may now ask for.
    blobs: Vec<BlobHash>,
    /// The warning of them for the client.
    warning: Option<String>,
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

    /// Bakes what a transaction brings; then it is one as any.
    pub(super) fn bake_assets(
        &mut self,
        client: SessionId,
        id: RequestId,
        transaction: Transaction,
        assets: NewAssets,
    ) {
        let (roots, baker) = (self.options.scene_roots.clone(), self.options.baker.clone());
        self.bake_request(ClientRequest { client, id }, async move {
            let (transaction, blobs) = assets::bake(transaction, assets, &roots, &baker).await?;
            Ok(BakedFiles { request: Request::Edit(transaction), blobs, warning: None })
        });
    }

    /// Bakes what is to surround scenes; then it is a request as any.
    pub(super) fn bake_environment(
        &mut self,
        client: SessionId,
        id: RequestId,
        source: EnvironmentSource,
    ) {
        let (roots, baker) = (self.options.scene_roots.clone(), self.options.baker.clone());
        let shown =
            self.cluster.shown_scene().map(|(scene, edits)| (scene.manifest, edits.clone()));
        self.bake_request(ClientRequest { client, id }, async move {
            let (environment, warning) = environment::bake(source, &roots, &baker, shown).await?;
            let blobs = vec![environment.blob];
            let request = Request::SetEnvironment(EnvironmentSource::Baked(environment));
            Ok(BakedFiles { request, blobs, warning })
        });
    }

    /// Bakes the files of a request in their turn.
    fn bake_request(
        &mut self,
        job: ClientRequest,
        bake: impl Future<Output = Result<BakedFiles, String>> + Send + 'static,
    ) {
        if self.asset_bakes.iter().filter(|of| of.client == job.client).count() >= ASSET_BAKES_MAX {
            let reason = format!(
                "files of {ASSET_BAKES_MAX} requests of this client are being read already; await \
                 some first"
            );
            return self.refuse(job, reason);
        }
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
            let _ = done.send(BakedRequest { job, result }).await;
        };
        tokio::spawn(work.instrument(self.cluster.request_span(job)));
    }

    /// Passes on how far a bake has come. The core knows those of scenes only.
    pub(super) fn handle_progress(&mut self, (job, progress): Baking) {
        if self.asset_bakes.contains(&job) {
            self.answer(job.client, MessageToClient::Progress { id: job.id, progress });
        } else {
            self.tell(self.now(), Input::Progress { job, progress });
        }
    }

    pub(super) fn handle_baked_assets(&mut self, baked: BakedRequest) {
        let job = baked.job;
        self.asset_bakes.retain(|of| *of != job);
        if !self.clients.contains_key(&job.client) {
            return;
        }
        match baked.result {
            Ok(BakedFiles { request, blobs, warning }) => {
                self.allowed.allow(&blobs);
                let ClientRequest { client, id } = job;
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
        let (done, turns) = (self.imported.0.clone(), Arc::clone(&self.bakes));
        let work = async move {
            // Nobody closes it, so there is always a turn.
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
mod tests {
    use std::cell::Cell;

    use super::*;

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
}
