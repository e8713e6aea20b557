//! Crowds: many small items that together are a surface which is not small, such as a façade of
//! panels, a wall of cubes or the leaves of a tree. None of them may be left out as small by
//! itself, since all of them would be.
//!
//! ```text
//! items of about one size, beside each other → a crowd → how far it reaches from each of them
//! items at a flat one that is much larger → none: what they stand at stays behind them
//! ```

use std::collections::HashMap;
use std::ops::ControlFlow;

use glam::{DVec3, I64Vec3};

use super::bvh::Bvh;
use super::draw_item::Bounds;

/// A flat item so many times as large as what stands at it stays when that is left out. It may be
/// left out too, at an error that is larger by this: with all that follow, by at most a seventh.
const GROUND_FACTOR: f64 = 8.0;

/// Of what stands at a ground: 1 + 1/8 + 1/64 + …
const SUM_OF_GROUNDS: f64 = GROUND_FACTOR / (GROUND_FACTOR - 1.0);

/// Flat items that are looked at for each item: where there are more about one place, it is a
/// crowd's.
const GROUNDS_MAX: usize = 64;

/// The gap between neighbours of a crowd, as a share of the smallest size of their class.
const GAP: f64 = 0.5;

/// Items between two looks at whether to stop.
const ITEMS_BETWEEN_CHECKS: usize = 1 << 14;

/// Stands for no cell.
const NONE: u32 = u32::MAX;

/// The items of one class of sizes, from one power of two to the next, whose middles lie in one
/// cube of the larger of both.
#[derive(Debug)]
struct Cell {
    class: i32,
    at: I64Vec3,
    bounds: Bounds,
    /// An index of cells: itself, or another one of its crowd.
    parent: u32,
    items: u32,
}

/// Returns, for each box, the radius of a sphere around its middle that holds all that vanishes if
/// it is left out and all like it are, too: never less than the box.
///
/// `None` if `is_cancelled` says so meanwhile.
pub(super) fn reaches(bounds: &[Bounds], is_cancelled: &dyn Fn() -> bool) -> Option<Vec<f32>> {
    let sizes: Vec<f64> = bounds.iter().map(|of| 2.0 * of.half().length()).collect();
    let is_sized = |size: f64| size.is_normal() && size > 0.0;
    let is_flat = |&at: &usize| {
        let thickness = 2.0 * bounds[at].half().min_element();
        is_sized(sizes[at]) && thickness * GROUND_FACTOR <= sizes[at]
    };
    let grounds: Vec<usize> = (0..bounds.len()).filter(is_flat).collect();
    let boxes: Vec<Bounds> = grounds.iter().map(|&at| bounds[at]).collect();
    let tree = Bvh::new(&boxes, is_cancelled)?;
    let stands_at_ground = |at: usize| {
        let mut looks = 0;
        let found = tree.find_meeting(&bounds[at], |ground| {
            looks += 1;
            let other = grounds[ground as usize];
            let thickness = 2.0 * bounds[other].half().min_element();
            if sizes[other] >= GROUND_FACTOR * sizes[at] && thickness <= sizes[at] {
                ControlFlow::Break(true)
            } else if looks == GROUNDS_MAX {
                ControlFlow::Break(false)
            } else {
                ControlFlow::Continue(())
            }
        });
        found == Some(true)
    };
    let mut reaches = Vec::with_capacity(bounds.len());
    let mut cell_of = vec![NONE; bounds.len()];
    let mut crowds = Crowds::default();
    for (at, &size) in sizes.iter().enumerate() {
        if at.is_multiple_of(ITEMS_BETWEEN_CHECKS) && is_cancelled() {
            return None;
        }
        let is_at_ground = is_sized(size) && stands_at_ground(at);
        if is_sized(size) && !is_at_ground {
            cell_of[at] = crowds.add(&bounds[at], size);
        }
        let error = if is_at_ground { size * SUM_OF_GROUNDS } else { size };
        reaches.push(rounded_up(error / 2.0));
    }
    crowds.join();
    let spheres = crowds.spheres();
    for ((reach, cell), of) in reaches.iter_mut().zip(cell_of).zip(bounds) {
        if let Some((center, radius)) = spheres.get(cell as usize).copied().flatten() {
            *reach = reach.max(rounded_up(center.distance(of.center()) + radius));
        }
    }
    Some(reaches)
}

/// The next larger `f32`.
fn rounded_up(value: f64) -> f32 {
    (value as f32).next_up()
}

/// All cells, by their class and place.
#[derive(Debug, Default)]
struct Crowds {
    cells: Vec<Cell>,
    by_place: HashMap<(i32, I64Vec3), u32>,
}

impl Crowds {
    /// Puts a box of this size into its cell; returns the cell.
    fn add(&mut self, bounds: &Bounds, size: f64) -> u32 {
        let class = size.log2().floor() as i32;
        let at = place(bounds.center(), class);
        let next = self.cells.len() as u32;
        let index = *self.by_place.entry((class, at)).or_insert(next);
        if index == next {
            let (parent, items) = (index, 0);
            self.cells.push(Cell { class, at, bounds: Bounds::EMPTY, parent, items });
        }
        let cell = &mut self.cells[index as usize];
        cell.bounds = cell.bounds.union(*bounds);
        cell.items += 1;
        index
    }

    /// Joins the cells whose items are beside each other, of one class or of two that follow.
    fn join(&mut self) {
        for index in 0..self.cells.len() as u32 {
            let Cell { class, at, bounds, .. } = self.cells[index as usize];
            let gap = DVec3::splat(f64::from(class).exp2() * GAP / 2.0);
            let around = Bounds { min: bounds.min - gap, max: bounds.max + gap };
            let larger = place(bounds.center(), class + 1);
            for (class, at) in [(class, at), (class + 1, larger)] {
                for near in neighbours(at) {
                    let Some(&other) = self.by_place.get(&(class, near)) else { continue };
                    let of = &self.cells[other as usize].bounds;
                    let meets = around.min.cmple(of.max + gap) & of.min.cmple(around.max + gap);
                    if other != index && meets.all() {
                        let roots = [self.root(index), self.root(other)];
                        self.cells[roots[0] as usize].parent = roots[1];
                    }
                }
            }
        }
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

    /// Returns, for each cell, the sphere around its crowd; `None` of an item alone.
    fn spheres(&mut self) -> Vec<Option<(DVec3, f64)>> {
        let roots: Vec<u32> = (0..self.cells.len() as u32).map(|index| self.root(index)).collect();
        let mut crowds = vec![(Bounds::EMPTY, 0); self.cells.len()];
        for (cell, &root) in self.cells.iter().zip(&roots) {
            let (bounds, items) = &mut crowds[root as usize];
            (*bounds, *items) = (bounds.union(cell.bounds), *items + cell.items);
        }
        let sphere = |&root: &u32| {
            let (bounds, items) = &crowds[root as usize];
            (*items > 1).then(|| (bounds.center(), bounds.half().length()))
        };
        roots.iter().map(sphere).collect()
    }
}

/// The cube of a class in which a point lies.
fn place(point: DVec3, class: i32) -> I64Vec3 {
    (point / f64::from(class + 1).exp2()).floor().as_i64vec3()
}

/// A cube, and those that touch it.
fn neighbours(at: I64Vec3) -> impl Iterator<Item = I64Vec3> {
    (0..27).map(move |index| {
        let step = I64Vec3::new(index % 3, index / 3 % 3, index / 9) - 1;
        at.saturating_add(step)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube(center: DVec3, side: f64) -> Bounds {
        Bounds { min: center - side / 2.0, max: center + side / 2.0 }
    }

    fn of(bounds: &[Bounds]) -> Vec<f64> {
        let found = reaches(bounds, &|| false).expect("not cancelled");
        found.into_iter().map(f64::from).collect()
    }

    /// 31.6 m of cubes, standing on the ground or in the air.
    fn wall_of_cubes() -> Vec<Bounds> {
        let at = |index: u32| DVec3::new(f64::from(index % 316), f64::from(index / 316), 0.0) * 0.1;
        (0..316 * 316).map(|index| cube(at(index), 0.1)).collect()
    }

    #[test]
    fn a_wall_of_cubes_is_as_large_as_the_wall() {
        let found = of(&wall_of_cubes());
        let half = 31.6 / 2.0 * 2.0_f64.sqrt();
        assert!(found.iter().all(|reach| (half..2.1 * half).contains(reach)), "{:?}", found[0]);
    }

    #[test]
    fn cubes_apart_from_each_other_are_alone() {
        let apart: Vec<_> = (0..100).map(|at| cube(DVec3::X * f64::from(at), 0.1)).collect();
        let own = 0.05 * 3.0_f64.sqrt();
        assert!(of(&apart).iter().all(|reach| (own..1.001 * own).contains(reach)));
        assert!(of(&[]).is_empty());
    }

    #[test]
    fn what_stands_on_the_ground_is_no_crowd_and_a_little_larger_than_alone() {
        let ground =
            Bounds { min: DVec3::new(-50.0, -0.1, -50.0), max: DVec3::new(90.0, 0.0, 50.0) };
        let mut all: Vec<_> =
            (0..20).map(|at| cube(DVec3::new(at.into(), 0.5, 0.0), 1.0)).collect();
        all.push(ground);
        let found = of(&all);
        let own = 3.0_f64.sqrt() / 2.0 * 8.0 / 7.0;
        assert!(found[..20].iter().all(|reach| (own..1.001 * own).contains(reach)), "{found:?}");
        // A box around a room is no ground: what floats in it is far from its walls.
        all[20] = cube(DVec3::ZERO, 100.0);
        assert!(of(&all)[..20].iter().all(|reach| *reach > 10.0));
    }

    #[test]
    fn sizes_of_a_crowd_may_differ_and_others_are_no_part_of_it() {
        let mut all: Vec<_> = (0..60)
            .map(|at| cube(DVec3::X * f64::from(at), if at % 2 == 0 { 0.9 } else { 1.6 }))
            .collect();
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
        all.extend([cube(DVec3::ZERO, 0.0), Bounds::EMPTY, Bounds::UNBOUNDED]);
        all.push(cube(DVec3::splat(1e300), 1e290));
        // Thousands in one place.
        all.extend((0..5000).map(|_| cube(DVec3::Y * 70.0, 2.0)));
        let found = of(&all);
        assert!(found[..50].iter().all(|reach| (25.0..60.0).contains(reach)), "{:?}", &found[..9]);
        assert!(found[50..100].iter().all(|reach| (0.0025..0.006).contains(reach)));
        assert!(found[105..].iter().all(|reach| (1.7..4.0).contains(reach)), "{}", found[105]);
        assert!(reaches(&all, &|| true).is_none());
    }
}
