//! The frame itself, once all that it reads is drawn: scene, depth of field, and the way to the
//! display target.

use std::time::{Duration, Instant};

use glam::Vec3;
use polyptych_scene::{FramePass, ToneMapper};

use super::begun_frame::ShownView;
use super::behind::{DrawnWith, GlassGroup};
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

/// The parts of a frame beside its views.
pub(super) struct FrameContent<'a> {
    /// Exposed light of the sky.
    pub sky: Vec3,
    pub tone: ToneMapper,
    /// All views, in groups that share a picture behind glass: one at least.
    pub groups: Vec<GlassGroup>,
    /// The occluders, whose depth it begins with, and the items that they hide.
    pub hidden_by: Option<(&'a OccluderPass, HiddenItems)>,
    /// There are maps of depth of field.
    pub is_blurred: bool,
    pub glow: &'a BegunGlow,
}

/// A frame that was submitted.
pub(super) struct EncodedFrame {
    /// By view.
    pub lists: Vec<DrawList>,
    /// Time that it took to draw what is behind glass and to sort what views show.
    pub sort: Duration,
    pub submission: Submission,
}

impl FrameResources {
    /// Encodes a frame and submits it, each group of views by itself but for the last.
    ///
    /// # Errors
    /// More is shown than is held for one frame, or the sky's colour could not be found.
    pub(super) fn encode_frame(
        &mut self,
        gpu: &Gpu,
        with: &DrawnWith<'_>,
        (scene, target): (&GpuScene, &mut Target),
        shown: &[ShownView],
        content: FrameContent<'_>,
    ) -> Result<EncodedFrame, DrawError> {
        let FrameContent { sky, tone, groups, hidden_by, is_blurred, glow } = content;
        let clear_display = if target.is_linear() {
            self.tonemap.sky_color(gpu, (sky, tone), target.content())?
        } else {
            light_color(tone_map(tone, sky))
        };
        let clear_scene = if target.is_linear() { light_color(sky) } else { clear_display };
        let (mut lists, mut sort) = (Vec::with_capacity(shown.len()), Duration::ZERO);
        let mut encoder = new_encoder(gpu);
        let mut left = groups.len();
        for group in groups {
            let (is_first, is_last) = (lists.is_empty(), left == 1);
            let ends = SceneEnds {
                sky: clear_scene,
                has_color: !is_first,
                has_depth: !is_first || hidden_by.is_some(),
                keeps_color: !is_last,
                keeps_depth: !is_last || is_blurred,
            };
            let ends = (ends, hidden_by.filter(|_| is_first));
            let of = (shown, group);
            let onto = (&mut encoder, &mut lists);
            sort += self.encode_group(gpu, with, (scene, target), of, ends, onto)?;
            left -= 1;
            if !is_last {
                // The next group writes over what this one reads.
                Submission::new(gpu, std::mem::replace(&mut encoder, new_encoder(gpu)));
            }
        }
        if is_blurred {
            self.encode_discs(gpu, &mut encoder, (target, clear_scene), shown);
        } else {
            target.end_focus();
        }
        if let Some(first) = &glow.first {
            self.encode_glow(gpu, &mut encoder, (target, Some(clear_display), tone), first);
        } else if target.is_linear() {
            let is_all = is_blurred || scene.environment.is_some() || with.variant.fog;
            let of_list =
                |list: &DrawList| if is_all { Some(list.rectangle) } else { list.touched };
            let touched = lists.iter().filter_map(of_list).reduce(around);
            let timer = self.timer.clone();
            timer.begin(&mut encoder);
            self.tonemap.encode(gpu, &mut encoder, target, (clear_display, tone), touched);
            timer.end(&mut encoder, FramePass::ToneMapping);
        }
        Ok(EncodedFrame { lists, sort, submission: Submission::new(gpu, encoder) })
    }

    /// Submits what is behind the glass of a group of views, and encodes their scene. Appends their
    /// lists, and returns the time until these were there.
    ///
    /// # Errors
    /// More is shown than is held for one frame, or the GPU failed.
    fn encode_group(
        &mut self,
        gpu: &Gpu,
        with: &DrawnWith<'_>,
        (scene, target): (&GpuScene, &Target),
        (shown, GlassGroup { views, regions }): (&[ShownView], GlassGroup),
        (ends, hidden_by): (SceneEnds, Option<(&OccluderPass, HiddenItems)>),
        (encoder, lists): (&mut wgpu::CommandEncoder, &mut Vec<DrawList>),
    ) -> Result<Duration, DrawError> {
        let start = Instant::now();
        let of_group = &shown[views.clone()];
        let occlusion = with.occlusion.map(|of| of.of_views(views.clone()));
        let shadows = with.shadows.get(views.clone()).unwrap_or_default();
        let with = DrawnWith { shadows, occlusion: occlusion.as_ref(), ..*with };
        let behind = self.draw_behind(gpu, &with, scene, target, (of_group, regions))?;
        let own = self.lists(gpu, scene, (shown, views))?;
        let sort = start.elapsed();
        let timer = self.timer.clone();
        let views: Vec<_> = of_group.iter().map(|(view, _)| view).collect();
        let background = self.background(gpu, scene, target, (with.variant, &views));
        let bindings = FrameBindings {
            pipelines: with.pipelines.to_vec(),
            environment: scene.environment.as_deref(),
            behind,
            occlusion: with.occlusion.map(|drawn| drawn.binding(of_group)),
        };
        let context = DrawContext {
            shadows: with.shadows.to_vec(),
            ..self.context(gpu, bindings, scene, views, &own)
        };
        timer.begin(encoder);
        if let Some((occluders, hidden)) = hidden_by {
            encode_behind(encoder, occluders, target, hidden);
        }
        encode_scene(encoder, target, ends, &context, background.as_ref());
        timer.end(encoder, FramePass::Scene);
        drop(context);
        lists.extend(own);
        Ok(sort)
    }
}

fn new_encoder(gpu: &Gpu) -> wgpu::CommandEncoder {
    let descriptor = wgpu::CommandEncoderDescriptor { label: Some("frame") };
    gpu.device.create_command_encoder(&descriptor)
}
