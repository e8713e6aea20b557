//! A walk over the meshes of the open scene, in the world: what rays, regions and
//! nearest points share.

use std::cell::Cell;
use std::sync::Arc;
use std::time::{Duration, Instant};

use glam::{DAffine3, DVec3};
use polyptych_files::blob::BlobStore;
use polyptych_scene::{Bounds, Primitive};
use polyptych_wall::region::ROUNDING;

use crate::scene_index::SceneIndex;
use crate::triangle_cache::{TriangleCache, Triangles};

/// Boxes and triangles between two looks at the clock: at most some milliseconds.
const STEPS_PER_LOOK: u32 = 1024;

/// The scene, and what reads its meshes, for a limited time.
#[derive(Debug)]
pub(crate) struct MeshWalk<'a> {
    pub scene: &'a SceneIndex,
    cache: &'a TriangleCache,
    store: &'a BlobStore,
    time_max: Duration,
    begun: Instant,
    steps: Cell<u32>,
}

impl<'a> MeshWalk<'a> {
    pub fn new(
        scene: &'a SceneIndex,
        cache: &'a TriangleCache,
        store: &'a BlobStore,
        time_max: Duration,
    ) -> Self {
        Self { scene, cache, store, time_max, begun: Instant::now(), steps: Cell::new(0) }
    }

    /// Counts a box or a triangle that is looked at.
    ///
    /// # Errors
    /// The question has taken too long.
    pub fn step(&self) -> Result<(), String> {
        let steps = self.steps.get() + 1;
        self.steps.set(steps % STEPS_PER_LOOK);
        if steps == STEPS_PER_LOOK { self.check_time() } else { Ok(()) }
    }

    /// # Errors
    /// The question has taken too long.
    pub fn check_time(&self) -> Result<(), String> {
        if self.begun.elapsed() <= self.time_max {
            return Ok(());
        }
        let seconds = self.time_max.as_secs_f64();
        Err(format!(
            "the question was given up after {seconds} s, the maximum time of one; ask again if \
             the disk was slow, for a shorter ray or distance, or for a smaller region of fewer \
             corners"
        ))
    }

    /// The triangles of a primitive; `None` where it has none.
    ///
    /// # Errors
    /// They cannot be read, or the question has taken too long.
    pub fn triangles(&self, primitive: &Primitive) -> Result<Option<Arc<Triangles>>, String> {
        self.check_time()?;
        self.cache.get(self.store, primitive)
    }
}

/// The box in the world around a box of a mesh, with room for what is rounded on the way of each
/// point in it.
pub(crate) fn world_box(of: &Bounds, world: &DAffine3) -> (DVec3, DVec3) {
    let stretch = |by: DVec3| {
        let axes = world.matrix3;
        axes.x_axis.abs() * by.x + axes.y_axis.abs() * by.y + axes.z_axis.abs() * by.z
    };
    let (center, half) = ((of.min + of.max) * 0.5, (of.max - of.min) * 0.5);
    let reach = stretch(center.abs() + half) + world.translation.abs();
    let (center, half) = (world.transform_point3(center), stretch(half) + ROUNDING * reach);
    (center - half, center + half)
}
