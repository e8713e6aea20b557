//! What channels that light one place share: their weights, the codes that come of them, and
//! black.
//!
//! At the middle of a channel's pixel its own numbers are those of its light map, and the others'
//! those of the formula: nothing is interpolated there. Between pixels that lie askew nothing can
//! be right in every point, as a projector's black ends within a pixel of another one; so there
//! light is judged as the mean of some pixels, linear between their middles.

use glam::{DVec2, DVec3, UVec2};
use polyptych_protocol::ids::ChannelId;
use polyptych_protocol::wall::blend::{BlackRule, Blend, LightMap};
use polyptych_protocol::wall::pixels::PixelMap;
use polyptych_protocol::wall::shapes::Shaped;
use polyptych_protocol::wall::superposition::Side;
use polyptych_protocol::wall::{Channel, Cover, Curve, Surface};

use crate::prove::table::{Table, Target};

/// How far the sum of weights may be from 1.
const WEIGHTS_MAX: f64 = 1.0 / 4096.0;

/// Pixels of a channel, and places of a canvas, that are looked at, across and down at most.
const PLACES_MAX: u32 = 192;

/// Pixels across and down over which light between pixels is a mean.
const WINDOW: u32 = 4;

/// Share of the canvas on which that mean must keep the bound. A leak's edge that runs askew is a
/// line of half-right pixels, and where outer edges cross a weight is 1 on one side and 0 on the
/// other: both are lines and points, and less of a picture of more pixels.
const WINDOWS_MIN: f64 = 0.995;

/// How far from a place of a mesh the light may come down that was thrown at it, in pixels of the
/// canvas: further, and it falls on what stands before it.
const LAYER_PX: f64 = 1.0;

/// Light of which the superposition is judged.
const GREYS: [f64; 6] = [0.0, 0.002, 0.05, 0.2, 0.6, 1.0];

/// Judges the light maps of all channels.
pub(super) fn prove(shaped: Shaped<'_>, maps: &[Option<LightMap>], table: &mut Table) {
    let wall = shaped.wall;
    let blend = Blend::new(shaped);
    let most = if wall.blend.leak > 0.0 { blend.most() } else { 1 };
    let shares = Shares { shaped, blend, most, black: BlackRule::new(wall.blend.leak, most) };
    let mut worst = Worst::default();
    for (id, map) in wall.channel_ids().zip(maps) {
        if let (Some(channel), Some(map)) = (wall.channel(id), map)
            && !shaped.shapes.is_blended_by_file(channel)
        {
            shares.look(id, channel, map, &mut worst);
        }
    }
    let mut windows = Windows::default();
    for index in 0..wall.screens.len() as u16 {
        for side in Side::of(wall, index) {
            let mut lamps = lamps(shaped, maps, index, *side);
            lamps.retain(|lamp| !shaped.shapes.is_blended_by_file(lamp.channel));
            shares.look_between(index, &lamps, &mut windows);
        }
    }
    let note =
        |what: &str| format!("{what}, {most} at most on one place, leak {}", wall.blend.leak);
    let at_most = |most: f64| Some(Target::AtMost(most));
    let sums = "at pixels of all channels";
    table.add("sum of blend weights, off 1", worst.weights, "", at_most(WEIGHTS_MAX), note(sums));
    let bound = "of 0.5·k^(1/γ) levels";
    table.add("superposed codes", worst.codes, "×", at_most(1.0), note(bound));
    table.add("black", worst.black, "×", at_most(1.0), note(bound));
    if windows.all > 0 {
        let kept = windows.kept as f64 / windows.all as f64;
        let what = format!("{WINDOW} × {WINDOW} means that keep it");
        let note = format!("between pixels; {:.2} × at the worst place", windows.worst);
        table.add(what, kept, "", Some(Target::AtLeast(WINDOWS_MIN)), note);
    }
}

/// A channel that lights a screen for one eye.
struct Lamp<'a> {
    channel: &'a Channel,
    surface: &'a Surface,
    pixels: PixelMap<'a>,
    map: Option<&'a LightMap>,
}

fn lamps<'a>(
    shaped: Shaped<'a>,
    maps: &'a [Option<LightMap>],
    screen: u16,
    side: Side,
) -> Vec<Lamp<'a>> {
    let lamp = |(id, map): (ChannelId, &'a Option<LightMap>)| {
        let channel = shaped.wall.channel(id)?;
        let is_seen = channel.screen == screen && side.sees(channel);
        let pixels = is_seen.then(|| shaped.pixel_map(id))??;
        let surface = &shaped.wall.screen_of(channel).surface;
        Some(Lamp { channel, surface, pixels, map: map.as_ref() })
    };
    shaped.wall.channel_ids().zip(maps).filter_map(lamp).collect()
}

impl Lamp<'_> {
    /// Whether a place lies between pixels of which some are dark by what a file says: there is
    /// nothing to interpolate between.
    fn ends_at(&self, canvas: DVec2) -> bool {
        if self.channel.cover == Cover::Tile {
            return false;
        }
        let Some(pixel) = self.pixels.pixel_from_canvas(canvas) else { return false };
        let (low, last) = ((pixel - 0.5).floor() + 0.5, self.channel.size.as_dvec2() - 0.5);
        let around = [DVec2::ZERO, DVec2::X, DVec2::Y, DVec2::ONE];
        let mut around = around.map(|by| (low + by).clamp(DVec2::splat(0.5), last)).into_iter();
        around.any(|middle| self.pixels.display_from_pixel(middle).is_none())
    }

    /// Factor and addend at a place of the canvas, linear between pixels.
    fn at(&self, canvas: DVec2) -> Option<[f64; 2]> {
        let pixel = self.pixels.pixel_from_canvas(canvas)?;
        let size = self.channel.size.as_dvec2();
        if !(pixel.cmpge(DVec2::ZERO).all() && pixel.cmplt(size).all()) {
            return None;
        }
        // A mesh may stand before itself.
        let is_mesh = matches!(self.surface, Surface::Mesh(_));
        if is_mesh && self.pixels.canvas_from_pixel(pixel)?.distance(canvas) > LAYER_PX {
            return None;
        }
        let Some(map) = self.map else { return Some([1.0, 0.0]) };
        let at = (pixel - 0.5).clamp(DVec2::ZERO, size - 1.0);
        let low = at.as_uvec2();
        let (high, t) = ((low + 1).min(self.channel.size - 1), at - low.as_dvec2());
        let mix = |axis: usize| {
            let row = |y: u32| {
                let (a, b) = (map.at(low.x, y)[axis], map.at(high.x, y)[axis]);
                a + (b - a) * t.x
            };
            row(low.y) + (row(high.y) - row(low.y)) * t.y
        };
        Some([mix(0), mix(1)])
    }
}

/// The worst of all pixels.
#[derive(Default)]
struct Worst {
    weights: f64,
    codes: f64,
    black: f64,
}

/// Means over some pixels.
#[derive(Default)]
struct Windows {
    all: u64,
    kept: u64,
    worst: f64,
}

/// What channels of a wall should share.
struct Shares<'a> {
    shaped: Shaped<'a>,
    blend: Blend<'a>,
    most: usize,
    black: BlackRule,
}

/// Numbers from 0 to below `count`, both ends among them.
fn spread(count: u32) -> impl Iterator<Item = u32> + Clone {
    let steps = (count - 1).clamp(1, PLACES_MAX);
    let at = move |step: u32| (u64::from(step) * u64::from(count - 1) / u64::from(steps)) as u32;
    (0..=steps).map(at)
}

impl Shares<'_> {
    /// At the middles of a channel's pixels.
    fn look(&self, id: ChannelId, channel: &Channel, map: &LightMap, worst: &mut Worst) {
        let Some(pixels) = self.shaped.pixel_map(id) else { return };
        let corners = [DVec2::ZERO, DVec2::X, DVec2::Y, DVec2::ONE];
        let rows = spread(channel.size.y);
        for (x, y) in rows.flat_map(|y| spread(channel.size.x).map(move |x| (x, y))) {
            let low = DVec2::new(f64::from(x), f64::from(y));
            let Some(canvas) = pixels.canvas_from_pixel(low + 0.5) else { continue };
            let weights = self.blend.weights(id, canvas);
            let add = self.black.add(weights.len() as f64);
            let lit = weights.iter().filter_map(|(other, weight)| {
                let own = [weight * self.black.multiply, weight * add];
                let curve = &self.shaped.wall.channel(*other)?.adjustment.color.curve;
                Some((curve, if *other == id { map.at(x, y) } else { own }))
            });
            let lit: Vec<(&Curve, [f64; 2])> = lit.collect();
            let sum: f64 = lit.iter().map(|(_, [multiply, _])| multiply).sum();
            worst.weights = worst.weights.max((sum / self.black.multiply - 1.0).abs());
            // Where an edge runs through it a pixel is right in the mean, and not in its middle.
            let is_whole = corners.iter().all(|corner| {
                let place = pixels.canvas_from_pixel(low + *corner);
                let others = place.map(|place| self.blend.weights(id, place));
                others.is_some_and(|others| {
                    others.iter().map(|(other, _)| other).eq(weights.iter().map(|(other, _)| other))
                })
            });
            if is_whole {
                for grey in GREYS {
                    let off = self.off(self.shown(&lit, grey), &lit, grey);
                    worst.codes = worst.codes.max(off);
                    if grey == 0.0 {
                        worst.black = worst.black.max(off);
                    }
                }
            }
        }
    }

    /// Over some pixels of a canvas each.
    fn look_between(&self, screen: u16, lamps: &[Lamp<'_>], windows: &mut Windows) {
        let canvas = self.shaped.wall.screens[usize::from(screen)].canvas;
        let starts = (canvas - WINDOW.min(canvas.min_element())) + 1;
        for (x, y) in spread(starts.y).flat_map(|y| spread(starts.x).map(move |x| (x, y))) {
            let mut shown = [0.0; GREYS.len()];
            let (mut count, mut fewest): (f64, Vec<_>) = (0.0, Vec::new());
            for part in 0..WINDOW * WINDOW {
                let at = UVec2::new(x + part % WINDOW, y + part / WINDOW).as_dvec2() + 0.5;
                let lit = lamps
                    .iter()
                    .filter_map(|l| Some((&l.channel.adjustment.color.curve, l.at(at)?)));
                let lit: Vec<(&Curve, [f64; 2])> = lit.collect();
                if lit.is_empty() || lamps.iter().any(|lamp| lamp.ends_at(at)) {
                    continue;
                }
                for (sum, grey) in shown.iter_mut().zip(GREYS) {
                    *sum += self.shown(&lit, grey);
                }
                count += 1.0;
                if fewest.is_empty() || lit.len() < fewest.len() {
                    fewest = lit;
                }
            }
            if fewest.is_empty() {
                continue;
            }
            let off =
                shown.iter().zip(GREYS).map(|(sum, grey)| self.off(sum / count, &fewest, grey));
            let off = off.fold(0.0, f64::max);
            windows.all += 1;
            windows.kept += u64::from(off <= 1.0);
            windows.worst = windows.worst.max(off);
        }
    }

    /// The light of rounded codes.
    fn shown(&self, lit: &[(&Curve, [f64; 2])], grey: f64) -> f64 {
        let leak = self.shaped.wall.blend.leak;
        let light = |(curve, [multiply, add]): &(&Curve, [f64; 2])| {
            let code = curve.encode(DVec3::splat(grey * multiply + add)).y;
            let code = (code * 255.0).round() / 255.0;
            leak + (1.0 - leak) * curve.decode(DVec3::splat(code)).y
        };
        lit.iter().map(light).sum()
    }

    /// By how much light is off what it should be, in parts of what rounding may do:
    /// 0.5·k^(1/γ) levels, or what half a level of each share comes to. Both are the same but
    /// near black, where half a level is no small part of a code, and where sRGB is linear.
    fn off(&self, shown: f64, lit: &[(&Curve, [f64; 2])], grey: f64) -> f64 {
        let leak = self.shaped.wall.blend.leak;
        let all = self.most as f64 * leak;
        let right = all + (1.0 - all) * grey;
        let (curve, _) = lit[0];
        let gamma = if let Curve::Gamma(gamma) = curve { gamma.y } else { 2.4 };
        let code = |light: f64| curve.encode(DVec3::splat(light)).y * 255.0;
        let half = |(curve, [multiply, add]): &(&Curve, [f64; 2])| {
            let code = curve.encode(DVec3::splat(grey * multiply + add)).y;
            let light = |code: f64| curve.decode(DVec3::splat(code)).y;
            (1.0 - leak) * (light(code + 0.5 / 255.0) - light(code))
        };
        let halves: f64 = lit.iter().map(half).sum();
        let bound = 0.5 * (lit.len() as f64).powf(1.0 / gamma);
        (code(shown) - code(right)).abs() / bound.max(code(right + halves) - code(right))
    }
}
