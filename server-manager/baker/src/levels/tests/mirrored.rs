//! Textures that are mirrored: one half of a surface shows what the other one does.

use std::sync::atomic::AtomicBool;

use glam::{DVec2, DVec3};
use polyptych_scene::VertexLayout;

use super::shapes::{Shape, noise};
use crate::levels::{Surface, build};

const LAYOUT: VertexLayout = VertexLayout { tangent: true, uv0: true, uv1: false, color: false };

/// Numbers of a vertex of this layout, and the place of the bitangent's side among them.
const STRIDE: usize = 12;
const BITANGENT_SIDE: usize = 9;

/// Cells of one half along each side.
const CELLS: u32 = 20;

/// A place of the right half, which has bumps, from 0 to 1 both ways.
fn bump(u: f64, v: f64) -> DVec3 {
    let seed = (u * 977.0) as u32 * 4099 + (v * 977.0) as u32;
    DVec3::new(u, v, 0.02 * noise(seed))
}

/// One half as a sheet whose cells share vertices.
fn connected() -> Shape {
    Shape::new("connected").all([CELLS; 2], bump)
}

/// One half as quads with gaps between them.
fn scattered() -> Shape {
    let mut shape = Shape::new("scattered");
    let share = |at: f64| at / f64::from(CELLS);
    for cell in 0..CELLS * CELLS {
        let [x, y] = [cell % CELLS, cell / CELLS].map(f64::from);
        let corners = [[0.01, 0.01], [0.99, 0.01], [0.01, 0.99], [0.99, 0.99]];
        let [a, b, c, d] = corners.map(|[dx, dy]| {
            let [u, v] = [x + dx, y + dy].map(share);
            shape.vertex(DVec3::new(u, v, bump(share(x), share(y)).z), DVec2::new(u, v))
        });
        shape.indices.extend([a, b, c, b, d, c]);
    }
    shape
}

/// A half and its mirror image on the left, with tangents: vertices and triangles.
fn both_halves(half: &Shape) -> (Vec<f32>, Vec<u32>) {
    let mut vertices = Vec::new();
    for side in [1.0_f32, -1.0] {
        for row in half.vertices.as_chunks::<8>().0 {
            let [x, y, z, normal @ .., u, v] = *row;
            vertices.extend([side * x, y, z]);
            vertices.extend(normal);
            vertices.extend([side, 0.0, 0.0, side, u, v]);
        }
    }
    let mut indices = half.indices.clone();
    let count = half.vertex_count() as u32;
    for [a, b, c] in half.indices.as_chunks::<3>().0 {
        indices.extend([a, c, b].map(|at| at + count));
    }
    (vertices, indices)
}

#[test]
fn no_triangle_has_corners_of_a_texture_and_of_its_mirror_image() {
    for half in [connected(), scattered()] {
        let (vertices, indices) = both_halves(&half);
        let surface = Surface {
            layout: LAYOUT,
            vertices: &vertices,
            indices: &indices,
            keeps_order: false,
            locked: &[],
        };
        let levels = build(&[surface], &AtomicBool::new(false)).expect("not cancelled");
        let levels = levels.into_iter().next().flatten().expect("levels");
        let coarsest = levels.facts.triangles.last().expect("a level");
        assert!(*coarsest < indices.len() as u64 / 6, "{}: {coarsest} triangles", half.name);
        let all = [&vertices[..], &levels.added].concat();
        let side = |vertex: u32| all[vertex as usize * STRIDE + BITANGENT_SIDE];
        for corners in levels.indices.as_chunks::<3>().0 {
            let [a, b, c] = corners.map(side);
            assert!(a == b && b == c, "{}: a triangle across the mirror's line", half.name);
        }
    }
}
