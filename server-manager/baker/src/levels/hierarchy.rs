//! The hierarchy of meshlets: groups of neighbours are simplified and cut into meshlets again,
//! until nothing can be spared.

use std::f64::consts::PI;
use std::sync::OnceLock;
use std::sync::atomic::AtomicBool;

use foldhash::{HashSet, HashSetExt};
use polyptych_scene::meshlet::ErrorSphere;
use rayon::prelude::*;

use super::clustering;
use super::coverage::Coverage;
use super::enclosing_sphere::{around_points, around_spheres, round_up};
use super::patch::{Patch, by_surface};
use super::simplified::{Simplified, best, error_worth_measuring};
use super::source::{Source, adapter};
use super::surface::Surface;
use crate::check;
use crate::error::BakeError;
use crate::vertex_cache::CACHE;

/// Triangles of a meshlet at most; a multiple of 4.
pub(super) const MESHLET_TRIANGLES: usize = 128;

/// Triangles of a meshlet at least where there are as many; a multiple of 4.
const MESHLET_TRIANGLES_MIN: usize = 40;

/// Vertices of a meshlet at most: all that meshoptimizer can count.
const MESHLET_VERTICES: usize = 256;

/// The weight of a meshlet's normals beside its extent: meshoptimizer's documentation advises
/// 0.25 where meshlets are culled by their cones.
const CONE_WEIGHT: f32 = 0.25;

/// Meshlets larger than this times the expected size are split, as meshoptimizer's own builder of
/// hierarchies does.
const SPLIT_FACTOR: f32 = 2.0;

/// Meshlets that are simplified together: enough that most vertices are not on the border, few
/// enough that a view needs few levels of other parts.
const GROUP_MESHLETS: usize = 16;

/// Triangles around a vertex beyond which it counts as several while meshlets are cut: for each
/// triangle that joins a meshlet, all those left around its vertices are looked through.
const HUB_TRIANGLES: u32 = 1024;

/// Triangles of a finest level that all coarser ones are measured against.
const SMALL_TRIANGLES: usize = 4096;

/// Groups that a meshlet may be in which could not be simplified, before it is coarsest.
const TRIES: u8 = 2;

/// Triangles that are drawn together, and what replaces them.
#[derive(Clone, Debug)]
pub(super) struct Cluster {
    /// Three for each triangle.
    pub indices: Vec<u32>,
    /// 0 is the finest.
    pub level: usize,
    /// See [`polyptych_scene::meshlet::Meshlet::error`].
    pub error: f32,
    /// The sphere of `error`.
    pub sphere: ErrorSphere,
    /// The angle by which a normal differs from that of a vertex of the finest level that is
    /// removed, at most: sums of steps where errors are, in radians.
    pub normal_angle: f64,
    /// The number of the group that it is replaced with.
    pub group: usize,
    /// The error of what replaces the group; infinite if nothing does.
    pub coarser_error: f32,
    /// The sphere of `coarser_error`.
    pub coarser_sphere: ErrorSphere,
    /// The level of what replaces the group; [`u32::MAX`] if nothing does.
    pub replaced_at: u32,
    tries: u8,
}

/// The meshlets of all levels of a surface.
#[derive(Debug, Default)]
pub(super) struct Hierarchy {
    /// The finest first, those of a group in a row.
    pub clusters: Vec<Cluster>,
    /// The largest [`Cluster::normal_angle`].
    pub normal_angle: f64,
}

/// Makes the hierarchy of a surface.
pub(super) fn build(source: &mut Source<'_>, cancel: &AtomicBool) -> Result<Hierarchy, BakeError> {
    let (kept, locked) = (vec![false; source.vertex_count()], source.locked());
    let (hierarchy, body) = (Hierarchy::default(), OnceLock::new());
    let mut builder = Builder { source, hierarchy, groups: 0, kept, locked, body };
    let mut open = Vec::new();
    let surfaces = builder.source.surfaces().iter();
    for (surface, triangles) in surfaces.zip(builder.source.triangles()) {
        if surface.keeps_order && !builder.source.keeps_order() {
            builder.keep(&triangles);
        } else {
            open.extend(builder.cut(&triangles, 0, (0.0, 0.0), None));
        }
    }
    while !open.is_empty() {
        check(cancel)?;
        open = builder.coarsen(open, cancel)?;
    }
    let mut hierarchy = builder.hierarchy;
    hierarchy.clusters.sort_by_key(|cluster| (cluster.level, cluster.group));
    Ok(hierarchy)
}

struct Builder<'a, 's> {
    source: &'a mut Source<'s>,
    hierarchy: Hierarchy,
    /// Groups so far.
    groups: usize,
    /// `true` for each position of a coarsest meshlet, which its neighbours must go on to meet;
    /// named by the first vertex there.
    kept: Vec<bool>,
    /// `true` for each position that stays in all levels, named likewise.
    locked: Vec<bool>,
    /// The coverage of what was the first to be replaced as a whole, if that is one body.
    body: OnceLock<Option<Coverage>>,
}

impl Builder<'_, '_> {
    /// Cuts triangles of this error and angle of normals into meshlets; the finest ones bring their
    /// own spheres.
    fn cut(
        &self,
        triangles: &[u32],
        level: usize,
        (error, normal_angle): (f32, f64),
        sphere: Option<ErrorSphere>,
    ) -> Vec<Cluster> {
        let parts = cut(self.source, triangles).into_iter();
        let position = |vertex: &u32| self.source.position(*vertex);
        let cluster = |indices: Vec<u32>| {
            let sphere = sphere.unwrap_or_else(|| around_points(indices.iter().map(position)));
            let coarser_error = f32::INFINITY;
            let (group, tries, replaced_at) = (0, 0, u32::MAX);
            Cluster {
                indices,
                level,
                error,
                sphere,
                normal_angle,
                group,
                coarser_error,
                coarser_sphere: sphere,
                replaced_at,
                tries,
            }
        };
        parts.map(cluster).collect()
    }

    /// Replaces groups of neighbours by fewer triangles. Gives the new meshlets, and those that may
    /// be replaced with other neighbours.
    fn coarsen(
        &mut self,
        open: Vec<Cluster>,
        cancel: &AtomicBool,
    ) -> Result<Vec<Cluster>, BakeError> {
        let groups = self.group(open);
        let borders = self.borders(&groups);
        let finest = if groups.len() == 1 { self.small_finest() } else { None };
        let body = if groups.len() == 1 { self.body_of(&groups[0]) } else { None };
        let keeps_body = |of: &Simplified| body.is_none_or(|body| self.is_kept(body, of));
        let simplify = |group: &Vec<Cluster>| {
            check(cancel)?;
            let triangles: Vec<u32> = group.iter().flat_map(|c| &c.indices).copied().collect();
            let measured = finest.as_ref().unwrap_or(&triangles);
            let prior = group.iter().map(|cluster| f64::from(cluster.error)).fold(0.0, f64::max);
            let is_locked = |vertex: u32| {
                let at = self.source.welded[vertex as usize];
                borders.contains(&at) || self.kept[at as usize] || self.locked[at as usize]
            };
            // What is replaced as a whole and meets no other mesh has no border for cracks.
            let is_alone = finest.is_some() && !self.locked.contains(&true);
            let is_whole = is_alone && self.source.surfaces().len() > 1;
            let patch = Patch::new(self.source, &triangles, measured);
            let mut found =
                finest.as_ref().and_then(|_| patch.simplify_parts(is_locked, (prior, is_whole)));
            found = found.filter(keeps_body);
            let errors = (prior, error_worth_measuring(found.as_ref()));
            found = best(patch.simplify(is_locked, errors).filter(keeps_body), found);
            if is_whole || clustering::is_scattered(self.source, &triangles) {
                let lists = (&triangles[..], &measured[..]);
                let errors = (prior, error_worth_measuring(found.as_ref()));
                let clustered = clustering::simplify(self.source, lists, is_locked, errors);
                found = best(found, clustered.filter(keeps_body));
            }
            let angle = group.iter().map(|cluster| cluster.normal_angle).fold(0.0, f64::max);
            let replacement = found.and_then(|mut simplified| {
                let (steps, turns) = if finest.is_some() { (0.0, 0.0) } else { (prior, angle) };
                let error = (steps + simplified.error).max(prior);
                simplified.normal_angle = (turns + simplified.normal_angle).min(PI);
                Replacement::new(group, simplified, error)
            });
            Ok(replacement)
        };
        let replacements: Vec<Option<Replacement>> =
            groups.par_iter().map(simplify).collect::<Result<_, BakeError>>()?;
        let is_stuck = replacements.iter().all(Option::is_none);
        let known = self.source.vertex_count() as u32;
        let mut next = Vec::new();
        for (group, replacement) in groups.into_iter().zip(replacements) {
            match replacement {
                Some(mut replacement) => {
                    self.add_vertices(&mut replacement.simplified, known);
                    next.extend(self.replace(group, &replacement));
                }
                None => next.extend(self.retry(group, is_stuck)),
            }
        }
        Ok(next)
    }

    /// The coverage of what was the first to be replaced as a whole: this, if nothing was yet.
    fn body_of(&self, group: &[Cluster]) -> Option<&Coverage> {
        let welded = |vertex: &u32| self.source.welded[*vertex as usize];
        let body = || {
            let indices: Vec<u32> = group.iter().flat_map(|c| &c.indices).map(welded).collect();
            Coverage::new(indices.as_chunks::<3>().0, |at| self.source.position(at))
        };
        self.body.get_or_init(body).as_ref()
    }

    /// Returns whether a replacement of the whole covers about as much as the body.
    fn is_kept(&self, body: &Coverage, by: &Simplified) -> bool {
        let known = self.source.vertex_count() as u32;
        let position = |vertex: u32| match vertex.checked_sub(known) {
            Some(added) => self.source.position(by.added[added as usize].at),
            None => self.source.position(vertex),
        };
        let triangles = by.indices.as_chunks::<3>().0.iter();
        let triangles: Vec<_> = triangles.map(|corners| corners.map(position)).collect();
        body.is_kept_by(&triangles)
    }

    /// Adds the vertices that a replacement brings, which it numbers from `known` on.
    fn add_vertices(&mut self, simplified: &mut Simplified, known: u32) {
        let numbers: Vec<u32> =
            simplified.added.iter().map(|vertex| self.source.add(vertex)).collect();
        for index in simplified.indices.iter_mut().filter(|index| **index >= known) {
            *index = numbers[(*index - known) as usize];
        }
        for stays in [&mut self.kept, &mut self.locked] {
            stays.resize(self.source.vertex_count(), false);
        }
    }

    /// Keeps a group, and gives the meshlets that replace it.
    fn replace(&mut self, group: Vec<Cluster>, by: &Replacement) -> Vec<Cluster> {
        let level = group.iter().map(|cluster| cluster.level).max().unwrap_or(0) + 1;
        let angle = by.simplified.normal_angle;
        self.hierarchy.normal_angle = self.hierarchy.normal_angle.max(angle);
        self.hierarchy.clusters.extend(group.into_iter().map(|cluster| Cluster {
            group: self.groups,
            coarser_error: by.error,
            coarser_sphere: by.sphere,
            replaced_at: level as u32,
            ..cluster
        }));
        self.groups += 1;
        self.cut(&by.simplified.indices, level, (by.error, angle), Some(by.sphere))
    }

    /// Keeps the positions of triangles in all levels.
    fn keep(&mut self, triangles: &[u32]) {
        for vertex in triangles {
            self.kept[self.source.welded[*vertex as usize] as usize] = true;
        }
    }

    /// Gives those of a group that could not be simplified which may be in another one, and keeps
    /// the others as the coarsest ones.
    fn retry(&mut self, group: Vec<Cluster>, is_last: bool) -> Vec<Cluster> {
        let (mut open, number) = (Vec::new(), self.groups);
        self.groups += 1;
        for cluster in group {
            let tries = cluster.tries + 1;
            if tries < TRIES && !is_last {
                open.push(Cluster { tries, ..cluster });
                continue;
            }
            self.keep(&cluster.indices);
            self.hierarchy.clusters.push(Cluster { group: number, ..cluster });
        }
        open
    }

    /// Groups neighbours, and orders the groups by their place.
    fn group(&self, open: Vec<Cluster>) -> Vec<Vec<Cluster>> {
        let positions = adapter(&self.source.scaled);
        let Some(positions) = positions.filter(|_| self.is_divided(&open)) else {
            return vec![open];
        };
        let mut group_of = vec![0; open.len()];
        let welded = |vertex: &u32| self.source.welded[*vertex as usize];
        let vertices: Vec<u32> = open.iter().flat_map(|c| c.indices.iter().map(welded)).collect();
        let counts: Vec<u32> = open.iter().map(|cluster| cluster.indices.len() as u32).collect();
        let count = meshopt::partition_clusters_with_positions(
            &mut group_of,
            &vertices,
            &counts,
            &positions,
            GROUP_MESHLETS,
        );
        let mut groups: Vec<Vec<Cluster>> = (0..count).map(|_| Vec::new()).collect();
        for (cluster, group) in open.into_iter().zip(group_of) {
            groups[group as usize].push(cluster);
        }
        groups.retain(|group| !group.is_empty());
        let place = |group: &Vec<Cluster>| self.source.scaled[group[0].indices[0] as usize];
        let places: Vec<[f32; 3]> = groups.iter().map(place).collect();
        let Some(places) = adapter(&places) else { return groups };
        let mut ordered: Vec<_> =
            meshopt::spatial_sort_remap(&places).into_iter().zip(groups).collect();
        ordered.sort_by_key(|(order, _)| *order);
        ordered.into_iter().map(|(_, group)| group).collect()
    }

    /// Gives the finest level if it is small and replaced as a whole, so that each coarser level
    /// can be measured against it: the sum of steps is up to four times as much.
    fn small_finest(&self) -> Option<Vec<u32>> {
        self.is_small().then(|| self.source.triangles().flatten().collect())
    }

    /// Returns whether all of the surface is open, and of few triangles.
    fn is_small(&self) -> bool {
        let surfaces = self.source.surfaces();
        let indices: usize = surfaces.iter().map(|surface| surface.indices.len()).sum();
        let is_fixed = |at: &Surface<'_>| at.keeps_order && !self.source.keeps_order();
        let is_small = indices <= SMALL_TRIANGLES * 3 && !surfaces.iter().any(is_fixed);
        is_small && !self.kept.contains(&true)
    }

    /// Returns whether parts of the surface have levels of their own. What is drawn in order is
    /// replaced as a whole, and so are several surfaces of few triangles, of which parts are left
    /// out.
    fn is_divided(&self, open: &[Cluster]) -> bool {
        let is_whole = self.source.surfaces().len() > 1 && self.is_small();
        open.len() > GROUP_MESHLETS && !self.source.keeps_order() && !is_whole
    }

    /// Returns the positions that several groups have, named by the first vertex there.
    fn borders(&self, groups: &[Vec<Cluster>]) -> HashSet<u32> {
        let mut group_at = vec![0; self.source.welded.len()];
        let mut borders = HashSet::new();
        for (number, group) in (1..).zip(groups) {
            for vertex in group.iter().flat_map(|cluster| &cluster.indices) {
                let at = self.source.welded[*vertex as usize];
                let known = &mut group_at[at as usize];
                if *known != 0 && *known != number {
                    borders.insert(at);
                }
                *known = number;
            }
        }
        borders
    }
}

/// The triangles that replace a group.
struct Replacement {
    simplified: Simplified,
    error: f32,
    sphere: ErrorSphere,
}

impl Replacement {
    /// The replacement of a group with this error; `None` if it is no number of f32.
    fn new(group: &[Cluster], simplified: Simplified, error: f64) -> Option<Self> {
        let error = round_up(error);
        let sphere = around_spheres(group.iter().map(|cluster| cluster.sphere));
        error.is_finite().then_some(Self { simplified, error, sphere })
    }
}

/// Cuts triangles into the runs of meshlets, each of one surface.
fn cut(source: &Source<'_>, triangles: &[u32]) -> Vec<Vec<u32>> {
    if source.keeps_order() {
        return triangles.chunks(MESHLET_TRIANGLES * 3).map(<[u32]>::to_vec).collect();
    }
    let surfaces = by_surface(triangles, |vertex| source.surface_of(vertex));
    surfaces.values().flat_map(|triangles| cut_surface(source, triangles)).collect()
}

fn cut_surface(source: &Source<'_>, triangles: &[u32]) -> Vec<Vec<u32>> {
    // Numbered anew: the time that cutting takes grows with all vertices that it could name.
    let mut vertices = triangles.to_vec();
    vertices.sort_unstable();
    vertices.dedup();
    let number = |vertex: &u32| vertices.partition_point(|known| known < vertex) as u32;
    let mut local: Vec<u32> = triangles.iter().map(number).collect();
    part_hubs(&mut local, &mut vertices);
    let positions: Vec<[f32; 3]> =
        vertices.iter().map(|vertex| source.scaled[*vertex as usize]).collect();
    let Some(positions) = adapter(&positions) else {
        return triangles.chunks(MESHLET_TRIANGLES * 3).map(<[u32]>::to_vec).collect();
    };
    let meshlets = meshopt::build_meshlets_flex(
        &local,
        &positions,
        MESHLET_VERTICES,
        MESHLET_TRIANGLES_MIN,
        MESHLET_TRIANGLES,
        CONE_WEIGHT,
        SPLIT_FACTOR,
    );
    let run = |meshlet: meshopt::Meshlet<'_>| -> Vec<u32> {
        let local: Vec<u32> = meshlet.triangles.iter().map(|index| u32::from(*index)).collect();
        let count = meshlet.vertices.len();
        let ordered = meshopt::optimize_vertex_cache_fifo(&local, count, CACHE);
        let vertex = |index: u32| vertices[meshlet.vertices[index as usize] as usize];
        ordered.into_iter().map(vertex).collect()
    };
    meshlets.iter().map(run).collect()
}

/// Gives a vertex another number for each [`HUB_TRIANGLES`] corners of triangles that it is.
/// `vertices` has the vertex of each number.
fn part_hubs(corners: &mut [u32], vertices: &mut Vec<u32>) {
    let mut number_of: Vec<u32> = (0..vertices.len() as u32).collect();
    let mut counts = vec![0_u32; vertices.len()];
    for corner in corners {
        let first = *corner as usize;
        if counts[first] == HUB_TRIANGLES {
            let vertex = vertices[first];
            number_of[first] = vertices.len() as u32;
            counts[first] = 0;
            vertices.push(vertex);
        }
        counts[first] += 1;
        *corner = number_of[first];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_vertex_has_more_triangles_than_can_be_looked_through() {
        // A fan around vertex 70, whose rim has the other numbers from 7 on.
        let count = 5000;
        let mut vertices: Vec<u32> = (0..=count).map(|at| at + 7).collect();
        let fan = (0..count).flat_map(|at| [63, at, at + 1]);
        let mut corners: Vec<u32> = fan.collect();
        let of = |corners: &[u32], vertices: &[u32]| -> Vec<u32> {
            corners.iter().map(|at| vertices[*at as usize]).collect()
        };
        let before = of(&corners, &vertices);
        part_hubs(&mut corners, &mut vertices);
        assert_eq!(of(&corners, &vertices), before);
        let mut counts = vec![0; vertices.len()];
        for at in corners {
            counts[at as usize] += 1;
        }
        assert!(counts.iter().all(|count| *count <= HUB_TRIANGLES));
        assert_eq!(vertices.len() as u32, count + 1 + 4, "five numbers for one vertex");
        let known = vertices.clone();
        part_hubs(&mut [0, 1, 2, 0, 2, 3], &mut vertices);
        assert_eq!(vertices, known, "others keep their one number");
    }
}
