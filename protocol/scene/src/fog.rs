//! Fog: how much of the light of a surface reaches the eye.

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Largest number of units in a fog, as a distance or a height, and the smallest's reciprocal.
const UNITS_MAX: f64 = 1e15;

/// The share of a contrast that is left at the limit of sight: World Meteorological Organization,
/// "Guide to Instruments and Methods of Observation" (WMO-No. 8), meteorological optical range.
const LIMIT_SHARE: f64 = 0.05;

/// A fog that fills the world, evenly or in a layer over the ground.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fog {
    /// World units through which 5 % of the light pass, at `height`: the meteorological optical
    /// range. Above 0.
    pub visibility: f64,
    /// The Y at which it has this density, in world units.
    pub height: f64,
    /// With each so many units above, half of the density is left, and below there is twice as
    /// much. `None`: it is the same everywhere.
    pub half_height: Option<f64>,
    /// The share of red, green and blue that it scatters, 0 to 1: white is a fog of water.
    pub color: [f32; 3],
}

impl Fog {
    /// A white fog that is the same everywhere.
    pub fn even(visibility: f64) -> Self {
        Self { visibility, height: 0.0, half_height: None, color: [1.0; 3] }
    }

    /// Returns what is wrong with it, if anything.
    pub fn fault(&self) -> Option<String> {
        let is_length = |length: f64| (UNITS_MAX.recip()..=UNITS_MAX).contains(&length);
        let Self { visibility, height, half_height, color } = self;
        if !is_length(*visibility) {
            return Some(format!(
                "a fog has a visibility above 0 and up to 1e15, not {visibility}"
            ));
        }
        if height.is_nan() || height.abs() > UNITS_MAX {
            return Some(format!("the height of a fog is a number up to 1e15, not {height}"));
        }
        if let Some(half) = half_height.filter(|half| !is_length(*half)) {
            return Some(format!("a fog thins to a half in more than 0 units, not in {half}"));
        }
        let is_color = color.iter().all(|share| (0.0..=1.0).contains(share));
        (!is_color).then(|| format!("a fog scatters 0 to 1 of each colour, not {color:?}"))
    }

    /// The factor e by which it thins, per unit of height.
    pub fn fall(&self) -> f64 {
        self.half_height.map_or(0.0, |half| std::f64::consts::LN_2 / half)
    }

    /// The natural logarithm of the share of light that it takes away per unit, at a height.
    pub fn log_density(&self, y: f64) -> f64 {
        (-LIMIT_SHARE.ln() / self.visibility).ln() - self.fall() * (y - self.height)
    }

    /// The share of light that passes from a point to the eye: e to minus the density along the
    /// way, which is the mean over the heights between both (Beer and Lambert). Accurate to 1e-12
    /// of that logarithm.
    pub fn passed(&self, eye: DVec3, point: DVec3) -> f64 {
        let rise = self.fall() * (point.y - eye.y);
        // From the lower end on, so that no number is out of range.
        let lower = self.log_density(eye.y.min(point.y)).exp();
        let steep = rise.abs();
        let mean = if steep < 1e-12 { 1.0 } else { -(-steep).exp_m1() / steep };
        (-lower * mean * eye.distance(point)).exp()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn at_the_limit_of_sight_a_twentieth_of_the_light_is_left() {
        let fog = Fog { height: 3.0, half_height: Some(7.0), ..Fog::even(500.0) };
        let at = |y: f64| DVec3::new(500.0, y, 0.0);
        assert!((fog.passed(DVec3::Y * 3.0, at(3.0)) - 0.05).abs() < 1e-12);
        // 7 above there is half of it, which is the root.
        assert!((fog.passed(DVec3::Y * 10.0, at(10.0)) - 0.05_f64.sqrt()).abs() < 1e-12);
        assert!((Fog::even(500.0).passed(DVec3::Y * 9.0, at(9.0)) - 0.05).abs() < 1e-12);
    }

    #[test]
    fn what_passes_is_the_product_over_the_way() {
        let fog = Fog { height: -2.0, half_height: Some(5.0), ..Fog::even(40.0) };
        let eye = DVec3::new(1.0, 6.0, -3.0);
        for point in [
            DVec3::new(9.0, -8.0, 2.0),
            DVec3::new(0.0, 30.0, 1.0),
            DVec3::new(4.0, 6.0 + 1e-9, 0.0),
            DVec3::new(1.0, -40.0, -3.0),
        ] {
            const STEPS: u32 = 200_000;
            let length = eye.distance(point) / f64::from(STEPS);
            let density = |step: u32| {
                let at = eye.lerp(point, (f64::from(step) + 0.5) / f64::from(STEPS));
                fog.log_density(at.y).exp() * length
            };
            let wanted: f64 = (0..STEPS).map(density).sum();
            let found = -fog.passed(eye, point).ln();
            assert!((found - wanted).abs() < 1e-8 * wanted, "{point}: {found} is not {wanted}");
            assert_eq!(fog.passed(eye, point), fog.passed(point, eye));
        }
    }

    #[test]
    fn a_fog_far_below_or_above_is_nothing_or_a_wall() {
        let fog = Fog { half_height: Some(1.0), ..Fog::even(10.0) };
        let [high, low] = [DVec3::Y * 1e9, DVec3::Y * -1e9];
        assert_eq!(fog.passed(high, high + DVec3::X * 1e6), 1.0);
        assert_eq!(fog.passed(high, low), 0.0);
        assert_eq!(fog.passed(low, low + DVec3::X), 0.0);
    }

    #[test]
    fn numbers_that_no_fog_has_are_named() {
        assert_eq!(Fog::even(1.0).fault(), None);
        let faults = [
            (Fog::even(0.0), "visibility"),
            (Fog::even(f64::NAN), "visibility"),
            (Fog::even(f64::INFINITY), "visibility"),
            (Fog { height: f64::NAN, ..Fog::even(1.0) }, "height"),
            (Fog { half_height: Some(-1.0), ..Fog::even(1.0) }, "half"),
            (Fog { color: [0.0, 1.5, 0.0], ..Fog::even(1.0) }, "colour"),
            (Fog { color: [f32::NAN; 3], ..Fog::even(1.0) }, "colour"),
        ];
        for (fog, part) in faults {
            assert!(fog.fault().is_some_and(|fault| fault.contains(part)), "{fog:?}");
        }
    }
}
