//! Ray casts and look-ups of picture places on a triangle mesh in f64, using a bounding volume
//! hierarchy.

use std::sync::OnceLock;

use glam::{DVec2, DVec3};

use super::triangle_bvh::{CRACK_SHARE, EDGE_SHARE, TriangleBvh};
use super::warp_mesh::WarpMesh;

/// Triangles with places in a picture and points in display space.
#[derive(Clone, Debug)]
pub struct MeshBvh {
    mesh: WarpMesh,
    by_point: TriangleBvh,
    by_place: TriangleBvh,
    /// See [`Self::outline`]; found on first use.
    outline: OnceLock<Vec<[DVec3; 2]>>,
}

/// The point where a ray meets a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// In metres of display space.
    pub point: DVec3,
    /// In the picture.
    pub place: DVec2,
    /// `true` if the ray comes from the side from which the picture is upright and not mirrored.
    pub is_front: bool,
}

impl MeshBvh {
    /// The triangles of a mesh; its "pixels" are the places, whatever they count.
    pub fn new(mesh: WarpMesh) -> Self {
        let points = mesh.vertices.iter().map(|vertex| vertex.point).collect::<Vec<_>>();
        let places = mesh.vertices.iter().map(|vertex| vertex.pixel.extend(0.0));
        let places = places.collect::<Vec<_>>();
        let by_point = TriangleBvh::new(&points, &mesh.triangles);
        let by_place = TriangleBvh::new(&places, &mesh.triangles);
        Self { mesh, by_point, by_place, outline: OnceLock::new() }
    }

    /// The point at a place; `None` where no triangle is. Where several are, that of one.
    pub fn point_at(&self, place: DVec2) -> Option<DVec3> {
        let above = place.extend(-1.0);
        let corners = |triangle: usize| self.corners(triangle, |vertex| vertex.pixel.extend(0.0));
        let (triangle, [_, u, v]) = nearest(&self.by_place, above, DVec3::Z, 1.0, corners)?;
        let [a, b, c] = self.corners(triangle, |vertex| vertex.point);
        Some(a + (b - a) * u + (c - a) * v)
    }

    /// Returns the point where a ray meets the mesh. Of several, the one nearest to `near` on the
    /// ray, in directions from `from`: 0 gives the first.
    pub fn hit(&self, from: DVec3, direction: DVec3, near: f64) -> Option<Hit> {
        let corners = |triangle: usize| self.corners(triangle, |vertex| vertex.point);
        let (triangle, [_, u, v]) = nearest(&self.by_point, from, direction, near, corners)?;
        let [a, b, c] = corners(triangle);
        let [p, q, r] = self.corners(triangle, |vertex| vertex.pixel);
        // y runs down in the picture: its x cross its y points away from the viewer.
        let away = (b - a).cross(c - a) * (q - p).perp_dot(r - p).signum();
        Some(Hit {
            point: a + (b - a) * u + (c - a) * v,
            place: p + (q - p) * u + (r - p) * v,
            is_front: away.dot(direction) > 0.0,
        })
    }

    /// The edges of one triangle alone, by the points of their ends: where the mesh ends, and where
    /// its holes begin.
    pub(crate) fn outline(&self) -> &[[DVec3; 2]] {
        self.outline.get_or_init(|| outline_of(&self.mesh))
    }

    fn corners<T>(
        &self,
        triangle: usize,
        of: impl Fn(&super::warp_mesh::WarpVertex) -> T,
    ) -> [T; 3] {
        self.mesh.triangles[triangle].map(|corner| of(&self.mesh.vertices[corner as usize]))
    }
}

/// The triangle that a ray meets nearest to `near` of its lengths, with that length and the place
/// in the triangle; where it meets none, one that it misses by a crack.
fn nearest(
    tree: &TriangleBvh,
    from: DVec3,
    direction: DVec3,
    near: f64,
    corners: impl Fn(usize) -> [DVec3; 3],
) -> Option<(usize, [f64; 3])> {
    let within = |share| tree.nearest(share, (from, direction, near), &corners);
    within(EDGE_SHARE).or_else(|| within(CRACK_SHARE))
}

/// Returns the edges that only one triangle of a mesh has. Files may have several vertices for one
/// point, where its places differ: ends are told apart by their points.
fn outline_of(mesh: &WarpMesh) -> Vec<[DVec3; 2]> {
    let point = |vertex: u32| mesh.vertices[vertex as usize].point;
    // −0 is 0.
    let bits = |vertex: &u32| point(*vertex).to_array().map(|number| (number + 0.0).to_bits());
    let mut order: Vec<u32> = (0..mesh.vertices.len() as u32).collect();
    order.sort_unstable_by_key(bits);
    let mut first_of = vec![0u32; order.len()];
    for same in order.chunk_by(|a, b| bits(a) == bits(b)) {
        for vertex in same {
            first_of[*vertex as usize] = same[0];
        }
    }
    let mut edges = Vec::with_capacity(mesh.triangles.len() * 3);
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|corner| first_of[corner as usize]);
        // A triangle of two points covers nothing.
        if a != b && b != c && c != a {
            edges.extend([(a, b), (b, c), (c, a)].map(|(a, b)| [a.min(b), a.max(b)]));
        }
    }
    edges.sort_unstable();
    let lone = edges.chunk_by(|a, b| a == b).filter(|same| same.len() == 1);
    lone.map(|same| same[0].map(point)).collect()
}

#[cfg(test)]
mod tests;
