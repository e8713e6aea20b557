//! Pictures of what is behind surfaces that transmit light, drawn before the frame that shows them.
//!
//! Those of many views take turns in one texture: a group of views is drawn after its pictures.

use std::ops::Range;

use polyptych_scene::FramePass;

use super::ambient_occlusion::{DrawnOcclusion, OcclusionBinding};
use super::begun_frame::ShownView;
use super::draw_context::FrameBindings;
use super::submission::Submission;
use super::{DrawContext, FrameResources, check_records, sky};
use crate::DrawError;
use crate::bindings::uniform_stride;
use crate::draw_list::{DrawList, VisibleItems, touched};
use crate::gpu::Gpu;
use crate::guarded_region::{BehindUniform, GuardedRegion, has_room_behind, pack_behind};
use crate::pass::behind::{BehindPass, BehindTexture};
use crate::pass::tonemap::light_color;
use crate::pass::{opaque, transparent};
use crate::picture_target::PictureTarget;
use crate::pipeline::{PipelineKey, PipelineVariant};
use crate::region_group::GlassRegion;
use crate::scene::GpuScene;
use crate::target::Target;
use crate::view::ViewDesc;

/// A texture that was not used in so many frames of channels leaves its memory.
const KEPT_FRAMES: u32 = 256;

/// The texture of the frames, and the pass that makes it; nothing of it before it is needed.
#[derive(Debug, Default)]
pub(super) struct BehindPictures {
    pass: Option<BehindPass>,
    texture: Option<BehindTexture>,
    unused_frames: u32,
}

/// The bindings of a frame that shows what transmits light.
#[derive(Debug)]
pub(super) struct BehindBinding {
    pub view: wgpu::TextureView,
    /// By view.
    pub uniforms: Vec<BehindUniform>,
}

impl BehindBinding {
    /// Returns the uniforms of all views as bytes, and the step from one view to the next.
    pub fn uniform_bytes(&self, gpu: &Gpu) -> (Vec<u8>, usize) {
        let stride = uniform_stride(gpu, size_of::<BehindUniform>());
        let mut bytes = vec![0; stride * self.uniforms.len().max(1)];
        for (slot, uniform) in bytes.chunks_exact_mut(stride).zip(&self.uniforms) {
            slot[..size_of::<BehindUniform>()].copy_from_slice(bytemuck::bytes_of(uniform));
        }
        (bytes, stride)
    }
}

/// Views of a frame, one after the other, whose pictures have room in one texture.
#[derive(Debug)]
pub(super) struct GlassGroup {
    pub views: Range<usize>,
    /// By view.
    pub regions: Vec<Vec<GuardedRegion>>,
}

/// The means of drawing that the frame itself has, too.
pub(super) struct DrawnWith<'a> {
    pub pipelines: &'a [Option<&'a wgpu::RenderPipeline>],
    pub variant: PipelineVariant,
    /// The bindings of each view; empty where no light casts shadows.
    pub shadows: &'a [wgpu::BindGroup],
    /// `None` without any.
    pub occlusion: Option<&'a DrawnOcclusion>,
}

/// The pictures of all views, and the ambient occlusion of each.
pub(super) struct PicturesOf<'a> {
    pub shown: &'a [ShownView],
    /// By view.
    pub regions: &'a [Vec<GuardedRegion>],
    pub occlusion: Option<OcclusionBinding>,
    /// The pictures behind glass in each of them; `None` where they show no glass.
    pub behind: Option<BehindBinding>,
}

impl FrameResources {
    /// Draws what is behind the surfaces of these views that transmit light; `None` if there are
    /// none.
    ///
    /// # Errors
    /// More is shown than is held for one frame, or the GPU failed.
    pub(super) fn draw_behind(
        &mut self,
        gpu: &Gpu,
        with: &DrawnWith<'_>,
        scene: &GpuScene,
        target: &Target,
        (shown, mut regions): (&[ShownView], Vec<Vec<GuardedRegion>>),
    ) -> Result<Option<BehindBinding>, DrawError> {
        if regions.iter().all(Vec::is_empty) {
            self.behind.age();
            return Ok(None);
        }
        let side_max = gpu.device.limits().max_texture_dimension_2d;
        let sides = packed(&mut regions, side_max).ok_or_else(|| DrawError::View {
            index: 0,
            reason: format!("what is behind its glass does not fit into {side_max} pixels"),
        })?;
        let texture = self.behind.texture(gpu, (sides, target.samples()));
        let onto = (&texture.target, sides);
        let is_opaque = |item| !scene.batch_of(item).blended;
        let occlusion = with.occlusion.map(|drawn| drawn.binding_of(shown, &regions, is_covered));
        let of = PicturesOf { shown, regions: &regions, occlusion, behind: None };
        let encoder = self.draw_pictures(gpu, with, (scene, target), of, onto, is_opaque)?;
        let timer = self.timer.clone();
        let view = self.behind.finish(gpu, encoder, texture, sides, |encoder, _| {
            timer.end(encoder, FramePass::Glass);
        });
        let uniform = |(of, regions): (&ShownView, &Vec<_>)| BehindUniform::new(&of.0, regions);
        let uniforms = shown.iter().zip(&regions).map(uniform).collect();
        Ok(Some(BehindBinding { view, uniforms }))
    }

    /// Draws the pictures of all views, with those items of the scene that are to be in them.
    /// Returns the commands, of which a pass is begun for the timer.
    ///
    /// # Errors
    /// More is shown than is held for one frame, or the GPU failed.
    pub(super) fn draw_pictures(
        &mut self,
        gpu: &Gpu,
        with: &DrawnWith<'_>,
        (scene, target): (&GpuScene, &Target),
        of: PicturesOf<'_>,
        (onto, sides): (&PictureTarget, [u32; 2]),
        is_drawn: impl Fn(u32) -> bool,
    ) -> Result<wgpu::CommandEncoder, DrawError> {
        let PicturesOf { shown, regions, occlusion, behind } = of;
        let (mut views, mut shadows) = (Vec::new(), Vec::new());
        for (index, (of, regions)) in shown.iter().zip(regions).enumerate() {
            views.extend(regions.iter().map(|region| region.view(&of.0)));
            let group = with.shadows.get(index);
            shadows.extend(regions.iter().filter_map(|_| group.cloned()));
        }
        let timer = self.timer.clone();
        let views: Vec<&ViewDesc> = views.iter().collect();
        let lists = self.lists_of_pictures(gpu, scene, &views, sides, is_drawn)?;
        let background = self.background(gpu, scene, target, (with.variant, &views));
        let bindings = FrameBindings {
            pipelines: with.pipelines.to_vec(),
            environment: scene.environment.as_deref(),
            behind,
            occlusion,
        };
        let context = DrawContext { shadows, ..self.context(gpu, bindings, scene, views, &lists) };
        let descriptor = wgpu::CommandEncoderDescriptor { label: Some("behind") };
        let mut encoder = gpu.device.create_command_encoder(&descriptor);
        let exposure = shown.first().map_or(1.0, |(view, _)| view.exposure);
        timer.begin(&mut encoder);
        let mut pass = onto.begin(&mut encoder, light_color(sky(scene, exposure)));
        opaque::encode(&mut pass, &context);
        if let Some(background) = &background {
            background.encode(&mut pass, &context);
        }
        transparent::encode(&mut pass, &context);
        drop(pass);
        Ok(encoder)
    }

    fn lists_of_pictures(
        &mut self,
        gpu: &Gpu,
        scene: &GpuScene,
        views: &[&ViewDesc],
        sides: [u32; 2],
        is_drawn: impl Fn(u32) -> bool,
    ) -> Result<Vec<DrawList>, DrawError> {
        self.clear_lists();
        let mut lists = Vec::with_capacity(views.len());
        for (index, view) in views.iter().enumerate() {
            let Some(rectangle) = view.rectangle(sides) else {
                lists.push(DrawList { rectangle: [0, 0, 1, 1], ..DrawList::default() });
                continue;
            };
            let mut visible = VisibleItems::new(scene, view, rectangle);
            visible.items.retain(|&item| is_drawn(item));
            let (scratch, records) = (&mut self.scratch, &mut self.records);
            lists.push(DrawList::new(scene, view, (&visible, &visible.items), scratch, records));
            check_records(gpu, records.len())
                .map_err(|reason| DrawError::View { index, reason })?;
        }
        Ok(lists)
    }

    /// The bindings that pipelines are warmed with; `None` for a scene that transmits no light.
    pub(super) fn behind_nothing(&mut self, gpu: &Gpu, scene: &GpuScene) -> Option<BehindBinding> {
        let is_used = scene.layout.keys.iter().any(PipelineKey::transmits);
        is_used.then(|| {
            let view = self.behind.any_view(gpu);
            BehindBinding { view, uniforms: vec![BehindUniform::default()] }
        })
    }
}

/// Returns the pictures that each view needs.
pub(super) fn planned(scene: &GpuScene, shown: &[ShownView]) -> Vec<Vec<GuardedRegion>> {
    if !scene.layout.keys.iter().any(PipelineKey::transmits) {
        return vec![Vec::new(); shown.len()];
    }
    let of_view = |(view, visible): &ShownView| {
        let transmits = |item: &u32| {
            let batch = scene.batch_of(*item);
            scene.layout.keys[batch.pipeline as usize].transmits()
        };
        let items: Vec<u32> = visible.items.iter().copied().filter(transmits).collect();
        let touched = touched(scene, view, visible.rectangle, &items);
        touched.map_or_else(Vec::new, |rectangle| GuardedRegion::of_view(view, rectangle))
    };
    shown.iter().map(of_view).collect()
}

/// The region of a view that glows or is blurred, with what may be behind glass in its picture.
pub(super) fn glass_region(
    scene: &GpuScene,
    view: &ViewDesc,
    region: Option<GuardedRegion>,
) -> GlassRegion {
    let transmits = scene.layout.keys.iter().any(PipelineKey::transmits);
    let seen = region.filter(|_| transmits);
    (region, seen.map_or_else(Vec::new, |of| of.pictures_behind(view)))
}

/// Divides the views of a frame into groups whose pictures have room in a texture that a group may
/// have, with sides up to `side_max`. All views are in one group where none has a picture.
pub(super) fn groups(regions: Vec<Vec<GuardedRegion>>, side_max: u32) -> Vec<GlassGroup> {
    let begun_at = |view: usize| GlassGroup { views: view..view, regions: Vec::new() };
    let mut groups = vec![begun_at(0)];
    for (view, of_view) in regions.into_iter().enumerate() {
        if !groups.last().is_some_and(|group| group.has_room(&of_view, side_max)) {
            groups.push(begun_at(view));
        }
        if let Some(group) = groups.last_mut() {
            group.regions.push(of_view);
            group.views.end += 1;
        }
    }
    groups
}

impl GlassGroup {
    /// Returns whether it can take the next view: one without a picture, or with the first, always.
    fn has_room(&self, of_view: &[GuardedRegion], side_max: u32) -> bool {
        let mut all: Vec<GuardedRegion> = self.regions.iter().flatten().copied().collect();
        if all.is_empty() || of_view.is_empty() {
            return true;
        }
        all.extend_from_slice(of_view);
        has_room_behind(&all, side_max)
    }
}

/// Returns whether a picture of what is behind glass has ambient occlusion: wide ones, of which a
/// texel is some pixels, have none.
pub(super) fn is_covered(picture: &GuardedRegion) -> bool {
    picture.scale == 0
}

/// Places all pictures, or only the wide ones if there is no room for the sharp ones: a frame that
/// is less sharp behind glass is better than none.
fn packed(regions: &mut [Vec<GuardedRegion>], side_max: u32) -> Option<[u32; 2]> {
    pack_behind(regions.iter_mut().flatten().collect(), side_max).or_else(|| {
        for of_view in &mut *regions {
            of_view.drain(..of_view.len().saturating_sub(1));
        }
        pack_behind(regions.iter_mut().flatten().collect(), side_max)
    })
}

impl BehindPictures {
    /// Returns whether nothing of it was needed yet.
    #[cfg(test)]
    pub fn is_empty(&self) -> bool {
        self.pass.is_none() && self.texture.is_none()
    }

    /// Texels of the texture.
    #[cfg(test)]
    pub fn texels(&self) -> u64 {
        let size = self.texture.as_ref().map_or([0, 0], BehindTexture::size);
        u64::from(size[0]) * u64::from(size[1])
    }

    pub fn age(&mut self) {
        self.unused_frames += 1;
        if self.unused_frames > KEPT_FRAMES {
            (self.texture, self.unused_frames) = (None, 0);
        }
    }

    /// Takes the texture out; [`Self::finish`] puts it back.
    pub fn texture(&mut self, gpu: &Gpu, sides: ([u32; 2], u32)) -> BehindTexture {
        let pass = self.pass.get_or_insert_with(|| BehindPass::new(gpu));
        pass.texture(gpu, self.texture.take(), sides)
    }

    /// A view for pipelines that show nothing of it: of the texture that is there, if one is.
    fn any_view(&mut self, gpu: &Gpu) -> wgpu::TextureView {
        let held = self.texture.take().unwrap_or_else(|| self.texture(gpu, ([1, 1], 1)));
        self.texture.insert(held).all.clone()
    }

    /// Halves the levels, encodes what comes then, and submits all of it.
    pub fn finish(
        &mut self,
        gpu: &Gpu,
        mut encoder: wgpu::CommandEncoder,
        texture: BehindTexture,
        used: [u32; 2],
        then: impl FnOnce(&mut wgpu::CommandEncoder, &BehindTexture),
    ) -> wgpu::TextureView {
        if let Some(pass) = &self.pass {
            pass.encode_levels(&mut encoder, &texture, used);
        }
        then(&mut encoder, &texture);
        // The queue draws it before the frame that is submitted next.
        Submission::new(gpu, encoder);
        self.unused_frames = 0;
        self.texture.insert(texture).all.clone()
    }
}
