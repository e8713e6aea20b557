//! How a brain begins: afresh, or from what the last manager of its wall remembered.

use polyptych_protocol::blob::BlobFolder;
use polyptych_protocol::ids::Epoch;

use super::ManagerOptions;
use crate::brain::Brain;
use crate::bulk::AllowedBlobs;
use crate::record::Fresh;
use crate::{import, memory};

/// The brain, going on where the last manager of this wall stopped, if there was one and its
/// scene is still in the store.
pub(super) fn begin(options: &mut ManagerOptions, epoch: Epoch, allowed: &AllowedBlobs) -> Brain {
    let (wall, is_navigable) = (options.wall.clone(), options.is_navigable);
    let recorder = options.recorder.take();
    let Some(mut memory) = options.memory.as_deref().and_then(memory::load) else {
        return Brain::new(Fresh { wall, epoch, memory: None, is_navigable }, recorder);
    };
    if let Some(scene) = &memory.scene {
        let folder = BlobFolder::new(options.baker.store.join("blobs"));
        match import::read_manifest(&folder, scene.manifest) {
            Ok(import) => {
                allowed.allow(&import.blobs);
                memory.further.notes = import.scene.summary.notes;
                memory.further.bounds = import.scene.summary.bounds;
            }
            Err(reason) => {
                tracing::warn!(scene = scene.name, reason, "the last scene is not there any more");
                memory.scene = None;
                // A state without it has not been numbered yet.
                memory.revision.0 += 1;
            }
        }
    }
    tracing::info!(revision = %memory.revision, "going on where the last manager stopped");
    Brain::new(Fresh { wall, epoch, memory: Some(memory), is_navigable }, recorder)
}
