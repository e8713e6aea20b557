//! A part of a surface that is simplified at once, and what that changes.

mod neighbors;
mod small_parts;

use std::cell::OnceCell;
use std::collections::BTreeMap;

use foldhash::{HashMap, HashMapExt, HashSet};
use glam::DVec3;
use meshopt::{SimplifyOptions, SimplifyVertex};
use polyptych_scene::VertexLayout;

use super::appearance::{Change, VertexList};
use super::chart;
use super::deviation::{self, Deviation};
use super::part_group::{self, PartPoints};
use super::simplified::Simplified;
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
    /// Three for each triangle, in `vertices`: what changes are measured against.
    indices: Vec<u32>,
    /// The triangles that are simplified; those of `indices`, or coarser ones.
    current: Vec<u32>,
    /// The first of `vertices` at the position of each.
    welded: Vec<u32>,
    /// The position that each vertex has in the triangles that are simplified, as `welded`.
    places: Vec<u32>,
    looks: VertexList,
    /// Made of `indices` when it is first asked for.
    reference: OnceCell<Reference>,
}

/// What changes are measured against.
#[derive(Debug)]
struct Reference {
    surfaces: BTreeMap<u32, ReferenceSurface>,
    charts: chart::Charts,
    /// The vertex that stands for each vertex's connected part.
    parts: Vec<u32>,
}

#[derive(Debug)]
struct ReferenceSurface {
    /// Three vertices of the patch for each triangle.
    indices: Vec<u32>,
    /// By their positions.
    triangles: Vec<[u32; 3]>,
    set: TriangleSet,
}

impl<'a> Patch<'a> {
    /// The patch of these triangles, which are simplified. What that changes is measured against
    /// others.
    pub fn new(source: &'a Source<'a>, triangles: &[u32], measured: &[u32]) -> Self {
        let mut vertices = [triangles, measured].concat();
        vertices.sort_unstable();
        vertices.dedup();
        let local = |vertex: &u32| vertices.partition_point(|known| known < vertex) as u32;
        let indices: Vec<u32> = measured.iter().map(local).collect();
        let current: Vec<u32> = triangles.iter().map(local).collect();
        let mut first_at = HashMap::new();
        let weld = |(local, vertex): (u32, &u32)| {
            *first_at.entry(source.welded[*vertex as usize]).or_insert(local)
        };
        let welded = (0..).zip(&vertices).map(weld).collect();
        let looks = VertexList::new(source, &vertices, (&indices, &current));
        let places = Vec::clone(&welded);
        let reference = OnceCell::new();
        Self { source, vertices, indices, current, welded, places, looks, reference }
    }

    /// The patch whose vertices have moved to these positions, those of other vertices, before.
    pub fn with_places(self, places: &HashMap<u32, u32>) -> Self {
        let place = |vertex: &u32| {
            let at = places.get(vertex).unwrap_or(vertex);
            self.vertices.binary_search(at).map_or(u32::MAX, |local| self.welded[local])
        };
        let places = self.vertices.iter().map(place).collect();
        Self { places, ..self }
    }

    /// Returns the patch with about half of its triangles, or `None` if too few can be spared for
    /// an error within `limit`. `is_locked` says of a vertex whether it must stay, and `prior` is
    /// the error that the patch's triangles have already.
    pub fn simplify(
        &self,
        is_locked: impl Fn(u32) -> bool,
        (prior, limit): (f64, f64),
    ) -> Option<Simplified> {
        let after = self.fewer(&self.current, is_locked, (self.wanted(), None))?;
        self.measured(&after, (prior, limit))
    }

    /// The number of triangles that its coarser level is to have.
    fn wanted(&self) -> usize {
        let triangles = self.current.len() / 3;
        let ratio = if triangles <= FEW { RATIO_OF_FEW } else { RATIO };
        (triangles as f64 * ratio) as usize
    }

    /// Returns at least `count` of these triangles of the patch, those whose loss changes least, if
    /// that is worth it: with all seams of textures, or else without. The simplifier goes no
    /// further than `error_max`, in units of the primitive's space, if there is one.
    fn fewer(
        &self,
        triangles: &[u32],
        is_locked: impl Fn(u32) -> bool,
        (count, error_max): (usize, Option<f64>),
    ) -> Option<Vec<u32>> {
        let neighbors = self.neighbors(triangles);
        let flags = |keeps_seams: bool| -> Vec<SimplifyVertex> {
            let vertices = self.vertices.iter().zip(&neighbors);
            vertices.map(|(vertex, of)| of.flags(is_locked(*vertex), keeps_seams)).collect()
        };
        let tries = [(true, SimplifyOptions::None), (false, SimplifyOptions::Prune)];
        tries.into_iter().find_map(|(keeps_seams, prune)| {
            let flags = flags(keeps_seams);
            let options = SimplifyOptions::Permissive | prune;
            let after = self.simplified(triangles, &flags, options, (count, error_max));
            (self.is_worth(after.len()) && self.fits(&after, &flags)).then_some(after)
        })
    }

    /// Returns fewer triangles of the patch with what they change, if the error is within `limit`.
    pub fn measured(&self, after: &[u32], (prior, limit): (f64, f64)) -> Option<Simplified> {
        let (error, normal_angle) = self.change(after, prior, limit)?;
        let indices = after.iter().map(|index| self.vertices[*index as usize]).collect();
        let added = Vec::new();
        error.is_finite().then_some(Simplified { indices, added, error, normal_angle })
    }

    /// Returns the triangles that it was made of.
    pub fn current(&self) -> &[u32] {
        &self.current
    }

    /// Returns whether so many indices are worth a coarser level.
    fn is_worth(&self, left: usize) -> bool {
        left > 0 && left as f64 <= self.current.len() as f64 * RATIO_MAX
    }

    /// Returns whether triangles go on to meet other patches, and each is of one surface, without
    /// a texture that is mirrored within it, unless there are such triangles already.
    fn fits(&self, after: &[u32], flags: &[SimplifyVertex]) -> bool {
        let mut is_kept = vec![false; self.vertices.len()];
        for index in after {
            is_kept[self.welded[*index as usize] as usize] = true;
        }
        let is_met = (0..).zip(flags).all(|(index, flags): (usize, _)| {
            !flags.contains(SimplifyVertex::Lock) || is_kept[self.welded[index] as usize]
        });
        let is_of_one = |corners: &[u32; 3]| {
            let [a, b, c] = corners.map(|index| self.surface_of(index));
            a == b && b == c
        };
        is_met
            && after.as_chunks::<3>().0.iter().all(is_of_one)
            && (!self.has_mixed(after) || self.has_mixed(&self.current))
    }

    fn surface_of(&self, index: u32) -> u32 {
        self.source.surface_of(self.vertices[index as usize])
    }

    fn simplified(
        &self,
        triangles: &[u32],
        flags: &[SimplifyVertex],
        options: SimplifyOptions,
        (count, error_max): (usize, Option<f64>),
    ) -> Vec<u32> {
        let scaled: Vec<[f32; 3]> =
            self.vertices.iter().map(|vertex| self.source.scaled[*vertex as usize]).collect();
        let Some(positions) = adapter(&scaled) else { return Vec::new() };
        let (attributes, weights) = self.attributes();
        // The simplifier's unit is the longest side of the patch.
        let error_max = error_max.map_or(f32::MAX, |error| (error / self.side()) as f32);
        meshopt::simplify_with_attributes_and_locks(
            triangles,
            &positions,
            &attributes,
            &weights,
            size_of_val(weights.as_slice()),
            flags,
            count.max(1) * 3,
            error_max,
            options,
            None,
        )
    }

    /// Gives what the simplifier keeps beside positions, and the weight of each number of a vertex.
    /// Weights are shares of the patch's longest side. Texture coordinates count from those of a
    /// vertex of the same surface: the simplifier squares them in f32, which leaves little of small
    /// differences far from 0.
    fn attributes(&self) -> (Vec<f32>, Vec<f32>) {
        let side = self.side();
        let VertexLayout { uv0, uv1, color: has_color, .. } = self.source.attributes();
        let sets = [uv0, uv1];
        let mut weights = vec![NORMAL_WEIGHT; 3];
        weights.extend(sets.iter().filter(|is| **is).flat_map(|_| [1.0; 2]));
        weights.extend(has_color.then_some([COLOR_WEIGHT; 4]).into_iter().flatten());
        let mut attributes = Vec::with_capacity(self.vertices.len() * weights.len());
        let mut firsts = BTreeMap::new();
        for (&vertex, point) in self.vertices.iter().zip(self.looks.points()) {
            attributes.extend(self.source.normal(vertex).as_vec3().to_array());
            let first = *firsts.entry(self.source.surface_of(vertex)).or_insert(point.looks);
            let looks = point.looks.iter().zip(first).zip(sets);
            for ((uv, first), _) in looks.filter(|(_, is)| *is) {
                let uv = ((*uv - first) / side).as_vec2();
                attributes.extend(if uv.is_finite() { uv.to_array() } else { [0.0; 2] });
            }
            let color = has_color.then(|| self.source.color(vertex)).into_iter().flatten();
            attributes.extend(color.map(|number| number as f32));
        }
        (attributes, weights)
    }

    /// The longest side of the box around it.
    fn side(&self) -> f64 {
        self.size().max_element()
    }

    /// The sides of the box around it.
    fn size(&self) -> DVec3 {
        let bounds = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let positions = self.looks.points().iter().map(|point| point.position);
        let (low, high) = positions.fold(bounds, |(low, high), at| (low.min(at), high.max(at)));
        high - low
    }

    /// Measures what fewer triangles change, see [`Simplified`]; `None` as soon as that is known to
    /// be beyond the limit.
    fn change(&self, after: &[u32], prior: f64, limit: f64) -> Option<(f64, f64)> {
        let size = self.size().length();
        let negligible = (NEGLIGIBLE * size).max(NEGLIGIBLE_BESIDE * prior);
        let points: Vec<DVec3> = self.looks.points().iter().map(|point| point.position).collect();
        let all = TriangleSet::new(&points, &self.weld(after));
        let mut after_of = by_surface(after, |index| self.surface_of(index));
        let (mut deviation, mut looks) = (Deviation::default(), Change::default());
        let reference = self.reference.get_or_init(|| self.reference(&points));
        let divided = reference.surfaces.iter().map(|(at, before)| {
            let after = after_of.remove(at).unwrap_or_default();
            (before, self.divide(&reference.parts, &before.indices, &after), after)
        });
        let divided: Vec<(&ReferenceSurface, Parts, Vec<u32>)> = divided.collect();
        let lost = width_of_removed(&points, divided.iter().map(|(_, parts, _)| parts));
        if lost > limit {
            return None;
        }
        for (before, Parts { kept, removed }, after) in divided {
            let old = self.weld(&kept);
            let new = self.weld(&after);
            let gone = self.weld(&removed.concat());
            let near = nearest_of_corners(&points, &gone, &[], &all);
            deviation::measure(&mut deviation, &points, &gone, &near, &all, negligible);
            if deviation.lower > limit {
                return None;
            }
            if new.is_empty() {
                continue;
            }
            let new_set = TriangleSet::new(&points, &new);
            let (gone, added) = (without(&old, &new), without(&new, &old));
            // Of vertices too that only their texture coordinates or normals tell from kept ones.
            let to_new = nearest_of_corners(&points, &old, &new, &new_set);
            let to_old = nearest_of_corners(&points, &added, &before.triangles, &before.set);
            if farthest(&gone, &to_new).max(farthest(&added, &to_old)) > limit {
                return None;
            }
            deviation::measure(&mut deviation, &points, &gone, &to_new, &new_set, negligible);
            deviation::measure(&mut deviation, &points, &added, &to_old, &before.set, negligible);
            let nearest = |index: u32| to_new[&self.welded[index as usize]];
            let lists = (&kept[..], &after[..]);
            self.looks.change(lists, &reference.charts, &new_set, nearest, &mut looks);
            let before = (&before.indices[..], &before.set);
            self.looks.change_of_added(before, &after, &reference.charts, &mut looks);
        }
        let reach = points.iter().map(|point| point.abs().max_element()).fold(0.0, f64::max);
        // Positions are no more exact than this themselves, so a smaller error has no meaning.
        let least = (reach * f64::from(f32::EPSILON)).max(f64::from(f32::MIN_POSITIVE));
        let slide = looks.slide(&reference.charts);
        let error = (deviation.upper + reach * ROUNDING).max(slide).max(lost).max(least);
        (error <= limit).then_some((error, looks.normal_angle))
    }

    /// What changes are measured against; `points` are its vertices' places.
    fn reference(&self, points: &[DVec3]) -> Reference {
        let of_surface = |indices: Vec<u32>| {
            let triangles = self.weld(&indices);
            let set = TriangleSet::new(points, &triangles);
            ReferenceSurface { indices, triangles, set }
        };
        let surfaces = by_surface(&self.indices, |index| self.surface_of(index));
        let origin_of = |index: u32| {
            let origin = self.source.origin(self.vertices[index as usize]);
            self.vertices.binary_search(&origin).map_or(index, |at| at as u32)
        };
        Reference {
            surfaces: surfaces.into_iter().map(|(at, own)| (at, of_surface(own))).collect(),
            charts: chart::Charts::new(
                self.looks.points(),
                |index| self.surface_of(index),
                &self.indices,
                origin_of,
            ),
            parts: self.connected(&self.indices),
        }
    }

    /// Returns for each vertex the one that stands for its connected part: triangles of a surface
    /// are connected where they share a position.
    fn connected(&self, triangles: &[u32]) -> Vec<u32> {
        let mut first_at = HashMap::new();
        let mut name = |at: u32| {
            let key = (self.surface_of(at), self.welded[at as usize]);
            *first_at.entry(key).or_insert(at)
        };
        let mut parents: Vec<u32> = (0..self.vertices.len() as u32).map(&mut name).collect();
        for corners in triangles.as_chunks::<3>().0 {
            chart::join(&mut parents, *corners);
        }
        (0..self.vertices.len() as u32).map(|at| chart::root(&mut parents, at)).collect()
    }

    /// The triangles of a list by their positions.
    fn weld(&self, indices: &[u32]) -> Vec<[u32; 3]> {
        let triangles = indices.as_chunks::<3>().0.iter();
        triangles.map(|corners| corners.map(|index| self.welded[index as usize])).collect()
    }

    /// Divides the triangles of a surface into those of connected parts of which something is
    /// kept, and the parts of which nothing is. A patch of one surface has no such parts: what is
    /// removed there is as far from what is kept as it is. `part_of` is the part of each vertex.
    fn divide(&self, part_of: &[u32], before: &[u32], after: &[u32]) -> Parts {
        if self.source.surfaces().len() == 1 {
            return Parts { kept: before.to_vec(), removed: Vec::new() };
        }
        let after_at: HashSet<u32> = self.weld(after).into_iter().flatten().collect();
        let is_there = |at: &&u32| after_at.contains(&self.places[**at as usize]);
        let kept: HashSet<u32> =
            before.iter().filter(is_there).map(|at| part_of[*at as usize]).collect();
        let mut parts = Parts::default();
        let mut removed: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for corners in before.as_chunks::<3>().0 {
            let part = part_of[corners[0] as usize];
            let list = if kept.contains(&part) {
                &mut parts.kept
            } else {
                removed.entry(part).or_default()
            };
            list.extend(corners);
        }
        if parts.kept.is_empty() && !after.is_empty() {
            // All that is there now must be near to something that was.
            return Parts { kept: before.to_vec(), removed: Vec::new() };
        }
        parts.removed = removed.into_values().collect();
        parts
    }
}

/// The triangles of a surface by what becomes of its connected parts.
#[derive(Debug, Default)]
struct Parts {
    kept: Vec<u32>,
    removed: Vec<Vec<u32>>,
}

/// The largest width of removed parts, those side by side taken together.
fn width_of_removed<'p>(points: &[DVec3], parts: impl Iterator<Item = &'p Parts>) -> f64 {
    let place = |at: &u32| points[*at as usize];
    let of_part = |part: &Vec<u32>| PartPoints::new(part.iter().map(place).collect());
    let removed: Vec<PartPoints> = parts.flat_map(|of| &of.removed).map(of_part).collect();
    let groups = part_group::groups(&removed.iter().collect::<Vec<_>>());
    groups.iter().map(|group| group.width).fold(0.0, f64::max)
}

/// Divides a list of triangles by the surfaces of their vertices.
pub(super) fn by_surface(
    indices: &[u32],
    surface_of: impl Fn(u32) -> u32,
) -> BTreeMap<u32, Vec<u32>> {
    let mut lists: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for corners in indices.as_chunks::<3>().0 {
        lists.entry(surface_of(corners[0])).or_default().extend(corners);
    }
    lists
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

/// The largest distance of a corner of triangles.
fn farthest(triangles: &[[u32; 3]], nearest: &HashMap<u32, Nearest>) -> f64 {
    triangles.iter().flatten().map(|point| nearest[point].distance).fold(0.0, f64::max)
}

/// Gives for each point that `triangles` or `surface` name which triangle of `to` is nearest to it.
/// `surface` has the corners of the triangles of `to`, and 0 is the distance of these.
fn nearest_of_corners(
    points: &[DVec3],
    triangles: &[[u32; 3]],
    surface: &[[u32; 3]],
    to: &TriangleSet,
) -> HashMap<u32, Nearest> {
    let mut nearest = HashMap::new();
    for (triangle, corners) in (0..).zip(surface) {
        for corner in corners {
            nearest.insert(*corner, Nearest { triangle, distance: 0.0 });
        }
    }
    // Neighbours in the list are neighbours in space.
    let mut guess = 0;
    for &corner in triangles.iter().flatten() {
        let near =
            nearest.entry(corner).or_insert_with(|| to.nearest(points[corner as usize], guess));
        guess = near.triangle;
    }
    nearest
}
