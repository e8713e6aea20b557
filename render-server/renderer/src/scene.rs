//! A scene on the GPU: everything about it that does not change from frame to frame.

mod billboard;
mod builder;
mod bvh;
mod draw_item;
mod geometry;
mod layout;
mod light;
mod material;
mod meshlet;
mod outline;
mod subset;
mod texture;

use std::sync::Arc;

use crate::gpu::Gpu;

pub(crate) use billboard::Billboard;
pub use builder::{SceneBuilder, SceneError};
#[cfg(test)]
pub(crate) use bvh::Bvh;
pub(crate) use draw_item::{Bounds, EyeRelativeTransform, Stance, relative_to};
pub(crate) use geometry::Geometry;
pub use layout::{ContentPlace, SceneLayout};
pub(crate) use light::LocalLight;
pub(crate) use material::MaterialUniform;
pub(crate) use meshlet::Meshlet;
pub(crate) use subset::Selection;

/// Items that one draw call can draw: one geometry, one material, one winding.
#[derive(Clone, Debug)]
pub(crate) struct Batch {
    /// An index into [`GpuScene::geometries`].
    pub geometry: u32,
    /// An index into [`GpuScene::materials`].
    pub material: u32,
    /// An index into [`SceneLayout::keys`].
    pub pipeline: u32,
    /// Draws the back faces first; only for double-sided blended triangles.
    pub back_pipeline: Option<u32>,
    pub blended: bool,
    /// The bit of the layer of its items; 0 if they are in none.
    pub layer: u64,
    /// Around all items, visible or not.
    pub bounds: Bounds,
    /// Of one item.
    pub triangles: u64,
}

/// A scene on the GPU.
#[derive(Debug)]
pub struct GpuScene {
    pub(crate) layout: Arc<SceneLayout>,
    pub(crate) geometries: Arc<Vec<Geometry>>,
    pub(crate) materials: Arc<Vec<wgpu::BindGroup>>,
    pub(crate) lamp_indices: wgpu::Buffer,
    /// By slot; what materials are made of.
    textures: Arc<Vec<wgpu::TextureView>>,
    content_bytes: u64,
}

impl GpuScene {
    /// The same scene with its nodes, lights and materials as in another layout of it: meshes and
    /// textures are shared, and nothing is uploaded but what differs.
    ///
    /// # Errors
    /// The other layout is not of this scene.
    pub fn with_layout(&self, gpu: &Gpu, layout: Arc<SceneLayout>) -> Result<Self, SceneError> {
        if !layout.shares_content_with(&self.layout) {
            return Err(SceneError::Description("it is another scene".to_owned()));
        }
        let materials = if layout.has_materials_of(&self.layout) {
            Arc::clone(&self.materials)
        } else {
            Arc::new(builder::materials(gpu, &layout, &self.textures))
        };
        Ok(Self {
            lamp_indices: builder::index_buffer(gpu, &layout.lights.indices),
            layout,
            geometries: Arc::clone(&self.geometries),
            materials,
            textures: Arc::clone(&self.textures),
            content_bytes: self.content_bytes,
        })
    }

    /// Bytes of its textures and primitives.
    pub fn content_bytes(&self) -> u64 {
        self.content_bytes
    }

    /// Whether anything in it is blended; its targets are linear then.
    pub fn has_transparency(&self) -> bool {
        self.layout.blends
    }

    /// Around everything in a part of it.
    pub(crate) fn extent(&self, of: Selection) -> Bounds {
        let own = (!of.has_all_places()).then(|| self.batch_bounds(of));
        let shown = (0..).zip(&self.layout.batches).filter(|(_, batch)| of.has_layer(batch.layer));
        let bounds =
            shown.map(|(at, batch): (usize, _)| own.as_ref().map_or(batch.bounds, |own| own[at]));
        bounds.fold(Bounds::EMPTY, Bounds::union)
    }

    /// Around the items of each batch that are in a part of it.
    pub(crate) fn batch_bounds(&self, of: Selection) -> Vec<Bounds> {
        let mut all = vec![Bounds::EMPTY; self.layout.batches.len()];
        let items = self.layout.items.iter().zip(&self.layout.bounds);
        for (item, bounds) in items.filter(|(item, _)| of.has_place(item.place)) {
            let batch = &mut all[item.batch as usize];
            *batch = batch.union(*bounds);
        }
        all
    }

    /// Primitives in all their places.
    pub fn item_count(&self) -> usize {
        self.layout.items.len()
    }

    /// The clusters of a batch's geometry; none where it is always drawn whole.
    pub(crate) fn clusters_of(&self, batch: u32) -> &[Meshlet] {
        &self.geometries[self.layout.batches[batch as usize].geometry as usize].clusters
    }

    /// Different pipelines that it needs.
    pub fn pipeline_count(&self) -> usize {
        self.layout.keys.len()
    }
}
