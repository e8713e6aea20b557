//! A scene on the GPU: everything about it that does not change from frame to frame.

mod bent_vertices;
mod billboard;
mod builder;
mod bvh;
mod content_place;
mod draw_item;
mod geometry;
mod geometry_room;
mod identity;
mod items_by_batch;
mod lamp_grid;
mod lamp_search;
mod layout;
mod light;
mod material;
mod material_extension;
mod meshlet;
mod moment;
mod moved_items;
mod moving_items;
mod outline;
mod part_bounds;
mod slots;
mod sorter;
mod subset;
mod texture;
mod triangle_order;

use std::sync::Arc;

use glam::Vec3;
use polyptych_scene::{LightEffects, SceneSubset};

use crate::cull::FrustumPlanes;
use crate::environment::Environment;
use crate::gpu::Gpu;

pub(crate) use billboard::Billboard;
pub use builder::{SceneBuilder, SceneError};
#[cfg(test)]
pub(crate) use bvh::Bvh;
pub use content_place::ContentPlace;
#[cfg(test)]
pub(crate) use draw_item::PlacedMesh;
pub(crate) use draw_item::{Bounds, DrawItem, EyeRelativeTransform, Stance, relative_to};
pub(crate) use geometry::Geometry;
pub(crate) use identity::SceneIdentity;
pub(crate) use lamp_grid::LampGrid;
pub use layout::SceneLayout;
pub(crate) use light::{DirectionalLight, LocalLight};
pub(crate) use material::{MaterialUniform, Materials};
pub(crate) use material_extension::{ExtensionFeatures, ExtensionUniform};
pub(crate) use meshlet::{MeshletCull, Meshlets, joined};
pub use moved_items::{MovedItems, MovedNode};
use part_bounds::PartBounds;
pub(crate) use subset::Selection;
pub(crate) use triangle_order::TriangleOrder;

/// Items that one draw call can draw: one geometry, one material, one winding.
#[derive(Clone, Debug)]
pub(crate) struct Batch {
    /// An index into [`GpuScene::geometries`].
    pub geometry: u32,
    /// Its number in [`GpuScene::materials`].
    pub material: u32,
    /// An index into [`SceneLayout::keys`].
    pub pipeline: u32,
    /// Draws the back faces first; only for double-sided blended triangles.
    pub back_pipeline: Option<u32>,
    /// Draws both sides at once; only for blended triangles, where they are in the order of their
    /// distances.
    pub ordered_pipeline: Option<u32>,
    /// Drawn after what is opaque, far to near: it is blended, or transmits light.
    pub blended: bool,
    /// The bit of the layer of its items; 0 if they are in none.
    pub layer: u64,
    /// Around all items as they were laid out, visible or not.
    pub bounds: Bounds,
    /// All items are skies: see [`polyptych_scene::Node::is_sky`].
    pub is_sky: bool,
    /// The number of triangles of one item.
    pub triangles: u64,
}

/// A scene on the GPU.
#[derive(Clone, Debug)]
pub struct GpuScene {
    pub(crate) layout: Arc<SceneLayout>,
    /// Items that stand elsewhere than in the layout.
    moved: Option<Arc<MovedItems>>,
    part_bounds: PartBounds,
    /// Items with masks whose material is changed by clips, rising.
    painted: Arc<[u32]>,
    pub(crate) geometries: Arc<Vec<Geometry>>,
    /// For each batch, whether its triangles are drawn in the order of their distances.
    ordered: Arc<[bool]>,
    pub(crate) materials: Arc<Materials>,
    pub(crate) lamp_indices: wgpu::Buffer,
    /// By slot; what materials are made of.
    textures: Arc<Vec<wgpu::TextureView>>,
    content_bytes: u64,
    /// The surroundings that it has instead of its sky.
    pub(crate) environment: Option<Arc<Environment>>,
}

impl GpuScene {
    /// Returns the scene in other surroundings, or in its own sky if `None`: all else is shared.
    #[must_use]
    pub fn with_environment(&self, environment: Option<Arc<Environment>>) -> Self {
        Self { environment, ..self.clone() }
    }

    /// Its surroundings, if not its own sky.
    pub fn environment(&self) -> Option<&Arc<Environment>> {
        self.environment.as_ref()
    }

    /// The part of it that a view shows, in its surroundings.
    pub(crate) fn part(&self, shown: &SceneSubset) -> Selection {
        let has_sun = self.environment.as_deref().is_some_and(Environment::has_sun);
        self.layout.tree.select(shown).within(has_sun)
    }

    /// The factor of the radiance of its surroundings: beside lights in real units they are as
    /// bright as its own sky is, which its file has in these units.
    pub(crate) fn surroundings_scale(&self) -> f32 {
        self.layout.content().exposure.map_or(1.0, f32::recip)
    }

    /// The radiance of a white fog: what comes from all around, and the light of suns, scattered
    /// evenly over all directions. Lamps and shadows do not count.
    pub(crate) fn scattered(&self, part: Selection) -> Vec3 {
        let own = (self.layout.sky + self.layout.ground) * 0.5;
        let scale = self.surroundings_scale();
        let around = self.environment.as_ref().map_or(own, |of| of.mean() * scale);
        let suns = self.suns().iter().map(|sun| sun.on.color_in(sun.irradiance, part));
        around + suns.sum::<Vec3>() / (4.0 * std::f32::consts::PI)
    }

    /// Returns the scene with its nodes, lights and materials as in another layout, but for what
    /// was moved since that was made: meshes and textures are shared, and nothing is uploaded but
    /// what differs.
    ///
    /// # Errors
    /// The other layout is not of this scene.
    pub fn with_layout(
        &self,
        gpu: &Gpu,
        layout: Arc<SceneLayout>,
        moved: Option<Arc<MovedItems>>,
    ) -> Result<Self, SceneError> {
        let is_same = Arc::ptr_eq(&layout, &self.layout);
        if !is_same && !layout.shares_content_with(&self.layout) {
            return Err(SceneError::Description("it is another scene".to_owned()));
        }
        let has_all = || layout.has_materials_of(&self.layout) && self.materials.serve(&layout);
        let materials = if is_same || has_all() {
            Arc::clone(&self.materials)
        } else {
            let known = Some((&*self.layout, &*self.materials));
            Arc::new(builder::materials(gpu, &layout, &self.textures, known))
        };
        let [before, now] = [&self.moved, &moved]
            .map(|moved| moved.as_ref().map_or(&[][..], |moved| moved.lamp_indices()));
        let lamp_indices = if is_same && before == now {
            self.lamp_indices.clone()
        } else if now.is_empty() {
            builder::index_buffer(gpu, &layout.lights.indices)
        } else {
            builder::index_buffer(gpu, &[&layout.lights.indices[..], now].concat())
        };
        let ordered = if is_same {
            Arc::clone(&self.ordered)
        } else {
            triangle_order::ordered_batches(&layout, &self.geometries)
        };
        Ok(Self {
            lamp_indices,
            ordered,
            layout,
            moved,
            part_bounds: PartBounds::default(),
            painted: Arc::default(),
            geometries: Arc::clone(&self.geometries),
            materials,
            textures: Arc::clone(&self.textures),
            content_bytes: self.content_bytes,
            environment: self.environment.clone(),
        })
    }

    /// Appends the items that may be visible, in no particular order. Never leaves one out that
    /// is.
    pub(crate) fn visible(&self, planes: &FrustumPlanes, found: &mut Vec<u32>) {
        self.layout.bvh.visible(planes, found);
        if let Some(moved) = &self.moved {
            found.retain(|&item| !moved.holds(item));
            moved.visible(planes, found);
        }
    }

    /// An item where it stands, with its stance and its box.
    pub(crate) fn item(&self, item: u32) -> (&DrawItem, &Stance, &Bounds) {
        self.moved.as_ref().and_then(|moved| moved.item(item)).unwrap_or_else(|| {
            let of_layout = &self.layout.items[item as usize];
            let stance = &self.layout.stances[of_layout.stance as usize];
            (of_layout, stance, &self.layout.bounds[item as usize])
        })
    }

    /// The batch of an item where it stands.
    pub(crate) fn batch_of(&self, item: u32) -> &Batch {
        &self.layout.batches[self.item(item).0.batch as usize]
    }

    /// The lamps of a range of the list of lamp indices.
    #[cfg(test)]
    pub(crate) fn lamp_list(&self, range: std::ops::Range<usize>) -> Vec<u32> {
        let own = self.moved.as_ref().map_or(&[][..], |moved| moved.lamp_indices());
        self.layout.lights.indices.iter().chain(own).copied().collect::<Vec<_>>()[range].to_vec()
    }

    /// The first directional lights, as they shine now.
    pub(crate) fn suns(&self) -> &[DirectionalLight] {
        let moved = self.moved.as_ref().and_then(|moved| moved.lights());
        moved.map_or(&self.layout.lights.suns, |moved| &moved.suns)
    }

    /// All other lights, as they shine now.
    pub(crate) fn lamps(&self) -> &[LocalLight] {
        let moved = self.moved.as_ref().and_then(|moved| moved.lights());
        moved.map_or(&self.layout.lights.lamps, |moved| &moved.lamps)
    }

    /// The nodes that turn towards the viewer, as they stand now.
    pub(crate) fn billboards(&self) -> &[Billboard] {
        self.moved.as_ref().map_or(&self.layout.billboards, |moved| moved.billboards())
    }

    /// Around all items of a batch that no clip hides, seen or not.
    pub(crate) fn batch_bounds(&self, batch: u32) -> Bounds {
        match &self.moved {
            Some(moved) => moved.batch_bounds(batch),
            None => self.layout.batches[batch as usize].bounds,
        }
    }

    /// Bytes that its textures and primitives take on the GPU.
    pub fn content_bytes(&self) -> u64 {
        self.content_bytes
    }

    /// Returns whether its textures and primitives are those of another scene, which take memory
    /// once.
    pub fn has_content_of(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.geometries, &other.geometries)
    }

    /// Returns whether anything in it is blended or transmits light; its targets must then be
    /// linear.
    pub fn has_transparency(&self) -> bool {
        self.layout.blends
    }

    /// Returns whether its targets must hold light before tone mapping: with transparency, glow, or
    /// depth of field.
    pub fn needs_light(&self, effects: LightEffects) -> bool {
        self.has_transparency() || effects.mixes_light()
    }

    /// Around everything in a part of it.
    pub(crate) fn extent(&self, of: Selection) -> Bounds {
        self.extent_of(of, |_| true)
    }

    /// Around all in a part of it that maps of shadows are for: skies are left out, unless there is
    /// nothing else.
    pub(crate) fn shadowed_extent(&self, of: Selection) -> Bounds {
        let rest = self.extent_of(of, |batch| !batch.is_sky);
        if rest == Bounds::EMPTY { self.extent(of) } else { rest }
    }

    /// Around those batches of a part of it.
    fn extent_of(&self, of: Selection, has: impl Fn(&Batch) -> bool) -> Bounds {
        let own = self.batch_bounds_of(of);
        let is_shown = |of_all: &Batch| of.has_layer(of_all.layer) && has(of_all);
        let shown = (0u32..).zip(&self.layout.batches).filter(|(_, of_all)| is_shown(of_all));
        let bounds = shown.map(|(at, _)| {
            own.as_ref().map_or_else(|| self.batch_bounds(at), |own| own[at as usize])
        });
        bounds.fold(Bounds::EMPTY, Bounds::union)
    }

    /// Primitives in all their places.
    pub fn item_count(&self) -> usize {
        self.layout.items.len()
    }

    /// The geometry of a batch.
    pub(crate) fn geometry_of(&self, batch: u32) -> &Geometry {
        &self.geometries[self.layout.batches[batch as usize].geometry as usize]
    }

    /// The triangles of a batch, and the pipeline of both their sides, if they are drawn in the
    /// order of their distances.
    pub(crate) fn order_of(&self, batch: u32) -> Option<(&TriangleOrder, u32)> {
        let pipeline = self.layout.batches[batch as usize].ordered_pipeline?;
        let order = self.geometry_of(batch).order.as_deref()?;
        self.ordered[batch as usize].then_some((order, pipeline))
    }

    /// Different pipelines that it needs.
    pub fn pipeline_count(&self) -> usize {
        self.layout.keys.len()
    }
}
