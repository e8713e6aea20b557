//! Checks that must hold for any file that is given as a scene.

use std::cell::RefCell;
use std::fs;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use polyptych_baker::{BakeCache, bake};
use polyptych_scene::Scene;

/// Longest reason for a refusal: file, place, what is wrong and what would be right.
const ERROR_BYTES_MAX: usize = 4096;

/// A folder with a scene and a store.
#[derive(Debug)]
pub struct SceneFixture {
    folder: tempfile::TempDir,
    file: PathBuf,
}

impl SceneFixture {
    pub fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("scene.glb");
        Self { folder, file }
    }

    /// Writes the scene.
    pub fn write(&self, bytes: &[u8]) -> PathBuf {
        fs::write(&self.file, bytes).expect("written");
        self.file.clone()
    }

    /// A path beside it.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Bakes a file of these bytes: a sound manifest with all blobs, or a reason of one line.
    /// Gives whether it was baked.
    pub fn check(&self, bytes: &[u8]) -> bool {
        self.write(bytes);
        let path = self.path("store");
        let store = BakeCache::open(&path).expect("a store");
        let baked = bake(&self.file, &store, &mut |_| {}, &AtomicBool::new(false));
        let is_baked = match baked {
            Ok(baked) => {
                let manifest = store.blobs().read(baked.manifest).expect("read").expect("there");
                let scene: Scene = polyptych_scene::decode(&manifest).expect("a manifest");
                assert_eq!(scene.fault(), None);
                for hash in scene.blobs() {
                    assert!(store.blobs().path_of(hash).is_file(), "{hash} is not there");
                }
                true
            }
            Err(error) => {
                let line = error.to_string();
                assert!(line.contains("scene.glb"), "{line}");
                assert!(!line.contains('\n'), "{line:?} is not one line");
                assert!(line.len() < ERROR_BYTES_MAX, "{} bytes: {line}", line.len());
                false
            }
        };
        // Each bake from the beginning; the disk stays as full as it is.
        fs::remove_dir_all(&path).expect("removed");
        is_baked
    }
}

/// One folder for each thread.
pub fn with_place<T>(work: impl FnOnce(&SceneFixture) -> T) -> T {
    thread_local! {
        static PLACE: RefCell<Option<SceneFixture>> = const { RefCell::new(None) };
    }
    PLACE.with_borrow_mut(|place| work(place.get_or_insert_with(SceneFixture::new)))
}
