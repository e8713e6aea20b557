//! Surfaces that no one should draw: nothing panics, hangs or is promised wrongly.

use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use glam::{DVec2, DVec3};
use polyptych_scene::meshlet;
use proptest::prelude::*;

use super::shapes::{self, Shape, noise};
use crate::BakeError;
use crate::levels::build;

/// Far more than any of these takes on a slow machine.
const TIME_MAX: Duration = Duration::from_mins(1);

/// Makes the levels, if any, and holds that their format is right.
fn check(shape: &Shape) {
    let begin = Instant::now();
    let levels = build(&[shape.surface()], &AtomicBool::new(false)).expect("not cancelled");
    let levels = levels.into_iter().next().flatten();
    assert!(begin.elapsed() < TIME_MAX, "{}: {:?}", shape.name, begin.elapsed());
    let Some(levels) = levels else { return };
    let [fine, all] = [shape.indices.len(), levels.indices.len()].map(|count| count as u32);
    assert_eq!(meshlet::fault(&levels.meshlets, fine, all), None, "{}", shape.name);
    let vertices = shape.vertex_count() + levels.added.len() / 8;
    assert!(levels.indices.iter().all(|index| (*index as usize) < vertices));
}

fn scaled(mut shape: Shape, factor: f32, offset: f32) -> Shape {
    for vertex in shape.vertices.chunks_exact_mut(8) {
        vertex[..3].iter_mut().for_each(|coordinate| *coordinate = *coordinate * factor + offset);
    }
    shape
}

#[test]
fn huge_tiny_and_distant_surfaces_keep_their_levels() {
    for (factor, offset) in [(1e30, 0.0), (1e-30, 0.0), (1e-40, 0.0), (5e36, 0.0), (1.0, 1e6)] {
        for shape in shapes::closed() {
            check(&scaled(shape, factor, offset));
        }
    }
    let ball = || shapes::closed().remove(0);
    let plain = super::levels(&ball()).facts;
    let scale = 2.0_f32.powi(100);
    let huge = super::levels(&scaled(ball(), scale, 0.0)).facts;
    assert_eq!(huge.triangles, plain.triangles);
    for (huge, plain) in huge.errors.iter().zip(plain.errors) {
        let ratio = huge / f64::from(scale);
        assert!((ratio - plain).abs() <= plain * 1e-6, "{ratio} {plain}");
    }
}

#[test]
fn degenerate_surfaces_do_no_harm() {
    let grid = || shapes::bumpy(20, 20, 7, 0.2);
    let mut point = scaled(grid(), 0.0, 3.0);
    point.name = "one point";
    let mut line = grid();
    line.name = "one line";
    for vertex in line.vertices.chunks_exact_mut(8) {
        vertex[1..3].fill(0.5);
    }
    let mut twice = grid();
    twice.name = "everything twice";
    twice.indices.extend(twice.indices.clone());
    let mut turned = grid();
    turned.name = "both sides";
    let backs: Vec<u32> = turned.indices.iter().rev().copied().collect();
    turned.indices.extend(backs);
    let mut corner = grid();
    corner.name = "triangles of one vertex";
    corner.indices.iter_mut().for_each(|index| *index = *index / 2 * 2 % 11);
    let mut fan = Shape::new("edge of 500 triangles");
    for turn in 0..500 {
        let angle = f64::from(turn);
        let out = DVec3::new(angle.cos(), angle.sin(), noise(turn));
        let corners = [DVec3::ZERO, DVec3::Z, out];
        for at in corners {
            let vertex = fan.vertex(at, DVec2::ZERO);
            fan.indices.push(vertex);
        }
    }
    let mut spike = grid();
    spike.name = "one vertex far away";
    spike.vertices[8 * 210] = 1e30;
    let mut textured = grid();
    textured.name = "wild textures";
    for (seed, vertex) in (0..).zip(textured.vertices.chunks_exact_mut(8)) {
        vertex[6] = 3e38 * noise(seed) as f32;
        vertex[7] = 1e-40;
    }
    for shape in [point, line, twice, turned, corner, fan, spike, textured] {
        check(&shape);
    }
}

#[test]
fn small_surfaces_have_none_and_cancelled_bakes_end() {
    let small = shapes::bumpy(5, 3, 1, 0.1);
    let levels = build(&[small.surface()], &AtomicBool::new(false)).expect("made");
    assert!(matches!(levels.as_slice(), [None]));
    let shape = shapes::bumpy(30, 30, 1, 0.1);
    let end = build(&[shape.surface()], &AtomicBool::new(true));
    assert!(matches!(end, Err(BakeError::Cancelled)));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn random_triangles_do_no_harm(
        points in proptest::collection::vec([-3..3_i8, -3..3_i8, -3..3_i8], 3..60),
        corners in proptest::collection::vec(any::<u16>(), 99..1500),
        exponent in -40..38_i32,
    ) {
        let mut shape = Shape::new("random");
        for point in &points {
            let at = DVec3::from(point.map(f64::from)) * 10.0_f64.powi(exponent);
            shape.vertex(at, DVec2::new(at.x, at.y));
        }
        let index = |corner: &u16| u32::from(*corner) % points.len() as u32;
        shape.indices = corners[..corners.len() / 3 * 3].iter().map(index).collect();
        check(&shape);
    }
}
