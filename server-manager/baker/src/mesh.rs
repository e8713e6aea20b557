//! Meshes: every primitive that is drawn, in pieces, each a blob of vertices and indices.

use std::collections::{BTreeMap, HashMap};
use std::sync::atomic::AtomicBool;

use glam::{DVec3, Vec3};
use polyptych_scene::{IndexFormat, Mesh, Primitive, Topology, VertexLayout};

use super::error::BakeError;
use super::geometry::{self, Geometry, Tangents, flat_normal};
use super::material::{Palette, VertexRequirements};
use super::pose::{Meshes, Pose};
use super::{BakeJob, check, document, split, tangent, topology, vertex_cache};

/// Most vertices that 16-bit indices are used for: 65,535 is left free, as it restarts strips.
const U16_VERTICES_MAX: usize = 65_535;

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
}

/// Bakes the uses of meshes named by the keys of `scales`, whose values are the most metres that
/// one of their units is drawn as. Gives them in the order of the keys.
pub(super) fn write_all(
    job: &mut BakeJob<'_>,
    palette: &mut Palette,
    uses: &Meshes,
    scales: &BTreeMap<u32, f64>,
) -> Result<Vec<Mesh>, BakeError> {
    let mut shared: BTreeMap<PrimitiveKey, Vec<Primitive>> = BTreeMap::new();
    let json: &[document::Mesh] = &job.source.document.meshes;
    let used = || {
        let uses =
            scales.iter().filter_map(|(used, scale)| Some((uses.uses.get(*used as usize)?, scale)));
        uses.filter_map(|(used, scale)| Some((*used, json.get(used.mesh as usize)?, *scale)))
    };
    let total: usize = used().map(|(_, mesh, _)| mesh.primitives.len()).sum();
    let (mut done, mut meshes) = (0u64, Vec::with_capacity(scales.len()));
    for (used, json, scale) in used() {
        let mut mesh = Mesh { name: json.name.clone(), primitives: Vec::new() };
        for (i, primitive) in json.primitives.iter().enumerate() {
            job.step("meshes", done, total as u64)?;
            done += 1;
            let place = format!("meshes[{}].primitives[{i}]", used.mesh);
            let is_surface = topology::of_mode(primitive.mode) == Some(Topology::Triangles);
            let is_lit = is_surface || primitive.attributes.contains_key("NORMAL");
            let (material, needs) = palette.material(job, primitive.material, is_lit, &place)?;
            let pose = uses.pose(used, primitive);
            let key = key(primitive, &needs, scale, pose.map(|(index, _)| index));
            let pieces = if let Some(pieces) = shared.get(&key) {
                pieces.clone()
            } else {
                let pose = pose.map(|(_, pose)| pose);
                let pieces = write(job, primitive, &needs, scale, pose, &place)?;
                shared.insert(key, pieces.clone());
                pieces
            };
            let pieces = pieces.into_iter().map(|piece| Primitive { material, ..piece });
            mesh.primitives.extend(pieces);
        }
        meshes.push(mesh);
    }
    job.step("meshes", done, total as u64)?;
    Ok(meshes)
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
    }
}

/// Writes one primitive in pieces.
fn write(
    job: &mut BakeJob<'_>,
    json: &document::Primitive,
    needs: &VertexRequirements,
    scale: f64,
    pose: Option<&Pose>,
    place: &str,
) -> Result<Vec<Primitive>, BakeError> {
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
    let mut writer = Writer {
        layout: VertexLayout {
            // Lines and points with a normal map get a tangent too: one layout per material.
            tangent: needs.normal_map.is_some(),
            uv0: geometry.uvs[0].is_some(),
            uv1: geometry.uvs[1].is_some(),
            color: geometry.colors.is_some(),
        },
        new_of: vec![u32::MAX; geometry.positions.len()],
        geometry,
        keeps_order: needs.keeps_order,
    };
    let mut written = Vec::with_capacity(pieces.ranges.len());
    for range in pieces.ranges {
        job.check()?;
        written.push(writer.write(job, &pieces.elements[range], place)?);
    }
    Ok(written)
}

/// A vertex of a piece: which of the primitive's it is, and a corner that it stands at.
#[derive(Clone, Copy)]
struct Vertex {
    source: u32,
    corner: u32,
}

struct Writer {
    geometry: Geometry,
    layout: VertexLayout,
    keeps_order: bool,
    /// The piece's number of each of the primitive's vertices; all unset between pieces.
    new_of: Vec<u32>,
}

impl Writer {
    fn write(
        &mut self,
        job: &mut BakeJob<'_>,
        elements: &[u32],
        place: &str,
    ) -> Result<Primitive, BakeError> {
        let is_shared = self.geometry.normals.is_some()
            && !matches!(self.geometry.tangents, Tangents::Corner(_));
        let (mut indices, vertices) =
            if is_shared { self.gather(elements) } else { self.weld(elements, job.cancel)? };
        let topology = self.geometry.topology;
        if topology == Topology::Triangles && !self.keeps_order {
            vertex_cache::triangles(&mut indices, vertices.len());
        }
        let order = vertex_cache::vertices(&mut indices, vertices.len());
        let vertices: Vec<Vertex> = order.iter().map(|&old| vertices[old as usize]).collect();

        let is_short = vertices.len() <= U16_VERTICES_MAX;
        let bytes_max = vertices.len() * self.layout.stride() as usize + indices.len() * 4;
        let mut bytes = Vec::with_capacity(bytes_max);
        let (min, max) = self.interleave(&vertices, &mut bytes);
        for &index in &indices {
            let index = index.to_le_bytes();
            bytes.extend_from_slice(if is_short { &index[..2] } else { &index });
        }
        Ok(Primitive {
            blob: job.write(&bytes, place)?,
            layout: self.layout,
            vertex_count: vertices.len() as u32,
            index_count: indices.len() as u32,
            coarser_index_count: 0,
            meshlet_count: 0,
            index_format: if is_short { IndexFormat::U16 } else { IndexFormat::U32 },
            topology,
            material: None,
            origin: DVec3::ZERO,
            min,
            max,
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

    /// Appends the vertices as the file has them; gives the box around them.
    ///
    /// They are not moved to the middle of the piece: that would round each, and differently in
    /// every piece. As they are, they are exact, and pieces meet in equal bits; the renderer takes
    /// what is large from them before anything is rounded.
    fn interleave(&self, vertices: &[Vertex], bytes: &mut Vec<u8>) -> (Vec3, Vec3) {
        let geometry = &self.geometry;
        let (mut min, mut max) = (Vec3::MAX, Vec3::MIN);
        for vertex in vertices {
            let source = vertex.source as usize;
            let position = Vec3::from(geometry.positions[source]);
            (min, max) = (min.min(position), max.max(position));
            let mut put = |values: &[f32]| {
                for value in values {
                    bytes.extend_from_slice(&value.to_le_bytes());
                }
            };
            put(&position.to_array());
            put(&self.normal(*vertex));
            if self.layout.tangent {
                put(&self.tangent(*vertex));
            }
            geometry.uvs.iter().flatten().for_each(|uv| put(&uv[source]));
            if let Some(colors) = &geometry.colors {
                put(&colors[source]);
            }
        }
        (min, max)
    }
}
