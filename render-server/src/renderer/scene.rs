//! A scene on the GPU: everything about it that does not change from frame to frame.

mod builder;
mod cluster;
mod description;
mod geometry;
mod light;
mod material;
mod placement;
mod texture;
mod tree;

use glam::Vec3;

pub use builder::{SceneBuilder, SceneError};
pub(in crate::renderer) use cluster::Cluster;
pub use description::{
    AlphaMode, ContentName, InstanceDesc, LightDesc, LightKind, MaterialDesc, MeshDesc, MipFilter,
    NodeDesc, PrimitiveDesc, SamplerDesc, SceneDesc, TextureDesc, TextureUse, Topology,
    VertexLayout, Wrap,
};
pub(in crate::renderer) use geometry::Geometry;
pub(in crate::renderer) use light::{Lamp, Lights};
pub(in crate::renderer) use material::MaterialUniform;
pub(in crate::renderer) use placement::{Bounds, Item, Relative};
pub(in crate::renderer) use tree::Tree;

use super::pipeline::PipelineKey;

/// Items that one draw call can draw: one geometry, one material, one winding.
#[derive(Clone, Debug)]
pub(in crate::renderer) struct Batch {
    /// An index into [`Scene::geometries`].
    pub geometry: u32,
    /// An index into [`Scene::materials`].
    pub material: u32,
    /// An index into [`Scene::keys`].
    pub pipeline: u32,
    /// Draws the back faces first; only for double-sided blended triangles.
    pub back_pipeline: Option<u32>,
    pub blended: bool,
    /// Around all items, visible or not.
    pub bounds: Bounds,
    /// Of one item.
    pub triangles: u64,
}

/// A scene on the GPU.
#[derive(Debug)]
pub struct Scene {
    pub(in crate::renderer) items: Vec<Item>,
    /// In the order of the items.
    pub(in crate::renderer) bounds: Vec<Bounds>,
    /// One for each described primitive: its mesh, in the primitive's space.
    pub(in crate::renderer) mesh_boxes: Vec<Bounds>,
    pub(in crate::renderer) tree: Tree,
    pub(in crate::renderer) batches: Vec<Batch>,
    pub(in crate::renderer) keys: Vec<PipelineKey>,
    pub(in crate::renderer) geometries: Vec<Geometry>,
    pub(in crate::renderer) materials: Vec<wgpu::BindGroup>,
    pub(in crate::renderer) lights: Lights,
    pub(in crate::renderer) lamp_indices: wgpu::Buffer,
    pub(in crate::renderer) sky: Vec3,
    pub(in crate::renderer) ground: Vec3,
    pub(in crate::renderer) blends: bool,
}

impl Scene {
    /// Whether anything in it is blended; its targets are linear then.
    pub fn blends(&self) -> bool {
        self.blends
    }

    /// Around everything in it.
    pub(in crate::renderer) fn extent(&self) -> Bounds {
        self.batches.iter().fold(Bounds::EMPTY, |all, batch| all.union(batch.bounds))
    }

    /// Primitives in all their places.
    pub fn item_count(&self) -> usize {
        self.items.len()
    }

    /// The clusters of a batch's geometry; none where it is always drawn whole.
    pub(in crate::renderer) fn clusters_of(&self, batch: u32) -> &[Cluster] {
        &self.geometries[self.batches[batch as usize].geometry as usize].clusters
    }

    /// Different pipelines that it needs.
    pub fn pipeline_count(&self) -> usize {
        self.keys.len()
    }
}
