//! Light from all around, on the GPU.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use polyptych_scene::EnvironmentMap;
use polyptych_scene::environment_map::TEXEL_BYTES;

use super::gpu::Gpu;

/// Twin of `Environment` in `include/environment.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct EnvironmentUniform {
    pub diffuse: [[f32; 4]; 9],
}

/// The surroundings of scenes, uploaded; see [`GpuScene::with_environment`](super::GpuScene).
#[derive(Debug)]
pub struct Environment {
    map: wgpu::TextureView,
    sampler: wgpu::Sampler,
    diffuse: wgpu::Buffer,
    mean: Vec3,
    has_sun: bool,
}

impl Environment {
    /// Uploads surroundings. A fault of the GPU shows in [`Gpu::take_error`].
    pub fn new(gpu: &Gpu, map: &EnvironmentMap) -> Self {
        let mut diffuse = map.diffuse.map(|term| Vec3::from(term).extend(0.0).to_array());
        diffuse[0][3] = (map.levels() - 1) as f32;
        let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("environment/diffuse"),
            size: size_of::<EnvironmentUniform>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let uniform = EnvironmentUniform { diffuse };
        gpu.queue.write_buffer(&buffer, 0, bytemuck::bytes_of(&uniform));
        let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("environment/sampler"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: wgpu::MipmapFilterMode::Linear,
            ..Default::default()
        });
        let (mean, has_sun) = (map.diffuse[0].into(), map.has_sun);
        Self { map: texture(gpu, map), sampler, diffuse: buffer, mean, has_sun }
    }

    /// The mean of its radiance over all directions: all other terms of its diffuse light have a
    /// mean of 0.
    pub(crate) fn mean(&self) -> Vec3 {
        self.mean
    }

    /// Returns whether its light is all that a scene without lights has.
    pub(crate) fn has_sun(&self) -> bool {
        self.has_sun
    }

    /// Its bindings of group 0, beside those of every frame.
    pub(crate) fn entries(&self) -> [wgpu::BindGroupEntry<'_>; 3] {
        let entry = |binding, resource| wgpu::BindGroupEntry { binding, resource };
        [
            entry(16, wgpu::BindingResource::TextureView(&self.map)),
            entry(17, wgpu::BindingResource::Sampler(&self.sampler)),
            entry(18, self.diffuse.as_entire_binding()),
        ]
    }
}

fn texture(gpu: &Gpu, map: &EnvironmentMap) -> wgpu::TextureView {
    let size = |side| wgpu::Extent3d { width: side, height: side, depth_or_array_layers: 6 };
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("environment/map"),
        size: size(map.side),
        mip_level_count: map.levels(),
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba16Float,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let mut rest = &map.texels[..];
    for mip_level in 0..map.levels() {
        let side = map.side >> mip_level;
        let row = side as usize * TEXEL_BYTES;
        let (texels, after) = rest.split_at((6 * side as usize * row).min(rest.len()));
        rest = after;
        gpu.queue.write_texture(
            wgpu::TexelCopyTextureInfo { mip_level, ..texture.as_image_copy() },
            texels,
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(row as u32),
                rows_per_image: Some(side),
            },
            size(side),
        );
    }
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::Cube),
        ..Default::default()
    })
}
