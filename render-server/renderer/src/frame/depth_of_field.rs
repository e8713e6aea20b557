//! The depth of field of a frame: pictures of all views with a guard band, the maps of what their
//! discs cover, then the pixels of the frame with that.
//!
//! Pictures of many views take turns in one texture; the maps, which have only what views show,
//! are together in another.

use polyptych_scene::FramePass;

use super::FrameResources;
use super::begun_frame::ShownView;
use super::behind::{BehindBinding, DrawnWith, PicturesOf, glass_region, planned};
use super::frame_buffer::FrameBuffer;
use super::submission::Submission;
use crate::DrawError;
use crate::bindings::uniform_stride;
use crate::draw_list::VisibleItems;
use crate::gpu::Gpu;
use crate::guarded_region::{GuardedRegion, pack};
use crate::pass::depth_of_field::{DepthOfFieldPass, DiscLayers, DiscMaps, LensUniform};
use crate::pipeline::PipelineKey;
use crate::region_group::RegionGroup;
use crate::scene::GpuScene;
use crate::target::Target;

/// Textures that were not used in so many frames of channels leave their memory.
const KEPT_FRAMES: u32 = 256;

/// The pass and textures that are kept from frame to frame; none before they are needed.
#[derive(Debug)]
pub(super) struct DiscPictures {
    pass: Option<DepthOfFieldPass>,
    layers: Option<DiscLayers>,
    maps: Option<DiscMaps>,
    uniforms: FrameBuffer,
    unused_frames: u32,
}

impl Default for DiscPictures {
    fn default() -> Self {
        let uniforms = FrameBuffer::new("frame/depth_of_field", wgpu::BufferUsages::UNIFORM);
        Self { pass: None, layers: None, maps: None, uniforms, unused_frames: 0 }
    }
}

/// The places of a view's map and of its picture; `None` for one without depth of field.
pub(super) type Places = Option<[GuardedRegion; 2]>;

/// Returns the places of each view, which nobody has packed yet.
pub(super) fn regions(shown: &[ShownView]) -> Vec<Places> {
    let region = |(view, visible): &ShownView| {
        let is_blurred = view.depth_of_field.is_some() && !view.is_parallel();
        is_blurred.then(|| GuardedRegion::of_focus(view, visible.rectangle))
    };
    shown.iter().map(region).collect()
}

impl DiscPictures {
    /// Returns whether nothing of it was needed yet.
    #[cfg(test)]
    pub fn is_empty(&self) -> bool {
        self.pass.is_none() && self.layers.is_none()
    }

    fn age(&mut self) {
        self.unused_frames += 1;
        if self.unused_frames > KEPT_FRAMES {
            (self.layers, self.maps, self.unused_frames) = (None, None, 0);
        }
    }

    /// See [`FrameResources::draw_discs`].
    fn draw(
        &mut self,
        frames: &mut FrameResources,
        gpu: &Gpu,
        with: &DrawnWith<'_>,
        (scene, target): (&GpuScene, &Target),
        (shown, regions): (&[ShownView], &[Places]),
    ) -> Result<bool, DrawError> {
        let side_max = gpu.device.limits().max_texture_dimension_2d;
        let pictures = shown.iter().zip(regions).map(|((view, _), of)| {
            let picture = of.map(|[_, picture]| picture);
            glass_region(scene, view, picture)
        });
        let groups = RegionGroup::of_frame(pictures, side_max);
        if groups.is_empty() {
            self.age();
            return Ok(false);
        }
        let mut own: Vec<_> = regions.iter().map(|of| of.map(|[own, _]| own)).collect();
        let map_sides = pack(own.iter_mut().flatten(), side_max).ok_or_else(|| {
            let reason = format!("its depth of field does not fit into {side_max} texels");
            DrawError::View { index: 0, reason }
        })?;
        self.unused_frames = 0;
        let samples = target.samples();
        let pass = self.pass.take().filter(|pass| pass.samples() == samples);
        let pass = &*self.pass.insert(pass.unwrap_or_else(|| DepthOfFieldPass::new(gpu, samples)));
        let held = self.maps.take();
        let maps = &*self.maps.insert(DiscMaps::new(gpu, held, map_sides));
        let uniforms = self.uniforms.write(gpu, &uniform_bytes(gpu, (shown, &own), &groups));
        let stride = uniform_stride(gpu, size_of::<LensUniform>()) as u32;
        for (index, group) in groups.iter().enumerate() {
            let held = self.layers.take();
            let layers = &*self.layers.insert(DiscLayers::new(gpu, held, group.sides, samples));
            let mut encoder =
                frames.draw_sharp(gpu, with, (scene, target), (shown, group), layers)?;
            let of_group = || group.views.clone().zip(&group.regions);
            let pictures = of_group().filter_map(|(view, of)| {
                let [[x, y], [width, height]] = of.map(|of| [of.place, of.size])?;
                Some(([x, y, width, height], view as u32 * stride))
            });
            let gathered = of_group().filter_map(|(view, _)| {
                let [[x, y], [width, height]] = own[view].map(|of| [of.place, of.size])?;
                Some(([x, y, width, height], view as u32 * stride))
            });
            let (pictures, gathered): (Vec<_>, Vec<_>) = (pictures.collect(), gathered.collect());
            let parts = [&pictures[..], &gathered];
            pass.encode_maps(gpu, &mut encoder, (layers, maps, uniforms), parts, index == 0);
            frames.timer.end(&mut encoder, FramePass::DepthOfField);
            Submission::new(gpu, encoder);
        }
        Ok(true)
    }
}

impl FrameResources {
    /// Draws the maps of all views that have depth of field; `false` if no view has any.
    ///
    /// # Errors
    /// More is shown than is held for one frame, or the GPU failed.
    pub(super) fn draw_discs(
        &mut self,
        gpu: &Gpu,
        with: &DrawnWith<'_>,
        of: (&GpuScene, &Target),
        shown: (&[ShownView], &[Places]),
    ) -> Result<bool, DrawError> {
        let mut discs = std::mem::take(&mut self.discs);
        let drawn = discs.draw(self, gpu, with, of, shown);
        self.discs = discs;
        drawn
    }

    /// Lays the discs over the light of a frame, which other passes read from then on.
    pub(super) fn encode_discs(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        (target, sky): (&mut Target, wgpu::Color),
        shown: &[ShownView],
    ) {
        let (Some(pass), Some(maps)) = (&self.discs.pass, &self.discs.maps) else { return };
        let Some([light, depth, onto]) = target.begin_focus(gpu) else { return };
        let stride = uniform_stride(gpu, size_of::<LensUniform>()) as u32;
        let offsets = (0u32..).map(|index| index * stride);
        let rectangles = shown.iter().map(|(_, visible)| visible.rectangle);
        let views: Vec<_> = rectangles.zip(offsets).collect();
        if let Some(uniforms) = self.discs.uniforms.buffer() {
            let onto = ([light, depth], onto, sky);
            self.timer.begin(encoder);
            pass.encode_onto(gpu, encoder, (maps, uniforms), onto, &views);
            self.timer.end(encoder, FramePass::DepthOfField);
        }
    }

    /// Draws the pictures of a group of views, sharp and with all that the frame shows.
    fn draw_sharp(
        &mut self,
        gpu: &Gpu,
        with: &DrawnWith<'_>,
        (scene, target): (&GpuScene, &Target),
        (shown, group): (&[ShownView], &RegionGroup),
        layers: &DiscLayers,
    ) -> Result<wgpu::CommandEncoder, DrawError> {
        let shown = &shown[group.views.clone()];
        let occlusion = with.occlusion.map(|of| of.of_views(group.views.clone()));
        let shadows = with.shadows.get(group.views.clone()).unwrap_or_default();
        let with = DrawnWith { shadows, occlusion: occlusion.as_ref(), ..*with };
        let behind = self.draw_behind_pictures(gpu, &with, (scene, target), (shown, group))?;
        let regions: Vec<_> = group.regions.iter().map(|of| Vec::from_iter(*of)).collect();
        let occlusion = with.occlusion.map(|of| of.binding_of(shown, &regions, |_| true));
        let of = PicturesOf { shown, regions: &regions, occlusion, behind };
        let onto = (&layers.target, group.sides);
        self.draw_pictures(gpu, &with, (scene, target), of, onto, |_| true)
    }

    /// Draws what is behind the glass of these pictures; `None` for a scene without any.
    pub(super) fn draw_behind_pictures(
        &mut self,
        gpu: &Gpu,
        with: &DrawnWith<'_>,
        (scene, target): (&GpuScene, &Target),
        (shown, group): (&[ShownView], &RegionGroup),
    ) -> Result<Option<BehindBinding>, DrawError> {
        if !scene.layout.keys.iter().any(PipelineKey::transmits) {
            return Ok(None);
        }
        let (mut seen, mut shadows) = (Vec::new(), Vec::new());
        for (index, ((view, _), region)) in shown.iter().zip(&group.regions).enumerate() {
            let Some(region) = region else { continue };
            let view = region.view(view);
            let rectangle = view.rectangle(group.sides).unwrap_or([0, 0, 1, 1]);
            let visible = VisibleItems::new(scene, &view, rectangle);
            seen.push((view, visible));
            shadows.extend(with.shadows.get(index).cloned());
        }
        let occlusion = with.occlusion.map(|of| of.of_none(seen.len()));
        let with = DrawnWith { shadows: &shadows, occlusion: occlusion.as_ref(), ..*with };
        let pictures = planned(scene, &seen);
        let behind = self.draw_behind(gpu, &with, scene, target, (&seen, pictures))?;
        // Pipelines of glass that none of the pictures shows still have their binding.
        Ok(behind.or_else(|| self.behind_nothing(gpu, scene)))
    }
}

/// The uniforms of all views, each at an offset.
fn uniform_bytes(
    gpu: &Gpu,
    (shown, own): (&[ShownView], &[Option<GuardedRegion>]),
    groups: &[RegionGroup],
) -> Vec<u8> {
    let stride = uniform_stride(gpu, size_of::<LensUniform>());
    let mut bytes = vec![0; stride * shown.len().max(1)];
    for (index, picture) in groups.iter().flat_map(|of| of.views.clone().zip(&of.regions)) {
        if let (Some(picture), Some(own)) = (picture, &own[index]) {
            let uniform = LensUniform::new(&shown[index].0, [own, picture]);
            let at = index * stride;
            bytes[at..at + size_of_val(&uniform)].copy_from_slice(bytemuck::bytes_of(&uniform));
        }
    }
    bytes
}
