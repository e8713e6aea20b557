//! The one form that all warps have: for points of a channel's picture, the points of display
//! space that they show, and triangles between them.
//!
//! Cells of a regular grid are divided until lines between their corners are right, and at the
//! border of what is lit down to single pixels, so that no lit pixel is lost and no dark one shows.

pub(crate) mod clip;
pub(crate) mod reach;
pub(crate) mod refine;

use std::collections::HashMap;

use glam::{DVec2, DVec3, UVec2};
use reach::CellPlaces;

/// Points of one mesh. A channel of 8,192 × 8,192 pixels has a quarter of a million cells of
/// [`TessellationOptions::default`]; what is so rough that it wants more is given a larger error.
pub const WARP_VERTICES_MAX: usize = 4 << 20;

/// The positions of a channel's pixels. In each triangle, the point is linear in the pixel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WarpMesh {
    /// Its points.
    pub vertices: Vec<WarpVertex>,
    /// Indices of corners.
    pub triangles: Vec<[u32; 3]>,
}

/// A point of a [`WarpMesh`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WarpVertex {
    /// The place in the upright picture, in pixels from its upper left corner, y down.
    pub pixel: DVec2,
    /// In metres of display space.
    pub point: DVec3,
}

/// The fineness of a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TessellationOptions {
    /// Sides of the largest cells, in pixels.
    pub step_px: u32,
    /// No point between corners is further than this from where it should be, in pixels of the
    /// channel as they lie there: whatever eye looks, the error is no larger.
    pub error_px: f64,
}

impl Default for TessellationOptions {
    /// A fifth of what a curved screen may be off by. On a cylinder of 3 m radius with pixels of
    /// 1.4 mm, cells of 16 pixels are off by 0.015 pixels, those of 32 by 0.06.
    fn default() -> Self {
        Self { step_px: 64, error_px: 0.02 }
    }
}

/// A rectangle of whole pixels.
#[derive(Clone, Copy, Debug)]
struct Cell {
    origin: UVec2,
    size: UVec2,
}

/// A mesh under construction.
struct Tessellator<F, M> {
    point: F,
    is_mixed: M,
    error_px: f64,
    mesh: WarpMesh,
    /// By corner.
    known: HashMap<UVec2, u32>,
}

impl WarpMesh {
    /// The mesh of a picture of this size, whose places show what `point` gives: `None` where
    /// there is nothing. It is asked beyond no edge of the picture. What is narrower than half a
    /// step, a hole or something lit, may be passed over.
    pub fn new(
        size: UVec2,
        rule: TessellationOptions,
        point: impl FnMut(DVec2) -> Option<DVec3>,
    ) -> Self {
        Self::with_borders(size, rule, point, |_| false)
    }

    /// The mesh like [`Self::new`], which passes over nothing as long as there is room: `is_mixed`
    /// returns whether there may be both lit and dark places in a cell, of whose places in the
    /// picture all are lit or none.
    pub(crate) fn with_borders(
        size: UVec2,
        rule: TessellationOptions,
        point: impl FnMut(DVec2) -> Option<DVec3>,
        is_mixed: impl FnMut(&CellPlaces) -> bool,
    ) -> Self {
        Self::within(WARP_VERTICES_MAX, (size, rule), point, is_mixed)
    }

    fn within(
        vertices_max: usize,
        (size, rule): (UVec2, TessellationOptions),
        mut point: impl FnMut(DVec2) -> Option<DVec3>,
        mut is_mixed: impl FnMut(&CellPlaces) -> bool,
    ) -> Self {
        let (mut error_px, mut has_room_for_borders) = (rule.error_px, true);
        loop {
            let finite = |pixel| point(pixel).filter(|point| point.is_finite());
            let mut maker = Tessellator {
                point: finite,
                is_mixed: |places: &CellPlaces| has_room_for_borders && is_mixed(places),
                error_px,
                mesh: Self::default(),
                known: HashMap::new(),
            };
            if maker.fill(size, rule.step_px.max(1), vertices_max) {
                return maker.mesh;
            }
            // Noise in a map has borders everywhere, and costs no other part its shape.
            if std::mem::replace(&mut has_room_for_borders, false) {
                continue;
            }
            // At the largest error only borders that corners see are divided.
            error_px = if error_px < 1e3 { error_px.max(1e-3) * 4.0 } else { f64::INFINITY };
        }
    }

    /// The point that a place of the picture shows, as the triangles have it.
    pub fn point_at(&self, pixel: DVec2) -> Option<DVec3> {
        self.triangles.iter().find_map(|triangle| {
            let [a, b, c] = triangle.map(|index| self.vertices[index as usize]);
            let (ab, ac, at) = (b.pixel - a.pixel, c.pixel - a.pixel, pixel - a.pixel);
            let area = ab.perp_dot(ac);
            let (u, v) = (at.perp_dot(ac) / area, ab.perp_dot(at) / area);
            let is_inside = u >= -1e-12 && v >= -1e-12 && u + v <= 1.0 + 1e-12;
            is_inside.then(|| a.point + (b.point - a.point) * u + (c.point - a.point) * v)
        })
    }
}

impl<F, M> Tessellator<F, M>
where
    F: FnMut(DVec2) -> Option<DVec3>,
    M: FnMut(&CellPlaces) -> bool,
{
    /// Fills the mesh; returns whether it had room.
    fn fill(&mut self, size: UVec2, step: u32, vertices_max: usize) -> bool {
        for y in (0..size.y).step_by(step as usize) {
            for x in (0..size.x).step_by(step as usize) {
                let origin = UVec2::new(x, y);
                self.divide(Cell { origin, size: (size - origin).min(UVec2::splat(step)) });
                if self.mesh.vertices.len() > vertices_max && self.error_px.is_finite() {
                    return false;
                }
            }
        }
        true
    }

    fn divide(&mut self, cell: Cell) {
        let (low, span) = (cell.origin.as_dvec2(), cell.size.as_dvec2());
        let part = |slot: usize| DVec2::new((slot % 3) as f64, (slot / 3) as f64) / 2.0;
        let places: CellPlaces = std::array::from_fn(|slot| low + span * part(slot));
        let points = places.map(&mut self.point);
        let is_pixel = cell.size == UVec2::ONE;
        let found = points.iter().flatten().count();
        let corners = [points[0], points[2], points[6], points[8]];
        let [across, down, between] = match found {
            9 => errors_px(&points, span),
            _ => [f64::INFINITY; 3],
        };
        let is_right = across.max(down).max(between) <= self.error_px;
        // Asked only of a cell that would not be divided otherwise.
        let is_even = found == 0 || (found == 9 && is_right);
        let is_mixed = !is_pixel && is_even && (self.is_mixed)(&places);
        if (found == 0 && !is_mixed) || (is_pixel && points[4].is_none()) {
            return;
        }
        let is_right = is_right && !is_mixed;
        if let [Some(a), Some(b), Some(c), Some(d)] = corners
            && (is_pixel || is_right)
        {
            self.cover(cell, [a, b, c, d]);
        } else if is_pixel {
            self.cover_pixel(low + 0.5);
        } else {
            // A cylinder is divided around its axis only.
            let (is_down, is_across) = (down > self.error_px, across > self.error_px);
            let (by_row, by_column) = (is_down || !is_across, is_across || !is_down);
            let halved = UVec2::new(cell.size.x.div_ceil(2), cell.size.y.div_ceil(2));
            let first = UVec2::new(
                if by_column || cell.size.y == 1 { halved.x } else { cell.size.x },
                if by_row || cell.size.x == 1 { halved.y } else { cell.size.y },
            );
            let second = cell.size - first;
            for (y, height) in [(0, first.y), (first.y, second.y)] {
                for (x, width) in [(0, first.x), (first.x, second.x)] {
                    if width > 0 && height > 0 {
                        let origin = cell.origin + UVec2::new(x, y);
                        self.divide(Cell { origin, size: UVec2::new(width, height) });
                    }
                }
            }
        }
    }

    fn cover(&mut self, cell: Cell, points: [DVec3; 4]) {
        let offsets = [UVec2::ZERO, UVec2::X, UVec2::Y, UVec2::ONE];
        let mut corners = [0; 4];
        for ((corner, offset), point) in corners.iter_mut().zip(offsets).zip(points) {
            let pixel = cell.origin + cell.size * offset;
            let vertices = &mut self.mesh.vertices;
            *corner = *self.known.entry(pixel).or_insert_with(|| {
                vertices.push(WarpVertex { pixel: pixel.as_dvec2(), point });
                vertices.len() as u32 - 1
            });
        }
        let [a, b, c, d] = corners;
        self.mesh.triangles.extend([[a, b, c], [c, b, d]]);
    }

    /// A pixel at the border: right in its middle, and as steep as what is lit beside it.
    fn cover_pixel(&mut self, middle: DVec2) {
        let Some(point) = (self.point)(middle) else { return };
        let mut slope = |step: DVec2| {
            let ahead = (self.point)(middle + step).map(|there| there - point);
            let behind = (self.point)(middle - step).map(|there| point - there);
            match (ahead, behind) {
                (Some(ahead), Some(behind)) => (ahead + behind) / 2.0 / step.length(),
                (Some(one), None) | (None, Some(one)) => one / step.length(),
                (None, None) => DVec3::ZERO,
            }
        };
        let (right, below) = (slope(DVec2::X * 0.25), slope(DVec2::Y * 0.25));
        let first = self.mesh.vertices.len() as u32;
        for (x, y) in [(-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)] {
            let point = point + right * x + below * y;
            self.mesh.vertices.push(WarpVertex { pixel: middle + DVec2::new(x, y), point });
        }
        self.mesh.triangles.extend([0, 1].map(|half| match half {
            0 => [first, first + 1, first + 2],
            _ => [first + 2, first + 1, first + 3],
        }));
    }
}

/// Returns the distances of the middles of a cell's sides across, of those down, and of its
/// diagonal from lines between its corners, in pixels as they lie there. A smooth mapping is off by
/// no more anywhere: linear interpolation in a right triangle is off most at the middle of its
/// longest side.
fn errors_px(points: &[Option<DVec3>; 9], span: DVec2) -> [f64; 3] {
    let at = |slot: usize| points[slot].unwrap_or(DVec3::NAN);
    let across = at(0).distance(at(2)).min(at(6).distance(at(8))) / span.x;
    let down = at(0).distance(at(6)).min(at(2).distance(at(8))) / span.y;
    let pitch = across.min(down);
    let off = |middle: usize, a: usize, b: usize| {
        let off = at(middle).distance((at(a) + at(b)) / 2.0);
        // All of a picture may show one point.
        if off == 0.0 { 0.0 } else { off / pitch }
    };
    [off(1, 0, 2).max(off(7, 6, 8)), off(3, 0, 6).max(off(5, 2, 8)), off(4, 2, 6)]
}

#[cfg(test)]
mod tests;
