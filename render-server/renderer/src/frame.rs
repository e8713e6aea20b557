//! One frame: cull, write, encode the passes in order, submit, wait.
//!
//! The frames of several targets share the buffers of [`FrameResources`], and all of them are
//! submitted before the first one is waited for. No write meets a frame that still reads: the queue
//! does writes and submissions in the order in which they were given to it, so that what is written
//! for one target comes after the frame of the target before; and a buffer that is replaced by a
//! larger one lives until the last frame that reads it is done.

mod ambient_occlusion;
mod begun_frame;
mod behind;
mod depth_of_field;
mod draw_args;
mod draw_context;
mod frame_buffer;
mod frame_content;
mod glow;
mod hidden_items;
mod lamp_shadows;
mod map_set;
mod map_sets;
mod pass_timer;
mod scene_pass;
mod shadow_map;
mod shadows;
mod submission;
mod sun_shadows;
mod surroundings;

use std::ops::Range;
use std::time::{Duration, Instant};

use glam::{DMat3, DMat4, DVec3, Vec3};
use polyptych_scene::{SceneSubset, ToneMapper};

use super::draw_list::{DrawList, Scratch, VisibleItems, samples_of};
use super::gpu::Gpu;
use super::guarded_region::GuardedRegion;
use super::occlusion::OcclusionCulling;
use super::pass::background::BackgroundPass;
use super::pass::occluder::OccluderPass;
use super::pass::tonemap::Tonemap;
use super::pipeline::{InstanceRecord, PipelineVariant, Pipelines};
use super::scene::GpuScene;
use super::scene_pipelines::ScenePipelines;
use super::target::Target;
use super::tone::LIGHT_MAX;
use super::view::{AllowedError, ViewDesc};
use super::{DrawError, DrawStats, albedo};
use ambient_occlusion::OcclusionMaps;
use begun_frame::ShownView;
pub use begun_frame::{BegunFrame, SubmittedFrame};
use behind::{BehindPictures, DrawnWith};
use depth_of_field::DiscPictures;
use draw_context::FrameBindings;
pub(crate) use draw_context::{DrawContext, ListPart};
use frame_buffer::{FrameBuffer, is_too_large};
use frame_content::{EncodedFrame, FrameContent};
use glow::GlowPictures;
pub(crate) use hidden_items::OcclusionMemory;
use pass_timer::{FrameTimer, PassTimer};
use scene_pass::{SceneEnds, encode_scene};
use shadows::FrameShadows;
pub(crate) use shadows::Shadows;
pub use submission::Submission;

/// Maximum number of primitives that all views of a frame show: 120 bytes each here, and at most
/// 240 on the GPU. Views multiply a scene: this is twice the largest, or one for two eyes.
const RECORDS_MAX: usize = 4 << 20;

/// Buffers, bind group layouts and passes that are reused from frame to frame.
#[derive(Debug)]
pub(crate) struct FrameResources {
    uniforms: FrameBuffer,
    lamps: FrameBuffer,
    instances: FrameBuffer,
    ordered_indices: FrameBuffer,
    /// Arguments of draws.
    args: FrameBuffer,
    behind_uniforms: FrameBuffer,
    behind: BehindPictures,
    discs: DiscPictures,
    glow: GlowPictures,
    occlusion: OcclusionMaps,
    background: Option<BackgroundPass>,
    /// See [`albedo`].
    albedo: wgpu::TextureView,
    albedo_sampler: wgpu::Sampler,
    tonemap: Tonemap,
    scratch: Scratch,
    records: Vec<InstanceRecord>,
    times: PassTimer,
    /// The timer of the frame that is begun or submitted.
    timer: FrameTimer,
    /// The end of the frame that was finished last.
    done: Option<Instant>,
    /// The next frame is the first of a round: of frames that are submitted before one of them is
    /// finished, as those of a server's channels are.
    begins_round: bool,
}

impl FrameResources {
    pub fn new(gpu: &Gpu) -> Self {
        let vertex = wgpu::BufferUsages::VERTEX;
        Self {
            uniforms: FrameBuffer::new("frame/uniforms", wgpu::BufferUsages::UNIFORM),
            lamps: FrameBuffer::new("frame/lamps", wgpu::BufferUsages::STORAGE),
            instances: FrameBuffer::new("frame/instances", vertex),
            ordered_indices: FrameBuffer::new("frame/ordered_indices", wgpu::BufferUsages::INDEX),
            args: FrameBuffer::new("frame/draw_args", wgpu::BufferUsages::INDIRECT),
            behind_uniforms: FrameBuffer::new("frame/behind", wgpu::BufferUsages::UNIFORM),
            behind: BehindPictures::default(),
            discs: DiscPictures::default(),
            glow: GlowPictures::default(),
            occlusion: OcclusionMaps::default(),
            background: None,
            albedo: albedo::texture(gpu),
            albedo_sampler: albedo::sampler(gpu),
            tonemap: Tonemap::new(gpu),
            scratch: Scratch::default(),
            records: Vec::new(),
            times: PassTimer::default(),
            timer: FrameTimer::default(),
            done: None,
            begins_round: true,
        }
    }

    /// Bytes that are held for the primitives of a frame, here and on the GPU.
    #[cfg(test)]
    pub fn held_bytes(&self) -> u64 {
        self.instances.size() + (self.records.capacity() * size_of::<InstanceRecord>()) as u64
    }

    /// Returns whether there are pictures of what is behind surfaces that transmit light.
    #[cfg(test)]
    pub fn has_behind(&self) -> bool {
        !self.behind.is_empty()
    }

    /// Texels of the pictures behind such surfaces.
    #[cfg(test)]
    pub fn behind_texels(&self) -> u64 {
        self.behind.texels()
    }

    /// Returns whether there are maps of depth of field.
    #[cfg(test)]
    pub fn has_discs(&self) -> bool {
        !self.discs.is_empty()
    }

    /// Returns whether there are maps of ambient occlusion.
    #[cfg(test)]
    pub fn has_occlusion(&self) -> bool {
        !self.occlusion.is_empty()
    }

    /// Begins a frame: finds what its views may show, and submits the search for what others hide
    /// if the pass for it is given and is faster.
    ///
    /// # Errors
    /// More is shown than is held for one frame, or the GPU failed.
    pub fn begin(
        &mut self,
        gpu: &Gpu,
        occluders: Option<(&OccluderPass, OcclusionCulling)>,
        scene: &GpuScene,
        target: &mut Target,
        views: &[ViewDesc],
    ) -> Result<BegunFrame, DrawError> {
        let start = Instant::now();
        let views: Vec<ViewDesc> = views.iter().map(|view| fitted(scene, view)).collect();
        let sky = sky(scene, views.first().map_or(1.0, |view| view.exposure));
        let tone = views.first().map_or_else(ToneMapper::default, |view| view.tone);
        let fog = views.iter().filter(|view| !view.is_parallel()).find_map(|view| view.fog);
        let mut shown = Vec::with_capacity(views.len());
        for view in views {
            let Some(rectangle) = view.rectangle(target.size()) else { continue };
            let view = ViewDesc { tone, ..view };
            let visible = VisibleItems::new(scene, &view, rectangle);
            shown.push((view, visible));
        }
        let cull = start.elapsed();
        self.timer = self.times.begin(gpu);
        let items = shown.iter().map(|(_, visible)| visible.items.len()).sum();
        let is_trial = occluders.is_some_and(|(_, when)| target.occlusion.is_trial(when, items));
        let occluders = occluders.filter(|(_, when)| target.occlusion.is_used(*when, items));
        let depths = match occluders {
            Some((occluders, _)) => self.search_hidden(gpu, occluders, scene, target, &shown)?,
            None => None,
        };
        let is_culling = occluders.is_some();
        let search = start.elapsed().saturating_sub(cull);
        let timer = self.timer.clone();
        Ok(BegunFrame {
            shown,
            sky,
            tone,
            fog,
            items,
            is_culling,
            is_trial,
            depths,
            timer,
            cull,
            search,
        })
    }

    /// Encodes a frame and submits it.
    ///
    /// # Errors
    /// More is shown than is held for one frame, the scene was not prepared, or the GPU failed.
    pub fn submit(
        &mut self,
        gpu: &Gpu,
        (pipelines, occluders, shadows): (&ScenePipelines, Option<&OccluderPass>, &mut Shadows),
        scene: &GpuScene,
        target: &mut Target,
        begun: BegunFrame,
    ) -> Result<SubmittedFrame, DrawError> {
        let start = Instant::now();
        let variant = begun.variant(scene, target);
        let BegunFrame { mut shown, sky, tone, items, is_culling, depths, cull, search, .. } =
            begun;
        self.timer.clone_from(&begun.timer);
        let (timer, is_trial) = (begun.timer, begun.is_trial);
        let hidden = depths.map(|of| of.leave_out_hidden(gpu, scene, target, &mut shown));
        let hidden = hidden.transpose()?;
        let searched = start.elapsed();
        let with = (&mut *self, &pipelines.casters);
        let FrameShadows { groups, drawn } = shadows.draw(with, gpu, scene, &shown)?;
        let found = ready(&pipelines.surfaces, scene, variant)?;
        let pictures = behind::planned(scene, &shown);
        let places = depth_of_field::regions(&shown);
        let covered = covered(&pictures, &places);
        let casters = &pipelines.casters;
        let occlusion = self.draw_occlusion(gpu, casters, scene, (&shown, &covered))?;
        let occlusion = occlusion.as_ref();
        let with = DrawnWith { pipelines: &found, variant, shadows: &groups, occlusion };
        let is_blurred = self.draw_discs(gpu, &with, (scene, target), (&shown, &places))?;
        // Both have pictures behind glass of their own, in the same texture.
        let glow = self.begin_glow(gpu, &with, (scene, target), &shown)?;
        let groups = behind::groups(pictures, gpu.device.limits().max_texture_dimension_2d);
        let hidden_by = occluders.zip(hidden);
        let content = FrameContent { sky, tone, groups, hidden_by, is_blurred, glow: &glow };
        let before = start.elapsed();
        let encoded = self.encode_frame(gpu, &with, (scene, &mut *target), &shown, content)?;
        let EncodedFrame { lists, sort, submission } = encoded;
        let sorted = before + sort;
        let glow = self.finish_glow(gpu, &with, (scene, target), &shown, (tone, &glow))?;
        let submission = glow.unwrap_or(submission);
        let submission = timer.submit(gpu).unwrap_or(submission);
        let encoded = start.elapsed();
        self.shrink();
        let occluded = hidden.map_or(0, |hidden| hidden.count);
        let stats = DrawStats {
            shadow_maps: drawn,
            is_trial,
            occlusion_us: us(search + searched),
            cull_us: us(cull + sorted.saturating_sub(searched)),
            encode_us: us(encoded.saturating_sub(sorted)),
            ..counts(scene, &lists, occluded)
        };
        let begin = cull + search;
        Ok(SubmittedFrame { submission, timer, stats, items, is_culling, begin, start })
    }

    /// Waits until a frame is there. Frames are finished in the order in which they were submitted.
    ///
    /// # Errors
    /// The GPU failed.
    pub fn finish(
        &mut self,
        gpu: &Gpu,
        target: &mut Target,
        frame: SubmittedFrame,
    ) -> Result<DrawStats, DrawError> {
        let SubmittedFrame { submission, timer, mut stats, items, is_culling, begin, start } =
            frame;
        self.begins_round = true;
        let before = self.done;
        stats.gpu_us = us(self.finish_submission(gpu, &submission)?);
        // Several frames are a pipeline: what one of them adds to the time of all is the time from
        // the end of the one before to its own.
        let since = before.map_or(start, |before| before.max(start));
        let done = self.done.unwrap_or(since);
        let frame_us = us(begin + done.saturating_duration_since(since));
        target.occlusion.record(items, frame_us, is_culling);
        stats.passes = self.times.finish(gpu, timer);
        Ok(stats)
    }

    /// Waits for work. Returns the time that the GPU took for it, as far as it is known.
    ///
    /// # Errors
    /// The GPU failed.
    pub fn finish_submission(
        &mut self,
        gpu: &Gpu,
        submission: &Submission,
    ) -> Result<Duration, DrawError> {
        let done = submission.wait(gpu)?;
        // The GPU begins with it when it is submitted, and not before it is done with others.
        let begun = self.done.map_or(submission.at(), |before| before.max(submission.at()));
        self.done = Some(done);
        Ok(done.saturating_duration_since(begun))
    }

    /// Returns when the work that was finished last was done.
    pub fn done(&self) -> Option<Instant> {
        self.done
    }

    /// Sorts what some of the views show, and makes its records.
    fn lists(
        &mut self,
        gpu: &Gpu,
        scene: &GpuScene,
        (shown, views): (&[ShownView], Range<usize>),
    ) -> Result<Vec<DrawList>, DrawError> {
        self.clear_lists();
        let mut lists = Vec::with_capacity(views.len());
        for (index, (view, visible)) in shown.iter().enumerate().take(views.end).skip(views.start) {
            let (scratch, records) = (&mut self.scratch, &mut self.records);
            lists.push(DrawList::new(scene, view, (visible, &visible.items), scratch, records));
            check_records(gpu, records.len())
                .map_err(|reason| DrawError::View { index, reason })?;
        }
        Ok(lists)
    }

    /// Forgets the records and ordered triangles of the lists before.
    fn clear_lists(&mut self) {
        self.records.clear();
        self.scratch.ordered_indices.clear();
    }

    /// Gives back room that the frame did not need.
    fn shrink(&mut self) {
        let records_bytes = |records: usize| (records * size_of::<InstanceRecord>()) as u64;
        let (held, needed) = (self.records.capacity(), self.records.len());
        if is_too_large(records_bytes(held), records_bytes(needed)) {
            self.records = Vec::new();
            self.scratch = Scratch::default();
        }
    }

    /// Draws a little with one of the scene's pipelines, and each of its materials, onto a target
    /// of one pixel, so that the driver compiles now and not in the first frame. Nothing shows: the
    /// one instance has a matrix of zeros.
    pub fn prewarm(
        &mut self,
        gpu: &Gpu,
        (pipelines, shadows): (&Pipelines, &Shadows),
        scene: &GpuScene,
        target: &Target,
        (variant, pipeline): (PipelineVariant, u32),
    ) -> Result<(), DrawError> {
        let tone = ToneMapper::default();
        let view = ViewDesc {
            eye_in_world: DVec3::ZERO,
            middle_eye_in_world: DVec3::ZERO,
            view_from_world: DMat3::IDENTITY,
            clip_from_view: DMat4::IDENTITY,
            viewport: [0.0, 0.0, 1.0, 1.0],
            scissor: None,
            exposure: 1.0,
            tone,
            fog: None,
            glow: None,
            ambient_occlusion: None,
            depth_of_field: None,
            subset: SceneSubset::default(),
            allowed_error: AllowedError::NONE,
            has_shadows: false,
        };
        let opaque = samples_of(scene, pipeline);
        let lists = [DrawList { rectangle: [0, 0, 1, 1], opaque, ..DrawList::default() }];
        self.clear_lists();
        self.records.push(InstanceRecord::default());
        let background = self.background(gpu, scene, target, (variant, &[&view]));
        let bindings = FrameBindings {
            pipelines: ready(pipelines, scene, variant)?,
            environment: scene.environment.as_deref(),
            behind: self.behind_nothing(gpu, scene),
            occlusion: variant.ambient_occlusion.then(|| self.occlusion.none(gpu)),
        };
        let mut context = self.context(gpu, bindings, scene, vec![&view], &lists);
        // A multiple of what points, lines and triangles take.
        (context.index_count_max, context.args) = (6, None);
        context.shadows = shadows.none(gpu, scene);
        let mut encoder = gpu
            .device
            .create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("warm") });
        let ends = SceneEnds::default();
        encode_scene(&mut encoder, target, ends, &context, background.as_ref());
        let black = (wgpu::Color::BLACK, tone);
        self.tonemap.encode(gpu, &mut encoder, target, black, Some([0, 0, 1, 1]));
        Submission::new(gpu, encoder).wait(gpu).map(|_| ())
    }
}

/// The pictures of each view that ambient occlusion covers beside what it shows.
fn covered(
    pictures: &[Vec<GuardedRegion>],
    places: &[depth_of_field::Places],
) -> Vec<Vec<GuardedRegion>> {
    let of_view = |(pictures, places): (&Vec<GuardedRegion>, &depth_of_field::Places)| {
        let sharp = pictures.iter().copied().filter(behind::is_covered);
        sharp.chain(places.map(|[_, picture]| picture)).collect()
    };
    pictures.iter().zip(places).map(of_view).collect()
}

/// What lists draw of a scene, without what is hidden.
fn counts(scene: &GpuScene, lists: &[DrawList], occluded: u32) -> DrawStats {
    let visible: u32 = lists.iter().map(|list| list.visible).sum();
    let draw_calls = lists.iter().map(|list| list.opaque.len() + list.transparent.len());
    DrawStats {
        triangles: lists.iter().map(|list| list.triangles).sum(),
        draw_calls: draw_calls.sum::<usize>() as u32,
        visible,
        error_share: lists.iter().map(|list| list.error_share).fold(0.0, f32::max),
        culled: (scene.layout.items.len() * lists.len()) as u32 - visible - occluded,
        occluded,
        ..DrawStats::default()
    }
}

/// A view with a depth that suits the part of the scene that it shows.
fn fitted(scene: &GpuScene, view: &ViewDesc) -> ViewDesc {
    if !view.is_parallel() {
        return view.clone();
    }
    view.with_fitted_depth(&scene.extent(scene.layout.tree.select(&view.subset)))
}

/// Refuses a frame whose views show more than is held for one.
fn check_records(gpu: &Gpu, records: usize) -> Result<(), String> {
    // The buffer grows to twice what is needed.
    let fit = gpu.device.limits().max_buffer_size as usize / (2 * size_of::<InstanceRecord>());
    let records_max = RECORDS_MAX.min(fit);
    if records <= records_max {
        return Ok(());
    }
    Err(format!(
        "with those before it, it shows {records} primitives, where {records_max} can be shown in \
         a frame; show fewer views of this scene"
    ))
}

/// The scene's pipelines for such a frame.
fn ready<'a>(
    pipelines: &'a Pipelines,
    scene: &GpuScene,
    variant: PipelineVariant,
) -> Result<Vec<Option<&'a wgpu::RenderPipeline>>, DrawError> {
    let found = scene.layout.keys.iter().map(|key| pipelines.get(key, variant));
    let found: Vec<_> = found.collect();
    if found.contains(&None) { Err(DrawError::NotPrepared) } else { Ok(found) }
}

/// Exposed light of the sky, within what the targets hold.
fn sky(scene: &GpuScene, exposure: f32) -> Vec3 {
    (scene.layout.sky * exposure).max(Vec3::ZERO).min(Vec3::splat(LIGHT_MAX))
}

fn around(a: [u32; 4], b: [u32; 4]) -> [u32; 4] {
    let (x, y) = (a[0].min(b[0]), a[1].min(b[1]));
    [x, y, (a[0] + a[2]).max(b[0] + b[2]) - x, (a[1] + a[3]).max(b[1] + b[3]) - y]
}

fn us(duration: Duration) -> u64 {
    duration.as_micros() as u64
}
