//! The point of the open scene's triangles that is nearest to a given point: f64, in the world.

use std::ops::ControlFlow;

use glam::{DAffine3, DVec3};
use polyptych_protocol::ids::Revision;
use polyptych_protocol::node_query::{NearestPoint, NearestQuery};
use polyptych_scene::{Bounds, SceneSubset};
use polyptych_wall::limits::REGION_REACH_MAX;
use polyptych_wall::triangle_distance::nearest_on_triangle;

use crate::mesh_walk::{MeshWalk, world_box};
use crate::triangle_cache::Triangles;

/// A mesh in one place.
struct Candidate {
    /// The distance of its box from the point, in world units.
    distance: f64,
    /// The index of its node in the scene.
    node: usize,
    world: DAffine3,
}

/// The nearest point that was found up to now.
struct Nearest {
    distance: f64,
    position: DVec3,
}

/// The point of the shown triangles that is nearest to a point, if one is near enough.
///
/// # Errors
/// The query is none, a mesh of the scene cannot be read, or it takes too long.
pub(crate) fn nearest(
    walk: &MeshWalk<'_>,
    query: &NearestQuery,
    revision: Revision,
) -> Result<Option<NearestPoint>, String> {
    let NearestQuery { point, within } = *query;
    if point.is_nan() || point.abs().max_element() > REGION_REACH_MAX {
        let limit = format!("at most {REGION_REACH_MAX:e} from 0");
        return Err(format!("the point is {point}; give three finite numbers, {limit}"));
    }
    if let Some(wrong) = within.filter(|within| within.is_nan() || *within < 0.0) {
        return Err(format!("the point may be {wrong} away; give a distance of 0 or more"));
    }
    let mut candidates = Vec::new();
    walk.scene.visit_meshes(&SceneSubset::default(), |node, bounds, world| {
        let distance = distance_of_box(point, bounds, world);
        candidates.push(Candidate { distance, node, world: *world });
    });
    candidates.sort_by(|a, b| a.distance.total_cmp(&b.distance));
    let (mut limit, mut found) = (within.unwrap_or(f64::INFINITY), None);
    for Candidate { distance, node, world } in candidates {
        if distance > limit {
            break;
        }
        for primitive in walk.scene.primitives(node) {
            walk.step()?;
            let Some(triangles) = walk.triangles(primitive)? else { continue };
            let nearer = nearest_of(walk, point, &triangles, &world, limit)?;
            // Of several as near the first one stays.
            let nearer = nearer.filter(|nearer| found.is_none() || nearer.distance < limit);
            if let Some(nearer) = nearer {
                limit = nearer.distance;
                found = Some((node, nearer));
            }
        }
    }
    Ok(found.map(|(node, Nearest { distance, position })| NearestPoint {
        revision,
        node: walk.scene.id(node),
        name: walk.scene.name(node).to_owned(),
        position,
        distance,
    }))
}

/// The nearest point of triangles in one place, at most `limit` away.
fn nearest_of(
    walk: &MeshWalk<'_>,
    point: DVec3,
    triangles: &Triangles,
    world: &DAffine3,
    mut limit: f64,
) -> Result<Option<Nearest>, String> {
    let mut found = None;
    let of_box = |min, max| distance_of_box(point, &Bounds { min, max }, world);
    let end = triangles.tree.visit_nearest(limit, of_box, |index| {
        if let Err(error) = walk.step() {
            return ControlFlow::Break(error);
        }
        let corners = triangles.corners(index).map(|corner| world.transform_point3(corner));
        let position = nearest_on_triangle(point, &corners);
        let distance = position.distance(point);
        if distance <= limit {
            limit = distance;
            found = Some(Nearest { distance, position });
        }
        ControlFlow::Continue(limit)
    });
    end.break_value().map_or(Ok(found), Err)
}

/// The distance of a point from the box in the world around a box of a mesh, in world units.
fn distance_of_box(point: DVec3, bounds: &Bounds, world: &DAffine3) -> f64 {
    let (low, high) = world_box(bounds, world);
    point.distance(point.max(low).min(high))
}

#[cfg(test)]
mod tests;
