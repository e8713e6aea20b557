//! Colours of vertices: a coarser level states how far they slide.

use std::sync::atomic::AtomicBool;

use glam::{DVec2, DVec3};
use polyptych_scene::VertexLayout;

use super::shapes::Shape;
use crate::levels::{Levels, Surface, build};

const LAYOUT: VertexLayout = VertexLayout { tangent: false, uv0: false, uv1: false, color: true };

/// Cells along each side.
const CELLS: u32 = 60;

/// The levels of a flat sheet of 60 × 60 m, white but for a red band of this width in cells.
fn banded(width: u32) -> (Levels, Vec<bool>) {
    let (mut vertices, mut indices, mut is_red) = (Vec::new(), Vec::new(), Vec::new());
    for row in 0..=CELLS {
        for column in 0..=CELLS {
            let red = (20..20 + width).contains(&column);
            let other = if red { 0.0 } else { 1.0 };
            vertices.extend([
                column as f32,
                row as f32,
                0.0,
                0.0,
                0.0,
                1.0,
                1.0,
                other,
                other,
                1.0,
            ]);
            is_red.push(red);
        }
    }
    for row in 0..CELLS {
        for column in 0..CELLS {
            let at = row * (CELLS + 1) + column;
            let below = at + CELLS + 1;
            indices.extend([at, at + 1, below, at + 1, below + 1, below]);
        }
    }
    let surface = Surface {
        layout: LAYOUT,
        vertices: &vertices,
        indices: &indices,
        keeps_order: false,
        locked: &[],
    };
    let levels = build(&[surface], &AtomicBool::new(false)).expect("not cancelled");
    (levels.into_iter().next().flatten().expect("levels"), is_red)
}

/// The vertices that are drawn at an allowed error.
fn drawn(levels: &Levels, limit: f32) -> Vec<u32> {
    let is_drawn =
        levels.meshlets.iter().filter(|of| of.error <= limit && of.coarser_error > limit);
    let run = is_drawn.flat_map(|of| {
        let first = of.first_index as usize;
        &levels.indices[first..first + of.index_count as usize]
    });
    run.copied().collect()
}

#[test]
fn a_band_is_drawn_until_the_error_is_as_wide() {
    let (plain, _) = banded(0);
    assert!(drawn(&plain, 0.01).len() < 300, "{} corners", drawn(&plain, 0.01).len());
    let (levels, is_red) = banded(8);
    for limit in [0.01, 0.5, 1.0, 2.0] {
        let corners = drawn(&levels, limit);
        let rows = |row: std::ops::Range<u32>| {
            let mut corners = corners.iter().filter(|at| row.contains(&(**at / (CELLS + 1))));
            corners.any(|at| is_red[*at as usize])
        };
        assert!(rows(0..20) && rows(41..61), "the band is not whole at {limit} m");
    }
    let all = levels.meshlets.iter().map(|of| of.error).fold(0.0, f32::max);
    assert!(all > 4.0, "the band is gone for {all} m");
}

/// A palette has one place of a texture for each face: its area there is none.
#[test]
fn tiles_of_a_palette_keep_their_colours() {
    let mut mosaic = Shape::new("mosaic");
    let tile_of = |vertex: u32| [vertex / 4 % 24, vertex / 4 / 24];
    let texel = |vertex: u32| {
        let [x, y] = tile_of(vertex);
        (x * 7 + y * 5 + x * y) % 16
    };
    for tile in 0..24 * 24 {
        let [x, y] = tile_of(4 * tile).map(f64::from);
        let uv = DVec2::new(f64::from(texel(4 * tile)) / 16.0, 0.5);
        let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
        let [a, b, c, d] =
            corners.map(|[dx, dy]| mosaic.vertex(DVec3::new(x + dx, y + dy, 0.0), uv));
        mosaic.indices.extend([a, b, c, b, d, c]);
    }
    let levels = build(&[mosaic.surface()], &AtomicBool::new(false)).expect("not cancelled");
    let levels = levels.into_iter().next().flatten().expect("levels");
    for limit in [0.001, 0.25] {
        let corners = drawn(&levels, limit);
        let triangles = corners.as_chunks::<3>().0;
        let is_mixed = |of: &&[u32; 3]| of.iter().any(|at| texel(*at) != texel(of[0]));
        assert_eq!(triangles.iter().filter(is_mixed).count(), 0, "{limit} m");
        assert!(triangles.len() > 500, "{} triangles at {limit} m", triangles.len());
    }
}
