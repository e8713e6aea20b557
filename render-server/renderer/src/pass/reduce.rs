//! From a picture to one of fewer pixels, for who watches from afar: each pixel has the mean light
//! of a square of pixels.

use std::collections::HashMap;
use std::num::NonZeroU32;

use crate::gpu::Gpu;
use crate::output_texture::OutputTexture;
use crate::pass::enlarge::picture_pipeline;
use crate::pass::tonemap::clear;
use crate::{bindings, shader};

const SOURCE: &str = include_str!("reduce.wgsl");

/// The pass.
#[derive(Debug)]
pub(crate) struct ReducePass {
    group_layout: wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
    /// By the format of a picture.
    pipelines: HashMap<wgpu::TextureFormat, wgpu::RenderPipeline>,
}

impl ReducePass {
    pub fn new(gpu: &Gpu) -> Self {
        let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor::default());
        let group_layout = bindings::picture_layout(&gpu.device);
        Self { group_layout, sampler, pipelines: HashMap::new() }
    }

    /// Submits the reduction of a picture. Squares have `side` pixels along each side, or less at
    /// the right and lower edge.
    pub fn submit(
        &mut self,
        gpu: &Gpu,
        picture: &OutputTexture,
        side: NonZeroU32,
    ) -> OutputTexture {
        // Of larger squares the picture has one, too.
        let [width, height] = picture.size();
        let side = side.get().min(width.max(height));
        let size = [width, height].map(|pixels| pixels.div_ceil(side));
        let reduced = OutputTexture::new(gpu, size, picture.content());
        let layout = &self.group_layout;
        let pipeline = self.pipelines.entry(picture.content().format()).or_insert_with(|| {
            let fragment = ("reduce", &shader::screen(SOURCE)[..], &[][..]);
            picture_pipeline(gpu, layout, picture.content(), fragment)
        });
        let entry = |binding, resource| wgpu::BindGroupEntry { binding, resource };
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("reduce/group"),
            layout,
            entries: &[
                entry(0, wgpu::BindingResource::TextureView(picture.view())),
                entry(1, wgpu::BindingResource::Sampler(&self.sampler)),
            ],
        });
        let descriptor = wgpu::CommandEncoderDescriptor { label: Some("reduce") };
        let mut encoder = gpu.device.create_command_encoder(&descriptor);
        {
            let black = wgpu::Color::BLACK;
            let mut pass = clear(&mut encoder, "reduce/pass", reduced.view(), black);
            pass.set_pipeline(pipeline);
            pass.set_bind_group(1, &group, &[]);
            pass.draw(0..3, side..side + 1);
        }
        gpu.queue.submit([encoder.finish()]);
        reduced
    }
}
