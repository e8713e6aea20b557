//! Levels of detail: a hierarchy of meshlets, of which coarser ones may have vertices of their own.
//!
//! ```text
//! source -> hierarchy: cut into meshlets -> group neighbours -> simplify -> cut again
//!     patch: along edges, or small_parts: without what is narrow, or clustering: parts grow
//!     together, where contraction says
//!     deviation, appearance: measure -> error of the group
//! ```
//!
//! The error of a coarser meshlet is an upper bound of the distance between its level and the
//! finest one, in both directions. That of one step is proven by [`deviation`], up to a rounding
//! that is added; errors of steps are added up, since distances obey the triangle inequality. A
//! texture that slides by more than that raises the error, but that is sampled: see [`appearance`].
//!
//! What is one body covers about as much at each of its levels, seen from all around: [`coverage`].
//!
//! All surfaces of a mesh are simplified together, so that they meet without a crack at any level.
//! Borders between parts that are replaced on their own stay as they are: so do those of surfaces
//! of which all are drawn in their order, where each has levels of its own.

mod appearance;
mod chart;
mod clustering;
pub(super) mod coarse_first;
mod cone;
mod contraction;
mod convex_polygon;
mod coverage;
mod deviation;
mod enclosing_sphere;
mod hierarchy;
mod part_group;
mod patch;
mod simplified;
mod source;
mod surface;
#[cfg(test)]
pub(super) mod tests;
mod triangle_set;
mod width;

use std::sync::atomic::AtomicBool;

use foldhash::{HashMap, HashMapExt};
use glam::DVec3;
use polyptych_scene::meshlet::Meshlet;
use rayon::prelude::*;

use super::BakedLevel;
use super::error::BakeError;
use hierarchy::Cluster;
use source::Source;
pub(super) use surface::Surface;

/// Fewer triangles than this cost less than another level.
const TRIANGLES_MIN: usize = 32;

/// The triangles of all levels of a surface.
#[derive(Clone, Debug)]
pub(super) struct Levels {
    /// Vertices that only coarser levels have, behind those of the surface. Not all are used.
    pub added: Vec<f32>,
    /// The triangles of the finest level, as many as were given, then those of coarser ones.
    pub indices: Vec<u32>,
    /// Those of the finest level first.
    pub meshlets: Vec<Meshlet>,
    /// By meshlet: the level of those that replace it, [`u32::MAX`] if none do.
    pub replaced_at: Vec<u32>,
    /// Counts and errors of each level.
    pub facts: LevelFacts,
}

/// Triangles and errors of all levels.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct LevelFacts {
    /// The triangles of each level, the finest first.
    pub triangles: Vec<u64>,
    /// The largest error of each level, in units of the primitive's space times a scale.
    pub errors: Vec<f64>,
    /// The largest angle by which a normal differs at a removed vertex, in radians; the sum of
    /// steps where errors are, π at most.
    pub normal_angle: f64,
}

impl LevelFacts {
    /// Adds the levels of another surface, of which one unit is `scale` of the sum's.
    pub fn add(&mut self, other: &Self, scale: f64) {
        let levels = self.triangles.len().max(other.triangles.len());
        self.triangles.resize(levels, 0);
        self.errors.resize(levels, 0.0);
        for (sum, triangles) in self.triangles.iter_mut().zip(&other.triangles) {
            *sum += triangles;
        }
        for (most, error) in self.errors.iter_mut().zip(&other.errors) {
            *most = most.max(error * scale);
        }
        self.normal_angle = self.normal_angle.max(other.normal_angle);
    }

    /// Returns them as a bake reports them; errors must be in metres.
    pub fn list(&self) -> Vec<BakedLevel> {
        let levels = self.triangles.iter().zip(&self.errors);
        levels.map(|(&triangles, &error_m)| BakedLevel { triangles, error_m }).collect()
    }
}

/// Makes the levels of the surfaces of a mesh, which are replaced together, or each by itself if
/// all are drawn in their order; `None` for one that is always drawn whole.
///
/// # Errors
/// [`BakeError::Cancelled`].
pub(super) fn build(
    surfaces: &[Surface<'_>],
    cancel: &AtomicBool,
) -> Result<Vec<Option<Levels>>, BakeError> {
    if surfaces.len() > 1 && surfaces.iter().all(|surface| surface.keeps_order) {
        build_each(surfaces, cancel)
    } else {
        build_together(surfaces, cancel)
    }
}

/// Makes the levels of each surface by itself, see [`build`]. Positions that several of them have
/// stay in all levels, so that they meet: the pieces of a large blended primitive do.
fn build_each(
    surfaces: &[Surface<'_>],
    cancel: &AtomicBool,
) -> Result<Vec<Option<Levels>>, BakeError> {
    // The one surface at each position; `None` where several are.
    let mut only_at = HashMap::new();
    for (number, surface) in surfaces.iter().enumerate() {
        for position in surface.position_bits() {
            let only = only_at.entry(position).or_insert(Some(number));
            *only = only.filter(|only| *only == number);
        }
    }
    let levels = |surface: &Surface<'_>| {
        let vertices = (0..).zip(surface.position_bits());
        let shared = vertices.filter(|(_, position)| only_at.get(position) == Some(&None));
        let shared = shared.map(|(vertex, _)| vertex);
        let locked: Vec<u32> = shared.chain(surface.locked.iter().copied()).collect();
        let mut surface = *surface;
        surface.locked = &locked;
        Ok(build_together(&[surface], cancel)?.pop().flatten())
    };
    surfaces.par_iter().map(levels).collect()
}

fn build_together(
    surfaces: &[Surface<'_>],
    cancel: &AtomicBool,
) -> Result<Vec<Option<Levels>>, BakeError> {
    let indices: usize = surfaces.iter().map(|surface| surface.indices.len()).sum();
    if indices < TRIANGLES_MIN * 3 {
        return Ok(surfaces.iter().map(|_| None).collect());
    }
    let mut source = Source::new(surfaces);
    let hierarchy = hierarchy::build(&mut source, cancel)?;
    let mut clusters_of = vec![Vec::new(); surfaces.len()];
    for cluster in &hierarchy.clusters {
        clusters_of[source.surface_of(cluster.indices[0]) as usize].push(cluster);
    }
    let levels = surfaces.iter().enumerate().zip(&clusters_of).map(|((at, surface), clusters)| {
        let levels = levels_of(&source, surface, clusters)?;
        let normal_angle = hierarchy.normal_angle;
        let added = source.added_to(at).to_vec();
        Some(Levels { added, facts: LevelFacts { normal_angle, ..levels.facts }, ..levels })
    });
    Ok(levels.collect())
}

/// The levels of one surface; `None` if it is always drawn whole.
fn levels_of(source: &Source<'_>, surface: &Surface<'_>, clusters: &[&Cluster]) -> Option<Levels> {
    let is_culled = clusters.len() > 1 && !surface.keeps_order;
    if clusters.iter().all(|cluster| cluster.coarser_error.is_infinite()) && !is_culled {
        return None;
    }
    let mut levels = Levels {
        added: Vec::new(),
        indices: Vec::new(),
        meshlets: Vec::with_capacity(clusters.len()),
        replaced_at: Vec::with_capacity(clusters.len()),
        facts: LevelFacts::default(),
    };
    for cluster in clusters {
        levels.meshlets.push(meshlet(source, cluster, levels.indices.len()));
        levels.replaced_at.push(cluster.replaced_at);
        levels.indices.extend(cluster.indices.iter().map(|at| source.vertex_in_surface(*at)));
        let mut triangles = vec![0; cluster.level + 1];
        let mut errors = vec![0.0; cluster.level + 1];
        triangles[cluster.level] = cluster.indices.len() as u64 / 3;
        errors[cluster.level] = f64::from(cluster.error);
        levels.facts.add(&LevelFacts { triangles, errors, normal_angle: 0.0 }, 1.0);
    }
    // What no 32-bit number counts is drawn at full detail.
    u32::try_from(levels.indices.len()).is_ok().then_some(levels)
}

fn meshlet(source: &Source<'_>, cluster: &Cluster, first_index: usize) -> Meshlet {
    let points = cluster.indices.iter().map(|vertex| source.position(*vertex));
    let bounds = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (min, max) = points.fold(bounds, |(min, max), point| (min.min(point), max.max(point)));
    let triangles = cluster.indices.as_chunks::<3>().0.iter();
    let corners = triangles.map(|corners| corners.map(|vertex| source.position(vertex)));
    let cone = cone::around_normals(corners);
    Meshlet {
        first_index: first_index as u32,
        index_count: cluster.indices.len() as u32,
        // Positions of f32, so exact.
        min: min.as_vec3(),
        max: max.as_vec3(),
        cone_axis: cone.axis,
        cone_sine: cone.sine,
        error: cluster.error,
        sphere: cluster.sphere,
        coarser_error: cluster.coarser_error,
        coarser_sphere: cluster.coarser_sphere,
        level: cluster.level as u32,
    }
}
