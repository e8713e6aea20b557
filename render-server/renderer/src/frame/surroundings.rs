//! The surroundings of a frame's scene.

use super::FrameResources;
use crate::gpu::Gpu;
use crate::pass::background::{BackgroundDraw, BackgroundPass};
use crate::pipeline::PipelineVariant;
use crate::scene::GpuScene;
use crate::target::Target;
use crate::view::ViewDesc;

impl FrameResources {
    /// The pass that draws the surroundings, if the scene has any of its own or lies in fog.
    pub(super) fn background(
        &mut self,
        gpu: &Gpu,
        scene: &GpuScene,
        target: &Target,
        (variant, views): (PipelineVariant, &[&ViewDesc]),
    ) -> Option<BackgroundDraw> {
        if scene.environment.is_none() && !variant.fog {
            return None;
        }
        let pass = self.background.get_or_insert_with(|| BackgroundPass::new(gpu));
        Some(pass.prepare(gpu, target, variant, views))
    }
}
