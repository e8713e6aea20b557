//! The controller on models of walls.

use proptest::prelude::*;

use polyptych_protocol::quality_bounds::ERROR_PX_MAX;

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
        let reduction = bound.in_force(asked);
        let draw_us = at(frame, px);
        late += u32::from(draw_us > PERIOD_US);
        bounds.push(px);
        bound.add(asked, draw_us as Micros, 0, reduction);
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
        bound.add(&asked, 10_000_000, 0, Reduction::new(0.5));
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
fn full_detail_that_is_too_slow_is_tried_ever_more_rarely() {
    let model = Model { fixed_us: 8e3, full_us: 60e3, half_px: 0.05, power: 1.4 };
    let (bounds, late) =
        run(&mut RateBound::default(), &asked(0.0), 2_000, |_, px| model.draw_us(px));
    // The first frame, and one after each of the holds of 32, 64, 128, 256 and 512 frames.
    assert!((2..=10).contains(&late), "{late} late frames");
    assert!(bounds.iter().all(|px| (0.0..=0.1).contains(px)), "{bounds:?}");
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

#[test]
fn a_lead_leaves_less_of_the_period_to_draw_in() {
    let asked = asked(0.0);
    let us = |share: f64| (share * PERIOD_US) as Micros;
    // Shares of the period: the lead, and drawings that keep the rate and that do not.
    for (lead, kept, slow) in [(0.0, 0.89, 0.91), (0.5, 0.44, 0.46), (0.95, 0.044, 0.046)] {
        for (draw, is_kept) in [(kept, true), (slow, false)] {
            let (mut awaited, mut late) = (RateBound::default(), RateBound::default());
            for _ in 0..100 {
                let reduction = awaited.in_force(&asked);
                awaited.add(&asked, us(draw), us(lead), reduction);
                late.add_late(&asked, ChannelId(0), us(draw), us(lead), Reduction::default());
            }
            for bound in [awaited, late] {
                let px = bound.in_force_px(&asked);
                assert_eq!(px == 0.0, is_kept, "{px} px, {draw} with a lead of {lead}");
            }
        }
    }
}

#[test]
fn a_lead_of_the_whole_period_is_told_and_costs_no_detail() {
    let asked = asked(0.0);
    for lead in [1.0, 1.5] {
        let lead_us = (lead * PERIOD_US) as Micros;
        let mut bound = RateBound::default();
        run(&mut bound, &asked, 5, |_, _| 2.0 * PERIOD_US);
        assert!(bound.in_force_px(&asked) > 0.0);
        for _ in 0..UNMET_FRAMES {
            let reduction = bound.in_force(&asked);
            bound.add(&asked, 1_000, lead_us, reduction);
        }
        bound.add_late(&asked, ChannelId(0), 1_000_000, lead_us, Reduction::default());
        assert_eq!(bound.in_force_px(&asked), 0.0);
        assert!(bound.is_unmet(&asked));
    }
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

/// A wall whose time goes into pixels as well: a model of its triangles, and a time of all pixels.
#[derive(Clone, Copy, Debug)]
struct PixelModel {
    triangles: Model,
    pixels_us: f64,
}

impl PixelModel {
    fn draw_us(&self, reduction: Reduction) -> f64 {
        let pixels = reduction.pixels_of(Reduction::default());
        self.triangles.draw_us(reduction.error_px()) + self.pixels_us * pixels
    }
}

/// The reductions of the frames, and how many were late.
fn reductions(frames: u32, at: impl Fn(u32, Reduction) -> f64) -> (Vec<Reduction>, u32) {
    let (mut bound, asked, mut late) = (RateBound::default(), asked(0.0), 0);
    let mut all = Vec::new();
    for frame in 0..frames {
        let reduction = bound.in_force(&asked);
        let draw_us = at(frame, reduction);
        late += u32::from(draw_us > PERIOD_US);
        all.push(reduction);
        bound.add(&asked, draw_us as Micros, 0, reduction);
    }
    (all, late)
}

/// Half of a second for the pixels of a channel, whatever its detail.
const FOG: PixelModel = PixelModel { triangles: CITY, pixels_us: 90_000.0 };

#[test]
fn resolution_keeps_a_rate_that_detail_alone_does_not() {
    let (all, late) = reductions(600, |_, reduction| FOG.draw_us(reduction));
    assert!(late <= 8, "{late} late frames: {all:?}");
    let steps: Vec<u8> = all.iter().map(|reduction| reduction.resolution_steps()).collect();
    let last = &steps[100..];
    // 31 ms are left for pixels: three steps, 35 %, are 31.8 ms, and four are 22.5 ms.
    assert!(last.iter().all(|&steps| (3..=4).contains(&steps)), "{steps:?}");
    assert!(all[100..].iter().all(|reduction| reduction.error_px() == 8.0));
    let turns = last.windows(2).filter(|pair| pair[1] != pair[0]).count();
    assert_eq!(turns, 0, "it swings: {steps:?}");
}

#[test]
fn resolution_comes_back_slowly_when_the_load_goes() {
    let light = PixelModel { pixels_us: 5_000.0, ..FOG };
    let load = |frame| if frame < 300 { FOG } else { light };
    let (all, late) = reductions(900, |frame, reduction| load(frame).draw_us(reduction));
    assert!(late <= 12, "{late} late frames");
    let steps: Vec<u8> = all.iter().map(|reduction| reduction.resolution_steps()).collect();
    assert!(steps[299] >= 3 && steps[899] == 0, "{steps:?}");
    assert!(steps[300..].windows(2).all(|pair| pair[1] <= pair[0]), "no way back: {steps:?}");
    assert!(steps[310] >= 3 && steps[330] > 0, "slowly: {steps:?}");
    assert!(all[899].error_px() < 8.0, "and the detail after it");
}

#[test]
fn resolution_comes_back_where_time_does_not_go_into_pixels() {
    // A stall of six frames; all others take 70 % of their time, whatever they draw.
    let stall = |frame: u32| (100..106).contains(&frame);
    let time = |frame| if stall(frame) { 4.0 * PERIOD_US } else { 0.63 * PERIOD_US };
    let (all, late) = reductions(800, |frame, _| time(frame));
    assert_eq!(late, 6);
    let steps: Vec<u8> = all.iter().map(|reduction| reduction.resolution_steps()).collect();
    assert!(steps[110] >= 2, "{steps:?}");
    assert_eq!(steps[799], 0, "{steps:?}");
    assert!(steps[110..].windows(2).all(|pair| pair[1] <= pair[0]), "no way back: {steps:?}");
}

#[test]
fn an_error_bound_that_was_asked_for_does_not_lower_the_resolution() {
    let bound = RateBound::default();
    for error_px in [0.0, 7.0, 20.0, ERROR_PX_MAX] {
        assert_eq!(bound.in_force_px(&asked(error_px)), error_px);
        assert_eq!(bound.resolution_steps(&asked(error_px)), 0);
    }
    // A step up from there lowers it at once.
    let (mut bound, asked) = (RateBound::default(), asked(20.0));
    bound.add(&asked, (2.0 * PERIOD_US) as Micros, 0, bound.in_force(&asked));
    assert!(bound.resolution_steps(&asked) >= 2);
    assert_eq!(bound.in_force_px(&asked), 20.0);
    let unbounded = QualityBounds { rate_fps: None, ..asked };
    assert_eq!(bound.resolution_steps(&unbounded), 0, "all pixels without a rate bound");
}

proptest! {
    #[test]
    fn a_flight_that_needs_resolution_is_in_time_and_does_not_swing(
        fixed in 1_000.0..15_000.0_f64,
        full in 0.0..300_000.0_f64,
        pixels in 40_000.0..200_000.0_f64,
        seed in any::<u32>(),
    ) {
        let triangles = Model { fixed_us: fixed, full_us: full, half_px: 0.3, power: 1.4 };
        let model = PixelModel { triangles, pixels_us: pixels };
        let (all, late) = reductions(1000, |frame, reduction| {
            let mut noise = frame.wrapping_add(seed).wrapping_mul(2_654_435_761);
            noise ^= noise >> 15;
            let noise = 1.0 + 0.04 * (f64::from(noise % 2001) / 1000.0 - 1.0);
            model.draw_us(reduction) * noise
        });
        // Up to 14 in 100,000 of these until the resolution is lowered enough.
        prop_assert!(late <= 20, "{late} of 1000 late: {all:?}");
        let steps: Vec<u8> = all.iter().map(|reduction| reduction.resolution_steps()).collect();
        let turns = steps[200..].windows(2).filter(|pair| pair[1] != pair[0]).count();
        // Tries of the next resolution, ever more rarely, and back.
        prop_assert!(turns <= 12, "{turns} changes: {steps:?}");
    }
}
