//! The number of channels that show each place of a screen's canvas: holes and overlaps, for each
//! eye of its own.
//!
//! Plain tiles are counted exactly, to the pixel; projectors, pins and bends on a grid of places.

use std::collections::BTreeMap;

use glam::{DVec2, DVec3, UVec2};
use polyptych_wall::calibration_change::Edge;
use polyptych_wall::channel_calibration::{Eye, StereoPacking};
use polyptych_wall::channel_mapping::ChannelMapping;
use polyptych_wall::wall_geometry::{ResolvedWall, ScreenGeometry, WallGeometry};
use polyptych_wall::{Channel, ChannelKind, Screen, Surface};

use super::tiling::Rect;

/// Places at which channels are asked for, all channels of a screen together: a second of work.
const SAMPLES_MAX: usize = 1 << 22;

/// Fewest and most places along one side of a canvas.
const SIDE_RANGE: (usize, usize) = (16, 256);

/// Places along an edge that are checked for other channels.
const EDGE_SAMPLES: u32 = 33;

/// Distance inside the edges of what a file lights at which other channels are looked for, in
/// pixels: an outline is known to about one.
const LIT_INSIDE_PX: f64 = 1.0;

/// Maximum distance of a projector's ray from the point that it was aimed at, as a share of its
/// distance plus 1 m.
const MISS_MAX: f64 = 1e-6;

/// A screen's canvas, as one eye sees it covered.
#[derive(Clone, Debug, PartialEq)]
pub struct Coverage {
    /// The eye; the middle if no channel is for one of both.
    pub eye: Eye,
    /// Most channels that show one place.
    pub layers_max: u32,
    /// Parts that no channel shows, the largest first.
    pub holes: Vec<Region>,
    /// Pairs of channels that show the same, in the order of the file.
    pub overlaps: Vec<Overlap>,
    /// The spacing of the places that were looked at, in pixels of the canvas; zero if everything
    /// was counted.
    pub step_px: DVec2,
}

/// A part of a canvas.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// Its upper left corner in pixels of the canvas.
    pub origin: DVec2,
    /// Width and height of the rectangle around it.
    pub size: DVec2,
    /// The number of its pixels.
    pub area: f64,
}

/// Two channels that show the same place.
#[derive(Clone, Debug, PartialEq)]
pub struct Overlap {
    /// Their places in the list of the wall's channels.
    pub channels: [usize; 2],
    /// The place.
    pub patch: Region,
    /// `true` if their light is shared there; `false` where one ends in a ramp without width.
    pub is_blended: bool,
}

/// Returns whether this eye sees the channel.
pub fn is_seen_by(channel: &Channel, eye: Eye) -> bool {
    let of = channel.adjustment.eye;
    let is_for_both = of == Eye::Center || channel.adjustment.packing != StereoPacking::None;
    is_for_both || of == eye
}

/// The eyes for which a screen with these channels is covered.
pub(super) fn eyes<'a>(channels: impl IntoIterator<Item = &'a Channel>) -> &'static [Eye] {
    let is_for_one = |channel: &Channel| channel.adjustment.eye != Eye::Center;
    if channels.into_iter().any(is_for_one) { &[Eye::Left, Eye::Right] } else { &[Eye::Center] }
}

/// A tile whose pixels lie where its rectangle says.
pub fn is_plain_tile(channel: &Channel) -> bool {
    let adjustment = &channel.adjustment;
    channel.cover == ChannelKind::Tile
        && adjustment.pin == [DVec2::ZERO; 4]
        && adjustment.bend.is_none()
}

/// The part of a screen that a channel covers.
#[derive(Debug)]
pub struct Footprint<'a> {
    channel: &'a Channel,
    shapes: &'a WallGeometry,
    ground: ScreenGeometry<'a>,
    map: Option<ChannelMapping<'a>>,
}

impl<'a> Footprint<'a> {
    /// The footprint of a channel without calibration files.
    pub fn new(channel: &'a Channel, screen: &'a Screen) -> Self {
        Self::shaped(channel, screen, WallGeometry::empty())
    }

    /// The footprint of a channel with the geometry of its calibration files.
    pub fn shaped(channel: &'a Channel, screen: &'a Screen, shapes: &'a WallGeometry) -> Self {
        let map = ChannelMapping::with_geometry(channel, screen, shapes);
        Self { channel, shapes, ground: shapes.screen(screen), map }
    }

    /// Returns whether the channel shows this place of the canvas.
    pub fn covers(&self, canvas: DVec2) -> bool {
        self.pixel_at(canvas).is_some()
    }

    /// The place of the channel's picture, in pixels, that shows this place of the canvas.
    pub fn pixel_at(&self, canvas: DVec2) -> Option<DVec2> {
        if let ChannelKind::Projector(projector) = &self.channel.cover {
            // The far side of a curved screen lies in the same direction, but in the dark.
            let point = self.ground.display_from_canvas(canvas)?;
            let hit = self.map.as_ref()?.lit_along(point - projector.position);
            let slack = MISS_MAX * (1.0 + point.distance(projector.position));
            hit.filter(|(hit, _)| hit.distance(point) < slack)?;
        }
        let size = self.channel.size.as_dvec2();
        let pixel = self.map.as_ref()?.pixel_from_canvas(canvas)?;
        (pixel.cmpge(DVec2::ZERO).all() && pixel.cmplt(size).all()).then_some(pixel)
    }

    /// The point of display space, in metres, that a place of the channel's picture lights, in
    /// pixels; `None` if its light misses the canvas.
    pub fn lit_point(&self, pixel: DVec2) -> Option<DVec3> {
        let map = self.map.as_ref()?;
        let canvas = map.canvas_from_pixel(pixel)?;
        let is_on = map.is_on_canvas(canvas);
        map.display_from_pixel(pixel).filter(|point| is_on && point.is_finite())
    }

    /// The pixel map of the channel; `None` if its pins leave no picture.
    pub fn map(&self) -> Option<&ChannelMapping<'a>> {
        self.map.as_ref()
    }

    /// Returns whether everything that says where its pixels lie is known, calibration files too.
    pub fn is_known(&self) -> bool {
        let is_mesh = matches!(self.ground.screen.surface, Surface::Mesh(_));
        let is_placed = !is_mesh || self.ground.is_mesh() || self.channel.cover == ChannelKind::Map;
        is_placed && self.map.as_ref().is_some_and(ChannelMapping::is_resolved)
    }

    /// The side at which this channel ends in a ramp without width, though another is there with
    /// which it shares light.
    pub fn hard_edge(&self, other: &Self) -> Option<&'static str> {
        // No ramp is computed where a file says how light fades.
        if [self, other].iter().any(|of| of.shapes.is_blended_by_file(of.channel)) {
            return None;
        }
        let edges = self.channel.adjustment.edges;
        let sides = [
            (Edge::Left, edges.left),
            (Edge::Right, edges.right),
            (Edge::Top, edges.top),
            (Edge::Bottom, edges.bottom),
        ];
        let map = self.map.as_ref()?;
        let is_there = |side: Edge, t: u32| {
            let along = (f64::from(t) + 0.5) / f64::from(EDGE_SAMPLES);
            let pixel = self.edge_place(map, side, along);
            let canvas = pixel.and_then(|pixel| map.canvas_from_pixel(pixel));
            canvas.is_some_and(|canvas| other.covers(canvas))
        };
        let mut hard = sides.into_iter().filter(|(_, edge)| *edge == Some(0.0));
        let met = hard.find(|(side, _)| (0..EDGE_SAMPLES).any(|t| is_there(*side, t)));
        met.map(|(side, _)| side.name())
    }

    /// A place of the picture just inside of a side, so far along it, from 0 to 1: of the part that
    /// its file lights, if one places it, for the rest is dark.
    fn edge_place(&self, map: &ChannelMapping<'_>, side: Edge, along: f64) -> Option<DVec2> {
        if let Some(meant) = self.shapes.lit_edge(self.channel, side, along, LIT_INSIDE_PX) {
            return map.pixel_from_ideal(meant);
        }
        let size = self.channel.size.as_dvec2();
        let at = size * along;
        Some(match side {
            Edge::Left => DVec2::new(0.5, at.y),
            Edge::Right => DVec2::new(size.x - 0.5, at.y),
            Edge::Top => DVec2::new(at.x, 0.5),
            Edge::Bottom => DVec2::new(at.x, size.y - 0.5),
        })
    }
}

/// Returns the coverage of a screen, for each eye; empty if that needs calibration files that were
/// not read.
pub fn coverage<'a>(of: impl Into<ResolvedWall<'a>>, screen: usize) -> Vec<Coverage> {
    let of: ResolvedWall<'a> = of.into();
    let wall = of.wall;
    let Some(surface) = wall.screens.get(screen) else { return Vec::new() };
    let on_screen = |channel: &&Channel| usize::from(channel.screen) == screen;
    let is_unknown = |channel: &Channel| {
        let map = ChannelMapping::with_geometry(channel, surface, of.shapes);
        !map.is_none_or(|map| map.is_resolved())
    };
    if wall.channels.iter().filter(on_screen).any(is_unknown) {
        return Vec::new();
    }
    let of_eye = |eye: &Eye| {
        let indices: Vec<usize> = (0..wall.channels.len())
            .filter(|index| on_screen(&&wall.channels[*index]))
            .filter(|index| is_seen_by(&wall.channels[*index], *eye))
            .collect();
        of_group(of, surface, *eye, &indices)
    };
    eyes(wall.channels.iter().filter(on_screen)).iter().map(of_eye).collect()
}

fn of_group(of: ResolvedWall<'_>, screen: &Screen, eye: Eye, indices: &[usize]) -> Coverage {
    let print = |index: &usize| Footprint::shaped(&of.wall.channels[*index], screen, of.shapes);
    let prints: Vec<Footprint<'_>> = indices.iter().map(print).collect();
    let (cells, pairs) = if prints.iter().all(|print| is_plain_tile(print.channel)) {
        exact(screen.canvas, &prints)
    } else {
        sampled(screen.canvas, &prints)
    };
    let overlap = |((a, b), patch): ((usize, usize), Region)| Overlap {
        channels: [indices[a], indices[b]],
        patch,
        is_blended: prints[a].hard_edge(&prints[b]).is_none()
            && prints[b].hard_edge(&prints[a]).is_none(),
    };
    Coverage {
        eye,
        layers_max: cells.count.iter().copied().max().unwrap_or(0),
        holes: cells.holes(),
        overlaps: pairs.into_iter().map(overlap).collect(),
        step_px: cells.step_px,
    }
}

/// Overlapping channels, by their places in the group.
type Pairs = BTreeMap<(usize, usize), Region>;

/// A canvas cut by columns and rows, and how many channels show each cell.
struct Cells {
    xs: Vec<f64>,
    ys: Vec<f64>,
    /// Row by row.
    count: Vec<u32>,
    step_px: DVec2,
}

/// Cut where a rectangle begins or ends, so that a cell is shown wholly or not at all.
fn exact(canvas: UVec2, prints: &[Footprint<'_>]) -> (Cells, Pairs) {
    let rects: Vec<Rect> = prints
        .iter()
        .map(|print| Rect { origin: print.channel.origin, size: print.channel.size })
        .collect();
    let cuts = |axis: usize| {
        let ends = rects.iter().flat_map(|rect| [rect.origin[axis], rect.end()[axis]]);
        let mut cuts: Vec<u32> = ends.filter(|at| *at < canvas[axis]).collect();
        cuts.extend([0, canvas[axis]]);
        cuts.sort_unstable();
        cuts.dedup();
        cuts
    };
    let (xs, ys) = (cuts(0), cuts(1));
    let (width, height) = (xs.len() - 1, ys.len() - 1);
    // Plus one where a rectangle begins in a row, minus one where it ends: sums are the counts.
    let mut steps = vec![0_i32; (width + 1) * height];
    for rect in &rects {
        let column = |x: u32| xs.partition_point(|cut| *cut < x).min(width);
        let (begin, end) = (column(rect.origin.x), column(rect.end().x));
        for row in 0..height {
            if rect.origin.y <= ys[row] && ys[row] < rect.end().y {
                steps[row * (width + 1) + begin] += 1;
                steps[row * (width + 1) + end] -= 1;
            }
        }
    }
    let mut count = Vec::with_capacity(width * height);
    for row in steps.chunks(width + 1) {
        let mut layers = 0;
        count.extend(row[..width].iter().map(|step| {
            layers += step;
            layers.unsigned_abs()
        }));
    }
    let mut pairs = Pairs::new();
    for (second, rect) in rects.iter().enumerate() {
        for (first, other) in rects[..second].iter().enumerate() {
            if let Some(both) = rect.intersection(*other) {
                let (origin, size) = (both.origin.as_dvec2(), both.size.as_dvec2());
                pairs.insert((first, second), Region { origin, size, area: both.area() as f64 });
            }
        }
    }
    let edges = |cuts: Vec<u32>| cuts.into_iter().map(f64::from).collect();
    (Cells { xs: edges(xs), ys: edges(ys), count, step_px: DVec2::ZERO }, pairs)
}

/// Cut evenly; a cell is shown where its middle is.
fn sampled(canvas: UVec2, prints: &[Footprint<'_>]) -> (Cells, Pairs) {
    let (low, high) = SIDE_RANGE;
    let side = (SAMPLES_MAX / prints.len().max(1)).isqrt().clamp(low, high);
    let cuts = |length: u32| {
        let cells = side.min(length as usize);
        let cut = |at: usize| f64::from(length) * at as f64 / cells as f64;
        (0..=cells).map(cut).collect::<Vec<f64>>()
    };
    let (xs, ys) = (cuts(canvas.x), cuts(canvas.y));
    let step_px = DVec2::new(xs[1] - xs[0], ys[1] - ys[0]);
    let mut count = Vec::with_capacity((xs.len() - 1) * (ys.len() - 1));
    let mut pairs = Pairs::new();
    for y in &ys[..ys.len() - 1] {
        for x in &xs[..xs.len() - 1] {
            let origin = DVec2::new(*x, *y);
            let middle = origin + step_px / 2.0;
            let there: Vec<usize> =
                (0..prints.len()).filter(|index| prints[*index].covers(middle)).collect();
            count.push(there.len() as u32);
            let cell = Region { origin, size: step_px, area: step_px.x * step_px.y };
            for (at, second) in there.iter().enumerate() {
                for first in &there[..at] {
                    let patch =
                        pairs.entry((*first, *second)).or_insert(Region { area: 0.0, ..cell });
                    *patch = patch.with(cell);
                }
            }
        }
    }
    (Cells { xs, ys, count, step_px }, pairs)
}

impl Region {
    /// Both, and the rectangle around them.
    fn with(self, other: Self) -> Self {
        let origin = self.origin.min(other.origin);
        let end = (self.origin + self.size).max(other.origin + other.size);
        Self { origin, size: end - origin, area: self.area + other.area }
    }
}

impl Cells {
    /// The cells that no channel shows, those that touch each other together; largest first.
    fn holes(&self) -> Vec<Region> {
        let width = self.xs.len() - 1;
        let mut is_open: Vec<bool> = self.count.iter().map(|layers| *layers == 0).collect();
        let mut holes = Vec::new();
        for start in 0..is_open.len() {
            if !is_open[start] {
                continue;
            }
            is_open[start] = false;
            let mut hole = Region { area: 0.0, ..self.cell(start) };
            let mut next = vec![start];
            while let Some(at) = next.pop() {
                hole = hole.with(self.cell(at));
                let (x, y) = (at % width, at / width);
                let beside = [
                    (x > 0).then(|| at - 1),
                    (x + 1 < width).then(|| at + 1),
                    (y > 0).then(|| at - width),
                    Some(at + width).filter(|below| *below < is_open.len()),
                ];
                for beside in beside.into_iter().flatten() {
                    if std::mem::take(&mut is_open[beside]) {
                        next.push(beside);
                    }
                }
            }
            holes.push(hole);
        }
        holes.sort_by(|a, b| b.area.total_cmp(&a.area));
        holes
    }

    fn cell(&self, at: usize) -> Region {
        let (x, y) = (at % (self.xs.len() - 1), at / (self.xs.len() - 1));
        let origin = DVec2::new(self.xs[x], self.ys[y]);
        let size = DVec2::new(self.xs[x + 1], self.ys[y + 1]) - origin;
        Region { origin, size, area: size.x * size.y }
    }
}

#[cfg(test)]
mod tests;
