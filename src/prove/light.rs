//! The light of a wall: what channels share of it, what black comes to, and what one channel's
//! picture says before it was shared.

use anyhow::Context;
use glam::{DVec2, DVec3, UVec2};
use polyptych_client::Picture;
use polyptych_protocol::head::Head;
use polyptych_protocol::ids::ChannelId;
use polyptych_protocol::limits::CHANNEL_SIDE_MAX;
use polyptych_protocol::wall::blend::{BlackRule, Blend, LightMap, Masks, light_map};
use polyptych_protocol::wall::pixels::PixelMap;
use polyptych_protocol::wall::source::SourcePlan;
use polyptych_protocol::wall::superposition::{ChannelLight, Side};
use polyptych_protocol::wall::warp_mesh::{MeshRule, WarpMesh};
use polyptych_protocol::wall::{Adjustment, Channel, Curve, EyeOf, Packing, Wall};

use super::marker::Light;
use super::table::{Table, Target};

/// How far the sum of weights may be from 1.
const WEIGHTS_MAX: f64 = 1.0 / 4096.0;

/// Least source pixels per pixel of a channel: what comes of rounding sides up to whole pixels.
const DENSITY_MIN: f64 = 0.999;

/// Places of a canvas that are looked at, across and down at most.
const PLACES_MAX: u32 = 512;

/// Light of which the superposition is judged.
const GREYS: [f64; 6] = [0.0, 0.002, 0.05, 0.2, 0.6, 1.0];

/// A weight below this says too little of the light that was weighted: half a level becomes two.
/// The neighbour, whose weight is the rest, tells more.
const WEIGHT_MIN: f64 = 0.25;

/// The eye for which a channel's picture, or the first one of its two, is drawn.
pub(super) fn eye_of(adjustment: &Adjustment) -> EyeOf {
    if adjustment.packing == Packing::None { adjustment.eye } else { EyeOf::Left }
}

/// What each channel has of the light, without masks from files; made once, as it takes a while.
pub(super) fn maps(wall: &Wall) -> Vec<Option<LightMap>> {
    wall.channel_ids().map(|id| light_map(wall, id, &Masks::default())).collect()
}

/// The light of a channel's picture, upright and before it was shared.
///
/// # Errors
/// A picture that is not of the display's size.
pub(super) fn of(
    wall: &Wall,
    maps: &[Option<LightMap>],
    id: ChannelId,
    picture: &Picture,
) -> anyhow::Result<Light> {
    let channel = wall.channel(id).context("the wall has no such channel")?;
    let side = if channel.adjustment.eye == EyeOf::Right { Side::Right } else { Side::Left };
    let shown = ChannelLight::new(wall, id, side, &picture.rgba);
    let shown = shown.with_context(|| format!("the picture of {} has no size", channel.name))?;
    let map = maps.get(usize::from(id.0)).and_then(Option::as_ref);
    let color = &channel.adjustment.color;
    let white = color.matrix * DVec3::ONE * color.gain;
    // Of an anaglyph's left eye only red is there.
    let axis = usize::from(channel.adjustment.packing != Packing::Anaglyph);
    let size = channel.size;
    let mut grey = Vec::with_capacity(size.x as usize * size.y as usize);
    for y in 0..size.y {
        for x in 0..size.x {
            let light = shown.pixel(UVec2::new(x, y))[axis];
            let [multiply, add] = map.map_or([1.0, 0.0], |map| map.at(x, y));
            let own = (light - add) / multiply / white[axis];
            grey.push(if multiply < WEIGHT_MIN { f32::NAN } else { own as f32 });
        }
    }
    Ok(Light { size, grey })
}

/// Proves what channels share, and from how many pixels each is drawn.
///
/// # Errors
/// A channel that cannot be drawn at all.
pub(super) fn prove(
    wall: &Wall,
    maps: &[Option<LightMap>],
    table: &mut Table,
) -> anyhow::Result<()> {
    prove_sampling(wall, table)?;
    if maps.iter().all(Option::is_none) {
        return Ok(());
    }
    let most = if wall.blend.leak > 0.0 { Blend::new(wall).most() } else { 1 };
    let black = BlackRule::new(wall.blend.leak, most);
    let mut worst = Worst::default();
    for index in 0..wall.screens.len() {
        for side in Side::of(wall, index as u16) {
            let lamps = lamps(wall, maps, index as u16, *side);
            worst.look(wall, wall.screens[index].canvas, &lamps, most, black.multiply);
        }
    }
    let note =
        |what: &str| format!("{what}, {most} at most on one place, leak {}", wall.blend.leak);
    let most = |most: f64| Some(Target::AtMost(most));
    table.add("sum of blend weights, off 1", worst.weights, "", most(WEIGHTS_MAX), note("all lit"));
    let bound = "of 0.5·k^(1/γ) levels";
    table.add("superposed codes", worst.codes, "×", most(1.0), note(bound));
    table.add("black", worst.black, "×", most(1.0), note(bound));
    Ok(())
}

/// A channel that lights a screen for one eye.
struct Lamp<'a> {
    channel: &'a Channel,
    pixels: PixelMap<'a>,
    map: Option<&'a LightMap>,
}

fn lamps<'a>(
    wall: &'a Wall,
    maps: &'a [Option<LightMap>],
    screen: u16,
    side: Side,
) -> Vec<Lamp<'a>> {
    let lamp = |(id, map): (ChannelId, &'a Option<LightMap>)| {
        let channel = wall.channel(id)?;
        let is_seen = channel.screen == screen && side.sees(channel);
        let pixels = is_seen.then(|| wall.pixel_map(id))??;
        Some(Lamp { channel, pixels, map: map.as_ref() })
    };
    wall.channel_ids().zip(maps).filter_map(lamp).collect()
}

impl Lamp<'_> {
    /// Factor and addend at a place of the canvas, linear between pixels.
    fn at(&self, canvas: DVec2) -> Option<[f64; 2]> {
        let pixel = self.pixels.pixel_from_canvas(canvas)?;
        let size = self.channel.size.as_dvec2();
        if !(pixel.cmpge(DVec2::ZERO).all() && pixel.cmplt(size).all()) {
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

/// The worst of all places.
#[derive(Default)]
struct Worst {
    weights: f64,
    codes: f64,
    black: f64,
}

impl Worst {
    fn look(&mut self, wall: &Wall, canvas: UVec2, lamps: &[Lamp<'_>], most: usize, whole: f64) {
        let step = (canvas / PLACES_MAX).max(UVec2::ONE);
        for y in (0..canvas.y).step_by(step.y as usize) {
            for x in (0..canvas.x).step_by(step.x as usize) {
                let place = UVec2::new(x, y).as_dvec2() + 0.5;
                let lit: Vec<(&Curve, [f64; 2])> = lamps
                    .iter()
                    .filter_map(|l| Some((&l.channel.adjustment.color.curve, l.at(place)?)))
                    .collect();
                if lit.is_empty() {
                    continue;
                }
                let sum: f64 = lit.iter().map(|(_, [multiply, _])| multiply / whole).sum();
                self.weights = self.weights.max((sum - 1.0).abs());
                for grey in GREYS {
                    let off = off(wall.blend.leak, most, &lit, grey);
                    self.codes = self.codes.max(off);
                    if grey == 0.0 {
                        self.black = self.black.max(off);
                    }
                }
            }
        }
    }
}

/// By how much the light of rounded codes is off what it should be, in parts of what rounding may
/// do: 0.5·k^(1/γ) levels.
fn off(leak: f64, most: usize, lit: &[(&Curve, [f64; 2])], grey: f64) -> f64 {
    let shown: f64 = lit
        .iter()
        .map(|(curve, [multiply, add])| {
            let code = curve.encode(DVec3::splat(grey * multiply + add)).y;
            let code = (code * 255.0).round() / 255.0;
            leak + (1.0 - leak) * curve.decode(DVec3::splat(code)).y
        })
        .sum();
    let all = most as f64 * leak;
    let right = all + (1.0 - all) * grey;
    let (curve, _) = lit[0];
    let gamma = if let Curve::Gamma(gamma) = curve { gamma.y } else { 2.4 };
    let code = |light: f64| curve.encode(DVec3::splat(light)).y * 255.0;
    // A share of k rounds to half a level of its own, which near black is more light than one
    // level of the whole: k of them k times that.
    (code(shown) - code(right)).abs() / (0.5 * (lit.len() as f64).powf(1.0 / gamma))
}

/// From how many pixels channels are drawn that are warped.
fn prove_sampling(wall: &Wall, table: &mut Table) -> anyhow::Result<()> {
    let head = Head::at(wall.eye, wall.eye_separation_m);
    let mut densities: Vec<(f64, f64, &str)> = Vec::new();
    for id in wall.channel_ids() {
        let (Some(channel), Some(map)) = (wall.channel(id), wall.pixel_map(id)) else { continue };
        if !super::geometry::is_warped(wall, channel) {
            continue;
        }
        let point = |pixel: DVec2| map.display_from_pixel(pixel);
        let mesh = WarpMesh::new(channel.size, MeshRule::default(), point);
        if mesh.triangles.is_empty() {
            continue;
        }
        let eye = head.eye(eye_of(&channel.adjustment));
        let plan = SourcePlan::new(&mesh, &[eye], wall.near_m, CHANNEL_SIDE_MAX);
        let plan = plan.with_context(|| format!("channel {}", channel.name))?;
        densities.push((plan.density_min, plan.density_max, &channel.name));
    }
    let Some(least) = densities.iter().min_by(|a, b| a.0.total_cmp(&b.0)) else { return Ok(()) };
    let target = Some(Target::AtLeast(DENSITY_MIN));
    table.add("source pixels per pixel, least", least.0, "", target, least.2);
    if let Some(most) = densities.iter().max_by(|a, b| a.1.total_cmp(&b.1)) {
        table.add("source pixels per pixel, most", most.1, "", None, most.2);
    }
    Ok(())
}
