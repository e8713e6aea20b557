//! Radiance by direction, as the faces of a cube with smaller and smaller levels.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::equirect::Equirect;

/// A cube map with all its levels, each the mean of the one before.
#[derive(Clone, Debug)]
pub(super) struct CubeMap {
    pub side: u32,
    /// By level, face, row and column.
    levels: Vec<Vec<Vec3>>,
}

/// The direction through a place of a face, from −1 to 1 right and down; not of length 1. Faces as
/// Vulkan has them: +X −X +Y −Y +Z −Z.
pub(super) fn through(face: usize, right: f64, down: f64) -> DVec3 {
    match face {
        0 => DVec3::new(1.0, -down, -right),
        1 => DVec3::new(-1.0, -down, right),
        2 => DVec3::new(right, 1.0, down),
        3 => DVec3::new(right, -1.0, -down),
        4 => DVec3::new(right, -down, 1.0),
        _ => DVec3::new(-right, -down, -1.0),
    }
}

/// The face that a direction goes through, and the place on it, from −1 to 1 right and down.
fn place(of: DVec3) -> (usize, f64, f64) {
    let size = of.abs();
    if size.x >= size.y && size.x >= size.z {
        let face = usize::from(of.x < 0.0);
        (face, -of.z / of.x, -of.y / size.x)
    } else if size.y >= size.z {
        let face = 2 + usize::from(of.y < 0.0);
        (face, of.x / size.y, of.z / of.y)
    } else {
        let face = 4 + usize::from(of.z < 0.0);
        (face, of.x / of.z, -of.y / size.z)
    }
}

/// The direction through the middle of a texel, of length 1. Texels beyond a face are those of the
/// plane that it lies in.
fn direction(side: u32, face: usize, column: f64, row: f64) -> DVec3 {
    let at = |index: f64| (2.0 * index + 1.0) / f64::from(side) - 1.0;
    through(face, at(column), at(row)).normalize()
}

/// Texels of a face by row, in parallel.
pub(super) fn fill(side: u32, texel: impl Fn(DVec3) -> Vec3 + Sync) -> Vec<Vec3> {
    let count = (side * side) as usize;
    (0..6 * count)
        .into_par_iter()
        .map(|index| {
            let (face, at) = (index / count, (index % count) as u32);
            texel(direction(side, face, f64::from(at % side), f64::from(at / side)))
        })
        .collect()
}

impl CubeMap {
    /// The cube map of a picture: each texel is the mean of as many directions as pixels lie in it.
    pub fn of(picture: &Equirect, side: u32) -> Self {
        let steps = picture.width.div_ceil(4 * side).max(1) + 1;
        let count = (side * side) as usize;
        let step = |index: u32| (f64::from(index) + 0.5) / f64::from(steps) - 0.5;
        let first = (0..6 * count).into_par_iter().map(|index| {
            let (face, at) = (index / count, (index % count) as u32);
            let mut sum = Vec3::ZERO;
            for part in 0..steps * steps {
                let column = f64::from(at % side) + step(part % steps);
                let row = f64::from(at / side) + step(part / steps);
                sum += picture.radiance(direction(side, face, column, row));
            }
            sum / (steps * steps) as f32
        });
        Self::of_texels(side, first.collect())
    }

    /// A cube map of the texels of its largest level.
    pub fn of_texels(side: u32, texels: Vec<Vec3>) -> Self {
        let mut levels = vec![texels];
        let mut width = side as usize;
        while width > 1 {
            let finer = &levels[levels.len() - 1];
            let half = width / 2;
            let texel = |index: usize| {
                let (face, at) = (index / (half * half), index % (half * half));
                let corner = face * width * width + at / half * 2 * width + at % half * 2;
                let four = [corner, corner + 1, corner + width, corner + width + 1];
                four.iter().map(|&of| finer[of]).sum::<Vec3>() * 0.25
            };
            let coarser = (0..6 * half * half).map(texel).collect();
            levels.push(coarser);
            width = half;
        }
        Self { side, levels }
    }

    /// The mean difference of texels on both sides of the borders of faces, as a part of what they
    /// are: small where the faces hang together.
    pub fn border_difference(&self) -> f64 {
        let last = f64::from(self.side - 1);
        let across = |face: usize, at: f64| {
            let pairs = [
                ([0.0, at], [-1.0, at]),
                ([last, at], [last + 1.0, at]),
                ([at, 0.0], [at, -1.0]),
                ([at, last], [at, last + 1.0]),
            ];
            pairs.map(|pair| {
                let texel = |[column, row]: [f64; 2]| self.texel(0, face, column, row);
                let (near, far) = (texel(pair.0), texel(pair.1));
                let sum = (near + far).element_sum();
                if sum > 0.0 { f64::from((near - far).abs().element_sum() / sum) } else { 0.0 }
            })
        };
        let places = (0..6).flat_map(|face| (0..self.side).map(move |at| (face, f64::from(at))));
        let sum: f64 = places.flat_map(|(face, at)| across(face, at)).sum();
        sum / (24.0 * f64::from(self.side))
    }

    /// The texels of the largest level.
    pub fn texels(&self) -> &[Vec3] {
        &self.levels[0]
    }

    /// Radiance from a direction, linear within a level and between two.
    pub fn radiance(&self, from: DVec3, level: f64) -> Vec3 {
        let level = level.clamp(0.0, (self.levels.len() - 1) as f64);
        let (finer, part) = (level.floor() as usize, level.fract() as f32);
        let near = self.within(from, finer);
        if part == 0.0 { near } else { near.lerp(self.within(from, finer + 1), part) }
    }

    fn within(&self, from: DVec3, level: usize) -> Vec3 {
        let side = self.side >> level;
        let (face, right, down) = place(from);
        let index = |at: f64| (at + 1.0) * 0.5 * f64::from(side) - 0.5;
        let (x, y) = (index(right), index(down));
        let (left, top) = (x.floor(), y.floor());
        let (part_x, part_y) = ((x - left) as f32, (y - top) as f32);
        let row = |row: f64| {
            let ends = [left, left + 1.0].map(|column| self.texel(level, face, column, row));
            ends[0].lerp(ends[1], part_x)
        };
        row(top).lerp(row(top + 1.0), part_y)
    }

    /// A texel; the one of the next face where it lies beyond its own.
    fn texel(&self, level: usize, face: usize, column: f64, row: f64) -> Vec3 {
        let side = self.side >> level;
        let range = 0.0..f64::from(side);
        let (face, column, row) = if range.contains(&column) && range.contains(&row) {
            (face, column as usize, row as usize)
        } else {
            let (face, right, down) = place(direction(side, face, column, row));
            let index = |at: f64| ((at + 1.0) * 0.5 * f64::from(side)) as usize;
            let last = side as usize - 1;
            (face, index(right).min(last), index(down).min(last))
        };
        self.levels[level][(face * side as usize + row) * side as usize + column]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_place_of_each_face_is_found_again() {
        for face in 0..6 {
            for (right, down) in [(0.0, 0.0), (-0.9, 0.3), (0.7, -0.8), (0.2, 0.99)] {
                let (found, x, y) = place(through(face, right, down).normalize());
                assert_eq!(found, face);
                assert!((x - right).abs() + (y - down).abs() < 1e-12, "{face}: {x}, {y}");
            }
        }
    }
}
