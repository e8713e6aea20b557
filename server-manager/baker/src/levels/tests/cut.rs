//! Cuts through the hierarchy at an allowed error: no gap, nothing twice.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::PI;
use std::sync::atomic::AtomicBool;

use glam::{DVec3, Vec3};
use polyptych_scene::meshlet::{self, ErrorSphere, Meshlet};
use proptest::prelude::*;

use super::shapes::{self, Shape, noise};
use super::{Drawn, levels};
use crate::levels::source::Source;
use crate::levels::{Levels, hierarchy};

/// An eye, and the error that is allowed at a unit's distance from it.
#[derive(Clone, Copy, Debug)]
struct Allowed {
    eye: DVec3,
    error: f64,
}

impl Allowed {
    fn allows(self, error: f32, sphere: ErrorSphere) -> bool {
        let distance = sphere.center.as_dvec3().distance(self.eye) - f64::from(sphere.radius);
        f64::from(error) <= self.error * distance.max(0.0)
    }

    fn draws(self, meshlet: &Meshlet) -> bool {
        self.allows(meshlet.error, meshlet.sphere)
            && !self.allows(meshlet.coarser_error, meshlet.coarser_sphere)
    }
}

fn bits(error: f32, sphere: ErrorSphere) -> [u32; 5] {
    let Vec3 { x, y, z } = sphere.center;
    [error, x, y, z, sphere.radius].map(f32::to_bits)
}

/// Holds that the drawn meshlets are what is left after groups, each as a whole, were replaced.
fn check_replacement(levels: &Levels, allowed: Allowed, name: &str) -> Vec<usize> {
    let all = &levels.meshlets;
    let mut groups: BTreeMap<[u32; 5], (BTreeSet<usize>, BTreeSet<usize>)> = BTreeMap::new();
    for (at, meshlet) in all.iter().enumerate() {
        if meshlet.coarser_error.is_finite() {
            let key = bits(meshlet.coarser_error, meshlet.coarser_sphere);
            groups.entry(key).or_default().0.insert(at);
        }
        if meshlet.error > 0.0 {
            groups.entry(bits(meshlet.error, meshlet.sphere)).or_default().1.insert(at);
        }
    }
    let finest = |at: &usize| all[*at].error == 0.0;
    let mut drawn: BTreeSet<usize> = (0..all.len()).filter(finest).collect();
    let mut open: Vec<_> = groups.values().collect();
    assert!(open.iter().all(|(old, new)| !old.is_empty() && !new.is_empty()), "{name}");
    loop {
        let before = open.len();
        open.retain(|(old, new)| {
            let first = &all[*old.first().expect("a meshlet")];
            let is_due =
                allowed.allows(first.coarser_error, first.coarser_sphere) && old.is_subset(&drawn);
            if is_due {
                drawn.retain(|at| !old.contains(at));
                drawn.extend(new);
            }
            !is_due
        });
        if open.len() == before {
            break;
        }
    }
    let chosen: BTreeSet<usize> = (0..all.len()).filter(|at| allowed.draws(&all[*at])).collect();
    assert_eq!(chosen, drawn, "{name}: {allowed:?}");
    chosen.into_iter().collect()
}

/// The edges at which triangles end: for each, by the bits of its ends, the triangles on its left
/// minus those on its right.
fn open_edges(vertices: &[f32], indices: &[u32]) -> BTreeMap<[[u32; 3]; 2], i32> {
    let position = |vertex: u32| {
        let row = &vertices[vertex as usize * 8..][..3];
        [0, 1, 2].map(|axis| (row[axis] + 0.0).to_bits())
    };
    let mut edges = BTreeMap::new();
    for corners in indices.as_chunks::<3>().0 {
        for side in 0..3 {
            let ends = [corners[side], corners[(side + 1) % 3]].map(position);
            let is_turned = ends[0] > ends[1];
            let key = if is_turned { [ends[1], ends[0]] } else { ends };
            if ends[0] != ends[1] {
                *edges.entry(key).or_insert(0) += if is_turned { -1 } else { 1 };
            }
        }
    }
    edges.retain(|_, sum| *sum != 0);
    edges
}

/// Holds that the drawn meshlets end only where the source does.
fn check_borders(shape: &Shape, drawn: &Drawn, may_be_open: bool) {
    let ends = |indices: &[u32]| -> BTreeSet<[u32; 3]> {
        open_edges(&drawn.vertices, indices).into_keys().flatten().collect()
    };
    let border = ends(&shape.indices);
    assert_eq!(border.is_empty(), !may_be_open, "{}", shape.name);
    let gaps = ends(&drawn.indices).difference(&border).count();
    assert_eq!(gaps, 0, "{} has cracks", shape.name);
}

#[test]
fn meshlets_are_in_order_and_tighten() {
    for shape in shapes::closed().into_iter().chain(shapes::open()) {
        let levels = levels(&shape);
        let [fine, all] = [shape.indices.len(), levels.indices.len()].map(|count| count as u32);
        assert_eq!(meshlet::fault(&levels.meshlets, fine, all), None, "{}", shape.name);
        let triangles = |indices: &[u32]| {
            let mut triangles = indices.as_chunks::<3>().0.to_vec();
            for corners in &mut triangles {
                let first = (0..3).min_by_key(|at| corners[*at]).expect("a corner");
                corners.rotate_left(first);
            }
            triangles.sort_unstable();
            triangles
        };
        let finest = &levels.indices[..shape.indices.len()];
        assert_eq!(triangles(finest), triangles(&shape.indices), "{}", shape.name);
        for meshlet in &levels.meshlets {
            assert!(meshlet.index_count <= 128 * 3, "{}", shape.name);
            let [own, coarser] = [meshlet.sphere, meshlet.coarser_sphere];
            let apart = own.center.as_dvec3().distance(coarser.center.as_dvec3());
            assert!(apart + f64::from(own.radius) <= f64::from(coarser.radius), "{}", shape.name);
            let drawn = Drawn::new(&shape, &levels, &[*meshlet]);
            for point in drawn.points() {
                let around = point.distance(own.center.as_dvec3());
                assert!(around <= f64::from(own.radius), "{}", shape.name);
                let [min, max] = [meshlet.min, meshlet.max].map(Vec3::as_dvec3);
                assert!(point.cmpge(min).all() && point.cmple(max).all(), "{}", shape.name);
            }
        }
    }
}

#[test]
fn cuts_are_whole_and_have_no_cracks() {
    let closed = shapes::closed().into_iter().chain([shapes::large_torus()]);
    let closed = closed.map(|shape| (shape, false));
    let open = shapes::open().into_iter().chain([shapes::bumpy(90, 90, 5, 0.05)]);
    let mut mixed = 0;
    for (shape, may_be_open) in closed.chain(open.map(|shape| (shape, true))) {
        let levels = levels(&shape);
        for view in 0..40 {
            let eye = DVec3::from_array([0, 1, 2].map(|axis| 5.0 * noise(view * 3 + axis)));
            let error = 10.0_f64.powf(noise(view + 700) * 1.5 - 1.5);
            let drawn = check_replacement(&levels, Allowed { eye, error }, shape.name);
            let drawn: Vec<Meshlet> = drawn.into_iter().map(|at| levels.meshlets[at]).collect();
            let is_finest = |meshlet: &Meshlet| meshlet.error == 0.0;
            mixed += usize::from(drawn.iter().any(is_finest) && !drawn.iter().all(is_finest));
            check_borders(&shape, &Drawn::new(&shape, &levels, &drawn), may_be_open);
        }
    }
    assert!(mixed > 10, "only {mixed} cuts have several levels");
}

/// Steps that are not measured against the finest level add their angles to those before.
#[test]
fn angles_of_normals_add_up_with_each_step() {
    let shape = shapes::bumpy(72, 60, 5, 0.01);
    assert!(shape.indices.len() / 3 > 4096, "a small one is measured against its finest level");
    let surfaces = [shape.surface()];
    let mut source = Source::new(&surfaces);
    let made = hierarchy::build(&mut source, &AtomicBool::new(false)).expect("not cancelled");
    let mut largest = BTreeMap::new();
    for old in made.clusters.iter().filter(|cluster| cluster.coarser_error.is_finite()) {
        let angle: &mut f64 =
            largest.entry(bits(old.coarser_error, old.coarser_sphere)).or_default();
        *angle = angle.max(old.normal_angle);
    }
    let mut added = 0;
    for new in made.clusters.iter().filter(|cluster| cluster.level > 0) {
        let (before, after) = (largest[&bits(new.error, new.sphere)], new.normal_angle);
        assert!(after > before || after == PI, "{after} rad after {before} rad");
        added += usize::from(before > 0.0 && after < PI);
        assert!(after <= made.normal_angle);
    }
    assert!(added > 0, "no second step");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn cuts_of_random_grids_have_no_cracks(
        columns in 12..80_u32,
        rows in 12..80_u32,
        seed in any::<u32>(),
        height in 0.0..0.5_f64,
    ) {
        let shape = shapes::bumpy(columns, rows, seed, height);
        let levels = levels(&shape);
        for step in 0..12 {
            let allowed = Allowed {
                eye: DVec3::from_array([1, 2, 3].map(|axis| 3.0 * noise(seed ^ (step * 3 + axis)))),
                error: 10.0_f64.powf(-f64::from(step) / 3.0),
            };
            let drawn = check_replacement(&levels, allowed, shape.name);
            let drawn: Vec<Meshlet> = drawn.into_iter().map(|at| levels.meshlets[at]).collect();
            check_borders(&shape, &Drawn::new(&shape, &levels, &drawn), true);
        }
    }
}
