//! Scenes that clients export, beside the loop of the manager.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use polyptych_core::{ClientRequest, EditedScene, SessionId};
use polyptych_files::blob::{BlobStore, CHUNK_BYTES_MAX};
use polyptych_protocol::exported_scene::ExportedScene;
use polyptych_protocol::ids::RequestId;
use polyptych_protocol::progress::{OpenProgress, OpenStage};
use polyptych_protocol::request::{MessageToClient, ReplyChunk, RequestError, Response};
use tracing::Instrument;

use super::EventLoop;
use super::saving::NO_STORE;
use crate::entry_store::EntryStore;
use crate::scene_export;
use crate::session::ClientHandle;
use crate::stored_scene::StoredScene;

/// Maximum number of scenes that are exported at a time: each has a file beside the blobs for as
/// long as its client reads it.
pub(super) const EXPORTS_MAX: usize = 2;

/// A scene that is to be exported.
enum ExportSource {
    Open(EditedScene),
    Saved(Arc<dyn EntryStore<StoredScene>>, String),
}

impl EventLoop {
    /// Writes a scene as a file, and sends it.
    pub(super) fn export(&mut self, client: SessionId, id: RequestId, saved: Option<String>) {
        let job = ClientRequest { client, id };
        let Some(link) = self.clients.get(&client).map(|seat| seat.link.clone()) else { return };
        let source = match (saved, self.stores.clone()) {
            (Some(name), Some(stores)) => Ok(ExportSource::Saved(stores.scenes, name)),
            (Some(_), None) => Err(NO_STORE.to_owned()),
            (None, _) => {
                let open = self.cluster.edited_scene().map(ExportSource::Open);
                open.ok_or_else(|| "no scene is open; open one first".to_owned())
            }
        };
        let turn = Arc::clone(&self.exports).try_acquire_owned().map_err(|_| {
            format!("{EXPORTS_MAX} scenes are being exported already; wait until one is done")
        });
        let (source, turn) = match source.and_then(|source| Ok((source, turn?))) {
            Ok(both) => both,
            Err(reason) => return self.refuse(job, reason),
        };
        let folder = self.options.baker.store.clone();
        let queues = self.turns.queues().clone();
        let work = async move {
            send(source, folder, &link, id).await;
            queues.finish(client, id);
            drop(turn);
        };
        tokio::spawn(work.instrument(self.cluster.request_span(job)));
    }
}

/// Sends a scene in pieces, and the reply behind them.
async fn send(source: ExportSource, folder: PathBuf, link: &ClientHandle, id: RequestId) {
    let progress = link.clone();
    let written = tokio::task::spawn_blocking(move || write(source, &folder, &progress, id)).await;
    let reply = match written.unwrap_or_else(|error| Err(error.to_string())) {
        Ok((about, file)) => send_file(file, link, id).await.map(|()| Response::Exported(about)),
        Err(reason) => Err(reason),
    };
    let reply = reply.map_err(RequestError::new);
    // One that is gone needs no reply.
    let _ = link.pieces.send(polyptych_codec::encode(&MessageToClient::Reply { id, reply })).await;
}

fn write(
    source: ExportSource,
    folder: &Path,
    link: &ClientHandle,
    id: RequestId,
) -> Result<(ExportedScene, impl Read + Send + use<>), String> {
    let scene = match source {
        ExportSource::Open(scene) => scene,
        ExportSource::Saved(store, name) => {
            let mut scene = store.load(&name)?.scene;
            scene.scene.name = name;
            scene
        }
    };
    let mut last = None;
    let mut step = |percent| {
        // Progress may be left out where the client reads slowly.
        if last.replace(percent) != Some(percent) && link.has_room() {
            let progress = OpenProgress { stage: OpenStage::Exporting, percent };
            link.send(polyptych_codec::encode(&MessageToClient::Progress { id, progress }));
        }
        !link.close.is_cancelled() && !link.pieces.is_closed()
    };
    let store = BlobStore::new(folder.join("blobs"));
    scene_export::write(&scene, &store, folder, &mut step)
}

/// Sends all of a file. Waits for the client where it reads slowly: little of it is in memory.
async fn send_file(
    mut file: impl Read + Send + 'static,
    link: &ClientHandle,
    id: RequestId,
) -> Result<(), String> {
    loop {
        let read = tokio::task::spawn_blocking(move || {
            let mut chunk = Vec::with_capacity(CHUNK_BYTES_MAX);
            let read = (&mut file).take(CHUNK_BYTES_MAX as u64).read_to_end(&mut chunk);
            read.map(|_| (file, chunk))
        });
        let read = read.await.map_err(|error| error.to_string())?;
        let (rest, chunk) =
            read.map_err(|error| format!("the file of the export cannot be read: {error}"))?;
        if chunk.is_empty() {
            return Ok(());
        }
        file = rest;
        let chunk = MessageToClient::Chunk(ReplyChunk { id, index: 0, bytes: chunk.into() });
        let sent = link.pieces.send(polyptych_codec::encode(&chunk)).await;
        sent.map_err(|_| "the client is gone".to_owned())?;
    }
}
