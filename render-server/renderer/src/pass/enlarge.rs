//! From a picture of lower resolution to one with all pixels, in linear light.
//!
//! The filter is bilinear: one read a pixel, a few percent of a frame of a software driver, where
//! this is needed most. A bicubic one reads 16 times, and would cost the resolution that it saves.

use std::collections::BTreeMap;

use crate::frame::Submission;
use crate::gpu::Gpu;
use crate::output_texture::{ImageEncoding, OutputTexture};
use crate::pass::tonemap::clear;
use crate::target::Target;
use crate::{bindings, shader};

const SOURCE: &str = include_str!("enlarge.wgsl");

/// The place of a picture of lower resolution in one with all pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Enlargement {
    /// Equal parts side by side, one for each eye; 1 or 2.
    pub parts: u32,
    /// The rectangle that a part of the source covers, from the upper left of the same part of the
    /// larger picture, in its pixels: x, y, width, height. It may reach beyond that part.
    pub covered: [f64; 4],
}

/// The pass.
#[derive(Debug)]
pub(crate) struct EnlargePass {
    group_layout: wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
    /// By parts, and whether the picture holds light.
    pipelines: BTreeMap<(u32, bool), wgpu::RenderPipeline>,
}

impl EnlargePass {
    pub fn new(gpu: &Gpu) -> Self {
        let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("enlarge/sampler"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        let group_layout = bindings::picture_layout(&gpu.device);
        Self { group_layout, sampler, pipelines: BTreeMap::new() }
    }

    /// Submits the enlargement of a target's picture onto another of the same content.
    pub fn submit(
        &mut self,
        gpu: &Gpu,
        source: &Target,
        Enlargement { parts, covered: [x, y, width, height] }: Enlargement,
        onto: &OutputTexture,
    ) -> Submission {
        let is_light = onto.content() == ImageEncoding::Light;
        let layout = &self.group_layout;
        let pipeline = self.pipelines.entry((parts, is_light)).or_insert_with(|| {
            let constants = [("PARTS", f64::from(parts))];
            let fragment = ("enlarge", &shader::screen(SOURCE)[..], &constants[..]);
            picture_pipeline(gpu, layout, onto.content(), fragment)
        });
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("enlarge/group"),
            layout,
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: wgpu::BindingResource::TextureView(source.display_view()),
                },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: wgpu::BindingResource::Sampler(&self.sampler),
                },
            ],
        });
        let descriptor = wgpu::CommandEncoderDescriptor { label: Some("enlarge") };
        let mut encoder = gpu.device.create_command_encoder(&descriptor);
        {
            let black = wgpu::Color::BLACK;
            let mut pass = clear(&mut encoder, "enlarge/pass", onto.view(), black);
            pass.set_pipeline(pipeline);
            pass.set_bind_group(1, &group, &[]);
            let [all, high] = onto.size();
            let wide = all / parts;
            for part in 0..parts {
                let left = f64::from(part * wide);
                let [x, y, width, height] = [x + left, y, width, height].map(|side| side as f32);
                pass.set_viewport(x, y, width, height, 0.0, 1.0);
                pass.set_scissor_rect(part * wide, 0, wide, high);
                pass.draw(0..3, part..part + 1);
            }
        }
        Submission::new(gpu, encoder)
    }
}

/// The pipeline from one picture to another: its fragment stage, which names it, its shader, and
/// the shader's constants.
pub(super) fn picture_pipeline(
    gpu: &Gpu,
    group_layout: &wgpu::BindGroupLayout,
    content: ImageEncoding,
    (name, source, constants): (&str, &str, &[(&str, f64)]),
) -> wgpu::RenderPipeline {
    let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(&format!("{name}/shader")),
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(&format!("{name}/pipeline_layout")),
        bind_group_layouts: &[None, Some(group_layout)],
        immediate_size: 0,
    });
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(&format!("{name}/pipeline")),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("corner"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: None,
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some(name),
            compilation_options: wgpu::PipelineCompilationOptions {
                constants,
                ..Default::default()
            },
            targets: &[Some(content.format().into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}
