//! The surroundings behind everything, where a scene has an environment or lies in fog.
//!
//! A triangle over each view at an infinite depth, between the opaque surfaces and the blended
//! ones. The direction of a pixel is found in f64 for the canvas, so tiles of one screen agree to
//! the bit, and so do the planes of a warped channel and both eyes: what is infinitely far has no
//! parallax.

use std::collections::BTreeMap;

use bytemuck::{Pod, Zeroable};
use glam::{DMat3, DVec3};

use crate::bindings::{self, FrameExtras, uniform_stride};
use crate::frame::DrawContext;
use crate::gpu::Gpu;
use crate::output_texture::ImageEncoding;
use crate::pipeline::PipelineVariant;
use crate::shader;
use crate::target::{DEPTH_FORMAT, DISPLAY_FORMAT, LINEAR_FORMAT, Target};
use crate::view::ViewDesc;

/// The fragment stage.
pub(crate) const SOURCE: &str = include_str!("background.wgsl");

/// Twin of `Background` in `background.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct BackgroundUniform {
    pub first: [f32; 4],
    pub right: [f32; 4],
    pub down: [f32; 4],
    pub corner: [f32; 4],
}

impl BackgroundUniform {
    pub fn new(view: &ViewDesc) -> Self {
        let [x, y, width, height] = view.viewport;
        let [first, right, down] = directions(view, width, height);
        let four = |v: DVec3| v.as_vec3().extend(0.0).to_array();
        let corner = [x as f32, y as f32, 0.0, 0.0];
        Self { first: four(first), right: four(right), down: four(down), corner }
    }
}

/// The direction of the canvas' corner, and by how much that of a pixel right and down differs.
fn directions(view: &ViewDesc, width: f64, height: f64) -> [DVec3; 3] {
    let clip_from_eye = view.clip_from_eye();
    let row = |index: usize| clip_from_eye.row(index).truncate();
    let rows = DMat3::from_cols(row(0), row(1), row(3));
    if view.is_parallel() || rows.determinant() == 0.0 {
        return [view.forward(), DVec3::ZERO, DVec3::ZERO];
    }
    let eye_from_clip = rows.transpose().inverse();
    let (across, up) = (eye_from_clip.x_axis, eye_from_clip.y_axis);
    [eye_from_clip.z_axis - across + up, across * (2.0 / width), up * (-2.0 / height)]
}

/// The properties that a pipeline depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct PipelineOf {
    is_linear: bool,
    is_float: bool,
    samples: u32,
    extras: FrameExtras,
    has_fog: bool,
}

/// The pass; its pipelines are made on demand.
#[derive(Debug)]
pub(crate) struct BackgroundPass {
    group_layout: wgpu::BindGroupLayout,
    ready: BTreeMap<PipelineOf, wgpu::RenderPipeline>,
}

/// The pass for the views of a frame.
#[derive(Debug)]
pub(crate) struct BackgroundDraw {
    pipeline: wgpu::RenderPipeline,
    group: wgpu::BindGroup,
    stride: u32,
}

impl BackgroundPass {
    pub fn new(gpu: &Gpu) -> Self {
        Self { group_layout: bindings::view_layout(&gpu.device), ready: BTreeMap::new() }
    }

    /// Writes what a frame with an environment or fog needs.
    pub fn prepare(
        &mut self,
        gpu: &Gpu,
        target: &Target,
        variant: PipelineVariant,
        views: &[&ViewDesc],
    ) -> BackgroundDraw {
        let stride = uniform_stride(gpu, size_of::<BackgroundUniform>());
        let mut bytes = vec![0; stride * views.len().max(1)];
        for (index, view) in views.iter().enumerate() {
            let uniform = BackgroundUniform::new(view);
            let uniform = bytemuck::bytes_of(&uniform);
            bytes[index * stride..][..uniform.len()].copy_from_slice(uniform);
        }
        let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("background/uniforms"),
            size: bytes.len() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        gpu.queue.write_buffer(&buffer, 0, &bytes);
        let size = wgpu::BufferSize::new(size_of::<BackgroundUniform>() as u64);
        let binding = wgpu::BufferBinding { buffer: &buffer, offset: 0, size };
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("background/group"),
            layout: &self.group_layout,
            entries: &[wgpu::BindGroupEntry {
                binding: 0,
                resource: wgpu::BindingResource::Buffer(binding),
            }],
        });
        let is_linear = target.is_linear();
        let is_float = is_linear || target.content() == ImageEncoding::Light;
        let key = PipelineOf {
            is_linear,
            is_float,
            samples: target.samples(),
            extras: variant.frame_extras(),
            has_fog: variant.fog,
        };
        let pipeline =
            self.ready.entry(key).or_insert_with(|| pipeline(gpu, &self.group_layout, key));
        BackgroundDraw { pipeline: pipeline.clone(), group, stride: stride as u32 }
    }
}

impl BackgroundDraw {
    /// Draws the surroundings in all views.
    pub fn encode(&self, pass: &mut wgpu::RenderPass<'_>, context: &DrawContext<'_>) {
        pass.set_pipeline(&self.pipeline);
        for view in 0..context.lists.len() {
            context.enter(pass, view);
            pass.set_bind_group(1, &self.group, &[view as u32 * self.stride]);
            pass.draw(0..3, 0..1);
        }
    }
}

fn pipeline(
    gpu: &Gpu,
    group_layout: &wgpu::BindGroupLayout,
    key: PipelineOf,
) -> wgpu::RenderPipeline {
    let PipelineOf { is_linear, is_float, samples, extras, has_fog } = key;
    let source = shader::surroundings(SOURCE, extras.environment, has_fog);
    let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("background/shader"),
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    let frame = bindings::frame_layout(&gpu.device, extras);
    let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("background/pipeline_layout"),
        bind_group_layouts: &[Some(&frame), Some(group_layout)],
        immediate_size: 0,
    });
    let constants = [("TONE_MAPPED", f64::from(u8::from(!is_linear)))];
    let format = if is_float { LINEAR_FORMAT } else { DISPLAY_FORMAT };
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("background/pipeline"),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("screen"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH_FORMAT,
            depth_write_enabled: Some(false),
            // Depth is reversed: only what was never drawn is as far as this.
            depth_compare: Some(wgpu::CompareFunction::GreaterEqual),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState { count: samples, ..Default::default() },
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some("surroundings"),
            compilation_options: wgpu::PipelineCompilationOptions {
                constants: &constants,
                ..Default::default()
            },
            targets: &[Some(format.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}
