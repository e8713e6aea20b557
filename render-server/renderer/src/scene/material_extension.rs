//! The data of glTF material extensions on the GPU: bind group 3.

use bytemuck::{Pod, Zeroable};
use glam::Affine2;
use polyptych_scene::{
    EXTENSION_SLOTS, EXTENSION_TEXTURES_MAX, Material, MaterialExtensions, VertexLayout,
};

use super::material::{UvTransform, slot_of, uv_transform};
use crate::bindings;
use crate::gpu::Gpu;
use crate::grain_albedo;
use crate::pipeline::TextureSlot;
use crate::shader::ExtensionSet;

/// The slot of the clear coat's normal map.
const CLEARCOAT_NORMAL: usize = 4;
/// The slot of the anisotropy.
const ANISOTROPY: usize = 9;
/// The slot of the baked light.
const BAKED_LIGHT: usize = 14;

/// Twin of `Extension` in `include/extension.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct ExtensionUniform {
    /// The transforms of the textures' coordinates, in the order of the bindings.
    pub uv_transforms: [UvTransform; EXTENSION_TEXTURES_MAX],
    /// Reflectance from the front, and its part that is there.
    pub specular: [f32; 4],
    /// Part, roughness, scale of the normal map; the intensity of baked light.
    pub clearcoat: [f32; 4],
    /// Colour, roughness.
    pub sheen: [f32; 4],
    /// Part, thickness, inverse of the index of refraction, 20 over the Abbe number.
    pub transmission: [f32; 4],
    /// Absorption of the volume per unit of the world; the factor of roughness for light that
    /// passes.
    pub absorption: [f32; 4],
    /// Strength, cosine and sine of the direction's angle.
    pub anisotropy: [f32; 4],
    /// Part, index of refraction, thickness in nanometres from and to.
    pub film: [f32; 4],
    /// Colour of what passes diffusely, and its part.
    pub through: [f32; 4],
}

impl ExtensionUniform {
    fn new(of: &MaterialExtensions) -> Self {
        let distinct = of.distinct_textures();
        let transform =
            |at: usize| distinct.get(at).map_or(Affine2::IDENTITY, |one| one.uv_transform);
        let specular = of.specular.clone().unwrap_or_default();
        let coat = of.clearcoat.clone().unwrap_or_default();
        let sheen = of.sheen.clone().unwrap_or_default();
        let part = of.transmission.as_ref().map_or(0.0, |of| of.factor);
        let volume = of.volume.clone().unwrap_or_default();
        // An index of 0 stands for one without end, which bends light to the normal.
        let is_endless = specular.ior == 0.0;
        let inverse = if is_endless { 0.0 } else { specular.ior.recip() };
        let rough = if is_endless { 1.0 } else { (2.0 * specular.ior - 2.0).clamp(0.0, 1.0) };
        let through = of.diffuse_transmission.clone().unwrap_or_default();
        let baked = of.baked_light.as_ref().map_or(0.0, |of| of.intensity);
        Self {
            uv_transforms: std::array::from_fn(|at| uv_transform(transform(at))),
            specular: (specular.color * specular.reflectance()).extend(specular.factor).to_array(),
            clearcoat: [coat.factor, coat.roughness, coat.normal_scale, baked],
            sheen: sheen.color.extend(sheen.roughness).to_array(),
            transmission: [part, volume.thickness, inverse, volume.dispersion],
            absorption: volume.absorption().extend(rough).to_array(),
            anisotropy: of.anisotropy.as_ref().map_or([0.0; 4], |of| {
                let direction = of.direction();
                [of.strength, direction.x, direction.y, 0.0]
            }),
            film: of.iridescence.as_ref().map_or([0.0; 4], |of| {
                [of.factor, of.ior, of.thickness_min_nm, of.thickness_max_nm]
            }),
            through: through.color.extend(through.factor).to_array(),
        }
    }
}

/// The features of a material's extensions that its pipeline must have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct ExtensionFeatures {
    pub set: ExtensionSet,
    /// For each slot of [`MaterialExtensions::texture_slots`] the binding of its texture, from 1;
    /// 0 for none.
    pub places: [u8; EXTENSION_SLOTS],
    /// The coordinates of each binding.
    pub coordinates: [TextureSlot; EXTENSION_TEXTURES_MAX],
    /// The material is anisotropic, though its vertices may lack tangents: its bindings have the
    /// table for it.
    pub has_grain: bool,
}

impl ExtensionFeatures {
    /// Those of a material; none of one that takes no light.
    pub fn new(desc: &Material, layout: VertexLayout) -> Self {
        let Some(of) = desc.extensions.as_deref().filter(|_| !desc.unlit) else {
            return Self::default();
        };
        let mut distinct = of.distinct_textures();
        distinct.truncate(EXTENSION_TEXTURES_MAX);
        let place = |slot| distinct.iter().position(|one| Some(*one) == slot);
        let mut places = of.texture_slots().map(|slot| place(slot).map_or(0, |at| at as u8 + 1));
        if !layout.tangent {
            places[CLEARCOAT_NORMAL] = 0;
            places[ANISOTROPY] = 0;
        }
        let volume = of.volume.as_ref().filter(|_| of.transmission.is_some());
        // Light that is bent to the normal has one direction for all wavelengths.
        let bends = of.specular.as_ref().is_none_or(|of| of.ior != 0.0);
        Self {
            set: ExtensionSet {
                specular: of.specular.is_some() || of.iridescence.is_some(),
                clearcoat: of.clearcoat.is_some(),
                sheen: of.sheen.is_some(),
                transmission: of.transmission.is_some(),
                volume: of.has_volume(),
                dispersion: bends && volume.is_some_and(|of| of.dispersion > 0.0),
                anisotropy: layout.tangent && of.anisotropy.is_some(),
                iridescence: of.iridescence.is_some(),
                diffuse_transmission: of.diffuse_transmission.is_some(),
                baked_light: places[BAKED_LIGHT] != 0,
            },
            places,
            coordinates: std::array::from_fn(|at| slot_of(distinct.get(at).copied(), layout)),
            has_grain: of.anisotropy.is_some(),
        }
    }

    /// Returns whether tangents are read.
    pub fn has_tangents(self) -> bool {
        self.places[CLEARCOAT_NORMAL] != 0 || self.set.anisotropy
    }

    /// The constants of its shader.
    pub fn constants(self) -> Vec<(&'static str, f64)> {
        const COORDINATES: [&str; EXTENSION_TEXTURES_MAX] =
            ["FURTHER_1", "FURTHER_2", "FURTHER_3", "FURTHER_4", "FURTHER_5"];
        if self.set.is_empty() {
            return Vec::new();
        }
        let coordinates = self.coordinates.map(|slot| f64::from(slot as u8));
        let set = self.set;
        let names: [(&str, bool); EXTENSION_SLOTS] = [
            ("SPECULAR", set.specular),
            ("SPECULAR_COLOR", set.specular),
            ("CLEARCOAT", set.clearcoat),
            ("CLEARCOAT_ROUGHNESS", set.clearcoat),
            ("CLEARCOAT_NORMAL", set.clearcoat),
            ("SHEEN_COLOR", set.sheen),
            ("SHEEN_ROUGHNESS", set.sheen),
            ("TRANSMISSION", set.transmission),
            ("THICKNESS", set.volume),
            ("ANISOTROPY", set.anisotropy),
            ("IRIDESCENCE", set.iridescence),
            ("IRIDESCENCE_THICKNESS", set.iridescence),
            ("THROUGH", set.diffuse_transmission),
            ("THROUGH_COLOR", set.diffuse_transmission),
            ("BAKED_LIGHT", set.baked_light),
        ];
        let places = names.into_iter().zip(self.places.map(f64::from));
        let places = places.filter_map(|((name, is_there), at)| is_there.then_some((name, at)));
        COORDINATES.into_iter().zip(coordinates).chain(places).collect()
    }
}

/// Bind group 3 of a material.
#[derive(Clone, Debug)]
pub(crate) struct ExtensionGroup {
    pub group: wgpu::BindGroup,
    values: wgpu::Buffer,
}

impl ExtensionGroup {
    /// Gives it other values.
    pub fn set(&self, gpu: &Gpu, of: &MaterialExtensions) {
        let uniform = ExtensionUniform::new(of);
        gpu.queue.write_buffer(&self.values, 0, bytemuck::bytes_of(&uniform));
    }
}

/// Bind group 3 of each material that has extensions.
pub(super) fn bind_groups(
    gpu: &Gpu,
    materials: &[&Material],
    views: &[wgpu::TextureView],
    samplers: &[wgpu::Sampler],
) -> Vec<Option<ExtensionGroup>> {
    let extended = |of: &&Material| of.extensions.is_some() && !of.unlit;
    if !materials.iter().any(extended) {
        return vec![None; materials.len()];
    }
    let is_anisotropic =
        |of: &&Material| extended(of) && of.extensions.iter().any(|of| of.anisotropy.is_some());
    let grain = materials.iter().any(is_anisotropic).then(|| grain_albedo::texture(gpu));
    let layouts = [false, true].map(|has| bindings::extension_layout(&gpu.device, has));
    let (empty_view, empty_sampler) = (views.len() - 1, samplers.len() - 1);
    let group = |of: &MaterialExtensions| {
        let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("extension/uniforms"),
            size: size_of::<ExtensionUniform>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        gpu.queue.write_buffer(&buffer, 0, bytemuck::bytes_of(&ExtensionUniform::new(of)));
        let distinct = of.distinct_textures();
        let at =
            |one: usize, empty: usize| distinct.get(one).map_or(empty, |of| of.texture as usize);
        let mut entries =
            vec![wgpu::BindGroupEntry { binding: 0, resource: buffer.as_entire_binding() }];
        for place in 0..EXTENSION_TEXTURES_MAX {
            entries.push(wgpu::BindGroupEntry {
                binding: 1 + place as u32,
                resource: wgpu::BindingResource::TextureView(&views[at(place, empty_view)]),
            });
            entries.push(wgpu::BindGroupEntry {
                binding: (1 + EXTENSION_TEXTURES_MAX + place) as u32,
                resource: wgpu::BindingResource::Sampler(&samplers[at(place, empty_sampler)]),
            });
        }
        let grain = grain.as_ref().filter(|_| of.anisotropy.is_some());
        entries.extend(grain.map(|table| wgpu::BindGroupEntry {
            binding: (1 + 2 * EXTENSION_TEXTURES_MAX) as u32,
            resource: wgpu::BindingResource::TextureView(table),
        }));
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("extension/group"),
            layout: &layouts[usize::from(grain.is_some())],
            entries: &entries,
        });
        ExtensionGroup { group, values: buffer }
    };
    let of = |one: &&Material| one.extensions.as_deref().filter(|_| !one.unlit).map(group);
    materials.iter().map(of).collect()
}
