//! Textures and samplers on the GPU.

use polyptych_files::blob::BlobHash;
use polyptych_scene::{Filter, MipFilter, Sampler, Texture, TextureFormat, Wrap};

use crate::gpu::Gpu;

/// Makes a texture with all its levels, but for the largest `levels_left_out` where smaller ones
/// remain. `bytes` has been checked against the description.
pub(crate) fn upload(
    gpu: &Gpu,
    desc: &Texture,
    bytes: &[u8],
    levels_left_out: u32,
) -> wgpu::TextureView {
    let first = desc.first_level(levels_left_out);
    let [width, height] = desc.level_size(first);
    let format = match desc.format {
        TextureFormat::Rgba8Srgb => wgpu::TextureFormat::Rgba8UnormSrgb,
        TextureFormat::Rgba8Linear => wgpu::TextureFormat::Rgba8Unorm,
    };
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("material/texture"),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: desc.mip_count - first,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let mut rest = bytes;
    for level in 0..desc.mip_count {
        let [width, height] = desc.level_size(level);
        let (pixels, after) = rest.split_at((width as usize * height as usize * 4).min(rest.len()));
        rest = after;
        let Some(mip_level) = level.checked_sub(first) else { continue };
        gpu.queue.write_texture(
            wgpu::TexelCopyTextureInfo { mip_level, ..texture.as_image_copy() },
            pixels,
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(width * 4),
                rows_per_image: None,
            },
            wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        );
    }
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}

/// The sampler of a description.
pub(crate) fn sampler(gpu: &Gpu, desc: Sampler) -> wgpu::Sampler {
    let filter = |filter| match filter {
        Filter::Linear => wgpu::FilterMode::Linear,
        Filter::Nearest => wgpu::FilterMode::Nearest,
    };
    let wrap = |wrap| match wrap {
        Wrap::Clamp => wgpu::AddressMode::ClampToEdge,
        Wrap::Mirror => wgpu::AddressMode::MirrorRepeat,
        Wrap::Repeat => wgpu::AddressMode::Repeat,
    };
    let (mipmap_filter, lod_max_clamp) = match desc.mip {
        // A quarter keeps the decision between magnified and minified, which a limit of 0
        // would take away: Vulkan, "Mapping of OpenGL to Vulkan filter modes".
        MipFilter::None => (wgpu::MipmapFilterMode::Nearest, 0.25),
        MipFilter::Nearest => (wgpu::MipmapFilterMode::Nearest, 32.0),
        MipFilter::Linear => (wgpu::MipmapFilterMode::Linear, 32.0),
    };
    gpu.device.create_sampler(&wgpu::SamplerDescriptor {
        label: Some("material/sampler"),
        address_mode_u: wrap(desc.wrap_u),
        address_mode_v: wrap(desc.wrap_v),
        mag_filter: filter(desc.mag),
        min_filter: filter(desc.min),
        mipmap_filter,
        lod_max_clamp,
        ..Default::default()
    })
}

/// A white texture of one pixel, for bindings that a material leaves empty. No shader reads it.
pub(crate) fn placeholder(gpu: &Gpu) -> wgpu::TextureView {
    let desc = Texture {
        blob: BlobHash([0; 32]),
        format: TextureFormat::Rgba8Linear,
        width: 1,
        height: 1,
        mip_count: 1,
        sampler: Sampler::default(),
    };
    upload(gpu, &desc, &[255; 4], 0)
}
