//! A part of a surface that is simplified at once, and what that changes.

mod small_parts;

use std::cell::OnceCell;
use std::collections::{BTreeMap, HashMap, HashSet};

use glam::DVec3;
use meshopt::{SimplifyOptions, SimplifyVertex};

use super::appearance::{Change, VertexList};
use super::chart::{self, root};
use super::clustering::MovedVertex;
use super::deviation::{self, Deviation};
use super::source::{Source, adapter};
use super::triangle_set::{Nearest, TriangleSet};
use super::width;

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
    finest: OnceCell<BTreeMap<u32, FinestSurface>>,
}

/// A surface before it is simplified.
#[derive(Debug)]
struct FinestSurface {
    /// Three vertices of the patch for each triangle.
    indices: Vec<u32>,
    /// By their positions.
    triangles: Vec<[u32; 3]>,
    set: TriangleSet,
    /// The width of each vertex's chart, see [`chart::widths`].
    charts: Vec<f64>,
}

/// Triangles that meet at a position.
#[derive(Clone, Copy, Debug, Default)]
struct Neighbors {
    /// A vertex of one of them.
    first: Option<u32>,
    /// They are of several surfaces.
    is_border: bool,
    /// They have several texture coordinates.
    is_seam: bool,
}

impl Neighbors {
    /// Returns the flags of a vertex for the simplifier. Seams of textures may be given up if
    /// nothing can be spared otherwise, borders of surfaces never.
    fn flags(self, is_locked: bool, keeps_seams: bool) -> SimplifyVertex {
        let Self { is_border, is_seam, .. } = self;
        let is_protected = is_border || (keeps_seams && is_seam);
        let protect = if is_protected { SimplifyVertex::Protect } else { SimplifyVertex::None };
        if is_locked { protect | SimplifyVertex::Lock } else { protect }
    }
}

/// A patch with fewer triangles.
#[derive(Debug)]
pub(super) struct Simplified {
    /// Three for each triangle, as the piece numbers vertices, and behind them those of `added`.
    pub indices: Vec<u32>,
    /// Vertices that the piece has not.
    pub added: Vec<MovedVertex>,
    /// An upper bound of the distance between each surface before and after, in both directions.
    /// Connected parts of a surface that are removed as a whole, as windows in a wall, count by
    /// their distance to what is left of all surfaces, and by their width, which is how far their
    /// outline moves. Or how far a texture slides, if that is more. Above 0, in units of the
    /// primitive's space.
    pub error: f64,
    /// The largest angle by which the normal at a removed vertex differs, in radians.
    pub normal_angle: f64,
}

impl Simplified {
    /// Numbers its vertices as these are: those of a list, and from `first_added` on those that it
    /// adds.
    pub fn give_numbers(&mut self, vertices: &[u32], first_added: u32) {
        let number = |at: u32| {
            let beyond = first_added + at.saturating_sub(vertices.len() as u32);
            vertices.get(at as usize).copied().unwrap_or(beyond)
        };
        self.indices.iter_mut().for_each(|index| *index = number(*index));
        for vertex in &mut self.added {
            (vertex.from, vertex.at) = (number(vertex.from), number(vertex.at));
        }
    }
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
        let current = triangles.iter().map(local).collect();
        let mut first_at = HashMap::new();
        let weld = |(local, vertex): (u32, &u32)| {
            *first_at.entry(source.welded[*vertex as usize]).or_insert(local)
        };
        let welded = (0..).zip(&vertices).map(weld).collect();
        let looks = VertexList::new(source, &vertices, &indices);
        let places = Vec::clone(&welded);
        let finest = OnceCell::new();
        Self { source, vertices, indices, current, welded, places, looks, finest }
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

    /// What meets at each vertex in these triangles.
    fn neighbors(&self, triangles: &[u32]) -> Vec<Neighbors> {
        let mut all = vec![Neighbors::default(); self.vertices.len()];
        for &index in triangles {
            let vertex = self.vertices[index as usize];
            let of = &mut all[self.welded[index as usize] as usize];
            let first = *of.first.get_or_insert(vertex);
            of.is_border |= self.source.surface_of(vertex) != self.source.surface_of(first);
            of.is_seam |= of.is_border || self.source.uvs(vertex) != self.source.uvs(first);
        }
        self.welded.iter().map(|at| all[*at as usize]).collect()
    }

    /// Returns the patch with about half of its triangles, or `None` if too few can be spared for
    /// an error within `limit`. `is_locked` says of a vertex whether it must stay, and `prior` is
    /// the error that the patch's triangles have already.
    pub fn simplify(
        &self,
        is_locked: impl Fn(u32) -> bool,
        (prior, limit): (f64, f64),
    ) -> Option<Simplified> {
        let is_worth = |after: &[u32]| self.is_worth(after);
        let after = self.fewer(&self.current, is_locked, (self.wanted(), None), is_worth)?;
        self.measured(&after, (prior, limit))
    }

    /// The number of triangles that its coarser level is to have.
    fn wanted(&self) -> usize {
        let triangles = self.current.len() / 3;
        let ratio = if triangles <= FEW { RATIO_OF_FEW } else { RATIO };
        (triangles as f64 * ratio) as usize
    }

    /// Returns at least this number of the triangles `whole` of the patch, from what changes least
    /// to what spares most: the first that are as wanted. The simplifier goes no further than
    /// `error_max`, in units of the primitive's space, if there is one.
    fn fewer(
        &self,
        whole: &[u32],
        is_locked: impl Fn(u32) -> bool,
        (triangles, error_max): (usize, Option<f64>),
        is_wanted: impl Fn(&[u32]) -> bool,
    ) -> Option<Vec<u32>> {
        let neighbors = self.neighbors(whole);
        let flags = |keeps_seams: bool| -> Vec<SimplifyVertex> {
            let vertices = self.vertices.iter().zip(&neighbors);
            vertices.map(|(vertex, of)| of.flags(is_locked(*vertex), keeps_seams)).collect()
        };
        let tries = [(true, SimplifyOptions::None), (false, SimplifyOptions::Prune)];
        tries.into_iter().find_map(|(keeps_seams, prune)| {
            let flags = flags(keeps_seams);
            let options = SimplifyOptions::Permissive | prune;
            let after = self.simplified(whole, &flags, options, (triangles, error_max));
            (is_wanted(&after) && self.fits(&after, &flags)).then_some(after)
        })
    }

    /// Returns fewer triangles of the patch with what they change, if the error is
    /// within `limit`.
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

    fn is_worth(&self, after: &[u32]) -> bool {
        !after.is_empty() && after.len() as f64 <= self.current.len() as f64 * RATIO_MAX
    }

    /// Returns whether triangles go on to meet other patches, and each is of one surface.
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
        is_met && after.as_chunks::<3>().0.iter().all(is_of_one)
    }

    fn surface_of(&self, index: u32) -> u32 {
        self.source.surface_of(self.vertices[index as usize])
    }

    fn simplified(
        &self,
        whole: &[u32],
        flags: &[SimplifyVertex],
        options: SimplifyOptions,
        (triangles, error_max): (usize, Option<f64>),
    ) -> Vec<u32> {
        let scaled: Vec<[f32; 3]> =
            self.vertices.iter().map(|vertex| self.source.scaled[*vertex as usize]).collect();
        let Some(positions) = adapter(&scaled) else { return Vec::new() };
        let (attributes, weights) = self.attributes();
        // The simplifier's unit is the longest side of the patch.
        let error_max = error_max.map_or(f32::MAX, |error| (error / self.side()) as f32);
        meshopt::simplify_with_attributes_and_locks(
            whole,
            &positions,
            &attributes,
            &weights,
            size_of_val(weights.as_slice()),
            flags,
            triangles.max(1) * 3,
            error_max,
            options,
            None,
        )
    }

    /// Gives what the simplifier keeps beside positions, and the weight of each number of a vertex.
    /// Weights are shares of the patch's longest side.
    fn attributes(&self) -> (Vec<f32>, Vec<f32>) {
        let side = self.side();
        let layouts = || self.source.surfaces().iter().map(|surface| surface.layout);
        let sets = [layouts().any(|of| of.uv0), layouts().any(|of| of.uv1)];
        let has_color = layouts().any(|of| of.color);
        let mut weights = vec![NORMAL_WEIGHT; 3];
        weights.extend(sets.iter().filter(|is| **is).flat_map(|_| [1.0; 2]));
        weights.extend(has_color.then_some([COLOR_WEIGHT; 4]).into_iter().flatten());
        let mut attributes = Vec::with_capacity(self.vertices.len() * weights.len());
        for (&vertex, point) in self.vertices.iter().zip(self.looks.points()) {
            attributes.extend(self.source.normal(vertex).as_vec3().to_array());
            for (uv, _) in point.looks.iter().zip(sets).filter(|(_, is)| *is) {
                let uv = (*uv / side).as_vec2();
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
        let (mut deviation, mut lost) = (Deviation::default(), 0.0_f64);
        let mut looks = Change::default();
        for (surface, finest) in self.finest.get_or_init(|| self.finest(&points)) {
            let after = after_of.remove(surface).unwrap_or_default();
            let Parts { kept, removed } = self.divide(&finest.indices, &after);
            let old = self.weld(&kept);
            let new = self.weld(&after);
            for part in &removed {
                let part = self.weld(part);
                let near = nearest_of_corners(&points, &part, &[], &all);
                deviation::measure(&mut deviation, &points, &part, &near, &all, negligible);
                lost = lost
                    .max(width::of_points(part.iter().flatten().map(|at| points[*at as usize])));
            }
            if deviation.lower.max(lost) > limit {
                return None;
            }
            if new.is_empty() {
                continue;
            }
            let new_set = TriangleSet::new(&points, &new);
            let (gone, added) = (without(&old, &new), without(&new, &old));
            // Of vertices too that only their texture coordinates or normals tell from kept ones.
            let to_new = nearest_of_corners(&points, &old, &new, &new_set);
            let to_old = nearest_of_corners(&points, &added, &finest.triangles, &finest.set);
            if farthest(&gone, &to_new).max(farthest(&added, &to_old)) > limit {
                return None;
            }
            deviation::measure(&mut deviation, &points, &gone, &to_new, &new_set, negligible);
            deviation::measure(&mut deviation, &points, &added, &to_old, &finest.set, negligible);
            let nearest = |index: u32| to_new[self.welded[index as usize] as usize];
            let lists = (&kept[..], &after[..]);
            let change = self.looks.change(lists, &finest.charts, &new_set, nearest);
            looks.slide = looks.slide.max(change.slide);
            looks.normal_angle = looks.normal_angle.max(change.normal_angle);
        }
        let reach = points.iter().map(|point| point.abs().max_element()).fold(0.0, f64::max);
        // Positions are no more exact than this themselves, so a smaller error has no meaning.
        let least = (reach * f64::from(f32::EPSILON)).max(f64::from(f32::MIN_POSITIVE));
        let error = (deviation.upper + reach * ROUNDING).max(looks.slide).max(lost).max(least);
        (error <= limit).then_some((error, looks.normal_angle))
    }

    /// What changes are measured against, by surface.
    fn finest(&self, points: &[DVec3]) -> BTreeMap<u32, FinestSurface> {
        let surfaces = by_surface(&self.indices, |index| self.surface_of(index));
        let of_surface = |indices: Vec<u32>| {
            let triangles = self.weld(&indices);
            let set = TriangleSet::new(points, &triangles);
            let charts = chart::widths(self.looks.points(), &indices);
            FinestSurface { indices, triangles, set, charts }
        };
        surfaces.into_iter().map(|(surface, indices)| (surface, of_surface(indices))).collect()
    }

    /// The triangles of a list by their positions.
    fn weld(&self, indices: &[u32]) -> Vec<[u32; 3]> {
        let triangles = indices.as_chunks::<3>().0.iter();
        triangles.map(|corners| corners.map(|index| self.welded[index as usize])).collect()
    }

    /// Divides the triangles of a surface into those of connected parts of which something is
    /// kept, and the parts of which nothing is. A patch of one surface has no such parts: what is
    /// removed there is as far from what is kept as it is.
    fn divide(&self, before: &[u32], after: &[u32]) -> Parts {
        if self.source.surfaces().len() == 1 {
            return Parts { kept: before.to_vec(), removed: Vec::new() };
        }
        let mut part_of: Vec<u32> = (0..self.vertices.len() as u32).collect();
        for corners in self.weld(before) {
            let [a, b, c] = corners.map(|corner| root(&mut part_of, corner));
            let least = a.min(b).min(c);
            for part in [a, b, c] {
                part_of[part as usize] = least;
            }
        }
        let mut kept = HashSet::new();
        let mut parts = Parts::default();
        let mut removed: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        let after_at: HashSet<u32> = self.weld(after).into_iter().flatten().collect();
        for &index in before {
            if after_at.contains(&self.places[index as usize]) {
                kept.insert(root(&mut part_of, self.welded[index as usize]));
            }
        }
        for corners in before.as_chunks::<3>().0 {
            let part = root(&mut part_of, self.welded[corners[0] as usize]);
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
fn farthest(triangles: &[[u32; 3]], nearest: &[Nearest]) -> f64 {
    let corners = triangles.iter().flatten();
    corners.map(|point| nearest[*point as usize].distance).fold(0.0, f64::max)
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
