//! A mesh of several surfaces with parts of different sizes: the small ones go first, and nothing
//! else changes for them.

use std::sync::atomic::AtomicBool;

use glam::DVec3;

use super::Drawn;
use super::shapes::Shape;
use crate::levels::{Levels, build};

/// Sides of the tower's ground plan and its height, in metres.
const TOWER: DVec3 = DVec3::new(12.0, 30.0, 12.0);

/// What may be left of 864 triangles: some that a sliver goes on to hang on.
const FEW: usize = 8;

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

/// Triangles that each surface shows at an allowed error.
fn shown(shapes: &[Shape; 3], levels: &[Option<Levels>], limit: f32) -> [usize; 3] {
    [0, 1, 2].map(|at| match &levels[at] {
        Some(levels) => Drawn::within(&shapes[at], levels, limit).triangles.len(),
        None => shapes[at].indices.len() / 3,
    })
}

#[test]
fn thin_parts_go_before_anything_else_changes() {
    let shapes = tower();
    let surfaces = [0, 1, 2].map(|at: usize| shapes[at].surface());
    let levels = build(&surfaces, &AtomicBool::new(false)).expect("not cancelled");
    let [walls, _, boards] = shown(&shapes, &levels, 0.0);
    // A sill is as wide as the diagonal of its cross section: 0.18 m.
    assert_eq!(shown(&shapes, &levels, 0.1)[1], 60 * 12, "sills are wider than 0.1 m");
    let [walls_after, sills, boards_after] = shown(&shapes, &levels, 0.25);
    assert!(sills <= FEW, "{sills} triangles of sills, none of which is wider than 0.25 m");
    assert!(walls_after <= walls && boards_after > 0, "{boards_after} triangles of boards");
    assert!(boards_after <= boards);
    // A board is 0.8 m wide: all are there at half of that, by their outlines at least.
    let boards_left = shown(&shapes, &levels, 0.4)[2];
    assert!(boards_left >= 12 * 2, "boards are wider than 0.4 m: {boards_left} triangles");
    let [_, sills, boards] = shown(&shapes, &levels, 1.2);
    assert!(sills + boards <= FEW, "{sills} and {boards} triangles that are not wider than 1.2 m");
}
