//! The identity of the scene that something was drawn of.

use std::sync::{Arc, Weak};

use super::GpuScene;
use super::geometry::Geometry;
use super::layout::SceneLayout;
use super::moved_items::MovedItems;
use super::moving_items::MovingItems;

/// The identity of all that decides where surfaces of a scene are: two scenes of one identity have
/// the same ones. It keeps none of it.
#[derive(Clone, Debug)]
pub(crate) struct SceneIdentity {
    layout: Weak<SceneLayout>,
    moved: Option<Weak<MovedItems>>,
    geometries: Weak<Vec<Geometry>>,
    moving: MovingItems,
}

impl SceneIdentity {
    pub fn new(scene: &GpuScene) -> Self {
        Self {
            layout: Arc::downgrade(&scene.layout),
            moved: scene.moved.as_ref().map(Arc::downgrade),
            geometries: Arc::downgrade(&scene.geometries),
            moving: scene.moving(),
        }
    }

    /// Returns whether the same items stand still in both, and in the same places.
    pub fn stands_as(&self, other: &Self) -> bool {
        self.layout.ptr_eq(&other.layout)
            && self.geometries.ptr_eq(&other.geometries)
            && self.moving == other.moving
    }

    /// Returns whether no scene has this identity any more.
    pub fn is_gone(&self) -> bool {
        self.layout.strong_count() == 0 || self.geometries.strong_count() == 0
    }
}

impl PartialEq for SceneIdentity {
    fn eq(&self, other: &Self) -> bool {
        let is_moved_alike = match (&self.moved, &other.moved) {
            (Some(one), Some(other)) => one.ptr_eq(other),
            (one, other) => one.is_none() && other.is_none(),
        };
        is_moved_alike && self.stands_as(other)
    }
}
