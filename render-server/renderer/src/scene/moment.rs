//! A scene at a moment: its nodes, lights and vertices where clips have moved them.

use std::sync::Arc;

use glam::{Vec3, Vec4};
use polyptych_scene::ChangedMaterial;
use polyptych_scene::deformation::Shape;
use rayon::prelude::*;

use super::moved_items::{BentBoxes, MovedItems, MovedNode};
use super::moving_items::MovingItems;
use super::{GpuScene, SceneError};
use crate::gpu::Gpu;

impl GpuScene {
    /// Returns the scene with nodes in other places, in the order of their indices, meshes, by
    /// their indices, in other shapes, and materials with other values. Vertices and values are
    /// shared: of several scenes that this made, only the last one can be drawn.
    ///
    /// # Errors
    /// A node was turned inside out of which that was not known when the scene was laid out.
    pub fn at_moment(
        &self,
        gpu: &Gpu,
        nodes: &[MovedNode<'_>],
        shapes: &[(u32, &Shape)],
        materials: &[ChangedMaterial],
    ) -> Result<Self, SceneError> {
        self.change_materials(gpu, materials);
        let boxes: BentBoxes =
            shapes.par_iter().map(|(mesh, shape)| (*mesh, self.bend(gpu, *mesh, shape))).collect();
        let layout = &self.layout;
        let moved = MovedItems::with_boxes(layout, nodes, &boxes, usize::MAX);
        let inside_out = || {
            let reason = "a node was turned inside out by more than its clips";
            SceneError::Description(reason.to_owned())
        };
        let moved = moved.ok_or_else(inside_out)?;
        let scene = self.with_layout(gpu, Arc::clone(layout), Some(Arc::new(moved)))?;
        Ok(Self { painted: MovingItems::painted(layout, materials), ..scene })
    }

    /// Gives materials other values, in all styles that they are drawn in. Draws that were ordered
    /// before have the values before.
    fn change_materials(&self, gpu: &Gpu, changed: &[ChangedMaterial]) {
        let (desc, styled) = (&self.layout.desc, &self.layout.styled);
        for one in changed {
            let Some(of_scene) = desc.materials.get(one.material as usize) else { continue };
            let mut material = of_scene.clone();
            one.apply_to(&mut material);
            let behind = (desc.materials.len() as u32 + 1..).zip(styled.iter());
            let of_it = behind.filter(|(_, of)| of.material == one.material);
            let of_it = of_it.map(|(number, of)| (number, of.highlight));
            for (number, highlight) in std::iter::once((one.material, Vec4::ZERO)).chain(of_it) {
                // A material that nothing draws has no values.
                if let Some(groups) = self.materials.get(number) {
                    groups.set(gpu, &material, highlight);
                }
            }
        }
    }

    /// Bends a mesh; gives the boxes around its primitives.
    fn bend(&self, gpu: &Gpu, mesh: u32, shape: &Shape) -> Vec<(Vec3, Vec3)> {
        let Some(primitives) = self.layout.desc.meshes.get(mesh as usize) else {
            return Vec::new();
        };
        let first = self.layout.first_primitive[mesh as usize];
        let primitives: Vec<_> = primitives.primitives.iter().zip(first..).collect();
        let bend = |(primitive, at): (&polyptych_scene::Primitive, usize)| {
            let geometry = &self.geometries[self.layout.geometries.of[at]];
            let still = (primitive.min, primitive.max);
            let bent = geometry.bent.as_ref();
            let place = (&geometry.vertices, geometry.first_vertex);
            bent.map_or(still, |bent| bent.bend(gpu, place, shape))
        };
        primitives.into_par_iter().map(bend).collect()
    }
}
