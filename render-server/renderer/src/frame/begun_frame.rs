//! A frame on its way: begun, then submitted, then finished.

use std::time::{Duration, Instant};

use glam::Vec3;
use polyptych_scene::{Fog, ToneMapper};

use super::hidden_items::OccluderDepths;
use super::submission::Submission;
use crate::DrawStats;
use crate::draw_list::VisibleItems;
use crate::output_texture::ImageEncoding;
use crate::pipeline::PipelineVariant;
use crate::scene::GpuScene;
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
    /// The search for what is hidden; `None` if there is none.
    pub(super) depths: Option<OccluderDepths>,
    /// Time that it took to find the items.
    pub(super) cull: Duration,
    /// Time that it took to encode the search.
    pub(super) search: Duration,
    /// It is drawn to be metered.
    pub(super) is_light: bool,
}

impl BegunFrame {
    /// Returns this frame as light before tone mapping, 0 where nothing is drawn.
    pub(crate) fn of_light(self) -> Self {
        Self { sky: Vec3::ZERO, is_light: true, ..self }
    }

    /// Fog that its views look through.
    pub(crate) fn fog(&self) -> Option<Fog> {
        self.fog
    }

    /// The pipelines that it needs for a scene, onto pictures of this content.
    pub(crate) fn variant(&self, scene: &GpuScene, content: ImageEncoding) -> PipelineVariant {
        PipelineVariant {
            content,
            tone: self.tone,
            environment: scene.environment.is_some(),
            fog: self.fog.is_some(),
            is_light: self.is_light,
        }
    }
}

/// A frame that the GPU draws; [`crate::Renderer::finish`] is next.
#[derive(Debug)]
#[must_use = "the picture is not there yet"]
pub struct SubmittedFrame {
    pub(super) submission: Submission,
    /// All but the GPU's time.
    pub(super) stats: DrawStats,
    pub(super) items: usize,
    pub(super) is_culling: bool,
    /// Time that it took to begin the frame.
    pub(super) begin: Duration,
    /// The instant from which on it was encoded.
    pub(super) start: Instant,
}
