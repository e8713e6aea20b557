//! Depth of field from a picture and its depths: what is in front of the distance that is sharp is
//! told from all else, both are gathered, and laid over the pixels of a frame.

use bytemuck::{Pod, Zeroable};
use glam::{DMat4, DVec4};
use wgpu::TextureFormat::{Rg16Float, Rgba16Float};

use super::tonemap::{clear, screen_pipeline, screen_pipeline_onto};
use crate::gpu::Gpu;
use crate::guarded_region::{DISC_REACH, GuardedRegion, LEVELS};
use crate::picture_target::{PictureTarget, picture_texture};
use crate::target::LINEAR_FORMAT;
use crate::view::ViewDesc;
use crate::{bindings, shader};

/// The fragment stages.
pub(crate) const SOURCE: &str = include_str!("depth_of_field.wgsl");

/// The greatest radius of a disc, in radians: 2°. More would need a wider guard band.
const RADIUS_MAX_RAD: f64 = 2.0 * std::f64::consts::PI / 180.0;

/// Sides of textures are multiples of so many texels, so that they are not made anew in each frame
/// of a camera that moves.
const SIDE_STEP: u32 = 256;

/// Formats of the layers that are split and halved: see `Layers` in `depth_of_field.wgsl`.
const LAYER_FORMATS: [wgpu::TextureFormat; 4] = [Rgba16Float, Rg16Float, Rgba16Float, Rgba16Float];

/// Formats of the maps that are gathered: see `Gathered` there.
const MAP_FORMATS: [wgpu::TextureFormat; 3] = [Rgba16Float, Rgba16Float, Rg16Float];

/// Twin of `Lens` in `depth_of_field.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(crate) struct LensUniform {
    pub eye_from_texel: [[f32; 4]; 4],
    pub eye_from_pixel: [[f32; 4]; 4],
    pub texel_from_eye: [[f32; 4]; 4],
    pub part: [i32; 4],
    pub to_picture: [i32; 2],
    pub offset: [f32; 2],
    pub texels_per_pixel: f32,
    pub focus_inverse: f32,
    pub aperture_half: f32,
    pub texels_per_radian: f32,
    pub radius_max: f32,
    pub texels_max: f32,
    pub pad: [f32; 2],
}

impl LensUniform {
    /// The uniforms of a view, whose map and picture are in these places; without blur if it has
    /// no depth of field.
    pub fn new(view: &ViewDesc, [own, picture]: [&GuardedRegion; 2]) -> Self {
        let Some(lens) = view.depth_of_field else { return Self::default() };
        let clip_from_eye = view.scaled_clip_from_eye();
        let pixel_from_eye = pixel_from_clip(view) * clip_from_eye;
        let drawn = picture.view(view);
        let texel_from_eye = pixel_from_clip(&drawn) * drawn.scaled_clip_from_eye();
        let of = |matrix: DMat4| matrix.as_mat4().to_cols_array_2d();
        let texel = |at: usize| (own.corner[at] - picture.corner[at]) >> own.scale;
        let to_picture = [0, 1]
            .map(|at| (texel(at) + i64::from(picture.place[at]) - i64::from(own.place[at])) as i32);
        let texels_per_pixel = 1.0 / f64::from(1u32 << own.scale);
        let offset = [0, 1]
            .map(|at| (f64::from(own.place[at]) - own.corner[at] as f64 * texels_per_pixel) as f32);
        let [first, size] = [picture.place, picture.size].map(|of| of.map(|side| side as i32));
        Self {
            eye_from_texel: of(texel_from_eye.inverse()),
            eye_from_pixel: of(pixel_from_eye.inverse()),
            texel_from_eye: of(texel_from_eye),
            part: [first[0], first[1], first[0] + size[0] - 1, first[1] + size[1] - 1],
            to_picture,
            offset,
            texels_per_pixel: texels_per_pixel as f32,
            focus_inverse: lens.focus.recip(),
            aperture_half: 0.5 * lens.aperture,
            texels_per_radian: picture.texel_rad(view).recip() as f32,
            radius_max: RADIUS_MAX_RAD as f32,
            texels_max: DISC_REACH as f32,
            pad: [0.0; 2],
        }
    }
}

/// From clip space to pixels of a view's target, y down.
fn pixel_from_clip(view: &ViewDesc) -> DMat4 {
    let [x, y, width, height] = view.viewport;
    DMat4::from_cols(
        DVec4::X * (0.5 * width),
        DVec4::Y * (-0.5 * height),
        DVec4::Z,
        DVec4::new(x + 0.5 * width, y + 0.5 * height, 0.0, 1.0),
    )
}

/// The textures of a group of views.
#[derive(Debug)]
pub(crate) struct DiscLayers {
    pub target: PictureTarget,
    /// All levels of each.
    all: [wgpu::TextureView; 4],
    /// By level, then by layer.
    levels: Vec<[wgpu::TextureView; 4]>,
    widest: wgpu::TextureView,
}

impl DiscLayers {
    /// Textures that hold pictures of these sides: the ones that are held, if they do.
    pub fn new(gpu: &Gpu, held: Option<Self>, sides: [u32; 2], samples: u32) -> Self {
        let mut size = grown(gpu, sides);
        if let Some(held) = held.filter(|held| held.target.samples() == samples) {
            let has = held.target.size();
            if has.iter().zip(size).all(|(has, wanted)| *has >= wanted) {
                return held;
            }
            size = [size[0].max(has[0]), size[1].max(has[1])];
        }
        let whole = wgpu::TextureViewDescriptor::default();
        let color = picture_texture(gpu, "depth_of_field/picture", LINEAR_FORMAT, (size, 1));
        let layers = LAYER_FORMATS
            .map(|format| picture_texture(gpu, "depth_of_field/layer", format, (size, LEVELS + 1)));
        let level = |base_mip_level, layer: usize| {
            layers[layer].create_view(&wgpu::TextureViewDescriptor {
                base_mip_level,
                mip_level_count: Some(1),
                ..Default::default()
            })
        };
        let cells = size.map(|side| side >> LEVELS);
        let widest = picture_texture(gpu, "depth_of_field/widest", Rg16Float, (cells, 1));
        Self {
            target: PictureTarget::new(gpu, color.create_view(&whole), samples, true),
            all: [0, 1, 2, 3].map(|at: usize| layers[at].create_view(&whole)),
            levels: (0..=LEVELS).map(|of| [0, 1, 2, 3].map(|layer| level(of, layer))).collect(),
            widest: widest.create_view(&whole),
        }
    }
}

/// The maps that are gathered for all views of a frame.
#[derive(Debug)]
pub(crate) struct DiscMaps {
    views: [wgpu::TextureView; 3],
}

impl DiscMaps {
    /// Textures of these sides: the ones that are held, if they are as large.
    pub fn new(gpu: &Gpu, held: Option<Self>, sides: [u32; 2]) -> Self {
        let mut size = grown(gpu, sides);
        if let Some(held) = held {
            let has = held.views[0].texture().size();
            if has.width >= size[0] && has.height >= size[1] {
                return held;
            }
            size = [size[0].max(has.width), size[1].max(has.height)];
        }
        let view = |format| {
            let texture = picture_texture(gpu, "depth_of_field/map", format, (size, 1));
            texture.create_view(&wgpu::TextureViewDescriptor::default())
        };
        Self { views: MAP_FORMATS.map(view) }
    }
}

fn grown(gpu: &Gpu, sides: [u32; 2]) -> [u32; 2] {
    let side_max = gpu.device.limits().max_texture_dimension_2d;
    sides.map(|side| side.next_multiple_of(SIDE_STEP).min(side_max))
}

/// Rectangles, each with the offset of its view's uniforms.
type Parts<'a> = &'a [([u32; 4], u32)];

/// The textures that a stage reads, in the order of their bindings: a picture and its depth,
/// what is behind and in front, and the largest radii.
struct Read<'a> {
    picture: &'a wgpu::TextureView,
    depth: &'a wgpu::TextureView,
    layers: [&'a wgpu::TextureView; 4],
    widest: &'a wgpu::TextureView,
}

/// The pass.
#[derive(Debug)]
pub(crate) struct DepthOfFieldPass {
    samples: u32,
    split: wgpu::RenderPipeline,
    halve: wgpu::RenderPipeline,
    widen: wgpu::RenderPipeline,
    gather: wgpu::RenderPipeline,
    compose: wgpu::RenderPipeline,
    group_layout: wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
}

impl DepthOfFieldPass {
    pub fn new(gpu: &Gpu, samples: u32) -> Self {
        let text = shader::depth(SOURCE, samples > 1);
        let group_layout = bindings::lens_layout(&gpu.device, samples > 1);
        let onto = |fragment, formats: &[wgpu::TextureFormat]| {
            let targets: Vec<_> = formats.iter().map(|format| Some((*format).into())).collect();
            let names = ["depth_of_field", fragment];
            screen_pipeline_onto(gpu, names, &text, &group_layout, &targets, &[])
        };
        let one = |fragment, format: wgpu::TextureFormat| {
            let names = ["depth_of_field", fragment];
            screen_pipeline(gpu, names, &text, &group_layout, format, &[])
        };
        Self {
            samples,
            split: onto("split", &LAYER_FORMATS),
            halve: onto("halve", &LAYER_FORMATS),
            widen: one("widen", Rg16Float),
            gather: onto("gather", &MAP_FORMATS),
            compose: one("compose", LINEAR_FORMAT),
            group_layout,
            sampler: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("depth_of_field/sampler"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                mipmap_filter: wgpu::MipmapFilterMode::Linear,
                ..Default::default()
            }),
        }
    }

    /// Samples per pixel of what it reads.
    pub fn samples(&self) -> u32 {
        self.samples
    }

    /// Gathers what was drawn: the pictures lie in some rectangles, the maps in others.
    pub fn encode_maps(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        (layers, maps, uniforms): (&DiscLayers, &DiscMaps, &wgpu::Buffer),
        [pictures, gathered]: [Parts<'_>; 2],
        is_first: bool,
    ) {
        let [map, map_front, map_light] = [0, 1, 2].map(|at: usize| &maps.views[at]);
        let read = Read {
            picture: layers.target.color(),
            depth: layers.target.depth(),
            layers: [map, map_light, map_front, map_front],
            widest: map,
        };
        let group = |read: &Read<'_>| self.group(gpu, read, uniforms);
        let onto: Vec<_> = layers.levels[0].iter().collect();
        encode(encoder, ("split", &self.split), (&onto, true), &group(&read), pictures);
        for level in 1..=LEVELS {
            let [finer, own] = [level - 1, level].map(|of| &layers.levels[of as usize]);
            let read = Read { layers: [0, 1, 2, 3].map(|at: usize| &finer[at]), ..read };
            let onto: Vec<_> = own.iter().collect();
            let parts = at_level(pictures, level);
            encode(encoder, ("halve", &self.halve), (&onto, true), &group(&read), &parts);
        }
        let coarsest = &layers.levels[LEVELS as usize];
        let read = Read { layers: [map, map_light, map_front, &coarsest[3]], ..read };
        let cells = at_level(pictures, LEVELS);
        let onto = [&layers.widest];
        encode(encoder, ("widen", &self.widen), (&onto, true), &group(&read), &cells);
        let all = [0, 1, 2, 3].map(|at: usize| &layers.all[at]);
        let read = Read { layers: all, widest: &layers.widest, ..read };
        let onto: Vec<_> = maps.views.iter().collect();
        let group = group(&read);
        encode(encoder, ("gather", &self.gather), (&onto, is_first), &group, gathered);
    }

    /// Lays what was gathered over the pixels of a frame, each view's in its rectangle; the rest
    /// of `onto` gets the sky.
    pub fn encode_onto(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        (maps, uniforms): (&DiscMaps, &wgpu::Buffer),
        ([light, depth], onto, sky): ([&wgpu::TextureView; 2], &wgpu::TextureView, wgpu::Color),
        views: Parts<'_>,
    ) {
        let [map, front, front_light] = [0, 1, 2].map(|at: usize| &maps.views[at]);
        let layers = [map, front_light, front, front_light];
        let read = Read { picture: light, depth, layers, widest: map };
        let group = self.group(gpu, &read, uniforms);
        let pass = clear(encoder, "depth_of_field/compose", onto, sky);
        draw(pass, &self.compose, &group, views);
    }

    fn group(&self, gpu: &Gpu, read: &Read<'_>, uniforms: &wgpu::Buffer) -> wgpu::BindGroup {
        let size = wgpu::BufferSize::new(size_of::<LensUniform>() as u64);
        let uniform = wgpu::BufferBinding { buffer: uniforms, offset: 0, size };
        let entry = |binding, resource| wgpu::BindGroupEntry { binding, resource };
        let view = wgpu::BindingResource::TextureView;
        let [behind, behind_more, front, front_more] = read.layers;
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("depth_of_field/group"),
            layout: &self.group_layout,
            entries: &[
                entry(0, wgpu::BindingResource::Buffer(uniform)),
                entry(1, wgpu::BindingResource::Sampler(&self.sampler)),
                entry(2, view(read.picture)),
                entry(3, view(read.depth)),
                entry(4, view(behind)),
                entry(5, view(behind_more)),
                entry(6, view(front)),
                entry(7, view(front_more)),
                entry(8, view(read.widest)),
            ],
        })
    }
}

/// Encodes a stage onto several textures, which are cleared if it is the first one that draws
/// to them.
fn encode(
    encoder: &mut wgpu::CommandEncoder,
    (name, pipeline): (&str, &wgpu::RenderPipeline),
    (onto, is_first): (&[&wgpu::TextureView], bool),
    group: &wgpu::BindGroup,
    parts: Parts<'_>,
) {
    let none = wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT);
    let load = if is_first { none } else { wgpu::LoadOp::Load };
    let attachment = |view| {
        let ops = wgpu::Operations { load, store: wgpu::StoreOp::Store };
        let resolve_target = None;
        Some(wgpu::RenderPassColorAttachment { view, depth_slice: None, resolve_target, ops })
    };
    let attachments: Vec<_> = onto.iter().copied().map(attachment).collect();
    let pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some(&format!("depth_of_field/{name}")),
        color_attachments: &attachments,
        ..Default::default()
    });
    draw(pass, pipeline, group, parts);
}

fn draw(
    mut pass: wgpu::RenderPass<'_>,
    pipeline: &wgpu::RenderPipeline,
    group: &wgpu::BindGroup,
    parts: Parts<'_>,
) {
    pass.set_pipeline(pipeline);
    for &([x, y, width, height], offset) in parts {
        pass.set_bind_group(1, group, &[offset]);
        pass.set_scissor_rect(x, y, width, height);
        pass.draw(0..3, 0..1);
    }
}

/// These rectangles in a coarser level; their sides are multiples of the coarsest texel.
fn at_level(parts: Parts<'_>, level: u32) -> Vec<([u32; 4], u32)> {
    parts.iter().map(|(of, offset)| (of.map(|side| side >> level), *offset)).collect()
}
