//! The geometry that files give the manager's wall, read when a capture first needs it.

use std::sync::{Arc, OnceLock};

use polyptych_files::blob::BlobStore;
use polyptych_wall::Wall;
use polyptych_wall::wall_geometry::WallGeometry;

use crate::import::read_wall_files;

/// The shapes of one wall: tuning changes none of them, and its files are baked once.
#[derive(Clone, Debug)]
pub struct GeometryCache {
    folder: BlobStore,
    known: Arc<OnceLock<Arc<WallGeometry>>>,
}

impl GeometryCache {
    /// Those of a wall whose blobs lie in this folder.
    pub fn new(folder: BlobStore) -> Self {
        Self { folder, known: Arc::default() }
    }

    /// The shapes of this wall; slow at the first time.
    ///
    /// # Errors
    /// The key and the file whose blob is gone or damaged; it is looked for again the next time.
    pub fn get(&self, wall: &Wall) -> Result<Arc<WallGeometry>, String> {
        if wall.files.is_empty() {
            return Ok(Arc::default());
        }
        if let Some(known) = self.known.get() {
            return Ok(Arc::clone(known));
        }
        let maps = read_wall_files(wall, &self.folder)?;
        // Maps are let go: of millions of points, a mesh keeps some thousand.
        Ok(Arc::clone(self.known.get_or_init(|| WallGeometry::new(wall, &maps).into())))
    }
}
