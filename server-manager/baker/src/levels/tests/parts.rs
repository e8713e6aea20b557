//! Meshes of several surfaces with parts of different sizes.

use std::sync::atomic::AtomicBool;

use glam::DVec3;

use super::Drawn;
use super::distance::sampled;
use super::shapes::Shape;
use crate::levels::{Levels, build};

/// Sides of the tower's ground plan and its height, in metres.
const TOWER: DVec3 = DVec3::new(12.0, 30.0, 12.0);

/// Triangles that may be left of 864: a sliver of a part may stay where it grew into another one.
const FEW: usize = 16;

/// A box from its lower left corner on the front of the tower, which it looks out of by its depth.
fn on_front(shape: Shape, [x, y]: [f64; 2], [width, height, depth]: [f64; 3]) -> Shape {
    let low = DVec3::new(x, y, TOWER.z - 0.05);
    shape.cuboid(1, low, low + DVec3::new(width, height, depth + 0.05))
}

/// The tower, its 60 sills of 1 m by 0.1 m, and its 12 boards of 0.8 m by 2 m.
fn tower() -> [Shape; 3] {
    let walls = Shape::new("walls").cuboid(2, DVec3::ZERO, TOWER);
    let sills = (0..60).fold(Shape::new("sills"), |sills, at| {
        let place = [1.0 + 1.7 * f64::from(at % 6), 1.0 + 2.8 * f64::from(at / 6)];
        on_front(sills, place, [1.0, 0.1, 0.1])
    });
    let boards = (0..12).fold(Shape::new("boards"), |boards, at| {
        let place = [0.5 + 2.9 * f64::from(at % 4), 1.5 + 8.4 * f64::from(at / 4)];
        on_front(boards, place, [0.8, 2.0, 0.1])
    });
    [walls, sills, boards]
}

/// What each surface shows at an allowed error.
fn shown(shapes: &[Shape; 3], levels: &[Option<Levels>], limit: f32) -> [Vec<[DVec3; 3]>; 3] {
    [0, 1, 2].map(|at| {
        let levels = levels[at].as_ref().expect("levels of every surface");
        Drawn::within(&shapes[at], levels, limit).triangles
    })
}

#[test]
fn narrow_parts_go_by_their_width() {
    let shapes = tower();
    let surfaces = [0, 1, 2].map(|at: usize| shapes[at].surface());
    let levels = build(&surfaces, &AtomicBool::new(false)).expect("not cancelled");
    let counts = |limit| shown(&shapes, &levels, limit).map(|surface| surface.len());
    // A sill is as wide as the diagonal of its cross section: 0.18 m.
    assert_eq!(counts(0.1)[1], 60 * 12, "sills are wider than 0.1 m");
    let [_, sills, boards] = counts(0.25);
    assert!(sills <= FEW, "{sills} triangles of sills, none of which is wider than 0.25 m");
    // A board is 0.8 m wide: all are there at half of that, by their outlines at least.
    let boards_left = counts(0.4)[2].min(boards);
    assert!(boards_left >= 12 * 2, "boards are wider than 0.4 m: {boards_left} triangles");
    let [_, sills, boards] = counts(1.2);
    assert!(sills + boards <= FEW, "{sills} and {boards} triangles that are not wider than 1.2 m");
}

#[test]
fn several_surfaces_together_are_no_farther_off_than_they_say() {
    let shapes = tower();
    let surfaces = [0, 1, 2].map(|at: usize| shapes[at].surface());
    let levels = build(&surfaces, &AtomicBool::new(false)).expect("not cancelled");
    let finest = shown(&shapes, &levels, 0.0).concat();
    for limit in [0.1, 0.25, 0.4, 1.2, 3.0] {
        let drawn = shown(&shapes, &levels, limit).concat();
        let off = sampled(&finest, &drawn, 6).max(sampled(&drawn, &finest, 6));
        assert!(off <= f64::from(limit), "{off} m off where {limit} m are allowed");
    }
}

#[test]
fn a_mesh_of_a_thousand_surfaces_has_levels() {
    let wall = Shape::new("wall").cuboid(6, DVec3::ZERO, TOWER);
    let boards: Vec<Shape> = (0..1000)
        .map(|at| {
            let place = [0.2 + 0.3 * f64::from(at % 36), 0.5 + 0.9 * f64::from(at / 36)];
            let low = DVec3::new(place[0], place[1], TOWER.z + 0.02);
            Shape::new("board").all([1, 1], |u, v| low + DVec3::new(0.2 * u, 0.5 * v, 0.0))
        })
        .collect();
    let surfaces: Vec<_> = std::iter::once(&wall).chain(&boards).map(Shape::surface).collect();
    let levels = build(&surfaces, &AtomicBool::new(false)).expect("not cancelled");
    let shown = |limit: f32| -> usize {
        let shapes = std::iter::once(&wall).chain(&boards).zip(&levels);
        shapes
            .map(|(shape, levels)| match levels {
                Some(levels) => Drawn::within(shape, levels, limit).triangles.len(),
                None => shape.indices.len() / 3,
            })
            .sum()
    };
    assert!(shown(1.0) * 10 < shown(0.0), "{} of {} triangles", shown(1.0), shown(0.0));
}

#[test]
fn shingles_that_cover_a_wall_stay() {
    let walls = Shape::new("walls").cuboid(2, DVec3::ZERO, TOWER);
    // Two materials in turn: what one leaves open the other one covers.
    let shingles = [0, 1].map(|first: usize| {
        (0..300).filter(|at| (at / 10 + at % 10) % 2 == first).fold(
            Shape::new("shingles"),
            |shingles, at| {
                let place = [0.01 + 1.2 * (at % 10) as f64, (at / 10) as f64];
                on_front(shingles, place, [1.18, 0.98, 0.02])
            },
        )
    });
    let [light, dark] = shingles;
    let shapes = [walls, light, dark];
    let surfaces = [0, 1, 2].map(|at: usize| shapes[at].surface());
    let levels = build(&surfaces, &AtomicBool::new(false)).expect("not cancelled");
    // What the front shows of shingles, in square metres.
    let covered = |limit| {
        let [_, light, dark] = shown(&shapes, &levels, limit);
        let areas = light.iter().chain(&dark).map(|[a, b, c]| (*b - *a).cross(*c - *a).z / 2.0);
        areas.map(|area| area.max(0.0)).sum::<f64>()
    };
    // Each is 1 m wide, and all are as wide as the tower. Some may go where others of
    // the material are near.
    let (finest, left) = (covered(0.0), covered(1.2));
    assert!(left > 0.5 * finest, "{left} of {finest} m² of shingles are left");
}
