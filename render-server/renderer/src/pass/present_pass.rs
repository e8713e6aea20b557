//! From a picture to a display's surface, and words over it.

use super::label::Label;
use super::tonemap::{clear, screen_pipeline};
use crate::gpu::Gpu;
use crate::output_texture::{FINE_FORMAT, ImageEncoding, OutputTexture};
use crate::{bindings, shader};

const SOURCE: &str = include_str!("output.wgsl");

/// Shows pictures on surfaces of one format.
#[derive(Debug)]
pub struct PresentPass {
    format: wgpu::TextureFormat,
    group_layout: wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
    pipeline: Option<(PresentKey, wgpu::RenderPipeline)>,
    /// Those that were asked for last; nothing exists for others.
    labels: Vec<LabelTexture>,
}

/// The values that a pipeline is specialised for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct PresentKey {
    /// The picture has as many pixels as it covers of the surface.
    exact: bool,
    /// x, y, width, height of the picture on the surface, in pixels.
    rectangle: [u32; 4],
    /// The texture view gives codes, not light.
    coded: bool,
}

/// A label on the GPU, for surfaces of one size.
#[derive(Debug)]
struct LabelTexture {
    label: Label,
    surface: [u32; 2],
    /// `None` where there is no room for it.
    drawn: Option<LabelDraw>,
}

#[derive(Debug)]
struct LabelDraw {
    /// x, y, width, height.
    rectangle: [u32; 4],
    group: wgpu::BindGroup,
    pipeline: wgpu::RenderPipeline,
}

impl PresentPass {
    /// For surfaces of this format: `Bgra8Unorm`, `Rgba8Unorm`, either with `Srgb`, or
    /// `Rgb10a2Unorm`.
    pub fn new(gpu: &Gpu, format: wgpu::TextureFormat) -> Self {
        let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("output/sampler"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        let group_layout = bindings::picture_layout(&gpu.device);
        Self { format, group_layout, sampler, pipeline: None, labels: Vec::new() }
    }

    /// Encodes and submits: the picture stands on a view of this size in pixels as [`letterbox`]
    /// says, with black around it or instead of it, and the labels stand over it. Pictures of the
    /// view's size are copied pixel by pixel, others filtered.
    pub fn draw(
        &mut self,
        gpu: &Gpu,
        picture: Option<&OutputTexture>,
        labels: &[Label],
        surface: &wgpu::TextureView,
        surface_size: [u32; 2],
    ) {
        if let Some(picture) = picture {
            let rectangle = letterbox(picture.size(), surface_size);
            let exact = picture.size() == surface_size;
            let coded = picture.content() == ImageEncoding::FineCodes;
            let layout = PresentKey { exact, rectangle, coded };
            if self.pipeline.as_ref().is_none_or(|(known, _)| *known != layout) {
                self.pipeline = Some((layout, self.build(gpu, "output", layout)));
            }
        }
        self.place(gpu, labels, surface_size);
        let mut encoder = gpu
            .device
            .create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("output") });
        {
            let mut pass = clear(&mut encoder, "output/pass", surface, wgpu::Color::BLACK);
            if let (Some(picture), Some((layout, pipeline))) = (picture, &self.pipeline) {
                let [x, y, width, height] = layout.rectangle;
                pass.set_pipeline(pipeline);
                pass.set_bind_group(1, &self.group(gpu, picture), &[]);
                pass.set_scissor_rect(x, y, width, height);
                pass.draw(0..3, 0..1);
            }
            for panel in self.labels.iter().filter_map(|panel| panel.drawn.as_ref()) {
                let [x, y, width, height] = panel.rectangle;
                pass.set_pipeline(&panel.pipeline);
                pass.set_bind_group(1, &panel.group, &[]);
                pass.set_scissor_rect(x, y, width, height);
                pass.draw(0..3, 0..1);
            }
        }
        gpu.queue.submit([encoder.finish()]);
    }

    /// Makes the panels of these labels, where they are not there yet, and lets go of all others.
    fn place(&mut self, gpu: &Gpu, labels: &[Label], surface: [u32; 2]) {
        let mut old = std::mem::take(&mut self.labels);
        for label in labels {
            let is_it = |panel: &LabelTexture| panel.label == *label && panel.surface == surface;
            let panel = match old.iter().position(is_it) {
                Some(at) => old.swap_remove(at),
                None => self.panel(gpu, label, surface),
            };
            self.labels.push(panel);
        }
    }

    fn panel(&self, gpu: &Gpu, label: &Label, surface: [u32; 2]) -> LabelTexture {
        let drawn = label.image(surface).map(|(image, [left, top])| {
            let picture = OutputTexture::of_pixels(gpu, [image.width(), image.height()], &image);
            let rectangle = [left, top, image.width(), image.height()];
            let layout = PresentKey { exact: true, rectangle, coded: false };
            LabelDraw {
                rectangle,
                group: self.group(gpu, &picture),
                pipeline: self.build(gpu, "label", layout),
            }
        });
        LabelTexture { label: label.clone(), surface, drawn }
    }

    fn group(&self, gpu: &Gpu, picture: &OutputTexture) -> wgpu::BindGroup {
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("output/group"),
            layout: &self.group_layout,
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: wgpu::BindingResource::TextureView(picture.view()),
                },
                wgpu::BindGroupEntry {
                    binding: 1,
                    resource: wgpu::BindingResource::Sampler(&self.sampler),
                },
            ],
        })
    }

    fn build(&self, gpu: &Gpu, name: &str, layout: PresentKey) -> wgpu::RenderPipeline {
        let flag = |on: bool| f64::from(u8::from(on));
        let [left, top, width, height] = layout.rectangle.map(f64::from);
        let constants = [
            ("LEFT", left),
            ("TOP", top),
            ("EXACT", flag(layout.exact)),
            ("ENCODED", flag(!self.format.is_srgb() && !layout.coded)),
            ("DECODED", flag(self.format.is_srgb() && layout.coded)),
            ("KEPT", flag(self.format == FINE_FORMAT && layout.coded)),
            ("WIDTH", width),
            ("HEIGHT", height),
        ];
        let text = shader::screen(SOURCE);
        let names = [name, "output"];
        screen_pipeline(gpu, names, &text, &self.group_layout, self.format, &constants)
    }
}

/// Returns x, y, width and height of a picture on a surface, all in pixels: centred, as large as
/// it fits with its aspect ratio kept. A surface that rounding has made up to a pixel too wide or
/// too high is filled: bars of a pixel would only look like gaps.
pub fn letterbox(picture: [u32; 2], surface: [u32; 2]) -> [u32; 4] {
    let [picture_width, picture_height] = picture.map(|side| u64::from(side.max(1)));
    let [width, height] = surface.map(|side| u64::from(side.max(1)));
    let scaled = |side: u64, by: u64, of: u64| ((side * by + of / 2) / of).max(1);
    // What a pixel of one side comes to on the other.
    let slack = |side: u64, of: u64| side.div_ceil(of);
    let [mut fitted_width, mut fitted_height] = [width, height];
    if picture_width * height > picture_height * width {
        let fitted = scaled(picture_height, width, picture_width);
        if height - fitted.min(height) > slack(picture_height, picture_width) {
            fitted_height = fitted;
        }
    } else {
        let fitted = scaled(picture_width, height, picture_height);
        if width - fitted.min(width) > slack(picture_width, picture_height) {
            fitted_width = fitted;
        }
    }
    let [x, y] = [(width - fitted_width) / 2, (height - fitted_height) / 2];
    // No larger than the surface.
    [x, y, fitted_width, fitted_height].map(|pixels| pixels as u32)
}
