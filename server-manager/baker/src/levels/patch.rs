//! A part of a surface that is simplified at once, and what that changes.

use std::collections::{HashMap, HashSet};

use glam::DVec3;
use meshopt::{SimplifyOptions, SimplifyVertex};

use super::appearance::VertexList;
use super::deviation::{self, Deviation};
use super::source::{Source, adapter};
use super::triangle_set::{Nearest, TriangleSet};

/// The number of triangles of a coarser level as a share of the finer one's.
const RATIO: f64 = 0.5;

/// [`RATIO`] of few triangles, where the next ones to spare may cost far more than the others.
const RATIO_OF_FEW: f64 = 0.7;

/// Triangles that are few: some meshlets.
const FEW: usize = 512;

/// A coarser level that has more triangles than this, as a share, is not worth its memory.
const RATIO_MAX: f64 = 0.85;

/// A normal that turns by a unit counts as much as a vertex that moves by this share of the
/// patch's size.
const NORMAL_WEIGHT: f32 = 0.1;

/// [`NORMAL_WEIGHT`] of a colour that goes from black to white.
const COLOR_WEIGHT: f32 = 0.1;

/// Distances below this share of the patch's size need not be measured.
const NEGLIGIBLE: f64 = 1e-5;

/// Distances below this share of the error that the patch has already need not be measured.
const NEGLIGIBLE_BESIDE: f64 = 0.03;

/// Rounding of f64 in a distance, as a share of the coordinates.
const ROUNDING: f64 = 1e-12;

/// Triangles over vertices of a piece.
pub(super) struct Patch<'a> {
    source: &'a Source<'a>,
    /// The vertices of the piece that it uses, in ascending order.
    vertices: Vec<u32>,
    /// Three for each triangle, in `vertices`.
    indices: Vec<u32>,
    /// The first of `vertices` at the position of each.
    welded: Vec<u32>,
    looks: VertexList,
}

/// A patch with fewer triangles.
#[derive(Debug)]
pub(super) struct Simplified {
    /// Three for each triangle, as the piece numbers vertices.
    pub indices: Vec<u32>,
    /// An upper bound of the distance between the surfaces before and after, in both directions;
    /// or how far a texture slides, if that is more. Above 0, in units of the primitive's space.
    pub error: f64,
    /// The largest angle by which the normal at a removed vertex differs, in radians.
    pub normal_angle: f64,
}

impl<'a> Patch<'a> {
    /// The patch of these triangles.
    pub fn new(source: &'a Source<'a>, triangles: &[u32]) -> Self {
        let mut vertices = triangles.to_vec();
        vertices.sort_unstable();
        vertices.dedup();
        let local = |vertex: &u32| vertices.partition_point(|known| known < vertex) as u32;
        let indices: Vec<u32> = triangles.iter().map(local).collect();
        let mut first_at = HashMap::new();
        let weld = |(local, vertex): (u32, &u32)| {
            *first_at.entry(source.welded[*vertex as usize]).or_insert(local)
        };
        let welded = (0..).zip(&vertices).map(weld).collect();
        let looks = VertexList::new(source, &vertices, &indices);
        Self { source, vertices, indices, welded, looks }
    }

    /// Returns the patch with about half of its triangles, or `None` if too few can be spared.
    /// `is_locked` says of a vertex whether it must stay, and `prior` is the error that the
    /// patch's triangles have already.
    pub fn simplify(&self, is_locked: impl Fn(u32) -> bool, prior: f64) -> Option<Simplified> {
        let flags =
            self.vertices.iter().map(|vertex| self.source.flags(*vertex, is_locked(*vertex)));
        let flags: Vec<SimplifyVertex> = flags.collect();
        let is_whole = !flags.iter().any(|flags| flags.contains(SimplifyVertex::Lock));
        let mut after = self.fewer(&flags, SimplifyOptions::Permissive);
        if !self.is_worth(&after) {
            let flags: Vec<_> = flags.iter().map(|flags| *flags & SimplifyVertex::Lock).collect();
            // What is removed as a whole may have no neighbour in other patches.
            let prune = if is_whole { SimplifyOptions::Prune } else { SimplifyOptions::None };
            after = self.fewer(&flags, SimplifyOptions::Permissive | prune);
        }
        if !self.is_worth(&after) {
            return None;
        }
        let (error, normal_angle) = self.change(&after, prior);
        let indices = after.iter().map(|index| self.vertices[*index as usize]).collect();
        error.is_finite().then_some(Simplified { indices, error, normal_angle })
    }

    fn is_worth(&self, after: &[u32]) -> bool {
        !after.is_empty() && after.len() as f64 <= self.indices.len() as f64 * RATIO_MAX
    }

    fn fewer(&self, flags: &[SimplifyVertex], options: SimplifyOptions) -> Vec<u32> {
        let scaled: Vec<[f32; 3]> =
            self.vertices.iter().map(|vertex| self.source.scaled[*vertex as usize]).collect();
        let Some(positions) = adapter(&scaled) else { return Vec::new() };
        let (attributes, weights) = self.attributes();
        let triangles = self.indices.len() / 3;
        let ratio = if triangles <= FEW { RATIO_OF_FEW } else { RATIO };
        let triangles = triangles as f64 * ratio;
        meshopt::simplify_with_attributes_and_locks(
            &self.indices,
            &positions,
            &attributes,
            &weights,
            size_of_val(weights.as_slice()),
            flags,
            (triangles as usize).max(1) * 3,
            f32::MAX,
            options,
            None,
        )
    }

    /// Gives what the simplifier keeps beside positions, and the weight of each number of a vertex.
    /// Weights are shares of the patch's longest side.
    fn attributes(&self) -> (Vec<f32>, Vec<f32>) {
        let surface = &self.source.surface;
        let side = self.size().max_element();
        let sets = surface.uv_offsets().count();
        let mut weights = vec![NORMAL_WEIGHT; 3];
        weights.extend([[1.0; 2]; 2][..sets].as_flattened());
        weights.extend(surface.layout.color.then_some([COLOR_WEIGHT; 4]).into_iter().flatten());
        let mut attributes = Vec::with_capacity(self.vertices.len() * weights.len());
        for (&vertex, point) in self.vertices.iter().zip(self.looks.points()) {
            attributes.extend(surface.normal(vertex).as_vec3().to_array());
            for uv in &point.uvs[..sets] {
                let uv = (*uv / side).as_vec2();
                attributes.extend(if uv.is_finite() { uv.to_array() } else { [0.0; 2] });
            }
            attributes.extend(surface.color(vertex).into_iter().flatten());
        }
        (attributes, weights)
    }

    /// The sides of the box around it.
    fn size(&self) -> DVec3 {
        let bounds = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let positions = self.looks.points().iter().map(|point| point.position);
        let (low, high) = positions.fold(bounds, |(low, high), at| (low.min(at), high.max(at)));
        high - low
    }

    /// Measures what fewer triangles change; see [`Simplified`].
    fn change(&self, after: &[u32], prior: f64) -> (f64, f64) {
        let size = self.size().length();
        let negligible = (NEGLIGIBLE * size).max(NEGLIGIBLE_BESIDE * prior);
        let points: Vec<DVec3> = self.looks.points().iter().map(|point| point.position).collect();
        let list = |indices: &[u32]| -> Vec<[u32; 3]> {
            let triangles = indices.as_chunks::<3>().0.iter();
            triangles.map(|corners| corners.map(|index| self.welded[index as usize])).collect()
        };
        let (old, new) = (list(&self.indices), list(after));
        let (old_set, new_set) = (TriangleSet::new(&points, &old), TriangleSet::new(&points, &new));
        let (removed, added) = (without(&old, &new), without(&new, &old));
        // Of vertices too that only their texture coordinates or normals tell from kept ones.
        let to_new = nearest_of_corners(&points, &old, &new, &new_set);
        let to_old = nearest_of_corners(&points, &added, &old, &old_set);
        let mut deviation = Deviation::default();
        deviation::measure(&mut deviation, &points, &removed, &to_new, &new_set, negligible);
        deviation::measure(&mut deviation, &points, &added, &to_old, &old_set, negligible);
        let nearest = |index: u32| to_new[self.welded[index as usize] as usize];
        let change = self.looks.change(&self.indices, after, &new_set, nearest);
        let reach = points.iter().map(|point| point.abs().max_element()).fold(0.0, f64::max);
        // Positions are no more exact than this themselves, so a smaller error has no meaning.
        let least = (reach * f64::from(f32::EPSILON)).max(f64::from(f32::MIN_POSITIVE));
        let error = (deviation.upper + reach * ROUNDING).max(change.slide).max(least);
        (error, change.normal_angle)
    }
}

/// Gives the triangles of the first list that are not in the second, whatever their sides.
fn without(triangles: &[[u32; 3]], others: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let sorted = |triangle: &[u32; 3]| {
        let mut sorted = *triangle;
        sorted.sort_unstable();
        sorted
    };
    let others: HashSet<[u32; 3]> = others.iter().map(sorted).collect();
    triangles.iter().filter(|triangle| !others.contains(&sorted(triangle))).copied().collect()
}

/// Gives for each point that `triangles` name which triangle of `to` is nearest to it. `surface`
/// has the corners of the triangles of `to`, and 0 is the distance of these.
fn nearest_of_corners(
    points: &[DVec3],
    triangles: &[[u32; 3]],
    surface: &[[u32; 3]],
    to: &TriangleSet,
) -> Vec<Nearest> {
    let mut nearest = vec![None; points.len()];
    for (triangle, corners) in (0..).zip(surface) {
        for corner in corners {
            nearest[*corner as usize] = Some(Nearest { triangle, distance: 0.0 });
        }
    }
    // Neighbours in the list are neighbours in space.
    let mut guess = 0;
    for &corner in triangles.iter().flatten() {
        let near = nearest[corner as usize]
            .get_or_insert_with(|| to.nearest(points[corner as usize], guess));
        guess = near.triangle;
    }
    let unused = Nearest { triangle: 0, distance: 0.0 };
    nearest.into_iter().map(|near| near.unwrap_or(unused)).collect()
}
