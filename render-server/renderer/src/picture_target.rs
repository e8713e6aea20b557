//! The target of pictures that a frame is computed from: colour, samples, and depth.

use crate::gpu::Gpu;
use crate::target::{DEPTH_FORMAT, LINEAR_FORMAT};

/// The target of a picture.
#[derive(Debug)]
pub(crate) struct PictureTarget {
    samples: u32,
    color: wgpu::TextureView,
    /// Only with several samples per texel.
    multisampled: Option<wgpu::TextureView>,
    /// The depth of each sample.
    depth: wgpu::TextureView,
    /// The depth is read later.
    keeps_depth: bool,
}

impl PictureTarget {
    /// A target whose colour is one level of a texture.
    pub fn new(gpu: &Gpu, color: wgpu::TextureView, samples: u32, keeps_depth: bool) -> Self {
        let wgpu::Extent3d { width, height, .. } = color.texture().size();
        let make = |label, format, usage| {
            let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: samples,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: usage | wgpu::TextureUsages::RENDER_ATTACHMENT,
                view_formats: &[],
            });
            texture.create_view(&wgpu::TextureViewDescriptor::default())
        };
        let none = wgpu::TextureUsages::empty();
        let read = if keeps_depth { wgpu::TextureUsages::TEXTURE_BINDING } else { none };
        Self {
            samples,
            color,
            multisampled: (samples > 1).then(|| make("picture/multisampled", LINEAR_FORMAT, none)),
            depth: make("picture/depth", DEPTH_FORMAT, read),
            keeps_depth,
        }
    }

    /// Width and height in texels.
    pub fn size(&self) -> [u32; 2] {
        let size = self.color.texture().size();
        [size.width, size.height]
    }

    /// Samples per texel.
    pub fn samples(&self) -> u32 {
        self.samples
    }

    /// The resolved colour.
    pub fn color(&self) -> &wgpu::TextureView {
        &self.color
    }

    /// The depth of each sample, if it is kept.
    pub fn depth(&self) -> &wgpu::TextureView {
        &self.depth
    }

    /// Begins the pass that draws it.
    pub fn begin<'a>(
        &self,
        encoder: &'a mut wgpu::CommandEncoder,
        sky: wgpu::Color,
    ) -> wgpu::RenderPass<'a> {
        let (view, resolve_target, store) = match &self.multisampled {
            Some(many) => (many, Some(&self.color), wgpu::StoreOp::Discard),
            None => (&self.color, None, wgpu::StoreOp::Store),
        };
        let kept = if self.keeps_depth { wgpu::StoreOp::Store } else { wgpu::StoreOp::Discard };
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("picture/pass"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view,
                depth_slice: None,
                resolve_target,
                ops: wgpu::Operations { load: wgpu::LoadOp::Clear(sky), store },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &self.depth,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: kept }),
                stencil_ops: None,
            }),
            ..Default::default()
        })
    }
}

/// A texture of so many levels that is drawn onto and read.
pub(crate) fn picture_texture(
    gpu: &Gpu,
    label: &str,
    format: wgpu::TextureFormat,
    ([width, height], levels): ([u32; 2], u32),
) -> wgpu::Texture {
    gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: levels,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
        view_formats: &[],
    })
}
