//! Pipelines of corrections, shared by those that follow each other on one channel, so that a
//! change of its numbers compiles nothing.

use std::collections::BTreeMap;

use glam::DMat3;
use polyptych_wall::{StereoPacking, TransferFunction};

use super::TAPS_MAX;
use super::correction_mesh::WarpVertexRecord;
use crate::bindings;
use crate::correction::{CorrectionDesc, EyeAtlas};
use crate::gpu::Gpu;
use crate::output_texture::{CODES_FORMAT, FINE_FORMAT};
use crate::target::DISPLAY_FORMAT;

const SOURCE: &str = include_str!("../correct.wgsl");

/// Pipelines of one channel that are kept, at most: those of the last numbers of planes and taps,
/// of two eyes, with even weights and others, of the last kinds of curves. Beyond it all are made
/// anew.
const PIPELINES_MAX: usize = 128;

/// The part of a pipeline's key that may change from frame to frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Sampling {
    planes: u32,
    /// Planes with triangles of their own; 0 if they have none.
    cells: u32,
    taps: [u32; 2],
}

/// All that pipelines are specialised for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Key {
    sampling: Sampling,
    eye: usize,
    upright: [u32; 2],
    is_exact: bool,
    is_colored: bool,
    is_weighted: bool,
    /// All of its pixels have the same weights.
    is_even: bool,
    /// Red, green and blue have weights of their own.
    is_tinted: bool,
    is_fine: bool,
    is_anaglyph: bool,
    /// 0 sRGB, 1 a power, 2 measured.
    curve: u8,
    dither: Option<u32>,
}

/// The pipelines of a channel's corrections, with what is the same for all of them.
#[derive(Debug)]
pub(super) struct Pipelines {
    sampler: wgpu::Sampler,
    map_sampler: wgpu::Sampler,
    group_layout: wgpu::BindGroupLayout,
    layout: wgpu::PipelineLayout,
    module: wgpu::ShaderModule,
    made: BTreeMap<Key, wgpu::RenderPipeline>,
}

impl Sampling {
    /// Creates the key for these eyes' planes, with samples across and down for each pixel of the
    /// display.
    pub fn new(eyes: &[EyeAtlas], taps: [u32; 2]) -> Self {
        let planes = eyes.iter().map(|eye| eye.planes.len()).max().unwrap_or(0) as u32;
        let has_cells = eyes.iter().any(|eye| eye.triangles.is_some());
        let (planes, cells) = if has_cells { (1, planes) } else { (planes, 0) };
        Self { planes, cells, taps: taps.map(|count| count.clamp(1, TAPS_MAX)) }
    }
}

impl Key {
    fn new(desc: &CorrectionDesc, sampling: Sampling, (eye, is_even): (usize, bool)) -> Self {
        let pixels = desc.upright[0] as usize * desc.upright[1] as usize;
        Self {
            sampling,
            eye,
            upright: desc.upright,
            is_exact: desc.warp.is_none(),
            is_colored: desc.color != DMat3::IDENTITY,
            is_weighted: desc.light_map.is_some(),
            is_even,
            is_tinted: desc.light_map.as_ref().is_some_and(|map| map.texels.len() > pixels),
            is_fine: desc.is_fine,
            is_anaglyph: desc.packing == StereoPacking::Anaglyph,
            curve: match desc.curve {
                TransferFunction::Srgb => 0,
                TransferFunction::Gamma(_) => 1,
                TransferFunction::Measured(_) => 2,
            },
            dither: desc.dither,
        }
    }

    fn constants(&self, gpu: &Gpu) -> [(&'static str, f64); 17] {
        let flag = |on: bool| f64::from(u8::from(on));
        [
            ("EYE", self.eye as f64),
            ("WIDTH", f64::from(self.upright[0])),
            ("HEIGHT", f64::from(self.upright[1])),
            ("EXACT", flag(self.is_exact)),
            ("PLANES", f64::from(self.sampling.planes)),
            ("CELLS", f64::from(self.sampling.cells)),
            ("TAPS_ACROSS", f64::from(self.sampling.taps[0])),
            ("TAPS_DOWN", f64::from(self.sampling.taps[1])),
            ("COLORED", flag(self.is_colored)),
            ("WEIGHTED", flag(self.is_weighted)),
            ("EVEN", flag(self.is_even)),
            ("TINTED", flag(self.is_tinted)),
            ("CURVE", f64::from(self.curve)),
            ("DITHERED", flag(self.dither.is_some())),
            ("CHANNEL", f64::from(self.dither.map_or(0, |id| id.wrapping_add(1)))),
            ("CODES", if self.is_fine { 1023.0 } else { 255.0 }),
            ("ENCODES", flag(!self.is_fine && !gpu.views_other_formats())),
        ]
    }
}

impl Pipelines {
    /// None yet.
    pub fn new(gpu: &Gpu) -> Self {
        let group_layout = bindings::correction_layout(&gpu.device);
        Self {
            sampler: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("correct/sampler"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            }),
            map_sampler: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("correct/map_sampler"),
                ..Default::default()
            }),
            layout: gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some("correct/pipeline_layout"),
                bind_group_layouts: &[None, Some(&group_layout)],
                immediate_size: 0,
            }),
            group_layout,
            module: gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some("correct/shader"),
                source: wgpu::ShaderSource::Wgsl(SOURCE.into()),
            }),
            made: BTreeMap::new(),
        }
    }

    /// Returns whether the pipeline of an eye is there, for even weights or others.
    pub fn has(&self, desc: &CorrectionDesc, sampling: Sampling, part: (usize, bool)) -> bool {
        self.made.contains_key(&Key::new(desc, sampling, part))
    }

    /// The pipeline of an eye, for even weights or others; compiled where there is none like it.
    pub fn of(
        &mut self,
        gpu: &Gpu,
        desc: &CorrectionDesc,
        sampling: Sampling,
        part: (usize, bool),
    ) -> wgpu::RenderPipeline {
        let key = Key::new(desc, sampling, part);
        if let Some(made) = self.made.get(&key) {
            return made.clone();
        }
        if self.made.len() == PIPELINES_MAX {
            self.made.clear();
        }
        let pipeline = self.build(gpu, &key);
        self.made.insert(key, pipeline.clone());
        pipeline
    }

    /// Creates the bind group of a draw: source, uniforms, light map, codes and cells.
    pub fn group(&self, gpu: &Gpu, resources: [wgpu::BindingResource<'_>; 5]) -> wgpu::BindGroup {
        let [source, uniform, light_map, codes, cells] = resources;
        let sampler = wgpu::BindingResource::Sampler(&self.sampler);
        let map_sampler = wgpu::BindingResource::Sampler(&self.map_sampler);
        let all = [source, sampler, uniform, light_map, codes, map_sampler, cells];
        let entries: Vec<_> = (0..)
            .zip(all)
            .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource })
            .collect();
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("correct/group"),
            layout: &self.group_layout,
            entries: &entries,
        })
    }

    fn build(&self, gpu: &Gpu, key: &Key) -> wgpu::RenderPipeline {
        let constants = key.constants(gpu);
        let options =
            || wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() };
        let attributes = wgpu::vertex_attr_array![0 => Float32x2, 1 => Float32x3];
        let write_mask = match (key.is_anaglyph, key.eye) {
            (true, 0) => wgpu::ColorWrites::RED,
            (true, _) => wgpu::ColorWrites::GREEN | wgpu::ColorWrites::BLUE,
            _ => wgpu::ColorWrites::ALL,
        };
        let format = match (key.is_fine, gpu.views_other_formats()) {
            (true, _) => FINE_FORMAT,
            (false, true) => CODES_FORMAT,
            (false, false) => DISPLAY_FORMAT,
        };
        gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("correct/pipeline"),
            layout: Some(&self.layout),
            vertex: wgpu::VertexState {
                module: &self.module,
                entry_point: Some("corner"),
                compilation_options: options(),
                buffers: &[Some(wgpu::VertexBufferLayout {
                    array_stride: size_of::<WarpVertexRecord>() as u64,
                    step_mode: wgpu::VertexStepMode::Vertex,
                    attributes: &attributes,
                })],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: None,
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &self.module,
                entry_point: Some("correct"),
                compilation_options: options(),
                targets: &[Some(wgpu::ColorTargetState { format, blend: None, write_mask })],
            }),
            multiview_mask: None,
            cache: None,
        })
    }
}
