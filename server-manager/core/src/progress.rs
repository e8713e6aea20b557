//! Progress of scenes that are being opened: sent to the clients that open them, and in the status.

use std::path::Path;

use polyptych_protocol::progress::{OpenProgress, Opening};
use polyptych_protocol::request::MessageToClient;
use polyptych_wall::limits::NAME_BYTES_MAX;

use super::{ClientRequest, Cluster, Effect};

/// The name by which people know the scene of this file: its stem, cut to [`NAME_BYTES_MAX`] bytes.
pub(super) fn name_of(path: &str) -> String {
    let stem = Path::new(path).file_stem().map(|stem| stem.to_string_lossy().into_owned());
    let mut name = stem.unwrap_or_else(|| path.to_owned());
    name.truncate(name.floor_char_boundary(NAME_BYTES_MAX));
    name
}

impl Cluster {
    /// The baker has come so far with a scene.
    pub(crate) fn handle_progress(&mut self, job: ClientRequest, progress: OpenProgress) {
        let Some(import) = self.imports.iter_mut().find(|import| import.job == job) else {
            return;
        };
        import.progress = progress;
        self.send_progress(job, progress);
    }

    /// Tells the client whose scene servers prepare how many channels are ready for it.
    pub(super) fn tell_preparing(&mut self) {
        let Some((job, Opening { progress, .. })) = self.preparing() else { return };
        if self.changes.is_news(progress.percent) {
            self.send_progress(job, progress);
        }
    }

    /// Returns the scenes that are being opened, the one that comes first before the others.
    pub(super) fn openings(&self) -> Vec<Opening> {
        let waiting = self.changes.waiting_scenes();
        let waiting = waiting.map(|scene| Opening { scene, progress: OpenProgress::NONE });
        let baking = self
            .imports
            .iter()
            .map(|import| Opening { scene: import.scene.clone(), progress: import.progress });
        self.preparing()
            .map(|(_, opening)| opening)
            .into_iter()
            .chain(waiting)
            .chain(baking)
            .collect()
    }

    fn send_progress(&mut self, job: ClientRequest, progress: OpenProgress) {
        let to = self.outcomes.heir(job);
        if self.clients.contains_key(&to.client) {
            let answer = MessageToClient::Progress { id: to.id, progress };
            self.outputs.push_back(Effect::Answer { to: to.client, answer });
        }
    }
}
