//! Triangles divided until a map of their points is linear in each.
//!
//! An edge is divided or not by itself, so that both of its triangles agree and no gap opens.

use std::collections::HashMap;

use super::{WARP_VERTICES_MAX, WarpMesh, WarpVertex};

/// Maximum number of times that an edge is halved: from the side of the largest picture to a pixel.
const ROUNDS_MAX: usize = 14;

/// An edge shorter than this, in pixels, is not divided.
const EDGE_MIN_PX: f64 = 1.0;

/// The fineness to which triangles are divided.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Refinement {
    /// Maximum length of an edge in pixels.
    pub edge_px: f64,
    /// Maximum distance of the middle of an edge from where it should be, in pixels.
    pub error_px: f64,
}

impl WarpMesh {
    /// The mesh whose vertices are those that `map` makes of this one's, divided as finely as it
    /// takes for lines between them; triangles with a corner for which it gives `None` are left
    /// out.
    #[must_use]
    pub(crate) fn mapped(
        self,
        rule: Refinement,
        map: impl Fn(&WarpVertex) -> Option<WarpVertex>,
    ) -> Self {
        let mapped = self.vertices.iter().map(&map).collect();
        let mut maker =
            Divider { map, rule, from: self.vertices, to: mapped, known: HashMap::new() };
        let mut waiting = self.triangles;
        let mut done = Vec::with_capacity(waiting.len());
        for _ in 0..ROUNDS_MAX {
            let mut divided = Vec::new();
            for [a, b, c] in waiting {
                let middles = [maker.middle(a, b), maker.middle(b, c), maker.middle(c, a)];
                divide([a, b, c], middles, &mut done, &mut divided);
            }
            waiting = divided;
            if waiting.is_empty() {
                break;
            }
        }
        done.extend(waiting);
        let is_there =
            |corners: &&[u32; 3]| corners.iter().all(|&i| maker.to[i as usize].is_some());
        let triangles: Vec<[u32; 3]> = done.iter().filter(is_there).copied().collect();
        // What is not there has no triangle.
        let nowhere = WarpVertex { pixel: glam::DVec2::NAN, point: glam::DVec3::NAN };
        let vertices = maker.to.iter().map(|vertex| vertex.unwrap_or(nowhere)).collect();
        Self { vertices, triangles }.without_loose_vertices()
    }
}

impl WarpMesh {
    /// The mesh with all edges halved that `is_long` says are too long, again and again, down to
    /// the length of a pixel.
    #[must_use]
    pub(crate) fn divided(mut self, is_long: impl Fn(&WarpVertex, &WarpVertex) -> bool) -> Self {
        let mut known: HashMap<[u32; 2], Option<u32>> = HashMap::new();
        let mut waiting = std::mem::take(&mut self.triangles);
        for _ in 0..ROUNDS_MAX {
            let mut middle = |one: u32, other: u32| {
                let ends = [one.min(other), one.max(other)];
                *known.entry(ends).or_insert_with(|| {
                    let [a, b] = ends.map(|end| self.vertices[end as usize]);
                    let is_divided = self.vertices.len() < WARP_VERTICES_MAX
                        && a.pixel.distance(b.pixel) > EDGE_MIN_PX
                        && is_long(&a, &b);
                    is_divided.then(|| {
                        let (pixel, point) = (a.pixel.midpoint(b.pixel), a.point.midpoint(b.point));
                        self.vertices.push(WarpVertex { pixel, point });
                        self.vertices.len() as u32 - 1
                    })
                })
            };
            let mut divided = Vec::new();
            for [a, b, c] in std::mem::take(&mut waiting) {
                let middles = [middle(a, b), middle(b, c), middle(c, a)];
                divide([a, b, c], middles, &mut self.triangles, &mut divided);
            }
            waiting = divided;
        }
        self.triangles.extend(waiting);
        self
    }
}

/// A mesh on its way.
struct Divider<F> {
    map: F,
    rule: Refinement,
    from: Vec<WarpVertex>,
    to: Vec<Option<WarpVertex>>,
    /// The middles of edges that are divided.
    known: HashMap<[u32; 2], Option<u32>>,
}

impl<F: Fn(&WarpVertex) -> Option<WarpVertex>> Divider<F> {
    /// The vertex in the middle of an edge, if it is to be divided.
    fn middle(&mut self, one: u32, other: u32) -> Option<u32> {
        let ends = [one.min(other), one.max(other)];
        if let Some(known) = self.known.get(&ends) {
            return *known;
        }
        let [a, b] = ends.map(|end| self.from[end as usize]);
        let pixel = (a.pixel + b.pixel) / 2.0;
        let between = WarpVertex { pixel, point: (a.point + b.point) / 2.0 };
        let found = (self.map)(&between);
        let is_divided = self.from.len() < WARP_VERTICES_MAX
            && a.pixel.distance(b.pixel) > EDGE_MIN_PX
            && !self.is_straight(ends, found.as_ref(), a.pixel.distance(b.pixel));
        let made = is_divided.then(|| {
            self.from.push(between);
            self.to.push(found);
            self.from.len() as u32 - 1
        });
        self.known.insert(ends, made);
        made
    }

    /// Returns whether the line between two vertices is right, whose middle is found there.
    fn is_straight(&self, ends: [u32; 2], found: Option<&WarpVertex>, length_px: f64) -> bool {
        let (a, b, found) = match (ends.map(|end| self.to[end as usize]), found) {
            ([Some(a), Some(b)], Some(found)) => (a, b, found),
            ([None, None], None) => return length_px <= self.rule.edge_px,
            _ => return false,
        };
        let long_px = a.pixel.distance(b.pixel);
        let long_m = a.point.distance(b.point);
        let off_px = found.pixel.distance((a.pixel + b.pixel) / 2.0);
        let off_m = found.point.distance((a.point + b.point) / 2.0);
        // A line may show one point.
        let point_px = if off_m == 0.0 { 0.0 } else { off_m / long_m * long_px };
        long_px <= self.rule.edge_px && off_px + point_px <= self.rule.error_px
    }
}

/// A triangle whose edges have these middles: it is done where there is none.
fn divide(
    [a, b, c]: [u32; 3],
    middles: [Option<u32>; 3],
    done: &mut Vec<[u32; 3]>,
    divided: &mut Vec<[u32; 3]>,
) {
    match middles {
        [None, None, None] => done.push([a, b, c]),
        [Some(ab), Some(bc), Some(ca)] => {
            divided.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        [Some(ab), None, None] => divided.extend([[a, ab, c], [ab, b, c]]),
        [None, Some(bc), None] => divided.extend([[a, b, bc], [a, bc, c]]),
        [None, None, Some(ca)] => divided.extend([[a, b, ca], [ca, b, c]]),
        [Some(ab), Some(bc), None] => divided.extend([[ab, b, bc], [a, ab, bc], [a, bc, c]]),
        [None, Some(bc), Some(ca)] => divided.extend([[bc, c, ca], [b, bc, ca], [b, ca, a]]),
        [Some(ab), None, Some(ca)] => divided.extend([[ca, a, ab], [c, ca, ab], [c, ab, b]]),
    }
}
