//! The start of a core: afresh, or from the state that the last manager of its wall persisted.

use polyptych_core::PersistentState;
use polyptych_files::blob::BlobStore;
use polyptych_protocol::ids::Epoch;
use polyptych_scene::SceneEdits;

use super::ManagerOptions;
use crate::bulk::BlobAllowlist;
use crate::recorded_cluster::RecordedCluster;
use crate::recorder::ClusterConfig;
use crate::state_file::{Reconciled, StateFile};
use crate::{import, state_file};

/// Maximum number of changed keys that are logged one by one.
const CHANGES_LOGGED_MAX: usize = 32;

/// The core, going on where the last manager of this wall stopped, if there was one and its
/// scene is still in the store; and the file in which its state is kept.
pub(super) fn start_cluster(
    options: &mut ManagerOptions,
    epoch: Epoch,
    allowed: &BlobAllowlist,
) -> (RecordedCluster, Option<StateFile>) {
    let (wall, is_navigable) = (options.wall.clone(), options.is_navigable);
    let recorder = options.recorder.take();
    let fence = options.leadership.clone();
    let state = options.memory.clone();
    let state = state.map(|path| StateFile::new(path, &wall).with_fence(fence));
    if let Some(state) = &state {
        state.remove_abandoned();
    }
    let saved = state.as_ref().and_then(|state| state_file::load(state.path()));
    let (Some(state), Some(saved)) = (&state, saved) else {
        if let Some(state) = state.as_ref().filter(|state| state.path().exists()) {
            keep_copy(state);
        }
        return (
            RecordedCluster::new(
                ClusterConfig { wall, epoch, memory: None, outline: None, is_navigable },
                recorder,
            ),
            state,
        );
    };
    let reconciled = state_file::reconcile(saved, &wall);
    log(&reconciled);
    let (has_changed, mut has_dropped) = (reconciled.has_changed(), reconciled.has_dropped());
    let (mut memory, mut outline) = (reconciled.memory, None);
    if let Some(scene) = &memory.scene {
        let folder = BlobStore::new(options.baker.store.join("blobs"));
        match import::read_manifest(&folder, scene.manifest) {
            Ok(import) => {
                allowed.allow(&import.blobs);
                if let Err(reason) = allow_assets(&memory, &folder, allowed) {
                    tracing::warn!(reason, "what was edited of the scene is forgotten");
                    memory.edits = SceneEdits::default();
                    memory.revision.0 += 1;
                    has_dropped = true;
                }
                outline = Some(import.scene.outline);
                memory.notes = import.scene.summary.notes;
                memory.bounds = import.scene.summary.bounds;
            }
            Err(reason) => {
                tracing::warn!(scene = scene.name, reason, "the last scene is not there any more");
                memory.scene = None;
                has_dropped = true;
                // A state without it has not been numbered yet.
                memory.revision.0 += 1;
            }
        }
    }
    let blobs = BlobStore::new(options.baker.store.join("blobs"));
    // Reading it removes a damaged one.
    let is_whole = |blob| matches!(blobs.read(blob), Ok(Some(_)));
    if let Some(environment) = memory.environment.take_if(|of| !is_whole(of.blob)) {
        let name = environment.name;
        tracing::warn!(name, "the last environment is not in the store any more");
        memory.revision.0 += 1;
        has_dropped = true;
    }
    if has_dropped {
        keep_copy(state);
    }
    allowed.allow(&memory.environment.iter().map(|of| of.blob).collect::<Vec<_>>());
    // What was said once is not said again by the next manager.
    if has_changed && let Err(error) = state.save(&memory, true) {
        tracing::warn!(path = %state.path().display(), %error, "cannot remember the state");
    }
    tracing::info!(revision = memory.revision.0, "going on where the last manager stopped");
    let core = RecordedCluster::new(
        ClusterConfig { wall, epoch, memory: Some(memory), outline, is_navigable },
        recorder,
    );
    (core, Some(state.clone()))
}

/// Lets servers have what was added to the remembered scene.
fn allow_assets(
    memory: &PersistentState,
    folder: &BlobStore,
    allowed: &BlobAllowlist,
) -> Result<(), String> {
    for manifest in memory.edits.asset_manifests() {
        let added = import::read_manifest(folder, manifest)?;
        allowed.allow(&added.blobs);
    }
    Ok(())
}

/// Logs what has changed in the wall file since the last manager, and what that makes invalid.
fn log(reconciled: &Reconciled) {
    let Reconciled { changes, tunings, dropped, .. } = reconciled;
    for change in changes.iter().take(CHANGES_LOGGED_MAX) {
        let value = |value: &Option<String>| value.clone().unwrap_or_else(|| "not set".to_owned());
        let (old, new) = (value(&change.old), value(&change.new));
        tracing::info!(key = change.key, old, new, "the wall file has changed");
    }
    if let Some(more) = changes.len().checked_sub(CHANGES_LOGGED_MAX).filter(|more| *more > 0) {
        tracing::info!(more, "more keys of the wall file have changed");
    }
    for (old, new) in &tunings.renamed {
        tracing::info!(old, new, "a channel was renamed; its tuning was kept");
    }
    for lost in &tunings.dropped {
        let (channel, keys, reason) = (&lost.channel, &lost.keys, &lost.reason);
        tracing::warn!(channel, keys, reason, "a tuning was dropped");
    }
    for (what, reason) in dropped {
        tracing::warn!(what, reason, "a part of the remembered state was dropped");
    }
}

/// Keeps what was remembered beside the state file, where this start does not go on with all of it:
/// a store that was not mounted yet must not cost the edits of a scene.
fn keep_copy(state: &StateFile) {
    match state.keep_copy() {
        Ok(copy) => {
            let copy = copy.display();
            tracing::warn!(%copy, "the state before was kept; read it with --state COPY");
        }
        Err(error) => {
            let path = state.path().display();
            tracing::warn!(%path, %error, "cannot keep a copy of the state before");
        }
    }
}
