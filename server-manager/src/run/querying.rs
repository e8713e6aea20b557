//! Questions about the scene, which are answered beside the loop of the manager: frames do not wait
//! for them.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use polyptych_core::{ClientRequest, Input, SessionId};
use polyptych_files::blob::{BlobHash, BlobStore};
use polyptych_protocol::ids::{RequestId, Revision};
use polyptych_protocol::node_query::{NearestQuery, NodeQuery, RayQuery, RegionQuery};
use polyptych_protocol::request::{MessageToClient, RequestError, Response};
use polyptych_protocol::walk_query::WalkQuery;
use polyptych_scene::{FilePlace, NodeId};
use tokio::sync::{Semaphore, mpsc};
use tokio::time::timeout;

use super::EventLoop;
use crate::mesh_walk::MeshWalk;
use crate::nearest_point::nearest;
use crate::ray_cast::cast;
use crate::region_search::find_in_region;
use crate::scene_index::SceneIndex;
use crate::triangle_cache::TriangleCache;
use crate::walk::walk;

/// Maximum number of questions of one client that are being answered.
const QUERIES_MAX: usize = 16;

/// Questions that are answered at a time, and likewise requests of each kind that reads or writes
/// files: cores are left for everything else.
const WORKERS_MAX: usize = 1;

/// Maximum time of a question that looks at many triangles: other questions wait for it. In it, 20
/// million triangles are compared with a sphere, or 800,000 with a prism of 256 corners.
const QUERY_TIME_MAX: Duration = Duration::from_secs(5);

/// Maximum time until the places of followed nodes are read: captures wait for them.
const PLACES_TIME_MAX: Duration = Duration::from_secs(30);

/// A question about the scene.
pub(super) enum Query {
    Nodes(NodeQuery),
    Ray(RayQuery),
    Region(RegionQuery),
    Nearest(NearestQuery),
    Way(WalkQuery),
    Layers,
}

impl Query {
    fn answer(
        &self,
        scene: &SceneIndex,
        triangles: &TriangleCache,
        store: &BlobStore,
        revision: Revision,
    ) -> Result<Response, String> {
        let meshes = || MeshWalk::new(scene, triangles, store, QUERY_TIME_MAX);
        match self {
            Self::Nodes(query) => scene.find(query, revision, |_| Ok(true)).map(Response::Nodes),
            Self::Ray(query) => cast(&meshes(), query, revision).map(Response::Ray),
            Self::Region(query) => find_in_region(&meshes(), query, revision).map(Response::Nodes),
            Self::Nearest(query) => nearest(&meshes(), query, revision).map(Response::Nearest),
            Self::Way(query) => walk(&(&meshes(), revision), query, revision)
                .map(|way| Response::Way(Box::new(way))),
            Self::Layers => Ok(Response::Layers(scene.layers())),
        }
    }
}

/// A finding from beside the loop.
pub(super) enum Found {
    /// The answer to a question.
    Answer(Answered),
    /// Places of nodes in the file of the open scene.
    Places(Placed),
}

/// The answer to a question.
pub(super) struct Answered {
    job: ClientRequest,
    reply: Result<Response, String>,
}

impl Answered {
    pub fn new(job: ClientRequest, reply: Result<Response, String>) -> Self {
        Self { job, reply }
    }
}

/// The questions of clients about the scene, and what is kept to answer them.
pub(super) struct Queries {
    store: BlobStore,
    /// The scene that is open, as far as is known here.
    scene: Option<BlobHash>,
    /// The state that was asked about last.
    index: Arc<Mutex<Option<Arc<SceneIndex>>>>,
    triangles: TriangleCache,
    turns: Arc<Semaphore>,
    /// The turns of saved scenes and sessions.
    pub(super) store_turns: Arc<Semaphore>,
    /// The turns of the scene folders: one on a disk that does not answer delays nothing else.
    pub(super) folder_turns: Arc<Semaphore>,
    open: Vec<ClientRequest>,
    done: (mpsc::Sender<Found>, mpsc::Receiver<Found>),
    /// `true` while places of nodes are being read.
    is_placing: bool,
}

/// The places of nodes in the file of a scene.
type Placed = (BlobHash, Result<Vec<(NodeId, FilePlace)>, String>);

impl Queries {
    pub fn new(store: BlobStore) -> Self {
        Self {
            store,
            scene: None,
            index: Arc::default(),
            triangles: TriangleCache::default(),
            turns: Arc::new(Semaphore::new(WORKERS_MAX)),
            store_turns: Arc::new(Semaphore::new(WORKERS_MAX)),
            folder_turns: Arc::new(Semaphore::new(WORKERS_MAX)),
            open: Vec::new(),
            done: mpsc::channel(16),
            is_placing: false,
        }
    }

    /// Another scene is open, or none: gives what was kept of the one before, which is large.
    /// Questions about it that are being answered end with what they hold of it.
    pub fn follow(&mut self, scene: Option<BlobHash>) -> Option<impl Send + 'static> {
        (self.scene != scene).then(|| {
            self.scene = scene;
            (std::mem::take(&mut self.index), std::mem::take(&mut self.triangles))
        })
    }

    /// The next finding.
    pub async fn found(&mut self) -> Option<Found> {
        self.done.1.recv().await
    }
}

impl EventLoop {
    /// Forgets what questions have read of a scene that is not open any more.
    pub(super) fn follow_scene(&mut self) {
        let scene = self.cluster.shown_scene().map(|(scene, _)| scene.manifest);
        if let Some(kept) = self.queries.follow(scene) {
            // A gibibyte takes its time.
            tokio::task::spawn_blocking(move || drop(kept));
        }
    }

    /// Reads where the scene's file has the nodes whose places the core has to know.
    pub(super) fn place_nodes(&mut self) {
        let nodes = self.cluster.unplaced_nodes();
        if nodes.is_empty() || self.queries.is_placing {
            return;
        }
        let Some((scene, edits)) = self.cluster.shown_scene() else { return };
        let (manifest, edits) = (scene.manifest, edits.clone());
        let (store, index) = (self.queries.store.clone(), Arc::clone(&self.queries.index));
        let done = self.queries.done.0.clone();
        self.queries.is_placing = true;
        tokio::spawn(async move {
            let work = move || {
                let before = index.lock().unwrap_or_else(PoisonError::into_inner).clone();
                let now = SceneIndex::new(before, &store, manifest, edits)?;
                let place = |node| match now.file_place(node) {
                    Some(place) => Ok((node, place)),
                    None => Err(format!("the scene's file has no {node}")),
                };
                nodes.into_iter().map(place).collect()
            };
            let places = timeout(PLACES_TIME_MAX, tokio::task::spawn_blocking(work)).await;
            let places = match places {
                Ok(Ok(places)) => places,
                Ok(Err(error)) => Err(error.to_string()),
                Err(_) => {
                    let limit_s = PLACES_TIME_MAX.as_secs();
                    Err(format!("the scene's file was not read within {limit_s} s"))
                }
            };
            // The manager may have ended meanwhile.
            let _ = done.send(Found::Places((manifest, places))).await;
        });
    }

    /// A client asks about the scene.
    pub(super) fn query(&mut self, client: SessionId, id: RequestId, query: Query) {
        let job = ClientRequest { client, id };
        let open = self.queries.open.iter().filter(|of| of.client == client).count();
        let Some((scene, edits)) = self.cluster.shown_scene().filter(|_| open < QUERIES_MAX) else {
            let reason = if open < QUERIES_MAX {
                "no scene is open; open one first".to_owned()
            } else {
                format!("{QUERIES_MAX} questions of this client are open already; await some first")
            };
            return self.reply_to_query(job, Err(reason));
        };
        let (manifest, edits, revision) =
            (scene.manifest, edits.clone(), self.cluster.scene_revision());
        let (store, index) = (self.queries.store.clone(), Arc::clone(&self.queries.index));
        let triangles = self.queries.triangles.clone();
        let (done, turns) = (self.queries.done.0.clone(), Arc::clone(&self.queries.turns));
        self.queries.open.push(job);
        tokio::spawn(async move {
            // Nobody closes it, so there is always a turn.
            let _turn = turns.acquire().await;
            let work = move || {
                // Taken out, so that it can be changed where it is: nobody else answers meanwhile.
                let before = index.lock().unwrap_or_else(PoisonError::into_inner).take();
                let now = SceneIndex::new(before, &store, manifest, edits)?;
                *index.lock().unwrap_or_else(PoisonError::into_inner) = Some(Arc::clone(&now));
                query.answer(&now, &triangles, &store, revision)
            };
            let reply = tokio::task::spawn_blocking(work).await;
            let reply = reply.unwrap_or_else(|error| Err(error.to_string()));
            // The manager may have ended meanwhile.
            let _ = done.send(Found::Answer(Answered { job, reply })).await;
        });
    }

    /// Answers a request away from the loop, when `turns` has one.
    pub(super) fn answer_beside(
        &mut self,
        job: ClientRequest,
        turns: Arc<Semaphore>,
        work: impl FnOnce() -> Result<Response, String> + Send + 'static,
    ) {
        let done = self.queries.done.0.clone();
        if self.queries.open.iter().filter(|of| of.client == job.client).count() >= QUERIES_MAX {
            let reason = format!(
                "{QUERIES_MAX} questions of this client are open already; await some first"
            );
            return self.reply_to_query(job, Err(reason));
        }
        self.queries.open.push(job);
        tokio::spawn(async move {
            // Nobody closes it, so there is always a turn.
            let _turn = turns.acquire().await;
            let reply = tokio::task::spawn_blocking(work).await;
            let reply = reply.unwrap_or_else(|error| Err(error.to_string()));
            // The manager may have ended meanwhile.
            let _ = done.send(Found::Answer(Answered { job, reply })).await;
        });
    }

    pub(super) fn handle_found(&mut self, found: Found) {
        match found {
            Found::Answer(Answered { job, reply }) => {
                self.queries.open.retain(|of| *of != job);
                self.reply_to_query(job, reply);
            }
            Found::Places((scene, places)) => {
                self.queries.is_placing = false;
                self.tell(self.now(), Input::Places { scene, places });
            }
        }
    }

    fn reply_to_query(&mut self, job: ClientRequest, reply: Result<Response, String>) {
        let reply = reply.map_err(RequestError::new);
        self.answer(job.client, MessageToClient::Reply { id: job.id, reply });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_kept_of_a_scene_goes_with_it() {
        let mut queries = Queries::new(BlobStore::new("none"));
        let [one, other] = [BlobHash::of(b"one"), BlobHash::of(b"other")];
        drop(queries.follow(Some(one)));
        let kept = Arc::downgrade(&queries.index);
        assert!(queries.follow(Some(one)).is_none(), "edits leave the scene the same");
        assert!(kept.upgrade().is_some());
        drop(queries.follow(Some(other)).expect("another scene"));
        assert!(kept.upgrade().is_none());
        assert!(queries.follow(None).is_some() && queries.follow(None).is_none());
    }
}
