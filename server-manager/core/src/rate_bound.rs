//! The error bound in force: as small as the rate bound lets it be.
//!
//! ```text
//! too slow: rises at once, by as much as the frame was too slow
//! on time, by less than it falls for: stays
//! faster for 8 frames: falls by 3 % a frame, but not to where it was too slow lately
//! ```
//!
//! The gap between rising and falling, and the memory of the bound that was too slow, keep it from
//! swinging: one that is too slow again and again is tried ever more rarely.

use polyptych_protocol::quality_bounds::{ERROR_PX_MAX, QualityBounds};
use serde::{Deserialize, Serialize};

use super::Micros;

/// The share of a frame's period that drawing may take: the rest is for the barrier and the swap.
const BUDGET_FRACTION: f64 = 0.9;

/// The share of the budget below which there is room for more detail. The gap up to the budget is
/// wider than what a step of [`FALL_FACTOR`] adds to a frame.
const ROOM_FRACTION: f64 = 0.9;

/// Frames that must all have had room before the bound falls.
const ROOM_FRAMES: u32 = 8;

/// The bound after a frame with room, as a multiple of that before: half in 23 frames.
const FALL_FACTOR: f64 = 0.97;

/// Range of the step by which the bound rises: a frame that took four times as long may have been
/// held up by something else.
const RISE_FACTORS: [f64; 2] = [1.02, 4.0];

/// The least bound above 0, in pixels: the first step up, and where falling ends.
const STEP_PX: f64 = 0.0625;

/// Frames for which a bound that was too slow is not tried again: at first, and at most.
const HOLD_FRAMES: [u32; 2] = [32, 1024];

/// Two bounds within this factor are the same for [`HOLD_FRAMES`].
const SAME_FACTOR: f64 = 1.25;

/// Frames at the largest bound that are too slow before this is said.
const UNMET_FRAMES: u32 = 10;

/// The controller of the error bound.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct RateBound {
    /// In pixels; what is asked for where that is more.
    in_force_px: f64,
    /// Frames with room since the last without.
    roomy: u32,
    /// The bound that was too slow lately.
    slow_px: f64,
    /// Frames for which it is remembered, and for how many it was remembered from the first.
    hold: u32,
    hold_from: u32,
    /// Frames at the largest bound that were too slow, one after another.
    unmet: u32,
}

impl RateBound {
    /// The bound of the next frame, in pixels.
    pub fn in_force_px(&self, asked: &QualityBounds) -> f64 {
        let bound = if asked.rate_fps.is_some() { self.in_force_px } else { 0.0 };
        bound.max(asked.error_px)
    }

    /// Returns whether even the largest bound does not keep the rate.
    pub fn is_unmet(&self, asked: &QualityBounds) -> bool {
        asked.rate_fps.is_some() && self.unmet >= UNMET_FRAMES
    }

    /// Forgets: another scene takes another time.
    pub fn restart(&mut self) {
        *self = Self::default();
    }

    /// Takes the time in which the slowest server drew a frame that the wall waited for, with this
    /// bound.
    pub fn add(&mut self, asked: &QualityBounds, draw_us: Micros, px: f64) {
        let Some(used) = used(asked, draw_us) else {
            self.restart();
            return;
        };
        self.hold = self.hold.saturating_sub(1);
        if used > 1.0 {
            self.rise(px, used);
        } else {
            self.unmet = 0;
            self.roomy = if used < ROOM_FRACTION { self.roomy + 1 } else { 0 };
            if self.roomy >= ROOM_FRAMES {
                self.fall(self.in_force_px(asked));
            }
        }
    }

    /// Takes the time of a channel that the wall did not wait for, which may have drawn an older
    /// frame with another bound: one that is too slow with this bound needs a larger one.
    pub fn add_late(&mut self, asked: &QualityBounds, draw_us: Micros, px: f64) {
        if let Some(used) = used(asked, draw_us)
            && used > 1.0
        {
            self.rise(px, used);
        }
    }

    fn rise(&mut self, px: f64, used: f64) {
        let is_same = px <= self.slow_px * SAME_FACTOR && px >= self.slow_px / SAME_FACTOR;
        let [first, most] = HOLD_FRAMES;
        self.hold_from = if is_same { (self.hold_from * 2).clamp(first, most) } else { first };
        (self.slow_px, self.hold, self.roomy) = (px, self.hold_from, 0);
        self.unmet = if px >= ERROR_PX_MAX { self.unmet.saturating_add(1) } else { 0 };
        let [least, greatest] = RISE_FACTORS;
        let step = used.clamp(least, greatest);
        let higher = (px.max(STEP_PX) * step).min(ERROR_PX_MAX);
        // A report of an older frame asks again for what was done.
        self.in_force_px = self.in_force_px.max(higher);
    }

    fn fall(&mut self, px: f64) {
        let least = if self.hold > 0 { (self.slow_px * RISE_FACTORS[0]).min(px) } else { 0.0 };
        let lower = (px * FALL_FACTOR).max(least);
        self.in_force_px = if lower < STEP_PX { least } else { lower };
    }
}

/// The share of a frame's budget that a drawing took; `None` without a rate bound.
fn used(asked: &QualityBounds, draw_us: Micros) -> Option<f64> {
    asked.rate_fps.map(|rate| draw_us as f64 * rate / (1e6 * BUDGET_FRACTION))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const RATE: f64 = 20.0;
    const PERIOD_US: f64 = 1e6 / RATE;

    fn asked(error_px: f64) -> QualityBounds {
        QualityBounds { error_px, rate_fps: Some(RATE) }
    }

    /// A wall whose frames take a fixed time, and one that falls with a power of the bound.
    #[derive(Clone, Copy, Debug)]
    struct Model {
        fixed_us: f64,
        full_us: f64,
        /// The bound at which the time has fallen to a half of `full_us`, in pixels.
        half_px: f64,
        power: f64,
    }

    impl Model {
        fn draw_us(&self, px: f64) -> f64 {
            self.fixed_us + self.full_us / (1.0 + (px / self.half_px).powf(self.power))
        }

        /// The smallest bound that keeps the period.
        fn best_px(&self) -> f64 {
            let (mut low, mut high) = (0.0, ERROR_PX_MAX);
            for _ in 0..60 {
                let middle = f64::midpoint(low, high);
                if self.draw_us(middle) > PERIOD_US { low = middle } else { high = middle }
            }
            high
        }
    }

    /// The bounds of the frames, and how many were late.
    fn run(
        bound: &mut RateBound,
        asked: &QualityBounds,
        frames: u32,
        at: impl Fn(u32, f64) -> f64,
    ) -> (Vec<f64>, u32) {
        let mut late = 0;
        let mut bounds = Vec::new();
        for frame in 0..frames {
            let px = bound.in_force_px(asked);
            let draw_us = at(frame, px);
            late += u32::from(draw_us > PERIOD_US);
            bounds.push(px);
            bound.add(asked, draw_us as Micros, px);
        }
        (bounds, late)
    }

    /// A third of a second at full detail: 3 frames per second.
    const CITY: Model = Model { fixed_us: 8_000.0, full_us: 325_000.0, half_px: 0.3, power: 1.4 };

    #[test]
    fn without_a_rate_bound_the_error_bound_is_what_was_asked_for() {
        let mut bound = RateBound::default();
        let asked = QualityBounds { error_px: 0.5, rate_fps: None };
        for _ in 0..50 {
            bound.add(&asked, 10_000_000, 0.5);
            assert_eq!(bound.in_force_px(&asked), 0.5);
        }
    }

    #[test]
    fn it_comes_near_the_best_constant_bound_and_stays_there() {
        let mut bound = RateBound::default();
        let (bounds, late) = run(&mut bound, &asked(0.0), 400, |_, px| CITY.draw_us(px));
        assert!(late <= 5, "{late} late frames");
        let last = &bounds[200..];
        let best = CITY.best_px();
        assert!(last.iter().all(|px| (1.0..=1.3).contains(&(px / best))), "{last:?}, best {best}");
        let turns = last.windows(2).filter(|pair| pair[1] > pair[0]).count();
        assert_eq!(turns, 0, "it swings: {last:?}");
    }

    #[test]
    fn a_load_step_up_is_followed_within_frames_and_one_down_slowly() {
        let heavy = Model { full_us: CITY.full_us * 4.0, ..CITY };
        let mut bound = RateBound::default();
        let at = |frame, px| if (300..600).contains(&frame) { heavy } else { CITY }.draw_us(px);
        let (bounds, late) = run(&mut bound, &asked(0.0), 1200, at);
        assert!(late <= 8, "{late} late frames");
        assert!((1.0..=1.3).contains(&(bounds[599] / heavy.best_px())), "{}", bounds[599]);
        assert!((1.0..=1.3).contains(&(bounds[1199] / CITY.best_px())), "{}", bounds[1199]);
    }

    #[test]
    fn detail_that_cannot_keep_the_rate_is_said() {
        let mut bound = RateBound::default();
        run(&mut bound, &asked(0.0), 5, |_, _| 2.0 * PERIOD_US);
        assert!(!bound.is_unmet(&asked(0.0)));
        let (bounds, _) = run(&mut bound, &asked(0.0), 40, |_, _| 2.0 * PERIOD_US);
        assert_eq!(bounds.last(), Some(&ERROR_PX_MAX));
        assert!(bound.is_unmet(&asked(0.0)));
        run(&mut bound, &asked(0.0), 1, |_, _| 0.5 * PERIOD_US);
        assert!(!bound.is_unmet(&asked(0.0)));
    }

    #[test]
    fn a_wall_that_is_fast_enough_draws_what_was_asked_for() {
        let mut bound = RateBound::default();
        // One frame that something else held up.
        let at = |frame, _| if frame == 10 { 3.0 * PERIOD_US } else { 0.2 * PERIOD_US };
        let (bounds, _) = run(&mut bound, &asked(0.25), 200, at);
        assert_eq!(bounds[..11], [0.25; 11]);
        assert!(bounds[11] > 0.25);
        assert_eq!(bounds[199], 0.25);
        let (bounds, _) = run(&mut bound, &asked(0.0), 100, |_, _| 0.2 * PERIOD_US);
        assert_eq!(bounds[99], 0.0);
    }

    proptest! {
        #[test]
        fn a_flight_with_noise_is_in_time(
            fixed in 1_000.0..20_000.0_f64,
            full in 60_000.0..600_000.0_f64,
            half in 0.05..2.0_f64,
            power in 1.0..2.0_f64,
            seed in any::<u32>(),
        ) {
            let mut bound = RateBound::default();
            let at = |frame: u32, px: f64| {
                // The load swings by half within 200 frames, and every frame by 4 %.
                let load = 1.0 + 0.5 * (f64::from(frame) / 200.0 * std::f64::consts::TAU).sin();
                let mut noise = frame.wrapping_add(seed).wrapping_mul(2_654_435_761);
                noise ^= noise >> 15;
                let noise = 1.0 + 0.04 * (f64::from(noise % 2001) / 1000.0 - 1.0);
                let model = Model { fixed_us: fixed, full_us: full * load, half_px: half, power };
                model.draw_us(px) * noise
            };
            let (bounds, late) = run(&mut bound, &asked(0.0), 1000, at);
            prop_assert!(late <= 30, "{late} of 1000 late; {bounds:?}");
        }
    }
}
