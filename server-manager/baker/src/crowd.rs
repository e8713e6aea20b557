//! Crowds: many small meshes that together are a surface which is not small, such as a façade of
//! panels, a wall of cubes or the leaves of a tree. None of them may be left out of a picture as
//! small by itself, since all of them would be.
//!
//! ```text
//! meshes of about one size, beside each other → a crowd → how far it reaches from each of them
//! meshes at a flat one that is much larger → none: what they stand at stays behind them
//! ```
//!
//! It is found in the bake, where meshes stand in their file: all servers know the same crowds,
//! whatever was moved since.

use std::collections::HashMap;

use glam::{DVec3, I64Vec3};
use polyptych_scene::{AlphaMode, Bounds, Mesh, Scene, Topology};

use super::BakeJob;
use super::bounds::{around, place_of, whole};
use super::error::BakeError;

/// A flat mesh so many times as large as what stands at it stays when that is left out. It may be
/// left out too, at an error that is larger by this: with all that follow, by at most a seventh.
const GROUND_FACTOR: f64 = 8.0;

/// Of what stands at a ground: 1 + 1/8 + 1/64 + …
const SUM_OF_GROUNDS: f64 = GROUND_FACTOR / (GROUND_FACTOR - 1.0);

/// Flat meshes that are looked at for each place: where there are more about it, it is a crowd's.
const GROUNDS_MAX: usize = 64;

/// The gap between neighbours of a crowd, as a share of the least size of their class.
const GAP: f64 = 0.5;

/// Places between two looks at whether to stop.
const PLACES_BETWEEN_CHECKS: usize = 1 << 14;

/// Stands for no cell.
const NONE: u32 = u32::MAX;

/// A mesh in one of its places.
#[derive(Clone, Copy, Debug)]
struct PlacedMesh {
    /// In the world.
    bounds: Bounds,
    /// It is opaque, and of triangles.
    is_solid: bool,
}

impl PlacedMesh {
    /// The diagonal of its box.
    fn size(&self) -> f64 {
        2.0 * self.bounds.radius()
    }

    fn thickness(&self) -> f64 {
        (self.bounds.max - self.bounds.min).min_element()
    }
}

/// Sets the crowd of each node ([`polyptych_scene::Node::crowd`]).
///
/// # Errors
/// The bake was cancelled.
pub(super) fn find(job: &BakeJob<'_>, scene: &mut Scene) -> Result<(), BakeError> {
    let (mut placed, mut of) = (Vec::new(), Vec::new());
    let boxes: Vec<_> = scene.meshes.iter().map(whole).collect();
    let solid: Vec<bool> = scene.meshes.iter().map(|mesh| is_solid(scene, mesh)).collect();
    for ((node, at), world) in scene.nodes.iter().zip(0_u32..).zip(scene.world_from_nodes()) {
        let Some(mesh) = node.mesh.map(|mesh| mesh as usize) else { continue };
        let Some(&Some(((min, max), _))) = boxes.get(mesh) else { continue };
        let mut add = |world: glam::DAffine3| {
            let bounds = around(world, min, max);
            placed.push(PlacedMesh { bounds, is_solid: solid[mesh] });
            // No more than the radius that the mesh has for who draws it.
            let axes = [world.matrix3.x_axis, world.matrix3.y_axis, world.matrix3.z_axis];
            let longest = axes.iter().map(|axis| axis.length()).fold(0.0, f64::max);
            of.push((at, longest * (max - min).length() / 2.0));
        };
        if node.instances.is_empty() {
            add(world);
        }
        node.instances.iter().for_each(|copy| add(world * place_of(copy)));
    }
    let reaches = reaches(&placed, || job.check())?;
    for ((node, radius), reach) in of.into_iter().zip(reaches) {
        let ratio = (reach / radius) as f32;
        let crowd = &mut scene.nodes[node as usize].crowd;
        if ratio.is_finite() && ratio > 1.0 {
            *crowd = crowd.max(ratio.next_up());
        }
    }
    Ok(())
}

/// Returns whether a mesh hides what is behind it, where it has triangles.
fn is_solid(scene: &Scene, mesh: &Mesh) -> bool {
    mesh.primitives.iter().all(|of| {
        let material = of.material.and_then(|index| scene.materials.get(index as usize));
        let is_clear =
            |of: &polyptych_scene::Material| of.alpha_mode != AlphaMode::Opaque || of.transmits();
        of.topology == Topology::Triangles && !material.is_some_and(is_clear)
    })
}

/// Returns, for each place, the radius of a sphere around the middle of its box that holds all that
/// vanishes if it is left out and all like it are, too: never less than the box.
///
/// # Errors
/// Those of `check`, which is called again and again.
fn reaches(
    placed: &[PlacedMesh],
    check: impl Fn() -> Result<(), BakeError>,
) -> Result<Vec<f64>, BakeError> {
    let is_sized = |size: f64| size.is_normal() && size > 0.0;
    let grounds = Grounds::new(placed);
    let mut crowds = Crowds::default();
    let mut found = Vec::with_capacity(placed.len());
    for (index, of) in placed.iter().enumerate() {
        if index.is_multiple_of(PLACES_BETWEEN_CHECKS) {
            check()?;
        }
        let size = of.size();
        let is_at_ground = is_sized(size) && grounds.are_at(placed, of);
        let cell = if is_sized(size) && !is_at_ground { crowds.add(of) } else { NONE };
        let error = if is_at_ground { size * SUM_OF_GROUNDS } else { size };
        found.push((error / 2.0, cell));
    }
    crowds.join(&check)?;
    let spheres = crowds.spheres();
    let reach = |((own, cell), of): ((f64, u32), &PlacedMesh)| {
        let sphere = spheres.get(cell as usize).copied().flatten();
        let away = |(center, radius): (DVec3, f64)| center.distance(of.bounds.center()) + radius;
        own.max(sphere.map_or(0.0, away))
    };
    Ok(found.into_iter().zip(placed).map(reach).collect())
}

/// The class of a size: sizes from one power of two to the next.
fn class_of(size: f64) -> i32 {
    size.log2().floor() as i32
}

/// Flat meshes, by their class and the cell of their middle.
#[derive(Debug, Default)]
struct Grounds {
    classes: Vec<i32>,
    at: HashMap<(i32, I64Vec3), Vec<u32>>,
}

impl Grounds {
    fn new(placed: &[PlacedMesh]) -> Self {
        let mut grounds = Self::default();
        for (index, of) in (0..).zip(placed) {
            let size = of.size();
            let is_flat = of.thickness() * GROUND_FACTOR <= size;
            if of.is_solid && is_flat && size.is_normal() {
                let class = class_of(size);
                let cell = Self::place(of.bounds.center(), class).floor().as_i64vec3();
                grounds.at.entry((class, cell)).or_default().push(index);
                if !grounds.classes.contains(&class) {
                    grounds.classes.push(class);
                }
            }
        }
        grounds
    }

    /// A point in cells of a class. The middle of what meets a ground of eight times its size is
    /// less than half of a cell away from the ground's.
    fn place(point: DVec3, class: i32) -> DVec3 {
        point / (f64::from(class + 1).exp2() * 1.25)
    }

    /// Returns whether a mesh stands at a ground: its box meets that of one which is much larger,
    /// and no thicker than the mesh is large.
    fn are_at(&self, placed: &[PlacedMesh], of: &PlacedMesh) -> bool {
        let (size, mut looks) = (of.size(), 0);
        let is_ground = |other: &PlacedMesh| {
            let (a, b) = (&other.bounds, &of.bounds);
            let meets = a.min.cmple(b.max) & b.min.cmple(a.max);
            other.size() >= GROUND_FACTOR * size && other.thickness() <= size && meets.all()
        };
        let least = class_of(GROUND_FACTOR * size);
        for &class in self.classes.iter().filter(|class| **class >= least) {
            // The eight cells whose middles are nearest.
            let first = (Self::place(of.bounds.center(), class) - 0.5).floor().as_i64vec3();
            for corner in 0..8 {
                let step = I64Vec3::new(corner & 1, corner >> 1 & 1, corner >> 2);
                let list = self.at.get(&(class, first.saturating_add(step)));
                for &index in list.into_iter().flatten() {
                    looks += 1;
                    if is_ground(&placed[index as usize]) {
                        return true;
                    }
                    if looks == GROUNDS_MAX {
                        return false;
                    }
                }
            }
        }
        false
    }
}

/// Meshes of one class whose middles lie in one cube of the class's largest size.
#[derive(Debug)]
struct Cell {
    class: i32,
    at: I64Vec3,
    bounds: Bounds,
    /// An index of cells: itself, or another one of its crowd.
    parent: u32,
    meshes: u32,
}

/// The box around both.
fn union(a: Bounds, b: Bounds) -> Bounds {
    Bounds { min: a.min.min(b.min), max: a.max.max(b.max) }
}

/// All cells, by their class and place.
#[derive(Debug, Default)]
struct Crowds {
    cells: Vec<Cell>,
    by_place: HashMap<(i32, I64Vec3), u32>,
}

impl Crowds {
    /// Puts a mesh into its cell; returns the cell.
    fn add(&mut self, of: &PlacedMesh) -> u32 {
        let class = class_of(of.size());
        let at = place(of.bounds.center(), class);
        let next = self.cells.len() as u32;
        let index = *self.by_place.entry((class, at)).or_insert(next);
        if index == next {
            let (parent, bounds) = (index, of.bounds);
            self.cells.push(Cell { class, at, bounds, parent, meshes: 0 });
        }
        let cell = &mut self.cells[index as usize];
        cell.bounds = union(cell.bounds, of.bounds);
        cell.meshes += 1;
        index
    }

    /// Joins the cells whose meshes are beside each other, of one class or of two that follow.
    fn join(&mut self, check: &impl Fn() -> Result<(), BakeError>) -> Result<(), BakeError> {
        for index in 0..self.cells.len() as u32 {
            if (index as usize).is_multiple_of(PLACES_BETWEEN_CHECKS) {
                check()?;
            }
            let Cell { class, at, bounds, .. } = self.cells[index as usize];
            let gap = DVec3::splat(f64::from(class).exp2() * GAP / 2.0);
            let around = Bounds { min: bounds.min - gap, max: bounds.max + gap };
            let larger = place(bounds.center(), class + 1);
            // Of one class each pair is found from one of both.
            let near = (14..27).map(|step| (class, neighbour(at, step)));
            let near = near.chain((0..27).map(|step| (class + 1, neighbour(larger, step))));
            for key in near {
                let Some(&other) = self.by_place.get(&key) else { continue };
                let of = &self.cells[other as usize].bounds;
                let meets = around.min.cmple(of.max + gap) & of.min.cmple(around.max + gap);
                if meets.all() {
                    let roots = [self.root(index), self.root(other)];
                    self.cells[roots[0] as usize].parent = roots[1];
                }
            }
        }
        Ok(())
    }

    /// The cell that stands for a crowd.
    fn root(&mut self, mut index: u32) -> u32 {
        loop {
            let parent = self.cells[index as usize].parent;
            if parent == index {
                return index;
            }
            // Shorter ways for those that come after.
            let above = self.cells[parent as usize].parent;
            self.cells[index as usize].parent = above;
            index = above;
        }
    }

    /// Returns, for each cell, the sphere around its crowd; `None` of a mesh alone.
    fn spheres(&mut self) -> Vec<Option<(DVec3, f64)>> {
        let roots: Vec<u32> = (0..self.cells.len() as u32).map(|index| self.root(index)).collect();
        let mut crowds: HashMap<u32, (Bounds, u32)> = HashMap::new();
        for (cell, &root) in self.cells.iter().zip(&roots) {
            let (bounds, meshes) = crowds.entry(root).or_insert((cell.bounds, 0));
            (*bounds, *meshes) = (union(*bounds, cell.bounds), *meshes + cell.meshes);
        }
        let sphere = |root: &u32| {
            let (bounds, meshes) = crowds.get(root)?;
            (*meshes > 1).then(|| (bounds.center(), bounds.radius()))
        };
        roots.iter().map(sphere).collect()
    }
}

/// The cube of a class in which a point lies.
fn place(point: DVec3, class: i32) -> I64Vec3 {
    (point / f64::from(class + 1).exp2()).floor().as_i64vec3()
}

/// One of a cube and the 26 that touch it, in the order of their places; 13 is the cube.
fn neighbour(at: I64Vec3, step: i64) -> I64Vec3 {
    at.saturating_add(I64Vec3::new(step % 3, step / 3 % 3, step / 9) - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn boxed(min: DVec3, max: DVec3) -> PlacedMesh {
        PlacedMesh { bounds: Bounds { min, max }, is_solid: true }
    }

    fn cube(center: DVec3, side: f64) -> PlacedMesh {
        boxed(center - side / 2.0, center + side / 2.0)
    }

    fn of(placed: &[PlacedMesh]) -> Vec<f64> {
        reaches(placed, || Ok(())).expect("not cancelled")
    }

    #[test]
    fn a_wall_of_cubes_is_as_large_as_the_wall() {
        let at = |index: u32| DVec3::new(f64::from(index % 316), f64::from(index / 316), 0.0) * 0.1;
        let cubes: Vec<_> = (0..316 * 316).map(|index| cube(at(index), 0.1)).collect();
        let half = 31.6 / 2.0 * 2.0_f64.sqrt();
        assert!(of(&cubes).iter().all(|reach| (half..2.1 * half).contains(reach)));
    }

    #[test]
    fn cubes_apart_from_each_other_are_alone() {
        let apart: Vec<_> = (0..100).map(|at| cube(DVec3::X * f64::from(at), 0.1)).collect();
        let own = 0.05 * 3.0_f64.sqrt();
        assert!(of(&apart).iter().all(|reach| (reach - own).abs() < 1e-9));
        assert!(of(&[]).is_empty());
    }

    #[test]
    fn what_stands_on_the_ground_is_no_crowd_and_a_little_larger_than_alone() {
        let mut all: Vec<_> =
            (0..20).map(|at| cube(DVec3::new(at.into(), 0.5, 0.0), 1.0)).collect();
        all.push(boxed(DVec3::new(-50.0, -0.1, -50.0), DVec3::new(90.0, 0.0, 50.0)));
        let own = 3.0_f64.sqrt() / 2.0 * 8.0 / 7.0;
        assert!(of(&all)[..20].iter().all(|reach| (reach - own).abs() < 1e-9));
        // Glass is no ground, and neither is a box around a room, from which they may be far.
        all[20].is_solid = false;
        assert!(of(&all)[..20].iter().all(|reach| *reach > 10.0));
        all[20] = cube(DVec3::ZERO, 100.0);
        assert!(of(&all)[..20].iter().all(|reach| *reach > 10.0));
    }

    /// Of a ground in many places and of many sizes, the cells that are looked at are enough.
    #[test]
    fn a_ground_is_found_wherever_it_is_met() {
        // Knuth's numbers, the upper bits of them.
        let mut state = 7_u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888);
            (state >> 11) as f64 / 2_f64.powi(53)
        };
        let mut anywhere = || DVec3::from([0; 3].map(|_| random()));
        for _ in 0..2000 {
            let min = (anywhere() - 0.5) * 1e4;
            let size = (anywhere() * 90.0 + 10.0).with_y(1.0);
            let ground = boxed(min, min + size);
            let met = min + size * anywhere();
            assert!(of(&[cube(met, 0.6), ground])[0] > 0.6 * 3.0_f64.sqrt() / 2.0 * 1.1);
        }
    }

    #[test]
    fn sizes_of_a_crowd_may_differ_and_others_are_no_part_of_it() {
        let side = |at: u32| if at.is_multiple_of(2) { 0.9 } else { 1.6 };
        let mut all: Vec<_> = (0..60).map(|at| cube(DVec3::X * f64::from(at), side(at))).collect();
        all.push(cube(DVec3::new(30.0, 0.5, 0.0), 0.05));
        let found = of(&all);
        assert!(found[..60].iter().all(|reach| *reach > 30.0), "{found:?}");
        assert!(found[60] < 0.05, "{}", found[60]);
    }

    #[test]
    fn hard_numbers_are_borne() {
        let far = DVec3::new(6.4e6, -6.4e6, 1e7);
        let mut all: Vec<_> = (0..50).map(|at| cube(far + DVec3::X * f64::from(at), 1.0)).collect();
        all.extend((0..50).map(|at| cube(DVec3::X * 1e-4 * f64::from(at), 1e-4)));
        let (all_of_it, nothing) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        all.extend([cube(DVec3::ZERO, 0.0), boxed(all_of_it, nothing), boxed(nothing, all_of_it)]);
        all.push(cube(DVec3::splat(1e300), 1e290));
        // Thousands in one place.
        all.extend((0..5000).map(|_| cube(DVec3::Y * 70.0, 2.0)));
        let found = of(&all);
        assert!(found[..50].iter().all(|reach| (25.0..60.0).contains(reach)), "{:?}", &found[..9]);
        assert!(found[50..100].iter().all(|reach| (0.0025..0.006).contains(reach)));
        assert!(found[105..].iter().all(|reach| (1.7..4.0).contains(reach)), "{}", found[105]);
        assert!(reaches(&all, || Err(BakeError::Cancelled)).is_err());
    }
}
