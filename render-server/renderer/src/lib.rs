//! Draws a scene onto targets. Knows no wire, no wall and no window.
//!
//! **Invariants.** World positions are f64 until the eye is subtracted. The picture, and the order
//! of what is drawn, is a function of the scene and the view, never of the target or of earlier
//! frames; only what others hide may be drawn or not. Nothing here panics: faults of the GPU come
//! back as errors.
//!
//! Levels of detail: a view allows an error, and each part of a mesh is drawn at the coarsest level
//! whose error is within it, as seen from the point between the viewer's eyes.
//!
//! Light: lux and candela are taken as they are, so that a white matt surface under π lux has the
//! radiance 1, and exposure scales radiance before the tone mapping.

mod albedo;
mod bindings;
mod correction;
mod cull;
mod draw_list;
mod environment;
mod error_tolerance;
mod frame;
mod gpu;
mod gpu_choice;
mod grain_albedo;
mod guarded_region;
mod item_draws;
mod lamp_map;
mod light_meter;
mod many_items;
mod occlusion;
mod occlusion_trial;
mod output_texture;
mod pass;
mod picture_target;
mod pipeline;
mod readback;
mod region_group;
mod scene;
mod scene_pipelines;
mod seen_from;
mod shader;
mod shadow_cascades;
mod shadow_uniform;
mod sheen_albedo;
mod target;
// The harness of tests serves the render server's too, so it names this crate as that one does.
#[cfg(test)]
extern crate self as polyptych_renderer;
#[cfg(test)]
mod tests;
mod text;
mod tone;
mod view;

pub use correction::{AtlasViewDesc, BlendMapDesc, CorrectionDesc, CorrectionError, EyeAtlas};
pub use environment::Environment;
pub use frame::{BegunFrame, Submission, SubmittedFrame};
pub use gpu::{Gpu, GpuError, GpuFault, GpuFaultKind};
pub use gpu_choice::AdapterInfo;
pub use occlusion::OcclusionCulling;
pub use output_texture::{FINE_FORMAT, ImageEncoding, OutputTexture};
pub use pass::correct::{Correction, CorrectionMesh, TAPS_MAX};
pub use pass::enlarge::Enlargement;
pub use pass::idle;
pub use pass::label::{Label, LabelPosition};
pub use pass::present_pass::{PresentPass, letterbox};
pub use pass::tonemap::SkyError;
pub use readback::{ReadError, read_picture, read_pixels};
pub use scene::{
    ContentPlace, GpuScene, MovedItems, MovedNode, SceneBuilder, SceneError, SceneLayout,
};
pub use scene_pipelines::{PipelineNeeds, ScenePipelines};
pub use target::{Target, TargetError};
pub use text::rasterize;
pub use view::{AllowedError, ViewDesc};

use std::num::NonZeroU32;
use std::time::{Duration, Instant};

use pass::shadow::Sides;
use polyptych_scene::{LightEffects, PassTimes};
use polyptych_wall::ShadowFilter;

/// Why a frame was not drawn.
#[derive(Debug, thiserror::Error)]
pub enum DrawError {
    /// [`Renderer::prepare`] has not seen this scene.
    #[error("the scene's pipelines have not been prepared")]
    NotPrepared,
    /// The target was made for other samples, or for a scene that blends where this does not.
    #[error("the target was not made for this renderer and scene")]
    Target,
    /// A view cannot be drawn.
    #[error("view {index}: {reason}")]
    View {
        /// The index of the view among those of the call.
        index: usize,
        /// The fault of the view.
        reason: String,
    },
    /// The sky's colour could not be found.
    #[error(transparent)]
    Sky(#[from] SkyError),
    /// The device is lost, hangs, or is out of memory.
    #[error("the GPU failed: {0}")]
    Gpu(String),
}

/// Counts and times of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DrawStats {
    /// The triangles of all visible items.
    pub triangles: u64,
    /// Encoded.
    pub draw_calls: u32,
    /// Primitives in their places that passed culling, over all views.
    pub visible: u32,
    /// Primitives in their places that did not, or that are too small for the allowed error.
    pub culled: u32,
    /// Primitives in their places that others hide, and that were left out for it.
    pub occluded: u32,
    /// Maps of shadows that were drawn anew; others are those of frames before.
    pub shadow_maps: u32,
    /// The largest error of what was drawn coarser than it is or left out as too small, as a share
    /// of what is allowed where it stands: 0 to 1, and 0 if all is at its finest. More than 1 where
    /// finer levels are not held; in pixels if nothing is allowed.
    pub error_share: f32,
    /// Microseconds to find what others hide, with the wait for the depth of these.
    pub occlusion_us: u64,
    /// Microseconds to cull and sort.
    pub cull_us: u64,
    /// Microseconds to write buffers, encode and submit.
    pub encode_us: u64,
    /// Microseconds from there until the GPU was done.
    pub gpu_us: u64,
    /// The frame was drawn in the way that was slower before, for comparison.
    pub is_trial: bool,
    /// How long the GPU took for each pass: one frame in eight tells, where the adapter can.
    pub passes: PassTimes,
}

impl DrawStats {
    /// Those of both, one after the other.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            triangles: self.triangles + other.triangles,
            draw_calls: self.draw_calls + other.draw_calls,
            visible: self.visible + other.visible,
            culled: self.culled + other.culled,
            occluded: self.occluded + other.occluded,
            shadow_maps: self.shadow_maps + other.shadow_maps,
            error_share: self.error_share.max(other.error_share),
            occlusion_us: self.occlusion_us + other.occlusion_us,
            cull_us: self.cull_us + other.cull_us,
            encode_us: self.encode_us + other.encode_us,
            gpu_us: self.gpu_us + other.gpu_us,
            is_trial: self.is_trial || other.is_trial,
            passes: self.passes.and(other.passes),
        }
    }
}

/// Draws scenes with a fixed number of samples per pixel.
#[derive(Debug)]
pub struct Renderer {
    samples: u32,
    is_gl: bool,
    pipelines: ScenePipelines,
    frames: frame::FrameResources,
    shadows: frame::Shadows,
    enlarge: pass::enlarge::EnlargePass,
    reduce: pass::reduce::ReducePass,
    occlusion: OcclusionCulling,
}

impl Renderer {
    /// A renderer with 1 or 4 samples per pixel.
    ///
    /// # Errors
    /// Other numbers of samples.
    pub fn new(gpu: &Gpu, samples: u32) -> Result<Self, TargetError> {
        if samples != 1 && samples != 4 {
            return Err(TargetError::Samples(samples));
        }
        Ok(Self {
            samples,
            is_gl: gpu.is_gl(),
            pipelines: ScenePipelines::new(gpu, samples),
            frames: frame::FrameResources::new(gpu),
            shadows: frame::Shadows::new(gpu),
            enlarge: pass::enlarge::EnlargePass::new(gpu),
            reduce: pass::reduce::ReducePass::new(gpu),
            occlusion: OcclusionCulling::default(),
        })
    }

    /// Sets when items that others hide are left out; no picture depends on it.
    pub fn set_occlusion(&mut self, occlusion: OcclusionCulling) {
        self.occlusion = occlusion;
    }

    /// Sets what edges shadows have; by GL contact hardening counts as soft. Scenes are to be
    /// prepared with it before they are drawn.
    pub fn set_shadows(&mut self, shadows: ShadowFilter) {
        let is_soft = self.is_gl && shadows == ShadowFilter::ContactHardening;
        let shadows = if is_soft { ShadowFilter::Soft } else { shadows };
        self.pipelines.surfaces.shadows = shadows;
        self.shadows.set_filter(shadows);
    }

    /// Samples per pixel.
    pub fn samples(&self) -> u32 {
        self.samples
    }

    /// The pipelines that it has.
    pub fn pipelines(&self) -> &ScenePipelines {
        &self.pipelines
    }

    /// Takes pipelines that a copy of [`Self::pipelines`] has beside its own.
    pub fn add_pipelines(&mut self, pipelines: ScenePipelines) {
        self.pipelines.add(pipelines);
    }

    /// Makes the pipelines that the scene needs and that are not there yet, and has the driver
    /// compile them: up to a second with a software driver, which the first frame is spared.
    ///
    /// A fault of the GPU shows in [`Gpu::take_error`] and in the next [`Self::draw`].
    pub fn prepare(&mut self, gpu: &Gpu, scene: &GpuScene) {
        self.prepare_for(gpu, scene, ImageEncoding::Srgb);
    }

    /// Prepares as [`Self::prepare`] does, for targets of this content.
    pub fn prepare_for(&mut self, gpu: &Gpu, scene: &GpuScene, content: ImageEncoding) {
        let needs = PipelineNeeds::new(scene, content, LightEffects::default());
        self.prepare_with(gpu, scene, &needs);
    }

    /// Prepares as [`Self::prepare`] does, for these needs of the scene; nothing if they are met.
    pub fn prepare_with(&mut self, gpu: &Gpu, scene: &GpuScene, needs: &PipelineNeeds) {
        self.shadows.prepare(gpu, scene);
        if self.pipelines.meet(needs) {
            return;
        }
        self.pipelines.complete(gpu, needs);
        let mut step = 0;
        while self.warm(gpu, scene, needs, step) {
            step += 1;
        }
    }

    /// Draws a little, unseen, with one of the scene's pipelines, whose number is `step`: some
    /// drivers compile one where it is used first. Returns whether there is a next step.
    pub fn warm(
        &mut self,
        gpu: &Gpu,
        scene: &GpuScene,
        needs: &PipelineNeeds,
        step: usize,
    ) -> bool {
        self.shadows.prepare(gpu, scene);
        let with = (&self.pipelines.surfaces, &self.shadows);
        let of = (needs.variant(), step as u32);
        let (is_light, content) = (needs.is_light(), needs.content);
        let warmed = Target::with_encoding(gpu, [1, 1], self.samples, is_light, content)
            .map_err(|error| error.to_string())
            .and_then(|target| {
                let warmed = self.frames.prewarm(gpu, with, scene, &target, of);
                warmed.map_err(|error| error.to_string())
            });
        if let Err(reason) = &warmed {
            tracing::warn!(reason, "the pipelines could not be warmed");
        }
        warmed.is_ok() && step + 1 < scene.layout.keys.len()
    }

    /// Draws views of the scene into the target and waits until the picture is there. Pixels
    /// outside of all views show the sky, exposed as in the first view. Views should not overlap:
    /// they share one depth.
    ///
    /// # Errors
    /// The scene was not prepared, target or view do not fit, or the GPU failed.
    pub fn draw(
        &mut self,
        gpu: &Gpu,
        scene: &GpuScene,
        target: &mut Target,
        views: &[ViewDesc],
    ) -> Result<DrawStats, DrawError> {
        let begun = self.begin(gpu, scene, target, views)?;
        let submitted = self.submit(gpu, scene, target, begun)?;
        self.finish(gpu, target, submitted)
    }

    /// Begins what [`Self::draw`] does. Of several targets all frames are begun, then submitted,
    /// then finished, each time in the same order: the GPU draws one while the next is culled.
    ///
    /// # Errors
    /// Target or view do not fit, or the GPU failed.
    pub fn begin(
        &mut self,
        gpu: &Gpu,
        scene: &GpuScene,
        target: &mut Target,
        views: &[ViewDesc],
    ) -> Result<BegunFrame, DrawError> {
        let needs_light = views.iter().any(|view| scene.needs_light(view.effects()));
        let lacks_light = (needs_light || scene.has_transparency()) && !target.is_linear();
        if target.samples() != self.samples || lacks_light {
            return Err(DrawError::Target);
        }
        let side_max = gpu.device.limits().max_texture_dimension_2d;
        for (index, view) in views.iter().enumerate() {
            if let Some(reason) = view.fault(side_max) {
                return Err(DrawError::View { index, reason });
            }
        }
        let occluders = &self.pipelines.occluders;
        let occluders = occluders.as_ref().map(|occluders| (occluders, self.occlusion));
        self.frames.begin(gpu, occluders, scene, target, views)
    }

    /// Submits a frame that was begun on this target.
    ///
    /// # Errors
    /// The scene was not prepared, a view shows too much, or the GPU failed.
    pub fn submit(
        &mut self,
        gpu: &Gpu,
        scene: &GpuScene,
        target: &mut Target,
        begun: BegunFrame,
    ) -> Result<SubmittedFrame, DrawError> {
        let variant = begun.variant(scene, target);
        let keys = &scene.layout.keys;
        self.pipelines.surfaces.prepare_look(gpu, keys, variant);
        if variant.ambient_occlusion {
            self.pipelines.casters.prepare(gpu, keys, Sides::Shown);
        }
        let with = (&self.pipelines, self.pipelines.occluders.as_ref(), &mut self.shadows);
        self.frames.submit(gpu, with, scene, target, begun)
    }

    /// Waits until the picture of a frame that was submitted for this target is there.
    ///
    /// # Errors
    /// The GPU failed.
    pub fn finish(
        &mut self,
        gpu: &Gpu,
        target: &mut Target,
        submitted: SubmittedFrame,
    ) -> Result<DrawStats, DrawError> {
        self.frames.finish(gpu, target, submitted)
    }

    /// A picture of this content and size in pixels for [`Self::enlarge`].
    ///
    /// # Errors
    /// A side of 0 or beyond the adapter.
    pub fn picture(
        &self,
        gpu: &Gpu,
        size: [u32; 2],
        content: ImageEncoding,
    ) -> Result<OutputTexture, TargetError> {
        let [width, height] = size;
        let side_max = gpu.device.limits().max_texture_dimension_2d;
        if size.iter().any(|side| !(1..=side_max).contains(side)) {
            return Err(TargetError::Size { width, height, side_max });
        }
        Ok(OutputTexture::new(gpu, size, content))
    }

    /// Submits the enlargement of a target that was drawn with fewer pixels, onto a picture of the
    /// same content, after the target's frame.
    ///
    /// # Errors
    /// The picture has another content.
    pub fn enlarge(
        &mut self,
        gpu: &Gpu,
        target: &Target,
        place: Enlargement,
        onto: &OutputTexture,
    ) -> Result<Submission, DrawError> {
        if target.content() != onto.content() {
            return Err(DrawError::Target);
        }
        Ok(self.enlarge.submit(gpu, target, place, onto))
    }

    /// Submits the reduction of a picture: each pixel of the result has the mean light of a square,
    /// `side` pixels along each side, or less at the right and lower edge.
    pub fn reduce(
        &mut self,
        gpu: &Gpu,
        picture: &OutputTexture,
        side: NonZeroU32,
    ) -> OutputTexture {
        self.reduce.submit(gpu, picture, side)
    }

    /// Waits for other work that comes after a frame. Returns the GPU's time for it.
    ///
    /// # Errors
    /// The GPU failed.
    pub fn finish_submission(
        &mut self,
        gpu: &Gpu,
        submission: &Submission,
    ) -> Result<Duration, DrawError> {
        self.frames.finish_submission(gpu, submission)
    }

    /// Returns when the work that was finished last was done, as far as was noticed.
    pub fn done(&self) -> Option<Instant> {
        self.frames.done()
    }
}
