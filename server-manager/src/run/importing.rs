//! Scenes that are baked beside the loop of the manager, and what is told of them.

use std::sync::Arc;

use polyptych_core::{ClientRequest, Input};
use polyptych_protocol::progress::{OpenProgress, OpenStage};
use tracing::Instrument;

use super::EventLoop;
use crate::import::{self, Import};

/// How far the bake has come that a client waits for.
pub(super) type Baking = (ClientRequest, OpenProgress);

/// A bake that has ended.
pub(super) struct Imported {
    job: ClientRequest,
    result: Result<Import, String>,
}

impl EventLoop {
    pub(super) fn handle_imported(&mut self, imported: Imported) {
        let job = imported.job;
        let scene = imported.result.map(|import| {
            self.allowed.allow(&import.blobs);
            import.scene
        });
        self.tell(self.now(), Input::Import { job, imported: scene });
    }

    /// Bakes a scene, or finds that it was baked.
    pub(super) fn import(&self, job: ClientRequest, path: String) {
        let roots = self.options.scene_roots.clone();
        let baker = self.options.baker.clone();
        let done = self.imported.0.clone();
        let baking = self.progress.0.clone();
        let turns = Arc::clone(&self.bakes);
        let work = async move {
            // Nobody closes it, so there is always a turn.
            let _turn = turns.acquire().await;
            let tell = |percent| {
                let progress = OpenProgress { stage: OpenStage::Baking, percent };
                // Where the manager is behind, the next one is as good.
                let _ = baking.try_send((job, progress));
            };
            let result = import::import(&path, &roots, &baker, tell).await;
            // The manager may have ended meanwhile.
            let _ = done.send(Imported { job, result }).await;
        };
        tokio::spawn(work.instrument(self.cluster.request_span(job)));
    }
}
