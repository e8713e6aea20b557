//! Trees: four kinds, drawn as instances of shared meshes.

use glam::{Vec2, Vec3, vec2, vec3};

use super::color::{Color, srgb};
use super::material::Material;
use super::random::{Random, lattice};
use super::surface::Model;
use super::trig::{about_up, sin_cos};

/// The kinds of trees.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Tree {
    /// A round crown of closed geometry.
    Plane,
    /// Tall and narrow.
    Cypress,
    /// A crown of leaf cards, cut out by their texture.
    Olive,
    /// A flat crown on a high trunk.
    Pine,
}

impl Tree {
    /// Every kind, in the order of their meshes.
    pub const ALL: [Self; 4] = [Self::Plane, Self::Cypress, Self::Olive, Self::Pine];

    /// The name of its mesh.
    pub fn name(self) -> &'static str {
        match self {
            Self::Plane => "tree-plane",
            Self::Cypress => "tree-cypress",
            Self::Olive => "tree-olive",
            Self::Pine => "tree-pine",
        }
    }

    /// The tree, rooted at the origin.
    pub fn model(self) -> Model {
        let mut model = Model::default();
        match self {
            Self::Plane => {
                trunk(&mut model, 0.26, 3.0);
                let green = srgb(0x8fa855);
                blob(&mut model, vec3(0.0, 4.6, 0.0), vec3(2.3, 2.1, 2.3), green, 1);
                blob(&mut model, vec3(1.1, 3.7, 0.7), vec3(1.5, 1.3, 1.5), green * 0.92, 2);
            }
            Self::Cypress => {
                trunk(&mut model, 0.16, 1.0);
                cypress(&mut model);
            }
            Self::Olive => {
                trunk(&mut model, 0.22, 2.6);
                cards(&mut model);
            }
            Self::Pine => {
                trunk(&mut model, 0.24, 6.4);
                let green = srgb(0x749652);
                blob(&mut model, vec3(0.0, 7.1, 0.0), vec3(3.0, 1.15, 3.0), green, 3);
            }
        }
        model
    }
}

fn trunk(model: &mut Model, radius: f32, height: f32) {
    let bark = srgb(0x8a7058);
    let profile = [
        (radius * 1.5, -0.8, bark * 0.6),
        (radius * 1.3, 0.1, bark * 0.7),
        (radius * 0.75, height, bark),
    ];
    model.lathe(Material::Timber, Vec3::ZERO, 5, &profile);
}

fn cypress(model: &mut Model) {
    let green = srgb(0x5f864c);
    let profile = [
        (0.30, 0.55, green * 0.45),
        (0.85, 1.5, green * 0.7),
        (0.98, 3.2, green * 0.9),
        (0.72, 5.4, green),
        (0.34, 7.2, green * 1.1),
        (0.0, 8.5, green * 1.2),
    ];
    model.lathe(Material::Foliage, Vec3::ZERO, 8, &profile);
}

/// An icosahedron whose faces are split in four, on an ellipsoid, with dents.
fn blob(model: &mut Model, centre: Vec3, radii: Vec3, color: Color, seed: u64) {
    let (points, faces) = icosphere();
    let surface = model.of(Material::Foliage);
    let mut indices = Vec::with_capacity(points.len());
    for (n, &point) in points.iter().enumerate() {
        let dent = 0.84 + 0.28 * lattice(seed, n as i32, 7);
        let place = centre + point * radii * dent;
        let normal = (point / radii).normalize_or(Vec3::Y);
        let shade = 0.62 + 0.42 * (point.y * 0.5 + 0.5);
        let uv = vec2(place.x + place.z * 0.6, -place.y) / Material::Foliage.repeat();
        indices.push(surface.vertex(place, normal, uv, color * shade));
    }
    for face in faces {
        surface.triangle(face.map(|n| indices[n]));
    }
}

/// Unit vectors and the faces between them: 42 and 80.
fn icosphere() -> (Vec<Vec3>, Vec<[usize; 3]>) {
    const T: f32 = 1.618_034;
    let mut points: Vec<Vec3> = Vec::new();
    for (a, b) in [(-1.0, T), (1.0, T), (-1.0, -T), (1.0, -T)] {
        points.push(vec3(a, b, 0.0));
    }
    for (a, b) in [(-1.0, T), (1.0, T), (-1.0, -T), (1.0, -T)] {
        points.push(vec3(0.0, a, b));
    }
    for (a, b) in [(T, -1.0), (T, 1.0), (-T, -1.0), (-T, 1.0)] {
        points.push(vec3(a, 0.0, b));
    }
    let faces = [
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    let mut middles = std::collections::BTreeMap::new();
    let mut split = Vec::with_capacity(80);
    for [a, b, c] in faces {
        let mut middle = |a: usize, b: usize| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                points.push((points[a] + points[b]) * 0.5);
                points.len() - 1
            })
        };
        let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
        split.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
    }
    (points.into_iter().map(|p| p.normalize_or(Vec3::Y)).collect(), split)
}

/// Leaf cards around a crown; their normals point away from its middle, so that it is lit as one.
fn cards(model: &mut Model) {
    let mut random = Random::new(0, 201);
    let (centre, radii) = (vec3(0.0, 3.5, 0.0), vec3(1.7, 1.25, 1.7));
    let surface = model.of(Material::LeafCard);
    for n in 0..34 {
        // A spiral from pole to pole spreads the cards evenly.
        let y = 1.0 - (n as f32 + 0.5) / 17.0;
        let (sine, cosine) = sin_cos(n as f32 * 0.381_966);
        let away = (1.0 - y * y).max(0.0).sqrt();
        let outward = vec3(away * cosine, y, away * sine);
        let place = centre + outward * radii * random.between(0.45, 0.85);
        let facing = about_up(outward, random.between(-0.12, 0.12)) + Vec3::Y * 0.35;
        let facing = facing.normalize_or(Vec3::Y);
        let right = Vec3::Y.cross(facing).normalize_or(Vec3::X);
        let up = facing.cross(right);
        let half = random.between(0.85, 1.15);
        let shade = srgb(0xa9b882) * (0.66 + 0.34 * (y * 0.5 + 0.5));
        let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
        let quad = corners.map(|(s, t): (f32, f32)| {
            let corner = place + (right * s + up * t) * half;
            let uv: Vec2 = vec2(s * 0.5 + 0.5, 0.5 - t * 0.5);
            surface.vertex(corner, (corner - centre).normalize_or(Vec3::Y), uv, shade)
        });
        surface.quad(quad);
    }
}
