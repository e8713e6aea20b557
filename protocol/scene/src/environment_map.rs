//! Light from all around, as the baker prepares it for shading: a cube map of reflections whose
//! levels are ever rougher, and the coefficients of diffuse light.
//!
//! Its bytes: [`MAGIC`] or [`MAGIC_SUNLESS`], the side as u32, 27 f32 of
//! [`EnvironmentMap::diffuse`], and the texels, all little-endian.

/// The first bytes of the blob; the last one is the version.
const MAGIC: [u8; 4] = *b"PEN\x01";

/// The same of a map without a sun.
const MAGIC_SUNLESS: [u8; 4] = *b"PEN\x02";

/// Minimum side of the largest level, in texels: 5 levels of roughness.
pub const SIDE_MIN: u32 = 64;

/// Maximum side of the largest level, in texels: 0.18° a texel, and 16.8 MB in all.
pub const SIDE_MAX: u32 = 512;

/// The side of the smallest level, in texels: the roughest lobe is wider than its texels.
const LAST_SIDE: u32 = 4;

/// Bytes of a texel: red, green, blue and 1 as IEEE 754 binary16.
pub const TEXEL_BYTES: usize = 8;

/// Bytes before the texels.
const HEAD_BYTES: usize = 8 + 27 * 4;

/// The largest radiance that a texel has. A renderer's float target holds no more.
pub const RADIANCE_MAX: f32 = 60000.0;

/// Factors of the real spherical harmonics `Y₀₀, Y₁₋₁, Y₁₀, Y₁₁, Y₂₋₂, Y₂₋₁, Y₂₀, Y₂₁, Y₂₂`, beside
/// the polynomials of [`EnvironmentMap::diffuse`], which stand in this order.
pub const HARMONICS: [f64; 9] = [
    0.282_094_791_773_878_14,
    0.488_602_511_902_919_9,
    0.488_602_511_902_919_9,
    0.488_602_511_902_919_9,
    1.092_548_430_592_079_2,
    1.092_548_430_592_079_2,
    0.315_391_565_252_520_05,
    1.092_548_430_592_079_2,
    0.546_274_215_296_039_6,
];

/// Maximum size of an encoded map, in bytes.
pub const ENVIRONMENT_BYTES_MAX: usize = 17 << 20;

/// The surroundings of a scene, prefiltered.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvironmentMap {
    /// The side of the largest level in texels, a power of two from [`SIDE_MIN`] to [`SIDE_MAX`].
    pub side: u32,
    /// Diffuse irradiance over π as a polynomial of the normal n = (x, y, z), in linear RGB; the
    /// factors of 1, y, z, x, xy, yz, 3z² − 1, xz and x² − y². Ramamoorthi and Hanrahan, "An
    /// Efficient Representation for Irradiance Environment Maps" (2001).
    pub diffuse: [[f32; 3]; 9],
    /// Radiance, prefiltered: by level from the largest, in each by face in the order +X −X +Y −Y
    /// +Z −Z of cube maps, in each by rows from the top.
    pub texels: Vec<u8>,
    /// Its light is all that a scene without lights has; `false` of a sky without the sun that
    /// shines in it.
    pub has_sun: bool,
}

impl EnvironmentMap {
    /// Returns the number of levels of a map of this side. Level l is filtered for the perceptual
    /// roughness l / (levels − 1), so the largest one is a mirror's.
    pub fn levels_of(side: u32) -> u32 {
        (side / LAST_SIDE).ilog2() + 1
    }

    /// Returns the number of levels.
    pub fn levels(&self) -> u32 {
        Self::levels_of(self.side)
    }

    /// Returns the bytes of all texels of a map of this side.
    pub fn texel_bytes_of(side: u32) -> usize {
        let side_of = |level: u32| (side >> level) as usize;
        let texels = (0..Self::levels_of(side)).map(|level| 6 * side_of(level).pow(2));
        texels.sum::<usize>() * TEXEL_BYTES
    }

    /// Returns the radiance of all texels in their order: linear RGB.
    pub fn radiance(&self) -> impl Iterator<Item = [f32; 3]> + '_ {
        let number =
            |texel: &[u8], at: usize| number(u16::from_le_bytes([texel[at], texel[at + 1]]));
        let of = move |texel| [0, 2, 4].map(|at| number(texel, at));
        self.texels.chunks_exact(TEXEL_BYTES).map(of)
    }

    /// Returns the map as a blob.
    pub fn encode(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(HEAD_BYTES + self.texels.len());
        bytes.extend(if self.has_sun { MAGIC } else { MAGIC_SUNLESS });
        bytes.extend(self.side.to_le_bytes());
        bytes.extend(self.diffuse.iter().flatten().flat_map(|number| number.to_le_bytes()));
        bytes.extend(&self.texels);
        bytes
    }

    /// Reads a blob.
    ///
    /// # Errors
    /// The bytes are no map, or one with a side or a number that no map has.
    pub fn decode(bytes: &[u8]) -> Result<Self, String> {
        let fault = |what: &str| format!("the environment's blob {what}; set it again");
        if bytes.len() > ENVIRONMENT_BYTES_MAX {
            return Err(fault(&format!("has more than {ENVIRONMENT_BYTES_MAX} bytes")));
        }
        let head = bytes.first_chunk::<HEAD_BYTES>().ok_or_else(|| fault("is cut off"))?;
        let has_sun = head[..4] == MAGIC;
        if !has_sun && head[..4] != MAGIC_SUNLESS {
            return Err(fault("is not one that this version reads"));
        }
        let word = |at: usize| [head[at], head[at + 1], head[at + 2], head[at + 3]];
        let side = u32::from_le_bytes(word(4));
        if !(side.is_power_of_two() && (SIDE_MIN..=SIDE_MAX).contains(&side)) {
            let range = format!("has a side of {side}, where {SIDE_MIN} to {SIDE_MAX} can be");
            return Err(fault(&range));
        }
        let texels = &bytes[HEAD_BYTES..];
        if texels.len() != Self::texel_bytes_of(side) {
            let (got, wanted) = (texels.len(), Self::texel_bytes_of(side));
            return Err(fault(&format!(
                "has {got} bytes of texels, where {wanted} would be right"
            )));
        }
        let diffuse: [[f32; 3]; 9] = std::array::from_fn(|term| {
            std::array::from_fn(|color| f32::from_le_bytes(word(8 + (term * 3 + color) * 4)))
        });
        let is_infinite = |half: &[u8]| half[1] & 0x7c == 0x7c;
        let is_broken = diffuse.iter().flatten().any(|number| !number.is_finite())
            || texels.chunks_exact(2).any(is_infinite);
        if is_broken {
            return Err(fault("has a number that is not finite"));
        }
        Ok(Self { side, diffuse, texels: texels.to_vec(), has_sun })
    }
}

/// The number of an IEEE 754 binary16 that is finite and 0 or more.
fn number(half: u16) -> f32 {
    let (exponent, fraction) = (half >> 10 & 0x1f, f32::from(half & 0x3ff) / 1024.0);
    if exponent == 0 {
        return fraction * (-14f32).exp2();
    }
    (1.0 + fraction) * (f32::from(exponent) - 15.0).exp2()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_are_read() {
        let known = [(0, 0.0), (1, 5.960_464_5e-8), (0x3c00, 1.0), (0x3555, 0.333_251_95)];
        for (bits, expected) in known {
            assert_eq!(number(bits), expected, "{bits:x}");
        }
        assert_eq!(number(0x7b53), RADIANCE_MAX);
    }

    fn map() -> EnvironmentMap {
        let texels = vec![0x11; EnvironmentMap::texel_bytes_of(64)];
        let mut diffuse = [[0.25; 3]; 9];
        diffuse[8] = [1.0, -2.0, 3.5];
        EnvironmentMap { side: 64, diffuse, texels, has_sun: true }
    }

    #[test]
    fn a_map_comes_back_as_it_was_written() {
        let map = map();
        let sunless = EnvironmentMap { has_sun: false, ..map.clone() };
        for map in [&map, &sunless] {
            assert_eq!(EnvironmentMap::decode(&map.encode()), Ok(map.clone()));
        }
        assert_eq!((map.levels(), EnvironmentMap::levels_of(SIDE_MAX)), (5, 8));
        let largest = HEAD_BYTES + EnvironmentMap::texel_bytes_of(SIDE_MAX);
        assert!(largest <= ENVIRONMENT_BYTES_MAX, "{largest}");
    }

    #[test]
    fn damaged_blobs_are_refused() {
        let good = map().encode();
        let with = |at: usize, byte: u8| {
            let mut bytes = good.clone();
            bytes[at] = byte;
            EnvironmentMap::decode(&bytes).expect_err("damaged")
        };
        assert!(with(0, b'X').contains("this version"));
        assert!(with(3, 3).contains("this version"));
        assert!(with(4, 65).contains("a side of 65"));
        assert!(with(5, 4).contains("a side of 1088"));
        assert!(with(4, 128).contains("bytes of texels"));
        let mut infinite = good.clone();
        infinite[8..12].copy_from_slice(&f32::INFINITY.to_le_bytes());
        assert!(EnvironmentMap::decode(&infinite).is_err_and(|fault| fault.contains("finite")));
        assert!(with(HEAD_BYTES + 1, 0x7c).contains("finite"));
        for cut in [0, 7, HEAD_BYTES, good.len() - 1] {
            assert!(EnvironmentMap::decode(&good[..cut]).is_err(), "{cut}");
        }
    }
}
