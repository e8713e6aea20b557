//! The triangles of a blended geometry in the order of their distances, where that can be seen.
//!
//! Blended triangles must be drawn from far to near, in a mesh too. A part of a convex surface
//! needs no order of its own: a ray meets it at most twice, first where it faces the eye and then
//! where it faces away, so its back faces before its front faces are in order already.

use std::sync::Arc;

use glam::{DVec3, Vec3};
use polyptych_scene::{Primitive, Topology};
use rayon::slice::ParallelSliceMut;

use super::Batch;
use super::geometry::Geometry;
use super::layout::SceneLayout;
use crate::draw_list::rising;

/// Maximum number of triangles that are ordered, of all places of all blended geometries: 10 ms for
/// each view on one core. Batches behind those that fit are drawn in the order of their files.
pub(super) const ORDERED_TRIANGLES_MAX: u64 = 1 << 18;
/// Maximum number of comparisons of a vertex with a plane: 20 ms for each geometry. What is larger
/// counts as not convex.
const CONVEX_TESTS_MAX: usize = 1 << 24;
/// A share of a geometry's extent by which a vertex may lie before a plane of a convex surface, and
/// that a triangle may be wide and still count as nothing: f32 rounds positions by less.
const CONVEX_SLACK: f32 = 1e-5;
/// Triangles from which several threads sort.
const PARALLEL_MIN: usize = 1 << 14;

/// The triangles of a geometry that must be ordered by distance.
#[derive(Debug)]
pub(crate) struct TriangleOrder {
    /// In the space of the primitive, by vertex; those at rest if clips bend it.
    positions: Vec<Vec3>,
    /// The triangles of all levels, in the order in which they are drawn.
    indices: Vec<[u32; 3]>,
}

impl TriangleOrder {
    /// Returns the triangles of checked vertices and indices; `None` if their order cannot be seen.
    pub fn new(desc: &Primitive, vertices: &[u8], indices: &[u8]) -> Option<Self> {
        if desc.topology != Topology::Triangles {
            return None;
        }
        let stride = desc.layout.stride() as usize;
        let positions: Vec<Vec3> = vertices.chunks_exact(stride).map(position).collect();
        let numbers: Vec<u32> = desc.index_format.numbers(indices).collect();
        let indices = numbers.as_chunks::<3>().0.to_vec();
        let finest = &indices[..indices.len().min(desc.triangles() as usize)];
        if desc.deformed.is_none() && is_convex(&positions, finest) {
            return None;
        }
        Some(Self { positions, indices })
    }

    /// Appends the indices of some runs of indices, the triangle whose middle has the greatest
    /// depth first; of equal ones the first in the geometry. `bent`: the positions as clips bend
    /// them, if they do.
    pub fn append(
        &self,
        (runs, bent): (impl Iterator<Item = [u32; 2]>, Option<&[Vec3]>),
        depth: impl Fn(DVec3) -> f64,
        (keys, ordered): (&mut Vec<(u64, u32)>, &mut Vec<u32>),
    ) {
        let positions = bent.unwrap_or(&self.positions);
        let at =
            |vertex: u32| positions.get(vertex as usize).map_or(DVec3::ZERO, |at| at.as_dvec3());
        keys.clear();
        for [first, count] in runs {
            for triangle in first / 3..(first + count) / 3 {
                let Some([a, b, c]) = self.indices.get(triangle as usize) else { continue };
                let middle = (at(*a) + at(*b) + at(*c)) / 3.0;
                keys.push((!rising(depth(middle)), triangle));
            }
        }
        if keys.len() < PARALLEL_MIN {
            keys.sort_unstable();
        } else {
            keys.par_sort_unstable();
        }
        ordered.extend(keys.iter().flat_map(|&(_, triangle)| self.indices[triangle as usize]));
    }
}

/// Returns for each batch whether its triangles are ordered: those of batches in their order, as
/// long as all of their places fit [`ORDERED_TRIANGLES_MAX`].
pub(super) fn ordered_batches(layout: &SceneLayout, geometries: &[Geometry]) -> Arc<[bool]> {
    let has_order = |batch: &Batch| {
        let order = geometries.get(batch.geometry as usize).is_some_and(|of| of.order.is_some());
        batch.ordered_pipeline.is_some() && order
    };
    let mut ordered: Vec<bool> = layout.batches.iter().map(has_order).collect();
    if ordered.contains(&true) {
        let mut places = vec![0u64; layout.batches.len()];
        for item in &layout.items {
            places[item.batch as usize] += 1;
        }
        let mut left = ORDERED_TRIANGLES_MAX;
        for (index, batch) in layout.batches.iter().enumerate() {
            // All places of a batch may be turned inside out, and into the other, at a time: the
            // first of the two takes room for all of both.
            let twin = layout.twins.get(&(index as u32)).map(|twin| *twin as usize);
            let fits = if let Some(first) = twin.filter(|twin| *twin < index) {
                ordered[first]
            } else {
                let of_both = places[index] + twin.map_or(0, |twin| places[twin]);
                let triangles = batch.triangles.saturating_mul(of_both);
                let fits = ordered[index] && triangles <= left;
                left -= if fits { triangles } else { 0 };
                fits
            };
            ordered[index] &= fits;
        }
    }
    ordered.into()
}

/// The position of an interleaved vertex.
fn position(vertex: &[u8]) -> Vec3 {
    let float = |at: usize| vertex.get(at..at + 4).map_or(0.0, bytemuck::pod_read_unaligned::<f32>);
    Vec3::new(float(0), float(4), float(8))
}

/// Returns whether no vertex lies before the plane of a triangle: the triangles are a part of the
/// surface of a convex body, seen from outside.
fn is_convex(positions: &[Vec3], triangles: &[[u32; 3]]) -> bool {
    let mut used: Vec<u32> = triangles.as_flattened().to_vec();
    used.sort_unstable();
    used.dedup();
    if used.len().saturating_mul(triangles.len()) > CONVEX_TESTS_MAX {
        return false;
    }
    let corners: Vec<Vec3> =
        used.iter().filter_map(|&vertex| positions.get(vertex as usize).copied()).collect();
    let around = |(min, max): (Vec3, Vec3), at: &Vec3| (min.min(*at), max.max(*at));
    let (min, max) = corners.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), around);
    let slack = (max - min).length() * CONVEX_SLACK;
    triangles.iter().all(|triangle| {
        let [a, b, c] = triangle.map(|vertex| positions.get(vertex as usize).copied());
        let (Some(a), Some(b), Some(c)) = (a, b, c) else { return false };
        let area = (b - a).cross(c - a);
        let longest = (b - a).length().max((c - a).length());
        // Nothing shows of what is thinner than that, and it has no plane.
        let is_thin = area.length() <= slack * longest;
        let normal = area.normalize_or_zero();
        is_thin || corners.iter().all(|corner| normal.dot(corner - a) <= slack)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A box from −1 to 1 without its lid, outside up.
    fn open_box() -> (Vec<Vec3>, Vec<[u32; 3]>) {
        let corner = |bits: u32| {
            let side = |bit: u32| if bits >> bit & 1 == 0 { -1.0 } else { 1.0 };
            Vec3::new(side(0), side(1), side(2))
        };
        let quads = [[0, 2, 3, 1], [0, 1, 5, 4], [1, 3, 7, 5], [3, 2, 6, 7], [2, 0, 4, 6]];
        let triangles = quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]);
        ((0..8).map(corner).collect(), triangles.collect())
    }

    #[test]
    fn tells_convex_surfaces_from_others() {
        let (positions, triangles) = open_box();
        assert!(is_convex(&positions, &triangles));
        let inward: Vec<_> = triangles.iter().map(|[a, b, c]| [*a, *c, *b]).collect();
        assert!(!is_convex(&positions, &inward), "seen from inside, the near wall faces away");
        let mut dented = positions.clone();
        dented[5] = Vec3::splat(-0.5);
        assert!(!is_convex(&dented, &triangles));
        assert!(is_convex(&positions, &[[0, 1, 2], [2, 1, 3]]), "what is flat");
        assert!(is_convex(&positions, &[[0, 0, 1]]), "what has no area");
        let nothing = positions.iter().map(|_| Vec3::NAN).collect::<Vec<_>>();
        assert!(!is_convex(&nothing, &triangles), "what is not finite has no inside");
    }
}
