//! The pipelines that scenes are drawn with.

use std::sync::Arc;

use polyptych_scene::LightEffects;

use super::gpu::Gpu;
use super::output_texture::ImageEncoding;
use super::pass::occluder::OccluderPass;
use super::pass::shadow::{CasterPass, Sides};
use super::pipeline::{PipelineVariant, Pipelines};
use super::scene::{GpuScene, SceneLayout};

/// What a scene is drawn onto, and how: what its pipelines are made for.
#[derive(Clone, Debug)]
pub struct PipelineNeeds {
    layout: Arc<SceneLayout>,
    has_environment: bool,
    pub(crate) content: ImageEncoding,
    pub(crate) effects: LightEffects,
    /// Its light is metered.
    is_metered: bool,
}

impl PipelineNeeds {
    /// The needs of a scene that is drawn onto targets of this content, with these effects.
    pub fn new(scene: &GpuScene, content: ImageEncoding, effects: LightEffects) -> Self {
        let has_environment = scene.environment.is_some();
        let (layout, is_metered) = (Arc::clone(&scene.layout), false);
        Self { layout, has_environment, content, effects, is_metered }
    }

    /// The needs of a scene whose light is metered ([`Renderer::luminances`](super::Renderer)),
    /// where frames have these effects.
    pub fn metering(scene: &GpuScene, effects: LightEffects) -> Self {
        // What lies over the light of surfaces is left out, as in `BegunFrame::of_light`.
        let effects = LightEffects { fog: effects.fog, ..LightEffects::NONE };
        Self { is_metered: true, ..Self::new(scene, ImageEncoding::Srgb, effects) }
    }

    /// Returns whether it is drawn onto targets that hold light.
    pub(crate) fn is_light(&self) -> bool {
        self.layout.blends || self.effects.mixes_light() || self.is_metered
    }

    pub(crate) fn variant(&self) -> PipelineVariant {
        let LightEffects { fog, ambient_occlusion, .. } = self.effects;
        let (content, environment) = (self.content, self.has_environment);
        PipelineVariant { content, environment, fog, ambient_occlusion, is_light: self.is_light() }
    }

    fn sides(&self) -> impl Iterator<Item = Sides> {
        let depths = self.effects.ambient_occlusion.then_some(Sides::Shown);
        self.layout.lights.has_shadows().then_some(Sides::Both).into_iter().chain(depths)
    }
}

/// Pipelines of a renderer. A copy of them can be completed on another thread while frames are
/// drawn: a driver takes tens of milliseconds to compile one.
#[derive(Clone, Debug)]
pub struct ScenePipelines {
    pub(crate) surfaces: Pipelines,
    pub(crate) casters: CasterPass,
    /// `None` where the driver cannot.
    pub(crate) occluders: Option<OccluderPass>,
}

impl ScenePipelines {
    pub(crate) fn new(gpu: &Gpu, samples: u32) -> Self {
        Self {
            surfaces: Pipelines::new(gpu, samples),
            casters: CasterPass::new(gpu),
            occluders: OccluderPass::new(gpu, samples),
        }
    }

    /// Returns whether nothing is missing.
    pub fn meet(&self, needs: &PipelineNeeds) -> bool {
        let keys = &needs.layout.keys;
        self.surfaces.has(keys, needs.variant())
            && needs.sides().all(|sides| self.casters.has(keys, sides))
            && self.occluders.as_ref().is_none_or(|occluders| occluders.has(keys))
    }

    /// Makes what is missing.
    pub fn complete(&mut self, gpu: &Gpu, needs: &PipelineNeeds) {
        let keys = &needs.layout.keys;
        self.surfaces.prepare(gpu, keys, needs.variant());
        for sides in needs.sides() {
            self.casters.prepare(gpu, keys, sides);
        }
        if let Some(occluders) = &mut self.occluders {
            occluders.prepare(gpu, keys);
        }
    }

    /// Takes what another copy has beside this one.
    pub fn add(&mut self, other: Self) {
        let Self { surfaces, casters, occluders } = other;
        self.surfaces.add(surfaces);
        self.casters.add(casters);
        if let (Some(own), Some(others)) = (&mut self.occluders, occluders) {
            own.add(others);
        }
    }
}
