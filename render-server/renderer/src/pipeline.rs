//! Pipelines: one for each combination that the scene has, and no other.

use std::collections::BTreeMap;

use polyptych_scene::{Topology, VertexLayout};
use polyptych_wall::ShadowFilter;

use super::bindings::{self, FrameExtras};
use super::gpu::Gpu;
use super::output_texture::ImageEncoding;
use super::pass::{opaque, transparent};
use super::scene::ExtensionFeatures;
use super::shader::{self, Interface};
use super::target::{DEPTH_FORMAT, DISPLAY_FORMAT, LINEAR_FORMAT};

/// The alpha mode of a material.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Alpha {
    Opaque,
    Mask,
    Blend,
}

/// The source of a texture's coordinates. The numbers stand in `include/material.wgsl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum TextureSlot {
    #[default]
    None = 0,
    Uv0 = 1,
    Uv1 = 2,
    /// The vertices lack the coordinates: always (0, 0).
    Corner = 3,
}

/// The features of a material that its pipeline must have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct MaterialFeatures {
    pub alpha: Alpha,
    pub double_sided: bool,
    pub lit: bool,
    pub base_color: TextureSlot,
    pub metallic_roughness: TextureSlot,
    pub normal: TextureSlot,
    pub occlusion: TextureSlot,
    pub occlusion_packed: bool,
    pub emissive: TextureSlot,
    pub glowing: bool,
    pub uv_transformed: bool,
    pub highlighted: bool,
    pub extensions: ExtensionFeatures,
}

/// The faces that are left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Cull {
    Nothing,
    Back,
    Front,
}

/// Everything that a pipeline depends on, but the samples of a renderer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct PipelineKey {
    pub layout: VertexLayout,
    pub topology: Topology,
    pub material: MaterialFeatures,
    pub cull: Cull,
    pub mirrored: bool,
    pub sun_count: u8,
    pub lamps: bool,
    /// Into the float target, which is tone-mapped later.
    pub linear: bool,
    /// Off where the scene has no light that casts shadows.
    pub shadows: ShadowFilter,
    /// Point or spot lights of the scene cast shadows.
    pub lamp_shadows: bool,
}

/// The part of a pipeline that is no scene's own: what a frame is drawn onto, and how.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct PipelineVariant {
    pub content: ImageEncoding,
    /// Light comes from all around, by a map.
    pub environment: bool,
    /// Fog lies between the eye and what it sees.
    pub fog: bool,
    /// Corners and gaps get less of the light from all around.
    pub ambient_occlusion: bool,
    /// Into the float target, whatever the scene does.
    pub is_light: bool,
}

/// What a pipeline of a key has of a variant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Built {
    /// Into a float target.
    is_float: bool,
    environment: bool,
    fog: bool,
    ambient_occlusion: bool,
}

/// The optional bindings of a pipeline, beside those that all have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct LayoutKey {
    pub frame: FrameExtras,
    pub has_shadows: bool,
    pub has_lamp_shadows: bool,
    pub has_extensions: bool,
    pub has_grain: bool,
}

impl PipelineVariant {
    /// What group 0 has for it, beside what is behind surfaces.
    pub fn frame_extras(self) -> FrameExtras {
        let Self { environment, ambient_occlusion, .. } = self;
        FrameExtras { environment, behind: false, occlusion: ambient_occlusion }
    }

    /// The same with each look that a frame may bring.
    fn looks(self) -> impl Iterator<Item = Self> {
        (0..8).map(move |bits| Self {
            fog: bits & 1 != 0,
            ambient_occlusion: bits & 2 != 0,
            is_light: bits & 4 != 0,
            ..self
        })
    }
}

impl PipelineKey {
    fn layout_key(&self, built: Built) -> LayoutKey {
        let Built { environment, ambient_occlusion: occlusion, .. } = built;
        let has_shadows = self.has_shadows();
        LayoutKey {
            frame: FrameExtras { environment, behind: self.transmits(), occlusion },
            has_shadows,
            has_lamp_shadows: has_shadows && self.lamp_shadows,
            has_extensions: !self.material.extensions.set.is_empty(),
            has_grain: self.material.extensions.has_grain,
        }
    }

    /// Returns whether lights cast shadows.
    pub fn has_shadows(&self) -> bool {
        self.shadows != ShadowFilter::Off
    }

    /// Returns whether light passes through its surfaces.
    pub fn transmits(&self) -> bool {
        self.material.extensions.set.transmission
    }

    /// The pipeline of this key that a variant uses; several may use one.
    fn built(&self, variant: PipelineVariant) -> Built {
        let is_float = is_float(self, variant.content);
        let PipelineVariant { environment, fog, ambient_occlusion, .. } = variant;
        Built { is_float, environment, fog, ambient_occlusion }
    }

    fn interface(&self, built: Built) -> Interface {
        let m = &self.material;
        let slots = [m.base_color, m.metallic_roughness, m.normal, m.occlusion, m.emissive];
        let has = |slot| slots.contains(&slot) || m.extensions.coordinates.contains(&slot);
        let attributes = VertexLayout {
            tangent: m.normal != TextureSlot::None || m.extensions.has_tangents(),
            uv0: has(TextureSlot::Uv0),
            uv1: has(TextureSlot::Uv1),
            color: self.layout.color,
        };
        let (lamps, shadows) = (self.lamps && m.lit, self.has_shadows() && m.lit);
        Interface {
            attributes,
            lit: m.lit,
            lamps,
            shadows,
            lamp_shadows: shadows && self.lamp_shadows,
            penumbras: shadows && self.shadows == ShadowFilter::ContactHardening,
            environment: built.environment && m.lit,
            fog: built.fog,
            ambient_occlusion: built.ambient_occlusion && m.lit,
            extensions: m.extensions.set,
        }
    }

    fn constants(&self) -> Vec<(&'static str, f64)> {
        let m = &self.material;
        let flag = |on: bool| f64::from(u8::from(on));
        let slot = |slot: TextureSlot| f64::from(slot as u8);
        let mut constants = vec![
            ("BASE_COLOR", slot(m.base_color)),
            ("METALLIC_ROUGHNESS", slot(m.metallic_roughness)),
            ("NORMAL", slot(m.normal)),
            ("OCCLUSION", slot(m.occlusion)),
            ("OCCLUSION_PACKED", flag(m.occlusion_packed)),
            ("EMISSIVE", slot(m.emissive)),
            ("GLOWING", flag(m.glowing)),
            ("UV_TRANSFORMED", flag(m.uv_transformed)),
            ("MASKED", flag(m.alpha == Alpha::Mask)),
            ("DOUBLE_SIDED", flag(m.double_sided)),
            ("LIT", flag(m.lit)),
            ("HIGHLIGHTED", flag(m.highlighted)),
            ("SUN_COUNT", f64::from(self.sun_count)),
            ("LAMPS", flag(self.lamps)),
            ("MIRRORED", flag(self.mirrored)),
        ];
        constants.extend(m.extensions.constants());
        if m.alpha != Alpha::Blend {
            constants.push(("TONE_MAPPED", flag(!self.linear)));
        }
        if self.has_shadows() && m.lit {
            constants.push(("SOFT", flag(self.shadows != ShadowFilter::Hard)));
            let has_penumbras = self.shadows == ShadowFilter::ContactHardening;
            constants.push(("CONTACT_HARDENING", flag(has_penumbras)));
        }
        constants
    }
}

/// One record per drawn item, stepped per instance.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, bytemuck::Pod, bytemuck::Zeroable)]
pub(crate) struct InstanceRecord {
    /// Rows of the affine matrix from `position - near` to eye-relative world axes.
    pub rows: [[f32; 4]; 3],
    /// Rows of the matrix for normals.
    pub normal_rows: [[f32; 3]; 3],
    /// Start and count in the list of lamp indices.
    pub lamps: [u32; 2],
    /// Subtracted from positions first; see `relative_to`.
    pub near: [f32; 3],
    /// The position of `near` in clip space.
    pub clip_offset: [f32; 4],
}

/// The pipelines of a renderer, made on demand.
#[derive(Clone, Debug)]
pub(crate) struct Pipelines {
    samples: u32,
    layouts: BTreeMap<LayoutKey, wgpu::PipelineLayout>,
    /// The filter of all scenes that have shadows.
    pub shadows: ShadowFilter,
    /// Lamps have maps of their shadows: [`Gpu::has_lamp_maps`].
    pub has_lamp_maps: bool,
    modules: BTreeMap<(Interface, bool), wgpu::ShaderModule>,
    ready: BTreeMap<(PipelineKey, Built), wgpu::RenderPipeline>,
}

impl Pipelines {
    pub fn new(gpu: &Gpu, samples: u32) -> Self {
        let (modules, ready) = (BTreeMap::new(), BTreeMap::new());
        let layouts = [false, true].map(|has_shadows| {
            let of = LayoutKey { has_shadows, ..LayoutKey::default() };
            (of, pipeline_layout(gpu, of))
        });
        let (layouts, shadows) = (layouts.into(), ShadowFilter::default());
        let has_lamp_maps = gpu.has_lamp_maps();
        Self { samples, layouts, shadows, has_lamp_maps, modules, ready }
    }

    /// Makes what is missing for a scene that is drawn in this way.
    pub fn prepare(&mut self, gpu: &Gpu, keys: &[PipelineKey], variant: PipelineVariant) {
        for key in &keys.iter().map(|key| self.filtered(key, variant)).collect::<Vec<_>>() {
            let built = key.built(variant);
            if !self.ready.contains_key(&(*key, built)) {
                let of = key.layout_key(built);
                self.layouts.entry(of).or_insert_with(|| pipeline_layout(gpu, of));
                let pipeline = self.build(gpu, key, built);
                self.ready.insert((*key, built), pipeline);
            }
        }
    }

    /// Returns whether nothing is missing for a scene that is drawn in this way.
    pub fn has(&self, keys: &[PipelineKey], variant: PipelineVariant) -> bool {
        keys.iter().all(|key| self.get(key, variant).is_some())
    }

    /// Takes what another one of the same samples has made.
    pub fn add(&mut self, other: Self) {
        let Self { layouts, modules, ready, .. } = other;
        self.layouts.extend(layouts);
        self.modules.extend(modules);
        self.ready.extend(ready);
    }

    /// The key of a scene with the filter in force and the maps that there are, for the target of a
    /// variant.
    fn filtered(&self, key: &PipelineKey, variant: PipelineVariant) -> PipelineKey {
        let shadows = if key.has_shadows() { self.shadows } else { key.shadows };
        let lamp_shadows = key.lamp_shadows && self.has_lamp_maps;
        PipelineKey { shadows, lamp_shadows, linear: key.linear || variant.is_light, ..*key }
    }

    /// The bindings of the pipeline that a variant uses.
    #[cfg(test)]
    pub fn layout_key(&self, key: &PipelineKey, variant: PipelineVariant) -> LayoutKey {
        let key = self.filtered(key, variant);
        key.layout_key(key.built(variant))
    }

    /// Makes what is missing for another look (fog, ambient occlusion or glow), if the
    /// scene was prepared for one: a frame brings them, and a state only what stays.
    pub fn prepare_look(&mut self, gpu: &Gpu, keys: &[PipelineKey], variant: PipelineVariant) {
        let is_ready = |variant| self.has(keys, variant);
        if !is_ready(variant) && variant.looks().any(is_ready) {
            self.prepare(gpu, keys, variant);
        }
    }

    pub fn get(
        &self,
        key: &PipelineKey,
        variant: PipelineVariant,
    ) -> Option<&wgpu::RenderPipeline> {
        let key = self.filtered(key, variant);
        self.ready.get(&(key, key.built(variant)))
    }

    fn build(&mut self, gpu: &Gpu, key: &PipelineKey, built: Built) -> wgpu::RenderPipeline {
        let blended = key.material.alpha == Alpha::Blend;
        let interface = key.interface(built);
        let layout = self.layouts.get(&key.layout_key(built));
        let pass = if blended { transparent::SOURCE } else { opaque::SOURCE };
        let module = self.modules.entry((interface, blended)).or_insert_with(|| {
            gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(if blended { "transparent/shader" } else { "opaque/shader" }),
                source: wgpu::ShaderSource::Wgsl(shader::surface(interface, pass).into()),
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
        let constants = key.constants();
        let compilation_options =
            || wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() };
        let target = wgpu::ColorTargetState {
            format: if built.is_float { LINEAR_FORMAT } else { DISPLAY_FORMAT },
            blend: blended.then(|| blend_state(key.material.lit && !key.material.highlighted)),
            write_mask: wgpu::ColorWrites::ALL,
        };
        gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(if blended { "transparent/pipeline" } else { "opaque/pipeline" }),
            layout,
            vertex: wgpu::VertexState {
                module,
                entry_point: Some("vertex"),
                compilation_options: compilation_options(),
                buffers: &buffers,
            },
            primitive: primitive_state(key.topology, key.cull, key.mirrored),
            depth_stencil: Some(wgpu::DepthStencilState {
                format: DEPTH_FORMAT,
                depth_write_enabled: Some(!blended),
                // Depth is reversed; of equal depths the first drawn stays. What is blended, such
                // as a decal, may lie exactly on what is opaque.
                depth_compare: Some(if blended {
                    wgpu::CompareFunction::GreaterEqual
                } else {
                    wgpu::CompareFunction::Greater
                }),
                stencil: wgpu::StencilState::default(),
                bias: wgpu::DepthBiasState::default(),
            }),
            multisample: wgpu::MultisampleState { count: self.samples, ..Default::default() },
            fragment: Some(wgpu::FragmentState {
                module,
                entry_point: Some(if blended { "transparent" } else { "opaque" }),
                compilation_options: compilation_options(),
                targets: &[Some(target)],
            }),
            multiview_mask: None,
            cache: None,
        })
    }
}

fn pipeline_layout(gpu: &Gpu, of: LayoutKey) -> wgpu::PipelineLayout {
    let material = bindings::material_layout(&gpu.device);
    let frame = bindings::frame_layout(&gpu.device, of.frame);
    let shadow = of.has_shadows.then(|| bindings::shadow_layout(&gpu.device, of.has_lamp_shadows));
    let extension =
        of.has_extensions.then(|| bindings::extension_layout(&gpu.device, of.has_grain));
    let groups = [Some(&frame), shadow.as_ref(), Some(&material), extension.as_ref()];
    gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("scene/pipeline_layout"),
        bind_group_layouts: if of.has_extensions { &groups } else { &groups[..3] },
        immediate_size: 0,
    })
}

/// Returns whether the scene is drawn into a float texture: light that is tone-mapped later always
/// is.
fn is_float(key: &PipelineKey, content: ImageEncoding) -> bool {
    key.linear || content.format() == LINEAR_FORMAT
}

/// Blending of premultiplied colours. The target's alpha is the part of its colour that is scene
/// light, see `include/tone.wgsl`: lit surfaces add their coverage to it, unlit and highlighted
/// ones take theirs.
fn blend_state(lit: bool) -> wgpu::BlendState {
    let over = wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING;
    if lit {
        return over;
    }
    let alpha = wgpu::BlendComponent { src_factor: wgpu::BlendFactor::Zero, ..over.alpha };
    wgpu::BlendState { alpha, ..over }
}

pub(crate) fn primitive_state(
    topology: Topology,
    cull: Cull,
    mirrored: bool,
) -> wgpu::PrimitiveState {
    wgpu::PrimitiveState {
        topology: match topology {
            Topology::Points => wgpu::PrimitiveTopology::PointList,
            Topology::Lines => wgpu::PrimitiveTopology::LineList,
            Topology::Triangles => wgpu::PrimitiveTopology::TriangleList,
        },
        front_face: if mirrored { wgpu::FrontFace::Cw } else { wgpu::FrontFace::Ccw },
        cull_mode: match cull {
            Cull::Nothing => None,
            Cull::Back => Some(wgpu::Face::Back),
            Cull::Front => Some(wgpu::Face::Front),
        },
        ..Default::default()
    }
}

pub(crate) fn vertex_attributes(
    layout: VertexLayout,
    interface: Interface,
) -> Vec<wgpu::VertexAttribute> {
    let (two, three, four) = (
        wgpu::VertexFormat::Float32x2,
        wgpu::VertexFormat::Float32x3,
        wgpu::VertexFormat::Float32x4,
    );
    let read = interface.attributes;
    [
        (true, three, 0, 0),
        (interface.lit, three, 12, 1),
        (read.tangent, four, VertexLayout::TANGENT_OFFSET, 2),
        (read.uv0, two, layout.uv0_offset(), 3),
        (read.uv1, two, layout.uv1_offset(), 4),
        (read.color, four, layout.color_offset(), 5),
    ]
    .into_iter()
    .filter(|(there, ..)| *there)
    .map(|(_, format, offset, shader_location)| wgpu::VertexAttribute {
        format,
        offset: u64::from(offset),
        shader_location,
    })
    .collect()
}

pub(crate) fn instance_attributes(interface: Interface) -> Vec<wgpu::VertexAttribute> {
    let attribute =
        |format, offset, shader_location| wgpu::VertexAttribute { format, offset, shader_location };
    let row = |i: u32| attribute(wgpu::VertexFormat::Float32x4, u64::from(i) * 16, 6 + i);
    let normal = |i: u32| attribute(wgpu::VertexFormat::Float32x3, 48 + u64::from(i) * 12, 9 + i);
    let mut attributes: Vec<_> = (0..3).map(row).collect();
    attributes.push(attribute(wgpu::VertexFormat::Float32x3, 92, 13));
    attributes.push(attribute(wgpu::VertexFormat::Float32x4, 104, 14));
    if interface.lit {
        attributes.extend((0..3).map(normal));
    }
    if interface.lamps {
        attributes.push(attribute(wgpu::VertexFormat::Uint32x2, 84, 12));
    }
    attributes
}
