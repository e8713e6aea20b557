//! Items that others hide, left out before the scene is drawn.
//!
//! Near, opaque items are drawn first, their depth only. What lies behind it everywhere is left out
//! of the frame; what is drawn begins with this depth, so that no fragment behind it is shaded.
//! Neither changes a pixel, and the order of what is drawn stays: so which items are occluders may
//! depend on the frame before.

use polyptych_scene::FramePass;

use super::begun_frame::ShownView;
use super::draw_context::FrameBindings;
use super::submission::Submission;
use super::{DrawContext, FrameResources, around, check_records};
use crate::DrawError;
use crate::draw_list::DrawList;
use crate::gpu::Gpu;
use crate::many_items;
use crate::occlusion::{OcclusionCulling, OcclusionTest};
use crate::occlusion_trial::OcclusionTrial;
use crate::pass::occluder::{OccluderPass, OccluderTarget, may_occlude};
use crate::readback::TextureCopy;
use crate::scene::GpuScene;
use crate::target::Target;
use crate::view::ViewDesc;

/// Items of a frame below which it is not tried whether leaving some out is faster: a trial may
/// double a frame's time, and what few items hide of each other is little.
const TRIED_ITEMS_MIN: usize = 64;

/// The least radius of an occluder, as a share of half of the picture's height: a smaller one hides
/// less than it costs to draw twice.
const OCCLUDER_RADIUS_MIN: f64 = 0.02;

/// The items that were found to be hidden in a frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct HiddenItems {
    pub count: u32,
    /// Pixels that occluders may touch: x, y, width, height.
    touched: [u32; 4],
}

/// The depth of occluders, which the GPU draws.
#[derive(Debug)]
pub(super) struct OccluderDepths {
    submission: Submission,
    copy: TextureCopy,
    touched: [u32; 4],
}

/// The memory of a target from frame to frame of what was hidden. No picture depends on it.
#[derive(Debug, Default)]
pub(crate) struct OcclusionMemory {
    textures: Option<OccluderTarget>,
    trial: OcclusionTrial,
    /// By view, a bit for each item that was hidden in the last frame: those are no occluders.
    hidden: Vec<Vec<u64>>,
}

impl OcclusionMemory {
    /// Returns whether the next frame, which may show so many items, leaves out what is hidden.
    pub(super) fn is_used(&self, when: OcclusionCulling, items: usize) -> bool {
        match when {
            OcclusionCulling::Never => false,
            OcclusionCulling::WhereFaster => items >= TRIED_ITEMS_MIN && self.trial.is_culling(),
            OcclusionCulling::Always => true,
        }
    }

    /// Returns whether the next frame, which may show so many items, is part of a trial.
    pub(super) fn is_trial(&self, when: OcclusionCulling, items: usize) -> bool {
        let may_try = when == OcclusionCulling::WhereFaster && items >= TRIED_ITEMS_MIN;
        may_try && self.trial.is_under_way()
    }

    /// Takes the time of a frame that may show so many items, if it could have been drawn either
    /// way. Of several frames on their way, the first may begin a trial that the next ones, which
    /// were drawn before that, are no part of.
    pub(super) fn record(&mut self, items: usize, frame_us: u64, is_culling: bool) {
        if items >= TRIED_ITEMS_MIN && is_culling == self.trial.is_culling() {
            self.trial.record(frame_us);
        }
    }

    fn was_hidden(&self, view: usize, item: u32) -> bool {
        let bits = self.hidden.get(view).and_then(|bits| bits.get(item as usize / 64));
        bits.is_some_and(|bits| bits >> (item % 64) & 1 == 1)
    }
}

impl FrameResources {
    /// Submits the depth of near, opaque items; `None` if there is no occluder.
    ///
    /// # Errors
    /// More is shown than is held for one frame.
    pub(super) fn search_hidden(
        &mut self,
        gpu: &Gpu,
        occluders: &OccluderPass,
        scene: &GpuScene,
        target: &mut Target,
        shown: &[ShownView],
    ) -> Result<Option<OccluderDepths>, DrawError> {
        self.clear_lists();
        let mut lists = Vec::with_capacity(shown.len());
        for (index, (view, visible)) in shown.iter().enumerate() {
            let occlusion = &target.occlusion;
            let items = many_items::find(&visible.items, |item| {
                let was_hidden = occlusion.was_hidden(index, item);
                (!was_hidden && hides_much(scene, view, item)).then_some(item)
            });
            let (scratch, records) = (&mut self.scratch, &mut self.records);
            lists.push(DrawList::new(scene, view, (visible, &items), scratch, records));
            check_records(gpu, records.len())
                .map_err(|reason| DrawError::View { index, reason })?;
        }
        let Some(touched) = lists.iter().filter_map(|list| list.touched).reduce(around) else {
            // All that would hide others was hidden, by what has gone: the next frame begins anew.
            target.occlusion.hidden.clear();
            return Ok(None);
        };
        let size = target.size();
        let textures = target.occlusion.textures.get_or_insert_with(|| occluders.target(gpu, size));
        let timer = self.timer.clone();
        let views = shown.iter().map(|(view, _)| view).collect();
        let pipelines = occluders.pipelines(&scene.layout.keys);
        let bindings = FrameBindings { pipelines, ..FrameBindings::default() };
        let context = DrawContext {
            has_materials: false,
            ..self.context(gpu, bindings, scene, views, &lists)
        };
        let descriptor = wgpu::CommandEncoderDescriptor { label: Some("occluders") };
        let mut encoder = gpu.device.create_command_encoder(&descriptor);
        timer.begin(&mut encoder);
        textures.encode_depth(&mut encoder, &context);
        occluders.encode_farthest(&mut encoder, textures, touched);
        timer.end(&mut encoder, FramePass::HiddenItems);
        let copy = textures.encode_read(gpu, &mut encoder);
        let submission = Submission::new(gpu, encoder);
        Ok(Some(OccluderDepths { submission, copy, touched }))
    }
}

impl OccluderDepths {
    /// Leaves out the items that others hide. Then [`encode_behind`] gives the scene's pass the
    /// depth to begin with.
    ///
    /// # Errors
    /// The GPU failed.
    pub fn leave_out_hidden(
        &self,
        gpu: &Gpu,
        scene: &GpuScene,
        target: &mut Target,
        shown: &mut [ShownView],
    ) -> Result<HiddenItems, DrawError> {
        self.submission.wait(gpu)?;
        let Some(textures) = &target.occlusion.textures else {
            return Err(DrawError::Target);
        };
        let depths = textures.read(gpu, &self.copy, self.submission.index());
        let depths = depths.map_err(|error| DrawError::Gpu(error.to_string()))?;
        let mut count = 0;
        target.occlusion.hidden.resize(shown.len(), Vec::new());
        for ((view, visible), bits) in shown.iter_mut().zip(&mut target.occlusion.hidden) {
            let test = OcclusionTest::new(view, visible.rectangle, &depths);
            bits.clear();
            bits.resize(scene.layout.items.len().div_ceil(64), 0);
            let hides = |item| test.hides(scene.item(item).2).then_some(item);
            let hidden = many_items::find(&visible.items, hides);
            count += hidden.len() as u32;
            for item in hidden {
                bits[item as usize / 64] |= 1 << (item % 64);
            }
            visible.items.retain(|item| bits[*item as usize / 64] >> (item % 64) & 1 == 0);
        }
        Ok(HiddenItems { count, touched: self.touched })
    }
}

/// Encodes the depth that the scene's pass begins with, after
/// [`OccluderDepths::leave_out_hidden`].
pub(super) fn encode_behind(
    encoder: &mut wgpu::CommandEncoder,
    occluders: &OccluderPass,
    target: &Target,
    hidden: HiddenItems,
) {
    if let Some(textures) = &target.occlusion.textures {
        occluders.encode_behind(encoder, textures, target.depth(), hidden.touched);
    }
}

/// Returns whether an item is solid, and large enough in the picture to hide others.
fn hides_much(scene: &GpuScene, view: &ViewDesc, index: u32) -> bool {
    let (item, _, bounds) = scene.item(index);
    let batch = &scene.layout.batches[item.batch as usize];
    if !may_occlude(&scene.layout.keys[batch.pipeline as usize]) {
        return false;
    }
    // Clip space from lengths in the world, where w is 1.
    let scale = view.view_from_world.row(2).length() * view.clip_from_view.y_axis.y.abs();
    let radius = bounds.half().length() * scale;
    let w = if view.is_parallel() {
        1.0
    } else {
        bounds.center().distance(view.eye_in_world) * view.view_from_world.row(2).length()
    };
    radius >= OCCLUDER_RADIUS_MIN * w
}
