//! The order in which frames are made faster to draw, as one number.
//!
//! ```text
//! reduction   0 ........ 8 ................... 128 ........ 1024
//! error       0 ........ 8 px .................. 8 ........ 64 px
//! resolution  all of the pixels ... a sixteenth of them ........
//! ```
//!
//! Detail goes first: an error of a pixel or two saves most triangles and is hardly seen. From 8
//! pixels on it would: a disc of that radius may be a triangle, and what is smaller is gone, while
//! a picture of half the resolution moves no edge by more than its own pixel, two of the wall's.
//! So the resolution goes next; and only when a quarter of the pixels along each side is not
//! enough, because time goes into triangles and not pixels, the error grows on up to where nothing
//! is recognised.
//!
//! Twice the reduction is half the pixels, as it is half the detail or less: so the controller of
//! the rate bound needs no more than this number.

use polyptych_protocol::quality_bounds::{ERROR_PX_MAX, RESOLUTION_STEPS_MAX};
use serde::{Deserialize, Serialize};

/// The error in pixels from which on the resolution is lowered.
pub(super) const RESOLUTION_FROM_PX: f64 = 8.0;

/// Steps of resolution that halve the number of pixels.
const STEPS_A_HALF: f64 = 2.0;

/// Slack of the logarithm of a step's own reduction: far above its rounding.
const ROUNDING: f64 = 1e-6;

/// The amount by which less than everything is drawn; 0 to [`Self::MAX`].
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd, Serialize, Deserialize)]
pub(super) struct Reduction(f64);

impl Reduction {
    /// The largest error at the lowest resolution.
    pub const MAX: Self = Self(1024.0);

    /// The reduction that an error bound that was asked for is at least. A larger error than that
    /// from which on the resolution is lowered says nothing about the resolution.
    pub fn of_error(error_px: f64) -> Self {
        Self(error_px.clamp(0.0, RESOLUTION_FROM_PX))
    }

    /// A reduction of this number.
    pub fn new(number: f64) -> Self {
        Self(number.clamp(0.0, Self::MAX.0))
    }

    /// Its number.
    pub fn number(self) -> f64 {
        self.0
    }

    /// The largest of both.
    pub fn max(self, other: Self) -> Self {
        Self(self.0.max(other.0))
    }

    /// The error bound, in pixels.
    pub fn error_px(self) -> f64 {
        let lowest = of_steps(RESOLUTION_STEPS_MAX);
        let beyond = RESOLUTION_FROM_PX * (self.0 / lowest).max(1.0);
        self.0.min(beyond).min(ERROR_PX_MAX)
    }

    /// The steps by which the resolution is lowered.
    pub fn resolution_steps(self) -> u8 {
        let steps = STEPS_A_HALF * (self.0 / RESOLUTION_FROM_PX).log2() - ROUNDING;
        steps.ceil().clamp(0.0, f64::from(RESOLUTION_STEPS_MAX)) as u8
    }

    /// At least this much more of it, and enough for a change of what is drawn.
    pub fn raised(self, factor: f64, least: f64) -> Self {
        // At the lowest resolution only an error beyond that of all resolutions changes a frame.
        let is_lowest = self.resolution_steps() == RESOLUTION_STEPS_MAX;
        let from = if is_lowest { of_steps(RESOLUTION_STEPS_MAX) } else { least };
        let higher = self.0.max(from) * factor;
        let steps = Self(higher).resolution_steps();
        let is_between = self.0 >= RESOLUTION_FROM_PX && steps < RESOLUTION_STEPS_MAX;
        let steps = if is_between { steps.max(self.resolution_steps() + 1) } else { steps };
        let is_lowered = steps > self.resolution_steps();
        Self::new(if is_lowered { higher.max(of_steps(steps)) } else { higher })
    }

    /// Pixels of a frame with this reduction for each one of a frame with another.
    pub fn pixels_of(self, other: Self) -> f64 {
        let steps = f64::from(other.resolution_steps()) - f64::from(self.resolution_steps());
        (steps / STEPS_A_HALF).exp2()
    }
}

/// The largest reduction of so many steps of resolution.
fn of_steps(steps: u8) -> f64 {
    RESOLUTION_FROM_PX * (f64::from(steps) / STEPS_A_HALF).exp2()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn error_comes_first_then_resolution_then_error_again() {
        let quality = |number| {
            let reduction = Reduction::new(number);
            (reduction.error_px(), reduction.resolution_steps())
        };
        for (number, expected) in [
            (0.0, (0.0, 0)),
            (0.5, (0.5, 0)),
            (8.0, (8.0, 0)),
            (8.1, (8.0, 1)),
            (16.0, (8.0, 2)),
            (128.0, (8.0, 8)),
            (256.0, (16.0, 8)),
            (1024.0, (64.0, 8)),
            (1e9, (64.0, 8)),
        ] {
            assert_eq!(quality(number), expected, "{number}");
        }
        assert_eq!(Reduction::of_error(20.0).resolution_steps(), 0);
    }

    proptest! {
        #[test]
        fn raising_always_draws_less_until_the_end(number in 0.0..1024.0_f64, by in 1.02..4.0_f64) {
            let (before, after) = {
                let before = Reduction::new(number);
                (before, before.raised(by, 0.0625))
            };
            let is_less = after.error_px() > before.error_px()
                || after.resolution_steps() > before.resolution_steps();
            prop_assert!(is_less || before.error_px() == ERROR_PX_MAX, "{before:?} {after:?}");
            prop_assert!(after.error_px() >= before.error_px());
            prop_assert!(after.resolution_steps() >= before.resolution_steps());
            // Where time goes with the pixels, it falls by the factor that was needed, as far as
            // there are pixels to lose.
            if number >= 8.0 && after.resolution_steps() < RESOLUTION_STEPS_MAX {
                prop_assert!(after.pixels_of(before) <= 1.0 / by * 1.42);
            }
        }
    }
}
