//! Meshes: every primitive that is drawn, in pieces, each a blob of vertices and indices.

use std::collections::BTreeMap;
use std::sync::atomic::AtomicBool;

use foldhash::{HashMap, HashMapExt};
use polyptych_scene::{Mesh, Primitive, Topology, VertexLayout};
use rayon::prelude::*;

use super::deformation::{BentMesh, Bindings};
use super::error::BakeError;
use super::geometry::{self, Geometry, Tangents, flat_normal};
use super::material::{Palette, VertexRequirements};
use super::mesh_use::{MeshUse, Meshes};
use super::piece::{Blob, Piece};
use super::pose::Pose;
use super::shared_borders::SharedBorders;
use super::split;
use super::variants::ReplacedMaterials;
use super::{BakeJob, check, document, tangent, topology};

/// Triangles, lines and points whose levels are made at once: enough to keep all cores busy with
/// small primitives, some 20 MB.
const BATCH_ELEMENTS: usize = 1 << 17;

/// Corners that are welded between two looks at the cancel flag: some milliseconds.
const CORNERS_BETWEEN_CHECKS: usize = 1 << 16;

/// Everything that the bytes of a primitive depend on; equal keys share blobs.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct PrimitiveKey<'a> {
    attributes: &'a BTreeMap<String, u32>,
    indices: Option<u32>,
    mode: u32,
    uv_sets: [Option<u32>; 2],
    tangents: Option<(u8, [u32; 6])>,
    keeps_order: bool,
    scale: u64,
    pose: Option<u32>,
    /// The morph targets, if a pose may weigh them.
    targets: &'a [BTreeMap<String, u32>],
    /// The mesh, if what is beside it decides about its levels.
    border: Option<u32>,
    /// The mesh, if clips or edits bend it.
    bent: Option<u32>,
}

/// A mesh whose primitives are being written.
struct Draft {
    name: String,
    /// The number of what was written.
    written: usize,
    /// The material that each primitive is drawn with here.
    materials: Vec<Option<u32>>,
}

/// Bakes the uses of meshes named by the keys of `scales`, whose values are the most metres that
/// one of their units is drawn as. Gives them in the order of the keys.
pub(super) fn write_all(
    job: &mut BakeJob<'_>,
    (palette, replaced): (&mut Palette, &mut ReplacedMaterials),
    (uses, borders): (&Meshes, &SharedBorders),
    scales: &BTreeMap<u32, f64>,
) -> Result<Vec<Mesh>, BakeError> {
    let mut shared: BTreeMap<Vec<PrimitiveKey<'_>>, usize> = BTreeMap::new();
    let json: &[document::Mesh] = &job.source.document.meshes;
    let used = || {
        scales.iter().filter_map(|(number, scale)| {
            let used = *uses.uses.get(*number as usize)?;
            Some((*number, used, json.get(used.mesh as usize)?, *scale))
        })
    };
    let total = used().map(|(_, _, mesh, _)| mesh.primitives.len() as u64).sum();
    let mut batch = Batch { total, ..Batch::default() };
    let mut drafts = Vec::with_capacity(scales.len());
    for (number, used, json, scale) in used() {
        let is_shared = |position: [f32; 3]| borders.is_shared(number, position);
        let border = borders.has_shared(number).then_some(number);
        let (mut keys, mut all_needs, mut materials) = (Vec::new(), Vec::new(), Vec::new());
        for (i, primitive) in json.primitives.iter().enumerate() {
            let place = format!("meshes[{}].primitives[{i}]", used.mesh);
            let is_surface = topology::of_mode(primitive.mode) == Some(Topology::Triangles);
            let is_lit = is_surface || primitive.attributes.contains_key("NORMAL");
            let (material, needs) = replaced.material(job, palette, primitive, is_lit, &place)?;
            let pose = uses.pose(used, primitive).map(|(index, _)| index);
            let key = key(primitive, &needs, scale, pose);
            keys.push(PrimitiveKey { border, bent: used.bent, ..key });
            all_needs.push((place, needs));
            materials.push(material);
        }
        let written = if let Some(written) = shared.get(&keys) {
            batch.read += json.primitives.len() as u64;
            *written
        } else {
            let mut mesh = Vec::with_capacity(keys.len());
            for (primitive, (place, needs)) in json.primitives.iter().zip(&all_needs) {
                job.step("meshes", batch.read, total)?;
                batch.read += 1;
                let shape = PrimitiveShape::of(uses, used, primitive);
                let pieces = read(job, primitive, needs, scale, &shape, place)?;
                mesh.push(pieces.into_iter().map(|piece| piece.with_locks(is_shared)).collect());
            }
            let number = batch.add(mesh);
            shared.insert(keys, number);
            number
        };
        drafts.push(Draft { name: json.name.clone(), written, materials });
        if batch.elements >= BATCH_ELEMENTS {
            batch.finish(job)?;
        }
    }
    batch.finish(job)?;
    Ok(batch.into_meshes(drafts))
}

/// Meshes whose levels are made together, and what was written of earlier ones.
#[derive(Default)]
struct Batch {
    /// Each with its number, and its pieces by primitive.
    meshes: Vec<(usize, Vec<Vec<Piece>>)>,
    /// Triangles, lines and points of `meshes`.
    elements: usize,
    /// The pieces of each primitive of each mesh.
    written: Vec<Vec<Vec<Primitive>>>,
    /// Primitives that were read, of `total`.
    read: u64,
    total: u64,
}

impl Batch {
    /// Adds the pieces of a mesh by primitive; gives its number.
    fn add(&mut self, mesh: Vec<Vec<Piece>>) -> usize {
        let number = self.written.len();
        self.elements += mesh.iter().flatten().map(Piece::element_count).sum::<usize>();
        // With no more room than is needed: there may be a million primitives.
        self.written.push(mesh.iter().map(|pieces| Vec::with_capacity(pieces.len())).collect());
        self.meshes.push((number, mesh));
        number
    }

    /// Makes the levels of all meshes on all cores, and writes them in order.
    fn finish(&mut self, job: &mut BakeJob<'_>) -> Result<(), BakeError> {
        job.step("levels", self.read, self.total)?;
        self.elements = 0;
        let cancel = job.cancel;
        let finish = |(mesh, pieces): (usize, Vec<Vec<Piece>>)| {
            let primitives = pieces.iter().enumerate();
            let owners: Vec<usize> =
                primitives.flat_map(|(at, pieces)| pieces.iter().map(move |_| at)).collect();
            let blobs = Piece::finish(pieces.into_iter().flatten().collect(), cancel)?;
            Ok((mesh, owners.into_iter().zip(blobs).collect()))
        };
        let meshes = std::mem::take(&mut self.meshes);
        let finished: Vec<(usize, Vec<(usize, Blob)>)> =
            meshes.into_par_iter().map(finish).collect::<Result<_, BakeError>>()?;
        for (mesh, blobs) in finished {
            for (at, Blob { bytes, mut primitive, levels, deformer, place }) in blobs {
                primitive.blob = job.write(&bytes, &place)?;
                if let (Some(described), Some(bytes)) = (&mut primitive.deformed, deformer) {
                    described.blob = job.write(&bytes, &place)?;
                }
                job.levels.add(&levels, 1.0);
                self.written[mesh][at].push(primitive);
            }
        }
        Ok(())
    }

    fn into_meshes(mut self, drafts: Vec<Draft>) -> Vec<Mesh> {
        // The last one with these pieces takes them.
        let mut last = vec![0; self.written.len()];
        for (at, draft) in drafts.iter().enumerate() {
            last[draft.written] = at;
        }
        let mesh = |(at, draft): (usize, Draft)| {
            let written = &mut self.written[draft.written];
            let is_last = last[draft.written] == at;
            let written = if is_last { std::mem::take(written) } else { written.clone() };
            let mut primitives = Vec::with_capacity(written.iter().map(Vec::len).sum());
            for (pieces, material) in written.into_iter().zip(draft.materials) {
                primitives.extend(pieces.into_iter().map(|of| Primitive { material, ..of }));
            }
            Mesh { name: draft.name, primitives }
        };
        drafts.into_iter().enumerate().map(mesh).collect()
    }
}

fn key<'a>(
    primitive: &'a document::Primitive,
    needs: &VertexRequirements,
    scale: f64,
    pose: Option<u32>,
) -> PrimitiveKey<'a> {
    PrimitiveKey {
        attributes: &primitive.attributes,
        indices: primitive.indices,
        mode: primitive.mode,
        uv_sets: needs.uv_sets,
        tangents: needs.tangents.map(|(set, uv)| (set, uv.to_cols_array().map(f32::to_bits))),
        keeps_order: needs.keeps_order,
        scale: scale.to_bits(),
        pose,
        targets: if pose.is_some() { &primitive.targets } else { &[] },
        border: None,
        bent: None,
    }
}

/// The shape of a primitive.
enum PrimitiveShape<'a> {
    /// Its own shape, or that of a pose.
    Still(Option<&'a Pose>),
    /// Bent by clips or edits.
    Bent(&'a BentMesh, Pose),
}

impl<'a> PrimitiveShape<'a> {
    fn of(uses: &'a Meshes, used: MeshUse, primitive: &document::Primitive) -> Self {
        match uses.bent(used) {
            Some((bent, pose)) => Self::Bent(bent, pose),
            None => Self::Still(uses.pose(used, primitive).map(|(_, pose)| pose)),
        }
    }

    /// The most units of the mesh's node that one unit of a primitive's positions is drawn as at
    /// rest: those of a quantised mesh become metres only by its joints.
    fn stretch(&self, primitive: &document::Primitive) -> f64 {
        match self {
            // Its positions are read as the pose has put them.
            Self::Still(_) => 1.0,
            Self::Bent(_, pose) => pose.stretch(primitive),
        }
    }
}

/// Reads one primitive in pieces.
fn read(
    job: &mut BakeJob<'_>,
    json: &document::Primitive,
    needs: &VertexRequirements,
    scale: f64,
    shape: &PrimitiveShape<'_>,
    place: &str,
) -> Result<Vec<Piece>, BakeError> {
    let pose = if let PrimitiveShape::Still(pose) = shape { *pose } else { None };
    let Some(mut geometry) = geometry::read(job, json, needs, pose, place)? else {
        return Ok(Vec::new());
    };
    let is_surface = geometry.topology == Topology::Triangles;
    let has_tangents = matches!(geometry.tangents, Tangents::Vertex(_));
    if let Some(lie) = needs.tangents.filter(|_| is_surface && !has_tangents) {
        let made = tangent::generate(job, &geometry, lie, place);
        geometry.tangents = Tangents::Corner(made);
    }
    let bindings = match shape {
        PrimitiveShape::Still(_) => None,
        PrimitiveShape::Bent(bent, pose) => {
            Some(Bindings::read(job, json, (bent, pose), (&geometry, needs), place)?)
        }
    };
    job.check()?;
    let scale = scale * shape.stretch(json);
    let arity = topology::arity(geometry.topology);
    let pieces = split::split(&geometry.positions, &geometry.indices, arity, scale, job.cancel)?;
    let mut reader = PieceReader {
        layout: VertexLayout {
            // Lines and points get tangents too, if triangles do: one layout per material.
            tangent: needs.tangents.is_some(),
            uv0: geometry.uvs[0].is_some(),
            uv1: geometry.uvs[1].is_some(),
            color: geometry.colors.is_some(),
        },
        new_of: vec![u32::MAX; geometry.positions.len()],
        geometry,
        keeps_order: needs.keeps_order,
        scale,
        bindings,
    };
    let mut read = Vec::with_capacity(pieces.ranges.len());
    for range in pieces.ranges {
        job.check()?;
        read.push(reader.read(job, &pieces.elements[range], place)?);
    }
    Ok(read)
}

/// A vertex of a piece: which of the primitive's it is, and a corner that it stands at.
#[derive(Clone, Copy)]
struct Vertex {
    source: u32,
    corner: u32,
}

struct PieceReader {
    geometry: Geometry,
    layout: VertexLayout,
    keeps_order: bool,
    scale: f64,
    /// The piece's number of each of the primitive's vertices; all unset between pieces.
    new_of: Vec<u32>,
    bindings: Option<Bindings>,
}

impl PieceReader {
    fn read(
        &mut self,
        job: &BakeJob<'_>,
        elements: &[u32],
        place: &str,
    ) -> Result<Piece, BakeError> {
        let is_shared = self.geometry.normals.is_some()
            && !matches!(self.geometry.tangents, Tangents::Corner(_));
        let (indices, vertices) = if is_shared {
            self.gather(elements)
        } else if self.bindings.is_some() && self.geometry.normals.is_none() {
            self.separate(elements)
        } else {
            self.weld(elements, job.cancel)?
        };
        let interleaved = self.interleave(&vertices);
        let bent = self.bindings.as_ref().map(|bindings| {
            let sources: Vec<u32> = vertices.iter().map(|vertex| vertex.source).collect();
            let vertices = interleaved.clone();
            (bindings.deformer(self.layout, vertices, &sources), bindings.rest.clone())
        });
        Ok(Piece {
            topology: self.geometry.topology,
            layout: self.layout,
            vertices: interleaved,
            bent,
            indices,
            keeps_order: self.keeps_order,
            scale: self.scale,
            locked: Vec::new(),
            place: place.to_owned(),
        })
    }

    fn corners<'a>(&'a self, elements: &'a [u32]) -> impl Iterator<Item = u32> + 'a {
        let arity = topology::arity(self.geometry.topology) as u32;
        elements.iter().flat_map(move |element| element * arity..(element + 1) * arity)
    }

    /// The vertices of these elements, each once.
    fn gather(&mut self, elements: &[u32]) -> (Vec<u32>, Vec<Vertex>) {
        let corners: Vec<u32> = self.corners(elements).collect();
        let mut vertices = Vec::new();
        let mut indices = Vec::with_capacity(corners.len());
        for corner in corners {
            let source = self.geometry.indices[corner as usize];
            let new = &mut self.new_of[source as usize];
            if *new == u32::MAX {
                *new = vertices.len() as u32;
                vertices.push(Vertex { source, corner });
            }
            indices.push(*new);
        }
        for vertex in &vertices {
            self.new_of[vertex.source as usize] = u32::MAX;
        }
        (indices, vertices)
    }

    /// A vertex for each corner: triangles that are flat now may not be so together when they are
    /// bent.
    fn separate(&self, elements: &[u32]) -> (Vec<u32>, Vec<Vertex>) {
        let vertex = |corner| Vertex { source: self.geometry.indices[corner as usize], corner };
        let vertices: Vec<Vertex> = self.corners(elements).map(vertex).collect();
        ((0..vertices.len() as u32).collect(), vertices)
    }

    /// Returns the indices and vertices of these elements where normals or tangents belong to
    /// corners: corners that agree share a vertex.
    fn weld(
        &self,
        elements: &[u32],
        cancel: &AtomicBool,
    ) -> Result<(Vec<u32>, Vec<Vertex>), BakeError> {
        let mut known: HashMap<(u32, [u32; 3], [u32; 4]), u32> = HashMap::new();
        let mut vertices = Vec::new();
        let mut indices = Vec::new();
        for (i, corner) in self.corners(elements).enumerate() {
            if i.is_multiple_of(CORNERS_BETWEEN_CHECKS) {
                check(cancel)?;
            }
            let source = self.geometry.indices[corner as usize];
            let vertex = Vertex { source, corner };
            let normal = self.normal(vertex).map(f32::to_bits);
            let tangent = self.tangent(vertex).map(f32::to_bits);
            let new = *known.entry((source, normal, tangent)).or_insert(vertices.len() as u32);
            if new as usize == vertices.len() {
                vertices.push(vertex);
            }
            indices.push(new);
        }
        Ok((indices, vertices))
    }

    fn normal(&self, vertex: Vertex) -> [f32; 3] {
        if let Some(normals) = &self.geometry.normals {
            return normals[vertex.source as usize];
        }
        let first = vertex.corner as usize / 3 * 3;
        flat_normal(&self.geometry.positions, &self.geometry.indices[first..first + 3])
    }

    fn tangent(&self, vertex: Vertex) -> [f32; 4] {
        match &self.geometry.tangents {
            Tangents::None => [1.0, 0.0, 0.0, 1.0],
            Tangents::Vertex(tangents) => tangents[vertex.source as usize],
            Tangents::Corner(tangents) => tangents[vertex.corner as usize],
        }
    }

    /// Gives the vertices as the file has them, in the order of the layout.
    fn interleave(&self, vertices: &[Vertex]) -> Vec<f32> {
        let geometry = &self.geometry;
        let mut floats = Vec::with_capacity(vertices.len() * self.layout.stride() as usize / 4);
        for vertex in vertices {
            let source = vertex.source as usize;
            floats.extend(geometry.positions[source]);
            floats.extend(self.normal(*vertex));
            if self.layout.tangent {
                floats.extend(self.tangent(*vertex));
            }
            geometry.uvs.iter().flatten().for_each(|uv| floats.extend(uv[source]));
            if let Some(colors) = &geometry.colors {
                floats.extend(colors[source]);
            }
        }
        floats
    }
}
