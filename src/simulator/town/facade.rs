//! The textures of houses: plaster, brick, cut stone, roof tiles, timber and windows.

use glam::{Vec3, vec3};

use super::canvas::{Canvas, Texel, cloud, noise};
use super::heightfield::smooth;
use super::random::lattice;

const SIDE: u32 = 256;

/// The position of a point in a bond of bricks: the brick, and the distance in from its edge in
/// rows.
struct Bond {
    brick: [i32; 2],
    inset: f32,
}

/// `columns` × `rows` bricks to the picture, every second row moved by half a brick.
fn bond(u: f32, v: f32, columns: i32, rows: i32) -> Bond {
    let y = v * rows as f32;
    let row = y.floor() as i32;
    let x = u * columns as f32 + 0.5 * (row & 1) as f32;
    let column = x.floor() as i32;
    let (s, t) = (x - x.floor(), y - y.floor());
    let shape = rows as f32 / columns as f32;
    let inset = t.min(1.0 - t).min(s.min(1.0 - s) * shape);
    Bond { brick: [column.rem_euclid(columns), row], inset }
}

/// Lime plaster: nearly white, to be tinted by vertices; trowel marks and faint stains.
pub(super) fn plaster() -> Canvas {
    Canvas::paint(SIDE, |u, v| {
        let broad = cloud(u, v, 4, 11);
        let fine = cloud(u, v, 32, 21);
        let tone = 0.84 + 0.10 * broad + 0.06 * (fine - 0.5);
        let stain = smooth((cloud(u, v, 3, 31) - 0.55) * 4.0) * 0.06;
        Texel {
            height: 1.5 * fine + 2.2 * broad,
            roughness: 0.86 + 0.1 * fine,
            occlusion: 0.9 + 0.1 * broad,
            ..Texel::flat(vec3(tone, tone - stain * 0.5, tone - stain))
        }
    })
}

/// Red-brown brick in a running bond, 8 × 24 to the picture.
pub(super) fn brick() -> Canvas {
    Canvas::paint(SIDE, |u, v| {
        let Bond { brick: [column, row], inset } = bond(u, v, 8, 24);
        let grain = cloud(u, v, 48, 41);
        let face = smooth((inset - 0.05) / 0.09);
        let tone = lattice(42, column, row);
        let warm =
            vec3(0.60, 0.34, 0.25).lerp(vec3(0.76, 0.48, 0.36), tone) * (0.88 + 0.24 * grain);
        let mortar = vec3(0.75, 0.71, 0.65) * (0.9 + 0.15 * grain);
        Texel {
            height: 1.6 * face + 0.8 * grain,
            roughness: 0.95 - 0.15 * face * tone,
            occlusion: 0.72 + 0.28 * face,
            ..Texel::flat(mortar.lerp(warm, face))
        }
    })
}

/// Cut stone in courses, 3 × 6 to the picture, to be tinted by vertices.
pub(super) fn stone() -> Canvas {
    Canvas::paint(SIDE, |u, v| {
        let Bond { brick: [column, row], inset } = bond(u, v, 3, 6);
        let grain = cloud(u, v, 16, 51);
        let face = smooth((inset - 0.015) / 0.06);
        let tone = 0.80 + 0.13 * lattice(52, column, row) + 0.20 * (grain - 0.5);
        let warm = vec3(1.0, 0.97, 0.91 + 0.05 * lattice(53, column, row));
        Texel {
            height: 3.0 * face + 4.0 * grain,
            roughness: 0.82 + 0.12 * grain,
            occlusion: 0.62 + 0.38 * face,
            ..Texel::flat(warm * (tone * (0.62 + 0.38 * face)))
        }
    })
}

/// Half-round roof tiles, 8 × 8 to the picture, each course lying over the one below; to be tinted
/// by vertices.
pub(super) fn tiles() -> Canvas {
    Canvas::paint(SIDE, |u, v| {
        let (x, y) = (u * 8.0, v * 8.0);
        let (column, row) = (x.floor(), y.floor());
        let (s, t) = (x - column, y - row);
        let arch = 1.0 - (2.0 * s - 1.0) * (2.0 * s - 1.0);
        let tone = lattice(61, column as i32, row as i32);
        let lip = smooth(t / 0.14);
        let shade = 0.70 + 0.16 * tone + 0.08 * (cloud(u, v, 24, 62) - 0.5);
        let hue = vec3(1.0, 0.96 - 0.06 * tone, 0.93 - 0.09 * tone);
        let depth = (0.45 + 0.55 * smooth(arch * 1.5)) * (0.6 + 0.4 * lip);
        Texel {
            height: 7.0 * arch * (0.75 + 0.25 * t) + 3.0 * t * lip,
            roughness: 0.78 + 0.12 * tone,
            occlusion: depth,
            ..Texel::flat(hue * shade * (0.45 + 0.55 * depth))
        }
    })
}

/// Painted planks, 6 to the picture, upright; to be tinted by vertices.
pub(super) fn timber() -> Canvas {
    Canvas::paint(128, |u, v| {
        let x = u * 6.0;
        let s = x - x.floor();
        let gap = smooth((s.min(1.0 - s) - 0.02) / 0.06);
        let grain = noise(u, v, 64, 71) * 0.5 + noise(u * 8.0, v, 8, 72) * 0.5;
        let tone = 0.80 + 0.12 * lattice(73, x.floor() as i32, 0) + 0.12 * (grain - 0.5);
        Texel {
            height: 2.0 * gap + 0.6 * grain,
            roughness: 0.62 + 0.2 * grain,
            occlusion: 0.6 + 0.4 * gap,
            ..Texel::flat(Vec3::splat(tone * (0.5 + 0.5 * gap)))
        }
    })
}

/// One window: a cream frame, two wings of three panes, and glass with a hint of curtain and sky.
pub(super) fn window() -> Canvas {
    Canvas::paint(128, |u, v| {
        let wing = (u * 2.0) - (u * 2.0).floor();
        let pane = (v * 3.0) - (v * 3.0).floor();
        let rim = u.min(1.0 - u).min(v.min(1.0 - v));
        let framed = rim < 0.07 || !(0.08..=0.92).contains(&wing) || !(0.06..=0.94).contains(&pane);
        if framed {
            let edge = smooth(rim / 0.05);
            return Texel {
                height: 2.0,
                roughness: 0.55,
                occlusion: 0.7 + 0.3 * edge,
                ..Texel::flat(vec3(0.90, 0.87, 0.80) * (0.8 + 0.2 * edge))
            };
        }
        let curtain = smooth((0.40 - (u - 0.5).abs() * 0.2 - v * 0.62) * 6.0);
        let curtain = curtain * (0.7 + 0.3 * noise(u, 0.3, 24, 81));
        let sky = vec3(0.17, 0.23, 0.28).lerp(vec3(0.34, 0.45, 0.52), 1.0 - v);
        Texel {
            height: 0.0,
            roughness: 0.12,
            occlusion: 0.85,
            ..Texel::flat(sky.lerp(vec3(0.66, 0.62, 0.55), curtain * 0.55))
        }
    })
}
