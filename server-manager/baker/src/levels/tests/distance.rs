//! The stated error against the distance that dense samples have: another formula, no tree, no
//! bound.

use glam::DVec3;
use rayon::prelude::*;

use super::shapes::{self, Shape};
use super::{Drawn, levels};

/// Points of a triangle along each side.
const STEPS: u32 = 4;

/// A triangle with a sphere around it, so that those far away are passed over.
struct Target {
    corners: [DVec3; 3],
    middle: DVec3,
    radius: f64,
}

impl Target {
    fn new(corners: [DVec3; 3]) -> Self {
        let middle = corners.iter().sum::<DVec3>() / 3.0;
        let radius = corners.iter().map(|corner| corner.distance(middle)).fold(0.0, f64::max);
        Self { corners, middle, radius }
    }

    /// Eberly's way: the point of the plane if the triangle holds it, or the nearest of its sides.
    fn distance(&self, point: DVec3) -> f64 {
        let [a, b, c] = self.corners;
        let sides = [(a, b), (b, c), (c, a)].map(|(from, to)| {
            let share = (point - from).dot(to - from) / from.distance_squared(to);
            let share = if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.0 };
            point.distance(from.lerp(to, share))
        });
        let near = sides.into_iter().fold(f64::INFINITY, f64::min);
        let Some(normal) = (b - a).cross(c - a).try_normalize() else { return near };
        let foot = point - normal * (point - a).dot(normal);
        let is_left = |from: DVec3, to: DVec3| (to - from).cross(foot - from).dot(normal) >= 0.0;
        let is_inside = is_left(a, b) && is_left(b, c) && is_left(c, a);
        if is_inside { near.min(point.distance(foot)) } else { near }
    }
}

/// Returns the largest distance of any sample of `from` to the surface `to`.
pub(crate) fn sampled(from: &[[DVec3; 3]], to: &[[DVec3; 3]], steps: u32) -> f64 {
    let targets: Vec<Target> = to.iter().copied().map(Target::new).collect();
    let distance = |point: DVec3| {
        targets.iter().fold(f64::INFINITY, |best, target| {
            let least = point.distance(target.middle) - target.radius;
            if least >= best { best } else { best.min(target.distance(point)) }
        })
    };
    let samples = |[a, b, c]: &[DVec3; 3]| {
        let (a, ab, ac) = (*a, *b - *a, *c - *a);
        (0..=steps)
            .flat_map(move |one| {
                let share = move |part: u32| f64::from(part) / f64::from(steps);
                (0..=steps - one).map(move |two| a + ab * share(one) + ac * share(two))
            })
            .collect::<Vec<DVec3>>()
    };
    let farthest =
        |triangle: &[DVec3; 3]| samples(triangle).into_iter().map(distance).fold(0.0, f64::max);
    from.par_iter().map(farthest).reduce(|| 0.0, f64::max)
}

/// Holds that every level keeps its promise. Gives the error of the first step as it was sampled,
/// and the stated one by that.
fn check(shape: &Shape, steps: u32) -> [f64; 2] {
    let levels = levels(shape);
    let source = Drawn::within(shape, &levels, 0.0).triangles;
    let mut samples = Vec::new();
    let facts = &levels.facts.errors;
    let deepest = facts.len() - 1;
    let asked = [1, deepest / 2, deepest].map(|level| facts[level.max(1)] as f32);
    for error in asked {
        let drawn = Drawn::within(shape, &levels, error);
        assert!(drawn.error > 0.0 && drawn.triangles.len() < source.len(), "{}", shape.name);
        let there = sampled(&source, &drawn.triangles, steps);
        let back = sampled(&drawn.triangles, &source, steps);
        let found = there.max(back);
        assert!(found <= drawn.error, "{}: {found} is more than {}", shape.name, drawn.error);
        samples.push([found, drawn.error / found]);
    }
    let (triangles, [_, first], [_, last]) = (&levels.facts.triangles, samples[0], samples[2]);
    println!("{:22} {triangles:?} stated / sampled: {first:.3}, coarsest {last:.2}", shape.name);
    samples[0]
}

#[test]
fn stated_errors_hold_on_generated_models() {
    let shapes: Vec<Shape> = shapes::closed().into_iter().chain(shapes::open()).collect();
    assert!(shapes.len() >= 20);
    for shape in &shapes {
        check(shape, STEPS);
    }
}

/// Without textures, what is stated is the distance and no more.
#[test]
fn first_steps_are_tight() {
    let mut tight = 0;
    for mut shape in [shapes::closed(), shapes::open()].into_iter().flatten() {
        for vertex in shape.vertices.chunks_exact_mut(8) {
            vertex[6..8].fill(0.0);
        }
        let [sampled, ratio] = check(&shape, 8);
        // Smaller ones are not measured exactly: all shapes have a size of about 1 to 50.
        if sampled > 1e-3 {
            tight += 1;
            assert!(ratio < 1.1, "{}: {ratio}", shape.name);
        }
    }
    assert!(tight >= 10, "only {tight} shapes have a distance");
}

#[test]
fn flat_sheets_cost_no_error() {
    let plane = shapes::open().remove(0);
    let levels = levels(&plane);
    let all = levels.facts.triangles.iter().zip(&levels.facts.errors);
    let free: Vec<_> = all.filter(|(_, error)| **error < 1e-4).collect();
    let (triangles, error) = free.last().expect("the finest level");
    assert!(**triangles <= 8 && **error > 0.0, "{:?}", levels.facts);
}

#[test]
fn normals_that_are_nearly_of_unit_length_turn_by_no_angle() {
    for length in [0.9992, 1.0008] {
        let mut plane = shapes::open().remove(0);
        for vertex in plane.vertices.chunks_exact_mut(8) {
            vertex[5] = length;
        }
        let angle = levels(&plane).facts.normal_angle;
        assert!(angle < 1e-6, "{angle} rad of normals that are all alike");
    }
    // Half of them are tilted by less than what a length of 1.0008 would hide.
    let mut tilted = shapes::open().remove(0);
    for (at, vertex) in tilted.vertices.chunks_exact_mut(8).enumerate() {
        let (sin, cos) = (if at % 2 == 0 { 0.03_f32 } else { 0.0 }).sin_cos();
        (vertex[3], vertex[5]) = (1.0008 * sin, 1.0008 * cos);
    }
    let angle = levels(&tilted).facts.normal_angle;
    assert!(angle > 0.01, "{angle} rad");
}
