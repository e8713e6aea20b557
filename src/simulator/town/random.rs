//! The stream of random numbers: SplitMix64, written here so that it stays the same for ever.

/// Steele, Lea and Flood, "Fast Splittable Pseudorandom Number Generators" (2014): a counter that
/// grows by the golden ratio, mixed by the finaliser of `mix`.
#[derive(Clone, Debug)]
pub(super) struct Random {
    state: u64,
}

const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// The finaliser of SplitMix64 (Stafford's variant 13): every bit of the result hangs on every bit
/// of the argument.
pub(super) fn mix(mut bits: u64) -> u64 {
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^ (bits >> 31)
}

/// Evenly in [0, 1), in steps that f32 holds exactly.
fn unit_of(bits: u64) -> f32 {
    (bits >> 40) as f32 / 16_777_216.0
}

/// A number in [0, 1) that belongs to a point of a lattice.
pub(super) fn lattice(seed: u64, x: i32, y: i32) -> f32 {
    let key = (u64::from(x as u32) << 32) | u64::from(y as u32);
    unit_of(mix(mix(seed.wrapping_add(GOLDEN)) ^ key.wrapping_mul(GOLDEN)))
}

impl Random {
    /// A stream that depends on the seed and the purpose alone.
    pub fn new(seed: u64, purpose: u64) -> Self {
        Self { state: mix(seed.wrapping_add(GOLDEN)) ^ mix(purpose.wrapping_mul(GOLDEN)) }
    }

    /// The stream of one block: what stands there does not hang on what was built before.
    pub fn of_block(seed: u64, column: i32, row: i32) -> Self {
        Self::new(seed, (u64::from(column as u32) << 32) | u64::from(row as u32))
    }

    fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(GOLDEN);
        mix(self.state)
    }

    /// Evenly in [0, 1).
    pub fn unit(&mut self) -> f32 {
        unit_of(self.bits())
    }

    /// Evenly in [least, most).
    pub fn between(&mut self, least: f32, most: f32) -> f32 {
        least + (most - least) * self.unit()
    }

    /// True with the given probability.
    pub fn chance(&mut self, probability: f32) -> bool {
        self.unit() < probability
    }

    /// Evenly in 0..count; 0 where there is nothing to choose from.
    pub fn below(&mut self, count: usize) -> usize {
        (((self.bits() >> 32) * count as u64) >> 32) as usize
    }
}
