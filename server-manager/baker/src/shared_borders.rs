//! Borders that meshes share: where tiles of a ground meet, levels of detail must not part them.

use std::collections::{BTreeMap, HashMap, HashSet};

use glam::{DAffine3, DVec3, Vec3};
use polyptych_scene::{Node, Topology};

use super::accessor::Accessor;
use super::error::BakeError;
use super::mesh_use::Meshes;
use super::{BakeJob, document, topology};

/// Positions of two borders that are nearer than this share of the smaller one's diagonal are one:
/// tiles of 16-bit numbers round them by less, and so does f32 up to some hundred diagonals from
/// the origin.
const NEAR: f64 = 1e-4;

/// Sides of cells are powers of this number, so that few grids are needed: one for each side.
const SIDE_BASE: f64 = 4.0;

/// The positions at the ends of meshes that are drawn once, where other such meshes end too.
#[derive(Debug, Default)]
pub(super) struct SharedBorders {
    /// The keys of positions in the space of each mesh.
    shared: BTreeMap<u32, HashSet<[u32; 3]>>,
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
        let mut borders = Vec::new();
        for (mesh, world) in world_from_mesh {
            job.check()?;
            let Some(world) = world else { continue };
            let json = uses.uses.get(mesh as usize).filter(|used| used.pose.is_none());
            let json = json.and_then(|used| job.source.document.meshes.get(used.mesh as usize));
            let points = json.map(|json| border(job, json)).unwrap_or_default();
            borders.extend(Border::new(mesh, world, points));
        }
        let mut sides: Vec<f64> = borders.iter().map(|of| of.side).collect();
        sides.sort_by(f64::total_cmp);
        sides.dedup();
        let mut found = Self::default();
        for side in sides {
            job.check()?;
            found.add(&borders, side);
        }
        Ok(found)
    }

    /// Adds the positions that borders with cells of at least this side share in cells of this
    /// side: where two borders meet, the side of the smaller one decides.
    fn add(&mut self, borders: &[Border], side: f64) {
        let borders = || borders.iter().filter(move |of| of.side >= side);
        let mut grid = BorderGrid { side, mesh_at: HashMap::new() };
        for Border { mesh, points, .. } in borders() {
            for (_, at) in points {
                grid.add(*mesh, *at);
            }
        }
        for Border { mesh, points, .. } in borders() {
            let meeting = points.iter().filter(|(_, at)| grid.meets(*mesh, *at));
            let mut keys = meeting.map(|(position, _)| key(*position)).peekable();
            if keys.peek().is_some() {
                self.shared.entry(*mesh).or_default().extend(keys);
            }
        }
    }

    /// Returns whether other meshes end at positions where a mesh ends.
    pub fn has_shared(&self, mesh: u32) -> bool {
        self.shared.contains_key(&mesh)
    }

    /// Returns whether this mesh ends at a position of it, and another one does too.
    pub fn is_shared(&self, mesh: u32, position: [f32; 3]) -> bool {
        self.shared.get(&mesh).is_some_and(|of| of.contains(&key(position)))
    }
}

/// The border of a mesh that is drawn once.
struct Border {
    mesh: u32,
    /// Its positions in the space of the mesh, and in the world.
    points: Vec<([f32; 3], DVec3)>,
    /// The side of the cells in which positions are looked for.
    side: f64,
}

impl Border {
    /// Returns the border with these positions; `None` if it has no size.
    fn new(mesh: u32, world: DAffine3, points: Vec<[f32; 3]>) -> Option<Self> {
        let in_world = |at: [f32; 3]| (at, world.transform_point3(Vec3::from(at).as_dvec3()));
        let points: Vec<_> =
            points.into_iter().map(in_world).filter(|(_, at)| at.is_finite()).collect();
        let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (low, high) =
            points.iter().fold(empty, |(low, high), (_, at)| (low.min(*at), high.max(*at)));
        let near = low.distance(high) * NEAR;
        let side = SIDE_BASE.powi(near.log(SIDE_BASE).ceil() as i32);
        side.is_normal().then_some(Self { mesh, points, side })
    }
}

/// The borders in each cell of space.
struct BorderGrid {
    /// The side of a cell.
    side: f64,
    /// The mesh with a border in each cell; `None` for several.
    mesh_at: HashMap<[i64; 3], Option<u32>>,
}

impl BorderGrid {
    fn cell(&self, at: DVec3) -> [i64; 3] {
        (at / self.side).floor().to_array().map(|number| number as i64)
    }

    fn add(&mut self, mesh: u32, at: DVec3) {
        let known = self.mesh_at.entry(self.cell(at)).or_insert(Some(mesh));
        *known = known.filter(|known| *known == mesh);
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

/// The bits of a position. Adding zero makes -0 and 0 one.
fn key(position: [f32; 3]) -> [u32; 3] {
    position.map(|number| (number + 0.0).to_bits())
}

/// Returns the positions at the ends of a mesh's surface: of edges with one triangle. What cannot
/// be read has none; who reads the mesh itself says why.
fn border(job: &BakeJob<'_>, mesh: &document::Mesh) -> Vec<[f32; 3]> {
    let mut numbers: HashMap<[u32; 3], u32> = HashMap::new();
    let mut points = Vec::new();
    let mut corners: Vec<u32> = Vec::new();
    for json in &mesh.primitives {
        let Some((positions, indices)) = triangles(job, json) else { continue };
        for index in indices {
            let Some(position) = positions.get(index as usize) else { continue };
            let next = points.len() as u32;
            let number = *numbers.entry(key(*position)).or_insert(next);
            if number == next {
                points.push(*position);
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
