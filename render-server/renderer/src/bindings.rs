//! The bind groups, said once: 0 frame, 1 pass, 2 material, 3 what extensions add to it;
//! instances are a vertex buffer.
//!
//! wgpu takes equal layouts for the same, so whoever needs one makes it here.

use polyptych_scene::EXTENSION_TEXTURES_MAX;

use super::environment::EnvironmentUniform;
use super::gpu::Gpu;
use super::guarded_region::BehindUniform;
use super::lamp_map::LampShadowRecord;
use super::pass::ambient_occlusion::OcclusionUniform;
use super::pass::background::BackgroundUniform;
use super::pass::correct::{CellRecord, CorrectionUniform};
use super::pass::depth_of_field::LensUniform;
use super::scene::{ExtensionUniform, MaterialUniform};
use super::shadow_uniform::ShadowUniform;
use super::view::{FrameUniform, LocalLightRecord};

/// The step from one uniform block to the next in a buffer, in bytes.
pub(crate) fn uniform_stride(gpu: &Gpu, size: usize) -> usize {
    size.next_multiple_of(gpu.device.limits().min_uniform_buffer_offset_alignment as usize)
}

fn buffer(
    binding: u32,
    visibility: wgpu::ShaderStages,
    ty: wgpu::BufferBindingType,
    has_dynamic_offset: bool,
    size: usize,
) -> wgpu::BindGroupLayoutEntry {
    let min_binding_size = wgpu::BufferSize::new(size as u64);
    let ty = wgpu::BindingType::Buffer { ty, has_dynamic_offset, min_binding_size };
    wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None }
}

fn texture(binding: u32, filterable: bool) -> wgpu::BindGroupLayoutEntry {
    texture_of(binding, filterable, wgpu::TextureViewDimension::D2)
}

fn texture_of(
    binding: u32,
    filterable: bool,
    view_dimension: wgpu::TextureViewDimension,
) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::FRAGMENT,
        ty: wgpu::BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Float { filterable },
            view_dimension,
            multisampled: false,
        },
        count: None,
    }
}

fn sampler(binding: u32) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::FRAGMENT,
        ty: wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
        count: None,
    }
}

/// What group 0 has beside that which all frames have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct FrameExtras {
    /// The map of an environment, a sampler, and its diffuse light.
    pub environment: bool,
    /// The pictures behind surfaces that transmit light, and their places.
    pub behind: bool,
    /// The map of ambient occlusion.
    pub occlusion: bool,
}

/// Group 0: the view's uniforms and lamps, each at an offset, the lists of lamps, and the table of
/// [`albedo`](super::albedo) with its sampler.
pub(crate) fn frame_layout(device: &wgpu::Device, extras: FrameExtras) -> wgpu::BindGroupLayout {
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("frame/layout"),
        entries: &frame_entries(extras),
    })
}

/// Group 1 of the search for ambient occlusion, and of its smoothing: the depths of views, or what
/// was found, and the uniforms of a view, each at an offset.
pub(crate) fn occlusion_layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    let (fragment, uniform) = (wgpu::ShaderStages::FRAGMENT, wgpu::BufferBindingType::Uniform);
    let uniforms = buffer(1, fragment, uniform, true, size_of::<OcclusionUniform>());
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("ambient_occlusion/layout"),
        entries: &[texture(0, false), uniforms],
    })
}

fn environment_entries() -> [wgpu::BindGroupLayoutEntry; 3] {
    let (fragment, uniform) = (wgpu::ShaderStages::FRAGMENT, wgpu::BufferBindingType::Uniform);
    [
        texture_of(16, true, wgpu::TextureViewDimension::Cube),
        sampler(17),
        buffer(18, fragment, uniform, false, size_of::<EnvironmentUniform>()),
    ]
}

/// Group 1 of the background: what each view sees, at an offset.
pub(crate) fn view_layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    let (fragment, uniform) = (wgpu::ShaderStages::FRAGMENT, wgpu::BufferBindingType::Uniform);
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("background/layout"),
        entries: &[buffer(0, fragment, uniform, true, size_of::<BackgroundUniform>())],
    })
}

/// The entries of [`frame_layout`].
pub(crate) fn frame_entries(extras: FrameExtras) -> Vec<wgpu::BindGroupLayoutEntry> {
    let both = wgpu::ShaderStages::VERTEX_FRAGMENT;
    let fragment = wgpu::ShaderStages::FRAGMENT;
    let storage = wgpu::BufferBindingType::Storage { read_only: true };
    let uniform = wgpu::BufferBindingType::Uniform;
    let mut entries = vec![
        buffer(0, both, uniform, true, size_of::<FrameUniform>()),
        buffer(1, fragment, storage, true, size_of::<LocalLightRecord>()),
        buffer(2, fragment, storage, false, size_of::<u32>()),
        texture(3, true),
        sampler(4),
    ];
    if extras.environment {
        entries.extend(environment_entries());
    }
    if extras.behind {
        let places = buffer(25, fragment, uniform, true, size_of::<BehindUniform>());
        entries.extend([texture(24, true), places]);
    }
    if extras.occlusion {
        entries.push(texture(26, false));
    }
    entries
}

/// Group 1 of the passes over a scene with lights that cast shadows: the view's uniforms, the maps
/// of suns, and the sampler that compares; where lamps cast some, their records and maps too.
pub(crate) fn shadow_layout(device: &wgpu::Device, has_lamps: bool) -> wgpu::BindGroupLayout {
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("shadow/layout"),
        entries: &shadow_entries(has_lamps),
    })
}

/// The entries of [`shadow_layout`].
pub(crate) fn shadow_entries(has_lamps: bool) -> Vec<wgpu::BindGroupLayoutEntry> {
    let fragment = wgpu::ShaderStages::FRAGMENT;
    let uniform = wgpu::BufferBindingType::Uniform;
    let entry =
        |binding, ty| wgpu::BindGroupLayoutEntry { binding, visibility: fragment, ty, count: None };
    let maps = wgpu::BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Depth,
        view_dimension: wgpu::TextureViewDimension::D2Array,
        multisampled: false,
    };
    let storage = wgpu::BufferBindingType::Storage { read_only: true };
    let mut entries = vec![
        buffer(0, fragment, uniform, false, size_of::<ShadowUniform>()),
        entry(1, maps),
        entry(2, wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Comparison)),
    ];
    if has_lamps {
        let records = buffer(3, fragment, storage, false, size_of::<LampShadowRecord>());
        entries.extend([records, entry(4, maps)]);
    }
    entries
}

/// Group 1 of the passes that read a picture: the picture, and a sampler.
pub(crate) fn picture_layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("picture/layout"),
        entries: &[texture(0, true), sampler(1)],
    })
}

/// Group 1 of the way to the display target with glow: the float target, a sampler, the picture
/// that spreads, and the uniforms of a view, each at an offset.
pub(crate) fn glow_layout(device: &wgpu::Device, uniform_size: usize) -> wgpu::BindGroupLayout {
    let uniform = wgpu::BufferBindingType::Uniform;
    let uniform = buffer(3, wgpu::ShaderStages::FRAGMENT, uniform, true, uniform_size);
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("glow/layout"),
        entries: &[texture(0, true), sampler(1), texture(2, true), uniform],
    })
}

/// Group 1 of depth of field: the uniforms of a view, each at an offset, a sampler, a picture and
/// its depth of one sample for each texel or of several, and five pictures that are computed from
/// these.
pub(crate) fn lens_layout(device: &wgpu::Device, multisampled: bool) -> wgpu::BindGroupLayout {
    let fragment = wgpu::ShaderStages::FRAGMENT;
    let uniform = wgpu::BufferBindingType::Uniform;
    let depth = wgpu::BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Depth,
        view_dimension: wgpu::TextureViewDimension::D2,
        multisampled,
    };
    let mut entries = vec![
        buffer(0, fragment, uniform, true, size_of::<LensUniform>()),
        sampler(1),
        texture(2, true),
        wgpu::BindGroupLayoutEntry { binding: 3, visibility: fragment, ty: depth, count: None },
    ];
    entries.extend((4..=8).map(|binding| texture(binding, true)));
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("depth_of_field/layout"),
        entries: &entries,
    })
}

/// Group 1 of the passes that read depth: of one sample for each pixel, with a sampler, or of
/// several.
pub(crate) fn depth_layout(device: &wgpu::Device, multisampled: bool) -> wgpu::BindGroupLayout {
    let (view_dimension, visibility) =
        (wgpu::TextureViewDimension::D2, wgpu::ShaderStages::FRAGMENT);
    let sample_type = wgpu::TextureSampleType::Depth;
    let depth = wgpu::BindingType::Texture { sample_type, view_dimension, multisampled };
    let texels = wgpu::BindingType::Sampler(wgpu::SamplerBindingType::NonFiltering);
    let entry = |binding, ty| wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None };
    let entries = [entry(0, depth), entry(1, texels)];
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("depth/layout"),
        entries: if multisampled { &entries[..1] } else { &entries },
    })
}

/// Group 1 of the correction: the source, its sampler, uniforms, light map, measured codes, and
/// planes that have triangles of their own.
pub(crate) fn correction_layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    let both = wgpu::ShaderStages::VERTEX_FRAGMENT;
    let fragment = wgpu::ShaderStages::FRAGMENT;
    let storage = wgpu::BufferBindingType::Storage { read_only: true };
    let uniform = wgpu::BufferBindingType::Uniform;
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("correction/layout"),
        entries: &[
            texture(0, true),
            sampler(1),
            buffer(2, both, uniform, false, size_of::<CorrectionUniform>()),
            texture_of(3, true, wgpu::TextureViewDimension::D2Array),
            buffer(4, fragment, storage, false, 2 * size_of::<[f32; 4]>()),
            sampler(5),
            buffer(6, wgpu::ShaderStages::VERTEX, storage, false, size_of::<CellRecord>()),
        ],
    })
}

/// Group 2: factors, five textures, five samplers.
pub(crate) fn material_layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("material/layout"),
        entries: &material_entries(),
    })
}

/// The entries of [`material_layout`].
pub(crate) fn material_entries() -> Vec<wgpu::BindGroupLayoutEntry> {
    let fragment = wgpu::ShaderStages::FRAGMENT;
    let uniform = wgpu::BufferBindingType::Uniform;
    let mut entries = vec![buffer(0, fragment, uniform, false, size_of::<MaterialUniform>())];
    entries.extend((1..=5).map(|binding| texture(binding, true)));
    entries.extend((6..=10).map(sampler));
    entries
}

/// Group 3: factors of extensions, their textures, their samplers; the table of
/// [`grain_albedo`](super::grain_albedo) where a material is anisotropic.
pub(crate) fn extension_layout(device: &wgpu::Device, has_grain: bool) -> wgpu::BindGroupLayout {
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("extension/layout"),
        entries: &extension_entries(has_grain),
    })
}

/// The entries of [`extension_layout`].
pub(crate) fn extension_entries(has_grain: bool) -> Vec<wgpu::BindGroupLayoutEntry> {
    const TEXTURES: u32 = EXTENSION_TEXTURES_MAX as u32;
    let fragment = wgpu::ShaderStages::FRAGMENT;
    let uniform = wgpu::BufferBindingType::Uniform;
    let mut entries = vec![buffer(0, fragment, uniform, false, size_of::<ExtensionUniform>())];
    entries.extend((1..=TEXTURES).map(|binding| texture(binding, true)));
    entries.extend((1 + TEXTURES..=2 * TEXTURES).map(sampler));
    if has_grain {
        entries.push(texture_of(1 + 2 * TEXTURES, true, wgpu::TextureViewDimension::D3));
    }
    entries
}
