//! The textures that a channel is drawn into.

use super::frame::OcclusionMemory;
use super::gpu::Gpu;
use super::output_texture::{ImageEncoding, OutputTexture};
use super::picture_target::picture_texture;

/// Bytes are sRGB; blending and resolving happen in linear light.
pub(crate) const DISPLAY_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8UnormSrgb;
/// Exposed light before tone mapping; its alpha is said in `include/tone.wgsl`.
pub(crate) const LINEAR_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;
/// Reversed: 0 is infinitely far.
pub(crate) const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// Why a target cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum TargetError {
    /// Nothing, or more than the adapter can.
    #[error("a target of {width} × {height} pixels, where 1 to {side_max} can be")]
    Size {
        /// Pixels across.
        width: u32,
        /// Pixels down.
        height: u32,
        /// The adapter's limit.
        side_max: u32,
    },
    /// Neither 1 nor 4.
    #[error("{0} samples per pixel, where 1 or 4 can be")]
    Samples(u32),
}

/// The textures of one channel, in pixels of the channel.
#[derive(Debug)]
pub struct Target {
    size: [u32; 2],
    samples: u32,
    display: OutputTexture,
    /// Only where the scene blends.
    linear: Option<wgpu::TextureView>,
    /// Only with several samples per pixel.
    multisampled: Option<wgpu::TextureView>,
    depth: wgpu::TextureView,
    /// The light with depth of field; `None` where the frame has none.
    focus: Option<wgpu::TextureView>,
    pub(crate) occlusion: OcclusionMemory,
}

impl AsRef<OutputTexture> for Target {
    fn as_ref(&self) -> &OutputTexture {
        &self.display
    }
}

impl Target {
    /// Textures for pictures of a size in pixels. `samples` is the renderer's; `linear` is
    /// [`GpuScene::has_transparency`](super::GpuScene::has_transparency).
    ///
    /// # Errors
    /// A side of 0 or beyond the adapter; samples other than 1 or 4.
    pub fn new(gpu: &Gpu, size: [u32; 2], samples: u32, linear: bool) -> Result<Self, TargetError> {
        Self::with_encoding(gpu, size, samples, linear, ImageEncoding::Srgb)
    }

    /// Creates a target as [`Self::new`] does, for pictures of this content: light, if they are to
    /// be corrected.
    ///
    /// # Errors
    /// Those of [`Self::new`].
    pub fn with_encoding(
        gpu: &Gpu,
        size: [u32; 2],
        samples: u32,
        linear: bool,
        content: ImageEncoding,
    ) -> Result<Self, TargetError> {
        let [width, height] = size;
        let side_max = gpu.device.limits().max_texture_dimension_2d;
        if size.iter().any(|side| !(1..=side_max).contains(side)) {
            return Err(TargetError::Size { width, height, side_max });
        }
        if samples != 1 && samples != 4 {
            return Err(TargetError::Samples(samples));
        }
        let make = |label, format, sample_count, usage| {
            gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage,
                view_formats: &[],
            })
        };
        let whole = wgpu::TextureViewDescriptor::default();
        let view = |texture: &wgpu::Texture| texture.create_view(&whole);
        let drawn = wgpu::TextureUsages::RENDER_ATTACHMENT;
        let read = drawn | wgpu::TextureUsages::TEXTURE_BINDING;
        let metered = read | wgpu::TextureUsages::COPY_SRC;
        let depth = if linear { read } else { drawn };
        let scene_format = if linear { LINEAR_FORMAT } else { content.format() };
        Ok(Self {
            size,
            samples,
            display: OutputTexture::new(gpu, size, content),
            linear: linear.then(|| view(&make("target/linear", LINEAR_FORMAT, 1, metered))),
            multisampled: (samples > 1)
                .then(|| view(&make("target/multisampled", scene_format, samples, drawn))),
            depth: view(&make("target/depth", DEPTH_FORMAT, samples, depth)),
            focus: None,
            occlusion: OcclusionMemory::default(),
        })
    }

    /// Width and height in pixels.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Samples per pixel.
    pub fn samples(&self) -> u32 {
        self.samples
    }

    /// Returns whether it holds light before tone mapping, as a scene that blends needs.
    pub fn is_linear(&self) -> bool {
        self.linear.is_some()
    }

    /// Gives the finished picture away, as the one that a display shows, while the next one is
    /// drawn. `spare` is drawn over from now on, where it has the target's size.
    #[must_use = "the target has no picture any more"]
    pub fn latch_image(&mut self, gpu: &Gpu, spare: Option<OutputTexture>) -> OutputTexture {
        let next = self.display.next(gpu, spare);
        std::mem::replace(&mut self.display, next)
    }

    /// Makes a picture of the target's size its finished one, once the GPU is at it.
    pub fn copy_from(&self, gpu: &Gpu, picture: &OutputTexture) {
        let [width, height] = self.size;
        let descriptor = wgpu::CommandEncoderDescriptor { label: Some("target/copy") };
        let mut encoder = gpu.device.create_command_encoder(&descriptor);
        encoder.copy_texture_to_texture(
            picture.texture().as_image_copy(),
            self.display.texture().as_image_copy(),
            wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        );
        gpu.queue.submit([encoder.finish()]);
    }

    /// Returns the encoding of its finished picture.
    pub fn content(&self) -> ImageEncoding {
        self.display.content()
    }

    /// The finished picture: RGBA8 as sRGB, unless its content is another.
    pub fn picture(&self) -> &OutputTexture {
        &self.display
    }

    /// The finished picture's texture.
    pub fn display(&self) -> &wgpu::Texture {
        self.display.texture()
    }

    /// A view of [`Self::display`].
    pub fn display_view(&self) -> &wgpu::TextureView {
        self.display.view()
    }

    pub(crate) fn linear(&self) -> Option<&wgpu::TextureView> {
        self.linear.as_ref()
    }

    /// The light that is shown: with depth of field, if the frame has any.
    pub(crate) fn light(&self) -> Option<&wgpu::TextureView> {
        self.focus.as_ref().or(self.linear.as_ref())
    }

    /// Begins depth of field: from now on the light that is shown is the last of these. Returns the
    /// light and the depth of the scene, and where the light with depth of field comes.
    pub(crate) fn begin_focus(&mut self, gpu: &Gpu) -> Option<[&wgpu::TextureView; 3]> {
        let linear = self.linear.as_ref()?;
        let focus = self.focus.get_or_insert_with(|| {
            let texture = picture_texture(gpu, "target/focus", LINEAR_FORMAT, (self.size, 1));
            texture.create_view(&wgpu::TextureViewDescriptor::default())
        });
        Some([linear, &self.depth, focus])
    }

    /// Ends depth of field: the light that is shown is that of the scene again.
    pub(crate) fn end_focus(&mut self) {
        self.focus = None;
    }

    pub(crate) fn depth(&self) -> &wgpu::TextureView {
        &self.depth
    }

    /// Returns the texture that the scene is drawn into, and the one that it is resolved to, if
    /// any.
    pub(crate) fn scene(&self) -> (&wgpu::TextureView, Option<&wgpu::TextureView>) {
        let single = self.linear.as_ref().unwrap_or(self.display.view());
        match &self.multisampled {
            Some(many) => (many, Some(single)),
            None => (single, None),
        }
    }
}
