//! A grid in the world whose cells list the lamps near them: a pixel of a large surface pays for
//! those that are near it, not for all that reach some of the surface.
//!
//! The grid is a function of the lights of the file, never of a viewer, so all channels and both
//! eyes have the same one. Lists are in rising order, and what they leave out has no light in the
//! cell, so pictures are to the bit those without it. Olsson, Billeter and Assarsson, "Clustered
//! Deferred and Forward Shading", HPG (2012), have clusters of one view instead.

use glam::{DVec3, UVec3};

use super::draw_item::Bounds;
use super::light::LocalLight;

/// Minimum number of lamps with a reach for which there is a grid, and more than the lamps that an
/// item can have in a list of its own without it: a list costs nothing to look up, but 8 lamps
/// over a ground of 200 m take 2 to 4 times as long without a grid, which costs what they all reach
/// nothing that could be measured.
pub(super) const GRID_LAMPS_MIN: usize = 4;

/// Maximum reach of a lamp in the grid, over the median of all: one lamp that reaches far would
/// make the cells of all others large.
const REACH_RATIO_MAX: f64 = 8.0;

/// Side of a cell over the median reach, at least: cells of a lamp then have 1.8 times its volume.
const SIDE_RATIO_MIN: f64 = 0.25;

/// Maximum number of cells: 1 MiB here and on the GPU.
const CELLS_MAX: usize = 256 << 10;

/// Maximum number of entries of the lists of all cells: 4 MiB here and on the GPU.
const ENTRIES_MAX: f64 = (1 << 20) as f64;

/// Share of a cell's side by which its lamps are looked for beyond it: shaders round places to f32.
const MARGIN: f64 = 1.0 / 64.0;

/// In the count of an item's list of lamps: those of the cells of its places shine on it too. Twin
/// of the constant in `include/surface.wgsl`.
pub(crate) const IN_CELLS: u32 = 1 << 31;

/// A grid of cubes with sides along the world's axes.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LampGrid {
    /// The least corner.
    pub origin: DVec3,
    /// Side of a cell, in units of the world.
    pub side: f64,
    /// Number of cells along each axis.
    pub cells: UVec3,
    /// The lamps that it holds: a flag for each.
    holds: Vec<bool>,
}

impl LampGrid {
    /// The grid of these lamps, and its lists: the place of the first entry of each cell, x
    /// fastest, then of the end, then the entries. `None` if few lamps have a reach.
    pub fn new(lamps: &[LocalLight]) -> Option<(Self, Vec<u32>)> {
        let mut reaches: Vec<f64> = lamps.iter().filter_map(LocalLight::bounded_reach).collect();
        if reaches.len() < GRID_LAMPS_MIN {
            return None;
        }
        let middle = reaches.len() / 2;
        let median = *reaches.select_nth_unstable_by(middle, f64::total_cmp).1;
        let reach_max = median * REACH_RATIO_MAX;
        let is_held = |lamp: &LocalLight| lamp.bounded_reach().is_some_and(|of| of <= reach_max);
        let holds: Vec<bool> = lamps.iter().map(is_held).collect();
        let held = || lamps.iter().filter(|lamp| is_held(lamp));
        let all = held().map(Bounds::of_lamp).fold(Bounds::EMPTY, Bounds::union);
        let extent = all.max - all.min;
        let mut side = median * SIDE_RATIO_MIN;
        if !(all.min.is_finite() && extent.is_finite() && side.is_normal()) {
            return None;
        }
        // Each doubling makes both smaller, and the box is as wide as a lamp reaches.
        while !fits(extent, side, held()) {
            side *= 2.0;
            if side > extent.max_element() * 2.0 {
                return None;
            }
        }
        let cells = (extent / side).ceil().max(DVec3::ONE).as_uvec3();
        let grid = Self { origin: all.min, side, cells, holds };
        let lists = grid.lists(lamps);
        Some((grid, lists))
    }

    /// Returns whether a lamp, by its index, is in the lists of the cells that it reaches.
    pub fn holds(&self, lamp: u32) -> bool {
        self.holds.get(lamp as usize).copied().unwrap_or(false)
    }

    fn lists(&self, lamps: &[LocalLight]) -> Vec<u32> {
        let held = || (0u32..).zip(lamps).filter(|(index, _)| self.holds(*index));
        let count = self.cells.element_product() as usize;
        let mut lists = vec![0; count + 1];
        for (_, lamp) in held() {
            self.for_each_cell(lamp, |cell| lists[cell + 1] += 1);
        }
        lists[0] = count as u32 + 1;
        for cell in 0..count {
            lists[cell + 1] += lists[cell];
        }
        let mut next = lists[..count].to_vec();
        lists.resize(lists[count] as usize, 0);
        for (index, lamp) in held() {
            self.for_each_cell(lamp, |cell| {
                lists[next[cell] as usize] = index;
                next[cell] += 1;
            });
        }
        lists
    }

    /// Gives the cells in which a lamp may have light, by their index.
    fn for_each_cell(&self, lamp: &LocalLight, mut give: impl FnMut(usize)) {
        let reach = Bounds::of_lamp(lamp);
        let margin = DVec3::splat(self.side * MARGIN);
        let last = (self.cells - 1).as_dvec3();
        let cell_at = |place: DVec3| ((place - self.origin) / self.side).floor();
        let from = cell_at(reach.min - margin).clamp(DVec3::ZERO, last).as_uvec3();
        let to = cell_at(reach.max + margin).clamp(DVec3::ZERO, last).as_uvec3();
        for z in from.z..=to.z {
            for y in from.y..=to.y {
                for x in from.x..=to.x {
                    let min = self.origin + DVec3::new(x.into(), y.into(), z.into()) * self.side;
                    let cell = Bounds { min: min - margin, max: min + self.side + margin };
                    if lamp.reaches(&cell) && lamp.shines_towards(&cell) {
                        give(((z * self.cells.y + y) * self.cells.x + x) as usize);
                    }
                }
            }
        }
    }
}

/// Returns whether cells of this side, and their lists, are few enough.
fn fits<'a>(extent: DVec3, side: f64, lamps: impl Iterator<Item = &'a LocalLight>) -> bool {
    let cells = (extent / side).ceil().max(DVec3::ONE).element_product();
    let of_lamp =
        |lamp: &LocalLight| (lamp.bounded_reach().unwrap_or(0.0) * 2.0 / side + 2.0).powi(3);
    cells <= CELLS_MAX as f64 && lamps.map(of_lamp).sum::<f64>() <= ENTRIES_MAX
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DQuat, Vec3};
    use polyptych_scene::{Light, LightKind};

    use super::super::light::Condition;
    use super::*;

    /// Numbers from 0 to 1, always the same.
    fn numbers() -> impl FnMut() -> f64 {
        let mut state = 0x2545_f491_4f6c_dd1d_u64;
        move || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) as f64 / (1u64 << 53) as f64
        }
    }

    fn lamp(at: DVec3, range: Option<f32>, kind: LightKind, turn: DQuat) -> LocalLight {
        let light = Light { kind, color: Vec3::ONE, intensity: 10.0, range };
        let place = DAffine3::from_rotation_translation(turn, at);
        LocalLight::new(&light, &place, Condition::Always)
    }

    fn random_lamps(count: usize, extent: f64) -> Vec<LocalLight> {
        let mut next = numbers();
        let mut lamps = Vec::new();
        for index in 0..count {
            let at = DVec3::new(next(), next() * 0.1, next()) * extent + DVec3::new(1e5, 0.0, -3e4);
            let outer_rad = 0.1 + next() as f32 * 1.4;
            let spot = LightKind::Spot { inner_rad: 0.0, outer_rad };
            let kind = if index % 2 == 0 { spot } else { LightKind::Point };
            let axis = DVec3::new(next() - 0.5, next() - 0.5, next() - 0.5).normalize();
            let range = (index % 7 != 0).then_some(4.0 + 6.0 * next() as f32);
            lamps.push(lamp(at, range, kind, DQuat::from_rotation_arc(DVec3::NEG_Z, axis)));
        }
        lamps
    }

    #[test]
    fn every_lamp_with_light_at_a_place_is_in_the_list_of_its_cell() {
        let lamps = random_lamps(500, 120.0);
        let (grid, lists) = LampGrid::new(&lamps).expect("many lamps");
        let (mut next, mut listed, mut lit) = (numbers(), 0, 0);
        for _ in 0..4000 {
            let at = DVec3::new(next() - 0.1, next() * 0.2 - 0.1, next() - 0.1) * 150.0
                + DVec3::new(1e5, 0.0, -3e4);
            // As the shader has it, relative to an eye.
            let eye = DVec3::new(1e5 + 60.0, 3.0, -3e4 + 80.0);
            let from =
                ((at - eye).as_vec3() - (grid.origin - eye).as_vec3()) * (grid.side.recip() as f32);
            let cell = from.floor().as_dvec3();
            let is_inside =
                cell.cmpge(DVec3::ZERO).all() && cell.cmplt(grid.cells.as_dvec3()).all();
            let list = if is_inside {
                let cell = cell.as_uvec3();
                let cell = ((cell.z * grid.cells.y + cell.y) * grid.cells.x + cell.x) as usize;
                &lists[lists[cell] as usize..lists[cell + 1] as usize]
            } else {
                &[]
            };
            assert!(list.is_sorted());
            listed += list.len();
            for (index, lamp) in (0u32..).zip(&lamps).filter(|(index, _)| grid.holds(*index)) {
                let way = at - lamp.position;
                let is_near = way.length() < f64::from(lamp.inverse_range).recip();
                let cosine = way.normalize().dot(lamp.direction.as_dvec3());
                let cone = cosine * f64::from(lamp.cone[0]) + f64::from(lamp.cone[1]);
                if is_near && cone > 0.0 {
                    lit += 1;
                    assert!(list.contains(&index), "{at} has no light of lamp {index}");
                }
            }
        }
        println!("{listed} lamps listed where {lit} have light, {} cells", grid.cells);
        assert!(lit > 1000 && listed < 6 * lit, "{listed} lamps listed where {lit} have light");
    }

    #[test]
    fn lamps_without_an_end_and_few_lamps_have_no_grid() {
        let endless = lamp(DVec3::ZERO, None, LightKind::Point, DQuat::IDENTITY);
        let near = lamp(DVec3::ONE, Some(3.0), LightKind::Point, DQuat::IDENTITY);
        let far = lamp(DVec3::ONE, Some(1e9), LightKind::Point, DQuat::IDENTITY);
        let mut lamps = vec![endless; 20];
        assert!(LampGrid::new(&lamps).is_none());
        lamps.extend(vec![near; GRID_LAMPS_MIN - 1]);
        assert!(LampGrid::new(&lamps).is_none());
        lamps.push(far);
        let (grid, _) = LampGrid::new(&lamps).expect("a grid");
        let held: Vec<bool> = (0..lamps.len() as u32).map(|lamp| grid.holds(lamp)).collect();
        let last = lamps.len() - 1;
        assert!(!held[0] && held[20] && held[last - 1] && !held[last]);
        assert!(grid.origin.abs_diff_eq(DVec3::splat(-2.0), 1e-3), "{}", grid.origin);
    }

    #[test]
    fn cells_and_lists_stay_within_their_limits() {
        for (count, extent) in [(64, 1e7), (20_000, 50.0), (20_000, 1e4)] {
            let lamps = random_lamps(count, extent);
            let (grid, lists) = LampGrid::new(&lamps).expect("many lamps");
            let cells = grid.cells.element_product() as usize;
            assert!(cells <= CELLS_MAX, "{cells} cells");
            assert!((lists.len() - cells - 1) as f64 <= ENTRIES_MAX, "{} entries", lists.len());
        }
        let far = lamp(DVec3::splat(f64::MAX), Some(1.0), LightKind::Point, DQuat::IDENTITY);
        let near = lamp(DVec3::splat(-f64::MAX), Some(1.0), LightKind::Point, DQuat::IDENTITY);
        assert!(LampGrid::new(&[vec![far; 20], vec![near; 20]].concat()).is_none());
    }
}
