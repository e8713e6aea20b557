//! A frame on its way: begun, then submitted, then finished.

use std::time::{Duration, Instant};

use glam::Vec3;
use polyptych_scene::{AmbientOcclusion, Fog, ToneMapper};

use super::hidden_items::OccluderDepths;
use super::pass_timer::FrameTimer;
use super::submission::Submission;
use crate::DrawStats;
use crate::draw_list::VisibleItems;
use crate::pipeline::PipelineVariant;
use crate::scene::GpuScene;
use crate::target::Target;
use crate::view::ViewDesc;

/// A view, with the items that it may show.
pub(super) type ShownView = (ViewDesc, VisibleItems);

/// A frame of which it is known what its views may show; [`crate::Renderer::submit`] is next.
#[derive(Debug)]
#[must_use = "nothing is drawn yet"]
pub struct BegunFrame {
    pub(super) shown: Vec<ShownView>,
    /// Exposed light of the sky.
    pub(super) sky: Vec3,
    /// The way to what is shown.
    pub(super) tone: ToneMapper,
    /// Fog that views look through.
    pub(super) fog: Option<Fog>,
    /// Items that all views may show.
    pub(super) items: usize,
    /// Items that others hide are left out.
    pub(super) is_culling: bool,
    /// For comparison.
    pub(super) is_trial: bool,
    /// The search for what is hidden; `None` if there is none.
    pub(super) depths: Option<OccluderDepths>,
    /// Measures its passes.
    pub(super) timer: FrameTimer,
    /// Time that it took to find the items.
    pub(super) cull: Duration,
    /// Time that it took to encode the search.
    pub(super) search: Duration,
}

impl BegunFrame {
    /// Returns this frame as light before tone mapping, 0 where nothing is drawn.
    pub(crate) fn of_light(mut self) -> Self {
        for (view, _) in &mut self.shown {
            (view.glow, view.ambient_occlusion, view.depth_of_field) = (None, None, None);
        }
        Self { sky: Vec3::ZERO, ..self }
    }

    /// The ambient occlusion of its views.
    pub(crate) fn ambient_occlusion(&self) -> Option<AmbientOcclusion> {
        self.shown.iter().find_map(|(view, _)| view.ambient_occlusion)
    }

    /// The pipelines that it needs for a scene, onto a target.
    pub(crate) fn variant(&self, scene: &GpuScene, target: &Target) -> PipelineVariant {
        PipelineVariant {
            content: target.content(),
            environment: scene.environment.is_some(),
            fog: self.fog.is_some(),
            ambient_occlusion: self.ambient_occlusion().is_some(),
            is_light: target.is_linear(),
        }
    }
}

/// A frame that the GPU draws; [`crate::Renderer::finish`] is next.
#[derive(Debug)]
#[must_use = "the picture is not there yet"]
pub struct SubmittedFrame {
    pub(super) submission: Submission,
    pub(super) timer: FrameTimer,
    /// All but the GPU's time.
    pub(super) stats: DrawStats,
    pub(super) items: usize,
    pub(super) is_culling: bool,
    /// Time that it took to begin the frame.
    pub(super) begin: Duration,
    /// The instant from which on it was encoded.
    pub(super) start: Instant,
}
