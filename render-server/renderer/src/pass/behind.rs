//! The texture of what is behind surfaces that transmit light, and the halving of its levels.

use crate::gpu::Gpu;
use crate::guarded_region::LEVELS;
use crate::pass::tonemap::{resume, screen_pipeline};
use crate::picture_target::{PictureTarget, picture_texture};
use crate::target::LINEAR_FORMAT;
use crate::{bindings, shader};

/// The fragment stage.
pub(crate) const SOURCE: &str = include_str!("behind.wgsl");

/// Sides of the texture are multiples of so many texels, so that it is not made anew in each frame
/// of a camera that moves.
const SIDE_STEP: u32 = 256;

/// The texture of all pictures of a frame.
#[derive(Debug)]
pub(crate) struct BehindTexture {
    /// The finest level is drawn onto.
    pub target: PictureTarget,
    levels: Vec<wgpu::TextureView>,
    pub all: wgpu::TextureView,
    groups: Vec<wgpu::BindGroup>,
}

/// The pass that halves.
#[derive(Debug)]
pub(crate) struct BehindPass {
    pipeline: wgpu::RenderPipeline,
    group_layout: wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
}

impl BehindPass {
    pub fn new(gpu: &Gpu) -> Self {
        let group_layout = bindings::picture_layout(&gpu.device);
        let text = shader::screen(SOURCE);
        let names = ["behind", "halve"];
        let pipeline = screen_pipeline(gpu, names, &text, &group_layout, LINEAR_FORMAT, &[]);
        let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("behind/sampler"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        Self { pipeline, group_layout, sampler }
    }

    /// Returns a texture that holds these sides, the one that is there if it does.
    pub fn texture(
        &self,
        gpu: &Gpu,
        held: Option<BehindTexture>,
        (sides, samples): ([u32; 2], u32),
    ) -> BehindTexture {
        let side_max = gpu.device.limits().max_texture_dimension_2d;
        let mut size = sides.map(|side| side.next_multiple_of(SIDE_STEP).min(side_max));
        if let Some(held) = held.filter(|held| held.target.samples() == samples) {
            let sides = held.size();
            if sides.iter().zip(size).all(|(held, side)| *held >= side) {
                return held;
            }
            size = [size[0].max(sides[0]), size[1].max(sides[1])];
        }
        self.made(gpu, size, samples)
    }

    fn made(&self, gpu: &Gpu, size: [u32; 2], samples: u32) -> BehindTexture {
        let color = picture_texture(gpu, "behind/color", LINEAR_FORMAT, (size, LEVELS + 1));
        let level = |base_mip_level| {
            color.create_view(&wgpu::TextureViewDescriptor {
                base_mip_level,
                mip_level_count: Some(1),
                ..Default::default()
            })
        };
        let levels: Vec<_> = (0..=LEVELS).map(level).collect();
        let group = |view| {
            let entry = |binding, resource| wgpu::BindGroupEntry { binding, resource };
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("behind/group"),
                layout: &self.group_layout,
                entries: &[
                    entry(0, wgpu::BindingResource::TextureView(view)),
                    entry(1, wgpu::BindingResource::Sampler(&self.sampler)),
                ],
            })
        };
        BehindTexture {
            target: PictureTarget::new(gpu, levels[0].clone(), samples, false),
            groups: levels.iter().map(group).collect(),
            levels,
            all: color.create_view(&wgpu::TextureViewDescriptor::default()),
        }
    }

    /// Halves the used part of the finest level again and again.
    pub fn encode_levels(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        texture: &BehindTexture,
        used: [u32; 2],
    ) {
        for level in 1..=LEVELS {
            let view = &texture.levels[level as usize];
            let mut pass = resume(encoder, "behind/halve", view);
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(1, &texture.groups[level as usize - 1], &[]);
            pass.set_scissor_rect(0, 0, used[0] >> level, used[1] >> level);
            pass.draw(0..3, 0..1);
        }
    }
}

impl BehindTexture {
    /// Width and height of the finest level, in texels.
    pub fn size(&self) -> [u32; 2] {
        self.target.size()
    }

    /// One level, to be drawn to.
    pub fn level(&self, level: u32) -> &wgpu::TextureView {
        &self.levels[level as usize]
    }

    /// The bindings of one level, which is read.
    pub fn group(&self, level: u32) -> &wgpu::BindGroup {
        &self.groups[level as usize]
    }
}
