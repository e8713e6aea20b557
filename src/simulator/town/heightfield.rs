//! The height of the ground: a quay, a hill that climbs from it, and a shore all around.
//!
//! The sea is y = 0 and lies towards +Z; the edge of the first street is z = 0; the town climbs
//! towards -Z and is centred on x = 0. Only additions, multiplications, divisions and square roots
//! are used, so the heights are the same on every machine.

use glam::{Vec3, vec3};

use super::random::lattice;

/// Metres of a block with half of the streets around it.
pub(super) const BLOCK: f32 = 40.0;
/// Height of the first street and of the quay above the sea.
pub(super) const QUAY_HEIGHT: f32 = 1.625;
/// Height at which the ground ends, below the sea.
const SEABED: f32 = -5.0;

/// The shape of the land.
#[derive(Clone, Debug)]
pub(super) struct Heightfield {
    seed: u64,
    /// Half of the town's width, in metres.
    pub half_width: f32,
    /// The town's depth from the quay to the last street, in metres.
    pub depth: f32,
    /// Width of the land around the town, in metres.
    pub rim: f32,
    grade: f32,
}

impl Heightfield {
    /// Land for `blocks` × `blocks` blocks.
    pub fn new(blocks: u32, seed: u64) -> Self {
        let blocks = blocks as f32;
        Self {
            seed,
            half_width: blocks * BLOCK * 0.5,
            depth: blocks * BLOCK,
            rim: rim_cells(blocks as u32) as f32 * BLOCK,
            // Small towns are steeper, so that every roof shows from the harbour.
            grade: 0.06 + 1.3 / (blocks + 4.0),
        }
    }

    /// Metres outside the town's rectangle; 0 within.
    pub fn outside(&self, x: f32, z: f32) -> f32 {
        let across = (x.abs() - self.half_width).max(0.0);
        let along = z.max(-self.depth - z).max(0.0);
        (across * across + along * along).sqrt()
    }

    /// Metres above the sea.
    pub fn height(&self, x: f32, z: f32) -> f32 {
        let climb = (-z - 8.0).max(0.0);
        let rise = self.grade * climb * climb / (climb + 40.0);
        let rolling = (self.noise(x, z, 96.0, 1) - 0.5) * 6.0 + (self.noise(x, z, 41.0, 2) - 0.5);
        let inland = QUAY_HEIGHT + rise + rolling * smooth(climb / 90.0);
        let outside = self.outside(x, z);
        let ragged = (self.noise(x, z, 33.0, 3) - 0.5) * 30.0 * smooth(outside / 30.0);
        let shore = smooth((outside + ragged) / self.rim);
        // The last metres always lie under water, however ragged the shore.
        let shore = shore.max(smooth((outside - self.rim * 0.75) / (self.rim * 0.25)));
        inland + (SEABED - inland) * shore
    }

    /// The unit normal, from heights a metre away.
    pub fn normal(&self, x: f32, z: f32) -> Vec3 {
        let east = self.height(x + 1.0, z) - self.height(x - 1.0, z);
        let south = self.height(x, z + 1.0) - self.height(x, z - 1.0);
        vec3(-east, 2.0, -south).normalize_or(Vec3::Y)
    }

    /// Value noise in [0, 1] whose waves are about `length` metres long.
    pub fn noise(&self, x: f32, z: f32, length: f32, layer: u64) -> f32 {
        let (x, z) = (x / length, z / length);
        let (column, row) = (x.floor(), z.floor());
        let (u, v) = (smooth(x - column), smooth(z - row));
        let (column, row) = (column as i32, row as i32);
        let seed = self.seed ^ (layer << 56);
        let at = |dx: i32, dz: i32| lattice(seed, column + dx, row + dz);
        let near = at(0, 0) + (at(1, 0) - at(0, 0)) * u;
        let far = at(0, 1) + (at(1, 1) - at(0, 1)) * u;
        near + (far - near) * v
    }
}

/// Returns the number of cells of open land on each side of the town.
pub(super) fn rim_cells(blocks: u32) -> i32 {
    2 + (blocks / 16) as i32
}

/// Perlin's fifth-order ease between 0 and 1: its second derivative is smooth too.
pub(super) fn smooth(t: f32) -> f32 {
    let t = t.clamp(0.0, 1.0);
    t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
}
