//! Rasterisation: the pixels that a triangle covers, and their light.
//!
//! Coverage is decided on the clipped polygon at pixel centres, by the top-left rule. Attributes
//! and distances come from the whole triangle by homogeneous edge functions (Olano and Greer,
//! "Triangle Scan Conversion using 2D Homogeneous Coordinates", 1997), which need no division by
//! a corner's `w`. So the two halves check each other.

use glam::{DVec2, DVec3};

use super::clip::clip;
use super::facet::Facet;
use super::view::{HomogeneousPixel, View};

/// Pixels by which a hardware rasteriser may see an edge elsewhere: Vulkan guarantees corners on
/// a grid of 1/16 pixel, what is in use has 1/256.
pub const EDGE_TOLERANCE: f64 = 0.01;

/// Surfaces nearer to each other than this part of their distance from the eye may be resolved
/// either way: some units in the last place of f32, in which the program's positions are.
pub const DISTANCE_TOLERANCE: f64 = 2e-6;

/// The content of a pixel.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// The nearest facet, the first of those equally near; `None` for the sky.
    pub facet: Option<usize>,
    /// Linear RGB.
    pub light: DVec3,
    /// In metres along the screen's normal; infinite for the sky.
    pub w: f64,
    /// `true` if no edge is within [`EDGE_TOLERANCE`], and no other surface within
    /// [`DISTANCE_TOLERANCE`].
    pub is_sure: bool,
}

/// A triangle ready to be asked about pixels.
pub struct Projected<'a> {
    facet: &'a Facet,
    /// The corners of the clipped polygon, clockwise as rows go down.
    polygon: Vec<DVec2>,
    /// Homogeneous edge functions; their sum over the determinant is 1/w.
    edges: [DVec3; 3],
    determinant: f64,
}

impl<'a> Projected<'a> {
    /// `None` where it is not seen: it is outside, turns its back, or has no area.
    pub fn new(view: &View, facet: &'a Facet) -> Option<Self> {
        let seen = facet.corners.map(|corner| view.see(corner.place));
        let [a, b, c] = seen.map(|s: HomogeneousPixel| DVec3::new(s.x, s.y, s.w));
        let edges = [b.cross(c), c.cross(a), a.cross(b)];
        let determinant = a.dot(edges[0]);
        // Rows go down, so counter-clockwise is negative.
        if determinant == 0.0 || (determinant > 0.0 && !facet.is_double_sided) {
            return None;
        }
        let clipped = clip(seen, view.size, view.near_m);
        let mut polygon: Vec<DVec2> =
            clipped.iter().map(|p| DVec2::new(p.x / p.w, p.y / p.w)).collect();
        if determinant < 0.0 {
            polygon.reverse();
        }
        (polygon.len() >= 3).then_some(Self { facet, polygon, edges, determinant })
    }

    /// The least and the greatest pixel that the polygon can cover, in a picture of this size.
    pub fn span(&self, size: [u32; 2]) -> [[u32; 2]; 2] {
        let least = self.polygon.iter().fold(DVec2::MAX, |m, p| m.min(*p)) - 1.0;
        let most = self.polygon.iter().fold(DVec2::MIN, |m, p| m.max(*p)) + 1.0;
        let last = DVec2::new(f64::from(size[0] - 1), f64::from(size[1] - 1));
        [least, most].map(|p| {
            let p = p.clamp(DVec2::ZERO, last);
            [p.x as u32, p.y as u32]
        })
    }

    /// Returns whether a pixel's centre is covered.
    pub fn covers(&self, center: DVec2) -> bool {
        self.sides().all(|(from, to)| {
            let side = side(from, to, center);
            let along = to - from;
            let is_top_left = along.y < 0.0 || (along.y == 0.0 && along.x > 0.0);
            side > 0.0 || (side == 0.0 && is_top_left)
        })
    }

    /// Returns the distance of a point from the nearest edge, in pixels; negative outside.
    pub fn margin(&self, center: DVec2) -> f64 {
        let distance = |(from, to): (DVec2, DVec2)| side(from, to, center) / (to - from).length();
        let long = |(from, to): &(DVec2, DVec2)| (*to - *from).length() > 1e-12;
        self.sides().filter(long).map(distance).fold(f64::INFINITY, f64::min)
    }

    /// Distance along the screen's normal, and linear light, at a point of the picture; the plane
    /// goes on beyond the triangle.
    pub fn at(&self, point: DVec2) -> (f64, DVec3) {
        let weights = self.edges.map(|edge| edge.dot(point.extend(1.0)));
        let sum: f64 = weights.iter().sum();
        let [a, b, c] = weights.map(|weight| weight / sum);
        let [p, q, r] = &self.facet.corners;
        let color = p.color * a + q.color * b + r.color * c;
        let light = match &self.facet.picture {
            Some(picture) => color * picture.sample(p.uv * a + q.uv * b + r.uv * c),
            None => color,
        };
        (self.determinant / sum, light)
    }

    fn sides(&self) -> impl Iterator<Item = (DVec2, DVec2)> + '_ {
        let count = self.polygon.len();
        (0..count).map(move |i| (self.polygon[i], self.polygon[(i + 1) % count]))
    }
}

/// Above 0 on the inner side of a side. Taken from the same end whichever way it is walked, so
/// that two triangles never both have, or both miss, a pixel of their common edge.
fn side(from: DVec2, to: DVec2, point: DVec2) -> f64 {
    let is_in_order = (from.x, from.y) <= (to.x, to.y);
    let (low, high) = if is_in_order { (from, to) } else { (to, from) };
    let side = (high - low).perp_dot(point - low);
    if is_in_order { side } else { -side }
}

/// The state of a pixel while facets are drawn.
#[derive(Clone, Copy)]
struct Pixel {
    nearest: Sample,
    /// The distance of the next surface behind the nearest one.
    second: f64,
    /// The distance of the nearest facet that may or may not cover the pixel, as its edge is so
    /// near.
    doubted: f64,
}

/// The whole picture, rows from the top.
pub fn draw(view: &View, facets: &[Facet], sky: DVec3) -> Vec<Sample> {
    let [width, height] = view.size;
    let nearest = Sample { facet: None, light: sky, w: f64::INFINITY, is_sure: true };
    let empty = Pixel { nearest, second: f64::INFINITY, doubted: f64::INFINITY };
    let mut pixels = vec![empty; width as usize * height as usize];
    for (index, facet) in facets.iter().enumerate() {
        let Some(projected) = Projected::new(view, facet) else { continue };
        let [[x0, y0], [x1, y1]] = projected.span(view.size);
        for (x, y) in (y0..=y1).flat_map(|y| (x0..=x1).map(move |x| (x, y))) {
            let center = DVec2::new(f64::from(x), f64::from(y)) + 0.5;
            let pixel = &mut pixels[y as usize * width as usize + x as usize];
            let margin = projected.margin(center);
            if margin < -EDGE_TOLERANCE {
                continue;
            }
            let (w, light) = projected.at(center);
            if margin < EDGE_TOLERANCE {
                pixel.doubted = pixel.doubted.min(w);
            }
            if !projected.covers(center) {
                continue;
            }
            if w < pixel.nearest.w {
                pixel.second = pixel.nearest.w;
                pixel.nearest = Sample { facet: Some(index), light, w, is_sure: true };
            } else {
                pixel.second = pixel.second.min(w);
            }
        }
    }
    let mut samples = Vec::with_capacity(pixels.len());
    for (index, Pixel { nearest, second, doubted }) in (0u32..).zip(pixels) {
        let center = DVec2::new(f64::from(index % width), f64::from(index / width)) + 0.5;
        let gap = DISTANCE_TOLERANCE * nearest.w * view.slant(center);
        // Nothing is as near as the sky, which is infinitely far.
        let is_alone = second.is_infinite() || second > nearest.w + gap;
        samples.push(Sample {
            is_sure: is_alone && (doubted.is_infinite() || doubted > nearest.w),
            ..nearest
        });
    }
    samples
}
