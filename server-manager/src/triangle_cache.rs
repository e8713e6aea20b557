//! The triangles of the open scene's meshes, as read from the store, in trees: kept from one
//! question to the next.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use glam::DVec3;
use polyptych_files::blob::{BlobHash, BlobStore};
use polyptych_scene::{Primitive, Topology};
use polyptych_wall::triangle_bvh::TriangleBvh;

/// Most bytes of triangles that are kept; beyond it, all are forgotten and read anew.
const KEPT_BYTES_MAX: usize = 1 << 30;

/// The triangles of a primitive, in its mesh's space.
#[derive(Debug)]
pub(crate) struct Triangles {
    points: Vec<DVec3>,
    corners: Vec<[u32; 3]>,
    pub tree: TriangleBvh,
}

/// The triangles of primitives that were asked about.
#[derive(Clone, Debug, Default)]
pub(crate) struct TriangleCache(Arc<Mutex<Kept>>);

#[derive(Debug, Default)]
struct Kept {
    by_blob: BTreeMap<BlobHash, Arc<Triangles>>,
    /// Those of all, about.
    bytes: usize,
}

/// Returns whether a primitive is made of triangles.
pub(crate) fn has_triangles(primitive: &Primitive) -> bool {
    primitive.topology == Topology::Triangles && primitive.index_count >= 3
}

impl TriangleCache {
    /// The triangles of a primitive; `None` where it has none.
    ///
    /// # Errors
    /// They cannot be read.
    pub fn get(
        &self,
        store: &BlobStore,
        primitive: &Primitive,
    ) -> Result<Option<Arc<Triangles>>, String> {
        if !has_triangles(primitive) {
            return Ok(None);
        }
        let lock = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = lock().by_blob.get(&primitive.blob) {
            return Ok(Some(Arc::clone(known)));
        }
        let bytes = store.read(primitive.blob).map_err(|error| error.to_string())?;
        let bytes = bytes.ok_or("a mesh of the open scene is not in the store any more")?;
        let triangles = Arc::new(Triangles::decode(primitive, &bytes)?);
        let (mut kept, bytes) = (lock(), triangles.bytes());
        if kept.bytes + bytes > KEPT_BYTES_MAX {
            *kept = Kept::default();
        }
        if kept.by_blob.insert(primitive.blob, Arc::clone(&triangles)).is_none() {
            kept.bytes += bytes;
        }
        Ok(Some(triangles))
    }
}

impl Triangles {
    fn decode(primitive: &Primitive, bytes: &[u8]) -> Result<Self, String> {
        if bytes.len() as u64 != primitive.bytes() {
            return Err("a mesh of the open scene is not what its description says".into());
        }
        let vertices = &bytes[..primitive.vertex_bytes() as usize];
        let indices = primitive.finest_indices_of(bytes);
        let vertices = vertices.chunks_exact(primitive.layout.stride() as usize);
        let number = |vertex: &[u8], at: usize| {
            let bytes = vertex.get(at..at + 4).and_then(|bytes| bytes.try_into().ok());
            f64::from(f32::from_le_bytes(bytes.unwrap_or_default()))
        };
        let point = |v: &[u8]| DVec3::new(number(v, 0), number(v, 4), number(v, 8));
        let points: Vec<DVec3> = vertices.map(|v| primitive.origin + point(v)).collect();
        let indices: Vec<u32> = primitive.index_format.numbers(&indices).collect();
        let corners = indices.as_chunks::<3>().0.to_vec();
        if corners.iter().flatten().any(|index| *index as usize >= points.len()) {
            return Err("a mesh of the open scene has an index behind its vertices".into());
        }
        let tree = TriangleBvh::new(&points, &corners);
        Ok(Self { points, corners, tree })
    }

    /// The corners of a triangle, in the space of its mesh.
    pub fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.corners[triangle].map(|corner| self.points[corner as usize])
    }

    /// Returns the bytes that they take, about: points, corners, a box for every two triangles.
    fn bytes(&self) -> usize {
        self.points.len() * 24 + self.corners.len() * (12 + 4 + 56 / 2)
    }
}
