//! Materials on the GPU, and what each asks of its pipeline.

use std::collections::HashMap;
use std::ops::Deref;
use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::{Affine2, Vec4};
use polyptych_scene::{
    AlphaMode, Highlight, Material, NodeStyle, Shading, TextureRef, VertexLayout,
};

use super::layout::SceneLayout;
use super::material_extension::{self, ExtensionFeatures, ExtensionGroup};
use crate::bindings;
use crate::gpu::Gpu;
use crate::pipeline::{Alpha, MaterialFeatures, TextureSlot};

/// Twin of `Material` in `include/material.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct MaterialUniform {
    pub base_color: [f32; 4],
    pub emissive: [f32; 3],
    pub roughness: f32,
    pub metallic: f32,
    pub normal_scale: f32,
    pub occlusion_strength: f32,
    pub alpha_cutoff: f32,
    /// Display light, and the part of it in what is shown.
    pub highlight: [f32; 4],
    /// Per texture, in the order of the bindings: columns x and y, then the offset.
    pub uv_transforms: [UvTransform; 5],
}

/// Twin of `UvTransform` in `include/material.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct UvTransform {
    pub columns: [f32; 4],
    pub offset: [f32; 4],
}

pub(super) fn uv_transform(affine: Affine2) -> UvTransform {
    let (x, y, offset) = (affine.x_axis, affine.y_axis, affine.translation);
    UvTransform { columns: [x.x, x.y, y.x, y.y], offset: [offset.x, offset.y, 0.0, 0.0] }
}

impl MaterialUniform {
    fn new(desc: &Material, highlight: Vec4) -> Self {
        let uses = desc.texture_slots();
        Self {
            base_color: desc.base_color.to_array(),
            emissive: desc.emissive.to_array(),
            roughness: desc.roughness,
            metallic: desc.metallic,
            normal_scale: desc.normal_scale,
            occlusion_strength: desc.occlusion_strength,
            alpha_cutoff: if let AlphaMode::Mask(cutoff) = desc.alpha_mode { cutoff } else { 0.0 },
            highlight: highlight.to_array(),
            uv_transforms: uses
                .map(|one| uv_transform(one.map_or(Affine2::IDENTITY, |one| one.uv_transform))),
        }
    }
}

/// A material as a style draws it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct StyledMaterial {
    /// An index into the scene's materials; the default one stands behind them.
    pub material: u32,
    pub is_unlit: bool,
    /// Display light, and the part of it in what is shown; zeros for none.
    pub highlight: Vec4,
}

impl StyledMaterial {
    /// The material in a style; `None` where it is drawn as it is.
    pub fn new(material: u32, style: NodeStyle) -> Option<Self> {
        let is_unlit = style.shading == Some(Shading::Unlit);
        let highlight = match style.highlight {
            Some(Highlight::Tint { color, share }) if share > 0.0 => color.extend(share),
            _ => Vec4::ZERO,
        };
        let is_styled = is_unlit || highlight != Vec4::ZERO;
        is_styled.then_some(Self { material, is_unlit, highlight })
    }

    /// All that tells it apart: the material, whether it is unlit, and the bits of the highlight.
    fn name(&self) -> (u32, bool, [u32; 4]) {
        // Both zeros are one number.
        let bits = self.highlight.to_array().map(|part| (part + 0.0).to_bits());
        (self.material, self.is_unlit, bits)
    }

    /// Its description, of that of the material.
    pub fn desc(&self, of: &Material) -> Material {
        Material { unlit: of.unlit || self.is_unlit, ..of.clone() }
    }

    /// The [`features`] of the description of a material.
    pub fn features(&self, of: &Material, layout: VertexLayout) -> MaterialFeatures {
        let highlighted = self.highlight != Vec4::ZERO;
        MaterialFeatures { highlighted, ..features(&self.desc(of), layout) }
    }
}

/// The materials of a layout as styles draw them, each once. Each node may have a tint of its own.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct StyledMaterials {
    all: Vec<StyledMaterial>,
    /// The index of each, by its name.
    known: HashMap<(u32, bool, [u32; 4]), u32>,
}

impl StyledMaterials {
    /// Returns the index of a material, which is added if it is not there.
    pub fn add(&mut self, styled: StyledMaterial) -> u32 {
        let next = self.all.len() as u32;
        let index = *self.known.entry(styled.name()).or_insert(next);
        if index == next {
            self.all.push(styled);
        }
        index
    }

    /// Returns the index of a material, if it is there.
    fn find(&self, styled: &StyledMaterial) -> Option<u32> {
        self.known.get(&styled.name()).copied()
    }
}

impl Deref for StyledMaterials {
    type Target = [StyledMaterial];

    fn deref(&self) -> &Self::Target {
        &self.all
    }
}

/// Returns the features of a material for the pipeline of a primitive with this layout. Texture
/// coordinates that the vertices lack are zero; a normal map without tangents is left out.
pub(crate) fn features(desc: &Material, layout: VertexLayout) -> MaterialFeatures {
    let uses = desc.texture_slots();
    let slot = |index: usize| slot_of(uses[index], layout);
    let lit = !desc.unlit;
    let only_lit = |slot| if lit { slot } else { TextureSlot::None };
    // glTF packs occlusion and roughness into one image: then one fetch serves both.
    let packed = uses[3].is_some() && uses[3] == uses[1];
    let normal = if layout.tangent { slot(2) } else { TextureSlot::None };
    let occlusion = if packed { TextureSlot::None } else { slot(3) };
    MaterialFeatures {
        alpha: match desc.alpha_mode {
            AlphaMode::Opaque => Alpha::Opaque,
            AlphaMode::Mask(_) => Alpha::Mask,
            AlphaMode::Blend => Alpha::Blend,
        },
        double_sided: desc.double_sided,
        lit,
        base_color: slot(0),
        metallic_roughness: only_lit(slot(1)),
        normal: only_lit(normal),
        occlusion: only_lit(occlusion),
        occlusion_packed: packed && lit,
        emissive: only_lit(slot(4)),
        glowing: lit && desc.emissive.max_element() > 0.0,
        uv_transformed: uses.iter().flatten().any(|one| one.uv_transform != Affine2::IDENTITY),
        highlighted: false,
        extensions: ExtensionFeatures::new(desc, layout),
    }
}

/// Returns the source of a texture's coordinates in a primitive with this layout.
pub(super) fn slot_of(used: Option<TextureRef>, layout: VertexLayout) -> TextureSlot {
    used.map_or(TextureSlot::None, |one| match one.uv_set {
        0 if layout.uv0 => TextureSlot::Uv0,
        1 if layout.uv1 => TextureSlot::Uv1,
        _ => TextureSlot::Corner,
    })
}

/// The bind groups of a material.
#[derive(Debug)]
pub(crate) struct MaterialGroups {
    /// Group 2.
    pub material: wgpu::BindGroup,
    /// Group 3, of one that has extensions.
    pub extensions: Option<ExtensionGroup>,
    /// Its values, from this byte on.
    values: (wgpu::Buffer, u64),
}

impl MaterialGroups {
    /// Gives it the values of a description with the same textures and extensions.
    pub fn set(&self, gpu: &Gpu, desc: &Material, highlight: Vec4) {
        let (buffer, offset) = &self.values;
        let uniform = MaterialUniform::new(desc, highlight);
        gpu.queue.write_buffer(buffer, *offset, bytemuck::bytes_of(&uniform));
        if let (Some(group), Some(of)) = (&self.extensions, &desc.extensions) {
            group.set(gpu, of);
        }
    }
}

/// The bind groups of the materials that a scene is drawn with: of many others, such as those of
/// files that were added several times, there are none.
#[derive(Debug)]
pub(crate) struct Materials {
    /// Shared by the scenes that have them.
    groups: Vec<Arc<MaterialGroups>>,
    /// The place of the groups of each described material, of the default one behind them, and of
    /// these as styles draw them.
    slots: Vec<Option<u32>>,
}

impl Materials {
    /// Returns the groups of a material of a batch; `None` if no batch had it when they were made.
    pub fn get(&self, material: u32) -> Option<&MaterialGroups> {
        self.shared(material).map(Arc::as_ref)
    }

    fn shared(&self, material: u32) -> Option<&Arc<MaterialGroups>> {
        let slot = self.slots.get(material as usize).copied().flatten()?;
        self.groups.get(slot as usize)
    }

    /// Returns whether it has the groups of all batches of a layout with the same materials.
    pub fn serve(&self, layout: &SceneLayout) -> bool {
        layout.batches.iter().all(|batch| self.get(batch.material).is_some())
    }
}

impl SceneLayout {
    /// Returns whether its materials are those of another layout, and change with clips as those
    /// do: one that clips changed until now has the values of their last moment on the GPU.
    pub(super) fn has_materials_of(&self, other: &Self) -> bool {
        self.desc.materials == other.desc.materials
            && self.styled == other.styled
            && self.changing == other.changing
    }

    /// The number in another layout of a material that is the same there, with all its textures,
    /// and that clips change in neither; `None` where there is none.
    pub(crate) fn same_material(&self, material: u32, other: &Self) -> Option<u32> {
        let [default, others_default] = [self, other].map(|of| of.desc.materials.len() as u32);
        // Its numbers here and there without a style, and its number there.
        let (own, others, number) = match material.checked_sub(default + 1) {
            Some(at) => {
                let styled = self.styled.get(at as usize)?;
                let at = other.styled.find(styled)?;
                (styled.material, styled.material, others_default + 1 + at)
            }
            None if material == default => (default, others_default, others_default),
            None => (material, material, material),
        };
        let desc = self.desc.materials.get(own as usize);
        let has_texture = |of: TextureRef| {
            let at = of.texture as usize;
            self.desc.textures.get(at) == other.desc.textures.get(at)
        };
        let is_changing = |of: &Self, number: u32| {
            of.changing.binary_search_by_key(&number, |(at, _)| *at).is_ok()
        };
        let is_same = desc == other.desc.materials.get(others as usize)
            && desc.is_none_or(|desc| desc.textures().all(has_texture))
            && !is_changing(self, own)
            && !is_changing(other, others);
        is_same.then_some(number)
    }
}

/// Returns the slot of each of so many materials, if it is drawn, and the material of each slot.
fn slots(count: usize, drawn: impl Iterator<Item = u32>) -> (Vec<Option<u32>>, Vec<u32>) {
    let (mut slots, mut materials) = (vec![None; count], Vec::new());
    for material in drawn {
        let Some(slot) = slots.get_mut(material as usize) else { continue };
        if slot.is_none() {
            *slot = Some(materials.len() as u32);
            materials.push(material);
        }
    }
    (slots, materials)
}

/// The bind groups of the materials that the batches of a layout have, and of the default one:
/// those of a `known` scene, whose textures are shared, or else new ones.
pub(super) fn bind_groups(
    gpu: &Gpu,
    layout: &SceneLayout,
    (views, samplers): (&[wgpu::TextureView], &[wgpu::Sampler]),
    known: Option<(&SceneLayout, &Materials)>,
) -> Materials {
    let (described, default) = (&layout.desc.materials, Material::default());
    let own = |material: u32| described.get(material as usize).unwrap_or(&default);
    let look = |&material: &u32| {
        let behind = (material as usize).checked_sub(described.len() + 1);
        match behind.and_then(|at| layout.styled.get(at)) {
            Some(styled) => (styled.desc(own(styled.material)), styled.highlight),
            None => (own(material).clone(), Vec4::ZERO),
        }
    };
    // The default one first: no list is empty then.
    let drawn = layout.batches.iter().map(|batch| batch.material);
    let drawn = std::iter::once(described.len() as u32).chain(drawn);
    let (slots, drawn) = slots(described.len() + 1 + layout.styled.len(), drawn);
    let kept = |material: &u32| {
        let (of, materials) = known?;
        materials.shared(layout.same_material(*material, of)?).cloned()
    };
    let kept: Vec<Option<Arc<MaterialGroups>>> = drawn.iter().map(kept).collect();
    let missing = drawn.iter().zip(&kept).filter(|(_, kept)| kept.is_none());
    let missing: Vec<(Material, Vec4)> = missing.map(|(material, _)| look(material)).collect();
    let mut made = groups_of(gpu, &missing, views, samplers).into_iter().map(Arc::new);
    // In the order of the slots.
    let groups = kept.into_iter().filter_map(|kept| kept.or_else(|| made.next()));
    Materials { groups: groups.collect(), slots }
}

/// The bind groups of materials with the highlights that styles lay over them.
fn groups_of(
    gpu: &Gpu,
    materials: &[(Material, Vec4)],
    views: &[wgpu::TextureView],
    samplers: &[wgpu::Sampler],
) -> Vec<MaterialGroups> {
    if materials.is_empty() {
        return Vec::new();
    }
    let stride = bindings::uniform_stride(gpu, size_of::<MaterialUniform>());
    let mut bytes = vec![0; stride * materials.len()];
    for (slot, (material, highlight)) in bytes.chunks_exact_mut(stride).zip(materials) {
        let uniform = MaterialUniform::new(material, *highlight);
        slot[..size_of::<MaterialUniform>()].copy_from_slice(bytemuck::bytes_of(&uniform));
    }
    let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("material/uniforms"),
        size: bytes.len() as u64,
        usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    gpu.queue.write_buffer(&buffer, 0, &bytes);
    let layout = bindings::material_layout(&gpu.device);
    let (empty_view, empty_sampler) = (views.len() - 1, samplers.len() - 1);
    let group = |(index, (material, _)): (usize, &(Material, Vec4))| {
        let uses = material.texture_slots();
        let at = |one: usize, empty: usize| uses[one].map_or(empty, |one| one.texture as usize);
        let mut entries = vec![wgpu::BindGroupEntry {
            binding: 0,
            resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                buffer: &buffer,
                offset: (index * stride) as u64,
                size: wgpu::BufferSize::new(size_of::<MaterialUniform>() as u64),
            }),
        }];
        for slot in 0..5 {
            entries.push(wgpu::BindGroupEntry {
                binding: 1 + slot as u32,
                resource: wgpu::BindingResource::TextureView(&views[at(slot, empty_view)]),
            });
            entries.push(wgpu::BindGroupEntry {
                binding: 6 + slot as u32,
                resource: wgpu::BindingResource::Sampler(&samplers[at(slot, empty_sampler)]),
            });
        }
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("material/group"),
            layout: &layout,
            entries: &entries,
        })
    };
    let extended: Vec<&Material> = materials.iter().map(|(material, _)| material).collect();
    let extensions = material_extension::bind_groups(gpu, &extended, views, samplers);
    let groups = materials.iter().enumerate().map(group).zip(extensions).enumerate();
    let with_values = |(index, (material, extensions))| {
        let values = (buffer.clone(), (index * stride) as u64);
        MaterialGroups { material, extensions, values }
    };
    groups.map(with_values).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_materials_that_are_drawn_have_slots() {
        let (slots, materials) = slots(6, [3, 5, 3, 0, 9].into_iter());
        assert_eq!(slots, [Some(2), None, None, Some(0), None, Some(1)]);
        assert_eq!(materials, [3, 5, 0]);
    }
}
