//! Ambient occlusion from depths: searched at each texel, then smoothed over the texels around it.

use bytemuck::{Pod, Zeroable};
use glam::{DMat4, DVec4};

use super::tonemap::{clear, resume, screen_pipeline};
use crate::gpu::Gpu;
use crate::guarded_region::{DEPTHS_REACH, GuardedRegion};
use crate::target::DEPTH_FORMAT;
use crate::view::ViewDesc;
use crate::{bindings, shader};

/// The fragment stages.
pub(crate) const SOURCE: &str = include_str!("ambient_occlusion.wgsl");

/// The visible part, and the depth that it is of.
const MAP_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rg32Float;

/// All of the light, where there is no depth.
const ALL: wgpu::Color = wgpu::Color { r: 1.0, g: 0.0, b: 0.0, a: 0.0 };

/// The greatest radius as a share of the distance from the eye: 7°. More would need a wider guard
/// band, and is what light maps are for.
const SHARE_MAX: f32 = 0.125;

/// Texels by which depths of one surface may differ: the error of coarser levels is up to half a
/// texel, and more along a view that grazes it.
const TOLERANCE_TEXELS: f64 = 2.0;

/// Sides of textures are multiples of so many texels, so that they are not made anew in each frame
/// of a camera that moves.
const SIDE_STEP: u32 = 256;

/// Twin of `Occlusion` in `ambient_occlusion.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(crate) struct OcclusionUniform {
    pub eye_from_texel: [[f32; 4]; 4],
    pub eye: [f32; 4],
    pub depths: [i32; 4],
    pub to_depth: [i32; 2],
    pub radius: f32,
    pub share: f32,
    pub texels: f32,
    pub relative: f32,
    pub absolute: f32,
    pub pad: f32,
}

/// Twin of `OcclusionPlace` in `include/frame.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct OcclusionPlace {
    pub offset: [f32; 2],
    pub texels_per_pixel: f32,
    pub relative: f32,
    pub absolute: f32,
    pub pad: [f32; 3],
}

impl OcclusionUniform {
    /// The uniforms of a view, whose ambient occlusion and depths are in these places.
    pub fn new(view: &ViewDesc, [own, depths]: [&GuardedRegion; 2]) -> Self {
        let texel = |at: usize| (own.corner[at] - depths.corner[at]) >> own.scale;
        let to_depth = [0, 1]
            .map(|at| (texel(at) + i64::from(depths.place[at]) - i64::from(own.place[at])) as i32);
        let drawn = depths.view(view);
        let [x, y, width, height] = drawn.viewport;
        let [across, down] = to_depth.map(f64::from);
        let clip_from_texel = DMat4::from_cols(
            DVec4::X * (2.0 / width),
            DVec4::Y * (-2.0 / height),
            DVec4::Z,
            DVec4::new(2.0 * (across - x) / width - 1.0, 1.0 - 2.0 * (down - y) / height, 0.0, 1.0),
        );
        let eye_from_texel = drawn.scaled_clip_from_eye().inverse() * clip_from_texel;
        let [first, size] = [depths.place, depths.size].map(|of| of.map(|side| side as i32));
        let [relative, absolute] = tolerance(view, own);
        Self {
            eye_from_texel: eye_from_texel.as_mat4().to_cols_array_2d(),
            eye: view.homogeneous_eye().to_array(),
            depths: [first[0], first[1], first[0] + size[0] - 1, first[1] + size[1] - 1],
            to_depth,
            radius: view.ambient_occlusion.map_or(0.0, |of| of.radius),
            share: SHARE_MAX,
            texels: DEPTHS_REACH as f32,
            relative,
            absolute,
            pad: 0.0,
        }
    }
}

impl OcclusionPlace {
    /// The place of a view's ambient occlusion, for a picture of it, or else for the target.
    pub fn new(view: &ViewDesc, own: &GuardedRegion, picture: Option<&GuardedRegion>) -> Self {
        let (corner, place, scale) =
            picture.map_or_else(Default::default, |of| (of.corner, of.place, of.scale));
        let texels_per_pixel = 1.0 / f64::from(1u32 << own.scale);
        let offset = [0, 1].map(|at| {
            let pixels = corner[at] - (i64::from(place[at]) << scale) - own.corner[at];
            (f64::from(own.place[at]) + pixels as f64 * texels_per_pixel) as f32
        });
        let texels_per_pixel = texels_per_pixel * f64::from(1u32 << scale);
        let [relative, absolute] = tolerance(view, own);
        let texels_per_pixel = texels_per_pixel as f32;
        Self { offset, texels_per_pixel, relative, absolute, pad: [0.0; 3] }
    }
}

/// The difference of depth from which on surfaces are two: as a share of the depth, and where rays
/// are parallel. Both are the lengths of some texels, along the middle ray.
fn tolerance(view: &ViewDesc, own: &GuardedRegion) -> [f32; 2] {
    if !view.is_parallel() {
        return [(TOLERANCE_TEXELS * own.texel_rad(view)) as f32, 0.0];
    }
    let texel = f64::from(1u32 << own.scale) * 2.0
        / (view.clip_from_view.y_axis.y.abs() * view.viewport[3]);
    [0.0, (TOLERANCE_TEXELS * texel * view.clip_from_view.z_axis.z.abs()) as f32]
}

/// The textures of a frame.
#[derive(Debug)]
pub(crate) struct OcclusionTextures {
    /// Sides of the depths, and of the others.
    sizes: [[u32; 2]; 2],
    depths: wgpu::TextureView,
    found: wgpu::TextureView,
    pub map: wgpu::TextureView,
}

/// The pass.
#[derive(Debug)]
pub(crate) struct AmbientOcclusionPass {
    search: wgpu::RenderPipeline,
    smoothed: wgpu::RenderPipeline,
}

impl AmbientOcclusionPass {
    pub fn new(gpu: &Gpu) -> Self {
        let text = shader::screen(SOURCE);
        let layout = bindings::occlusion_layout(&gpu.device);
        let pipeline = |fragment| {
            screen_pipeline(gpu, ["ambient_occlusion", fragment], &text, &layout, MAP_FORMAT, &[])
        };
        Self { search: pipeline("search"), smoothed: pipeline("smoothed") }
    }

    /// Searches in the depths of views: each has a rectangle of the map, and the offset of its
    /// uniforms. The first search of a frame clears all of it.
    pub fn encode_search(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        (textures, uniforms): (&OcclusionTextures, &wgpu::Buffer),
        (views, is_first): (&[([u32; 4], u32)], bool),
    ) {
        let group = group(gpu, &textures.depths, uniforms);
        let (name, onto) = ("ambient_occlusion/search", &textures.found);
        let pass =
            if is_first { clear(encoder, name, onto, ALL) } else { resume(encoder, name, onto) };
        encode(pass, (&self.search, &group), views);
    }

    /// Smooths what was found in these rectangles.
    pub fn encode_smoothed(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        (textures, uniforms): (&OcclusionTextures, &wgpu::Buffer),
        views: &[([u32; 4], u32)],
    ) {
        let group = group(gpu, &textures.found, uniforms);
        let pass = clear(encoder, "ambient_occlusion/smoothed", &textures.map, ALL);
        encode(pass, (&self.smoothed, &group), views);
    }
}

fn group(gpu: &Gpu, picture: &wgpu::TextureView, uniforms: &wgpu::Buffer) -> wgpu::BindGroup {
    let size = wgpu::BufferSize::new(size_of::<OcclusionUniform>() as u64);
    let uniform = wgpu::BufferBinding { buffer: uniforms, offset: 0, size };
    let entry = |binding, resource| wgpu::BindGroupEntry { binding, resource };
    let picture = wgpu::BindingResource::TextureView(picture);
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("ambient_occlusion/group"),
        layout: &bindings::occlusion_layout(&gpu.device),
        entries: &[entry(0, picture), entry(1, wgpu::BindingResource::Buffer(uniform))],
    })
}

fn encode(
    mut pass: wgpu::RenderPass<'_>,
    (pipeline, group): (&wgpu::RenderPipeline, &wgpu::BindGroup),
    views: &[([u32; 4], u32)],
) {
    pass.set_pipeline(pipeline);
    for &([x, y, width, height], offset) in views {
        pass.set_bind_group(1, group, &[offset]);
        pass.set_scissor_rect(x, y, width, height);
        pass.draw(0..3, 0..1);
    }
}

/// Sides of a texture that holds either of two, if it is at most twice as large as the larger one:
/// channels that stand and channels that lie have room in the same. Else the first one's.
fn joint(wanted: [u32; 2], has: [u32; 2]) -> [u32; 2] {
    let area = |[width, height]: [u32; 2]| u64::from(width) * u64::from(height);
    let both = [wanted[0].max(has[0]), wanted[1].max(has[1])];
    if area(both) <= 2 * area(wanted).max(area(has)) { both } else { wanted }
}

impl OcclusionTextures {
    /// Textures that hold depths and maps of these sides: the ones that are held, if they do.
    pub fn new(gpu: &Gpu, held: Option<Self>, wanted: [[u32; 2]; 2]) -> Self {
        let side_max = gpu.device.limits().max_texture_dimension_2d;
        let grown = |side: u32| side.next_multiple_of(SIDE_STEP).min(side_max);
        let mut sizes = wanted.map(|sides| sides.map(grown));
        if let Some(held) = held {
            let (has, wanted) = (held.sizes.as_flattened(), wanted.as_flattened());
            if has.iter().zip(wanted).all(|(has, wanted)| has >= wanted) {
                return held;
            }
            for (wanted, has) in sizes.iter_mut().zip(held.sizes) {
                *wanted = joint(*wanted, has);
            }
        }
        let make = |label, format, [width, height]: [u32; 2]| {
            let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT
                    | wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            });
            texture.create_view(&wgpu::TextureViewDescriptor::default())
        };
        Self {
            sizes,
            depths: make("ambient_occlusion/depths", DEPTH_FORMAT, sizes[0]),
            found: make("ambient_occlusion/found", MAP_FORMAT, sizes[1]),
            map: make("ambient_occlusion/map", MAP_FORMAT, sizes[1]),
        }
    }

    /// Begins the pass that draws depths.
    pub fn begin_depths<'a>(&self, encoder: &'a mut wgpu::CommandEncoder) -> wgpu::RenderPass<'a> {
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("ambient_occlusion/depths"),
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &self.depths,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(0.0),
                    store: wgpu::StoreOp::Store,
                }),
                stencil_ops: None,
            }),
            ..Default::default()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_that_stand_and_lie_share_textures_unless_these_are_far_larger() {
        assert_eq!(joint([1024, 2048], [2048, 1024]), [2048, 2048]);
        assert_eq!(joint([1024, 1024], [2048, 512]), [2048, 1024]);
        assert_eq!(joint([256, 8192], [8192, 256]), [256, 8192]);
    }
}
