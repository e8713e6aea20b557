//! Triangles under construction: a surface has one material, a model has several surfaces.

use std::collections::BTreeMap;

use glam::{Vec2, Vec3, vec2, vec3};

use super::color::{Color, bytes};
use super::material::Material;
use super::trig::sin_cos;

/// Positions are multiples of this many metres: rounding differences between machines vanish, and
/// sums with a block's whole-metre place are exact, so neighbours meet without cracks.
const GRID: f32 = 1.0 / 1024.0;

/// Rounded to the grid.
pub(super) fn on_grid(value: Vec3) -> Vec3 {
    (value / GRID).round() * GRID
}

/// Triangles of one material.
#[derive(Clone, Debug, Default)]
pub(super) struct MeshBuffer {
    pub positions: Vec<Vec3>,
    pub normals: Vec<Vec3>,
    pub uvs: Vec<Vec2>,
    pub colors: Vec<[u8; 4]>,
    pub indices: Vec<u16>,
}

impl MeshBuffer {
    /// Adds a vertex and gives its index.
    pub fn vertex(&mut self, position: Vec3, normal: Vec3, uv: Vec2, color: Color) -> usize {
        self.positions.push(on_grid(position));
        self.normals.push(normal.normalize_or(Vec3::Y));
        self.uvs.push(uv);
        self.colors.push(bytes(color));
        self.positions.len() - 1
    }

    /// Adds a triangle, anticlockwise seen from outside; one without area is left out.
    pub fn triangle(&mut self, corners: [usize; 3]) {
        let [a, b, c] = corners.map(|index| self.positions[index]);
        if (b - a).cross(c - a).length_squared() > 1e-10 {
            self.indices.extend(corners.map(|index| index as u16));
        }
    }

    /// Adds a quadrilateral, anticlockwise seen from outside.
    pub fn quad(&mut self, [a, b, c, d]: [usize; 4]) {
        self.triangle([a, b, c]);
        self.triangle([a, c, d]);
    }
}

/// A box or a place on a wall: `x` to the right, `y` up, `z` out of it, from an origin.
#[derive(Clone, Copy, Debug)]
pub(super) struct LocalFrame {
    pub origin: Vec3,
    pub right: Vec3,
    pub up: Vec3,
    pub out: Vec3,
}

impl LocalFrame {
    /// The model's own axes.
    pub const MODEL: Self = Self { origin: Vec3::ZERO, right: Vec3::X, up: Vec3::Y, out: Vec3::Z };

    /// Upright at `origin`, with `right` × up pointing out.
    pub fn upright(origin: Vec3, right: Vec3) -> Self {
        Self { origin, right, up: Vec3::Y, out: right.cross(Vec3::Y) }
    }

    /// A point given in the frame.
    pub fn point(&self, x: f32, y: f32, z: f32) -> Vec3 {
        self.origin + self.right * x + self.up * y + self.out * z
    }

    /// Returns a frame with the same axes and another origin, given in this frame.
    pub fn moved(&self, x: f32, y: f32, z: f32) -> Self {
        Self { origin: self.point(x, y, z), ..*self }
    }
}

/// The extent of a box in a frame: least and greatest x, y and z.
#[derive(Clone, Copy, Debug)]
pub(super) struct Extent {
    pub x: [f32; 2],
    pub y: [f32; 2],
    pub z: [f32; 2],
}

/// The faces of a box that can never be seen and are left out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Hidden {
    /// All faces can be seen.
    Nothing,
    /// It stands on something.
    Bottom,
    /// It hangs on a wall.
    Back,
    /// It stands before a wall.
    BackAndBottom,
    /// It stands in the ground and under something.
    TopAndBottom,
}

/// Surfaces by material.
#[derive(Clone, Debug, Default)]
pub(super) struct Model {
    pub surfaces: BTreeMap<Material, MeshBuffer>,
}

impl Model {
    /// The surface of a material.
    pub fn of(&mut self, material: Material) -> &mut MeshBuffer {
        self.surfaces.entry(material).or_default()
    }

    /// A flat polygon of three or four corners with a texture laid along `right` and its height.
    pub fn polygon(&mut self, material: Material, corners: &[Vec3], right: Vec3, colors: &[Color]) {
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        let normal = normal.normalize_or(Vec3::Y);
        let down = right.cross(normal);
        let repeat = material.repeat();
        let surface = self.of(material);
        let mut indices = [0; 4];
        for (n, &corner) in corners.iter().enumerate() {
            let uv = vec2(corner.dot(right), corner.dot(down)) / repeat;
            indices[n] = surface.vertex(corner, normal, uv, colors[n.min(colors.len() - 1)]);
        }
        if corners.len() == 3 {
            surface.triangle([indices[0], indices[1], indices[2]]);
        } else {
            surface.quad(indices);
        }
    }

    /// A quadrilateral that shows the whole of its texture once.
    pub fn picture(&mut self, material: Material, corners: [Vec3; 4], color: Color) {
        let normal = (corners[1] - corners[0]).cross(corners[3] - corners[0]);
        let uvs = [vec2(0.0, 1.0), vec2(1.0, 1.0), vec2(1.0, 0.0), vec2(0.0, 0.0)];
        let surface = self.of(material);
        let mut indices = [0; 4];
        for n in 0..4 {
            indices[n] = surface.vertex(corners[n], normal, uvs[n], color);
        }
        surface.quad(indices);
    }

    /// A box in a frame without its hidden faces.
    pub fn cuboid(
        &mut self,
        material: Material,
        frame: &LocalFrame,
        extent: Extent,
        hidden: Hidden,
        color: Color,
    ) {
        let Extent { x, y, z } = extent;
        let p = |i: usize, j: usize, k: usize| frame.point(x[i], y[j], z[k]);
        let front = [p(0, 0, 1), p(1, 0, 1), p(1, 1, 1), p(0, 1, 1)];
        let back = [p(1, 0, 0), p(0, 0, 0), p(0, 1, 0), p(1, 1, 0)];
        let east = [p(1, 0, 1), p(1, 0, 0), p(1, 1, 0), p(1, 1, 1)];
        let west = [p(0, 0, 0), p(0, 0, 1), p(0, 1, 1), p(0, 1, 0)];
        let top = [p(0, 1, 1), p(1, 1, 1), p(1, 1, 0), p(0, 1, 0)];
        let bottom = [p(0, 0, 0), p(1, 0, 0), p(1, 0, 1), p(0, 0, 1)];
        let mut faces = vec![(front, frame.right), (east, -frame.out), (west, frame.out)];
        if matches!(hidden, Hidden::Nothing | Hidden::Bottom | Hidden::TopAndBottom) {
            faces.push((back, -frame.right));
        }
        if hidden != Hidden::TopAndBottom {
            faces.push((top, frame.right));
        }
        if matches!(hidden, Hidden::Nothing | Hidden::Back) {
            faces.push((bottom, frame.right));
        }
        for (corners, right) in faces {
            self.polygon(material, &corners, right, &[color]);
        }
    }

    /// A surface of revolution about a vertical axis through `centre`.
    ///
    /// The profile runs upwards as (radius, height, colour); a radius of 0 closes it.
    pub fn lathe(
        &mut self,
        material: Material,
        centre: Vec3,
        sides: usize,
        profile: &[(f32, f32, Color)],
    ) {
        let outward = |pair: &[(f32, f32, Color)]| {
            vec2(pair[1].1 - pair[0].1, pair[0].0 - pair[1].0).normalize_or(Vec2::X)
        };
        let slopes: Vec<Vec2> = profile.windows(2).map(outward).collect();
        let widest = profile.iter().fold(0.1_f32, |most, ring| most.max(ring.0));
        let around = (std::f32::consts::TAU * widest / material.repeat()).round().max(1.0);
        let surface = self.of(material);
        let mut along = 0.0;
        for (n, pair) in profile.windows(2).enumerate() {
            let length = vec2(pair[1].0 - pair[0].0, pair[1].1 - pair[0].1).length();
            let ends = [along, along + length / material.repeat()];
            along = ends[1];
            let neighbours = [n.checked_sub(1), Some(n + 1)];
            let rings = [0, 1].map(|end| {
                let (radius, height, color) = pair[end];
                let beyond = neighbours[end].and_then(|n| slopes.get(n)).copied();
                let slope = rounded(slopes[n], beyond);
                let ring = |side: usize| {
                    let (sine, cosine) = sin_cos(side as f32 / sides as f32);
                    let normal = vec3(cosine * slope.x, slope.y, -sine * slope.x);
                    let place = centre + vec3(cosine * radius, height, -sine * radius);
                    let uv = vec2(around * side as f32 / sides as f32, -ends[end]);
                    surface.vertex(place, normal, uv, color)
                };
                (0..=sides).map(ring).collect::<Vec<usize>>()
            });
            for side in 0..sides {
                let next = side + 1;
                surface.quad([rings[0][side], rings[0][next], rings[1][next], rings[1][side]]);
            }
        }
    }
}

/// The normal where two parts of a profile meet: their mean, or the part's own at a sharp edge.
fn rounded(own: Vec2, beyond: Option<Vec2>) -> Vec2 {
    match beyond {
        Some(other) if own.dot(other) > 0.6 => (own + other).normalize_or(own),
        _ => own,
    }
}
