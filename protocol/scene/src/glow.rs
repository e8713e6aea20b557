//! Glow: light that spreads around what is bright, as it does in an eye and in a lens.

use serde::{Deserialize, Serialize};

/// Range of [`Glow::width_degrees`]. The widest level of a picture that glows holds the upper end,
/// and a narrower glow than the lower one is a blurred picture.
const WIDTH_DEGREES: [f32; 2] = [0.1, 7.0];

/// The octaves of angle into which light is spread, down from the widest.
pub const GLOW_OCTAVES: f64 = 5.0;

/// Light that spreads around what is bright. As much goes into each of [`GLOW_OCTAVES`] octaves of
/// angle, so that it falls with the square of the angle, as glare in an eye does (the law of Stiles
/// and Holladay). None of it is lost: what spreads is taken from where it comes from.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Glow {
    /// The share of light that spreads, above 0 and up to 1.
    pub strength: f32,
    /// The width of the widest octave as seen by the viewer, in degrees: 0.1 to 7.
    pub width_degrees: f32,
}

impl Glow {
    /// A glow of this strength, 4° wide.
    pub fn new(strength: f32) -> Self {
        Self { strength, width_degrees: 4.0 }
    }

    /// Returns what is wrong with it, if anything.
    pub fn fault(&self) -> Option<String> {
        let Self { strength, width_degrees } = self;
        if !(*strength > 0.0 && *strength <= 1.0) {
            return Some(format!("a glow has a strength above 0 and up to 1, not {strength}"));
        }
        let [least, greatest] = WIDTH_DEGREES;
        (!(least..=greatest).contains(width_degrees))
            .then(|| format!("a glow is {least} to {greatest} degrees wide, not {width_degrees}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_numbers_that_no_glow_has() {
        assert_eq!(Glow::new(1.0).fault(), None);
        for strength in [0.0, -0.5, 1.01, f32::NAN, f32::INFINITY] {
            let fault = Glow::new(strength).fault();
            assert!(fault.is_some_and(|fault| fault.contains("strength")), "{strength}");
        }
        for width_degrees in [0.0, 0.09, 7.1, f32::NAN, f32::INFINITY] {
            let fault = Glow { strength: 0.1, width_degrees }.fault();
            assert!(fault.is_some_and(|fault| fault.contains("wide")), "{width_degrees}");
        }
    }
}
