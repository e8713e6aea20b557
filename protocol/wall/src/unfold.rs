//! Windows of a whole wall on one monitor: its screens unfolded, as the paper model of a room is
//! laid flat.
//!
//! The screen in front of the eye stands in the middle, those to the left and right beside it,
//! the floor below and the ceiling above. The layout depends on the wall and the monitor only, so
//! that servers that know nothing of each other place their windows as parts of one picture. No
//! two windows overlap: channels that share a part of their screen are moved apart.

mod separate;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::{DVec2, DVec3, I64Vec2, UVec2};

use super::{Screen, Wall};

/// Screens whose centres are higher or lower than this, as the eye sees them, lie above or below
/// all others: between a wall's upper edge and a ceiling's middle, seen from the middle of a cube.
const STEEP_RAD: f64 = 0.87;

/// A screen whose centre is within this angle of straight back is behind the eye.
const BEHIND_RAD: f64 = 0.2;

/// A rectangle of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WindowRect {
    /// Its upper left pixel, from the upper left of the monitor.
    pub origin: UVec2,
    /// Its width and height, at least 1.
    pub size: UVec2,
}

/// The windows of a wall on one monitor.
#[derive(Clone, Debug, PartialEq)]
pub struct WindowLayout {
    /// Pixels of the monitor per pixel of a channel's display, at most 1; the same for all.
    pub scale: f64,
    /// One for each channel, in the wall's order; disjoint.
    pub windows: Vec<WindowRect>,
}

impl WindowLayout {
    /// The windows of `wall` on a monitor of this size in pixels.
    pub fn new(wall: &Wall, monitor: UVec2) -> Self {
        let areas = unfolded(wall);
        let extent = areas.iter().map(Area::end).fold(I64Vec2::ONE, I64Vec2::max);
        let monitor = monitor.max(UVec2::ONE);
        let scale = (monitor.as_dvec2() / extent.as_dvec2()).min_element().min(1.0);
        let place = |at: I64Vec2| (at.as_dvec2() * scale).round().as_uvec2().min(monitor);
        let window = |area: &Area| {
            // Both ends are rounded, so that neighbours still meet. Where a pixel of the monitor
            // is more than a channel, the channel gets that pixel.
            let origin = place(area.origin).min(monitor - 1);
            WindowRect { origin, size: (place(area.end()).max(origin) - origin).max(UVec2::ONE) }
        };
        Self { scale, windows: areas.iter().map(window).collect() }
    }
}

/// A rectangle in pixels of channels' displays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Area {
    origin: I64Vec2,
    size: I64Vec2,
}

impl Area {
    fn end(&self) -> I64Vec2 {
        self.origin + self.size
    }

    fn overlaps(&self, other: &Self) -> bool {
        self.origin.cmplt(other.end()).all() && other.origin.cmplt(self.end()).all()
    }

    fn moved(self, by: I64Vec2) -> Self {
        Self { origin: self.origin + by, ..self }
    }

    /// The smallest area around all of these; empty if there are none.
    fn around(areas: impl IntoIterator<Item = Self>) -> Self {
        let both = |a: Self, b: Self| {
            let origin = a.origin.min(b.origin);
            Self { origin, size: a.end().max(b.end()) - origin }
        };
        areas.into_iter().reduce(both).unwrap_or_default()
    }
}

/// The area of each channel, in the wall's order, the least coordinates being 0.
fn unfolded(wall: &Wall) -> Vec<Area> {
    let mut areas = vec![Area::default(); wall.channels.len()];
    let mut blocks = Vec::new();
    for (index, screen) in wall.screens.iter().enumerate() {
        let on_screen = |&id: &usize| usize::from(wall.channels[id].screen) == index;
        let channels: Vec<usize> = (0..wall.channels.len()).filter(on_screen).collect();
        if channels.is_empty() {
            continue;
        }
        let placed = separate::separate(wall, &channels);
        let around = Area::around(placed.iter().copied());
        for (&id, area) in channels.iter().zip(placed) {
            areas[id] = area.moved(-around.origin);
        }
        blocks.push(Block { channels, size: around.size, sight: Sight::new(wall.eye, screen) });
    }
    let origins = arrange(&blocks);
    for (block, origin) in blocks.iter().zip(origins) {
        for &id in &block.channels {
            areas[id] = areas[id].moved(origin);
        }
    }
    let least = Area::around(areas.iter().copied()).origin;
    areas.iter().map(|area| area.moved(-least)).collect()
}

/// The channels of one screen.
struct Block {
    channels: Vec<usize>,
    size: I64Vec2,
    sight: Sight,
}

/// The side of the eye on which a screen stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Side {
    Around,
    Below,
    Above,
    /// Only its file knows.
    Unknown,
}

/// A screen as the eye sees it.
#[derive(Clone, Copy, Debug)]
struct Sight {
    side: Side,
    /// The place of its centre, to the right and downwards: for screens around the eye azimuth and
    /// depression in radians, for those above and below it tangents.
    place: DVec2,
    /// Half of its width, in the unit of `place`.
    half_width: f64,
}

impl Sight {
    fn new(eye: DVec3, screen: &Screen) -> Self {
        let unknown = Self { side: Side::Unknown, place: DVec2::ZERO, half_width: 0.0 };
        let canvas = screen.canvas.as_dvec2();
        let toward = |u: f64, v: f64| {
            let point = screen.display_from_canvas(DVec2::new(u, v) * canvas)?;
            (point - eye).try_normalize()
        };
        let (Some(middle), Some(left), Some(right)) =
            (toward(0.5, 0.5), toward(0.0, 0.5), toward(1.0, 0.5))
        else {
            return unknown;
        };
        let elevation = middle.y.clamp(-1.0, 1.0).asin();
        if elevation.abs() < STEEP_RAD {
            let azimuth = middle.x.atan2(-middle.z);
            // A screen behind the viewer hangs at the right end, wherever the eye stands exactly.
            let is_behind = azimuth < BEHIND_RAD - PI;
            let azimuth = if is_behind { azimuth + TAU } else { azimuth };
            let half = |side: DVec3| side.dot(middle).clamp(-1.0, 1.0).acos();
            let half_width = half(left).min(half(right)).min(FRAC_PI_2);
            return Self { side: Side::Around, place: DVec2::new(azimuth, -elevation), half_width };
        }
        let (side, down) = if elevation < 0.0 { (Side::Below, 1.0) } else { (Side::Above, -1.0) };
        let tangent = |toward: DVec3| DVec2::new(toward.x, down * toward.z) / middle.y.abs();
        let half_width = (tangent(right) - tangent(left)).length() / 2.0;
        Self { side, place: tangent(middle), half_width }
    }
}

/// Returns the place of each block's upper left corner, in pixels.
fn arrange(blocks: &[Block]) -> Vec<I64Vec2> {
    let mut origins = vec![I64Vec2::ZERO; blocks.len()];
    let on = |side: Side| (0..blocks.len()).filter(move |&i| blocks[i].sight.side == side);
    let areas_of = |ids: &[usize], origins: &[I64Vec2]| -> Vec<Area> {
        ids.iter().map(|&id| Area { origin: origins[id], size: blocks[id].size }).collect()
    };

    let around = columns(blocks, on(Side::Around).collect());
    let widths: Vec<i64> = around.iter().map(|column| width(blocks, column)).collect();
    let azimuth = |column: &Vec<usize>| blocks[column[0]].sight.place.x.abs();
    let front =
        (0..around.len()).min_by(|&a, &b| azimuth(&around[a]).total_cmp(&azimuth(&around[b])));
    let mut left = 0;
    let mut middle = 0;
    for (index, (column, width)) in around.iter().zip(&widths).enumerate() {
        if Some(index) == front {
            middle = left + width / 2;
        }
        stack(blocks, column, [left, *width], &mut origins);
        left += width;
    }
    let ring: Vec<usize> = around.concat();

    for side in [Side::Below, Side::Above] {
        let columns = columns(blocks, on(side).collect());
        let ids = columns.concat();
        let total: i64 = columns.iter().map(|column| width(blocks, column)).sum();
        let mut x = middle - total / 2;
        for column in &columns {
            let width = width(blocks, column);
            stack(blocks, column, [x, width], &mut origins);
            x += width;
        }
        let block = Area::around(areas_of(&ids, &origins));
        // It touches what stands over or under it, and nothing else.
        let is_near = |it: &Area| it.origin.x < block.end().x && block.origin.x < it.end().x;
        let near = Area::around(areas_of(&ring, &origins).into_iter().filter(is_near));
        let down = match side {
            Side::Below => near.end().y - block.origin.y,
            _ => near.origin.y - block.end().y,
        };
        for &id in &ids {
            origins[id].y += down;
        }
    }

    let known: Vec<usize> =
        (0..blocks.len()).filter(|&i| blocks[i].sight.side != Side::Unknown).collect();
    let unknown: Vec<usize> = on(Side::Unknown).collect();
    let around_known = Area::around(areas_of(&known, &origins));
    let sizes: Vec<I64Vec2> = unknown.iter().map(|&id| blocks[id].size).collect();
    let below = I64Vec2::new(around_known.origin.x, around_known.end().y);
    for (&id, origin) in unknown.iter().zip(separate::grid(&sizes)) {
        origins[id] = below + origin;
    }
    origins
}

/// These blocks from left to right; those that the eye sees one over the other in one column,
/// from the upper one down.
fn columns(blocks: &[Block], mut ids: Vec<usize>) -> Vec<Vec<usize>> {
    let sight = |id: usize| &blocks[id].sight;
    ids.sort_by(|&a, &b| sight(a).place.x.total_cmp(&sight(b).place.x));
    let mut columns: Vec<Vec<usize>> = Vec::new();
    for id in ids {
        let is_over = |column: &&mut Vec<usize>| {
            let (a, b) = (sight(column[0]), sight(id));
            (b.place.x - a.place.x).abs() <= a.half_width.min(b.half_width) / 2.0
        };
        match columns.last_mut().filter(is_over) {
            Some(column) => column.push(id),
            None => columns.push(vec![id]),
        }
    }
    for column in &mut columns {
        column.sort_by(|&a, &b| sight(a).place.y.total_cmp(&sight(b).place.y));
    }
    columns
}

fn width(blocks: &[Block], column: &[usize]) -> i64 {
    column.iter().map(|&id| blocks[id].size.x).max().unwrap_or_default()
}

/// Places a column at `[left, width]`: the block that is nearest to the height of the eye around
/// y = 0, the others over and under it.
fn stack(blocks: &[Block], column: &[usize], [left, width]: [i64; 2], origins: &mut [I64Vec2]) {
    /// Two rows that are equally far from the eye's height are so but for rounding.
    const SAME_RAD: f64 = 1e-6;
    let away = |id: usize| blocks[id].sight.place.y.abs();
    let nearest = column.iter().map(|&id| away(id)).fold(f64::INFINITY, f64::min);
    let level = column.iter().position(|&id| away(id) <= nearest + SAME_RAD).unwrap_or_default();
    let height = |ids: &[usize]| ids.iter().map(|&id| blocks[id].size.y).sum::<i64>();
    let middle = column.get(level).map_or(0, |&id| blocks[id].size.y / 2);
    let mut top = -middle - height(&column[..level]);
    for &id in column {
        let size = blocks[id].size;
        origins[id] = I64Vec2::new(left + (width - size.x) / 2, top);
        top += size.y;
    }
}
