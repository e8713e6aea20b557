//! All that passes over a scene draw with.

use crate::draw_list::{Draw, DrawList};
use crate::scene::GpuScene;
use crate::view::ViewDesc;

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
