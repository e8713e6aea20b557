//! The frame itself, once all that it reads is drawn: scene, depth of field, and the way to the
//! display target.

use glam::Vec3;
use polyptych_scene::{FramePass, ToneMapper};

use super::begun_frame::ShownView;
use super::behind::{BehindBinding, DrawnWith};
use super::draw_context::{DrawContext, FrameBindings};
use super::glow::BegunGlow;
use super::hidden_items::{HiddenItems, encode_behind};
use super::scene_pass::{SceneEnds, encode_scene};
use super::submission::Submission;
use super::{FrameResources, around};
use crate::DrawError;
use crate::draw_list::DrawList;
use crate::gpu::Gpu;
use crate::pass::occluder::OccluderPass;
use crate::pass::tonemap::light_color;
use crate::scene::GpuScene;
use crate::target::Target;
use crate::tone::tone_map;

/// The parts of a frame beside the lists of its views.
pub(super) struct FrameContent<'a> {
    /// Exposed light of the sky.
    pub sky: Vec3,
    pub tone: ToneMapper,
    /// The picture behind glass.
    pub behind: Option<BehindBinding>,
    /// The occluders, whose depth it begins with, and the items that they hide.
    pub hidden_by: Option<(&'a OccluderPass, HiddenItems)>,
    /// There are maps of depth of field.
    pub is_blurred: bool,
    pub glow: &'a BegunGlow,
}

impl FrameResources {
    /// Encodes the frame of lists that were sorted last, and submits it.
    ///
    /// # Errors
    /// The sky's colour could not be found.
    pub(super) fn encode_frame(
        &mut self,
        gpu: &Gpu,
        with: &DrawnWith<'_>,
        (scene, target): (&GpuScene, &mut Target),
        (shown, lists): (&[ShownView], &[DrawList]),
        content: FrameContent<'_>,
    ) -> Result<Submission, DrawError> {
        let FrameContent { sky, tone, behind, hidden_by, is_blurred, glow } = content;
        let clear_display = if target.is_linear() {
            self.tonemap.sky_color(gpu, (sky, tone), target.content())?
        } else {
            light_color(tone_map(tone, sky))
        };
        let timer = self.timer.clone();
        let views: Vec<_> = shown.iter().map(|(view, _)| view).collect();
        let background = self.background(gpu, scene, target, (with.variant, &views));
        let bindings = FrameBindings {
            pipelines: with.pipelines.to_vec(),
            environment: scene.environment.as_deref(),
            behind,
            occlusion: with.occlusion.map(|drawn| drawn.binding(shown)),
        };
        let context = DrawContext {
            shadows: with.shadows.to_vec(),
            ..self.context(gpu, bindings, scene, views, lists)
        };
        let descriptor = wgpu::CommandEncoderDescriptor { label: Some("frame") };
        let mut encoder = gpu.device.create_command_encoder(&descriptor);
        timer.begin(&mut encoder);
        if let Some((occluders, hidden)) = hidden_by {
            encode_behind(&mut encoder, occluders, target, hidden);
        }
        let clear_scene = if target.is_linear() { light_color(sky) } else { clear_display };
        let has_depth = hidden_by.is_some();
        let ends = SceneEnds { sky: clear_scene, has_depth, keeps_depth: is_blurred };
        encode_scene(&mut encoder, target, ends, &context, background.as_ref());
        timer.end(&mut encoder, FramePass::Scene);
        if is_blurred {
            self.encode_discs(gpu, &mut encoder, (target, clear_scene), shown);
        } else {
            target.end_focus();
        }
        if let Some(first) = &glow.first {
            self.encode_glow(gpu, &mut encoder, (target, Some(clear_display), tone), first);
        } else if target.is_linear() {
            let touched = lists.iter().filter_map(|list| match background {
                None if !is_blurred => list.touched,
                _ => Some(list.rectangle),
            });
            let touched = touched.reduce(around);
            timer.begin(&mut encoder);
            self.tonemap.encode(gpu, &mut encoder, target, (clear_display, tone), touched);
            timer.end(&mut encoder, FramePass::ToneMapping);
        }
        Ok(Submission::new(gpu, encoder))
    }
}
