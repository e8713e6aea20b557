//! Questions about the scene, which are answered beside the loop of the manager: frames do not wait
//! for them.

use std::sync::{Arc, Mutex, PoisonError};

use polyptych_core::{ClientRequest, SessionId};
use polyptych_files::blob::BlobStore;
use polyptych_protocol::ids::RequestId;
use polyptych_protocol::node_query::{NodeQuery, RayQuery};
use polyptych_protocol::request::{MessageToClient, RequestError, Response};
use tokio::sync::{Semaphore, mpsc};

use super::EventLoop;
use crate::ray_cast::{TriangleCache, cast};
use crate::scene_index::SceneIndex;

/// Most questions of one client that are being answered.
const QUERIES_MAX: usize = 16;

/// Questions that are answered at a time: one core is left for everything else.
const WORKERS_MAX: usize = 1;

/// A question about the scene.
pub(super) enum Query {
    Nodes(NodeQuery),
    Ray(RayQuery),
}

/// The answer to a question.
pub(super) struct Answered {
    job: ClientRequest,
    reply: Result<Response, String>,
}

/// Who asks what of the scene.
pub(super) struct Queries {
    store: BlobStore,
    /// The state that was asked about last.
    index: Arc<Mutex<Option<Arc<SceneIndex>>>>,
    triangles: TriangleCache,
    turns: Arc<Semaphore>,
    open: Vec<ClientRequest>,
    done: (mpsc::Sender<Answered>, mpsc::Receiver<Answered>),
}

impl Queries {
    pub fn new(store: BlobStore) -> Self {
        Self {
            store,
            index: Arc::default(),
            triangles: TriangleCache::default(),
            turns: Arc::new(Semaphore::new(WORKERS_MAX)),
            open: Vec::new(),
            done: mpsc::channel(16),
        }
    }

    /// The next answer.
    pub async fn answered(&mut self) -> Option<Answered> {
        self.done.1.recv().await
    }
}

impl EventLoop {
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
        let (manifest, edits, revision) = (scene.manifest, edits.clone(), self.cluster.revision());
        let (store, index) = (self.queries.store.clone(), Arc::clone(&self.queries.index));
        let triangles = self.queries.triangles.clone();
        let (done, turns) = (self.queries.done.0.clone(), Arc::clone(&self.queries.turns));
        self.queries.open.push(job);
        tokio::spawn(async move {
            // Nobody closes it, so there is always a turn.
            let _turn = turns.acquire().await;
            let work = move || {
                let before = index.lock().unwrap_or_else(PoisonError::into_inner).clone();
                let now = SceneIndex::new(before, &store, manifest, edits)?;
                *index.lock().unwrap_or_else(PoisonError::into_inner) = Some(Arc::clone(&now));
                match query {
                    Query::Nodes(query) => now.find(&query, revision).map(Response::Nodes),
                    Query::Ray(query) => {
                        cast(&now, &triangles, &store, &query, revision).map(Response::Ray)
                    }
                }
            };
            let reply = tokio::task::spawn_blocking(work).await;
            let reply = reply.unwrap_or_else(|error| Err(error.to_string()));
            // The manager may have ended meanwhile.
            let _ = done.send(Answered { job, reply }).await;
        });
    }

    pub(super) fn handle_answered(&mut self, Answered { job, reply }: Answered) {
        self.queries.open.retain(|of| *of != job);
        self.reply_to_query(job, reply);
    }

    fn reply_to_query(&mut self, job: ClientRequest, reply: Result<Response, String>) {
        let reply = reply.map_err(RequestError::new);
        self.answer(job.client, MessageToClient::Reply { id: job.id, reply });
    }
}
