//! Glow: how the levels of a picture are mixed, and how a float target gets to the display target
//! with it.

use std::collections::BTreeMap;

use bytemuck::{Pod, Zeroable};
use polyptych_scene::ToneMapper;

use super::behind::BehindTexture;
use super::tonemap::{clear, resume, screen_pipeline};
use crate::gpu::Gpu;
use crate::guarded_region::LEVELS;
use crate::output_texture::ImageEncoding;
use crate::target::{LINEAR_FORMAT, Target};
use crate::{bindings, shader};

/// The fragment stages.
pub(crate) const SOURCE: &str = include_str!("glow.wgsl");

/// Twin of `Glow` in `glow.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct GlowUniform {
    pub corner: [f32; 2],
    pub place: [f32; 2],
    pub size: [f32; 2],
    pub texels_per_pixel: f32,
    pub strength: f32,
}

/// A part of the picture that spreads: x, y, width, height in texels of its finest level, and by
/// level the share of it that stays where the next wider level is laid over it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SpreadPart {
    pub rectangle: [u32; 4],
    pub stays: [f64; LEVELS as usize + 1],
}

/// The pipelines, made when they are first used.
#[derive(Debug)]
pub(crate) struct GlowPass {
    keep_light: wgpu::RenderPipeline,
    spread: wgpu::RenderPipeline,
    /// By whether the target is of light, and by tone mapper.
    onto: BTreeMap<(bool, ToneMapper), wgpu::RenderPipeline>,
    group_layout: wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
}

impl GlowPass {
    pub fn new(gpu: &Gpu) -> Self {
        use wgpu::BlendFactor::{Constant, DstAlpha, One, OneMinusConstant, Zero};
        let picture_layout = bindings::picture_layout(&gpu.device);
        let text = shader::screen(SOURCE);
        let part = |src_factor, dst_factor| wgpu::BlendComponent {
            src_factor,
            dst_factor,
            operation: wgpu::BlendOperation::Add,
        };
        let pipeline = |fragment, color, alpha| {
            let target = wgpu::ColorTargetState {
                format: LINEAR_FORMAT,
                blend: Some(wgpu::BlendState { color, alpha }),
                write_mask: wgpu::ColorWrites::ALL,
            };
            screen_pipeline(gpu, ["glow", fragment], &text, &picture_layout, target, &[])
        };
        let mixed = part(OneMinusConstant, Constant);
        Self {
            keep_light: pipeline("keep_light", part(Zero, DstAlpha), part(Zero, One)),
            spread: pipeline("spread", mixed, mixed),
            onto: BTreeMap::new(),
            group_layout: bindings::glow_layout(&gpu.device, size_of::<GlowUniform>()),
            sampler: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("glow/sampler"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            }),
        }
    }

    /// Leaves only light in the finest level; halving is next.
    pub fn encode_light(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        texture: &BehindTexture,
        [width, height]: [u32; 2],
    ) {
        let mut pass = resume(encoder, "glow/keep_light", texture.level(0));
        pass.set_pipeline(&self.keep_light);
        pass.set_bind_group(1, texture.group(1), &[]);
        pass.set_scissor_rect(0, 0, width, height);
        pass.draw(0..3, 0..1);
    }

    /// Mixes the levels into the finest one.
    pub fn encode_spread(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        texture: &BehindTexture,
        parts: &[SpreadPart],
    ) {
        for level in (0..LEVELS).rev() {
            let mut pass = resume(encoder, "glow/spread", texture.level(level));
            pass.set_pipeline(&self.spread);
            pass.set_bind_group(1, texture.group(level + 1), &[]);
            for part in parts {
                let stays = part.stays[level as usize];
                let [x, y, width, height] = part.rectangle.map(|side| side >> level);
                pass.set_blend_constant(wgpu::Color { r: stays, g: stays, b: stays, a: stays });
                pass.set_scissor_rect(x, y, width, height);
                pass.draw(0..3, 0..1);
            }
        }
    }

    /// Maps the rectangles of views, each with the offset of its uniform, to the display target;
    /// where there is a sky, all of it is filled with that first.
    pub fn encode_onto(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        (target, sky, tone): (&Target, Option<wgpu::Color>, ToneMapper),
        (picture, uniforms): (&wgpu::TextureView, &wgpu::Buffer),
        views: &[([u32; 4], u32)],
    ) {
        let Some(linear) = target.light() else { return };
        let entry = |binding, resource| wgpu::BindGroupEntry { binding, resource };
        let size = wgpu::BufferSize::new(size_of::<GlowUniform>() as u64);
        let uniform = wgpu::BufferBinding { buffer: uniforms, offset: 0, size };
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("glow/group"),
            layout: &self.group_layout,
            entries: &[
                entry(0, wgpu::BindingResource::TextureView(linear)),
                entry(1, wgpu::BindingResource::Sampler(&self.sampler)),
                entry(2, wgpu::BindingResource::TextureView(picture)),
                entry(3, wgpu::BindingResource::Buffer(uniform)),
            ],
        });
        let is_light = target.content() == ImageEncoding::Light;
        let pipeline = self.onto.entry((is_light, tone)).or_insert_with(|| {
            let content = if is_light { ImageEncoding::Light } else { ImageEncoding::Srgb };
            let (names, text) = (["glow", "tonemap_glow"], shader::screen(SOURCE));
            let constants = [("TONE_MAPPER", tone.number())];
            screen_pipeline(gpu, names, &text, &self.group_layout, content.format(), &constants)
        });
        let (name, onto) = ("glow/pass", target.display_view());
        let mut pass = match sky {
            Some(sky) => clear(encoder, name, onto, sky),
            None => resume(encoder, name, onto),
        };
        pass.set_pipeline(pipeline);
        for &([x, y, width, height], offset) in views {
            pass.set_bind_group(1, &group, &[offset]);
            pass.set_scissor_rect(x, y, width, height);
            pass.draw(0..3, 0..1);
        }
    }
}
