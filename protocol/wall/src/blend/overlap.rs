//! Overlaps of channels' pictures, found by walks along their edges.
//!
//! A region that several channels light is bounded by edges of some of them or of their screen, so
//! that places just inside of all edges see every region that is no smaller than a step of the
//! walk; steps shrink towards corners, so that regions at corners may be as small as a pixel.

use glam::{DVec2, DVec3};

use super::super::lit_area::Edge;
use super::BlendChannel;
use crate::{ChannelId, Eye};

/// Distance inside and outside of an edge at which overlaps are looked for, in pixels: less than
/// half a pixel, so that an overlap of one is found.
const BESIDE: f64 = 0.25;

/// Steps along an edge, away from the corners.
const STEPS: u32 = 64;

/// Bisections of a width: 8,192 pixels to 1/1,000.
const BISECTIONS: usize = 23;

/// Widths are rounded to parts of a pixel, so that they are exact for whole pixels.
const WIDTH_PARTS: f64 = 64.0;

/// Notes for all lamps which others may light what they light.
pub(super) fn find_neighbours(lamps: &mut [BlendChannel<'_>]) {
    let ids = |count: usize| (0..u16::try_from(count).unwrap_or(u16::MAX)).map(ChannelId);
    for at in 0..lamps.len() {
        let meets = |id: &ChannelId| {
            let other = usize::from(id.0);
            other != at && lamps[at].may_overlap(&lamps[other])
        };
        lamps[at].neighbours = ids(lamps.len()).filter(meets).collect();
    }
}

/// Places along an edge of this length, with the length that each stands for.
fn walk(length: f64) -> Vec<(f64, f64)> {
    let mut places = vec![0.0];
    let mut near = 0.5;
    while near < length / f64::from(STEPS) {
        places.extend([near, length - near]);
        near *= 2.0;
    }
    places.extend((1..STEPS).map(|step| length * f64::from(step) / f64::from(STEPS)));
    places.push(length);
    places.sort_unstable_by(f64::total_cmp);
    // In the middle of each piece, so that no place is on a corner.
    let piece = |pair: &[f64]| (f64::midpoint(pair[0], pair[1]), pair[1] - pair[0]);
    places.windows(2).map(piece).filter(|(_, stands_for)| *stands_for > 0.0).collect()
}

/// A side of a picture.
#[derive(Clone, Copy)]
struct EdgeSegment {
    side: Edge,
    begin: DVec2,
    along: DVec2,
    inward: DVec2,
    length: f64,
    /// From this edge to the opposite one.
    across: f64,
}

/// Left, right, top and bottom of what is lit.
fn edges(lamp: &BlendChannel<'_>) -> [EdgeSegment; 4] {
    let (low, high) = lamp.outline.map_or((DVec2::ZERO, lamp.size), |lit| (lit.low, lit.high));
    let size = high - low;
    let edge = |side, begin, along, inward, length, across| EdgeSegment {
        side,
        begin,
        along,
        inward,
        length,
        across,
    };
    let (right, lower) = (DVec2::new(high.x, low.y), DVec2::new(low.x, high.y));
    [
        edge(Edge::Left, low, DVec2::Y, DVec2::X, size.y, size.x),
        edge(Edge::Right, right, DVec2::Y, DVec2::NEG_X, size.y, size.x),
        edge(Edge::Top, low, DVec2::X, DVec2::Y, size.x, size.y),
        edge(Edge::Bottom, lower, DVec2::X, DVec2::NEG_Y, size.x, size.y),
    ]
}

impl EdgeSegment {
    /// The place of the edge so far along it.
    fn place(&self, lamp: &BlendChannel<'_>, at: f64) -> DVec2 {
        let straight = self.begin + self.along * at;
        lamp.outline.map_or(straight, |outline| outline.snap_to_edge(self.side, straight))
    }
}

/// Returns the widths of a channel's ramps: those of the wall, or else those of the overlap.
pub(super) fn ramp_widths(lamp: &BlendChannel<'_>, lamps: &[BlendChannel<'_>]) -> [Option<f64>; 4] {
    let said = &lamp.channel.adjustment.edges;
    let said = [said.left, said.right, said.top, said.bottom];
    let mut widths = [None; 4];
    if lamp.neighbours.is_empty() {
        return widths;
    }
    for ((width, said), edge) in widths.iter_mut().zip(said).zip(edges(lamp)) {
        *width = said.or_else(|| width_of(lamp, edge, lamps));
    }
    widths
}

/// The depth to which others reach over an edge, where they do: the median along the edge, so that
/// a neighbour above or below, which lies beside the edge too, does not count. No more than the
/// length along which they do: a strip along another edge asks for no ramp as long as itself.
fn width_of(lamp: &BlendChannel<'_>, edge: EdgeSegment, lamps: &[BlendChannel<'_>]) -> Option<f64> {
    let mut depths = Vec::new();
    for (at, stands_for) in walk(edge.length) {
        let from = edge.place(lamp, at);
        let canvas = |depth: f64| lamp.canvas_from_edge(from + edge.inward * depth);
        // A file ends at the edge; beyond it goes on as it came.
        let ahead = || Some(canvas(BESIDE)? * 2.0 - canvas(3.0 * BESIDE)?);
        let outside = canvas(-BESIDE).or_else(ahead);
        let (Some(outside), Some(inside)) = (outside, canvas(BESIDE)) else { continue };
        let reaches = |other: &&BlendChannel<'_>| {
            other.lit_pixel(inside).is_some() && other.lit_pixel(outside).is_some()
        };
        let others = lamp.neighbours.iter().map(|id| &lamps[usize::from(id.0)]);
        let is_lit = |other: &BlendChannel<'_>, depth: f64| {
            canvas(depth).is_some_and(|canvas| other.lit_pixel(canvas).is_some())
        };
        let depth = |other: &BlendChannel<'_>| {
            let (mut low, mut high) = (BESIDE, edge.across - BESIDE);
            if high <= low || is_lit(other, high) {
                return edge.across;
            }
            for _ in 0..BISECTIONS {
                let middle = f64::midpoint(low, high);
                let end = if is_lit(other, middle) { &mut low } else { &mut high };
                *end = middle;
            }
            (low * WIDTH_PARTS).round() / WIDTH_PARTS
        };
        if let Some(depth) = others.filter(reaches).map(depth).max_by(f64::total_cmp) {
            depths.push((depth, stands_for));
        }
    }
    let length: f64 = depths.iter().map(|(_, stands_for)| stands_for).sum();
    median(depths).map(|depth| depth.min(length))
}

/// The value below which half of the weights lie.
fn median(mut values: Vec<(f64, f64)>) -> Option<f64> {
    values.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let half = values.iter().map(|(_, weight)| weight).sum::<f64>() / 2.0;
    let mut sum = 0.0;
    values.into_iter().find_map(|(value, weight)| {
        sum += weight;
        (sum >= half).then_some(value)
    })
}

/// Places of a canvas just inside of its edges.
fn border(size: DVec2) -> Vec<DVec2> {
    let across = walk(size.x).into_iter().map(|(x, _)| x);
    let down = walk(size.y).into_iter().map(|(y, _)| y);
    let rows = across.flat_map(|x| [BESIDE, size.y - BESIDE].map(|y| DVec2::new(x, y)));
    let columns = down.flat_map(|y| [BESIDE, size.x - BESIDE].map(|x| DVec2::new(x, y)));
    rows.chain(columns).collect()
}

/// The most that channels which light a place along a channel's edges, or its screen's, have
/// together of what `of` says of each, the channel itself among them.
pub(super) fn overlap_max(
    lamp: &BlendChannel<'_>,
    lamps: &[BlendChannel<'_>],
    of: impl Fn(&BlendChannel<'_>) -> DVec3,
) -> DVec3 {
    let own = of(lamp);
    let mut most = own;
    if lamp.neighbours.is_empty() {
        return most;
    }
    for edge in edges(lamp) {
        for (at, _) in walk(edge.length) {
            let place = edge.place(lamp, at) + edge.inward * BESIDE;
            let Some(canvas) = lamp.canvas_from_edge(place) else { continue };
            most = most.max(own + lit_by(lamp, lamps, canvas, &of));
        }
    }
    // A screen that is small in all pictures ends before their edges.
    for canvas in border(lamp.canvas_size()) {
        if lamp.lit_pixel(canvas).is_some() {
            most = most.max(own + lit_by(lamp, lamps, canvas, &of));
        }
    }
    most
}

/// Returns the sum of a value over the neighbours that light a place and that one eye sees
/// together; for a channel of both eyes, the larger sum of the two.
fn lit_by(
    lamp: &BlendChannel<'_>,
    lamps: &[BlendChannel<'_>],
    canvas: DVec2,
    of: impl Fn(&BlendChannel<'_>) -> DVec3,
) -> DVec3 {
    let others = lamp.neighbours.iter().map(|id| &lamps[usize::from(id.0)]);
    let lit: Vec<_> = others.filter(|other| other.lit_pixel(canvas).is_some()).collect();
    let seen = |eye| {
        let is_seen = |other: &&&BlendChannel<'_>| [Eye::Center, eye].contains(&other.eye());
        lit.iter().filter(is_seen).map(|other| of(other)).sum::<DVec3>()
    };
    match lamp.eye() {
        Eye::Center => seen(Eye::Left).max(seen(Eye::Right)),
        eye => seen(eye),
    }
}
