//! The batches of a layout: each placement goes into one, and names the pipelines that it needs.

use std::collections::{BTreeSet, HashMap};

use polyptych_scene::{
    AlphaMode, Fill, Material, NodeStyle, NodeTraits, Primitive, Scene, Topology, VertexLayout,
};
use polyptych_wall::ShadowFilter;

use super::draw_item::{Bounds, PrimitiveInstance};
use super::light::Lights;
use super::material::{StyledMaterial, StyledMaterials};
use super::outline::{Outline, Outlines};
use super::{Batch, material, outline};
use crate::pipeline::{Alpha, Cull, MaterialFeatures, PipelineKey};

/// The way in which a primitive is drawn in one place.
#[derive(Clone, Copy, Debug)]
pub(super) struct Look {
    /// The slot of its geometry.
    pub geometry: usize,
    /// The bit of its layer.
    pub layer: u64,
    pub style: NodeStyle,
}

/// Finds the batch of each placement, and collects the pipelines that they need.
pub(super) struct Sorter<'a> {
    default_material: Material,
    /// The properties of nodes that clips may change.
    traits: &'a NodeTraits,
    pub template: Template,
    pub batches: Vec<Batch>,
    pub keys: Vec<PipelineKey>,
    /// By geometry, layer, material, and whether they are mirrored.
    known: HashMap<(usize, u64, u32, bool), u32>,
    /// The number of geometries that are not outlines.
    geometry_count: usize,
    pub outlines: Outlines,
    pub styled: StyledMaterials,
    /// See [`SceneLayout::twins`](super::SceneLayout::twins).
    pub twins: HashMap<u32, u32>,
}

/// The part of a pipeline's key that all pipelines of a scene share.
pub(super) struct Template {
    sun_count: u8,
    lamps: bool,
    /// Anything that is drawn is blended or transmits light.
    pub linear: bool,
    shadows: ShadowFilter,
    lamp_shadows: bool,
}

impl<'a> Sorter<'a> {
    pub fn new(
        desc: &Scene,
        traits: &'a NodeTraits,
        lights: &Lights,
        geometry_count: usize,
    ) -> Self {
        let blends = |primitive: &Primitive| {
            let material = primitive.material.and_then(|m| desc.materials.get(m as usize));
            material.is_some_and(|of| of.alpha_mode == AlphaMode::Blend || of.transmits())
        };
        let used: BTreeSet<u32> = desc.nodes.iter().filter_map(|node| node.mesh).collect();
        let mut drawn = used.iter().flat_map(|&mesh| &desc.meshes[mesh as usize].primitives);
        let template = Template {
            sun_count: lights.suns.len() as u8,
            lamps: !lights.lamps.is_empty(),
            linear: drawn.any(blends),
            shadows: lights.shadow_filter(),
            lamp_shadows: lights.has_lamp_shadows,
        };
        Self {
            default_material: Material::default(),
            traits,
            template,
            batches: Vec::new(),
            keys: Vec::new(),
            known: HashMap::new(),
            geometry_count,
            outlines: Outlines::default(),
            styled: StyledMaterials::default(),
            twins: HashMap::new(),
        }
    }

    /// Returns the geometry of a placement, and what it makes.
    fn geometry_of(
        &mut self,
        look: &Look,
        placement: &PrimitiveInstance<'_>,
        is_blend: bool,
    ) -> (usize, Topology) {
        let (slot, mut fill) = (look.geometry, look.style.fill.unwrap_or_default());
        let own = placement.desc.topology;
        let drawn = outline::drawn(own, fill);
        if drawn.is_none() {
            if !is_blend || placement.desc.triangles() < 2 {
                return (slot, own);
            }
            fill = Fill::Solid;
        }
        let topology = drawn.unwrap_or(own);
        let (mesh, primitive) = (placement.mesh as usize, placement.primitive as usize);
        let index = self.outlines.add(Outline { slot, fill, mesh, primitive });
        (self.geometry_count + index, topology)
    }

    /// Returns the index of a material in a style, and the style's part in it.
    fn material_of(
        &mut self,
        desc: &Scene,
        material: u32,
        style: NodeStyle,
    ) -> (u32, Option<StyledMaterial>) {
        let Some(styled) = StyledMaterial::new(material, style) else { return (material, None) };
        (desc.materials.len() as u32 + 1 + self.styled.add(styled), Some(styled))
    }

    /// Returns the batch of a placement, whose box does not count it yet.
    fn batch_of(&mut self, desc: &Scene, look: Look, placement: &PrimitiveInstance<'_>) -> u32 {
        let primitive = placement.desc;
        // The default material stands behind all others.
        let plain = primitive.material.unwrap_or(desc.materials.len() as u32);
        let described = desc.materials.get(plain as usize);
        let is_blend = described.is_some_and(|of| of.alpha_mode == AlphaMode::Blend);
        let (geometry, topology) = self.geometry_of(&look, placement, is_blend);
        let (material, styled) = self.material_of(desc, plain, look.style);
        let layer = look.layer;
        let mirrored = placement.is_mirrored;
        let next = self.batches.len() as u32;
        let index = *self.known.entry((geometry, layer, material, mirrored)).or_insert(next);
        if index == next {
            let described = described.unwrap_or(&self.default_material);
            let layout = primitive.layout;
            let described = &*self.traits.with_changes(plain, described);
            let features = styled.map_or_else(
                || material::features(described, layout),
                |styled| styled.features(described, layout),
            );
            let triangles = if topology == Topology::Triangles { primitive.triangles() } else { 0 };
            let batch = self.batch((layout, topology, triangles), features, mirrored);
            self.batches.push(Batch { geometry: geometry as u32, material, layer, ..batch });
        }
        self.batches[index as usize].is_sky &= desc.nodes[placement.node].is_sky;
        index
    }

    /// Returns the batch of a placement, which it is joined to, and makes the one that it is in
    /// while it is turned inside out, if it may be.
    pub fn batch_of_moving(
        &mut self,
        desc: &Scene,
        look: Look,
        placement: &PrimitiveInstance<'_>,
        traits: &NodeTraits,
    ) -> u32 {
        // What is flat at rest may come to stand either way.
        let may_turn = traits.is_moving(placement.node) && (traits.may_mirror || placement.is_flat);
        let batch = if may_turn {
            // In one order, whichever way it stands: that of batches decides between equals.
            let [plain, mirrored] = [false, true].map(|is_mirrored| {
                self.batch_of(desc, look, &PrimitiveInstance { is_mirrored, ..*placement })
            });
            self.twins.insert(plain, mirrored);
            self.twins.insert(mirrored, plain);
            if placement.is_mirrored { mirrored } else { plain }
        } else {
            self.batch_of(desc, look, placement)
        };
        let of_batch = &mut self.batches[batch as usize].bounds;
        *of_batch = of_batch.union(placement.bounds);
        batch
    }

    fn batch(
        &mut self,
        (layout, topology, triangles): (VertexLayout, Topology, u64),
        features: MaterialFeatures,
        mirrored: bool,
    ) -> Batch {
        let is_blend = features.alpha == Alpha::Blend;
        let blended = is_blend || features.extensions.set.transmission;
        let key = PipelineKey {
            layout,
            topology,
            material: features,
            cull: if features.double_sided { Cull::Nothing } else { Cull::Back },
            mirrored,
            sun_count: self.template.sun_count,
            lamps: self.template.lamps,
            linear: self.template.linear,
            shadows: self.template.shadows,
            lamp_shadows: self.template.lamp_shadows,
        };
        let two_passes = is_blend && features.double_sided && topology == Topology::Triangles;
        let (pipeline, back_pipeline) = if two_passes {
            let back = self.key_index(PipelineKey { cull: Cull::Front, ..key });
            (self.key_index(PipelineKey { cull: Cull::Back, ..key }), Some(back))
        } else {
            (self.key_index(key), None)
        };
        let ordered_pipeline = (is_blend && triangles > 1).then(|| self.key_index(key));
        Batch {
            geometry: 0,
            material: 0,
            pipeline,
            back_pipeline,
            ordered_pipeline,
            blended,
            layer: 0,
            bounds: Bounds::EMPTY,
            is_sky: true,
            triangles,
        }
    }

    fn key_index(&mut self, key: PipelineKey) -> u32 {
        let known = self.keys.iter().position(|one| *one == key);
        known.unwrap_or_else(|| {
            self.keys.push(key);
            self.keys.len() - 1
        }) as u32
    }
}
