//! Meshes: every primitive that is drawn, in pieces, each a blob of vertices and indices.

use std::collections::{BTreeMap, HashMap};
use std::sync::atomic::AtomicBool;

use polyptych_scene::{Mesh, Primitive, Topology, VertexLayout};
use rayon::prelude::*;

use super::borders::Borders;
use super::error::BakeError;
use super::geometry::{self, Geometry, Tangents, flat_normal};
use super::material::{Palette, VertexRequirements};
use super::piece::{Blob, Piece};
use super::pose::{MeshUse, Meshes, Pose};
use super::split::{self, Pieces};
use super::{BakeJob, check, document, tangent, topology};

/// Triangles, lines and points whose levels are made at once: enough to keep all cores busy with
/// small primitives, some 20 MB.
const BATCH_ELEMENTS: usize = 1 << 17;

/// Corners that are welded between two looks at the cancel flag: some milliseconds.
const CORNERS_BETWEEN_CHECKS: usize = 1 << 16;

/// Everything that the bytes of a primitive depend on; equal keys share blobs.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct PrimitiveKey {
    attributes: BTreeMap<String, u32>,
    indices: Option<u32>,
    mode: u32,
    uv_sets: [Option<u32>; 2],
    normal_map: Option<(u8, [u32; 6])>,
    keeps_order: bool,
    scale: u64,
    pose: Option<u32>,
    /// The other surfaces of the mesh, whose vertices are borders of this one.
    neighbors: Vec<SurfaceKey>,
}

/// Everything that the positions of a surface depend on: POSITION, indices and pose.
type SurfaceKey = (Option<u32>, Option<u32>, Option<u32>);

/// A mesh whose primitives are being written.
struct Draft {
    name: String,
    /// Each as the number of what was written, and the material that it is drawn with here.
    primitives: Vec<(usize, Option<u32>)>,
}

/// Bakes the uses of meshes named by the keys of `scales`, whose values are the most metres that
/// one of their units is drawn as. Gives them in the order of the keys.
pub(super) fn write_all(
    job: &mut BakeJob<'_>,
    palette: &mut Palette,
    uses: &Meshes,
    scales: &BTreeMap<u32, f64>,
) -> Result<Vec<Mesh>, BakeError> {
    let mut shared: BTreeMap<PrimitiveKey, usize> = BTreeMap::new();
    let json: &[document::Mesh] = &job.source.document.meshes;
    let used = || {
        let uses =
            scales.iter().filter_map(|(used, scale)| Some((uses.uses.get(*used as usize)?, scale)));
        uses.filter_map(|(used, scale)| Some((*used, json.get(used.mesh as usize)?, *scale)))
    };
    let total = used().map(|(_, mesh, _)| mesh.primitives.len() as u64).sum();
    let mut batch = Batch { total, ..Batch::default() };
    let mut drafts = Vec::with_capacity(scales.len());
    for (used, json, scale) in used() {
        let mut draft = Draft { name: json.name.clone(), primitives: Vec::new() };
        let surfaces = surfaces(uses, used, json);
        let mut borders = None;
        for (i, primitive) in json.primitives.iter().enumerate() {
            job.step("meshes", batch.read, total)?;
            batch.read += 1;
            let place = format!("meshes[{}].primitives[{i}]", used.mesh);
            let is_surface = topology::of_mode(primitive.mode) == Some(Topology::Triangles);
            let is_lit = is_surface || primitive.attributes.contains_key("NORMAL");
            let (material, needs) = palette.material(job, primitive.material, is_lit, &place)?;
            let pose = uses.pose(used, primitive);
            let neighbors = surfaces.iter().filter(|(of, _)| is_surface && *of != i);
            let key = PrimitiveKey {
                neighbors: neighbors.map(|(_, key)| *key).collect(),
                ..key(primitive, &needs, scale, pose.map(|(index, _)| index))
            };
            let number = if let Some(number) = shared.get(&key) {
                *number
            } else {
                let borders = match &mut borders {
                    Some(borders) => borders,
                    none => none.insert(borders_of(job, uses, used, json)?),
                };
                let pose = pose.map(|(_, pose)| pose);
                let pieces = read(job, primitive, &needs, scale, pose, borders, &place)?;
                let number = batch.add(pieces);
                shared.insert(key, number);
                number
            };
            draft.primitives.push((number, material));
            if batch.elements >= BATCH_ELEMENTS {
                batch.finish(job)?;
            }
        }
        drafts.push(draft);
    }
    batch.finish(job)?;
    Ok(drafts.into_iter().map(|draft| batch.mesh(draft)).collect())
}

/// Pieces whose levels are made together, and what was written of earlier ones.
#[derive(Default)]
struct Batch {
    /// Each with the number of its primitive.
    pieces: Vec<(usize, Piece)>,
    /// Triangles, lines and points of `pieces`.
    elements: usize,
    /// The pieces of each primitive.
    written: Vec<Vec<Primitive>>,
    /// Primitives that were read, of `total`.
    read: u64,
    total: u64,
}

impl Batch {
    /// Adds the pieces of a primitive; gives its number.
    fn add(&mut self, pieces: Vec<Piece>) -> usize {
        let number = self.written.len();
        self.elements += pieces.iter().map(Piece::element_count).sum::<usize>();
        self.pieces.extend(pieces.into_iter().map(|piece| (number, piece)));
        self.written.push(Vec::new());
        number
    }

    /// Makes the levels of all pieces on all cores, and writes them in order.
    fn finish(&mut self, job: &mut BakeJob<'_>) -> Result<(), BakeError> {
        job.step("levels", self.read, self.total)?;
        self.elements = 0;
        let pieces = std::mem::take(&mut self.pieces);
        let cancel = job.cancel;
        let finish = |(number, piece): (usize, Piece)| Ok((number, piece.finish(cancel)?));
        let blobs: Vec<(usize, Blob)> =
            pieces.into_par_iter().map(finish).collect::<Result<_, BakeError>>()?;
        for (number, Blob { bytes, primitive, levels, place }) in blobs {
            let blob = job.write(&bytes, &place)?;
            job.levels.add(&levels, 1.0);
            self.written[number].push(Primitive { blob, ..primitive });
        }
        Ok(())
    }

    fn mesh(&self, draft: Draft) -> Mesh {
        let primitives = draft.primitives.into_iter().flat_map(|(number, material)| {
            let pieces = self.written[number].iter();
            pieces.map(move |piece| Primitive { material, ..piece.clone() })
        });
        Mesh { name: draft.name, primitives: primitives.collect() }
    }
}

/// The surfaces of a mesh, each with its number among the primitives.
fn surfaces(uses: &Meshes, used: MeshUse, json: &document::Mesh) -> Vec<(usize, SurfaceKey)> {
    let is_surface = |primitive: &document::Primitive| {
        topology::of_mode(primitive.mode) == Some(Topology::Triangles)
    };
    let primitives = json.primitives.iter().enumerate();
    let key = |(i, primitive): (usize, &document::Primitive)| {
        let pose = uses.pose(used, primitive).map(|(index, _)| index);
        let positions = primitive.attributes.get("POSITION").copied();
        is_surface(primitive).then_some((i, (positions, primitive.indices, pose)))
    };
    primitives.filter_map(key).collect()
}

/// The positions that several surfaces of a mesh have.
fn borders_of(
    job: &mut BakeJob<'_>,
    uses: &Meshes,
    used: MeshUse,
    json: &document::Mesh,
) -> Result<Borders, BakeError> {
    let surfaces = surfaces(uses, used, json);
    let mut borders = Borders::default();
    for &(i, _) in surfaces.iter().filter(|_| surfaces.len() > 1) {
        job.check()?;
        let primitive = &json.primitives[i];
        let pose = uses.pose(used, primitive).map(|(_, pose)| pose);
        // What is wrong with one is said when it is read for itself.
        let positions = geometry::used_positions(job, primitive, pose).unwrap_or_default();
        borders.add(i as u32, positions.into_iter());
    }
    Ok(borders)
}

fn key(
    primitive: &document::Primitive,
    needs: &VertexRequirements,
    scale: f64,
    pose: Option<u32>,
) -> PrimitiveKey {
    let normal_map = needs.normal_map;
    PrimitiveKey {
        attributes: primitive.attributes.clone(),
        indices: primitive.indices,
        mode: primitive.mode,
        uv_sets: needs.uv_sets,
        normal_map: normal_map.map(|(set, uv)| (set, uv.to_cols_array().map(f32::to_bits))),
        keeps_order: needs.keeps_order,
        scale: scale.to_bits(),
        pose,
        neighbors: Vec::new(),
    }
}

/// Reads one primitive in pieces. `borders` has the positions that it shares with others.
fn read(
    job: &mut BakeJob<'_>,
    json: &document::Primitive,
    needs: &VertexRequirements,
    scale: f64,
    pose: Option<&Pose>,
    borders: &Borders,
    place: &str,
) -> Result<Vec<Piece>, BakeError> {
    let Some(mut geometry) = geometry::read(job, json, needs, pose, place)? else {
        return Ok(Vec::new());
    };
    let is_surface = geometry.topology == Topology::Triangles;
    let has_tangents = matches!(geometry.tangents, Tangents::Vertex(_));
    if let Some(map) = needs.normal_map.filter(|_| is_surface && !has_tangents) {
        let made = tangent::generate(job, &geometry, map, place);
        geometry.tangents = Tangents::Corner(made);
    }
    job.check()?;
    let arity = topology::arity(geometry.topology);
    let pieces = split::split(&geometry.positions, &geometry.indices, arity, scale, job.cancel)?;
    let mut reader = PieceReader {
        layout: VertexLayout {
            // Lines and points with a normal map get a tangent too: one layout per material.
            tangent: needs.normal_map.is_some(),
            uv0: geometry.uvs[0].is_some(),
            uv1: geometry.uvs[1].is_some(),
            color: geometry.colors.is_some(),
        },
        new_of: vec![u32::MAX; geometry.positions.len()],
        is_locked: Vec::new(),
        geometry,
        keeps_order: needs.keeps_order,
        scale,
    };
    reader.is_locked = reader.locked(&pieces, borders);
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
    /// `true` for each of the primitive's vertices at the position of another piece.
    is_locked: Vec<bool>,
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
        let (indices, vertices) =
            if is_shared { self.gather(elements) } else { self.weld(elements, job.cancel)? };
        let is_locked = vertices.iter().map(|vertex| self.is_locked[vertex.source as usize]);
        Ok(Piece {
            topology: self.geometry.topology,
            layout: self.layout,
            is_locked: is_locked.collect(),
            vertices: self.interleave(&vertices),
            indices,
            keeps_order: self.keeps_order,
            scale: self.scale,
            place: place.to_owned(),
        })
    }

    /// Says of each vertex whether another piece or another surface of the mesh has its position.
    fn locked(&self, pieces: &Pieces, others: &Borders) -> Vec<bool> {
        let position = |vertex: u32| self.geometry.positions[vertex as usize];
        let mut own = Borders::default();
        for (part, range) in (0..).zip(&pieces.ranges).filter(|_| pieces.ranges.len() > 1) {
            let corners = self.corners(&pieces.elements[range.clone()]);
            let vertices = corners.map(|corner| self.geometry.indices[corner as usize]);
            own.add(part, vertices.map(position));
        }
        let positions = self.geometry.positions.iter();
        positions.map(|at| own.contains(*at) || others.contains(*at)).collect()
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

    /// The same where normals or tangents belong to corners: corners that agree share a vertex.
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
