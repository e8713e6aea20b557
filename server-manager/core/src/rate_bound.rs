//! The detail and resolution in force: as high as the rate bound lets them be.
//!
//! ```text
//! too slow: rises at once, by as much as the frame was too slow
//! three rises have not halved what is too much: doubles with each frame
//! on time, by less than it falls for: stays
//! faster for 8 frames: falls by 3 % a frame, but not to where it was too slow lately
//! room for 64 frames, but not for a step of resolution if time goes into pixels: tries one
//! a late channel is too slow 8 times: not heard until the wall waits for it again
//! ```
//!
//! The gap between rising and falling, and the memory of the bound that was too slow, keep it from
//! swinging: one that is too slow again and again is tried ever more rarely. A step of resolution
//! adds much more to a frame than 3 %, so that it needs as much more room.
//!
//! The bound is a [`Reduction`]: of detail, and where that is not enough of resolution.

use std::collections::BTreeMap;

use polyptych_protocol::quality_bounds::QualityBounds;
use polyptych_wall::ChannelId;
use serde::{Deserialize, Serialize};

use super::Micros;
use super::reduction::Reduction;

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

/// Rises that together must halve the time that frames take too long: from then on each is at
/// least [`SOONER_FACTOR`], as what the bound saves is not where the time goes. Without it, a wall
/// whose time goes into pixels was late in 31 frames until its resolution was lowered.
const SOONER_RISES: u32 = 3;

/// The least factor of these rises.
const SOONER_FACTOR: f64 = 2.0;

/// Times that [`ROOM_FRAMES`] had room, but less than a step of resolution may need, before it is
/// tried all the same: the time may not go into pixels.
const TRIAL_ROUNDS: u32 = 8;

/// The least bound above 0, in pixels: the first step up, and where falling ends.
const STEP_PX: f64 = 0.0625;

/// Frames for which a bound that was too slow is not tried again: at first, and at most.
const HOLD_FRAMES: [u32; 2] = [32, 1024];

/// Two bounds within this factor are the same for [`HOLD_FRAMES`].
const SAME_FACTOR: f64 = 1.25;

/// Drawings of a channel that the wall does not wait for that may raise the bound. Eight that
/// take four times too long reach the largest bound from the least. A channel that is too slow
/// after them does not get faster by less detail, which all the others would lose for nothing.
const LATE_RISES_MAX: u32 = 8;

/// Frames at the largest bound that are too slow before this is said.
const UNMET_FRAMES: u32 = 10;

/// The controller of the error bound.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct RateBound {
    /// The reduction in force; the error that was asked for counts where that is more.
    in_force: Reduction,
    /// Frames with room since the last without.
    roomy: u32,
    /// The largest share of the budget that these took.
    peak: f64,
    /// Times that there was room since then, but not for a step of resolution.
    #[serde(default)]
    narrow: u32,
    /// The bound that was too slow lately.
    slow: Reduction,
    /// Frames for which it is remembered, and for how many it was remembered from the first.
    hold: u32,
    hold_from: u32,
    /// Frames at the largest bound that were too slow, one after another.
    unmet: u32,
    /// The time that a frame took too long, as a share of the budget, and the rises since then;
    /// it is another one where it has halved.
    excess: f64,
    rises: u32,
    /// Drawings of late channels that raised the bound, since the wall last waited for each.
    late_rises: BTreeMap<ChannelId, u32>,
}

impl RateBound {
    /// The reduction of the next frame; none by the rate, if it is not bounded.
    pub fn in_force(&self, asked: &QualityBounds) -> Reduction {
        let least = Reduction::of_error(asked.error_px);
        if asked.rate_fps.is_some() { self.in_force.max(least) } else { least }
    }

    /// The error bound of the next frame, in pixels.
    pub fn in_force_px(&self, asked: &QualityBounds) -> f64 {
        self.in_force(asked).error_px().max(asked.error_px)
    }

    /// The steps by which the resolution of the next frame is lowered.
    pub fn resolution_steps(&self, asked: &QualityBounds) -> u8 {
        self.in_force(asked).resolution_steps()
    }

    /// Returns whether even the largest bound does not keep the rate.
    pub fn is_unmet(&self, asked: &QualityBounds) -> bool {
        asked.rate_fps.is_some() && self.unmet >= UNMET_FRAMES
    }

    /// Forgets: another scene takes another time, and a lower rate leaves more.
    pub fn restart(&mut self) {
        *self = Self::default();
    }

    /// Takes another rate, in frames per second; `None` for none. Where it asks for less, all that
    /// the one before cost goes at once on a wall that is paused, which has no frames to lower it
    /// with. That the one before was not kept says nothing of another one. Returns whether there
    /// was anything to go.
    pub fn set_rate(&mut self, before: Option<f64>, rate: Option<f64>, is_paused: bool) -> bool {
        let asks_less = |rate: f64| is_paused && before.is_some_and(|before| rate < before);
        let is_restarted = before.is_some() && rate.is_none_or(asks_less);
        if is_restarted {
            self.restart();
        } else if rate != before {
            self.unmet = 0;
        }
        is_restarted
    }

    /// Takes the time in which the slowest server drew a frame that the wall waited for, with this
    /// bound. Servers draw nothing for `undrawn_us` of each period. If that leaves no time to draw
    /// in, the rate is unmet, and there is no reduction, since none would keep it.
    pub fn add(
        &mut self,
        asked: &QualityBounds,
        draw_us: Micros,
        undrawn_us: Micros,
        with: Reduction,
    ) {
        let Some(rate) = asked.rate_fps else {
            self.restart();
            return;
        };
        let Some(used) = used(rate, draw_us, undrawn_us) else {
            *self = Self { unmet: self.unmet.saturating_add(1), ..Self::default() };
            return;
        };
        self.hold = self.hold.saturating_sub(1);
        if used > 1.0 {
            self.rise(with, used);
        } else {
            (self.unmet, self.rises) = (0, 0);
            let (roomy, peak) = (self.roomy + 1, self.peak.max(used));
            (self.roomy, self.peak) = if used < ROOM_FRACTION { (roomy, peak) } else { (0, 0.0) };
            self.narrow = if self.roomy > 0 { self.narrow } else { 0 };
            if self.roomy >= ROOM_FRAMES {
                self.fall(self.in_force(asked));
            }
        }
    }

    /// Takes the time of a channel that the wall did not wait for, which may have drawn an older
    /// frame with another bound: one that is too slow with this bound needs a larger one. After
    /// [`LATE_RISES_MAX`] it is not heard until [`Self::record_awaited`]. It is not heard either
    /// if `undrawn_us` leaves no time to draw in.
    pub fn add_late(
        &mut self,
        asked: &QualityBounds,
        channel: ChannelId,
        draw_us: Micros,
        undrawn_us: Micros,
        with: Reduction,
    ) {
        let used = asked.rate_fps.and_then(|rate| used(rate, draw_us, undrawn_us));
        let Some(used) = used.filter(|used| *used > 1.0) else { return };
        let rises = self.late_rises.get(&channel).map_or(0, |&rises| rises);
        if rises < LATE_RISES_MAX {
            let before = self.in_force;
            self.rise(with, used);
            // What was drawn before the last rise, and asks for no more than it, does not count.
            let counts = with >= before || self.in_force > before;
            self.late_rises.insert(channel, rises + u32::from(counts));
        }
    }

    /// Records that the wall waited for this channel's drawing.
    pub fn record_awaited(&mut self, channel: ChannelId) {
        self.late_rises.remove(&channel);
    }

    fn rise(&mut self, with: Reduction, used: f64) {
        let (px, slow_px) = (with.number(), self.slow.number());
        let is_same = px <= slow_px * SAME_FACTOR && px >= slow_px / SAME_FACTOR;
        let [first, most] = HOLD_FRAMES;
        self.hold_from = if is_same { (self.hold_from * 2).clamp(first, most) } else { first };
        (self.slow, self.hold, self.roomy, self.peak) = (with, self.hold_from, 0, 0.0);
        self.narrow = 0;
        self.unmet = if with >= Reduction::MAX { self.unmet.saturating_add(1) } else { 0 };
        if self.rises == 0 || used - 1.0 < 0.5 * self.excess {
            (self.excess, self.rises) = (used - 1.0, 0);
        }
        let [least, greatest] = RISE_FACTORS;
        let least = if self.rises >= SOONER_RISES { SOONER_FACTOR } else { least };
        let higher = with.raised(used.clamp(least, greatest), STEP_PX);
        // A report of an older frame asks again for what was done.
        if higher > self.in_force {
            self.in_force = higher;
            self.rises += 1;
        }
    }

    fn fall(&mut self, from: Reduction) {
        let px = from.number();
        let slow_px = self.slow.number();
        // Above 0, or one that is too slow at 0 would be there again at once.
        let floor = (slow_px * RISE_FACTORS[0]).max(STEP_PX).min(px);
        let least = if self.hold > 0 { floor } else { 0.0 };
        let lower = (px * FALL_FACTOR).max(least);
        let lower = Reduction::new(if lower < STEP_PX { least } else { lower });
        let more = lower.pixels_of(from);
        if more > 1.0 {
            // The time of frames may all go with their pixels. Those that there was room in are
            // counted anew for each step.
            let has_room = self.peak * more < ROOM_FRACTION;
            (self.roomy, self.peak) = (0, 0.0);
            self.narrow = if has_room { 0 } else { self.narrow + 1 };
            if !has_room && (self.hold > 0 || self.narrow < TRIAL_ROUNDS) {
                return;
            }
            self.narrow = 0;
        }
        self.in_force = lower;
    }
}

/// Returns the share of a frame's budget that a drawing took; `None` without a budget.
fn used(rate_fps: f64, draw_us: Micros, undrawn_us: Micros) -> Option<f64> {
    budget_us(rate_fps, undrawn_us).map(|budget_us| draw_us as f64 / budget_us)
}

/// Returns the time that drawing may take of each frame, in microseconds: a share of what the time
/// in which servers draw nothing leaves of the period. `None` if it leaves nothing.
pub(super) fn budget_us(rate_fps: f64, undrawn_us: Micros) -> Option<f64> {
    let left_us = 1e6 / rate_fps - undrawn_us as f64;
    (left_us > 0.0).then_some(BUDGET_FRACTION * left_us)
}

#[cfg(test)]
mod tests;
