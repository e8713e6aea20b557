//! The light that comes together on each place of the wall, read back from the pictures of flat
//! fields: overlapping channels as bright as one, codes, and black.
//!
//! Nothing of this knows how a picture was made: displays give the light of the codes that they
//! got, by their curve, and what leaks with it; on each place the light of all is summed, and must
//! be that of the field. Where a channel's pixels are the canvas's, and where it is alone, each
//! pixel is judged; else light between pixels is linear, and judged as the mean of some pixels, as
//! a projector's black ends within a pixel of another one. What no eye can see is not judged: the
//! far side of a dome seen from outside, what stands behind a mesh, and a canvas where it has none.

use anyhow::Context;
use glam::{DMat3, DVec2, DVec3, UVec2};
use polyptych_wall::blend::BlendModel;
use polyptych_wall::calibration_maps::CalibrationMaps;
use polyptych_wall::channel_mapping::ChannelMapping;
use polyptych_wall::light_composite::{LinearImage, StereoEye};
use polyptych_wall::wall_geometry::{ResolvedWall, ScreenGeometry};
use polyptych_wall::{
    BitDepth, Channel, ChannelCalibration, ChannelKind, StereoPacking, Surface, TransferFunction,
    Viewpoint, Wall,
};

use crate::simulator::verify::fields::{Fields, GREYS};
use crate::simulator::verify::verification_report::{Bound, VerificationReport};

/// Maximum error of the light of overlaps at white, relative to the field's light: half a level
/// there is 0.5 %, of two displays together up to twice that.
const WEIGHTS_MAX: f64 = 0.01;

/// Codes may be off by half a level; the f32 of a GPU rounds some of them the other way.
const CODES_MAX: f64 = 1.1;

/// Pixels of a channel, and places of a canvas, that are looked at, across and down at most.
const PLACES_MAX: u32 = 192;

/// Pixels across and down over which light between pixels is a mean.
const WINDOW: u32 = 4;

/// Share of the canvas on which that mean must keep the bound. A leak's edge that runs askew is a
/// line of half-right pixels, and where outer edges cross a weight is 1 on one side and 0 on the
/// other: both are lines and points, and less of a picture of more pixels.
const WINDOWS_MIN: f64 = 0.995;

/// Minimum share of the canvas whose means keep the bound, if masks of files share the light: they
/// may end it at the border of the wall.
const MASKED_WINDOWS_MIN: f64 = 0.9;

/// Maximum distance between a point of a curved screen and the point that light thrown at it
/// reaches, in pixels of the canvas: beyond it, the light falls on a part in front of the point.
const LAYER_PX: f64 = 1.0;

/// Maximum distance between a point of a screen and the first one that an eye sees there, as a
/// share of its own distance plus 1 m.
const MISS_MAX: f64 = 1e-6;

/// Distance around a pixel within which the same channels must light the canvas, in pixels, for the
/// pixel to be judged alone.
const AROUND_PX: f64 = 1.5;

/// Judges the light of all screens. `is_as_built`: the wall is the one that stands, whose matrices
/// and gains undo what its displays do; else displays are alike.
///
/// # Errors
/// A channel without a picture, or one of another size than its display's.
pub(in crate::simulator::verify) fn verify(
    shaped: ResolvedWall<'_>,
    files: &CalibrationMaps,
    fields: &Fields,
    is_as_built: bool,
    table: &mut VerificationReport,
) -> anyhow::Result<()> {
    let wall = shaped.wall;
    let step = if wall.dither { 1.0 } else { 0.5 };
    let mut sums = Sums { step, ..Sums::default() };
    let mut screens = Vec::new();
    for index in 0..wall.screens.len() as u16 {
        for side in StereoEye::of(wall, index) {
            screens.push((index, lamps(shaped, files, fields, (index, *side), is_as_built)?));
        }
    }
    for (index, lamps) in &screens {
        let canvas = wall.screens[usize::from(*index)].canvas;
        let (most, black) = most(lamps, canvas);
        (sums.most, sums.all_black) = (sums.most.max(most), sums.all_black.max(black));
    }
    if is_as_built || is_alike(wall) {
        // A place where most leak may be smaller than the steps of the search.
        sums.all_black = sums.all_black.max(BlendModel::new(shaped).black());
    }
    for (index, lamps) in &screens {
        for at in 0..lamps.len() {
            sums.look(lamps, at);
        }
        sums.look_between(lamps, wall.screens[usize::from(*index)].canvas);
    }
    sums.report(table);
    Ok(())
}

/// Returns whether no channel's colours say that its display is unlike others.
fn is_alike(wall: &Wall) -> bool {
    wall.channels.iter().all(|channel| channel.adjustment.color.made() == DMat3::IDENTITY)
}

/// A channel that lights a screen for one eye.
struct LitChannel<'a> {
    channel: &'a Channel,
    ground: ScreenGeometry<'a>,
    /// Its eyes.
    eyes: Vec<Viewpoint>,
    pixels: ChannelMapping<'a>,
    /// The light of its codes, for each of [`GREYS`].
    shown: Vec<LinearImage<'a>>,
    /// From the light of codes to that of the display: it needs the matrix and gains of the wall
    /// as it was built, where somebody knows, because its light is what they undo.
    built: DMat3,
    /// The light that its display shows of black, as a share of its white.
    leak: DVec3,
    /// Its light is cut by a file: how much, only who made that knows.
    is_masked: bool,
    /// Its pixels are the canvas's.
    is_exact: bool,
    /// The axes of red, green and blue that its eye sees.
    axes: &'static [usize],
}

fn lamps<'a>(
    shaped: ResolvedWall<'a>,
    files: &CalibrationMaps,
    fields: &'a Fields,
    (screen, side): (u16, StereoEye),
    is_as_built: bool,
) -> anyhow::Result<Vec<LitChannel<'a>>> {
    let mut lamps = Vec::new();
    for id in shaped.wall.channel_ids() {
        let Some(channel) = shaped.wall.channel(id) else { continue };
        if channel.screen != screen || !side.sees(channel) {
            continue;
        }
        let Some(pixels) = shaped.channel_mapping(id) else { continue };
        let shown = fields.of(&channel.name)?.into_iter().map(|picture| {
            let light = LinearImage::new(shaped, id, side, &picture.rgba);
            light.with_context(|| format!("the picture of {} has no size", channel.name))
        });
        let ChannelCalibration { color, alpha, beta, .. } = &channel.adjustment;
        let is_lit_by_file = files.mesh_light_mask(channel, &pixels).is_some();
        let needed = DMat3::from_diagonal(color.gain) * color.matrix;
        lamps.push(LitChannel {
            channel,
            ground: shaped.shapes.screen(shaped.wall.screen_of(channel)),
            eyes: shaped.wall.viewpoints(channel),
            shown: shown.collect::<anyhow::Result<_>>()?,
            built: if is_as_built { needed.inverse() } else { DMat3::IDENTITY },
            leak: shaped.wall.leak_of(channel),
            is_masked: alpha.is_some() || beta.is_some() || is_lit_by_file,
            is_exact: channel.cover == ChannelKind::Tile
                && channel.adjustment.pin == [DVec2::ZERO; 4]
                && channel.adjustment.bend.is_none(),
            axes: match (channel.adjustment.packing, side) {
                (StereoPacking::Anaglyph, StereoEye::Left) => &[0],
                (StereoPacking::Anaglyph, StereoEye::Right) => &[1, 2],
                _ => &[0, 1, 2],
            },
            pixels,
        });
    }
    Ok(lamps)
}

impl LitChannel<'_> {
    /// The place of the picture that lights a place of the canvas.
    fn lit(&self, canvas: DVec2) -> Option<DVec2> {
        let pixel = self.pixels.pixel_from_canvas(canvas)?;
        let size = self.channel.size.as_dvec2();
        if !(pixel.cmpge(DVec2::ZERO).all() && pixel.cmplt(size).all()) {
            return None;
        }
        if matches!(self.channel.cover, ChannelKind::Projector(_)) {
            // Nothing is drawn beside the screen.
            self.pixels.drawn_from_pixel(pixel)?;
        }
        if self.is_flat() {
            return Some(pixel);
        }
        // A canvas may lie nowhere in places, and a curved screen may stand before itself.
        self.ground.display_from_canvas(canvas)?;
        let reached = self.pixels.canvas_from_pixel(pixel)?;
        (reached.distance(canvas) <= LAYER_PX).then_some(pixel)
    }

    fn is_flat(&self) -> bool {
        matches!(self.ground.screen.surface, Surface::Plane(_))
    }

    /// Returns whether some eye sees a place of the screen's canvas: its front, before all else.
    /// No wall has eyes behind a plane.
    fn is_seen(&self, canvas: DVec2) -> bool {
        if self.is_flat() {
            return true;
        }
        let Some(point) = self.ground.display_from_canvas(canvas) else { return false };
        self.eyes.iter().any(|eye| {
            let eye = eye.eye_for(point);
            let first = self.ground.hit(eye, point - eye);
            let slack = MISS_MAX * (1.0 + point.distance(eye));
            first.is_some_and(|(first, _)| first.distance(point) <= slack)
        })
    }

    /// A place between pixels of which some are dark, by what a file says or beside the screen of a
    /// projector: there is nothing to interpolate between.
    fn ends_at(&self, pixel: DVec2) -> bool {
        if self.channel.cover == ChannelKind::Tile && !self.ground.is_mesh() {
            return false;
        }
        let (low, last) = ((pixel - 0.5).floor() + 0.5, self.channel.size.as_dvec2() - 0.5);
        let around = [DVec2::ZERO, DVec2::X, DVec2::Y, DVec2::ONE];
        let mut around = around.map(|by| (low + by).clamp(DVec2::splat(0.5), last)).into_iter();
        around.any(|middle| self.pixels.drawn_from_pixel(middle).is_none())
    }

    /// Returns the light that it shows of black.
    fn black(&self) -> DVec3 {
        self.built * self.leak
    }

    /// The light of a place of the upright picture, with what leaks, linear between the middles
    /// of its pixels.
    fn light(&self, grey: usize, pixel: DVec2) -> DVec3 {
        let shown = &self.shown[grey];
        let last = self.channel.size - 1;
        let at = (pixel - 0.5).clamp(DVec2::ZERO, last.as_dvec2());
        let low = at.as_uvec2();
        let (high, t) = ((low + 1).min(last), at - low.as_dvec2());
        let row = |y: u32| {
            let (a, b) = (shown.pixel(UVec2::new(low.x, y)), shown.pixel(UVec2::new(high.x, y)));
            a.lerp(b, t.x)
        };
        self.built * shown.leaking(row(low.y).lerp(row(high.y), t.y))
    }
}

/// Those that light a place of the canvas, with the place of their pictures.
fn lit_at(lamps: &[LitChannel<'_>], canvas: DVec2) -> Vec<(usize, DVec2)> {
    let lit = |(at, lamp): (usize, &LitChannel<'_>)| Some((at, lamp.lit(canvas)?));
    lamps.iter().enumerate().filter_map(lit).collect()
}

/// The light of all, with what leaks.
fn light_of(lamps: &[LitChannel<'_>], lit: &[(usize, DVec2)], grey: usize) -> DVec3 {
    lit.iter().map(|(at, pixel)| lamps[*at].light(grey, *pixel)).sum()
}

/// Numbers from 0 to below `count`, both ends among them.
fn spread(count: u32) -> impl Iterator<Item = u32> + Clone {
    let steps = (count - 1).clamp(1, PLACES_MAX);
    let at = move |step: u32| (u64::from(step) * u64::from(count - 1) / u64::from(steps)) as u32;
    (0..=steps).map(at)
}

/// Returns the maximum number of channels that light one place, and the maximum light of their
/// black.
fn most(lamps: &[LitChannel<'_>], canvas: UVec2) -> (usize, DVec3) {
    let places = spread(canvas.y).flat_map(|y| spread(canvas.x).map(move |x| UVec2::new(x, y)));
    places.fold((0, DVec3::ZERO), |(most, black), place| {
        let lit = lit_at(lamps, place.as_dvec2() + 0.5);
        let own: DVec3 = lit.iter().map(|(at, _)| lamps[*at].black()).sum();
        (most.max(lit.len()), black.max(own))
    })
}

/// The worst, and where.
#[derive(Default)]
struct WorstErrors {
    off: f64,
    at: String,
    count: u64,
}

impl WorstErrors {
    fn add(&mut self, off: f64, at: impl FnOnce() -> String) {
        self.count += 1;
        if off > self.off || (self.at.is_empty() && off >= self.off) {
            (self.off, self.at) = (off, at());
        }
    }
}

/// Means over some pixels.
#[derive(Default)]
struct WindowMeans {
    all: u64,
    kept: u64,
    worst: WorstErrors,
}

/// The results of the pictures of flat fields.
#[derive(Default)]
struct Sums {
    /// The most black that the wall shows of a place.
    all_black: DVec3,
    /// Maximum error of a code in levels: half of one, and noise of another half.
    step: f64,
    /// The maximum number of channels that light one place.
    most: usize,
    codes: WorstErrors,
    black: WorstErrors,
    /// At white, where channels overlap.
    weights: WorstErrors,
    plain: WindowMeans,
    masked: WindowMeans,
}

impl Sums {
    /// At the middles of a channel's pixels, where those of all that light them are exact.
    fn look(&mut self, lamps: &[LitChannel<'_>], at: usize) {
        let lamp = &lamps[at];
        let LitChannel { channel, pixels, axes, .. } = lamp;
        let around = [DVec2::ZERO, DVec2::X, DVec2::Y, DVec2::ONE].map(|by| by - 0.5);
        let rows = spread(channel.size.y);
        for (x, y) in rows.flat_map(|y| spread(channel.size.x).map(move |x| (x, y))) {
            let pixel = UVec2::new(x, y).as_dvec2() + 0.5;
            let Some(canvas) = pixels.canvas_from_pixel(pixel) else { continue };
            let mut lit = lit_at(lamps, canvas);
            if let [(only, place)] = &mut lit[..]
                && *only == at
            {
                *place = pixel;
            }
            let is_exact = lit.iter().all(|(other, _)| lamps[*other].is_exact);
            let is_judged = lit.iter().any(|(other, _)| *other == at)
                && (lit.len() == 1 || is_exact)
                && lit.iter().all(|(other, _)| !lamps[*other].is_masked);
            // Beside an edge, what leaks may end within the pixel.
            let is_whole = || {
                around.iter().all(|by| {
                    let place = pixels.canvas_from_pixel(pixel + *by * 2.0 * AROUND_PX);
                    place.is_none_or(|place| {
                        let others = lit_at(lamps, place);
                        others.iter().all(|(other, _)| lit.iter().any(|(own, _)| own == other))
                    })
                })
            };
            let is_seen = || {
                let mut corners = around.iter().map(|by| pixels.canvas_from_pixel(pixel + *by));
                lamp.is_flat() || corners.all(|at| at.is_some_and(|at| lamp.is_seen(at)))
            };
            if !is_judged || !is_seen() || (!is_exact && !is_whole()) {
                continue;
            }
            for (grey, light) in GREYS.into_iter().enumerate() {
                let off = self.off(lamps, &lit, light_of(lamps, &lit, grey), light, axes);
                let place = || format!("{} at pixel ({x}, {y}) of light {light}", channel.name);
                self.codes.add(off, place);
                if light == 0.0 {
                    self.black.add(off, || format!("{} at pixel ({x}, {y})", channel.name));
                }
            }
        }
    }

    /// Over some pixels of a canvas each.
    fn look_between(&mut self, lamps: &[LitChannel<'_>], canvas: UVec2) {
        let starts = (canvas - WINDOW.min(canvas.min_element())) + 1;
        for (x, y) in spread(starts.y).flat_map(|y| spread(starts.x).map(move |x| (x, y))) {
            let mut shown = [DVec3::ZERO; GREYS.len()];
            let (mut count, mut fewest, mut is_even) = (0.0, Vec::<(usize, DVec2)>::new(), true);
            for part in 0..WINDOW * WINDOW {
                let at = UVec2::new(x + part % WINDOW, y + part / WINDOW).as_dvec2() + 0.5;
                let lit = lit_at(lamps, at);
                if lit.is_empty() || lit.iter().any(|(at, pixel)| lamps[*at].ends_at(*pixel)) {
                    continue;
                }
                for (grey, sum) in shown.iter_mut().enumerate() {
                    *sum += light_of(lamps, &lit, grey);
                }
                count += 1.0;
                is_even &= fewest.is_empty() || lit.len() == fewest.len();
                if fewest.is_empty() || lit.len() < fewest.len() {
                    fewest = lit;
                }
            }
            let is_masked = fewest.iter().any(|(at, _)| lamps[*at].is_masked);
            let middle = UVec2::new(x, y).as_dvec2() + f64::from(WINDOW) / 2.0;
            let is_seen = |(at, _): &(usize, DVec2)| lamps[*at].is_seen(middle);
            // What one mask alone leaves of the light, it is meant to leave.
            if !fewest.iter().any(is_seen) || (is_masked && fewest.len() == 1) {
                continue;
            }
            let axes: Vec<usize> = (0..3)
                .filter(|axis| fewest.iter().all(|(at, _)| lamps[*at].axes.contains(axis)))
                .collect();
            let name = || {
                let names: Vec<&str> =
                    fewest.iter().map(|(at, _)| lamps[*at].channel.name.as_str()).collect();
                format!("{} at ({x}, {y}) of the canvas", names.join(" and "))
            };
            let white = shown[GREYS.len() - 1] / count;
            let off_white = axes.iter().map(|axis| (white[*axis] - 1.0).abs());
            let off_white = off_white.fold(0.0, f64::max);
            if is_masked {
                self.masked.add(off_white / WEIGHTS_MAX, name);
                continue;
            }
            if fewest.len() > 1 && is_even && fewest.iter().all(|(at, _)| lamps[*at].is_exact) {
                self.weights.add(off_white, name);
            }
            let off = GREYS.into_iter().zip(shown);
            let off = off.map(|(light, sum)| self.off(lamps, &fewest, sum / count, light, &axes));
            self.plain.add(off.fold(0.0, f64::max), name);
        }
    }

    /// Returns the error of light in parts of what rounding may do: 0.5·k^(1/γ) levels, or what
    /// half a level of each share comes to. Both are the same but near black, where half a level is
    /// no small part of a code, and where sRGB is linear.
    fn off(
        &self,
        lamps: &[LitChannel<'_>],
        lit: &[(usize, DVec2)],
        shown: DVec3,
        light: f64,
        axes: &[usize],
    ) -> f64 {
        let right = self.all_black + (DVec3::ONE - self.all_black) * light;
        let curve = |at: &usize| &lamps[*at].channel.adjustment.color.curve;
        let first = curve(&lit[0].0);
        let codes = |light: DVec3| first.encode(light) * 255.0;
        let count = lit.len() as f64;
        // What each has of it is not known, and half a level is most where it is equal.
        let share = right / count;
        // A picture of 10 bits is rounded to its codes, and then to those of 8 bits.
        let step = |at: &usize| match lamps[*at].channel.adjustment.bits {
            BitDepth::Eight => self.step,
            BitDepth::Ten => self.step + 0.5 * 255.0 / 1023.0,
        };
        let largest = lit.iter().map(|(at, _)| step(at)).fold(0.0, f64::max);
        let half = |(at, _): &(usize, DVec2)| {
            let code = curve(at).encode(lamps[*at].built.inverse() * share);
            let half = curve(at).decode(code + step(at) / 255.0) - curve(at).decode(code);
            (lamps[*at].built * (half * (DVec3::ONE - lamps[*at].leak))).abs()
        };
        let halves: DVec3 = lit.iter().map(half).sum();
        let (off, near) =
            ((codes(shown) - codes(right)).abs(), codes(right + halves) - codes(right));
        let part = |axis: &usize| {
            let gamma = if let TransferFunction::Gamma(gamma) = first { gamma[*axis] } else { 2.4 };
            off[*axis] / (largest * count.powf(gamma.recip())).max(near[*axis])
        };
        axes.iter().map(part).fold(0.0, f64::max)
    }

    fn report(self, table: &mut VerificationReport) {
        let Self { all_black, most, codes, black, weights, plain, masked, .. } = self;
        let at_most = |most: f64| Some(Bound::AtMost(most));
        let leak = all_black.max_element();
        let note = |worst: &WorstErrors| {
            format!("{}; {most} at most on one place, black {leak:.4}", worst.at)
        };
        if weights.count > 0 {
            let what = "sum of blend weights, off 1";
            table.add(what, weights.off, "", at_most(WEIGHTS_MAX), note(&weights));
        }
        if codes.count > 0 {
            table.add("superposed codes", codes.off, "×", at_most(CODES_MAX), note(&codes));
            table.add("black", black.off, "×", at_most(CODES_MAX), note(&black));
        }
        plain.report("", WINDOWS_MIN, table);
        masked.report(" of overlapping masks", MASKED_WINDOWS_MIN, table);
        if codes.count + plain.all + masked.all == 0 {
            let why = "no place is lit but by one channel with a mask of its own";
            table.add_unmeasured("superposed codes", None, why);
        }
    }
}

impl WindowMeans {
    fn add(&mut self, off: f64, at: impl FnOnce() -> String) {
        self.all += 1;
        self.kept += u64::from(off <= 1.0);
        self.worst.add(off, at);
    }

    fn report(&self, of: &str, least: f64, table: &mut VerificationReport) {
        if self.all == 0 {
            return;
        }
        let kept = self.kept as f64 / self.all as f64;
        let what = format!("{WINDOW} × {WINDOW} means{of} that keep it");
        let note = format!("{:.2} × at the worst, {}", self.worst.off, self.worst.at);
        table.add(what, kept, "", Some(Bound::AtLeast(least)), note);
    }
}

#[cfg(test)]
mod tests;
