//! A terrain with levels of detail, made by hand, of which every error is known.
//!
//! Its meshlets are squares of a height field. A square's border stays as it is in all coarser
//! levels of its size, so that neighbours of any level meet. From one level to the next, a square
//! of 8 × 8 cells loses every second row and column within, then all points but its middle; and
//! four squares become one that has only their outer border and the middle.

use glam::{DVec2, DVec3, IVec2, Vec2, Vec3};
use polyptych_scene::meshlet::{ErrorSphere, Meshlet};

use super::harness::MeshFixture;

/// Cells along the side of the smallest square.
const CELLS: i32 = 8;

/// More than f32 rounds, so that spheres hold those of finer levels.
const ROUNDING: f32 = 1e-6;

/// A height field over the square from 0 to 1, with its levels.
pub struct Terrain {
    /// Cells along its side.
    side: i32,
    /// Levels of detail so far.
    levels: u32,
    /// In rows.
    heights: Vec<f64>,
    shape: MeshFixture,
}

/// A square of one level, and what it was made of.
struct Square {
    corner: IVec2,
    triangles: Vec<[IVec2; 3]>,
    error: f32,
    sphere: ErrorSphere,
    /// Places of the meshlets of the level below, which it replaces.
    replaces: Vec<usize>,
}

impl Terrain {
    /// A terrain of `1 << doublings` smallest squares along its side, as high as its heights say of
    /// places from 0 to 1, with the mesh of all levels.
    pub fn mesh(doublings: u32, height: impl Fn(DVec2) -> f64) -> MeshFixture {
        let side = CELLS << doublings;
        let places = (0..=side).flat_map(|z| (0..=side).map(move |x| IVec2::new(x, z)));
        let place = |at: IVec2| at.as_dvec2() / f64::from(side);
        let mut terrain =
            Self { side, levels: 0, heights: Vec::new(), shape: MeshFixture::default() };
        for at in places {
            // As the vertex has it.
            let point = |at: DVec2| DVec3::new(at.x, height(at), at.y).as_vec3();
            let (along_x, along_z) = (DVec2::X * 1e-3, DVec2::Y * 1e-3);
            let here = point(place(at));
            let slopes = [along_z, along_x].map(|by| point(place(at) + by) - here);
            let normal = slopes[0].cross(slopes[1]).normalize();
            terrain.shape.push(here, normal, Vec3::X, Vec2::new(here.x, here.z) * 8.0);
            terrain.heights.push(f64::from(here.y));
        }
        terrain.build(doublings);
        terrain.shape
    }

    fn build(&mut self, doublings: u32) {
        let squares = |size: i32| {
            let across = (CELLS << doublings) / size;
            (0..across).flat_map(move |z| (0..across).map(move |x| IVec2::new(x, z) * size))
        };
        let finest = squares(CELLS).map(|corner| self.square(corner, CELLS, grid(corner), &[]));
        let mut level: Vec<Square> = finest.collect();
        let mut places = self.add(&level);
        for triangles in [ring, |corner| fan(corner, CELLS)] {
            let same = level.iter().enumerate().map(|(at, square)| {
                self.square(square.corner, CELLS, triangles(square.corner), &[(at, square)])
            });
            level = same.collect();
            places = self.replace(&places, &level);
        }
        for doubling in 1..=doublings {
            let size = CELLS << doubling;
            let across = CELLS << (doublings + 1) >> doubling;
            let merged = squares(size).map(|corner| {
                let half = corner / (size / 2);
                let four = [IVec2::ZERO, IVec2::X, IVec2::Y, IVec2::ONE].map(|by| half + by);
                let of = four.map(|of| (of.y * (across / CELLS) + of.x) as usize);
                self.square(corner, size, fan(corner, size), &of.map(|at| (at, &level[at])))
            });
            level = merged.collect();
            places = self.replace(&places, &level);
        }
    }

    /// A square with its error, which is no less than that of what it replaces.
    fn square(
        &self,
        corner: IVec2,
        size: i32,
        triangles: Vec<[IVec2; 3]>,
        replaces: &[(usize, &Square)],
    ) -> Square {
        let is_finest = replaces.is_empty();
        let own = if is_finest { 0.0 } else { self.error(corner, size, &triangles).max(1e-6) };
        let error = replaces.iter().map(|(_, of)| of.error).fold(own as f32 * 1.000_001, f32::max);
        let end = corner + size;
        let rows = (corner.y..=end.y).flat_map(|z| (corner.x..=end.x).map(move |x| (x, z)));
        let points: Vec<Vec3> = rows.map(|(x, z)| self.point(IVec2::new(x, z))).collect();
        let min = points.iter().copied().fold(Vec3::INFINITY, Vec3::min);
        let max = points.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
        let center = (min + max) * 0.5;
        let reach =
            |(_, of): &(usize, &Square)| center.distance(of.sphere.center) + of.sphere.radius;
        let radius = replaces.iter().map(reach).fold((max - min).length() * 0.5, f32::max);
        let sphere = ErrorSphere { center, radius: radius * (1.0 + ROUNDING) };
        let replaces = replaces.iter().map(|(at, _)| *at).collect();
        Square { corner, triangles, error, sphere, replaces }
    }

    /// Adds the meshlets of a level; returns their places.
    fn add(&mut self, level: &[Square]) -> Vec<usize> {
        let first = self.shape.meshlets.len();
        for square in level {
            let index = |at: &IVec2| self.index(*at) as u32;
            let indices: Vec<u32> = square.triangles.iter().flatten().map(index).collect();
            let begin = (self.shape.indices.len() + self.shape.coarser_indices.len()) as u32;
            let mut meshlet = self.shape.meshlet(begin, &indices);
            (meshlet.error, meshlet.sphere) = (square.error, square.sphere);
            (meshlet.coarser_sphere, meshlet.level) = (square.sphere, self.levels);
            self.shape.meshlets.push(meshlet);
            if square.error == 0.0 {
                self.shape.indices.extend(indices);
            } else {
                self.shape.coarser_indices.extend(indices);
            }
        }
        self.levels += 1;
        (first..self.shape.meshlets.len()).collect()
    }

    /// Adds a level that replaces another, whose places are given.
    fn replace(&mut self, replaced: &[usize], level: &[Square]) -> Vec<usize> {
        for square in level {
            for at in &square.replaces {
                let meshlet: &mut Meshlet = &mut self.shape.meshlets[replaced[*at]];
                meshlet.coarser_error = square.error;
                meshlet.coarser_sphere = square.sphere;
            }
        }
        self.add(level)
    }

    fn index(&self, at: IVec2) -> usize {
        (at.y * (self.side + 1) + at.x) as usize
    }

    fn point(&self, at: IVec2) -> Vec3 {
        Vec3::from_slice(&self.shape.vertices[self.index(at)][..3])
    }

    fn height(&self, at: IVec2) -> f64 {
        self.heights[self.index(at)]
    }

    /// The largest difference of heights between the finest level and these triangles of a square.
    /// Both are flat between the edges of both, so it is where two edges cross or where one ends.
    fn error(&self, corner: IVec2, size: i32, triangles: &[[IVec2; 3]]) -> f64 {
        let mut largest: f64 = 0.0;
        for z in corner.y..=corner.y + size {
            for x in corner.x..=corner.x + size {
                let at = IVec2::new(x, z);
                let coarse = triangles.iter().find_map(|of| self.height_in(of, at.as_dvec2()));
                let coarse = coarse.unwrap_or_else(|| panic!("a hole at {at}"));
                largest = largest.max((coarse - self.height(at)).abs());
            }
        }
        for [a, b] in triangles.iter().flat_map(|[a, b, c]| [[*a, *b], [*b, *c], [*c, *a]]) {
            let along = |at: IVec2| [at.x, at.y, at.x - at.y];
            for (from, to) in along(a).into_iter().zip(along(b)) {
                for line in from.min(to) + 1..from.max(to) {
                    let share = f64::from(line - from) / f64::from(to - from);
                    let coarse = self.height(a) * (1.0 - share) + self.height(b) * share;
                    let fine = self.finest(a.as_dvec2().lerp(b.as_dvec2(), share));
                    largest = largest.max((coarse - fine).abs());
                }
            }
        }
        largest
    }

    /// The height of the finest level.
    fn finest(&self, at: DVec2) -> f64 {
        let cell = at.floor().as_ivec2().min(IVec2::splat(self.side - 1));
        let within = |of: &[IVec2; 3]| self.height_in(of, at);
        cell_triangles(cell).iter().find_map(within).unwrap_or_else(|| panic!("a hole at {at}"))
    }

    /// The height of a triangle at a place; `None` beside it.
    fn height_in(&self, [a, b, c]: &[IVec2; 3], at: DVec2) -> Option<f64> {
        let [u, v] = [*b, *c].map(|corner| (corner - *a).as_dvec2());
        let to = at - a.as_dvec2();
        let area = u.perp_dot(v);
        let [along_b, along_c] = [to.perp_dot(v) / area, u.perp_dot(to) / area];
        let is_within = along_b >= -1e-9 && along_c >= -1e-9 && along_b + along_c <= 1.0 + 1e-9;
        let [h, hb, hc] = [a, b, c].map(|corner| self.height(*corner));
        is_within.then_some(h + (hb - h) * along_b + (hc - h) * along_c)
    }
}

/// The two triangles of a cell, counter-clockwise from above.
fn cell_triangles(at: IVec2) -> [[IVec2; 3]; 2] {
    let across = at + IVec2::ONE;
    [[at, across, at + IVec2::X], [at, at + IVec2::Y, across]]
}

/// All cells of a smallest square.
fn grid(corner: IVec2) -> Vec<[IVec2; 3]> {
    let cells = (0..CELLS).flat_map(|z| (0..CELLS).map(move |x| corner + IVec2::new(x, z)));
    cells.flat_map(cell_triangles).collect()
}

/// Cells of twice the size in the middle of a smallest square, and triangles to its border.
fn ring(corner: IVec2) -> Vec<[IVec2; 3]> {
    let mut triangles = Vec::new();
    for (z, x) in [(2, 2), (2, 4), (4, 2), (4, 4)] {
        let at = corner + IVec2::new(x, z);
        let double = |of: IVec2| at + (of - at) * 2;
        triangles.extend(cell_triangles(at).map(|of| of.map(double)));
    }
    let (outer, inner) = (border(corner, CELLS, 1), border(corner + 2, CELLS - 4, 2));
    for side in 0..4 {
        // Each of the two inner edges of a side faces half of its outer ones.
        let (o, i) = (side * 8, side * 2);
        let at = |of: &[IVec2], place: usize| of[place % of.len()];
        for step in 0..8 {
            let near = at(&inner, i + (step + 2) / 4);
            triangles.push([at(&outer, o + step), at(&outer, o + step + 1), near]);
        }
        triangles.push([at(&inner, i), at(&outer, o + 2), at(&inner, i + 1)]);
        triangles.push([at(&inner, i + 1), at(&outer, o + 6), at(&inner, i + 2)]);
    }
    triangles
}

/// Triangles from the middle of a square to all points of its border.
fn fan(corner: IVec2, size: i32) -> Vec<[IVec2; 3]> {
    let (border, middle) = (border(corner, size, 1), corner + size / 2);
    let next = border.iter().cycle().skip(1);
    border.iter().zip(next).map(|(a, b)| [*a, *b, middle]).collect()
}

/// The points around a square, counter-clockwise from above.
fn border(corner: IVec2, size: i32, step: i32) -> Vec<IVec2> {
    let steps = || (0..size).step_by(step as usize);
    let down = steps().map(|by| corner + IVec2::new(0, by));
    let right = steps().map(|by| corner + IVec2::new(by, size));
    let up = steps().map(|by| corner + IVec2::new(size, size - by));
    let left = steps().map(|by| corner + IVec2::new(size - by, 0));
    down.chain(right).chain(up).chain(left).collect()
}
