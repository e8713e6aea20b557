//! Depth of occluders, drawn before the scene: what lies behind them need not be drawn.
//!
//! Occluders are opaque triangles that the scene's pass draws too, by the same numbers: their depth
//! is the same there, to the bit. What lies behind them at a sample cannot win there, so that it
//! changes no pixel if its fragments are not shaded, or if it is not drawn at all.

use std::collections::BTreeMap;

use polyptych_scene::{Topology, VertexLayout};

use crate::bindings::{self, FrameExtras};
use crate::frame::{DrawContext, ListPart};
use crate::gpu::Gpu;
use crate::occlusion::CellDepths;
use crate::pipeline::{
    Alpha, Cull, InstanceRecord, PipelineKey, instance_attributes, primitive_state,
    vertex_attributes,
};
use crate::readback::{ReadError, TextureCopy};
use crate::shader::{self, Interface};
use crate::target::DEPTH_FORMAT;

/// The fragment stages.
pub(crate) const SOURCE: &str = include_str!("occluder.wgsl");

/// Pixels along each side of a cell of [`CellDepths`]; twin of the constant in `occluder.wgsl`.
pub(crate) const CELL_SIDE: u32 = 8;

const CELL_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R32Float;

/// Everything that the depth of an occluder depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct DepthKey {
    layout: VertexLayout,
    cull: Cull,
    mirrored: bool,
}

impl DepthKey {
    /// The key of what hides all that is behind it, wherever it is drawn: its fragments are not
    /// blended, discarded or passed by light, and its triangles have an inside.
    fn new(key: &PipelineKey) -> Option<Self> {
        let is_solid = key.material.alpha == Alpha::Opaque
            && key.topology == Topology::Triangles
            && !key.transmits();
        let PipelineKey { layout, cull, mirrored, .. } = *key;
        is_solid.then_some(Self { layout, cull, mirrored })
    }
}

/// Returns whether what is drawn so can be an occluder.
pub(crate) fn may_occlude(key: &PipelineKey) -> bool {
    DepthKey::new(key).is_some()
}

/// The textures of one target: of its size and samples.
#[derive(Debug)]
pub(crate) struct OccluderTarget {
    depth: wgpu::TextureView,
    group: wgpu::BindGroup,
    farthest: wgpu::Texture,
}

/// The pass.
#[derive(Clone, Debug)]
pub(crate) struct OccluderPass {
    samples: u32,
    module: wgpu::ShaderModule,
    layout: wgpu::PipelineLayout,
    depth: BTreeMap<DepthKey, wgpu::RenderPipeline>,
    behind: wgpu::RenderPipeline,
    farthest: wgpu::RenderPipeline,
    group_layout: wgpu::BindGroupLayout,
    texels: wgpu::Sampler,
}

impl OccluderPass {
    /// The pass for so many samples per pixel; `None` where the driver cannot read the depth of
    /// each sample, or has a depth from −1 to 1, which loses what tells surfaces apart.
    pub fn new(gpu: &Gpu, samples: u32) -> Option<Self> {
        let flags = gpu.adapter.get_downlevel_capabilities().flags;
        let reads_samples =
            samples == 1 || flags.contains(wgpu::DownlevelFlags::MULTISAMPLED_SHADING);
        if gpu.is_gl() || !reads_samples {
            return None;
        }
        let device = &gpu.device;
        let shader = |label, text: String| {
            let source = wgpu::ShaderSource::Wgsl(text.into());
            device.create_shader_module(wgpu::ShaderModuleDescriptor { label: Some(label), source })
        };
        let frame = bindings::frame_layout(device, FrameExtras::default());
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("occluder/pipeline_layout"),
            bind_group_layouts: &[Some(&frame)],
            immediate_size: 0,
        });
        let group_layout = bindings::depth_layout(device, samples > 1);
        let made = shader("occluder/shader", shader::depth(SOURCE, samples > 1));
        let onto = |name| screen_pipeline(gpu, &made, &group_layout, (name, samples));
        Some(Self {
            samples,
            module: shader("occluder/vertices", shader::surface(Interface::default(), "")),
            layout,
            depth: BTreeMap::new(),
            behind: onto("behind"),
            farthest: onto("farthest"),
            group_layout,
            texels: device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("occluder/texels"),
                ..Default::default()
            }),
        })
    }

    /// Makes what is missing for a scene.
    pub fn prepare(&mut self, gpu: &Gpu, keys: &[PipelineKey]) {
        for key in keys.iter().filter_map(DepthKey::new) {
            if !self.depth.contains_key(&key) {
                let pipeline = self.build(gpu, key);
                self.depth.insert(key, pipeline);
            }
        }
    }

    /// Returns whether nothing is missing for a scene.
    pub fn has(&self, keys: &[PipelineKey]) -> bool {
        keys.iter().filter_map(DepthKey::new).all(|key| self.depth.contains_key(&key))
    }

    /// Takes what another one of the same samples has made.
    pub fn add(&mut self, other: Self) {
        self.depth.extend(other.depth);
    }

    fn build(&self, gpu: &Gpu, key: DepthKey) -> wgpu::RenderPipeline {
        let vertex_attributes = vertex_attributes(key.layout, Interface::default());
        let instance_attributes = instance_attributes(Interface::default());
        let buffers = [
            Some(wgpu::VertexBufferLayout {
                array_stride: u64::from(key.layout.stride()),
                step_mode: wgpu::VertexStepMode::Vertex,
                attributes: &vertex_attributes,
            }),
            Some(wgpu::VertexBufferLayout {
                array_stride: size_of::<InstanceRecord>() as u64,
                step_mode: wgpu::VertexStepMode::Instance,
                attributes: &instance_attributes,
            }),
        ];
        gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("occluder/pipeline"),
            layout: Some(&self.layout),
            vertex: wgpu::VertexState {
                module: &self.module,
                entry_point: Some("vertex"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &buffers,
            },
            primitive: primitive_state(Topology::Triangles, key.cull, key.mirrored),
            depth_stencil: Some(depth_state(wgpu::CompareFunction::Greater)),
            multisample: wgpu::MultisampleState { count: self.samples, ..Default::default() },
            fragment: None,
            multiview_mask: None,
            cache: None,
        })
    }

    /// The pipelines of a scene, in the order of its keys; `None` for what is no occluder or was
    /// not prepared.
    pub fn pipelines(&self, keys: &[PipelineKey]) -> Vec<Option<&wgpu::RenderPipeline>> {
        let of = |key| DepthKey::new(key).and_then(|key| self.depth.get(&key));
        keys.iter().map(of).collect()
    }

    /// Textures for a target of a size in pixels.
    pub fn target(&self, gpu: &Gpu, [width, height]: [u32; 2]) -> OccluderTarget {
        let texture = |label, [width, height]: [u32; 2], sample_count, format, usage| {
            gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: usage | wgpu::TextureUsages::RENDER_ATTACHMENT,
                view_formats: &[],
            })
        };
        let read = wgpu::TextureUsages::TEXTURE_BINDING;
        let depth = texture("occluder/depth", [width, height], self.samples, DEPTH_FORMAT, read);
        let depth = depth.create_view(&wgpu::TextureViewDescriptor::default());
        let cells = [width, height].map(|side| side.div_ceil(CELL_SIDE));
        let copied = wgpu::TextureUsages::COPY_SRC;
        let entry = |binding, resource| wgpu::BindGroupEntry { binding, resource };
        let entries = [
            entry(0, wgpu::BindingResource::TextureView(&depth)),
            entry(1, wgpu::BindingResource::Sampler(&self.texels)),
        ];
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("occluder/group"),
            layout: &self.group_layout,
            entries: if self.samples > 1 { &entries[..1] } else { &entries },
        });
        let farthest = texture("occluder/farthest", cells, 1, CELL_FORMAT, copied);
        OccluderTarget { depth, group, farthest }
    }

    /// Encodes the farthest depth of each cell within pixels x, y, width, height; of others 0.
    pub fn encode_farthest(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        of: &OccluderTarget,
        [x, y, width, height]: [u32; 4],
    ) {
        let view = of.farthest.create_view(&wgpu::TextureViewDescriptor::default());
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("occluder/farthest"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                    store: wgpu::StoreOp::Store,
                },
            })],
            ..Default::default()
        });
        pass.set_pipeline(&self.farthest);
        pass.set_bind_group(1, &of.group, &[]);
        let [left, top] = [x, y].map(|at| at / CELL_SIDE);
        let [right, bottom] = [x + width, y + height].map(|end| end.div_ceil(CELL_SIDE));
        pass.set_scissor_rect(left, top, right - left, bottom - top);
        pass.draw(0..3, 0..1);
    }

    /// Encodes the depth that the scene's pass begins with, within pixels x, y, width, height; of
    /// others none.
    pub fn encode_behind(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        of: &OccluderTarget,
        depth: &wgpu::TextureView,
        [x, y, width, height]: [u32; 4],
    ) {
        let mut pass = begin(encoder, "occluder/behind", depth);
        pass.set_pipeline(&self.behind);
        pass.set_bind_group(1, &of.group, &[]);
        pass.set_scissor_rect(x, y, width, height);
        pass.draw(0..3, 0..1);
    }
}

impl OccluderTarget {
    /// Encodes the depth of the draws of all views, of a context with [`OccluderPass::pipelines`].
    pub fn encode_depth(&self, encoder: &mut wgpu::CommandEncoder, context: &DrawContext<'_>) {
        let mut pass = begin(encoder, "occluder/pass", &self.depth);
        for view in 0..context.lists.len() {
            context.draw(&mut pass, view, ListPart::Opaque);
        }
    }

    /// Encodes a copy of the farthest depths, for [`Self::read`].
    pub fn encode_read(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder) -> TextureCopy {
        TextureCopy::encode(gpu, encoder, &self.farthest)
    }

    /// Waits for the farthest depths of the cells, which were submitted so; not for what was
    /// submitted later.
    ///
    /// # Errors
    /// The GPU is lost or out of memory.
    pub fn read(
        &self,
        gpu: &Gpu,
        copy: &TextureCopy,
        submission: wgpu::SubmissionIndex,
    ) -> Result<CellDepths, ReadError> {
        let bytes = copy.read(gpu, Some(submission))?;
        let depths = bytes.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes));
        let size = [self.farthest.width(), self.farthest.height()];
        Ok(CellDepths::new(size.map(|side| side as usize), depths.collect()))
    }
}

fn depth_state(compare: wgpu::CompareFunction) -> wgpu::DepthStencilState {
    wgpu::DepthStencilState {
        format: DEPTH_FORMAT,
        depth_write_enabled: Some(true),
        depth_compare: Some(compare),
        stencil: wgpu::StencilState::default(),
        bias: wgpu::DepthBiasState::default(),
    }
}

fn begin<'encoder>(
    encoder: &'encoder mut wgpu::CommandEncoder,
    label: &str,
    view: &wgpu::TextureView,
) -> wgpu::RenderPass<'encoder> {
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some(label),
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view,
            depth_ops: Some(wgpu::Operations {
                load: wgpu::LoadOp::Clear(0.0),
                store: wgpu::StoreOp::Store,
            }),
            stencil_ops: None,
        }),
        ..Default::default()
    })
}

/// The pipeline of a triangle over all pixels: `behind` writes depth, of each sample, and
/// `farthest` a colour.
fn screen_pipeline(
    gpu: &Gpu,
    module: &wgpu::ShaderModule,
    group_layout: &wgpu::BindGroupLayout,
    (name, samples): (&str, u32),
) -> wgpu::RenderPipeline {
    let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("occluder/screen_layout"),
        bind_group_layouts: &[None, Some(group_layout)],
        immediate_size: 0,
    });
    let is_depth = name == "behind";
    let color = [Some(CELL_FORMAT.into())];
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(&format!("occluder/{name}")),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some("screen"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: is_depth.then(|| depth_state(wgpu::CompareFunction::Always)),
        multisample: wgpu::MultisampleState {
            count: if is_depth { samples } else { 1 },
            ..Default::default()
        },
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some(name),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: if is_depth { &[] } else { &color },
        }),
        multiview_mask: None,
        cache: None,
    })
}
