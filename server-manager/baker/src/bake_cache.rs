//! The store of bakes, so that no scene is imported twice.
//!
//! ```text
//! STORE/blobs/3f/3fa1...    meshes, textures, manifests: protocol's BlobFolder
//! STORE/bakes/KEY.json      which manifest came of which source, and how much it is
//! ```

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use polyptych_files::blob::{self, Abandoned, BlobError, BlobHash, BlobStore};
use polyptych_scene::Scene;
use rayon::prelude::*;

use super::Baked;
use super::error::BakeError;

/// Largest `KEY.json`; ours have a few kilobytes.
const BAKE_JSON_BYTES_MAX: u64 = 1 << 20;

/// A folder of bakes and their blobs. Several processes may share one.
#[derive(Clone, Debug)]
pub struct BakeCache {
    bakes: PathBuf,
    blobs: BlobStore,
}

impl BakeCache {
    /// Opens the store in this folder, which is made if it is not there.
    ///
    /// # Errors
    /// [`BakeError::Store`] where the folder can't be made.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, BakeError> {
        let path = path.as_ref();
        let (bakes, blobs) = (path.join("bakes"), path.join("blobs"));
        for folder in [&bakes, &blobs] {
            fs::create_dir_all(folder).map_err(|error| unusable(folder, error))?;
        }
        Ok(Self { bakes, blobs: BlobStore::new(blobs) })
    }

    /// Removes the files that killed bakers left, and logs how much that was.
    pub fn remove_abandoned(&self) {
        let blobs = self.blobs.remove_abandoned();
        let bakes = blob::remove_abandoned(&self.bakes);
        let Abandoned { files, bytes } =
            Abandoned { files: blobs.files + bakes.files, bytes: blobs.bytes + bakes.bytes };
        if files > 0 {
            let store = self.blobs.root().display();
            tracing::info!(%store, files, bytes, "files of killed processes were removed");
        }
    }

    /// The blobs of all bakes.
    pub fn blobs(&self) -> &BlobStore {
        &self.blobs
    }

    /// The bake of this key, if it is complete.
    pub(super) fn find(&self, key: BlobHash) -> Option<Baked> {
        let path = self.path_of(key);
        let facts = fs::metadata(&path).ok()?;
        let text = (facts.len() <= BAKE_JSON_BYTES_MAX).then(|| fs::read(&path).ok())??;
        let baked: Baked = serde_json::from_slice(&text).ok()?;
        // A damaged manifest is removed by this read, and made anew by the bake that follows.
        let manifest = self.blobs.read(baked.manifest).ok()??;
        let scene: Scene = polyptych_scene::decode(&manifest).ok()?;
        let is_whole = scene.fault().is_none() && self.has_all(&scene);
        is_whole.then_some(Baked { reused: true, ..baked })
    }

    /// Returns whether every blob is there, has the length that it must have, and hashes to its
    /// name. All are looked at, and damaged ones removed, so that one bake mends all: servers would
    /// else find the next damaged one with each `open`.
    fn has_all(&self, scene: &Scene) -> bool {
        let primitives = scene.meshes.iter().flat_map(|mesh| &mesh.primitives);
        let bent = primitives.clone().filter_map(|p| p.deformed);
        let bent = bent.map(|deformed| (deformed.blob, deformed.bytes));
        let meshes = primitives.map(|p| (p.blob, p.bytes()));
        let textures = scene.textures.iter().map(|t| (t.blob, t.bytes()));
        let all: BTreeMap<BlobHash, u64> = meshes.chain(bent).chain(textures).collect();
        let damaged = |&(blob, bytes): &(&BlobHash, &u64)| !self.blobs.verify(*blob, *bytes);
        let damaged = all.par_iter().filter(damaged).count();
        if damaged > 0 {
            tracing::warn!(damaged, of = all.len(), "blobs of the store are baked anew");
        }
        // Its length is in it. Reading it removes a damaged one.
        let has_light =
            scene.surroundings.is_none_or(|of| matches!(self.blobs.read(of), Ok(Some(_))));
        damaged == 0 && has_light
    }

    /// Notes what came of this key, once its blobs are durable: who is told that a scene is open
    /// finds it after a power cut too.
    pub(super) fn record(&self, key: BlobHash, baked: &Baked) -> Result<(), BakeError> {
        self.sync()?;
        let path = self.path_of(key);
        let written = serde_json::to_vec_pretty(baked).map_err(std::io::Error::from);
        let written = written.and_then(|text| blob::place(&self.bakes, &path, &text));
        written.map_err(|error| unusable(&path, error))
    }

    /// Makes all blobs durable that were written.
    pub(super) fn sync(&self) -> Result<(), BakeError> {
        let root = self.blobs.root();
        sync_file_system(root).map_err(|error| unusable(root, error))
    }

    fn path_of(&self, key: BlobHash) -> PathBuf {
        self.bakes.join(format!("{key}.json"))
    }
}

/// Writes all that waits for the disk of this folder. One call for all blobs takes a fraction of
/// the time of one for each.
#[cfg(target_os = "linux")]
fn sync_file_system(folder: &Path) -> std::io::Result<()> {
    Ok(rustix::fs::syncfs(fs::File::open(folder)?)?)
}

/// Other systems have no such call; blobs are durable when the system wants.
#[cfg(not(target_os = "linux"))]
fn sync_file_system(_: &Path) -> std::io::Result<()> {
    Ok(())
}

fn unusable(path: &Path, source: std::io::Error) -> BakeError {
    BakeError::Store(BlobError::Io { path: path.to_owned(), source })
}
