//! Clusters of vertices: corners of triangles move to few places, whatever connects them.
//!
//! Surfaces of many small parts that do not share vertices, as walls with windows, gates and trims,
//! hardly lose triangles along their edges. So vertices move together where [`contract`] says;
//! triangles that lose their area vanish, and with them the gaps between the parts.
//!
//! Texture coordinates go on linearly to where a corner moves, so that textures stay where they
//! are on each triangle's plane. This takes vertices that the source has not.

use std::collections::BTreeMap;

use foldhash::{HashMap, HashMapExt, HashSet};
use glam::{DVec2, DVec3};

use super::appearance::{UvLengths, color_length};
use super::chart;
use super::contraction::{Goal, contract};
use super::patch::Patch;
use super::simplified::Simplified;
use super::source::Source;

/// Fewer parts than this are not many.
const PARTS_MIN: usize = 3;

/// Triangles that a small part has on average at most: some boxes, of which each is 12.
const PART_TRIANGLES: usize = 32;

/// The number of triangles of a coarser level as a share of the finer one's.
const RATIO: f64 = 0.6;

/// A coarser level that has more triangles than this, as a share, is not worth its memory.
const RATIO_MAX: f64 = 0.8;

/// Vertices are paired within this share of the diagonal of all, or within the error that there is
/// already.
const REACH_MIN: f64 = 1.0 / 32.0;

/// Corners of one place share a vertex if their texture coordinates are no farther apart on the
/// surface than this share of the way within which vertices are paired.
const SLIDE_MAX: f64 = 0.1;

/// Corners of one place share a vertex if the cosine between their normals is at least this, and
/// their tangents are alike.
const COSINE_MIN: f64 = 0.9;

/// Corners of one place share a vertex if no component of their colours differs by more.
const COLOR_STEP: f64 = 0.05;

/// The square of the sine between two edges below which a triangle has no slope of its texture.
const SLIVER: f64 = 1e-6;

/// Triangles whose corners have moved.
#[derive(Debug, Default)]
pub(super) struct Clustered {
    /// Three for each triangle: vertices of the source, and behind the last those of `added`.
    pub triangles: Vec<u32>,
    /// Vertices that the source has not.
    pub added: Vec<MovedVertex>,
    /// The vertex at the place to which each vertex of the triangles has moved.
    pub places: HashMap<u32, u32>,
    /// The places of corners that have not moved.
    pub stays: HashSet<u32>,
}

/// A vertex in the place of another one.
#[derive(Clone, Copy, Debug)]
pub(super) struct MovedVertex {
    /// The vertex whose normal, tangent and colour it has.
    pub from: u32,
    /// The vertex in whose place it stands.
    pub at: u32,
    pub uvs: [DVec2; 2],
    /// The vertex of whose chart it is: the one that has moved, or `from` if that has another
    /// colour.
    pub origin: u32,
}

/// Returns the triangles of a surface of many parts with about half of their number, or `None` if
/// too few can be spared for an error within `limit`. `measured` is what the error is measured
/// against; `is_locked` says of a vertex whether it must stay, and `prior` is the error that the
/// triangles have already.
pub(super) fn simplify(
    source: &Source<'_>,
    (triangles, measured): (&[u32], &[u32]),
    is_locked: impl Fn(u32) -> bool,
    (prior, limit): (f64, f64),
) -> Option<Simplified> {
    let target = (triangles.len() as f64 / 3.0 * RATIO) as usize;
    let reach = prior.max(diagonal(source, triangles) * REACH_MIN);
    let goal = Goal { target, reach, way_max: f64::INFINITY };
    let contracted = Contracted::new(source, (triangles, measured), is_locked, goal)?;
    let is_worth = contracted.count() as f64 <= triangles.len() as f64 / 3.0 * RATIO_MAX;
    if is_worth { contracted.measured((prior, limit)) } else { None }
}

/// Triangles whose vertices have moved together.
pub(super) struct Contracted<'a> {
    source: &'a Source<'a>,
    /// The vertices of the source that the triangles and those that they replace use.
    vertices: Vec<u32>,
    /// The source of these alone.
    part: Source<'a>,
    clustered: Clustered,
    /// What the error is measured against: three vertices of `part` for each triangle.
    measured: Vec<u32>,
}

impl<'a> Contracted<'a> {
    /// Contracts triangles, see [`simplify`]; `None` if nothing is left, or they are drawn in
    /// order.
    pub fn new(
        source: &'a Source<'a>,
        (triangles, measured): (&[u32], &[u32]),
        is_locked: impl Fn(u32) -> bool,
        goal: Goal,
    ) -> Option<Self> {
        if source.keeps_order() {
            return None;
        }
        let mut vertices = [triangles, measured].concat();
        vertices.sort_unstable();
        vertices.dedup();
        let own = |list: &[u32]| -> Vec<u32> {
            list.iter().map(|at| vertices.partition_point(|known| known < at) as u32).collect()
        };
        let (triangles, measured) = (own(triangles), own(measured));
        let part = source.part(&vertices);
        let is_locked =
            |at: u32| vertices.get(at as usize).is_some_and(|vertex| is_locked(*vertex));
        let places = contract(&part, &triangles, is_locked, goal);
        let clustered = cluster(&part, &triangles, &places, goal.reach);
        let is_met = keeps_locked(&part, &triangles, &clustered.stays, is_locked);
        let is_any = is_met && !clustered.triangles.is_empty();
        is_any.then_some(Self { source, vertices, part, clustered, measured })
    }

    /// The number of triangles that are left.
    pub fn count(&self) -> usize {
        self.clustered.triangles.len() / 3
    }

    /// Returns the triangles that are left with what they change, see [`Patch::measured`].
    pub fn measured(self, (prior, limit): (f64, f64)) -> Option<Simplified> {
        let Self { source, vertices, part: mut moved, clustered, measured } = self;
        for vertex in &clustered.added {
            moved.add(vertex);
        }
        let patch =
            Patch::new(&moved, &clustered.triangles, &measured).with_places(&clustered.places);
        let mut simplified = patch.measured(patch.current(), (prior, limit))?;
        simplified.added = clustered.added;
        simplified.give_numbers(&vertices, source.vertex_count() as u32);
        Some(simplified)
    }
}

/// Returns the diagonal of the box around triangles.
fn diagonal(source: &Source<'_>, triangles: &[u32]) -> f64 {
    let corners = triangles.iter().map(|vertex| source.position(*vertex));
    let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (low, high) = corners.fold(empty, |(low, high), at| (low.min(at), high.max(at)));
    low.distance(high)
}

/// Returns whether triangles had corners at all of their locked positions that stay there, so that
/// they go on to meet the same neighbours. Corners that move there do not count, which errs on the
/// side of no replacement.
fn keeps_locked(
    source: &Source<'_>,
    triangles: &[u32],
    stays: &HashSet<u32>,
    is_locked: impl Fn(u32) -> bool,
) -> bool {
    let mut locked = triangles.iter().filter(|vertex| is_locked(**vertex));
    locked.all(|vertex| stays.contains(&source.welded[*vertex as usize]))
}

/// Returns whether a surface is of many small parts that share no position, so that simplifying it
/// along its edges cannot get far.
pub(super) fn is_scattered(source: &Source<'_>, triangles: &[u32]) -> bool {
    let mut names: Vec<u32> = triangles.iter().map(|at| source.welded[*at as usize]).collect();
    let corners = names.clone();
    names.sort_unstable();
    names.dedup();
    let mut parents: Vec<u32> = (0..names.len() as u32).collect();
    let number = |name: u32| names.partition_point(|known| *known < name) as u32;
    for corners in corners.as_chunks::<3>().0 {
        chart::join(&mut parents, corners.map(number));
    }
    let parts = (0..).zip(&parents).filter(|(at, parent): &(u32, _)| at == *parent).count();
    parts >= PARTS_MIN && triangles.len() / 3 <= parts * PART_TRIANGLES
}

/// Moves vertices from place to place. Corners share a vertex if that slides textures by less than
/// a share of `reach`.
fn cluster(
    source: &Source<'_>,
    triangles: &[u32],
    places: &BTreeMap<u32, u32>,
    reach: f64,
) -> Clustered {
    let mut corners = Corners::new(source, triangles, reach);
    let kept = kept(source, triangles, places);
    let mut clustered = Clustered::default();
    for triangle in &kept {
        let moved = triangle.map(|vertex| {
            let place = places[&source.welded[vertex as usize]];
            if source.welded[vertex as usize] == place {
                clustered.stays.insert(place);
            }
            corners.vertex(triangle, vertex, place, &mut clustered.added)
        });
        clustered.triangles.extend(moved);
    }
    clustered.places =
        triangles.iter().map(|at| (*at, places[&source.welded[*at as usize]])).collect();
    clustered
}

/// Returns the triangles that have an area in their new places, each once: of those that come to
/// lie on each other and face the same side, the one that was largest.
fn kept(source: &Source<'_>, triangles: &[u32], places: &BTreeMap<u32, u32>) -> Vec<[u32; 3]> {
    let mut kept: Vec<([u32; 3], f64)> = Vec::new();
    let mut known: HashMap<[u32; 3], usize> = HashMap::new();
    for corners in triangles.as_chunks::<3>().0 {
        let [a, b, c] = corners.map(|vertex| places[&source.welded[vertex as usize]]);
        if a == b || b == c || c == a {
            continue;
        }
        let least = a.min(b).min(c);
        // From its least corner on, so that only the side it faces decides the order.
        let key = if least == a {
            [a, b, c]
        } else if least == b {
            [b, c, a]
        } else {
            [c, a, b]
        };
        let area = area_normal(source, corners).length();
        match known.get(&key) {
            Some(&at) if kept[at].1 < area => kept[at] = (*corners, area),
            Some(_) => {}
            None => {
                known.insert(key, kept.len());
                kept.push((*corners, area));
            }
        }
    }
    kept.into_iter().map(|(corners, _)| corners).collect()
}

/// The normal of a triangle times twice its area.
fn area_normal(source: &Source<'_>, corners: &[u32; 3]) -> DVec3 {
    let [a, b, c] = corners.map(|vertex| source.position(vertex));
    (b - a).cross(c - a)
}

/// The vertices of corners that have moved.
struct Corners<'a> {
    source: &'a Source<'a>,
    reach: f64,
    /// The lengths of texture units on each surface.
    lengths: BTreeMap<u32, [UvLengths; 2]>,
    /// The lengths of colours on each surface.
    color_lengths: BTreeMap<u32, f64>,
    charts: chart::UvBoxes,
    /// The vertices of the triangles by place and surface.
    at_place: HashMap<(u32, u32), Vec<u32>>,
    /// Those that have been added, likewise.
    added: HashMap<(u32, u32), Vec<(u32, MovedVertex)>>,
}

impl<'a> Corners<'a> {
    fn new(source: &'a Source<'a>, triangles: &[u32], reach: f64) -> Self {
        let surfaces = super::patch::by_surface(triangles, |vertex| source.surface_of(vertex));
        let lengths = surfaces.iter().map(|(surface, own)| {
            let lengths = |set: usize| {
                let uv = |vertex| source.uvs(vertex)[set];
                UvLengths::new(own, |vertex| source.position(vertex), uv)
            };
            (*surface, [0, 1].map(lengths))
        });
        let color_length = |own: &[u32]| color_length(own.iter().map(|at| source.position(*at)));
        let color_lengths = surfaces.iter().map(|(at, own)| (*at, color_length(own))).collect();
        let mut at_place: HashMap<(u32, u32), Vec<u32>> = HashMap::new();
        for &vertex in triangles {
            let key = (source.welded[vertex as usize], source.surface_of(vertex));
            let known = at_place.entry(key).or_default();
            if !known.contains(&vertex) {
                known.push(vertex);
            }
        }
        Self {
            source,
            reach,
            lengths: lengths.collect(),
            color_lengths,
            charts: chart::UvBoxes::new(source, triangles),
            at_place,
            added: HashMap::new(),
        }
    }

    /// Returns the vertex for a corner of a triangle in a place: itself, or one that looks nearly
    /// alike there, or one that is added. What faces the same side there and is nearest in colour
    /// gives the colour, unless that is farther off than the place is.
    fn vertex(
        &mut self,
        triangle: &[u32; 3],
        corner: u32,
        place: u32,
        added: &mut Vec<MovedVertex>,
    ) -> u32 {
        let source = self.source;
        if source.welded[corner as usize] == place {
            return corner;
        }
        let surface = source.surface_of(corner);
        let uvs = self.charts.clamp(corner, self.uvs_at(triangle, corner, place));
        let lengths = self.lengths.get(&surface);
        let lengths = lengths.map_or([0.0; 2], |of| of.each_ref().map(|of| of.at(corner)));
        let is_near = |other: [DVec2; 2]| {
            let slide = [0, 1].map(|set| (uvs[set] - other[set]).length() * lengths[set]);
            slide[0].max(slide[1]) <= self.reach * SLIDE_MAX
        };
        let faces_alike = |other: u32| {
            source.normal(corner).dot(source.normal(other)) >= COSINE_MIN
                && !source.is_mirrored(corner, other)
                && source.has_tangents_alike(corner, other)
        };
        let there = self.at_place.get(&(place, surface)).into_iter().flatten().copied();
        let mut there: Vec<u32> = there.filter(|other| faces_alike(*other)).collect();
        // The own colour would be off by the way there.
        let way = source.position(corner).distance(source.position(place));
        there.retain(|other| self.color_way(corner, *other) <= way);
        there.sort_by(|one, two| {
            self.color_way(corner, *one).total_cmp(&self.color_way(corner, *two))
        });
        if let Some(vertex) = there.iter().find(|other| is_near(source.uvs(**other))) {
            return *vertex;
        }
        let from = there.first().copied().unwrap_or(corner);
        let is_alike = |other: &MovedVertex| {
            let colors = source.color(from).into_iter().zip(source.color(other.from));
            is_near(other.uvs)
                && faces_alike(other.from)
                && colors.into_iter().all(|(one, two)| (one - two).abs() <= COLOR_STEP)
        };
        let origin = if self.color_way(corner, from) > 0.0 { from } else { corner };
        let known = self.added.entry((place, surface)).or_default();
        if let Some((vertex, _)) = known.iter().find(|(_, other)| is_alike(other)) {
            return *vertex;
        }
        let vertex = (source.vertex_count() + added.len()) as u32;
        let moved = MovedVertex { from, at: place, uvs, origin };
        known.push((vertex, moved));
        added.push(moved);
        vertex
    }

    /// Returns how far a colour is off where a corner takes that of another vertex.
    fn color_way(&self, corner: u32, other: u32) -> f64 {
        let source = self.source;
        let length = self.color_lengths.get(&source.surface_of(corner)).copied().unwrap_or(0.0);
        let colors = source.color(corner).into_iter().zip(source.color(other));
        let square: f64 = colors.map(|(one, two)| (one - two).powi(2)).sum();
        square.sqrt() * length
    }

    /// Returns the texture coordinates of a triangle's plane in another place.
    fn uvs_at(&self, triangle: &[u32; 3], corner: u32, place: u32) -> [DVec2; 2] {
        let source = self.source;
        let [a, b, c] = triangle.map(|vertex| source.position(vertex));
        let (ab, ac) = (b - a, c - a);
        let way = source.position(place) - source.position(corner);
        let (bb, bc, cc) = (ab.dot(ab), ab.dot(ac), ac.dot(ac));
        let area = bb * cc - bc * bc;
        let own = source.uvs(corner);
        if area <= SLIVER * bb * cc {
            return own;
        }
        let (along_b, along_c) = (ab.dot(way), ac.dot(way));
        let second = (cc * along_b - bc * along_c) / area;
        let third = (bb * along_c - bc * along_b) / area;
        let corners = triangle.map(|vertex| source.uvs(vertex));
        [0, 1].map(|set| {
            let [a, b, c] = corners.map(|uvs| uvs[set]);
            own[set] + (b - a) * second + (c - a) * third
        })
    }
}

#[cfg(test)]
mod tests {
    use polyptych_scene::VertexLayout;

    use super::*;
    use crate::levels::surface::Surface;

    #[test]
    fn a_corner_that_moves_to_a_locked_place_meets_no_neighbour() {
        // A narrow triangle has the locked corner 0; corner 3 of another one lies beside it.
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 0.1], [-0.1, 0.0], [-1.0, 1.0], [-1.0, 0.0]];
        let vertices: Vec<f32> =
            corners.iter().flat_map(|[x, y]| [*x, *y, 0.0, 0.0, 0.0, 1.0]).collect();
        let (indices, layout) = ([0, 1, 2, 3, 4, 5], VertexLayout::default());
        let surfaces = [Surface {
            layout,
            vertices: &vertices,
            indices: &indices,
            keeps_order: false,
            locked: &[],
        }];
        let source = Source::new(&surfaces);
        let after = |moves: &[(u32, u32)]| {
            let mut places: BTreeMap<u32, u32> = (0..6).map(|at| (at, at)).collect();
            places.extend(moves.iter().copied());
            let clustered = cluster(&source, &indices, &places, 0.2);
            let is_met = keeps_locked(&source, &indices, &clustered.stays, |vertex| vertex == 0);
            (clustered.triangles.len() / 3, is_met)
        };
        assert_eq!(after(&[]), (2, true));
        assert_eq!(after(&[(3, 0)]), (2, true), "the locked corner's own triangle is left");
        assert_eq!(after(&[(2, 1)]), (1, false), "no triangle is left at the locked place");
        assert_eq!(after(&[(2, 1), (3, 0)]), (1, false), "only a corner that moved is left there");
    }
}
