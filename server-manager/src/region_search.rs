//! The nodes of the open scene in a region: f64, by their triangles in the world.

use std::ops::ControlFlow;

use glam::DAffine3;
use polyptych_protocol::ids::Revision;
use polyptych_protocol::node_query::{NodePage, RegionQuery};
use polyptych_scene::{Bounds, SceneSubset};
use polyptych_wall::region::{BoxPlace, RegionTest, Relation};

use crate::mesh_walk::{MeshWalk, world_box};
use crate::scene_index::primitive_bounds;
use crate::triangle_cache::{Triangles, has_triangles};

/// The nodes that are shown, have triangles, and lie to a region as asked.
///
/// # Errors
/// The region is none, the query names a node that is not there, a mesh of the scene cannot be
/// read, or it takes too long.
pub(crate) fn find_in_region(
    walk: &MeshWalk<'_>,
    query: &RegionQuery,
    revision: Revision,
) -> Result<NodePage, String> {
    let test = RegionTest::new(&query.region).map_err(|error| error.to_string())?;
    let shown = walk.scene.shown(&SceneSubset::default());
    walk.scene.find(&query.nodes, revision, |node| {
        if !shown[node] || !walk.scene.primitives(node).iter().any(has_triangles) {
            return Ok(false);
        }
        match query.relation {
            Relation::Contains => {
                let bounds = walk.scene.bounds(node);
                Ok(bounds.is_some_and(|bounds| test.is_within(bounds.min, bounds.max)))
            }
            Relation::Inside => all(walk, node, &Inside(&test)),
            Relation::Touches => all(walk, node, &Outside(&test)).map(|is_outside| !is_outside),
            Relation::Disjoint => all(walk, node, &Outside(&test)),
        }
    })
}

/// A condition on all triangles of a node.
trait Demand {
    /// Returns whether it holds of whatever is in a box of this place, if that says so.
    fn of_box(&self, bounds: &Bounds, world: &DAffine3) -> Option<bool>;

    /// Returns whether it holds of a triangle of a mesh.
    fn of_triangle(&self, triangles: &Triangles, index: usize, world: &DAffine3) -> bool;
}

struct Inside<'a>(&'a RegionTest);

struct Outside<'a>(&'a RegionTest);

fn place(test: &RegionTest, bounds: &Bounds, world: &DAffine3) -> BoxPlace {
    let (low, high) = world_box(bounds, world);
    test.place_of_box(low, high)
}

impl Demand for Inside<'_> {
    fn of_box(&self, bounds: &Bounds, world: &DAffine3) -> Option<bool> {
        match place(self.0, bounds, world) {
            BoxPlace::Outside => Some(false),
            BoxPlace::Inside => Some(true),
            BoxPlace::Across => None,
        }
    }

    fn of_triangle(&self, triangles: &Triangles, index: usize, world: &DAffine3) -> bool {
        self.0.holds(&triangles.corners(index).map(|corner| world.transform_point3(corner)))
    }
}

impl Demand for Outside<'_> {
    fn of_box(&self, bounds: &Bounds, world: &DAffine3) -> Option<bool> {
        match place(self.0, bounds, world) {
            BoxPlace::Outside => Some(true),
            BoxPlace::Inside => Some(false),
            BoxPlace::Across => None,
        }
    }

    fn of_triangle(&self, triangles: &Triangles, index: usize, world: &DAffine3) -> bool {
        !self.0.touches(&triangles.corners(index).map(|corner| world.transform_point3(corner)))
    }
}

/// Returns whether a demand holds of all triangles of a node, in all its places.
fn all(walk: &MeshWalk<'_>, node: usize, demand: &impl Demand) -> Result<bool, String> {
    let primitives = walk.scene.primitives(node).iter().filter(|of| has_triangles(of));
    for world in walk.scene.places(node) {
        for primitive in primitives.clone() {
            walk.step()?;
            match demand.of_box(&primitive_bounds(primitive), &world) {
                Some(true) => continue,
                Some(false) => return Ok(false),
                None => {}
            }
            let Some(triangles) = walk.triangles(primitive)? else { continue };
            if !all_of(walk, &triangles, &world, demand)? {
                return Ok(false);
            }
        }
    }
    Ok(true)
}

fn all_of(
    walk: &MeshWalk<'_>,
    triangles: &Triangles,
    world: &DAffine3,
    demand: &impl Demand,
) -> Result<bool, String> {
    let stop = |reason: Result<(), String>| match reason {
        Ok(()) => ControlFlow::Continue(()),
        Err(error) => ControlFlow::Break(Err(error)),
    };
    let enters = |min, max| {
        stop(walk.step())?;
        match demand.of_box(&Bounds { min, max }, world) {
            Some(true) => ControlFlow::Continue(false),
            Some(false) => ControlFlow::Break(Ok(false)),
            None => ControlFlow::Continue(true),
        }
    };
    let visit = |index| {
        stop(walk.step())?;
        if demand.of_triangle(triangles, index, world) {
            ControlFlow::Continue(())
        } else {
            ControlFlow::Break(Ok(false))
        }
    };
    triangles.tree.visit(enters, visit).break_value().unwrap_or(Ok(true))
}

#[cfg(test)]
mod tests;
