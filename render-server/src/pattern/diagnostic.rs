//! Patterns that show what the wall comes to where a display's pixels lie.

use glam::{DVec2, DVec3, UVec2};
use image::{Rgba, RgbaImage};
use polyptych_renderer::{Label, LabelPosition};
use polyptych_wall::blend::BlendModel;
use polyptych_wall::calibration_maps::CalibrationMaps;
use polyptych_wall::channel_mapping::ChannelMapping;
use polyptych_wall::color::linear_from_srgb;
use polyptych_wall::wall_geometry::ResolvedWall;
use polyptych_wall::{Channel, ChannelId, ColorCorrection, Eye, StereoPacking};
use rayon::prelude::*;

use super::pixel_positions::{BLOCK, Block, PixelPositions};
use super::{BLACK, blank, label, opaque};
use crate::correction::light_map;

/// The colours of points that one, two, three, and four or more channels light.
const COUNTS: [[u8; 3]; 4] = [[0, 40, 120], [0, 160, 0], [230, 200, 0], [255, 0, 0]];

/// Pixels for a degree, from few to many, and their colours: each step doubles.
const DENSITY_MIN: f64 = 4.0;
const DENSITIES: [[u8; 3]; 6] =
    [[160, 0, 0], [220, 100, 0], [200, 200, 0], [0, 180, 0], [0, 160, 200], [40, 60, 255]];

/// Another channel of the screen, and what of a block it lights.
struct Neighbour<'a> {
    blend: &'a BlendModel<'a>,
    id: ChannelId,
    size: DVec2,
    /// `true` for the left and the right eye if it sees both this channel and the one of the
    /// picture.
    is_seen: [bool; 2],
}

/// The channels that light a block of pixels.
struct BlockCoverage<'a> {
    /// Channels that light all of it, for the left and the right eye.
    everywhere: [usize; 2],
    /// Those that light a part of it.
    partly: Vec<&'a Neighbour<'a>>,
}

impl Neighbour<'_> {
    fn pixel(&self, canvas: DVec2) -> Option<DVec2> {
        self.blend.pixel(self.id, canvas)
    }

    fn lights(&self, canvas: DVec2) -> bool {
        let is_inside = |at: DVec2| at.cmpge(DVec2::ZERO).all() && at.cmplt(self.size).all();
        self.pixel(canvas).is_some_and(is_inside)
    }

    /// Counts the channel for each eye that sees it.
    fn add_to(&self, counts: &mut [usize; 2]) {
        counts.iter_mut().zip(self.is_seen).for_each(|(count, is)| *count += usize::from(is));
    }

    /// Returns whether the channel lights all (`true`) or nothing (`false`) of a block; `None` if
    /// its pixels must be tested one by one.
    fn lights_all(&self, corners: &[DVec2; 4]) -> Option<bool> {
        let [a, b, c, d] = corners.map(|corner| self.pixel(corner));
        let at = [a?, b?, c?, d?];
        // A bend may bulge between corners, by less than this.
        let margin = f64::from(BLOCK);
        let all = |is: &dyn Fn(&DVec2) -> bool| at.iter().all(is);
        let (low, high) = (DVec2::splat(margin), self.size - margin);
        if all(&|at| at.cmpge(low).all() && at.cmple(high).all()) {
            return Some(true);
        }
        let is_beside = all(&|at| at.x < -margin)
            || all(&|at| at.y < -margin)
            || all(&|at| at.x > self.size.x + margin)
            || all(&|at| at.y > self.size.y + margin);
        is_beside.then_some(false)
    }
}

impl BlockCoverage<'_> {
    /// Returns the number of channels that light a place of the block, for the eye that sees more.
    fn count(&self, canvas: DVec2) -> usize {
        let mut counts = self.everywhere;
        for other in self.partly.iter().filter(|other| other.lights(canvas)) {
            other.add_to(&mut counts);
        }
        counts[0].max(counts[1])
    }
}

/// Returns whether the left eye sees a channel, and whether the right one does.
fn seen_by(channel: &Channel) -> [bool; 2] {
    let adjustment = &channel.adjustment;
    let is_for_both = adjustment.eye == Eye::Center || adjustment.packing != StereoPacking::None;
    [Eye::Left, Eye::Right].map(|eye| is_for_both || adjustment.eye == eye)
}

/// Returns the picture of the number of the screen's channels that light each pixel, for the eye
/// that the channel is for; for the one that sees more if it is for both.
pub(super) fn overlap(
    shaped: ResolvedWall<'_>,
    id: ChannelId,
    places: &PixelPositions<'_>,
) -> RgbaImage {
    let wall = shaped.wall;
    let Some(own) = wall.channel(id) else { return RgbaImage::default() };
    let blend = BlendModel::new(shaped);
    let others = wall.channel_ids().zip(&wall.channels);
    let bounds = |id| shaped.channel_mapping(id).and_then(|map| map.canvas_bounds());
    let own_bounds = bounds(id);
    // Of many tiles only a few lie over this one.
    let is_beside = |other: ChannelId| match (own_bounds, bounds(other)) {
        (Some([a, b]), Some([c, d])) => b.cmplt(c).any() || d.cmplt(a).any(),
        _ => false,
    };
    let others = others.filter(|(other, channel)| {
        *other != id && channel.screen == own.screen && !is_beside(*other)
    });
    let neighbours: Vec<_> = others
        .filter_map(|(other, channel)| {
            let ([left, right], of) = (seen_by(channel), seen_by(own));
            let is_seen = [left && of[0], right && of[1]];
            let size = channel.size.as_dvec2();
            let neighbour = Neighbour { blend: &blend, id: other, size, is_seen };
            is_seen.contains(&true).then_some(neighbour)
        })
        .collect();
    let prepare = |block: &Block<'_>| {
        let mut lit = BlockCoverage { everywhere: [1; 2], partly: Vec::new() };
        for neighbour in &neighbours {
            match block.corners().and_then(|corners| neighbour.lights_all(corners)) {
                Some(true) => neighbour.add_to(&mut lit.everywhere),
                Some(false) => {}
                None => lit.partly.push(neighbour),
            }
        }
        lit
    };
    let mut image = places.paint(prepare, |lit, place| {
        let Some(place) = place.filter(|place| places.is_lit(place.at)) else { return BLACK };
        COUNTS[(lit.count(place.at) - 1).min(COUNTS.len() - 1)]
    });
    let lines = vec![own.name.clone(), "blue 1, green 2, yellow 3, red 4 channels".to_owned()];
    label(&mut image, &Label { lines, place: LabelPosition::Corner });
    image
}

/// The channel's share of the light, by its weights and masks, as its display shows it: on a wall
/// that is right, all of them together are white.
pub(super) fn weights(
    shaped: ResolvedWall<'_>,
    maps: &CalibrationMaps,
    id: ChannelId,
) -> RgbaImage {
    let Some(channel) = shaped.wall.channel(id) else { return RgbaImage::default() };
    // The shares alone, whatever else the light is changed by.
    let mut wall = shaped.wall.clone();
    wall.blend.leak = 0.0;
    wall.channels.iter_mut().for_each(|channel| channel.adjustment.color.leak = None);
    let unleaking = ResolvedWall { wall: &wall, shapes: shaped.shapes };
    let map = light_map(unleaking, &BlendModel::new(unleaking), maps, id);
    let curve = &channel.adjustment.color.curve;
    let mut last = (DVec3::NAN, opaque(BLACK));
    RgbaImage::from_fn(channel.size.x, channel.size.y, |x, y| {
        let share = map.as_ref().map_or(DVec3::ONE, |map| map.light_at(x, y)[0]);
        if share != last.0 {
            last = (share, codes(curve.encode(share)));
        }
        last.1
    })
}

/// Does to a picture what is done to the scene's: its light is shared with other channels, masked,
/// coloured and encoded for the display.
pub(super) fn apply_blend(
    image: &mut RgbaImage,
    shaped: ResolvedWall<'_>,
    maps: &CalibrationMaps,
    id: ChannelId,
) {
    let blend = BlendModel::new(shaped);
    let map = light_map(shaped, &blend, maps, id);
    let Some(color) =
        blend.color(id).filter(|color| map.is_some() || *color != ColorCorrection::default())
    else {
        return;
    };
    let light: Vec<f64> = (0..=255).map(|code| linear_from_srgb(f64::from(code) / 255.0)).collect();
    let row_bytes = image.width() as usize * 4;
    let rows = image.par_chunks_exact_mut(row_bytes).enumerate();
    rows.for_each(|(y, row)| {
        // Neighbours are mostly alike, and encoding costs.
        let mut last = None;
        for (x, pixel) in row.chunks_exact_mut(4).enumerate() {
            let plain = [DVec3::ONE, DVec3::ZERO];
            let by = map.as_ref().map_or(plain, |map| map.light_at(x as u32, y as u32));
            let from = ([pixel[0], pixel[1], pixel[2]], by);
            let coded = match last {
                Some((known, coded)) if known == from => coded,
                _ => {
                    let [red, green, blue] = from.0.map(|code| light[usize::from(code)]);
                    codes(color.codes(DVec3::new(red, green, blue), by[0], by[1]))
                }
            };
            last = Some((from, coded));
            pixel.copy_from_slice(&coded.0);
        }
    });
}

fn codes(codes: DVec3) -> Rgba<u8> {
    opaque((codes * 255.0).round().to_array().map(|code| code as u8))
}

/// Returns the picture of the viewer's pixels per degree, in the direction in which they are
/// fewest. A change of colour stands for the root of two.
pub(super) fn density(channel: &Channel, map: &ChannelMapping<'_>, eye: DVec3) -> RgbaImage {
    let (width, height) = (channel.size.x, channel.size.y);
    let blocks = channel.size.map(|side| side.div_ceil(BLOCK)) + 1;
    let corner = |index: u32| UVec2::new(index % blocks.x, index / blocks.x) * BLOCK;
    // It changes slowly: in blocks it is interpolated.
    let known: Vec<f64> = (0..blocks.x * blocks.y)
        .into_par_iter()
        .map(|index| {
            let at = corner(index).as_dvec2().min(channel.size.as_dvec2() - 1.0);
            density_at(map, eye, at).map_or(f64::NAN, f64::log2)
        })
        .collect();
    let mut image = blank(channel.size);
    let rows = image.par_chunks_exact_mut(width as usize * 4).enumerate();
    rows.for_each(|(y, line)| {
        for (x, pixel) in line.chunks_exact_mut(4).enumerate() {
            let at = (DVec2::new(x as f64, y as f64) + 0.5) / f64::from(BLOCK);
            let (cell, t) = (at.floor().as_uvec2(), at - at.floor());
            let of = |x: u32, y: u32| known[((cell.y + y) * blocks.x + cell.x + x) as usize];
            let upper = of(0, 0) * (1.0 - t.x) + of(1, 0) * t.x;
            let lower = of(0, 1) * (1.0 - t.x) + of(1, 1) * t.x;
            let color = density_color(upper * (1.0 - t.y) + lower * t.y);
            pixel.copy_from_slice(&opaque(color).0);
        }
    });
    debug_assert_eq!(image.height(), height);
    let seen = known.iter().filter(|log| log.is_finite());
    let (low, high) = seen
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), log| (log.min(low), log.max(high)));
    let what = if low.is_finite() {
        format!("{:.1} to {:.1} pixels a degree", low.exp2(), high.exp2())
    } else {
        "nothing is seen from here".to_owned()
    };
    let lines = vec![channel.name.clone(), what];
    label(&mut image, &Label { lines, place: LabelPosition::Corner });
    image
}

/// Pixels for a degree around a place of the picture, in the direction in which they are fewest;
/// `None` where nothing is seen.
pub(super) fn density_at(map: &ChannelMapping<'_>, eye: DVec3, pixel: DVec2) -> Option<f64> {
    let ray = |at: DVec2| Some((map.display_from_pixel(at)? - eye).normalize());
    let from = ray(pixel)?;
    let across = ray(pixel + DVec2::X)? - from;
    let down = ray(pixel + DVec2::Y)? - from;
    // The largest singular value of the two: radians that a pixel takes at most.
    let (aa, ad, dd) = (across.dot(across), across.dot(down), down.dot(down));
    let middle = f64::midpoint(aa, dd);
    let largest = (middle + ((aa - dd) * 0.5).hypot(ad)).sqrt();
    let density = largest.to_degrees().recip();
    (density.is_finite() && density > 0.0).then_some(density)
}

fn density_color(log: f64) -> [u8; 3] {
    if !log.is_finite() {
        return BLACK;
    }
    let step = ((log - DENSITY_MIN.log2()) * 2.0).clamp(0.0, DENSITIES.len() as f64 * 2.0 - 1.0);
    let color = DENSITIES[step as usize / 2];
    // The upper half of each octave is brighter.
    if (step as usize).is_multiple_of(2) { color.map(|code| code / 3 * 2) } else { color }
}
