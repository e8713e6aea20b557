//! From the display target to a window's surface.

use super::tonemap::{clear, screen_pipeline};
use crate::renderer::bindings;
use crate::renderer::gpu::Gpu;
use crate::renderer::shader;
use crate::renderer::target::Target;

const SOURCE: &str = include_str!("output.wgsl");

/// Copies pictures to surfaces of one format.
#[derive(Debug)]
pub struct Output {
    format: wgpu::TextureFormat,
    group_layout: wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
    pipeline: Option<(Sizes, wgpu::RenderPipeline)>,
}

/// What the pipeline is specialised for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Sizes {
    picture: [u32; 2],
    surface: [u32; 2],
}

impl Output {
    /// For surfaces of this format: `Bgra8Unorm`, `Rgba8Unorm`, or either with `Srgb`.
    pub fn new(gpu: &Gpu, format: wgpu::TextureFormat) -> Self {
        let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("output/sampler"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        let group_layout = bindings::picture_layout(&gpu.device);
        Self { format, group_layout, sampler, pipeline: None }
    }

    /// Encodes and submits: the target's picture fills a view of this size in pixels. Equal sizes
    /// are copied pixel by pixel, others filtered.
    pub fn draw(
        &mut self,
        gpu: &Gpu,
        target: &Target,
        surface: &wgpu::TextureView,
        surface_size: [u32; 2],
    ) {
        let sizes = Sizes { picture: target.size(), surface: surface_size };
        if self.pipeline.as_ref().is_none_or(|(known, _)| *known != sizes) {
            self.pipeline = Some((sizes, self.build(gpu, sizes)));
        }
        let Some((_, pipeline)) = &self.pipeline else { return };
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("output/group"),
            layout: &self.group_layout,
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: wgpu::BindingResource::TextureView(target.display_view()),
                },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: wgpu::BindingResource::Sampler(&self.sampler),
                },
            ],
        });
        let mut encoder = gpu
            .device
            .create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("output") });
        {
            let mut pass = clear(&mut encoder, "output/pass", surface, wgpu::Color::BLACK);
            pass.set_pipeline(pipeline);
            pass.set_bind_group(1, &group, &[]);
            pass.draw(0..3, 0..1);
        }
        gpu.queue.submit([encoder.finish()]);
    }

    fn build(&self, gpu: &Gpu, sizes: Sizes) -> wgpu::RenderPipeline {
        let flag = |on: bool| f64::from(u8::from(on));
        let constants = [
            ("EXACT", flag(sizes.picture == sizes.surface)),
            ("ENCODED", flag(!self.format.is_srgb())),
            ("WIDTH", f64::from(sizes.surface[0])),
            ("HEIGHT", f64::from(sizes.surface[1])),
        ];
        let text = shader::screen(SOURCE);
        screen_pipeline(gpu, "output", &text, &self.group_layout, self.format, &constants)
    }
}
