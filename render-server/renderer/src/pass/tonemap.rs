//! From the float target to the display target, where anything was drawn; the rest is sky.

use std::collections::BTreeMap;

use glam::Vec3;
use polyptych_scene::ToneMapper;

use crate::gpu::Gpu;
use crate::output_texture::ImageEncoding;
use crate::readback::{ReadError, read_pixels};
use crate::target::{Target, TargetError};
use crate::tone::{f16_from_bits, linear_from_srgb};
use crate::{bindings, shader};

const SOURCE: &str = include_str!("tonemap.wgsl");

/// The pass, and what it makes of the last sky.
#[derive(Debug)]
pub(crate) struct Tonemap {
    /// By whether the target is of light, and by tone mapper; made when they are first used.
    onto: BTreeMap<(bool, ToneMapper), wgpu::RenderPipeline>,
    group_layout: wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
    sky: Option<((Vec3, ToneMapper), ImageEncoding, wgpu::Color)>,
}

/// Why the sky's colour could not be found.
#[derive(Debug, thiserror::Error)]
pub enum SkyError {
    /// No room for one pixel.
    #[error(transparent)]
    Target(#[from] TargetError),
    /// The pixel did not come back.
    #[error(transparent)]
    Read(#[from] ReadError),
}

impl Tonemap {
    pub fn new(gpu: &Gpu) -> Self {
        let group_layout = bindings::picture_layout(&gpu.device);
        Self {
            onto: BTreeMap::new(),
            group_layout,
            sampler: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("tonemap/sampler"),
                ..Default::default()
            }),
            sky: None,
        }
    }

    /// The clear colour of the display target that equals the tone-mapped sky to the bit: the
    /// driver's own rounding is asked, once per colour, with a target of one pixel.
    pub fn sky_color(
        &mut self,
        gpu: &Gpu,
        (light, tone): (Vec3, ToneMapper),
        content: ImageEncoding,
    ) -> Result<wgpu::Color, SkyError> {
        if light == Vec3::ZERO {
            return Ok(wgpu::Color::BLACK);
        }
        if let Some((sky, onto, color)) = self.sky
            && (sky, onto) == ((light, tone), content)
        {
            return Ok(color);
        }
        let target = Target::with_encoding(gpu, [1, 1], 1, true, content)?;
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor {
            label: Some("tonemap/probe"),
        });
        clear(&mut encoder, "tonemap/probe", target.scene().0, light_color(light));
        let black = (wgpu::Color::BLACK, tone);
        self.encode(gpu, &mut encoder, &target, black, Some([0, 0, 1, 1]));
        gpu.queue.submit([encoder.finish()]);
        let pixel = read_pixels(gpu, &target)?;
        let byte = |i: usize| pixel.get(i).copied().unwrap_or(0);
        let channel = |i: usize| match content {
            ImageEncoding::Srgb | ImageEncoding::Codes | ImageEncoding::FineCodes => {
                linear_from_srgb(byte(i))
            }
            ImageEncoding::Light => {
                f16_from_bits(u16::from_le_bytes([byte(2 * i), byte(2 * i + 1)]))
            }
        };
        let color = wgpu::Color { r: channel(0), g: channel(1), b: channel(2), a: 1.0 };
        self.sky = Some(((light, tone), content, color));
        Ok(color)
    }

    /// Fills the display target with the sky and maps the rectangle x, y, width, height.
    pub fn encode(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        target: &Target,
        (sky, tone): (wgpu::Color, ToneMapper),
        rectangle: Option<[u32; 4]>,
    ) {
        let Some(linear) = target.light() else { return };
        let mut pass = clear(encoder, "tonemap/pass", target.display_view(), sky);
        let Some([x, y, width, height]) = rectangle else { return };
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("tonemap/group"),
            layout: &self.group_layout,
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: wgpu::BindingResource::TextureView(linear),
                },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: wgpu::BindingResource::Sampler(&self.sampler),
                },
            ],
        });
        let is_light = target.content() == ImageEncoding::Light;
        let pipeline = self.onto.entry((is_light, tone)).or_insert_with(|| {
            let content = if is_light { ImageEncoding::Light } else { ImageEncoding::Srgb };
            let (names, text) = (["tonemap", "tonemap"], shader::screen(SOURCE));
            let constants = [("TONE_MAPPER", tone.number())];
            screen_pipeline(gpu, names, &text, &self.group_layout, content.format(), &constants)
        });
        pass.set_pipeline(pipeline);
        pass.set_bind_group(1, &group, &[]);
        pass.set_scissor_rect(x, y, width, height);
        pass.draw(0..3, 0..1);
    }
}

/// Light as a clear colour of the float target.
pub(crate) fn light_color(light: Vec3) -> wgpu::Color {
    let [r, g, b] = light.to_array().map(f64::from);
    wgpu::Color { r, g, b, a: 1.0 }
}

/// Begins a pass that clears a colour target.
pub(crate) fn clear<'encoder>(
    encoder: &'encoder mut wgpu::CommandEncoder,
    label: &str,
    view: &wgpu::TextureView,
    color: wgpu::Color,
) -> wgpu::RenderPass<'encoder> {
    begin(encoder, label, view, wgpu::LoadOp::Clear(color))
}

/// Begins a pass over what a colour target holds.
pub(crate) fn resume<'encoder>(
    encoder: &'encoder mut wgpu::CommandEncoder,
    label: &str,
    view: &wgpu::TextureView,
) -> wgpu::RenderPass<'encoder> {
    begin(encoder, label, view, wgpu::LoadOp::Load)
}

fn begin<'encoder>(
    encoder: &'encoder mut wgpu::CommandEncoder,
    label: &str,
    view: &wgpu::TextureView,
    load: wgpu::LoadOp<wgpu::Color>,
) -> wgpu::RenderPass<'encoder> {
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some(label),
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations { load, store: wgpu::StoreOp::Store },
        })],
        ..Default::default()
    })
}

/// A pipeline of a triangle over the whole target, with a picture in group 1. The fragment stage
/// has the second name; the first one is for labels.
pub(crate) fn screen_pipeline(
    gpu: &Gpu,
    names: [&str; 2],
    text: &str,
    group_layout: &wgpu::BindGroupLayout,
    onto: impl Into<wgpu::ColorTargetState>,
    constants: &[(&str, f64)],
) -> wgpu::RenderPipeline {
    screen_pipeline_onto(gpu, names, text, group_layout, &[Some(onto.into())], constants)
}

/// A pipeline as [`screen_pipeline`] makes it, onto several targets.
pub(crate) fn screen_pipeline_onto(
    gpu: &Gpu,
    [name, fragment]: [&str; 2],
    text: &str,
    group_layout: &wgpu::BindGroupLayout,
    targets: &[Option<wgpu::ColorTargetState>],
    constants: &[(&str, f64)],
) -> wgpu::RenderPipeline {
    let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(&format!("{name}/shader")),
        source: wgpu::ShaderSource::Wgsl(text.into()),
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
            entry_point: Some("screen"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: None,
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some(fragment),
            compilation_options: wgpu::PipelineCompilationOptions {
                constants,
                ..Default::default()
            },
            targets,
        }),
        multiview_mask: None,
        cache: None,
    })
}
