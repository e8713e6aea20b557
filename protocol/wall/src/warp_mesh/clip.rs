//! Triangles cut by lines: what of a mesh lies in a picture.
//!
//! I. Sutherland, G. Hodgman, *Reentrant polygon clipping*, 1974, one line after the other over the
//! whole mesh, so that triangles that share an edge share the points at which it is cut.

use std::collections::HashMap;

use glam::{DVec2, DVec3};

use super::{WarpMesh, WarpVertex};

/// Maximum distance between a side of the picture and a vertex that counts as on it, in pixels:
/// places of files are f32, and a strip cut off there would be thinner than any pixel sees.
pub(crate) const SNAP_PX: f64 = 1e-2;

impl WarpMesh {
    /// The part of the mesh where `line.dot((x, y, 1))` is not negative for each of the lines.
    #[must_use]
    pub(crate) fn cut(mut self, lines: &[DVec3]) -> Self {
        for line in lines {
            let side = |vertex: &WarpVertex| line.dot(vertex.pixel.extend(1.0));
            let sides: Vec<f64> = self.vertices.iter().map(side).collect();
            if sides.iter().any(|side| *side < 0.0) {
                self.cut_by(&sides);
            }
        }
        self.without_loose_vertices()
    }

    /// The part of the mesh in the rectangle from `low` to `high`, in its own pixels. What is
    /// within `snap` of a side is moved onto it.
    #[must_use]
    pub(crate) fn within_rect(mut self, low: DVec2, high: DVec2, snap: f64) -> Self {
        for WarpVertex { pixel, .. } in &mut self.vertices {
            for side in [low, high] {
                let is_near = (*pixel - side).abs().cmple(DVec2::splat(snap));
                *pixel = DVec2::select(is_near, side, *pixel);
            }
        }
        let is_inside = |v: &WarpVertex| v.pixel.cmpge(low).all() && v.pixel.cmple(high).all();
        if self.vertices.iter().all(is_inside) {
            return self;
        }
        let mut cut = self.cut(&[
            DVec3::new(1.0, 0.0, -low.x),
            DVec3::new(0.0, 1.0, -low.y),
            DVec3::new(-1.0, 0.0, high.x),
            DVec3::new(0.0, -1.0, high.y),
        ]);
        // Points between others are rounded.
        for vertex in &mut cut.vertices {
            vertex.pixel = vertex.pixel.clamp(low, high);
        }
        let vertices = &cut.vertices;
        cut.triangles.retain(|corners| {
            let [a, b, c] = corners.map(|corner| vertices[corner as usize].pixel);
            (b - a).perp_dot(c - a) != 0.0
        });
        cut.without_loose_vertices()
    }

    /// Keeps what is not negative of triangles whose vertices are so far from a line.
    fn cut_by(&mut self, sides: &[f64]) {
        let mut known: HashMap<[u32; 2], u32> = HashMap::new();
        let mut triangles = Vec::with_capacity(self.triangles.len());
        for corners in std::mem::take(&mut self.triangles) {
            let is_out = corners.map(|corner| sides[corner as usize] < 0.0);
            match is_out.iter().filter(|out| **out).count() {
                0 => triangles.push(corners),
                3 => {}
                count => {
                    // The corner that is alone on its side comes first.
                    let lone = (0..3).find(|&i| is_out[i] == (count == 1)).unwrap_or(0);
                    let [a, b, c] = [0, 1, 2].map(|i| corners[(lone + i) % 3]);
                    let mut crossing = |one, other| {
                        let ends = [u32::min(one, other), u32::max(one, other)];
                        *known.entry(ends).or_insert_with(|| {
                            self.vertices.push(self.crossing(ends, sides));
                            self.vertices.len() as u32 - 1
                        })
                    };
                    let (ab, ac) = (crossing(a, b), crossing(a, c));
                    if count == 1 {
                        triangles.extend([[ab, b, c], [ab, c, ac]]);
                    } else {
                        triangles.push([a, ab, ac]);
                    }
                }
            }
        }
        self.triangles = triangles;
    }

    /// Returns the vertex where an edge meets the line.
    fn crossing(&self, ends: [u32; 2], sides: &[f64]) -> WarpVertex {
        let [a, b] = ends.map(|end| self.vertices[end as usize]);
        let [from, to] = ends.map(|end| sides[end as usize]);
        let part = (from / (from - to)).clamp(0.0, 1.0);
        WarpVertex { pixel: a.pixel.lerp(b.pixel, part), point: a.point.lerp(b.point, part) }
    }

    /// Only the vertices that a triangle has: planes are fitted around all that there are.
    pub(super) fn without_loose_vertices(mut self) -> Self {
        let mut index_of: Vec<Option<u32>> = vec![None; self.vertices.len()];
        let mut kept = Vec::new();
        for corner in self.triangles.iter_mut().flatten() {
            let old = *corner as usize;
            *corner = *index_of[old].get_or_insert_with(|| {
                kept.push(self.vertices[old]);
                kept.len() as u32 - 1
            });
        }
        Self { vertices: kept, triangles: self.triangles }
    }
}
