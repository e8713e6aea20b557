//! Surfaces that are hard to simplify, each in its own way.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3, Vec3};
use polyptych_scene::VertexLayout;

use crate::levels::Surface;

/// A surface with texture coordinates.
#[derive(Clone, Debug, Default)]
pub(crate) struct Shape {
    pub name: &'static str,
    pub vertices: Vec<f32>,
    pub indices: Vec<u32>,
    pub keeps_order: bool,
}

const LAYOUT: VertexLayout = VertexLayout { tangent: false, uv0: true, uv1: false, color: false };

impl Shape {
    pub(crate) fn new(name: &'static str) -> Self {
        Self { name, ..Self::default() }
    }

    pub(crate) fn surface(&self) -> Surface<'_> {
        Surface {
            layout: LAYOUT,
            vertices: &self.vertices,
            indices: &self.indices,
            keeps_order: self.keeps_order,
            locked: &[],
        }
    }

    pub(crate) fn vertex_count(&self) -> usize {
        self.vertices.len() / 8
    }

    pub(crate) fn vertex(&mut self, position: DVec3, uv: DVec2) -> u32 {
        self.vertices.extend(position.as_vec3().to_array());
        self.vertices.extend([0.0, 0.0, 1.0]);
        self.vertices.extend(uv.as_vec2().to_array());
        self.vertex_count() as u32 - 1
    }

    /// A flat or bent sheet, from 0 to 1 both ways; quads without `keep` are left out.
    fn sheet(
        mut self,
        [columns, rows]: [u32; 2],
        position: impl Fn(f64, f64) -> DVec3,
        keep: impl Fn(u32, u32) -> bool,
    ) -> Self {
        let first = self.vertex_count() as u32;
        for row in 0..=rows {
            for column in 0..=columns {
                let [u, v] =
                    [f64::from(column) / f64::from(columns), f64::from(row) / f64::from(rows)];
                self.vertex(position(u, v), DVec2::new(u, v));
            }
        }
        for row in 0..rows {
            for column in (0..columns).filter(|column| keep(*column, row)) {
                let at = first + row * (columns + 1) + column;
                let below = at + columns + 1;
                self.indices.extend([at, at + 1, below, at + 1, below + 1, below]);
            }
        }
        self
    }

    pub(super) fn all(self, cells: [u32; 2], position: impl Fn(f64, f64) -> DVec3) -> Self {
        self.sheet(cells, position, |_, _| true)
    }

    /// Six sheets around a box, each with normals and texture coordinates of its own.
    pub(super) fn cuboid(mut self, cells: u32, low: DVec3, high: DVec3) -> Self {
        for side in 0..6 {
            let axis = side % 3;
            let place = move |u: f64, v: f64| {
                let mut share = [0.0; 3];
                let [one, two] = if side < 3 { [u, v] } else { [v, u] };
                share[axis] = if side < 3 { 1.0 } else { 0.0 };
                share[(axis + 1) % 3] = one;
                share[(axis + 2) % 3] = two;
                low + (high - low) * DVec3::from(share)
            };
            self = self.all([cells; 2], place);
        }
        self
    }

    /// Normals of triangles, smooth where they share vertices.
    fn lit(mut self) -> Self {
        let position = |vertices: &[f32], at: u32| {
            let at = at as usize * 8;
            Vec3::new(vertices[at], vertices[at + 1], vertices[at + 2]).as_dvec3()
        };
        let mut normals = vec![DVec3::ZERO; self.vertex_count()];
        for corners in self.indices.as_chunks::<3>().0 {
            let [a, b, c] = corners.map(|corner| position(&self.vertices, corner));
            for at in corners {
                normals[*at as usize] += (b - a).cross(c - a);
            }
        }
        for (row, normal) in self.vertices.chunks_exact_mut(8).zip(normals) {
            let normal = normal.normalize_or(DVec3::Z).as_vec3();
            row[3..6].copy_from_slice(&normal.to_array());
        }
        self
    }

    /// The shape with vertices and normals of its own for each triangle.
    fn faceted(self, name: &'static str) -> Self {
        let mut shape = Self::new(name);
        for &index in &self.indices {
            let row = &self.vertices[index as usize * 8..][..8];
            shape.vertices.extend(row);
        }
        shape.indices = (0..self.indices.len() as u32).collect();
        shape.lit()
    }
}

/// A number from -1 to 1 that looks random.
pub(crate) fn noise(seed: u32) -> f64 {
    let mut bits = seed.wrapping_mul(0x9e37_79b9) ^ 0x5bd1_e995;
    for _ in 0..2 {
        bits = (bits ^ (bits >> 15)).wrapping_mul(0x85eb_ca6b);
    }
    f64::from(bits ^ (bits >> 13)) / f64::from(u32::MAX) * 2.0 - 1.0
}

/// A point of a ring: the last is the first, bit for bit.
fn ring(share: f64) -> [f64; 2] {
    let turn = if share >= 1.0 { 0.0 } else { share * TAU };
    [turn.cos(), turn.sin()]
}

fn ball(u: f64, v: f64) -> DVec3 {
    let [x, y] = ring(u);
    let wide = if v <= 0.0 || v >= 1.0 { 0.0 } else { (v * PI).sin() };
    DVec3::new(x * wide, y * wide, (v * PI).cos())
}

fn torus(u: f64, v: f64) -> DVec3 {
    let ([x, y], [out, up]) = (ring(u), ring(v));
    DVec3::new(x * (2.0 + 0.7 * out), y * (2.0 + 0.7 * out), 0.7 * up)
}

fn hills(u: f64, v: f64) -> DVec3 {
    let height = 0.15 * (u * 9.0).sin() * (v * 7.0).cos();
    let seed = (u * 4096.0) as u32 * 8191 + (v * 4096.0) as u32;
    DVec3::new(u * 4.0, v * 4.0, height + 0.01 * noise(seed))
}

/// Returns the closed ones: each edge has a triangle on both sides.
pub(crate) fn closed() -> Vec<Shape> {
    let rough = |u: f64, v: f64| {
        let at = ball(u, v);
        at * (1.0 + 0.1 * (at.x * 7.0).sin() * (at.y * 5.0).cos())
    };
    let knot = |u: f64, v: f64| {
        let ([x, y], [out, up]) = (ring(u), ring(v));
        let [x3, y3] = ring((u * 3.0).fract());
        DVec3::new(x * (2.0 + x3 + 0.3 * out), y * (2.0 + x3 + 0.3 * out), y3 + 0.3 * up)
    };
    vec![
        Shape::new("ball").all([40, 20], ball).lit(),
        Shape::new("rough ball").all([48, 24], rough).lit(),
        Shape::new("torus").all([48, 20], torus).lit(),
        Shape::new("knot").all([90, 10], knot).lit(),
        Shape::new("box").cuboid(12, DVec3::NEG_ONE, DVec3::ONE).lit(),
        Shape::new("plate").cuboid(10, DVec3::ZERO, DVec3::new(4.0, 3.0, 0.02)).lit(),
        Shape::new("beam").cuboid(14, DVec3::ZERO, DVec3::new(50.0, 0.3, 0.2)).lit(),
        Shape::new("torus").all([40, 16], torus).faceted("torus of facets"),
        Shape::new("ball").all([36, 18], rough).faceted("rough ball of facets"),
        town(),
    ]
}

/// Returns those with borders.
pub(crate) fn open() -> Vec<Shape> {
    let plane = |u: f64, v: f64| DVec3::new(u * 3.0, v * 3.0, 0.0);
    let stairs = |u: f64, v: f64| DVec3::new(u, v, (u * 6.0).floor() * 0.2);
    let tube = |u: f64, v: f64| {
        let [x, y] = ring(u);
        DVec3::new(x, y, v * 4.0)
    };
    let strip = |u: f64, v: f64| {
        let ([x, y], half) = (ring(u), u * PI);
        let wide = 1.0 + (v - 0.5) * half.cos();
        DVec3::new(x * wide, y * wide, (v - 0.5) * half.sin())
    };
    let spiral = |u: f64, v: f64| {
        let turn = u * 3.0 * TAU;
        DVec3::new(turn.cos() * (1.0 + u), turn.sin() * (1.0 + u), v)
    };
    let hole = |column: u32, row: u32| column.abs_diff(14) > 4 || row.abs_diff(12) > 3;
    let holes = |column: u32, row: u32| column % 5 != 2 || row % 5 != 2;
    vec![
        Shape::new("plane").all([24, 24], plane).lit(),
        Shape::new("plane with a hole").sheet([28, 24], plane, hole).lit(),
        Shape::new("hills").all([32, 32], hills).lit(),
        Shape::new("hills with holes").sheet([30, 30], hills, holes).lit(),
        Shape::new("hills").all([24, 24], hills).faceted("hills of facets"),
        Shape::new("stairs").all([36, 12], stairs).lit(),
        Shape::new("tube").all([32, 20], tube).lit(),
        Shape::new("moebius strip").all([80, 8], strip).lit(),
        Shape::new("spiral").all([90, 8], spiral).lit(),
        Shape::new("two sheets")
            .all([20, 20], plane)
            .all([20, 20], |u, v| plane(u, v) + DVec3::new(0.0, 0.0, 0.001 + 0.05 * u * v))
            .lit(),
        crossing_sheets(),
        bricks(),
        soup(),
    ]
}

/// Boxes of several sizes, none of which touches another.
fn town() -> Shape {
    let mut shape = Shape::new("town of boxes");
    for house in 0..25 {
        let low = DVec3::new(f64::from(house % 5), f64::from(house / 5), 0.0);
        let size = DVec3::new(0.5, 0.6, 0.9 + 0.8 * noise(house));
        shape = shape.cuboid(2, low, low + size);
    }
    shape.lit()
}

/// A wall of bricks with gaps between them: quads that share no vertex, some in front of others.
fn bricks() -> Shape {
    let mut shape = Shape::new("bricks");
    for brick in 0..240 {
        let (column, row) = (brick % 20, brick / 20);
        let low =
            DVec3::new(f64::from(column) + 0.5 * f64::from(row % 2), f64::from(row) * 0.5, 0.0);
        let depth = 0.02 * noise(brick);
        let place = move |u: f64, v: f64| low + DVec3::new(u * 0.97, v * 0.47, depth);
        shape = shape.all([1, 1], place);
    }
    shape.lit()
}

/// Three sheets with one common line: edges of six triangles.
fn crossing_sheets() -> Shape {
    let mut shape = Shape::new("crossing sheets");
    for turn in 0..3 {
        let [x, y] = ring(f64::from(turn) / 6.0);
        shape = shape.all([12, 12], |u, v| DVec3::new(x * (u - 0.5), y * (u - 0.5), v));
    }
    shape.lit()
}

/// Triangles without neighbours.
fn soup() -> Shape {
    let mut shape = Shape::new("soup");
    for triangle in 0..600 {
        let middle = DVec3::from_array([0, 1, 2].map(|axis| 3.0 * noise(triangle * 3 + axis)));
        for corner in 0..3 {
            let seed = 9000 + triangle * 9 + corner * 3;
            let out = DVec3::from_array([0, 1, 2].map(|axis| 0.2 * noise(seed + axis)));
            let at = shape.vertex(middle + out, DVec2::new(out.x, out.y));
            shape.indices.push(at);
        }
    }
    shape.lit()
}

/// Returns a closed surface of many groups of meshlets.
pub(crate) fn large_torus() -> Shape {
    Shape::new("large torus").all([128, 64], torus).lit()
}

/// Returns a sheet with random heights.
pub(crate) fn bumpy(columns: u32, rows: u32, seed: u32, height: f64) -> Shape {
    let bump = |u: f64, v: f64| {
        let at = (u * 977.0) as u32 * 4099 + (v * 977.0) as u32;
        DVec3::new(u * 3.0, v * 2.0, height * noise(seed ^ at))
    };
    Shape::new("bumpy sheet").all([columns, rows], bump).lit()
}
