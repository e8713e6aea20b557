//! The layout of a scene: all of it that needs no GPU, and so can be made on any thread.
//!
//! A million draws take a second to place and sort, so who makes a layout can stop it. It outlives
//! a lost device: only buffers, textures and materials are made anew then.

use std::collections::{HashMap, HashSet};
use std::sync::OnceLock;

use glam::Vec3;
use polyptych_files::blob::BlobHash;
use polyptych_scene::{Fill, MaterialProperty, NodeTraits, Primitive, Scene};

use super::billboard::Billboard;
use super::bvh::Bvh;
use super::content_place::ContentPlace;
use super::draw_item::{self, Bounds, DrawItem, Stance};
use super::items_by_batch::ItemsByBatch;
use super::light::{GROUND, Lights};
use super::material::StyledMaterials;
use super::moving_items::turning_items;
use super::outline::{Outline, Outlines};
use super::slots::{
    GeometryName, Slots, TextureName, first_primitives, geometry_name, geometry_names, texture_name,
};
use super::sorter::{Look, Sorter};
use super::subset::{SceneTree, layer_bit};
use super::{Batch, SceneError};
use crate::pipeline::PipelineKey;

/// Draws that are placed between two looks at whether to stop: a millisecond.
const DRAWS_BETWEEN_CHECKS: usize = 1 << 12;

/// All of a scene that does not depend on a GPU.
#[derive(Debug)]
pub struct SceneLayout {
    /// Without its nodes and lights, which are placed.
    pub(super) desc: Scene,
    pub(super) textures: Slots,
    pub(super) geometries: Slots,
    /// Index of each mesh's first primitive in the order of all primitives.
    pub(super) first_primitive: Vec<usize>,
    pub(crate) items: Vec<DrawItem>,
    /// Index of each described node's first item, and the number of all items behind the last.
    pub(super) first_items: Vec<u32>,
    /// Made where nodes are moved for the first time.
    pub(super) by_batch: OnceLock<ItemsByBatch>,
    /// Named by items.
    pub(crate) stances: Vec<Stance>,
    /// In the order of the items.
    pub(crate) bounds: Vec<Bounds>,
    /// One for each described primitive: its mesh, in the primitive's space.
    pub(crate) mesh_boxes: Vec<Bounds>,
    pub(crate) bvh: Bvh,
    pub(crate) tree: SceneTree,
    pub(crate) batches: Vec<Batch>,
    pub(crate) keys: Vec<PipelineKey>,
    pub(crate) lights: Lights,
    pub(crate) sky: Vec3,
    pub(crate) ground: Vec3,
    pub(crate) blends: bool,
    /// Their geometries stand behind all others.
    pub(super) outlines: Outlines,
    /// They stand behind the default material.
    pub(super) styled: StyledMaterials,
    /// The properties of materials that clips may change.
    pub(super) changing: Vec<(u32, MaterialProperty)>,
    pub(crate) billboards: Vec<Billboard>,
    /// Items that turn with a billboard, rising.
    pub(super) turning: Vec<u32>,
    /// For each batch that a moving item may leave because it is turned inside out, the other.
    pub(super) twins: HashMap<u32, u32>,
}

impl SceneLayout {
    /// Checks the description, places everything in the world and sorts it into batches.
    ///
    /// # Errors
    /// An index points nowhere, a parent stands behind its child, a number is out of bounds; or
    /// [`SceneError::Cancelled`], soon after `is_cancelled` returns `true`.
    pub fn new(desc: Scene, is_cancelled: &dyn Fn() -> bool) -> Result<Self, SceneError> {
        let traits = NodeTraits::of_file(desc.nodes.len());
        Self::with_traits(desc, &traits, is_cancelled)
    }

    /// The layout of a scene that was edited; see [`Self::new`].
    ///
    /// # Errors
    /// Those of [`Self::new`].
    pub fn with_traits(
        mut desc: Scene,
        traits: &NodeTraits,
        is_cancelled: &dyn Fn() -> bool,
    ) -> Result<Self, SceneError> {
        if let Some(fault) = desc.fault() {
            return Err(SceneError::Description(fault));
        }
        let first_primitive = first_primitives(&desc);
        let geometries = Slots::new(geometry_names(&desc));
        let world = draw_item::world_from_nodes(&desc.nodes);
        let mut lights = Lights::new(&desc, &world, traits);
        let (tree, places) = SceneTree::new(&desc.nodes, traits);
        let mut sorter = Sorter::new(&desc, traits, &lights, geometries.count);
        let (mut items, mut bounds) = (Vec::new(), Vec::new());
        let mut first_items = Vec::with_capacity(desc.nodes.len() + 1);
        let (billboards, billboard_of) = Billboard::all(&desc.nodes, &world, &traits.facings);
        let stances = draw_item::instantiate(&desc, &world, &billboard_of, |placement| {
            let Some(mut placement) = placement else {
                first_items.push(items.len() as u32);
                return Ok(());
            };
            let billboard = billboard_of.get(placement.node).copied().flatten();
            placement.bounds = Billboard::bounds(&billboards, billboard, placement.bounds);
            if items.len().is_multiple_of(DRAWS_BETWEEN_CHECKS) && is_cancelled() {
                return Err(SceneError::Cancelled);
            }
            let primitive = first_primitive[placement.mesh as usize] + placement.primitive as usize;
            let look = Look {
                geometry: geometries.of[primitive],
                layer: layer_bit(traits, placement.node),
                style: traits.styles.get(placement.node).copied().unwrap_or_default(),
            };
            items.push(DrawItem {
                origin: placement.origin,
                stance: placement.stance,
                lamps: lights.lights_affecting(&placement.bounds)?,
                batch: sorter.batch_of_moving(&desc, look, &placement, traits),
                mesh_box: primitive as u32,
                place: places[placement.node],
                crowd: desc.nodes[placement.node].crowd_of(placement.copy).max(1.0),
            });
            bounds.push(placement.bounds);
            Ok(())
        })?;
        first_items.push(items.len() as u32);
        lights.seal();
        let Sorter { batches, keys, template, outlines, styled, twins, .. } = sorter;
        (desc.nodes, desc.lights) = (Vec::new(), Vec::new());
        Ok(Self {
            turning: turning_items(&items, &stances),
            bvh: Bvh::new(&bounds, is_cancelled).ok_or(SceneError::Cancelled)?,
            tree,
            textures: Slots::new(desc.textures.iter().map(texture_name)),
            sky: desc.sky,
            ground: desc.sky * GROUND,
            mesh_boxes: draw_item::mesh_boxes(&desc),
            desc,
            geometries,
            first_primitive,
            items,
            first_items,
            by_batch: OnceLock::new(),
            stances,
            bounds,
            batches,
            keys,
            lights,
            blends: template.linear,
            outlines,
            styled,
            changing: traits.changing_materials.clone(),
            billboards,
            twins,
        })
    }
}

impl SceneLayout {
    /// Sets the radiance from below, linear RGB, instead of what a matt, warm ground makes of the
    /// sky's.
    #[must_use]
    pub fn with_ground(self, ground: Vec3) -> Self {
        Self { ground, ..self }
    }

    /// Its meshes, materials and textures; nodes and lights are placed.
    pub fn content(&self) -> &Scene {
        &self.desc
    }

    /// Returns what must be brought to the GPU where another scene is there: the bytes, each once,
    /// and where they go.
    pub fn content_beyond(&self, held: Option<&Self>) -> Vec<(BlobHash, ContentPlace)> {
        let mut textures = held.map(Self::texture_slots).unwrap_or_default();
        let mut geometries = held.map(Self::geometry_slots).unwrap_or_default();
        let shared = held.map(|held| self.shared_outlines(held));
        let mut outlines: HashSet<GeometryName> = HashSet::new();
        for (at, (name, _)) in self.outline_names().enumerate() {
            if shared.as_ref().is_none_or(|shared| shared[at].is_none()) {
                outlines.insert(name);
            }
        }
        let mut missing = Vec::new();
        for (index, texture) in self.desc.textures.iter().enumerate() {
            if textures.insert(texture_name(texture), 0).is_none() {
                missing.push((texture.blob, ContentPlace::Texture { index }));
            }
        }
        for (mesh, of) in self.desc.meshes.iter().enumerate() {
            for (primitive, of) in of.primitives.iter().enumerate() {
                let name = geometry_name(mesh, of);
                let lacks_outline = outlines.contains(&name);
                if geometries.insert(name, 0).is_none() || lacks_outline {
                    outlines.remove(&name);
                    missing.push((of.blob, ContentPlace::Primitive { mesh, primitive }));
                    let deformed = of.deformed.map(|deformed| deformed.blob);
                    let place = ContentPlace::Deformer { mesh, primitive };
                    missing.extend(deformed.map(|blob| (blob, place)));
                }
            }
        }
        missing
    }

    /// Returns the slot of each texture.
    fn texture_slots(&self) -> HashMap<TextureName, usize> {
        let names = self.desc.textures.iter().map(texture_name);
        names.zip(self.textures.of.iter().copied()).collect()
    }

    fn geometry_names(&self) -> impl Iterator<Item = GeometryName> {
        geometry_names(&self.desc)
    }

    /// Returns the slot of each primitive.
    fn geometry_slots(&self) -> HashMap<GeometryName, usize> {
        self.geometry_names().zip(self.geometries.of.iter().copied()).collect()
    }

    /// For each slot of a texture, that of the same one in another layout.
    pub(super) fn shared_textures(&self, other: &Self) -> Vec<Option<usize>> {
        self.textures.shared(self.desc.textures.iter().map(texture_name), &other.texture_slots())
    }

    /// Returns, for each slot of a primitive, that of the same one in another layout.
    pub(super) fn shared_geometries(&self, other: &Self) -> Vec<Option<usize>> {
        self.geometries.shared(self.geometry_names(), &other.geometry_slots())
    }

    /// Bytes that its textures and primitives take on the GPU, each counted once.
    pub fn content_bytes(&self) -> u64 {
        let textures: HashMap<_, _> =
            self.desc.textures.iter().map(|of| (texture_name(of), of.bytes())).collect();
        let primitives = self.desc.meshes.iter().flat_map(|mesh| &mesh.primitives);
        let bytes = primitives.map(Primitive::geometry_bytes);
        let primitives: HashMap<_, _> = self.geometry_names().zip(bytes).collect();
        textures.values().chain(primitives.values()).sum()
    }

    /// For each outline, the geometry of the same one in another layout.
    pub(super) fn shared_outlines(&self, other: &Self) -> Vec<Option<usize>> {
        let known: HashMap<_, _> = other.outline_names().zip(other.geometries.count..).collect();
        self.outline_names().map(|name| known.get(&name).copied()).collect()
    }

    fn outline_names(&self) -> impl Iterator<Item = (GeometryName, Fill)> {
        let primitive = |of: &Outline| &self.desc.meshes[of.mesh].primitives[of.primitive];
        self.outlines.iter().map(move |of| (geometry_name(of.mesh, primitive(of)), of.fill))
    }

    /// Returns whether its meshes, their edges, and its textures are those of another layout, slot
    /// by slot.
    pub fn shares_content_with(&self, other: &Self) -> bool {
        self.desc.meshes == other.desc.meshes
            && self.desc.textures == other.desc.textures
            && self.outlines == other.outlines
    }
}
