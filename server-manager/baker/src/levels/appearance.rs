//! How far textures slide and normals turn where vertices are removed: sampled at these vertices.
//!
//! At a removed vertex, its texture coordinates are compared with those of the point of the coarser
//! surface that is nearest to it. Their difference times the size of a texture unit on the finer
//! surface is how far the texture has slid. At seams several triangles are about as near, and the
//! one that fits best is taken: which of them a viewer sees at that point is not known.
//!
//! This proves nothing of the points between vertices, where texture coordinates are linear on both
//! surfaces: what a slide is most, it nearly is at a vertex.

use glam::{DVec2, DVec3};
use polyptych_wall::triangle_distance::nearest_on_triangle;

use super::source::Source;
use super::triangle_set::{Nearest, TriangleSet};

/// Triangles whose distance is less than this times the least one are about as near.
const ABOUT_AS_NEAR: f64 = 1.1;

/// Texture coordinates nearer than this are the same: a thousandth of a texel of 16,384.
const SAME_UV: f64 = 6e-8;

/// A texture that is stretched more than this in one direction has no size in the other.
const STRETCH_MAX: f64 = 1e9;

/// Vertices of a piece that a list of triangles numbers anew.
pub(super) struct VertexList<'a> {
    pub source: &'a Source<'a>,
    pub vertices: &'a [u32],
}

/// The largest changes at any vertex.
#[derive(Clone, Copy, Debug)]
pub(super) struct Change {
    /// In units of the primitive's space; `None` if a texture changes where it was of one colour,
    /// so that no distance says how much.
    pub slide: Option<f64>,
    /// In radians.
    pub normal_angle: f64,
}

/// How the surface runs along the two axes of a texture: the derivatives of the position.
type Tangents = [DVec3; 2];

impl VertexList<'_> {
    fn uv(&self, index: u32, offset: usize) -> DVec2 {
        self.source.surface.uv(self.vertices[index as usize], offset)
    }

    fn normal(&self, index: u32) -> DVec3 {
        self.source.surface.normal(self.vertices[index as usize])
    }

    /// Returns the tangents at each vertex, from one of its triangles; `None` if none of them has
    /// an area on the texture.
    fn tangents(&self, indices: &[u32], offset: usize) -> Vec<Option<Tangents>> {
        let mut tangents = vec![None; self.vertices.len()];
        for corners in indices.as_chunks::<3>().0 {
            if corners.iter().all(|corner| tangents[*corner as usize].is_some()) {
                continue;
            }
            let position =
                |corner: u32| self.source.surface.position(self.vertices[corner as usize]);
            let of = triangle_tangents(
                corners.map(position),
                corners.map(|corner| self.uv(corner, offset)),
            );
            for corner in corners {
                let known = &mut tangents[*corner as usize];
                *known = known.or(of);
            }
        }
        tangents
    }
}

fn triangle_tangents([a, b, c]: [DVec3; 3], [ta, tb, tc]: [DVec2; 3]) -> Option<Tangents> {
    let (ab, ac) = (b - a, c - a);
    let (tab, tac) = (tb - ta, tc - ta);
    let area = tab.perp_dot(tac);
    let is_flat = area.abs() * STRETCH_MAX <= tab.length() * tac.length();
    let along = [ab * tac.y - ac * tab.y, ac * tab.x - ab * tac.x].map(|vector| vector / area);
    (!is_flat && along.iter().all(|vector| vector.is_finite())).then_some(along)
}

/// Measures the change at the vertices that `before` uses and `after` does not. `nearest` gives the
/// triangle of `after` that is nearest to a vertex; those nearer than `negligible` are as near.
pub(super) fn change(
    list: &VertexList<'_>,
    before: &[u32],
    after: &[u32],
    after_set: &TriangleSet<'_>,
    nearest: impl Fn(u32) -> Nearest,
    negligible: f64,
) -> Change {
    let mut is_removed = vec![false; list.vertices.len()];
    before.iter().for_each(|index| is_removed[*index as usize] = true);
    after.iter().for_each(|index| is_removed[*index as usize] = false);
    let offsets = list.source.uv_lengths.iter().map(|(offset, _)| *offset);
    let maps: Vec<(usize, Vec<Option<Tangents>>)> =
        offsets.map(|offset| (offset, list.tangents(before, offset))).collect();
    let mut change = Change { slide: Some(0.0), normal_angle: 0.0 };
    let removed = (0..).zip(&is_removed).filter(|(_, is_removed)| **is_removed);
    for (index, _) in removed {
        let point = list.source.surface.position(list.vertices[index as usize]);
        let limit = nearest(index).distance * ABOUT_AS_NEAR + negligible;
        let (mut slide, mut cosine) = (f64::INFINITY, -1.0_f64);
        after_set.visit_within(point, limit, |triangle, distance| {
            if distance <= limit {
                let shares = barycentric(point, &after_set.corners(triangle));
                let first = triangle as usize * 3;
                let corners = [after[first], after[first + 1], after[first + 2]];
                let slides = maps.iter().map(|(offset, tangents)| {
                    let uvs = corners.map(|corner| list.uv(corner, *offset));
                    let uv: DVec2 = uvs.iter().zip(shares).map(|(uv, share)| *uv * share).sum();
                    slid(uv - list.uv(index, *offset), tangents[index as usize])
                });
                slide = slide.min(slides.fold(0.0, f64::max));
                let normals = corners.map(|corner| list.normal(corner));
                let normal: DVec3 = normals.iter().zip(shares).map(|(n, share)| *n * share).sum();
                cosine = cosine.max(normal.normalize_or_zero().dot(list.normal(index)));
            }
            limit
        });
        change.slide = change.slide.map(|most| most.max(slide)).filter(|most| most.is_finite());
        change.normal_angle = change.normal_angle.max(cosine.clamp(-1.0, 1.0).acos());
    }
    change
}

/// Returns how far a texture slides; infinity if it changes and has no size.
fn slid(by: DVec2, tangents: Option<Tangents>) -> f64 {
    match tangents {
        Some([along_u, along_v]) => (along_u * by.x + along_v * by.y).length(),
        None if by.length() <= SAME_UV => 0.0,
        None => f64::INFINITY,
    }
}

/// Returns the shares of the corners in the point of a triangle that is nearest to `point`.
fn barycentric(point: DVec3, corners: &[DVec3; 3]) -> [f64; 3] {
    let [a, b, c] = *corners;
    let at = nearest_on_triangle(point, corners);
    let normal = (b - a).cross(c - a);
    let area = normal.length_squared();
    let share = |from: DVec3, to: DVec3| (to - from).cross(at - from).dot(normal) / area;
    let shares = [share(b, c), share(c, a), share(a, b)];
    if shares.iter().all(|share| share.is_finite()) {
        return shares;
    }
    // A line, or a point: the nearest corner.
    let mut nearest = 0;
    for corner in 1..3 {
        if corners[corner].distance_squared(at) < corners[nearest].distance_squared(at) {
            nearest = corner;
        }
    }
    let mut shares = [0.0; 3];
    shares[nearest] = 1.0;
    shares
}
