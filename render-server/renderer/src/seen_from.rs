//! The viewpoint of a view, and the records of items as seen from it.

use std::borrow::Cow;

use glam::{DAffine3, DMat4, DVec3};

use super::pipeline::InstanceRecord;
use super::scene::{DrawItem, EyeRelativeTransform, GpuScene, Stance, relative_to};

/// The viewpoint that records are relative to.
#[derive(Debug)]
pub(crate) struct SeenFrom<'a> {
    pub scene: &'a GpuScene,
    pub eye: DVec3,
    pub clip_from_eye: DMat4,
    /// The turn of each billboard of the scene, in world space.
    pub turns: &'a [DAffine3],
}

impl<'a> SeenFrom<'a> {
    /// An item, how it stands, and its origin, in world space.
    pub fn place(&self, index: u32) -> (&'a DrawItem, Cow<'a, Stance>, DVec3) {
        let (item, stance, _) = self.scene.item(index);
        let turn = stance.billboard.and_then(|billboard| self.turns.get(billboard as usize));
        match turn {
            None => (item, Cow::Borrowed(stance), item.origin),
            Some(turn) => {
                let (stance, origin) = stance.turned(item.origin, turn);
                (item, Cow::Owned(stance), origin)
            }
        }
    }

    /// The record of an item, relative to the eye.
    pub fn record(&self, index: u32) -> InstanceRecord {
        let (item, stance, origin) = self.place(index);
        let mesh_box = &self.scene.layout.mesh_boxes[item.mesh_box as usize];
        let EyeRelativeTransform { near, rows, offset } =
            relative_to(origin, stance.linear, self.eye, mesh_box);
        InstanceRecord {
            rows,
            normal_rows: stance.normal_rows,
            lamps: item.lamps,
            near,
            clip_offset: (self.clip_from_eye * offset.extend(1.0)).as_vec4().to_array(),
        }
    }
}
