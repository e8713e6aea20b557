//! The depth of all that casts shadows: as a light sees it, or as a viewer does for ambient
//! occlusion.

use std::collections::BTreeMap;

use polyptych_scene::{Topology, VertexLayout};

use crate::bindings::{self, FrameExtras};
use crate::gpu::Gpu;
use crate::pipeline::{
    Alpha, Cull, InstanceRecord, MaterialFeatures, PipelineKey, TextureSlot, instance_attributes,
    primitive_state, vertex_attributes,
};
use crate::shader::{self, Interface};
use crate::target::DEPTH_FORMAT;

/// The fragment stage of masked surfaces.
pub(crate) const SOURCE: &str = include_str!("shadow.wgsl");

/// Which triangles are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Sides {
    /// Both sides of all that casts shadows: what has no back casts one too.
    Both,
    /// What a viewer sees of it; not what light passes through.
    Shown,
}

/// Returns whether what is drawn so casts shadows: triangles that light meets and that are not
/// blended. Unlit surfaces take no part in light: they are skies, labels and baked light.
pub(crate) fn casts_shadows(key: &PipelineKey) -> bool {
    CasterPass::draws(key, Sides::Both)
}

/// Everything that the depth of what casts shadows depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct CasterKey {
    layout: VertexLayout,
    /// The slot of the texture that has the mask, if any, and whether its place is moved.
    mask: Option<(TextureSlot, bool)>,
    cull: Cull,
    mirrored: bool,
}

impl CasterKey {
    fn new(key: &PipelineKey, sides: Sides) -> Option<Self> {
        let PipelineKey { layout, topology, material, cull, mirrored, .. } = *key;
        let MaterialFeatures { alpha, base_color, uv_transformed, lit, .. } = material;
        let mask = (alpha == Alpha::Mask).then_some((base_color, uv_transformed));
        let casts = alpha != Alpha::Blend && topology == Topology::Triangles && lit;
        match sides {
            Sides::Both => {
                casts.then_some(Self { layout, mask, cull: Cull::Nothing, mirrored: false })
            }
            Sides::Shown => {
                (casts && !key.transmits()).then_some(Self { layout, mask, cull, mirrored })
            }
        }
    }

    fn interface(self) -> Interface {
        let Some((slot, _)) = self.mask else { return Interface::default() };
        let attributes = VertexLayout {
            tangent: false,
            uv0: slot == TextureSlot::Uv0,
            uv1: slot == TextureSlot::Uv1,
            color: self.layout.color,
        };
        Interface { attributes, ..Interface::default() }
    }
}

/// The pass.
#[derive(Clone, Debug)]
pub(crate) struct CasterPass {
    layout: wgpu::PipelineLayout,
    modules: BTreeMap<Interface, wgpu::ShaderModule>,
    pipelines: BTreeMap<CasterKey, wgpu::RenderPipeline>,
}

impl CasterPass {
    pub fn new(gpu: &Gpu) -> Self {
        let frame = bindings::frame_layout(&gpu.device, FrameExtras::default());
        let material = bindings::material_layout(&gpu.device);
        let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("shadow/pipeline_layout"),
            bind_group_layouts: &[Some(&frame), None, Some(&material)],
            immediate_size: 0,
        });
        Self { layout, modules: BTreeMap::new(), pipelines: BTreeMap::new() }
    }

    /// Returns whether it draws what is drawn so.
    pub fn draws(key: &PipelineKey, sides: Sides) -> bool {
        CasterKey::new(key, sides).is_some()
    }

    /// Makes what is missing for a scene.
    pub fn prepare(&mut self, gpu: &Gpu, keys: &[PipelineKey], sides: Sides) {
        for key in keys.iter().filter_map(|key| CasterKey::new(key, sides)) {
            if !self.pipelines.contains_key(&key) {
                let pipeline = self.build(gpu, key);
                self.pipelines.insert(key, pipeline);
            }
        }
    }

    /// Returns whether nothing is missing for a scene.
    pub fn has(&self, keys: &[PipelineKey], sides: Sides) -> bool {
        let mut needed = keys.iter().filter_map(|key| CasterKey::new(key, sides));
        needed.all(|key| self.pipelines.contains_key(&key))
    }

    /// Takes what another one has made.
    pub fn add(&mut self, other: Self) {
        self.modules.extend(other.modules);
        self.pipelines.extend(other.pipelines);
    }

    /// The pipelines of a scene, in the order of its keys; `None` for what casts no shadow or was
    /// not prepared.
    pub fn pipelines(
        &self,
        keys: &[PipelineKey],
        sides: Sides,
    ) -> Vec<Option<&wgpu::RenderPipeline>> {
        let of = |key| CasterKey::new(key, sides).and_then(|key| self.pipelines.get(&key));
        keys.iter().map(of).collect()
    }

    fn build(&mut self, gpu: &Gpu, key: CasterKey) -> wgpu::RenderPipeline {
        let interface = key.interface();
        let module = self.modules.entry(interface).or_insert_with(|| {
            gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some("shadow/shader"),
                source: wgpu::ShaderSource::Wgsl(shader::surface(interface, SOURCE).into()),
            })
        });
        let vertex_attributes = vertex_attributes(key.layout, interface);
        let instance_attributes = instance_attributes(interface);
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
        let (slot, is_moved) = key.mask.unwrap_or((TextureSlot::None, false));
        let constants = [
            ("BASE_COLOR", f64::from(slot as u8)),
            ("UV_TRANSFORMED", f64::from(u8::from(is_moved))),
        ];
        gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("shadow/pipeline"),
            layout: Some(&self.layout),
            vertex: wgpu::VertexState {
                module,
                entry_point: Some("vertex"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &buffers,
            },
            primitive: primitive_state(Topology::Triangles, key.cull, key.mirrored),
            depth_stencil: Some(wgpu::DepthStencilState {
                format: DEPTH_FORMAT,
                depth_write_enabled: Some(true),
                // Depth is reversed: 1 at the light.
                depth_compare: Some(wgpu::CompareFunction::Greater),
                stencil: wgpu::StencilState::default(),
                bias: wgpu::DepthBiasState::default(),
            }),
            multisample: wgpu::MultisampleState::default(),
            fragment: key.mask.is_some().then_some(wgpu::FragmentState {
                module,
                entry_point: Some("caster"),
                compilation_options: wgpu::PipelineCompilationOptions {
                    constants: &constants,
                    ..Default::default()
                },
                targets: &[],
            }),
            multiview_mask: None,
            cache: None,
        })
    }
}

/// Begins the pass over a map, which keeps what it has or is cleared.
pub(crate) fn begin<'encoder>(
    encoder: &'encoder mut wgpu::CommandEncoder,
    map: &wgpu::TextureView,
    keeps: bool,
) -> wgpu::RenderPass<'encoder> {
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("shadow/pass"),
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view: map,
            depth_ops: Some(wgpu::Operations {
                load: if keeps { wgpu::LoadOp::Load } else { wgpu::LoadOp::Clear(0.0) },
                store: wgpu::StoreOp::Store,
            }),
            stencil_ops: None,
        }),
        ..Default::default()
    })
}
