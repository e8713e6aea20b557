//! Colours of vertices: a coarser level states how far they slide.

use std::sync::atomic::AtomicBool;

use polyptych_scene::VertexLayout;

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
