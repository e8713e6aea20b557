//! A finished picture on the GPU.

use super::gpu::Gpu;
use super::target::DISPLAY_FORMAT;

/// A picture as displays get it: RGBA8 as sRGB, drawn in linear light.
#[derive(Debug)]
pub struct Picture {
    size: [u32; 2],
    texture: wgpu::Texture,
    view: wgpu::TextureView,
}

impl Picture {
    /// A picture of a size in pixels, which the adapter must be able to hold.
    pub(in crate::renderer) fn new(gpu: &Gpu, size: [u32; 2]) -> Self {
        let [width, height] = size;
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("picture/texture"),
            size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: DISPLAY_FORMAT,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT
                | wgpu::TextureUsages::TEXTURE_BINDING
                | wgpu::TextureUsages::COPY_SRC
                | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        Self { size, texture, view }
    }

    /// The picture of these pixels: RGBA8 as sRGB, rows from the top, as many as `size` says.
    pub(in crate::renderer) fn of_pixels(gpu: &Gpu, size: [u32; 2], rgba: &[u8]) -> Self {
        let picture = Self::new(gpu, size);
        let [width, height] = size;
        gpu.queue.write_texture(
            picture.texture.as_image_copy(),
            rgba,
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(width * 4),
                rows_per_image: None,
            },
            wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        );
        picture
    }

    /// Width and height in pixels.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// The texture itself.
    pub fn texture(&self) -> &wgpu::Texture {
        &self.texture
    }

    /// A view of all of it.
    pub fn view(&self) -> &wgpu::TextureView {
        &self.view
    }
}
