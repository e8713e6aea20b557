//! Borders that meshes share: where tiles of a ground meet, levels of detail must not part them.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use glam::{DAffine3, DVec3, Vec3};
use polyptych_scene::{Node, Topology};

use super::accessor::Accessor;
use super::error::BakeError;
use super::mesh_use::Meshes;
use super::{BakeJob, document, topology};

/// Positions that are nearer than this share of the whole scene's diagonal are one: f32 rounds
/// them by less, tiles of 16-bit numbers by a tenth of it if there are ten along the diagonal.
const NEAR: f64 = 1e-5;

/// The positions at the ends of meshes that are drawn once, in world space.
#[derive(Debug, Default)]
pub(super) struct SharedBorders {
    /// World space from that of each mesh.
    world_from_mesh: BTreeMap<u32, DAffine3>,
    /// The side of a cell.
    side: f64,
    /// The mesh with a border in each cell; `None` for several.
    mesh_at: HashMap<[i64; 3], Option<u32>>,
}

impl SharedBorders {
    /// Looks for the borders of the meshes that these nodes draw once.
    ///
    /// # Errors
    /// [`BakeError::Cancelled`].
    pub fn find(
        job: &BakeJob<'_>,
        uses: &Meshes,
        nodes: &[Node],
        world_from_nodes: &[DAffine3],
    ) -> Result<Self, BakeError> {
        let mut world_from_mesh: BTreeMap<u32, Option<DAffine3>> = BTreeMap::new();
        for (node, world) in nodes.iter().zip(world_from_nodes) {
            if let Some(mesh) = node.mesh {
                let is_first = !world_from_mesh.contains_key(&mesh) && node.instances.is_empty();
                world_from_mesh.insert(mesh, is_first.then_some(*world));
            }
        }
        let world_from_mesh: BTreeMap<u32, DAffine3> =
            world_from_mesh.into_iter().filter_map(|(mesh, world)| Some((mesh, world?))).collect();
        let mut borders = Vec::new();
        for (mesh, world) in &world_from_mesh {
            job.check()?;
            let json = uses.uses.get(*mesh as usize).filter(|used| used.pose.is_none());
            let json = json.and_then(|used| job.source.document.meshes.get(used.mesh as usize));
            let points = json.map(|json| border(job, json)).unwrap_or_default();
            borders.extend(points.into_iter().map(|at| (world.transform_point3(at), *mesh)));
        }
        borders.retain(|(position, _)| position.is_finite());
        let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let corners = |(low, high): (DVec3, DVec3), at: DVec3| (low.min(at), high.max(at));
        let (low, high) = borders.iter().fold(empty, |all, (position, _)| corners(all, *position));
        let side = low.distance(high) * NEAR;
        let mut found = Self { world_from_mesh, side, mesh_at: HashMap::new() };
        if side > 0.0 {
            for (position, mesh) in &borders {
                let known = found.mesh_at.entry(found.cell(*position)).or_insert(Some(*mesh));
                *known = known.filter(|known| known == mesh);
            }
        }
        let meets = |(position, mesh): (DVec3, u32)| found.meets(mesh, position).then_some(mesh);
        let meeting: BTreeSet<u32> = borders.into_iter().filter_map(meets).collect();
        found.world_from_mesh.retain(|mesh, _| meeting.contains(mesh));
        Ok(found)
    }

    fn cell(&self, at: DVec3) -> [i64; 3] {
        (at / self.side).floor().to_array().map(|number| number as i64)
    }

    /// Returns whether other meshes end at positions where a mesh ends.
    pub fn has_shared(&self, mesh: u32) -> bool {
        self.world_from_mesh.contains_key(&mesh)
    }

    /// Returns whether other meshes end at a position of this one.
    pub fn is_shared(&self, mesh: u32, position: [f32; 3]) -> bool {
        let world = self.world_from_mesh.get(&mesh);
        let at = world.map(|world| world.transform_point3(Vec3::from(position).as_dvec3()));
        at.is_some_and(|at| self.meets(mesh, at))
    }

    /// Returns whether another mesh ends at a position in world space.
    fn meets(&self, mesh: u32, at: DVec3) -> bool {
        // The cells of all positions within half a side.
        (0..8).any(|corner| {
            let sign = |axis: u32| if corner >> axis & 1 == 0 { -0.5 } else { 0.5 };
            let cell = self.cell(at + DVec3::new(sign(0), sign(1), sign(2)) * self.side);
            self.mesh_at.get(&cell).is_some_and(|of| *of != Some(mesh))
        })
    }
}

/// Returns the positions at the ends of a mesh's surface: of edges with one triangle. What cannot
/// be read has none; who reads the mesh itself says why.
fn border(job: &BakeJob<'_>, mesh: &document::Mesh) -> Vec<DVec3> {
    let mut numbers: HashMap<[u32; 3], u32> = HashMap::new();
    let mut points = Vec::new();
    let mut corners: Vec<u32> = Vec::new();
    for json in &mesh.primitives {
        let Some((positions, indices)) = triangles(job, json) else { continue };
        for index in indices {
            let Some(position) = positions.get(index as usize) else { continue };
            // Adding zero makes -0 and 0 one.
            let key = position.map(|number| (number + 0.0).to_bits());
            let next = points.len() as u32;
            let number = *numbers.entry(key).or_insert(next);
            if number == next {
                points.push(Vec3::from(*position).as_dvec3());
            }
            corners.push(number);
        }
    }
    let mut edges: Vec<[u32; 2]> = Vec::with_capacity(corners.len());
    for [a, b, c] in corners.as_chunks::<3>().0 {
        edges.extend([(a, b), (b, c), (c, a)].map(|(from, to)| [*from.min(to), *from.max(to)]));
    }
    edges.sort_unstable();
    let mut is_border = vec![false; points.len()];
    let mut count = 0;
    for triangles in edges.chunk_by(|one, two| one == two) {
        if let [[from, to]] = triangles {
            (is_border[*from as usize], is_border[*to as usize]) = (true, true);
            count += 1;
        }
    }
    // A part of separate quads, as a house, has borders everywhere, two edges for each triangle; no
    // other part continues it. A road that is one quad wide has little more than one.
    if corners.len() / 2 < count {
        return Vec::new();
    }
    points
        .into_iter()
        .zip(is_border)
        .filter_map(|(at, is_border)| is_border.then_some(at))
        .collect()
}

/// Returns the positions and the corners of a primitive of triangles.
fn triangles(job: &BakeJob<'_>, json: &document::Primitive) -> Option<(Vec<[f32; 3]>, Vec<u32>)> {
    // A stream without a fault was unpacked into accessors.
    let is_packed = json.extensions.draco.as_ref().is_some_and(|draco| draco.fault.is_some());
    if topology::of_mode(json.mode) != Some(Topology::Triangles) || is_packed {
        return None;
    }
    let open = |index: u32| Accessor::open(job.source, index, "borders").ok();
    let positions = open(*json.attributes.get("POSITION")?)?.floats::<3>().ok()?;
    let (indices, restart) = match json.indices {
        None => ((0..positions.len() as u32).collect(), None),
        Some(index) => {
            let read = open(index)?.indices().ok()?;
            (read.values, Some(read.restart).filter(|_| json.mode != 4))
        }
    };
    Some((positions, topology::to_list(json.mode, indices, restart)))
}
