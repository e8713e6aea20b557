//! Where bakes lie, so that no scene is imported twice.
//!
//! ```text
//! STORE/blobs/3f/3fa1...    meshes, textures, manifests: protocol's BlobFolder
//! STORE/bakes/KEY.json      which manifest came of which source, and how much it is
//! ```

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use polyptych_protocol::blob::{BlobError, BlobFolder};
use polyptych_protocol::codec;
use polyptych_protocol::ids::BlobHash;
use polyptych_protocol::scene::Scene;

use super::Baked;
use super::error::BakeError;

/// Largest `KEY.json`; ours have a few kilobytes.
const BAKE_JSON_BYTES_MAX: u64 = 1 << 20;

/// A folder of bakes and their blobs. Several processes may share one.
#[derive(Clone, Debug)]
pub struct Store {
    bakes: PathBuf,
    blobs: BlobFolder,
}

impl Store {
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
        Ok(Self { bakes, blobs: BlobFolder::new(blobs) })
    }

    /// The blobs of all bakes.
    pub fn blobs(&self) -> &BlobFolder {
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
        let scene: Scene = codec::decode_manifest(&manifest).ok()?;
        let is_whole = scene.fault().is_none() && self.has_all(&scene);
        is_whole.then_some(Baked { reused: true, ..baked })
    }

    /// Whether every blob is there with the length that it must have; one that has not is
    /// removed, because [`BlobFolder::write`] leaves alone what is there.
    fn has_all(&self, scene: &Scene) -> bool {
        let primitives = scene.meshes.iter().flat_map(|mesh| &mesh.primitives);
        let meshes = primitives.map(|p| (p.blob, p.vertex_bytes() + p.index_bytes()));
        let textures = scene.textures.iter().map(|t| (t.blob, t.bytes()));
        let mut has_all = true;
        for (blob, bytes) in meshes.chain(textures) {
            let path = self.blobs.path_of(blob);
            match fs::metadata(&path) {
                Ok(facts) if facts.is_file() && facts.len() == bytes => {}
                Ok(_) => {
                    has_all = false;
                    drop(fs::remove_file(&path));
                }
                Err(_) => has_all = false,
            }
        }
        has_all
    }

    /// Notes what came of this key.
    pub(super) fn record(&self, key: BlobHash, baked: &Baked) -> Result<(), BakeError> {
        let path = self.path_of(key);
        let written = serde_json::to_vec_pretty(baked).map_err(std::io::Error::from);
        let written = written.and_then(|text| {
            let mut file = tempfile::NamedTempFile::new_in(&self.bakes)?;
            file.write_all(&text)?;
            file.persist(&path).map_err(|error| error.error)?;
            Ok(())
        });
        written.map_err(|error| unusable(&path, error))
    }

    fn path_of(&self, key: BlobHash) -> PathBuf {
        self.bakes.join(format!("{key}.json"))
    }
}

fn unusable(path: &Path, source: std::io::Error) -> BakeError {
    BakeError::Store(BlobError::Io { path: path.to_owned(), source })
}
