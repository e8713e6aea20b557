//! Crowds: many small meshes that together are a surface which is not small, such as a façade of
//! panels, a wall of cubes or a ground of tiles. None of them may be left out of a picture as small
//! by itself, since all of them would be.
//!
//! Meshes of about one size that touch are a crowd; it has a sphere, which is small only where all
//! of them are. It is found in the bake, where meshes stand in their file: all servers know the
//! same crowds, whatever was moved since. Clips may make a surface of meshes that are apart there,
//! or are points: what they move is in a crowd without end, and so never left out as small.

use foldhash::{HashMap, HashMapExt};
use glam::{DAffine3, DVec3, I64Vec3};
use polyptych_scene::{AnimatedPath, Bounds, Scene};

use super::BakeJob;
use super::bounds::{around, place_of, whole};
use super::error::BakeError;

/// The gap between meshes that touch, as a share of the least size of the smaller one's class: more
/// would join the houses of a street, each of which may be left out by itself.
const GAP: f64 = 0.02;

/// Meshes of a cell that are compared one by one: where there are more, they touch or almost.
const COMPARED_MAX: usize = 32;

/// Cells between two looks at whether to stop.
const CELLS_BETWEEN_CHECKS: usize = 1 << 12;

/// A mesh in one of its places, in the world.
#[derive(Clone, Copy, Debug)]
struct PlacedMesh {
    bounds: Bounds,
    /// Half of the edges of the mesh's own box.
    edges: [DVec3; 3],
    /// Of a sphere around the middle of the box that holds the mesh.
    radius: f64,
}

impl PlacedMesh {
    fn new(world: DAffine3, (min, max): (DVec3, DVec3)) -> Self {
        let bounds = around(world, min, max);
        let (axes, half) = (world.matrix3, (max - min) / 2.0);
        // No more than the radius that the mesh has for who draws it.
        let lengths = [axes.x_axis.length(), axes.y_axis.length(), axes.z_axis.length()];
        let radius = lengths.into_iter().fold(0.0, f64::max) * half.length();
        let edges = [axes.x_axis * half.x, axes.y_axis * half.y, axes.z_axis * half.z];
        Self { bounds, edges, radius }
    }

    /// Returns whether no side of either box parts the two by more than a gap. Boxes with their
    /// edges along axes of the world, which are all that [`Bounds`] knows, touch much sooner.
    fn touches(&self, other: &Self, gap: f64) -> bool {
        let between = other.bounds.center() - self.bounds.center();
        let is_parted = |[a, b]: [DVec3; 2]| {
            let normal = a.cross(b).normalize_or_zero();
            let halves = self.edges.iter().chain(&other.edges).map(|edge| edge.dot(normal).abs());
            between.dot(normal).abs() > halves.sum::<f64>() + gap
        };
        let sides = |[x, y, z]: [DVec3; 3]| [[x, y], [y, z], [z, x]];
        !sides(self.edges).into_iter().chain(sides(other.edges)).any(is_parted)
    }
}

/// Sets the crowd of each node and of each of its copies ([`polyptych_scene::Node::crowd`]).
///
/// # Errors
/// The bake was cancelled.
pub(super) fn find(job: &BakeJob<'_>, scene: &mut Scene) -> Result<(), BakeError> {
    let (mut placed, mut places) = (Vec::new(), Vec::new());
    let boxes: Vec<_> = scene.meshes.iter().map(whole).collect();
    for ((node, at), world) in scene.nodes.iter().zip(0_u32..).zip(scene.world_from_nodes()) {
        let Some(mesh) = node.mesh.and_then(|mesh| *boxes.get(mesh as usize)?) else { continue };
        let mut add = |copy: u32, world: DAffine3| {
            placed.push(PlacedMesh::new(world, mesh.0));
            places.push((at, copy));
        };
        if node.instances.is_empty() {
            add(0, world);
        }
        for (copy, of) in (0..).zip(&node.instances) {
            add(copy, world * place_of(of));
        }
    }
    let found = ratios(&placed, || job.check())?;
    let movers = movers(scene);
    let of_first = places.first().map(|(node, _)| movers[*node as usize]);
    // What all hangs from one mover stays as it is beside the rest of it.
    let is_one_body = places.iter().all(|(node, _)| Some(movers[*node as usize]) == of_first);
    for (((node, copy), of), ratio) in places.into_iter().zip(&placed).zip(found) {
        let is_as_found = movers[node as usize].is_none() || (is_one_body && of.radius > 0.0);
        let ratio = if is_as_found { ratio } else { f32::INFINITY };
        let node = &mut scene.nodes[node as usize];
        node.crowd = node.crowd.max(ratio);
        if let Some(copy) = node.instances.get_mut(copy as usize) {
            copy.crowd = ratio;
        }
    }
    Ok(())
}

/// Returns the nearest node at or above each one that a clip moves, turns or scales, if any.
fn movers(scene: &Scene) -> Vec<Option<u32>> {
    let mut is_moved = vec![false; scene.nodes.len()];
    for channel in scene.animations.clips.iter().flat_map(|clip| &clip.channels) {
        let target = match channel.path {
            AnimatedPath::Translation | AnimatedPath::Rotation | AnimatedPath::Scale => {
                scene.animations.nodes.get(channel.target as usize)
            }
            AnimatedPath::Weights | AnimatedPath::Property => None,
        };
        if let Some(slot) = target.and_then(|target| is_moved.get_mut(target.node as usize)) {
            *slot = true;
        }
    }
    let mut movers: Vec<Option<u32>> = Vec::with_capacity(scene.nodes.len());
    for ((node, at), is_moved) in scene.nodes.iter().zip(0..).zip(is_moved) {
        let above = node.parent.and_then(|parent| *movers.get(parent as usize)?);
        movers.push(if is_moved { Some(at) } else { above });
    }
    movers
}

/// Returns the radius of a sphere around the middle of each place that holds its crowd, in radii of
/// the mesh there, rounded up; 0 of a mesh that touches none.
///
/// # Errors
/// Those of `check`, which is called again and again.
fn ratios(
    placed: &[PlacedMesh],
    check: impl Fn() -> Result<(), BakeError>,
) -> Result<Vec<f32>, BakeError> {
    let mut crowds = Crowds::new(placed.len());
    let cells = cells(placed);
    let parts: Vec<_> = cells.list.iter().map(|cell| crowds.parts(cell, placed)).collect();
    for (index, Cell { class, at, .. }) in cells.list.iter().enumerate() {
        if index.is_multiple_of(CELLS_BETWEEN_CHECKS) {
            check()?;
        }
        for (nth, one) in parts[index].iter().enumerate() {
            crowds.join(placed, one, &parts[index][nth + 1..]);
        }
        // Each pair of cells of one class is found from one of both.
        let near = (14..27).map(|step| (*class, neighbour(*at, step)));
        // Cells of the next class are as large, or eight of these lie in one.
        let of_next = *at >> (class & 1);
        let next = (0..27).map(|step| (class + 1, neighbour(of_next, step)));
        for place in near.chain(next) {
            let Some(&other) = cells.by_place.get(&place) else { continue };
            for one in &parts[index] {
                crowds.join(placed, one, &parts[other]);
            }
        }
    }
    Ok(crowds.ratios(placed))
}

/// Meshes of one class, of diameters from one power of √2 to the next, whose middles lie in a cube
/// of the next power of two: those that touch are in one cell, or in cells beside each other.
#[derive(Debug)]
struct Cell {
    class: i32,
    at: I64Vec3,
    /// Indices of places.
    meshes: Vec<u32>,
}

/// What is compared with others.
#[derive(Clone, Copy, Debug)]
struct Part {
    /// A place of it.
    index: u32,
    class: i32,
    bounds: Bounds,
    /// It is one mesh, not many.
    is_one: bool,
}

/// All cells, in the order of their first meshes.
#[derive(Debug, Default)]
struct Cells {
    list: Vec<Cell>,
    by_place: HashMap<(i32, I64Vec3), usize>,
}

fn cells(placed: &[PlacedMesh]) -> Cells {
    let mut cells = Cells::default();
    for (index, of) in (0..).zip(placed) {
        if !(of.radius.is_normal() && of.radius > 0.0) {
            continue;
        }
        let class = (2.0 * (2.0 * of.radius).log2()).floor() as i32;
        let side = f64::from((class >> 1) + 1).exp2();
        let at = (of.bounds.center() / side).floor().as_i64vec3();
        let next = cells.list.len();
        let cell = *cells.by_place.entry((class, at)).or_insert(next);
        if cell == next {
            cells.list.push(Cell { class, at, meshes: Vec::new() });
        }
        cells.list[cell].meshes.push(index);
    }
    cells
}

/// One of a cube and the 26 that touch it, in the order of their places; 13 is the cube.
fn neighbour(at: I64Vec3, step: i64) -> I64Vec3 {
    at.saturating_add(I64Vec3::new(step % 3, step / 3 % 3, step / 9) - 1)
}

/// The crowds of places: for each another one of it, up to one that stands for it. Each place is in
/// two, so that meshes on both sides of a border of classes are one surface: in one with those of
/// its class and of the next, and, behind all of these, in one with those of its class and of the
/// one before. So what is in one crowd differs by less than two times, whatever is between: a town
/// would else be one crowd with its ground.
#[derive(Debug)]
struct Crowds {
    of: Vec<u32>,
    places: u32,
}

impl Crowds {
    fn new(count: usize) -> Self {
        let places = count as u32;
        Self { of: (0..2 * places).collect(), places }
    }

    /// Returns what of a cell is compared with others: its meshes, or all as one if they are so
    /// many that they touch or almost.
    fn parts(&mut self, cell: &Cell, placed: &[PlacedMesh]) -> Vec<Part> {
        let is_one = cell.meshes.len() <= COMPARED_MAX;
        let class = cell.class;
        let bounds = |index: u32| placed[index as usize].bounds;
        let part = |&index: &u32| Part { index, class, bounds: bounds(index), is_one };
        let all = cell.meshes.iter().map(part);
        if is_one {
            return all.collect();
        }
        let joined = all.reduce(|first, next| {
            self.unite(&first, &next);
            Part { bounds: union(first.bounds, next.bounds), ..first }
        });
        joined.into_iter().collect()
    }

    /// Joins a part with those of others that it touches, of its class or of the next.
    fn join(&mut self, placed: &[PlacedMesh], one: &Part, others: &[Part]) {
        let gap = (f64::from(one.class) / 2.0).exp2() * GAP;
        let (min, max) = (one.bounds.min - gap, one.bounds.max + gap);
        for other in others {
            let is_near = min.cmple(other.bounds.max) & other.bounds.min.cmple(max);
            let [a, b] = [one, other].map(|of| &placed[of.index as usize]);
            let is_near = is_near.all();
            if is_near && (!one.is_one || !other.is_one || a.touches(b, gap)) {
                self.unite(one, other);
            }
        }
    }

    /// Makes one crowd of those that two parts may be in together.
    fn unite(&mut self, one: &Part, other: &Part) {
        let before = other.index + self.places;
        if one.class == other.class {
            self.unite_places(one.index, other.index);
            self.unite_places(one.index + self.places, before);
        } else {
            self.unite_places(one.index, before);
        }
    }

    fn unite_places(&mut self, one: u32, other: u32) {
        let [one, other] = [one, other].map(|index| self.root(index));
        self.of[other as usize] = one;
    }

    /// The place that stands for a crowd.
    fn root(&mut self, mut index: u32) -> u32 {
        while self.of[index as usize] != index {
            // Shorter ways for those that come after.
            let above = self.of[self.of[index as usize] as usize];
            self.of[index as usize] = above;
            index = above;
        }
        index
    }

    fn ratios(&mut self, placed: &[PlacedMesh]) -> Vec<f32> {
        let roots: Vec<u32> = (0..2 * self.places).map(|index| self.root(index)).collect();
        let mut crowds: HashMap<u32, (Bounds, u32)> = HashMap::new();
        for (of, root) in placed.iter().cycle().zip(&roots) {
            let (bounds, count) = crowds.entry(*root).or_insert((of.bounds, 0));
            (*bounds, *count) = (union(*bounds, of.bounds), *count + 1);
        }
        let ratio = |of: &PlacedMesh, root: &u32| {
            let Some((bounds, 2..)) = crowds.get(root) else { return 0.0 };
            let reach = bounds.center().distance(of.bounds.center()) + bounds.radius();
            let ratio = ((reach / of.radius) as f32).next_up();
            if ratio.is_finite() { ratio } else { 0.0 }
        };
        let (with_next, with_last) = roots.split_at(placed.len());
        let both = placed.iter().zip(with_next.iter().zip(with_last));
        both.map(|(of, (next, last))| ratio(of, next).max(ratio(of, last))).collect()
    }
}

/// The box around both.
fn union(a: Bounds, b: Bounds) -> Bounds {
    Bounds { min: a.min.min(b.min), max: a.max.max(b.max) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube(center: DVec3, side: f64) -> PlacedMesh {
        let half = DVec3::splat(0.5);
        let world = DAffine3::from_scale(DVec3::splat(side));
        PlacedMesh::new(DAffine3::from_translation(center) * world, (-half, half))
    }

    fn of(placed: &[PlacedMesh]) -> Vec<f32> {
        ratios(placed, || Ok(())).expect("not cancelled")
    }

    #[test]
    fn a_wall_of_cubes_is_as_large_as_the_wall() {
        for step in [0.1, 0.0999, 0.101] {
            let at = |index: u32| DVec3::new((index % 316).into(), (index / 316).into(), 0.0);
            let cubes: Vec<_> = (0..316 * 316).map(|index| cube(at(index) * step, 0.1)).collect();
            let half = (316.0 * step / 2.0 * 2.0_f64.sqrt() / cubes[0].radius) as f32;
            assert!(of(&cubes).iter().all(|ratio| (0.99 * half..2.1 * half).contains(ratio)));
        }
    }

    #[test]
    fn what_touches_nothing_is_alone_however_it_is_turned() {
        let street = |turn: f64| -> Vec<_> {
            let house = |at: u32| {
                let place = DVec3::new(f64::from(at % 10) * 10.2, 0.0, f64::from(at / 10) * 30.0);
                let world = DAffine3::from_rotation_y(turn) * DAffine3::from_translation(place);
                PlacedMesh::new(world, (DVec3::ZERO, DVec3::new(8.4, 9.0, 8.0)))
            };
            (0..100).map(house).collect()
        };
        for turn in [0.0, 0.3, 0.8] {
            assert!(of(&street(turn)).iter().all(|ratio| *ratio == 0.0), "{turn}");
        }
        assert!(of(&[]).is_empty());
    }

    /// Panels at slabs that are much larger are a crowd, which the slabs are no part of.
    #[test]
    fn a_facade_is_one_crowd_and_its_slabs_are_none() {
        let mut all = Vec::new();
        for floor in 0..20 {
            let y = f64::from(floor) * 3.5;
            let slab = (DVec3::new(0.0, -0.3, 0.0), DVec3::new(60.0, 0.0, 40.0));
            all.push(PlacedMesh::new(DAffine3::from_translation(DVec3::Y * y), slab));
            all.extend((0..40).map(|at| {
                let place = DVec3::new(f64::from(at) * 1.5, y, 40.0);
                let panel = (DVec3::ZERO, DVec3::new(1.5, 3.5, 0.1));
                PlacedMesh::new(DAffine3::from_translation(place), panel)
            }));
        }
        for (index, ratio) in of(&all).into_iter().enumerate() {
            let is_slab = index % 41 == 0;
            assert!(if is_slab { ratio == 0.0 } else { ratio > 23.0 }, "{index}: {ratio}");
        }
    }

    /// A row along X of cubes that touch, with these diameters.
    fn row(diameters: impl IntoIterator<Item = f64>) -> Vec<PlacedMesh> {
        let mut end = 0.0;
        let cubes = diameters.into_iter().map(|diameter| {
            let side = diameter / 3.0_f64.sqrt();
            end += side;
            cube(DVec3::X * (end - side / 2.0), side)
        });
        cubes.collect()
    }

    #[test]
    fn meshes_on_both_sides_of_a_border_of_classes_are_one_crowd() {
        for (small, large) in [(0.99, 1.01), (0.7, 0.71)] {
            let wall = row((0..200).map(|at| if at % 2 == 0 { small } else { large }));
            assert!(of(&wall).iter().all(|ratio| *ratio > 60.0), "{small}: {:?}", of(&wall));
        }
    }

    /// The crowd of each mesh is no more than the meshes beside it.
    #[test]
    fn sizes_that_grow_step_by_step_are_no_crowd() {
        let steps = row((0..20).map(|at| 1.1 * (f64::from(at) / 2.0).exp2()));
        let found = of(&steps);
        assert!(found.iter().all(|ratio| (1.0..8.0).contains(ratio)), "{found:?}");
        assert_eq!(of(&row([22.0, 57.0])), [0.0; 2], "a house and its ground");
    }

    #[test]
    fn hard_numbers_are_borne() {
        let far = DVec3::new(6.4e6, -6.4e6, 1e7);
        let mut all: Vec<_> = (0..50).map(|at| cube(far + DVec3::X * f64::from(at), 1.0)).collect();
        all.extend((0..50).map(|at| cube(DVec3::X * 1e-4 * f64::from(at), 1e-4)));
        all.extend([cube(DVec3::ZERO, 0.0), cube(DVec3::NAN, 1.0), cube(DVec3::ZERO, f64::NAN)]);
        all.extend([cube(DVec3::splat(1e300), 1e290), cube(DVec3::Y, f64::INFINITY)]);
        // Thousands in one place.
        all.extend((0..5000).map(|_| cube(DVec3::Y * 70.0, 2.0)));
        let found = of(&all);
        assert!(found[..100].iter().all(|ratio| (28.0..62.0).contains(ratio)), "{:?}", &found[..9]);
        assert_eq!(found[100..105], [0.0; 5]);
        assert!(found[105..].iter().all(|ratio| (1.0..1.1).contains(ratio)), "{}", found[105]);
        assert!(ratios(&all, || Err(BakeError::Cancelled)).is_err());
    }
}
