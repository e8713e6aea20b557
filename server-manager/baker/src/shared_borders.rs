//! Borders that meshes share: where tiles of a ground meet, levels of detail must not part them.

use std::collections::BTreeMap;

use foldhash::{HashMap, HashMapExt};
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

/// Positions whose cells are held at a time, some 200 MB: more are looked at in several passes.
const PASS_POINTS: usize = 3 << 20;

/// Sides of cells are powers of this number, so that few grids are needed: one for each side.
const SIDE_BASE: f64 = 4.0;

/// The positions at the ends of meshes that are drawn once, where other such meshes end too.
#[derive(Debug, Default)]
pub(super) struct SharedBorders {
    /// The keys of positions in the space of each mesh, rising.
    shared: BTreeMap<u32, Vec<[u32; 3]>>,
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
            found.add(&borders, (side, PASS_POINTS), || job.check())?;
        }
        Ok(found.sorted())
    }

    /// Adds the positions that borders with cells of at least this side share in cells of this
    /// side: where two borders meet, the side of the smaller one decides. In each pass, no more
    /// than about so many positions are in cells.
    ///
    /// # Errors
    /// Those of `check`, which is called again and again.
    fn add(
        &mut self,
        borders: &[Border],
        (side, pass_points): (f64, usize),
        check: impl Fn() -> Result<(), BakeError>,
    ) -> Result<(), BakeError> {
        let borders = || borders.iter().filter(move |of| of.side >= side);
        let passes = borders().map(|of| of.points.len()).sum::<usize>().div_ceil(pass_points);
        for pass in 0..passes as u64 {
            let passes = passes as u64;
            let mut grid = BorderGrid { side, pass, passes, mesh_at: HashMap::new() };
            for border in borders() {
                check()?;
                for (_, at) in border.points() {
                    grid.add(border.mesh, at);
                }
            }
            for border in borders() {
                check()?;
                let meeting = border.points().filter(|(_, at)| grid.meets(border.mesh, *at));
                let mut keys = meeting.map(|(position, _)| key(position)).peekable();
                if keys.peek().is_some() {
                    self.shared.entry(border.mesh).or_default().extend(keys);
                }
            }
        }
        Ok(())
    }

    /// The same with positions in order, each once.
    fn sorted(mut self) -> Self {
        for keys in self.shared.values_mut() {
            keys.sort_unstable();
            keys.dedup();
            keys.shrink_to_fit();
        }
        self
    }

    /// Returns whether other meshes end at positions where a mesh ends.
    pub fn has_shared(&self, mesh: u32) -> bool {
        self.shared.contains_key(&mesh)
    }

    /// Returns whether this mesh ends at a position of it, and another one does too.
    pub fn is_shared(&self, mesh: u32, position: [f32; 3]) -> bool {
        self.shared.get(&mesh).is_some_and(|of| of.binary_search(&key(position)).is_ok())
    }
}

/// The border of a mesh that is drawn once.
///
/// Borders of all meshes are held at once, so it has no more than it needs: places in the world are
/// computed again and again.
struct Border {
    mesh: u32,
    world_from_mesh: DAffine3,
    /// Its positions in the space of the mesh.
    points: Box<[[f32; 3]]>,
    /// The side of the cells in which positions are looked for.
    side: f64,
}

impl Border {
    /// Returns the border with these positions; `None` if it has no size.
    fn new(mesh: u32, world_from_mesh: DAffine3, mut points: Vec<[f32; 3]>) -> Option<Self> {
        points.retain(|at| in_world(&world_from_mesh, *at).is_finite());
        let points = points.into_boxed_slice();
        let border = Self { mesh, world_from_mesh, points, side: 0.0 };
        let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (low, high) =
            border.points().fold(empty, |(low, high), (_, at)| (low.min(at), high.max(at)));
        let near = low.distance(high) * NEAR;
        let side = SIDE_BASE.powi(near.log(SIDE_BASE).ceil() as i32);
        side.is_normal().then_some(Self { side, ..border })
    }

    /// Its positions in the space of the mesh, and in the world.
    fn points(&self) -> impl Iterator<Item = ([f32; 3], DVec3)> {
        self.points.iter().map(|at| (*at, in_world(&self.world_from_mesh, *at)))
    }
}

fn in_world(world_from_mesh: &DAffine3, at: [f32; 3]) -> DVec3 {
    world_from_mesh.transform_point3(Vec3::from(at).as_dvec3())
}

/// The borders in the cells of space that are looked at in one pass.
struct BorderGrid {
    /// The side of a cell.
    side: f64,
    /// One of `passes`, which have about as many cells each.
    pass: u64,
    passes: u64,
    /// The mesh with a border in each cell; `None` for several.
    mesh_at: HashMap<[i64; 3], Option<u32>>,
}

impl BorderGrid {
    fn cell(&self, at: DVec3) -> [i64; 3] {
        (at / self.side).floor().to_array().map(|number| number as i64)
    }

    /// Returns whether a cell is looked at in this pass.
    fn has(&self, cell: [i64; 3]) -> bool {
        // A multiplicative hash: cells beside each other are in other passes.
        let mix = |sum: u64, number: i64| (sum ^ number as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        self.passes == 1 || (cell.into_iter().fold(0, mix) >> 32) % self.passes == self.pass
    }

    fn add(&mut self, mesh: u32, at: DVec3) {
        let cell = self.cell(at);
        if self.has(cell) {
            let known = self.mesh_at.entry(cell).or_insert(Some(mesh));
            *known = known.filter(|known| *known == mesh);
        }
    }

    /// Returns whether another mesh ends at a position in world space, in a cell of this pass.
    fn meets(&self, mesh: u32, at: DVec3) -> bool {
        // The cells of all positions within half a side.
        (0..8).any(|corner| {
            let sign = |axis: u32| if corner >> axis & 1 == 0 { -0.5 } else { 0.5 };
            let cell = self.cell(at + DVec3::new(sign(0), sign(1), sign(2)) * self.side);
            self.has(cell) && self.mesh_at.get(&cell).is_some_and(|of| *of != Some(mesh))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn several_passes_find_what_one_finds() {
        // Tiles of a ground, each shifted by less than what is near.
        let tile = |mesh: u32| {
            let (x, z) = (f64::from(mesh % 5), f64::from(mesh / 5));
            let world = DAffine3::from_translation(DVec3::new(x * 10.0 + 2e-4 * z, 0.0, z * 10.0));
            let along = (0..=50u8).map(|step| f32::from(step) * 0.2);
            let sides = along.flat_map(|at| [[at, 0.0, 0.0], [at, 0.0, 10.0], [0.0, 0.0, at]]);
            let side = (0..=50u8).map(|step| [10.0, 0.0, f32::from(step) * 0.2]);
            Border::new(mesh, world, sides.chain(side).collect()).expect("a size")
        };
        let borders: Vec<Border> = (0..25).map(tile).collect();
        let found = |pass_points: usize| {
            let mut found = SharedBorders::default();
            found.add(&borders, (borders[0].side, pass_points), || Ok(())).expect("not cancelled");
            found.sorted().shared
        };
        let whole = found(usize::MAX);
        assert_eq!(whole.len(), 25, "each tile meets another");
        for pass_points in [100, 4000] {
            assert_eq!(found(pass_points), whole, "{pass_points}");
        }
        let mut stopped = SharedBorders::default();
        let stop = || Err(BakeError::Cancelled);
        assert!(stopped.add(&borders, (borders[0].side, 1), stop).is_err());
    }
}
