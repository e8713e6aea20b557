//! All that passes over a scene draw with.

use super::FrameResources;
use super::ambient_occlusion::OcclusionBinding;
use super::behind::BehindBinding;
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
        let mut uniforms = vec![0; uniform_size * views.len().max(1)];
        let mut lamps = vec![0; lamp_stride * views.len().max(1)];
        for (index, view) in views.iter().enumerate() {
            let part = scene.layout.tree.select(&view.subset);
            let mut uniform = view.uniform(scene, part);
            let place = occlusion.as_ref().and_then(|of| of.places.get(index));
            uniform.occlusion = place.copied().unwrap_or_default();
            let bytes = bytemuck::bytes_of(&uniform);
            uniforms[index * uniform_size..][..bytes.len()].copy_from_slice(bytes);
            let eye = view.eye_in_world;
            let record = |lamp| LocalLightRecord::new(lamp, eye, part);
            let records: Vec<_> = scene.lamps().iter().map(record).collect();
            let bytes = bytemuck::cast_slice(&records);
            lamps[index * lamp_stride..][..bytes.len()].copy_from_slice(bytes);
        }
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
        }
    }
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
    pub fn draw(&self, pass: &mut wgpu::RenderPass<'_>, view: usize, draws: &[Draw]) {
        if draws.is_empty() {
            return;
        }
        self.enter(pass, view);
        if let Some(shadows) = self.shadows.get(view) {
            pass.set_bind_group(1, shadows, &[]);
        }
        pass.set_vertex_buffer(1, self.instances.slice(..));
        let mut transmitted = false;
        let (mut pipeline, mut material, mut geometry) = (None, None, None);
        for draw in draws {
            let batch = &self.scene.layout.batches[draw.batch as usize];
            let Some(with) = self.pipelines[draw.pipeline as usize] else { continue };
            if pipeline.replace(draw.pipeline) != Some(draw.pipeline) {
                pass.set_pipeline(with);
                let transmits = self.scene.layout.keys[draw.pipeline as usize].transmits();
                if std::mem::replace(&mut transmitted, transmits) != transmits {
                    self.bind_frame(pass, view, transmits);
                }
            }
            if self.has_materials && material.replace(batch.material) != Some(batch.material) {
                let groups = &self.scene.materials[batch.material as usize];
                pass.set_bind_group(2, &groups.material, &[]);
                if let Some(extensions) = &groups.extensions {
                    pass.set_bind_group(3, &extensions.group, &[]);
                }
            }
            let shape = &self.scene.geometries[batch.geometry as usize];
            let drawn = (batch.geometry, draw.ordered);
            if geometry.replace(drawn) != Some(drawn) {
                pass.set_vertex_buffer(0, shape.vertices.slice(..shape.vertex_bytes));
                if let Some(ordered) = self.ordered_indices.filter(|_| draw.ordered) {
                    pass.set_index_buffer(ordered.slice(..), wgpu::IndexFormat::Uint32);
                } else {
                    let indices = shape.indices.slice(shape.first_index_byte..);
                    pass.set_index_buffer(indices, shape.index_format);
                }
            }
            let [start, count] = draw.indices;
            let indices = start..start + count.min(self.index_count_max);
            pass.draw_indexed(indices, 0, draw.first..draw.first + draw.count);
        }
    }
}
