//! Tangents as glTF prescribes them where a file has none: MikkTSpace.

use bevy_mikktspace::{Geometry as _, TangentSpace};
use foldhash::{HashMap, HashMapExt};
use glam::{Affine2, DVec3, Vec2, Vec3};

use super::BakeJob;
use super::geometry::{Geometry, clean_tangent, flat_normal};

/// Larger texture coordinates than this have no fraction left, and their squares overflow.
const UV_MAX: f32 = 1e6;

/// Most pairs of vertices in one place that are compared, about ten seconds: welding looks at
/// every pair, so that a file with a million vertices in one point would take hours.
const PAIRS_MAX: u64 = 1 << 30;

/// Most corners of triangles in one place: the triangles around a place are one chain of calls, and
/// their time grows with the square of their number.
const CORNERS_MAX: u64 = 10_000;

/// Tangents for every index of a geometry of triangles, from its normals and one of its sets of
/// texture coordinates as the normal map uses it.
pub(super) fn generate(
    job: &mut BakeJob<'_>,
    geometry: &Geometry,
    (uv_set, uv_transform): (u8, Affine2),
    place: &str,
) -> Vec<[f32; 4]> {
    let positions = geometry.positions.iter().map(|&position| Vec3::from(position).as_dvec3());
    let (min, max) = positions.fold((DVec3::MAX, DVec3::MIN), |(min, max), position| {
        (min.min(position), max.max(position))
    });
    let largest = (max - min).max_element();
    // Sizes far from one would under- or overflow in f32; tangents don't depend on size.
    let scale = if (1e-3..1e5).contains(&largest) { 1.0 } else { 1.0 / largest.max(1e-300) };
    let mut surface = TangentSpaceInput {
        geometry,
        uv: geometry.uvs.get(uv_set as usize).and_then(Option::as_ref),
        uv_transform,
        center: (min + max) * 0.5,
        scale,
        tangents: vec![[0.0, 0.0, 0.0, 1.0]; geometry.indices.len()],
    };
    // The enum of errors has no variants; should it get one, the clean-up below stands in.
    if surface.is_crowded() || bevy_mikktspace::generate_tangents(&mut surface).is_err() {
        job.warn(&format!(
            "{place}: too many vertices or triangles in one place; its tangents are rough"
        ));
    }
    surface.fill_lines();
    let mut tangents = surface.tangents;
    for (corner, tangent) in tangents.iter_mut().enumerate() {
        *tangent = clean_tangent(*tangent, normal(geometry, corner));
    }
    tangents
}

/// The normal of one corner.
fn normal(geometry: &Geometry, corner: usize) -> [f32; 3] {
    if let Some(normals) = &geometry.normals {
        return normals[geometry.indices[corner] as usize];
    }
    let first = corner / 3 * 3;
    flat_normal(&geometry.positions, &geometry.indices[first..first + 3])
}

/// Those of a geometry whose triangles without two corners in one place count: for each corner of
/// another one all triangles would be looked through.
struct TangentSpaceInput<'a> {
    geometry: &'a Geometry,
    uv: Option<&'a Vec<[f32; 2]>>,
    uv_transform: Affine2,
    center: DVec3,
    scale: f64,
    tangents: Vec<[f32; 4]>,
}

impl TangentSpaceInput<'_> {
    /// Returns whether two corners of a triangle are in one place, as its tangents are found.
    fn is_line(&self, face: usize) -> bool {
        let [a, b, c] = [0, 1, 2].map(|vert| self.position(face, vert));
        a == b || b == c || c == a
    }

    /// Returns whether tangents would take hours or no stack holds them: welding compares each pair
    /// of vertices that share a place, and there are more than [`PAIRS_MAX`], or a place has more
    /// than [`CORNERS_MAX`].
    fn is_crowded(&self) -> bool {
        let Geometry { positions, indices, .. } = self.geometry;
        let mut corners_of = vec![0u64; positions.len()];
        for face in (0..self.num_faces()).filter(|face| !self.is_line(*face)) {
            for index in &indices[face * 3..face * 3 + 3] {
                corners_of[*index as usize] += 1;
            }
        }
        let mut counts_at: HashMap<[u32; 3], [u64; 2]> = HashMap::with_capacity(positions.len());
        let mut pairs = 0u64;
        positions.iter().zip(corners_of).any(|(position, own)| {
            let [vertices, corners] = counts_at.entry(position.map(f32::to_bits)).or_default();
            pairs += *vertices;
            *vertices += 1;
            *corners += own;
            pairs > PAIRS_MAX || *corners > CORNERS_MAX
        })
    }

    /// Gives the corners of triangles that did not count the tangents that their vertices have
    /// elsewhere, so that none becomes two.
    fn fill_lines(&mut self) {
        let lines: Vec<usize> = (0..self.num_faces()).filter(|face| self.is_line(*face)).collect();
        if lines.is_empty() {
            return;
        }
        let indices = &self.geometry.indices;
        let mut known = vec![None; self.geometry.positions.len()];
        for face in (0..self.num_faces()).filter(|face| !self.is_line(*face)) {
            for corner in face * 3..face * 3 + 3 {
                known[indices[corner] as usize].get_or_insert(self.tangents[corner]);
            }
        }
        for corner in lines.into_iter().flat_map(|face| face * 3..face * 3 + 3) {
            if let Some(tangent) = known[indices[corner] as usize] {
                self.tangents[corner] = tangent;
            }
        }
    }
}

impl bevy_mikktspace::Geometry for TangentSpaceInput<'_> {
    fn num_faces(&self) -> usize {
        self.geometry.indices.len() / 3
    }

    fn num_vertices_of_face(&self, face: usize) -> usize {
        if self.is_line(face) { 0 } else { 3 }
    }

    fn position(&self, face: usize, vert: usize) -> [f32; 3] {
        let index = self.geometry.indices[face * 3 + vert] as usize;
        let position = self.geometry.positions[index];
        if self.scale == 1.0 {
            return position;
        }
        ((Vec3::from(position).as_dvec3() - self.center) * self.scale).as_vec3().to_array()
    }

    fn normal(&self, face: usize, vert: usize) -> [f32; 3] {
        normal(self.geometry, face * 3 + vert)
    }

    fn tex_coord(&self, face: usize, vert: usize) -> [f32; 2] {
        let index = self.geometry.indices[face * 3 + vert] as usize;
        let uv = self.uv.map_or(Vec2::ZERO, |uv| Vec2::from(uv[index]));
        let uv = self.uv_transform.transform_point2(uv);
        if uv.is_finite() {
            uv.clamp(Vec2::splat(-UV_MAX), Vec2::splat(UV_MAX)).into()
        } else {
            [0.0; 2]
        }
    }

    fn set_tangent(&mut self, space: Option<TangentSpace>, face: usize, vert: usize) {
        if let Some(space) = space {
            // glTF counts v downwards and wants the bitangent to point up the image, so the
            // sign of MikkTSpace, which goes along +v, is turned.
            let [x, y, z, sign] = space.tangent_encoded();
            self.tangents[face * 3 + vert] = [x, y, z, -sign];
        }
    }
}
