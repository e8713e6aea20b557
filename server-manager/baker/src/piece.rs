//! A piece of a primitive on its way to its blob: ordered, with its levels of detail.

use std::sync::atomic::AtomicBool;

use glam::{DVec3, Vec3};
use polyptych_files::blob::BlobHash;
use polyptych_scene::meshlet::Meshlet;
use polyptych_scene::{IndexFormat, Primitive, Topology, VertexLayout};

use polyptych_scene::deformation::{Deformer, Shape};

use super::deformation;
use super::error::BakeError;
use super::levels::{self, LevelFacts, Levels, Surface, coarse_first};
use super::{check, vertex_cache};

/// Most vertices that 16-bit indices are used for: 65,535 is left free, as it restarts strips.
const U16_VERTICES_MAX: usize = 65_535;

/// Vertices and indices as they came from the source.
#[derive(Debug)]
pub(super) struct Piece {
    pub topology: Topology,
    pub layout: VertexLayout,
    /// Vertices of `layout`, in f32.
    pub vertices: Vec<f32>,
    /// Corners of the elements; each vertex is used.
    pub indices: Vec<u32>,
    /// `true` if the elements are drawn in the order of the source.
    pub keeps_order: bool,
    /// Metres that one unit is drawn as, at most.
    pub scale: f64,
    /// The vertices that no level moves or leaves out, rising.
    pub locked: Vec<u32>,
    /// The part that clips or edits bend, and its shape at rest; `vertices` are as before.
    pub bent: Option<(Deformer, Shape)>,
    /// The primitive in the file, for messages.
    pub place: String,
}

/// A piece as it is stored.
#[derive(Debug)]
pub(super) struct Blob {
    pub bytes: Vec<u8>,
    /// The contents of the bytes; their hash and the material have yet to be set.
    pub primitive: Primitive,
    /// The levels, with their errors in metres.
    pub levels: LevelFacts,
    /// The bytes of what bends it.
    pub deformer: Option<Vec<u8>>,
    pub place: String,
}

impl Piece {
    /// Returns the number of elements.
    pub(super) fn element_count(&self) -> usize {
        self.indices.len() / super::topology::arity(self.topology)
    }

    /// Locks the vertices whose positions are as wanted.
    pub(super) fn with_locks(self, is_locked: impl Fn([f32; 3]) -> bool) -> Self {
        let rows = self.vertices.chunks_exact(self.layout.stride() as usize / 4);
        let locked = (0..).zip(rows).filter(|(_, row)| is_locked([row[0], row[1], row[2]]));
        let locked = locked.map(|(vertex, _)| vertex).collect();
        Self { locked, ..self }
    }

    /// Makes the levels of all pieces of a mesh, and their bytes.
    ///
    /// # Errors
    /// [`BakeError::Cancelled`].
    pub(super) fn finish(pieces: Vec<Self>, cancel: &AtomicBool) -> Result<Vec<Blob>, BakeError> {
        let is_surface =
            |piece: &&Self| piece.topology == Topology::Triangles && piece.bent.is_none();
        let surfaces: Vec<Surface<'_>> =
            pieces.iter().filter(is_surface).map(Self::surface).collect();
        let levels = levels::build(&surfaces, cancel)?;
        let kept = coarse_first::kept_levels(&levels);
        let mut levels = levels.into_iter();
        let mut blobs = Vec::with_capacity(pieces.len());
        for piece in pieces {
            check(cancel)?;
            let levels = if is_surface(&&piece) { levels.next().flatten() } else { None };
            blobs.push(match piece.bent {
                Some(_) => piece.bent_blob()?,
                None => piece.blob(levels, &kept),
            });
        }
        Ok(blobs)
    }

    fn surface(&self) -> Surface<'_> {
        Surface {
            layout: self.layout,
            vertices: &self.vertices,
            indices: &self.indices,
            keeps_order: self.keeps_order,
            locked: &self.locked,
        }
    }

    /// Makes the bytes, with cuts at the kept levels.
    fn blob(mut self, levels: Option<Levels>, kept: &[u32]) -> Blob {
        let fine_count = self.indices.len();
        let mut meshlets = Vec::new();
        let mut cuts = Vec::new();
        let mut facts = LevelFacts::default();
        let is_plain = levels.is_none();
        if let Some(levels) = levels {
            let mut levels = coarse_first::ordered(levels);
            cuts = coarse_first::cuts(&levels, kept);
            self.vertices.append(&mut levels.added);
            self.indices = levels.indices;
            meshlets = levels.meshlets;
            facts.add(&levels.facts, self.scale);
        }
        let vertex_count = self.surface().vertex_count();
        if is_plain && self.topology == Topology::Triangles {
            let triangles = vec![fine_count as u64 / 3];
            facts = LevelFacts { triangles, errors: vec![0.0], normal_angle: 0.0 };
            if !self.keeps_order {
                vertex_cache::triangles(&mut self.indices, vertex_count);
            }
        }
        let order = vertex_cache::vertices(&mut self.indices, vertex_count);
        for cut in &mut cuts {
            let named = &self.indices[..cut.index_count_of_all() as usize];
            cut.vertex_count = named.iter().max().map_or(0, |last| last + 1);
        }
        let (primitive, bytes) = self.lay_out(&order, fine_count, &meshlets);
        let primitive = Primitive { cuts, ..primitive };
        Blob { bytes, primitive, levels: facts, deformer: None, place: self.place }
    }

    /// Makes the bytes of what is bent, which has no levels: the vertices at rest, and apart from
    /// them those that are bent.
    ///
    /// # Errors
    /// A vertex at rest is not finite.
    fn bent_blob(mut self) -> Result<Blob, BakeError> {
        let (deformer, rest) = self.bent.take().unwrap_or_default();
        let (fine_count, count) = (self.indices.len(), deformer.vertex_count());
        let is_surface = self.topology == Topology::Triangles;
        let mirrored = deformer.mirrored(&rest);
        let order = if deformer.is_flat && is_surface {
            // Three vertices each: the triangle's own, in its own order.
            let mut order: Vec<u32> = (0..count as u32).collect();
            super::geometry::turn(&mut order, &mirrored, self.topology);
            order
        } else {
            super::geometry::turn(&mut self.indices, &mirrored, self.topology);
            if is_surface && !self.keeps_order {
                vertex_cache::triangles(&mut self.indices, count);
            }
            vertex_cache::vertices(&mut self.indices, count)
        };
        let deformer = deformation::reordered(&deformer, &order);
        deformer.apply(&rest, &mut self.vertices);
        if let Some(at) = self.vertices.iter().position(|number| !number.is_finite()) {
            let vertex = at / (self.layout.stride() as usize / 4);
            let what = format!("vertex {vertex} of the mesh at rest is not finite");
            return Err(BakeError::at(self.place, what, "smaller numbers would be right"));
        }
        let in_order: Vec<u32> = (0..count as u32).collect();
        let (primitive, bytes) = self.lay_out(&in_order, fine_count, &[]);
        let of_deformer = deformer.to_bytes();
        let described =
            deformation::described(&deformer, of_deformer.len() as u64, rest.joints.len());
        let triangles = vec![if is_surface { fine_count as u64 / 3 } else { 0 }];
        let levels = LevelFacts { triangles, errors: vec![0.0], normal_angle: 0.0 };
        let primitive = Primitive { deformed: Some(described), ..primitive };
        Ok(Blob { bytes, primitive, levels, deformer: Some(of_deformer), place: self.place })
    }

    /// Gives the bytes, and what is in them. `order` has the old number of each vertex.
    ///
    /// Vertices are not moved to the middle of the piece: that would round each, and differently in
    /// every piece. As they are, they are exact, and pieces meet in equal bits; the renderer takes
    /// what is large from them before anything is rounded.
    fn lay_out(
        &self,
        order: &[u32],
        fine_count: usize,
        meshlets: &[Meshlet],
    ) -> (Primitive, Vec<u8>) {
        let is_short = order.len() <= U16_VERTICES_MAX;
        let floats = self.layout.stride() as usize / 4;
        let mut bytes = Vec::with_capacity(
            self.vertices.len() * 4 + self.indices.len() * 4 + meshlets.len() * Meshlet::BYTES + 4,
        );
        let (mut min, mut max) = (Vec3::MAX, Vec3::MIN);
        for &old in order {
            let vertex = &self.vertices[old as usize * floats..][..floats];
            let position = Vec3::new(vertex[0], vertex[1], vertex[2]);
            (min, max) = (min.min(position), max.max(position));
            bytes.extend(vertex.iter().flat_map(|value| value.to_le_bytes()));
        }
        for &index in &self.indices {
            let index = index.to_le_bytes();
            bytes.extend_from_slice(if is_short { &index[..2] } else { &index });
        }
        if !meshlets.is_empty() {
            bytes.resize(bytes.len().next_multiple_of(4), 0);
        }
        bytes.extend(meshlets.iter().flat_map(Meshlet::to_bytes));
        let primitive = Primitive {
            blob: BlobHash([0; 32]),
            layout: self.layout,
            vertex_count: order.len() as u32,
            index_count: fine_count as u32,
            coarser_index_count: (self.indices.len() - fine_count) as u32,
            meshlet_count: meshlets.len() as u32,
            index_format: if is_short { IndexFormat::U16 } else { IndexFormat::U32 },
            topology: self.topology,
            material: None,
            origin: DVec3::ZERO,
            min,
            max,
            cuts: Vec::new(),
            finest_level: 0,
            deformed: None,
        };
        (primitive, bytes)
    }
}
