//! Small parts of surfaces that are left out: windows, frames and trims on a wall.
//!
//! Where the parts of a surface share no vertex, moving vertices along edges or together spoils
//! large parts before it spares small ones. What is left out changes no part that stays, and then
//! what it stood on may lose the edges that it had because of it, or have its vertices contracted.

use std::collections::BTreeMap;

use glam::DVec3;

use super::{NEGLIGIBLE, Patch};
use crate::levels::clustering::Contracted;
use crate::levels::contraction::Goal;
use crate::levels::part_group::{self, PartPoints};
use crate::levels::simplified::{Simplified, best, error_worth_measuring};
use crate::levels::triangle_set::TriangleSet;

/// The step by which the error grows until enough triangles are spared.
const STEP: f64 = 1.4;

/// Errors that are tried from the least one on that spares enough.
const STEPS: i32 = 4;

/// A way to spare triangles.
enum Way<'a> {
    /// Three vertices of the patch for each that is left.
    Triangles(Vec<u32>),
    Contracted(Box<Contracted<'a>>),
}

impl Way<'_> {
    fn measured(self, patch: &Patch<'_>, errors: (f64, f64)) -> Option<Simplified> {
        match self {
            Self::Triangles(triangles) => patch.measured(&triangles, errors),
            Self::Contracted(contracted) => contracted.measured(errors),
        }
    }
}

/// A connected part of a surface.
struct Part {
    /// Three vertices of the patch for each triangle.
    indices: Vec<u32>,
    points: PartPoints,
    /// Locked vertices keep it.
    must_stay: bool,
}

impl Part {
    /// See [`crate::levels::width::of_points`]; infinite if the part must stay.
    fn width(&self) -> f64 {
        if self.must_stay { f64::INFINITY } else { self.points.width }
    }
}

impl Patch<'_> {
    /// Returns the patch with fewer triangles for the least error that spares enough of them, of
    /// errors that are steps apart: without parts that are no wider and no farther from a larger
    /// part, and then with fewer edges, or contracted if `is_whole`: it meets nothing else.
    /// `None` if nothing is worth it. `is_locked` says of a vertex whether it must stay, and
    /// `prior` is the error that the patch's triangles have already.
    pub fn simplify_parts(
        &self,
        is_locked: impl Fn(u32) -> bool,
        (prior, is_whole): (f64, bool),
    ) -> Option<Simplified> {
        let parts = self.parts(&is_locked);
        let size = self.size().length();
        let least = prior.max(NEGLIGIBLE * size);
        let error = |step: i32| least * STEP.powi(step);
        let end = ((size / least).ln() / STEP.ln()).ceil().max(0.0) as i32;
        // The first step that spares enough.
        let (mut from, mut to) = (0, end);
        while from < to {
            let middle = from.midpoint(to);
            let mut ways = self.ways(&is_locked, &parts, (error(middle), is_whole));
            if ways.next().is_none() {
                from = middle + 1;
            } else {
                to = middle;
            }
        }
        let mut found: Option<Simplified> = None;
        for step in from..end.min(from + STEPS) {
            if found.as_ref().is_some_and(|found| found.error <= error(step)) {
                break;
            }
            for way in self.ways(&is_locked, &parts, (error(step), is_whole)) {
                let errors = (prior, error_worth_measuring(found.as_ref()));
                found = best(found, way.measured(self, errors));
            }
        }
        found
    }

    /// Returns the ways to spare triangles at an error that are worth it: without parts of such a
    /// width, and then with edges that are left out, or vertices that move together.
    fn ways<'p>(
        &'p self,
        is_locked: impl Fn(u32) -> bool + Copy,
        parts: &[Part],
        (error, is_whole): (f64, bool),
    ) -> impl Iterator<Item = Way<'p>> {
        let stays = self.without_parts(parts, error);
        let global = |list: &[u32]| -> Vec<u32> {
            list.iter().map(|at| self.vertices[*at as usize]).collect()
        };
        let lists = (global(&stays), global(&self.indices));
        let without = Some(stays.clone()).filter(|stays| self.is_worth(stays.len()));
        let fewer = move || self.fewer(&stays, is_locked, (0, Some(error)));
        let contracted = move || {
            if !is_whole {
                return None;
            }
            let goal = Goal { target: 0, reach: error, way_max: error };
            let contracted = Contracted::new(self.source, (&lists.0, &lists.1), is_locked, goal)?;
            self.is_worth(contracted.count() * 3).then(|| Box::new(contracted))
        };
        let edges = std::iter::once_with(fewer).flatten();
        let vertices = std::iter::once_with(contracted).flatten();
        without.into_iter().chain(edges).map(Way::Triangles).chain(vertices.map(Way::Contracted))
    }

    /// Returns the triangles without parts up to a width that are no farther than that from what
    /// is wider; the widest part always stays. Parts side by side count together.
    fn without_parts(&self, parts: &[Part], width: f64) -> Vec<u32> {
        let widest = parts.last().map_or(0.0, Part::width);
        let is_small = |part: &Part| part.width() <= width && part.width() < widest;
        let (small, large) = parts.split_at(parts.partition_point(is_small));
        // A patch of one surface is measured as a whole: nothing may be left out of it.
        if small.is_empty() || self.source.surfaces().len() == 1 {
            return self.current.clone();
        }
        let points: Vec<DVec3> = self.looks.points().iter().map(|point| point.position).collect();
        let mut stays: Vec<u32> = large.iter().flat_map(|of| &of.indices).copied().collect();
        let set = TriangleSet::new(&points, &self.weld(&stays));
        // Neighbours in the list are neighbours in space.
        let mut guess = 0;
        let (far, near): (Vec<&Part>, Vec<&Part>) = small.iter().partition(|part| {
            part.indices.iter().any(|at| {
                let near = set.nearest(points[*at as usize], guess);
                guess = near.triangle;
                near.distance > width
            })
        });
        let groups = part_group::groups(&near.iter().map(|of| &of.points).collect::<Vec<_>>());
        let wide = groups.iter().filter(|group| group.width > width);
        let wide = wide.flat_map(|group| group.parts.iter().map(|at| near[*at]));
        stays.extend(far.into_iter().chain(wide).flat_map(|part| &part.indices));
        stays
    }

    /// The connected parts of all surfaces, the narrowest first, and those that must stay last.
    fn parts(&self, is_locked: impl Fn(u32) -> bool) -> Vec<Part> {
        let part_of = self.connected(&self.current);
        let mut found: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for corners in self.current.as_chunks::<3>().0 {
            found.entry(part_of[corners[0] as usize]).or_default().extend(corners);
        }
        let part = |indices: Vec<u32>| {
            let must_stay = indices.iter().any(|at| is_locked(self.vertices[*at as usize]));
            let points = indices.iter().map(|at| self.looks.points()[*at as usize].position);
            Part { points: PartPoints::new(points.collect()), indices, must_stay }
        };
        let mut parts: Vec<Part> = found.into_values().map(part).collect();
        parts.sort_by(|one, two| one.width().total_cmp(&two.width()));
        parts
    }
}
