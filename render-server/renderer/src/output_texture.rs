//! A finished picture on the GPU.

use super::gpu::Gpu;
use super::target::{DISPLAY_FORMAT, LINEAR_FORMAT};

/// Bytes as they are written.
pub(crate) const CODES_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

/// Codes of ten bits.
pub const FINE_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgb10a2Unorm;

/// The encoding of a picture's pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImageEncoding {
    /// RGBA8 as sRGB, drawn in linear light: what a display gets.
    Srgb,
    /// RGBA8 for a display with a curve of its own: codes that are written as they stand.
    Codes,
    /// RGB10A2, for a display with 1,024 codes and a curve of its own.
    FineCodes,
    /// Display light from 0 to 1, linear, RGBA16F: what is still to be corrected.
    Light,
}

impl ImageEncoding {
    /// The format that it is drawn in.
    pub(crate) fn format(self) -> wgpu::TextureFormat {
        match self {
            Self::Srgb | Self::Codes => DISPLAY_FORMAT,
            Self::FineCodes => FINE_FORMAT,
            Self::Light => LINEAR_FORMAT,
        }
    }
}

/// A picture as displays get it: RGBA8 as sRGB, drawn in linear light, or as its content says.
#[derive(Debug)]
pub struct OutputTexture {
    size: [u32; 2],
    content: ImageEncoding,
    texture: wgpu::Texture,
    view: wgpu::TextureView,
}

impl AsRef<Self> for OutputTexture {
    fn as_ref(&self) -> &Self {
        self
    }
}

impl OutputTexture {
    /// A picture of a size in pixels, which the adapter must be able to hold.
    pub(crate) fn new(gpu: &Gpu, size: [u32; 2], content: ImageEncoding) -> Self {
        let [width, height] = size;
        let codes = [CODES_FORMAT];
        let has_codes = content == ImageEncoding::Codes && gpu.views_other_formats();
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("picture/texture"),
            size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: content.format(),
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT
                | wgpu::TextureUsages::TEXTURE_BINDING
                | wgpu::TextureUsages::COPY_SRC
                | wgpu::TextureUsages::COPY_DST,
            view_formats: if has_codes { &codes } else { &[] },
        });
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        Self { size, content, texture, view }
    }

    /// A picture to draw the next one onto: `spare` where it is like this one, else a new one.
    pub fn next(&self, gpu: &Gpu, spare: Option<Self>) -> Self {
        let fits = |it: &Self| it.size == self.size && it.content == self.content;
        spare.filter(fits).unwrap_or_else(|| Self::new(gpu, self.size, self.content))
    }

    /// The picture of these pixels: RGBA8 as sRGB, rows from the top, as many as `size` says.
    pub fn of_pixels(gpu: &Gpu, size: [u32; 2], rgba: &[u8]) -> Self {
        let picture = Self::new(gpu, size, ImageEncoding::Srgb);
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

    /// Returns the encoding of its pixels.
    pub fn content(&self) -> ImageEncoding {
        self.content
    }

    /// A view whose bytes are what is written; of the sRGB format, which encodes what is written,
    /// where the driver knows one format a texture.
    pub(crate) fn codes_view(&self, gpu: &Gpu) -> wgpu::TextureView {
        let has_codes = self.content == ImageEncoding::Codes && gpu.views_other_formats();
        self.texture.create_view(&wgpu::TextureViewDescriptor {
            label: Some("picture/codes"),
            format: has_codes.then_some(CODES_FORMAT),
            ..Default::default()
        })
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
