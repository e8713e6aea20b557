//! Meshes from arrays, and the shapes that are made most often.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3, Vec4};
use polyptych_scene::Topology;

/// A mesh as arrays, in metres of the node that shows it. What is empty is left out; what is not
/// has an entry for each position.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshData {
    /// One for each vertex.
    pub positions: Vec<Vec3>,
    /// Unit vectors. Without them a triangle is lit as flat.
    pub normals: Vec<Vec3>,
    /// Texture coordinates; 0, 0 is the upper left corner of a picture.
    pub uvs: Vec<Vec2>,
    /// Linear RGBA from 0 to 1, times the material's base colour.
    pub colors: Vec<Vec4>,
    /// Three for each triangle, counter-clockwise from its front, two for each line, or one for
    /// each point. Without them the vertices are taken in their order.
    pub indices: Vec<u32>,
    /// The shape that indices make; lines and points are one pixel wide.
    pub topology: Topology,
}

impl Default for MeshData {
    /// Triangles, of which there are none.
    fn default() -> Self {
        Self {
            positions: Vec::new(),
            normals: Vec::new(),
            uvs: Vec::new(),
            colors: Vec::new(),
            indices: Vec::new(),
            topology: Topology::Triangles,
        }
    }
}

/// Sides of what is round: its outline is then within 0.03 % of its diameter.
const SIDES: u32 = 64;

impl MeshData {
    /// A box around the origin, with these lengths of its edges.
    pub fn cuboid(size: Vec3) -> Self {
        let mut mesh = Self::default();
        for axis in 0..3 {
            for sign in [-1.0f32, 1.0] {
                let mut normal = Vec3::ZERO;
                normal[axis] = sign;
                let mut right = Vec3::ZERO;
                right[(axis + 1) % 3] = sign;
                let up = normal.cross(right);
                mesh.add_face(normal * size * 0.5, right * size * 0.5, up * size * 0.5);
            }
        }
        mesh
    }

    /// A rectangle around the origin, seen from +Z: `size` is its width and height.
    pub fn rectangle(size: Vec2) -> Self {
        let mut mesh = Self::default();
        mesh.add_face(Vec3::ZERO, Vec3::X * size.x * 0.5, Vec3::Y * size.y * 0.5);
        mesh
    }

    /// A sphere around the origin.
    pub fn sphere(radius: f32) -> Self {
        let rows = SIDES / 2;
        Self::grid(SIDES, rows, |u, v| {
            let (sin, cos) = (v * PI).sin_cos();
            let normal = Vec3::new(sin * (u * TAU).sin(), cos, sin * (u * TAU).cos());
            (normal * radius, normal)
        })
    }

    /// A closed cylinder around the Y axis, from −`height`/2 to `height`/2.
    pub fn cylinder(radius: f32, height: f32) -> Self {
        Self::cone(radius, radius, height)
    }

    /// A closed frustum of a cone around the Y axis, from −`height`/2, with the radius `low`, to
    /// `height`/2, with the radius `high`. A `high` of 0 makes a cone.
    pub fn cone(low: f32, high: f32, height: f32) -> Self {
        let slope = Vec2::new(height, low - high).normalize_or(Vec2::X);
        let around = |u: f32| Vec3::new((u * TAU).sin(), 0.0, (u * TAU).cos());
        let mut mesh = Self::grid(SIDES, 1, |u, v| {
            let y = height * (0.5 - v);
            let position = around(u) * (high + (low - high) * v) + Vec3::Y * y;
            (position, around(u) * slope.x + Vec3::Y * slope.y)
        });
        for (radius, side) in [(high, 1.0f32), (low, -1.0)] {
            let middle = mesh.positions.len() as u32;
            mesh.push(Vec3::Y * side * height * 0.5, Vec3::Y * side, Vec2::splat(0.5));
            for at in 0..=SIDES {
                let out = around(at as f32 / SIDES as f32);
                let uv = Vec2::splat(0.5) + Vec2::new(out.x, out.z * side) * 0.5;
                mesh.push(out * radius + Vec3::Y * side * height * 0.5, Vec3::Y * side, uv);
            }
            for at in 0..SIDES {
                let (one, two) = (middle + 1 + at, middle + 2 + at);
                mesh.indices.extend(if side > 0.0 {
                    [middle, one, two]
                } else {
                    [middle, two, one]
                });
            }
        }
        mesh
    }

    /// A line through these points.
    pub fn polyline(points: &[Vec3]) -> Self {
        let ends = 1..points.len() as u32;
        let indices = ends.flat_map(|end| [end - 1, end]).collect();
        Self { positions: points.to_vec(), indices, topology: Topology::Lines, ..Self::default() }
    }

    /// Points by themselves.
    pub fn points(points: &[Vec3]) -> Self {
        Self { positions: points.to_vec(), topology: Topology::Points, ..Self::default() }
    }

    /// Returns the mesh with one colour for all vertices, linear RGBA.
    #[must_use]
    pub fn with_color(self, color: Vec4) -> Self {
        Self { colors: vec![color; self.positions.len()], ..self }
    }

    fn push(&mut self, position: Vec3, normal: Vec3, uv: Vec2) {
        self.positions.push(position);
        self.normals.push(normal);
        self.uvs.push(uv);
    }

    /// A rectangle around `middle`, with half of its width and height.
    fn add_face(&mut self, middle: Vec3, right: Vec3, up: Vec3) {
        let (first, normal) = (self.positions.len() as u32, right.cross(up).normalize_or_zero());
        for (x, y) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
            let uv = Vec2::new(0.5 + x * 0.5, 0.5 - y * 0.5);
            self.push(middle + right * x + up * y, normal, uv);
        }
        self.indices.extend([0, 1, 2, 0, 2, 3].map(|corner| first + corner));
    }

    /// A surface over the unit square, whose rows go down: position and normal of each point.
    fn grid(columns: u32, rows: u32, at: impl Fn(f32, f32) -> (Vec3, Vec3)) -> Self {
        let mut mesh = Self::default();
        for row in 0..=rows {
            for column in 0..=columns {
                let (u, v) = (column as f32 / columns as f32, row as f32 / rows as f32);
                let (position, normal) = at(u, v);
                mesh.push(position, normal, Vec2::new(u, v));
            }
        }
        for row in 0..rows {
            for column in 0..columns {
                let upper = row * (columns + 1) + column;
                let lower = upper + columns + 1;
                mesh.indices.extend([upper, lower, lower + 1, upper, lower + 1, upper + 1]);
            }
        }
        mesh
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Six times the volume that a closed mesh of triangles encloses, by the divergence theorem.
    fn volume(mesh: &MeshData) -> f32 {
        let corner = |index: &u32| mesh.positions[*index as usize];
        let triangles = mesh.indices.chunks_exact(3);
        triangles.map(|t| corner(&t[0]).dot(corner(&t[1]).cross(corner(&t[2])))).sum::<f32>() / 6.0
    }

    #[test]
    fn shapes_are_closed_and_seen_from_outside() {
        let shapes = [
            ("box", MeshData::cuboid(Vec3::new(1.0, 2.0, 3.0)), 6.0),
            ("sphere", MeshData::sphere(0.5), PI / 6.0),
            ("cylinder", MeshData::cylinder(0.5, 2.0), PI / 2.0),
            ("cone", MeshData::cone(1.0, 0.0, 3.0), PI),
        ];
        for (name, mesh, wanted) in shapes {
            let got = volume(&mesh);
            assert!((got - wanted).abs() < 0.01 * wanted, "{name}: {got}, where {wanted} is right");
            assert_eq!(mesh.positions.len(), mesh.normals.len(), "{name}");
            for t in mesh.indices.chunks_exact(3) {
                let [a, b, c] = [t[0], t[1], t[2]].map(|at| mesh.positions[at as usize]);
                let normal = (b - a).cross(c - a);
                let lit: Vec3 = t.iter().map(|at| mesh.normals[*at as usize]).sum();
                // The poles of a sphere have triangles without area.
                assert!(normal.length() < 1e-6 || normal.dot(lit) > 0.0, "{name}");
            }
            assert!(mesh.normals.iter().all(|normal| normal.is_normalized()), "{name}");
        }
    }

    #[test]
    fn a_line_has_a_part_less_than_points() {
        let points = [Vec3::ZERO, Vec3::X, Vec3::Y];
        assert_eq!(MeshData::polyline(&points).indices, [0, 1, 1, 2]);
        assert_eq!(MeshData::polyline(&points[..1]).indices, [0; 0]);
        assert_eq!(MeshData::points(&points).with_color(Vec4::ONE).colors.len(), 3);
    }
}
