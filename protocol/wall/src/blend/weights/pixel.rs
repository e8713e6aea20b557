//! The shares of the pixels of a cell that other channels may light.

use glam::{DVec2, DVec3};

use super::super::BlendWeight;
use super::super::stereo::{self, EyeContribution};
use super::patch::Row;
use super::{Cell, Here, Neighbour, Raster};

/// By how much an interpolated place may make a weight wrong: an eighth of what a sum of weights
/// may be off by, for four channels and more. Elsewhere places are exact: in steep ramps, and where
/// outer edges cross, around which weights turn within a pixel.
const WEIGHT_ERROR_MAX: f64 = 1.0 / 32768.0;

/// Parts of a pixel, across and down, that are checked for light where an edge of another picture
/// runs through the pixel.
const PARTS: u32 = 8;

/// The pixels of a cell.
pub(super) struct Pixels<'p, 'l, 'w> {
    raster: &'p Raster<'l, 'w>,
    cell: &'p Cell,
    here: &'p [Here<'l, 'w>],
    /// `true` if all places of the cell can be interpolated.
    is_patched: bool,
    /// The places of the channels that are here, for the row that was begun.
    rows: Vec<Row>,
    seen: Vec<Seen<'p, 'l, 'w>>,
    lights: Vec<EyeContribution>,
}

/// A place of another channel's picture.
struct Seen<'p, 'l, 'w> {
    other: &'p Neighbour<'l, 'w>,
    place: DVec2,
    /// Maximum error of the place, in pixels.
    error_px: f64,
    /// Its step from pixel to pixel, across and down.
    slope: [DVec2; 2],
}

impl<'p, 'l, 'w> Pixels<'p, 'l, 'w> {
    pub fn new(
        raster: &'p Raster<'l, 'w>,
        cell: &'p Cell,
        here: &'p [Here<'l, 'w>],
        is_lit: bool,
    ) -> Self {
        let is_patched = is_lit && here.iter().all(|here| here.patch.is_some());
        let (rows, seen, lights) = (Vec::new(), Vec::new(), Vec::new());
        Self { raster, cell, here, is_patched, rows, seen, lights }
    }

    pub fn begin_row(&mut self, y: u32) {
        self.rows.clear();
        if self.is_patched {
            let y = f64::from(y - self.cell.begin.y) + 0.5;
            self.rows.extend(self.here.iter().filter_map(|here| Some(here.patch.as_ref()?.row(y))));
        }
    }

    /// The share of a pixel of the row that was begun.
    pub fn share(&mut self, x: u32, y: u32) -> BlendWeight {
        let pixel = DVec2::new(f64::from(x), f64::from(y)) + 0.5;
        if self.is_patched {
            self.see_patches(pixel.x - f64::from(self.cell.begin.x));
            if let Some(share) = self.share_among(pixel) {
                return share;
            }
        }
        let is_seen = self.see_exactly(pixel).is_some();
        let share = if is_seen { self.share_among(pixel) } else { None };
        share.unwrap_or(BlendWeight { weight: 0.0, black: DVec3::ZERO })
    }

    /// Finds places by the cell's patches.
    fn see_patches(&mut self, x: f64) {
        self.seen.clear();
        for (here, row) in self.here.iter().zip(&self.rows) {
            let Some(patch) = &here.patch else { continue };
            let (place, slope) = (row.at(x), row.slope(x));
            let error_px = patch.error_px;
            self.seen.push(Seen { other: &here.other, place, error_px, slope });
        }
    }

    /// Finds places where they are; `None` where the pixel misses the screen.
    fn see_exactly(&mut self, pixel: DVec2) -> Option<()> {
        self.seen.clear();
        let lamp = self.raster.lamp;
        let spot = lamp.spot(pixel)?;
        let beside = |by: DVec2| [by, -by].map(|by| lamp.spot(pixel + by));
        let beside = [beside(DVec2::X * 0.5), beside(DVec2::Y * 0.5)];
        for Here { other, .. } in self.here {
            let Some(place) = other.lamp.pixel_of(&spot) else { continue };
            let slope = beside.each_ref().map(|spots| {
                let places = spots.each_ref().map(|spot| other.lamp.pixel_of(spot.as_ref()?));
                match places {
                    [Some(ahead), Some(behind)] => ahead - behind,
                    [Some(ahead), None] => (ahead - place) * 2.0,
                    [None, Some(behind)] => (place - behind) * 2.0,
                    [None, None] => DVec2::ZERO,
                }
            });
            self.seen.push(Seen { other, place, error_px: 0.0, slope });
        }
        Some(())
    }

    /// The share of a pixel whose places in other pictures are those seen; `None` where they are
    /// too far off for it.
    fn share_among(&mut self, pixel: DVec2) -> Option<BlendWeight> {
        self.lights.clear();
        self.lights.extend(self.seen.iter().map(Seen::light));
        if self.lights.iter().all(|light| light.step.is_none() && light.part == 0.0) {
            return Some(self.raster.lamp.alone());
        }
        let Raster { lamp, widths, exponent, .. } = self.raster;
        let own = lamp.ramp(pixel, *widths);
        let share =
            stereo::blend_weight(EyeContribution::full_pixel(lamp, own), &self.lights, *exponent);
        let is_exact = self.seen.iter().all(|seen| seen.error_px == 0.0);
        let is_good = is_exact || share.weight * self.error(own) <= WEIGHT_ERROR_MAX;
        is_good.then_some(share)
    }

    /// Returns the error of a pixel's weight for this step, as a share of the weight: the sum over
    /// the other channels of ∂w/∂r times the error of r.
    fn error(&self, own: f64) -> f64 {
        let exponent = self.raster.exponent;
        let lit = || {
            let all = self.seen.iter().zip(&self.lights);
            all.filter_map(|(seen, light)| Some((seen, light.step.filter(|step| *step > 0.0)?)))
        };
        let most = lit().map(|(_, step)| step).fold(own, f64::max);
        let errors = lit().map(|(seen, step)| {
            let relative = seen.other.lamp.ramp_slope(seen.place, seen.other.widths);
            (step / most).powf(exponent) * exponent * relative * seen.error_px
        });
        errors.sum()
    }
}

impl Seen<'_, '_, '_> {
    fn light(&self) -> EyeContribution {
        let other = self.other;
        let step =
            other.lamp.contains(self.place).then(|| other.lamp.ramp(self.place, other.widths));
        let (eye, is_before) = (other.lamp.eye(), other.is_before);
        EyeContribution { eye, step, is_before, part: self.lit_part(), leak: other.lamp.leak }
    }

    /// Returns the part of the pixel that the other channel lights: an edge of a picture that runs
    /// askew through a pixel ends its black within it.
    fn lit_part(&self) -> f64 {
        let lamp = self.other.lamp;
        let reach = (self.slope[0].abs() + self.slope[1].abs()) * 0.5;
        let (low, high) = (self.place - reach, self.place + reach);
        if lamp.contains(low) && lamp.contains(high) {
            return 1.0;
        }
        if high.cmple(DVec2::ZERO).any() || low.cmpge(lamp.size).any() {
            return 0.0;
        }
        let part = |at: u32| (f64::from(at) + 0.5) / f64::from(PARTS) - 0.5;
        let parts = (0..PARTS).flat_map(|y| (0..PARTS).map(move |x| (part(x), part(y))));
        let is_lit = |(x, y): &(f64, f64)| {
            lamp.contains(self.place + self.slope[0] * *x + self.slope[1] * *y)
        };
        parts.filter(is_lit).count() as f64 / f64::from(PARTS * PARTS)
    }
}
