//! The triangle of the open scene that a ray meets first: f64, in the scene as it stands.
//!
//! A ray is taken into the space of each mesh whose box it meets, the nearest box first, and there
//! into a tree of its triangles, which is kept for the next ray.

use glam::{DAffine3, DVec3};
use polyptych_protocol::ids::Revision;
use polyptych_protocol::node_query::{RayHit, RayQuery};
use polyptych_scene::Bounds;
use polyptych_wall::pick_ray::Ray;
use polyptych_wall::triangle_bvh::EDGE_SHARE;

use crate::mesh_walk::MeshWalk;
use crate::triangle_cache::Triangles;

/// A mesh in one place, which a ray comes near.
struct Candidate {
    /// The place at which the ray enters its box, in lengths of the ray's direction.
    enters: f64,
    /// Its index in the scene.
    node: usize,
    world: DAffine3,
}

/// The nearest triangle that the ray meets, from either side.
///
/// # Errors
/// The ray is none, a mesh of the scene cannot be read, or it takes too long.
pub(crate) fn cast(
    walk: &MeshWalk<'_>,
    query: &RayQuery,
    revision: Revision,
) -> Result<Option<RayHit>, String> {
    let RayQuery { ray, max_distance, ref subset } = *query;
    let length = ray.direction.length();
    if !(ray.origin.is_finite() && length.is_finite() && length > 0.0) {
        return Err("a ray has a finite origin, and a finite direction that is not 0".into());
    }
    if max_distance.is_some_and(|distance| distance.is_nan() || distance < 0.0) {
        return Err("the distance that a ray may go is 0 or more".into());
    }
    let mut candidates = Vec::new();
    let scene = walk.scene;
    scene.visit_meshes(subset, |node, bounds, world| {
        if let Some(enters) = enters(&local(&ray, world), bounds) {
            candidates.push(Candidate { enters, node, world: *world });
        }
    });
    candidates.sort_by(|a, b| a.enters.total_cmp(&b.enters));
    let mut along_max = max_distance.map_or(f64::INFINITY, |distance| distance / length);
    let mut best = None;
    for candidate in candidates {
        if candidate.enters > along_max {
            break;
        }
        let local_ray = local(&ray, &candidate.world);
        for primitive in scene.primitives(candidate.node) {
            let Some(triangles) = walk.triangles(primitive)? else { continue };
            let met = first(&triangles, &local_ray).filter(|(along, _)| *along <= along_max);
            let Some((along, corners)) = met else { continue };
            along_max = along;
            best = Some((candidate.node, candidate.world, along, corners, primitive.material));
        }
    }
    Ok(best.map(|(node, world, along, corners, material)| {
        let [a, b, c] = corners.map(|corner| world.transform_point3(corner));
        // The front is the mesh's, also of one that is mirrored.
        let normal =
            (b - a).cross(c - a).normalize_or_zero() * world.matrix3.determinant().signum();
        RayHit {
            revision,
            node: scene.id(node),
            name: scene.name(node).to_owned(),
            position: ray.at(along),
            normal,
            distance: along * length,
            is_front: normal.dot(ray.direction) < 0.0,
            material,
        }
    }))
}

/// The ray as a mesh sees it: at equal lengths of its direction it is at the same point.
fn local(ray: &Ray, world: &DAffine3) -> Ray {
    let inverse = world.inverse();
    Ray {
        origin: inverse.transform_point3(ray.origin),
        direction: inverse.transform_vector3(ray.direction),
    }
}

/// Returns the distance at which a ray enters a box, in lengths of its direction; 0 if it begins
/// inside. `None` if it misses the box, or comes from a space that is flat.
fn enters(ray: &Ray, bounds: &Bounds) -> Option<f64> {
    if !(ray.origin.is_finite() && ray.direction.is_finite()) {
        return None;
    }
    // What rounds away on the way must not hide what lies in the box's own side, and a ray along
    // that side is inside: without room it would be 0 · ∞ from it, which is no number.
    let reach = ray.origin.abs().max(bounds.min.abs()).max(bounds.max.abs());
    let room = (reach * EDGE_SHARE).max(DVec3::splat(f64::MIN_POSITIVE));
    let inverse = ray.direction.recip();
    let one = (bounds.min - room - ray.origin) * inverse;
    let two = (bounds.max + room - ray.origin) * inverse;
    let (mut begin, mut end) = (0.0f64, f64::INFINITY);
    for axis in 0..3 {
        begin = begin.max(one[axis].min(two[axis]));
        end = end.min(one[axis].max(two[axis]));
    }
    (begin <= end).then_some(begin)
}

/// Returns the distance at which a ray first meets a triangle, in lengths of its direction, and the
/// corners of that triangle.
fn first(triangles: &Triangles, ray: &Ray) -> Option<(f64, [DVec3; 3])> {
    let from = (ray.origin, ray.direction, 0.0);
    let corners = |triangle| triangles.corners(triangle);
    let (triangle, [along, ..]) = triangles.tree.nearest(EDGE_SHARE, from, corners)?;
    Some((along, triangles.corners(triangle)))
}

#[cfg(test)]
mod tests;
