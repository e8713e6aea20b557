//! The start of a core: afresh, or from the state that the last manager of its wall persisted.

use std::path::Path;

use polyptych_core::PersistentState;
use polyptych_files::blob::BlobStore;
use polyptych_protocol::ids::Epoch;
use polyptych_tls::{Credentials, CredentialsError, NodeIdentity};

use super::{ManagerError, ManagerOptions};
use crate::bulk::BlobAllowlist;
use crate::leadership::Release;
use crate::recorded_cluster::RecordedCluster;
use crate::recorder::ClusterConfig;
use crate::state_file::kept_copy::KeepError;
use crate::state_file::{Found, Reconciled, StateFile};
use crate::{import, state_file};

/// Maximum number of changed keys that are logged one by one.
const CHANGES_LOGGED_MAX: usize = 32;

/// The manager's own keys, fit for use now.
pub(super) fn load_keys(folder: &Path) -> Result<Credentials, CredentialsError> {
    let keys = Credentials::load(folder)?;
    keys.expect_identity(&NodeIdentity::Manager)?;
    for warning in keys.warnings() {
        tracing::warn!("{warning}");
    }
    Ok(keys)
}

/// The state file of this wall and what is in it; `None` for a wall that keeps no state.
///
/// # Errors
/// The file must not be written over.
pub(super) async fn load_state(
    options: &ManagerOptions,
) -> Result<Option<(StateFile, Found)>, ManagerError> {
    let Some(path) = options.memory.clone() else { return Ok(None) };
    let mut state = StateFile::new(path, &options.wall).with_fence(options.leadership.clone());
    match state.load().await {
        Ok(found) => Ok(Some((state, found))),
        Err(error) => Err(refusal(options, error.to_string())),
    }
}

/// The core, going on where the last manager of this wall stopped, if there was one and its
/// scene is still in the store; and the file in which its state is kept.
///
/// # Errors
/// State that does not fit any more cannot be kept elsewhere, and would be written over.
pub(super) fn start_cluster(
    options: &mut ManagerOptions,
    state: Option<(StateFile, Found)>,
    epoch: Epoch,
    allowed: &BlobAllowlist,
) -> Result<(RecordedCluster, Option<StateFile>), ManagerError> {
    let Some((mut state, found)) = state else { return Ok((start_afresh(options, epoch), None)) };
    state.remove_abandoned();
    let saved = match found {
        Found::Saved(saved) => *saved,
        Found::Nothing => return Ok((start_afresh(options, epoch), Some(state))),
        Found::Damaged(reason) => {
            let path = state.path().display();
            tracing::warn!(%path, reason, "what was remembered is of no use");
            keep_copy(&state, true).map_err(|reason| refusal(options, reason))?;
            return Ok((start_afresh(options, epoch), Some(state)));
        }
    };
    let (wall, is_navigable) = (options.wall.clone(), options.is_navigable);
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
                    // Those with which it is opened: its file hides nodes, and says more of them.
                    memory.edits = import.scene.edits;
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
        keep_copy(&state, false).map_err(|reason| refusal(options, reason))?;
    }
    allowed.allow(&memory.environment.iter().map(|of| of.blob).collect::<Vec<_>>());
    // What was said once is not said again by the next manager.
    if has_changed && let Err(error) = state.save(&memory, true) {
        tracing::warn!(path = %state.path().display(), %error, "cannot remember the state");
    }
    tracing::info!(revision = memory.revision.0, "going on where the last manager stopped");
    let config = ClusterConfig { wall, epoch, memory: Some(memory), outline, is_navigable };
    let core = RecordedCluster::new(config, options.recorder.take());
    Ok((core, Some(state)))
}

fn start_afresh(options: &mut ManagerOptions, epoch: Epoch) -> RecordedCluster {
    let (wall, is_navigable) = (options.wall.clone(), options.is_navigable);
    let config = ClusterConfig { wall, epoch, memory: None, outline: None, is_navigable };
    RecordedCluster::new(config, options.recorder.take())
}

/// Gives the lease up, if there is one, since another manager of the wall may do better.
fn refusal(options: &ManagerOptions, reason: String) -> ManagerError {
    if let Some(leadership) = &options.leadership {
        leadership.release(Release::Ended);
    }
    ManagerError::State(reason)
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
/// a store that was not mounted yet must not cost the edits of a scene. Once all names of copies
/// are taken, the oldest copies stay, and what was dropped of a file that is not damaged is lost.
///
/// # Errors
/// The reason why it cannot be kept, so that the file is the only one.
fn keep_copy(state: &StateFile, is_damaged: bool) -> Result<(), String> {
    let path = state.path().display();
    match state.keep_copy() {
        Ok(copy) => {
            let copy = copy.display();
            tracing::warn!(%copy, "the state before was kept; read it with --state COPY");
        }
        Err(error @ KeepError::Full(_)) if !is_damaged => {
            tracing::warn!(%path, %error, "what was dropped of the state is kept in no copy");
        }
        Err(error) => {
            return Err(format!(
                "the state file {path} cannot be used as it is, and no copy of it kept: {error}; \
                 make room beside it, or move it away to begin without it"
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use glam::{DVec2, DVec3, UVec2};
    use polyptych_files::blob::BlobHash;
    use polyptych_protocol::state_log::SceneRef;
    use polyptych_scene::{AssetSet, Edit, Node, NodeExtras, NodeId, Scene};
    use polyptych_wall::surface::Plane;
    use polyptych_wall::{Channel, Screen, Surface, Wall};

    use super::*;
    use crate::state_file::Saved;

    /// The options of a wall of one display, with its store in this folder.
    fn options(folder: &Path) -> ManagerOptions {
        let plane = Plane::upright(DVec3::NEG_Z, DVec2::splat(2.0));
        let size = UVec2::splat(64);
        let screens = vec![Screen::new("front", Surface::Plane(plane), size)];
        let wall = Wall::new("w", screens, vec![Channel::tile("a", 0, UVec2::ZERO, size)]);
        let (program, store) = ("none".into(), folder.to_owned());
        ManagerOptions {
            wall,
            token: String::new(),
            keys: None,
            scene_roots: Vec::new(),
            baker: import::Baker { program, memory_mib: 1, memory_remedy: "", store },
            memory: None,
            leadership: None,
            is_navigable: false,
            recorder: None,
            metrics: None,
            http: None,
            notifier: None,
        }
    }

    #[test]
    fn a_scene_whose_added_assets_are_lost_is_as_its_file_has_it() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut options = options(folder.path());
        let extras = vec![NodeExtras { node: 0, is_hidden: true, ..NodeExtras::default() }];
        let scene = Scene { nodes: vec![Node::default(); 2], extras, ..Scene::default() };
        let blobs = BlobStore::new(folder.path().join("blobs"));
        let manifest = blobs.write(&polyptych_codec::encode(&scene)).expect("written");
        let lost = AssetSet {
            manifest: BlobHash([7; 32]),
            first_mesh: 0,
            primitives: vec![1],
            first_material: 0,
            materials: 0,
            first_texture: 0,
            textures: 0,
        };
        let mut edits = scene.first_edits();
        edits.apply(Edit::AddAssets(Box::new(lost)));
        edits.apply(Edit::SetMesh { node: NodeId(1), mesh: Some(0) });
        let wall = options.wall.clone();
        let memory = PersistentState {
            scene: Some(SceneRef { name: "town".into(), manifest }),
            edits,
            ..PersistentState::of_wall(&wall)
        };
        let path = folder.path().join("wall.state");
        fs::write(&path, "what was saved").expect("written");
        let state = StateFile::new(path, &wall);
        let found = Found::Saved(Box::new(Saved { wall, memory }));
        let allowed = BlobAllowlist::default();
        let started = start_cluster(&mut options, Some((state, found)), Epoch(1), &allowed);
        let (cluster, _) = started.expect("the wall goes on");
        let (_, edits) = cluster.shown_scene().expect("its scene is there");
        assert_eq!(*edits, scene.first_edits(), "one node is hidden");
    }

    #[test]
    fn goes_on_without_a_copy_only_if_all_are_taken_and_nothing_is_damaged() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("wall.state");
        let state = StateFile::new(path.clone(), &Wall::new("w", vec![], vec![]));
        let keep_next = |number: u32| {
            fs::write(&path, number.to_string()).expect("written");
            state.keep_copy()
        };
        let full = (0..1_000).find_map(|number| keep_next(number).err()).expect("a limit");
        assert!(matches!(full, KeepError::Full(_)), "{full}");
        keep_copy(&state, false).expect("the wall begins, with a warning");
        let refused = keep_copy(&state, true).expect_err("it would be lost");
        assert!(refused.contains("wall.state.old on; move some"), "{refused}");
        let oldest = fs::read_to_string(folder.path().join("wall.state.old")).expect("read");
        assert_eq!(oldest, "0");
        // Nothing to copy: an error of the system ends the start in both cases.
        fs::remove_file(&path).expect("removed");
        for is_damaged in [false, true] {
            keep_copy(&state, is_damaged).expect_err("not copied");
        }
    }
}
