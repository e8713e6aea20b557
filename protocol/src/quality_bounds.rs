//! The two bounds of a wall's pictures: how large their error may be, and how seldom they may come.

use polyptych_text::text_of_peer;
use serde::{Deserialize, Serialize};

/// Maximum error that can be asked for and that the rate bound leads to, in pixels: beyond it
/// nothing of a scene is recognised.
pub const ERROR_PX_MAX: f64 = 64.0;

/// Minimum rate that can be asked for, in frames per second.
pub const RATE_FPS_MIN: f64 = 1.0;

/// Maximum rate that can be asked for, in frames per second.
pub const RATE_FPS_MAX: f64 = 1000.0;

/// Maximum number of steps by which the rate bound lowers the resolution: a quarter of the wall's
/// pixels along each side, which still shows where things are.
pub const RESOLUTION_STEPS_MAX: u8 = 8;

/// Returns the pixels that are drawn along each side after so many steps, as a share of the wall's:
/// 1, 0.84, 0.71, 0.59, 0.5 and so on to 0.25. Two steps halve the number of pixels.
pub fn resolution_scale(steps: u8) -> f64 {
    (-f64::from(steps.min(RESOLUTION_STEPS_MAX)) / 4.0).exp2()
}

/// An upper bound of the image-space error and a lower bound of the frame rate. Where both cannot
/// be kept, the rate is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QualityBounds {
    /// The distance in pixels of the wall by which surfaces may be drawn beside their place, 0 to
    /// [`ERROR_PX_MAX`]; 0 draws the finest level of everything.
    pub error_px: f64,
    /// Frames per second, [`RATE_FPS_MIN`] to [`RATE_FPS_MAX`]; `None` for no bound.
    pub rate_fps: Option<f64>,
}

impl QualityBounds {
    /// Everything at its finest, at the rate that comes of it.
    pub const FINEST: Self = Self { error_px: 0.0, rate_fps: None };

    /// Checks the ranges.
    ///
    /// # Errors
    /// The number that is out of its range, and the range.
    pub fn validate(&self) -> Result<(), String> {
        let Self { error_px, rate_fps } = *self;
        if !(0.0..=ERROR_PX_MAX).contains(&error_px) {
            return Err(format!("an error bound is 0 to {ERROR_PX_MAX} pixels, not {error_px}"));
        }
        if let Some(rate) = rate_fps
            && !(RATE_FPS_MIN..=RATE_FPS_MAX).contains(&rate)
        {
            return Err(format!(
                "a rate bound is {RATE_FPS_MIN} to {RATE_FPS_MAX} frames per second, not {rate}"
            ));
        }
        Ok(())
    }
}

/// The error bound in force for a frame: one decision for all channels.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DetailBound {
    /// In pixels of the wall; 0 draws the finest level of everything.
    pub error_px: f64,
    /// For each view of the frame, the wall's own first: pixels per radian around its eye, or per
    /// metre of display space where its rays are parallel. Empty if `error_px` is 0 and the wall
    /// has no budget of GPU memory.
    pub densities: Vec<f64>,
    /// The steps by which the resolution of all channels is lowered, 0 to
    /// [`RESOLUTION_STEPS_MAX`]; see [`resolution_scale`].
    pub resolution_steps: u8,
    /// The error and the resolution change with the rate of frames: what takes long to draw anew
    /// does not follow them.
    pub follows_rate: bool,
}

impl DetailBound {
    /// The error that a view may have, in its unit: radians, or metres of display space. 0 for a
    /// view without a density.
    pub fn allowed_in(&self, view: usize) -> f64 {
        self.length_of(self.error_px, view)
    }

    /// A pixel of a view, in the unit of [`Self::allowed_in`].
    pub fn pixel_in(&self, view: usize) -> f64 {
        self.length_of(1.0, view)
    }

    fn length_of(&self, pixels: f64, view: usize) -> f64 {
        let density = self.densities.get(view).copied().unwrap_or_default();
        let length = pixels / density;
        if density > 0.0 && length.is_finite() && length > 0.0 { length } else { 0.0 }
    }
}

/// The detail that a frame was drawn with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DrawnDetail {
    /// The error bound in force, in pixels of the wall.
    pub error_in_force_px: f64,
    /// The largest error of what any channel drew or left out, in pixels of the wall; at most the
    /// bound in force, unless the wall's budget of GPU memory holds too little detail for that.
    pub largest_error_px: f64,
    /// The channel that drew longest on the server that drew longest for all of its channels, of
    /// those that the frame waited for.
    #[serde(deserialize_with = "text_of_peer")]
    pub limiting_channel: Option<String>,
    /// The pixels that were drawn along each side, as a share of the wall's: 0.25 to 1.
    pub resolution_scale: f64,
    /// Servers hold a part of the scene, and get one ready that serves better where the wall is
    /// seen from: the same frame will have more detail.
    #[serde(default)]
    pub awaits_detail: bool,
}

impl Default for DrawnDetail {
    fn default() -> Self {
        Self {
            error_in_force_px: 0.0,
            largest_error_px: 0.0,
            limiting_channel: None,
            resolution_scale: 1.0,
            awaits_detail: false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_out_of_range_are_refused_with_their_range() {
        assert_eq!(QualityBounds::FINEST.validate(), Ok(()));
        let bounds = |error_px, rate_fps| QualityBounds { error_px, rate_fps }.validate();
        assert_eq!(bounds(ERROR_PX_MAX, Some(RATE_FPS_MAX)), Ok(()));
        for error_px in [-0.1, f64::NAN, f64::INFINITY, ERROR_PX_MAX + 1.0] {
            assert!(bounds(error_px, None).is_err_and(|error| error.contains("0 to 64 pixels")));
        }
        for rate in [0.0, -1.0, f64::NAN, 1e9] {
            let refused = bounds(0.0, Some(rate));
            assert!(refused.is_err_and(|error| error.contains("1 to 1000 frames per second")));
        }
    }

    #[test]
    fn views_without_a_density_are_drawn_finest() {
        let densities = vec![1000.0, 0.0, f64::NAN, 1e-320];
        let bound = DetailBound { error_px: 2.0, densities, ..DetailBound::default() };
        let allowed: Vec<f64> = (0..5).map(|view| bound.allowed_in(view)).collect();
        assert_eq!(allowed, [0.002, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(DetailBound::default().allowed_in(0), 0.0);
    }

    #[test]
    fn two_steps_of_resolution_halve_the_pixels_and_no_step_is_below_a_quarter() {
        let scales: Vec<f64> = (0..=RESOLUTION_STEPS_MAX).map(resolution_scale).collect();
        assert_eq!((scales[0], scales[4], scales[8]), (1.0, 0.5, 0.25));
        for pair in scales.windows(3) {
            assert!((pair[2] * pair[2] / (pair[0] * pair[0]) - 0.5).abs() < 1e-12, "{scales:?}");
        }
        assert_eq!(resolution_scale(u8::MAX), 0.25);
    }
}
