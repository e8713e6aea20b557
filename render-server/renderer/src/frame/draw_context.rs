//! All that passes over a scene draw with.

use super::FrameResources;
use super::ambient_occlusion::OcclusionBinding;
use super::behind::BehindBinding;
use super::draw_args;
use crate::bindings::{FrameExtras, frame_layout, uniform_stride};
use crate::draw_list::{Draw, DrawList};
use crate::environment::Environment;
use crate::gpu::Gpu;
use crate::guarded_region::BehindUniform;
use crate::scene::GpuScene;
use crate::view::{FrameUniform, LocalLightRecord, ViewDesc};

/// The pipelines of a pass over a scene, and what they read beside it.
#[derive(Default)]
pub(super) struct FrameBindings<'a> {
    /// In the order of the scene's keys; what has none is not drawn.
    pub pipelines: Vec<Option<&'a wgpu::RenderPipeline>>,
    pub environment: Option<&'a Environment>,
    pub behind: Option<BehindBinding>,
    pub occlusion: Option<OcclusionBinding>,
}

/// All that passes over a scene draw with.
pub(crate) struct DrawContext<'a> {
    pub(super) scene: &'a GpuScene,
    /// In the order of the scene's keys; what has none is not drawn.
    pub(super) pipelines: Vec<Option<&'a wgpu::RenderPipeline>>,
    /// The pipelines read materials.
    pub(super) has_materials: bool,
    pub(super) views: Vec<&'a ViewDesc>,
    pub lists: &'a [DrawList],
    pub(super) group: wgpu::BindGroup,
    /// Group 0 of what transmits light, and the step of its uniforms.
    pub(super) behind: Option<(wgpu::BindGroup, u32)>,
    /// The bindings of each view; empty where no light casts shadows.
    pub(super) shadows: Vec<wgpu::BindGroup>,
    pub(super) instances: &'a wgpu::Buffer,
    /// Indices of what is drawn in the order of distances; `None` without any.
    pub(super) ordered_indices: Option<&'a wgpu::Buffer>,
    pub(super) uniform_stride: u32,
    pub(super) lamp_stride: u32,
    /// No more indices of a geometry than this are drawn.
    pub(super) index_count_max: u32,
    /// The arguments of all draws, and the number of those before each list; `None` where the GPU
    /// reads none.
    pub(super) args: Option<(&'a wgpu::Buffer, Vec<u32>)>,
}

/// A part of a list of draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ListPart {
    Opaque,
    Transparent,
}

impl FrameResources {
    /// Writes what the views of a pass over a scene need, and binds it.
    pub(super) fn context<'a>(
        &'a mut self,
        gpu: &Gpu,
        bindings: FrameBindings<'a>,
        scene: &'a GpuScene,
        views: Vec<&'a ViewDesc>,
        lists: &'a [DrawList],
    ) -> DrawContext<'a> {
        let FrameBindings { pipelines, environment, behind, occlusion } = bindings;
        let uniform_size = uniform_stride(gpu, size_of::<FrameUniform>());
        let lamp_count = scene.lamps().len().max(1);
        let lamp_size = lamp_count * size_of::<LocalLightRecord>();
        let alignment = gpu.device.limits().min_storage_buffer_offset_alignment as usize;
        let lamp_stride = lamp_size.next_multiple_of(alignment);
        let strides = [uniform_size, lamp_stride];
        let (uniforms, lamps) = bytes_of_views(scene, &views, occlusion.as_ref(), strides);
        let uniforms = self.uniforms.write(gpu, &uniforms);
        let lamps = self.lamps.write(gpu, &lamps);
        let part = |buffer, size: usize| {
            let size = wgpu::BufferSize::new(size as u64);
            wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer, offset: 0, size })
        };
        let entry = |binding, resource| wgpu::BindGroupEntry { binding, resource };
        let mut entries = vec![
            entry(0, part(uniforms, size_of::<FrameUniform>())),
            entry(1, part(lamps, lamp_size)),
            entry(2, scene.lamp_indices.as_entire_binding()),
            entry(3, wgpu::BindingResource::TextureView(&self.albedo)),
            entry(4, wgpu::BindingResource::Sampler(&self.albedo_sampler)),
        ];
        let has = (environment.is_some(), occlusion.is_some());
        let mut extras = FrameExtras { environment: has.0, behind: false, occlusion: has.1 };
        entries.extend(environment.iter().flat_map(|of| of.entries()));
        if let Some(of) = &occlusion {
            entries.push(entry(26, wgpu::BindingResource::TextureView(&of.map)));
        }
        let group = |extras, entries: &[wgpu::BindGroupEntry<'_>]| {
            let layout = &frame_layout(&gpu.device, extras);
            let label = Some("frame/group");
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor { label, layout, entries })
        };
        let whole = group(extras, &entries);
        let behind = behind.as_ref().map(|of| {
            let (bytes, stride) = of.uniform_bytes(gpu);
            let places = self.behind_uniforms.write(gpu, &bytes);
            entries.push(entry(24, wgpu::BindingResource::TextureView(&of.view)));
            entries.push(entry(25, part(places, size_of::<BehindUniform>())));
            extras.behind = true;
            (group(extras, &entries), stride as u32)
        });
        let mut first_args = Vec::new();
        let args =
            gpu.draws_indirectly().then(|| draw_args::of_lists(scene, lists, &mut first_args));
        let args = args.filter(|bytes| !bytes.is_empty());
        DrawContext {
            scene,
            pipelines,
            has_materials: true,
            views,
            lists,
            group: whole,
            behind,
            shadows: Vec::new(),
            instances: self.instances.write(gpu, bytemuck::cast_slice(&self.records)),
            ordered_indices: self.ordered_indices.write_any(gpu, &self.scratch.ordered_indices),
            uniform_stride: uniform_size as u32,
            lamp_stride: lamp_stride as u32,
            index_count_max: u32::MAX,
            args: args.map(|bytes| (self.args.write(gpu, &bytes), first_args)),
        }
    }
}

/// The uniforms of all views and the records of their lamps, so many bytes for each view.
fn bytes_of_views(
    scene: &GpuScene,
    views: &[&ViewDesc],
    occlusion: Option<&OcclusionBinding>,
    [uniform_size, lamp_stride]: [usize; 2],
) -> (Vec<u8>, Vec<u8>) {
    let mut uniforms = vec![0; uniform_size * views.len().max(1)];
    let mut lamps = vec![0; lamp_stride * views.len().max(1)];
    for (index, view) in views.iter().enumerate() {
        let part = scene.part(&view.subset);
        let mut uniform = view.uniform(scene, part);
        let place = occlusion.and_then(|of| of.places.get(index));
        uniform.occlusion = place.copied().unwrap_or_default();
        let bytes = bytemuck::bytes_of(&uniform);
        uniforms[index * uniform_size..][..bytes.len()].copy_from_slice(bytes);
        let eye = view.eye_in_world;
        let record = |lamp| LocalLightRecord::new(lamp, eye, part);
        let records: Vec<_> = scene.lamps().iter().map(record).collect();
        let bytes = bytemuck::cast_slice(&records);
        lamps[index * lamp_stride..][..bytes.len()].copy_from_slice(bytes);
    }
    (uniforms, lamps)
}

impl DrawContext<'_> {
    /// Sets what all draws of a view share.
    pub fn enter(&self, pass: &mut wgpu::RenderPass<'_>, view: usize) {
        let [x, y, width, height] = self.views[view].viewport.map(|number| number as f32);
        pass.set_viewport(x, y, width, height, 0.0, 1.0);
        let [x, y, width, height] = self.lists[view].rectangle;
        pass.set_scissor_rect(x, y, width, height);
        self.bind_frame(pass, view, false);
    }

    /// Sets group 0 for what transmits light, or for all else.
    fn bind_frame(&self, pass: &mut wgpu::RenderPass<'_>, view: usize, transmits: bool) {
        let index = view as u32;
        let [frame, lamps] = [index * self.uniform_stride, index * self.lamp_stride];
        match &self.behind {
            Some((group, stride)) if transmits => {
                pass.set_bind_group(0, group, &[frame, lamps, index * stride]);
            }
            _ => pass.set_bind_group(0, &self.group, &[frame, lamps]),
        }
    }

    /// Encodes draws of one view; sets only what changes from draw to draw.
    pub fn draw(&self, pass: &mut wgpu::RenderPass<'_>, view: usize, part: ListPart) {
        let list = &self.lists[view];
        let (draws, mut next) = match part {
            ListPart::Opaque => (&list.opaque, 0),
            ListPart::Transparent => (&list.transparent, list.opaque.len()),
        };
        if draws.is_empty() {
            return;
        }
        self.enter(pass, view);
        if let Some(shadows) = self.shadows.get(view) {
            pass.set_bind_group(1, shadows, &[]);
        }
        pass.set_vertex_buffer(1, self.instances.slice(..));
        let mut last = None;
        for alike in draws.chunk_by(|a, b| self.state(a) == self.state(b)) {
            let first = next;
            next += alike.len();
            let state = self.state(&alike[0]);
            if let Some(pipeline) = self.pipelines[state.pipeline as usize] {
                self.set(pass, view, (pipeline, &state), last.as_ref());
                self.draw_alike(pass, view, alike, first);
                last = Some(state);
            }
        }
    }

    /// All that is set for a draw.
    fn state(&self, draw: &Draw) -> DrawState<'_> {
        let batch = &self.scene.layout.batches[draw.batch as usize];
        let shape = &self.scene.geometries[batch.geometry as usize];
        let ordered = self.ordered_indices.filter(|_| draw.ordered);
        let own = (&shape.indices, shape.index_format);
        DrawState {
            pipeline: draw.pipeline,
            material: self.has_materials.then_some(batch.material),
            vertices: &shape.vertices,
            indices: ordered.map_or(own, |ordered| (ordered, wgpu::IndexFormat::Uint32)),
        }
    }

    /// Sets what of a state is not that of the last draw.
    fn set(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        view: usize,
        (pipeline, state): (&wgpu::RenderPipeline, &DrawState<'_>),
        last: Option<&DrawState<'_>>,
    ) {
        let DrawState { material, vertices, indices, .. } = state;
        if last.is_none_or(|last| last.pipeline != state.pipeline) {
            pass.set_pipeline(pipeline);
            let transmits =
                |of: &DrawState<'_>| self.scene.layout.keys[of.pipeline as usize].transmits();
            let transmitted = last.is_some_and(transmits);
            if transmits(state) != transmitted {
                self.bind_frame(pass, view, !transmitted);
            }
        }
        let material = material.filter(|of| last.is_none_or(|l| l.material != Some(*of)));
        if let Some(groups) = material.and_then(|of| self.scene.materials.get(of)) {
            pass.set_bind_group(2, &groups.material, &[]);
            if let Some(extensions) = &groups.extensions {
                pass.set_bind_group(3, &extensions.group, &[]);
            }
        }
        if last.is_none_or(|last| last.vertices != *vertices) {
            pass.set_vertex_buffer(0, vertices.slice(..));
        }
        if last.is_none_or(|last| last.indices != *indices) {
            pass.set_index_buffer(indices.0.slice(..), indices.1);
        }
    }

    /// Encodes draws with one state, of which the first is in this place among those of its list.
    fn draw_alike(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        view: usize,
        draws: &[Draw],
        first: usize,
    ) {
        if let Some((buffer, before)) = self.args.as_ref().filter(|_| draws.len() > 1) {
            let byte = (u64::from(before[view]) + first as u64) * draw_args::ARGS_BYTES;
            pass.multi_draw_indexed_indirect(buffer, byte, draws.len() as u32);
            return;
        }
        for draw in draws {
            let args =
                draw_args::args(self.scene.geometry_of(draw.batch), draw, self.index_count_max);
            let indices = args.first_index..args.first_index + args.index_count;
            let instances = args.first_instance..args.first_instance + args.instance_count;
            pass.draw_indexed(indices, args.base_vertex, instances);
        }
    }
}

/// All that is set for a draw: those that follow each other with the same are one command.
#[derive(Clone, Copy, Debug, PartialEq)]
struct DrawState<'a> {
    /// An index into the scene's pipeline keys.
    pipeline: u32,
    /// Its number in the scene's materials; `None` where pipelines read none.
    material: Option<u32>,
    vertices: &'a wgpu::Buffer,
    indices: (&'a wgpu::Buffer, wgpu::IndexFormat),
}
