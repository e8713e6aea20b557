//! The ambient occlusion of a frame: the depths of all views, then the maps that surfaces read.
//!
//! It is known before anything is shaded. Depths of many views take turns in one texture; the maps,
//! which have only what views show, are together in another.

use std::ops::Range;

use polyptych_scene::FramePass;

use super::begun_frame::ShownView;
use super::draw_context::FrameBindings;
use super::frame_buffer::FrameBuffer;
use super::submission::Submission;
use super::{FrameResources, ListPart, check_records};
use crate::DrawError;
use crate::bindings::uniform_stride;
use crate::draw_list::{DrawList, VisibleItems};
use crate::gpu::Gpu;
use crate::guarded_region::{GuardedRegion, pack};
use crate::pass::ambient_occlusion::{
    AmbientOcclusionPass, OcclusionPlace, OcclusionTextures, OcclusionUniform,
};
use crate::pass::shadow::{CasterPass, Sides};
use crate::region_group::RegionGroup;
use crate::scene::GpuScene;

/// Textures that were not used in so many frames of channels leave their memory.
const KEPT_FRAMES: u32 = 256;

/// What ambient occlusion needs from frame to frame; nothing of it before there is any.
#[derive(Debug)]
pub(super) struct OcclusionMaps {
    pass: Option<AmbientOcclusionPass>,
    textures: Option<OcclusionTextures>,
    uniforms: FrameBuffer,
    unused_frames: u32,
}

/// The map of a frame, and by view the place of its own; `None` for one without any.
#[derive(Debug)]
pub(super) struct DrawnOcclusion {
    map: wgpu::TextureView,
    regions: Vec<Option<GuardedRegion>>,
}

/// The depths of a group of views, on their way.
struct DrawnDepths {
    encoder: wgpu::CommandEncoder,
    /// By index of the view: the texels that may have a depth, if any.
    touched: Vec<(usize, [u32; 4])>,
}

/// The binding of a frame with ambient occlusion.
#[derive(Debug)]
pub(super) struct OcclusionBinding {
    pub map: wgpu::TextureView,
    /// By view.
    pub places: Vec<OcclusionPlace>,
}

impl Default for OcclusionMaps {
    fn default() -> Self {
        let uniforms = FrameBuffer::new("frame/ambient_occlusion", wgpu::BufferUsages::UNIFORM);
        Self { pass: None, textures: None, uniforms, unused_frames: 0 }
    }
}

impl OcclusionMaps {
    /// Returns whether nothing of it was needed yet.
    #[cfg(test)]
    pub fn is_empty(&self) -> bool {
        self.pass.is_none() && self.textures.is_none()
    }

    fn age(&mut self) {
        self.unused_frames += 1;
        if self.unused_frames > KEPT_FRAMES {
            (self.textures, self.unused_frames) = (None, 0);
        }
    }

    /// The binding of one view without ambient occlusion, which pipelines are warmed with.
    pub fn none(&mut self, gpu: &Gpu) -> OcclusionBinding {
        let held = self.textures.take();
        let textures = self.textures.insert(OcclusionTextures::new(gpu, held, [[1, 1]; 2]));
        OcclusionBinding { map: textures.map.clone(), places: vec![OcclusionPlace::default()] }
    }

    /// See [`FrameResources::draw_occlusion`].
    fn draw(
        &mut self,
        frames: &mut FrameResources,
        gpu: &Gpu,
        casters: &CasterPass,
        scene: &GpuScene,
        (shown, covered): (&[ShownView], &[Vec<GuardedRegion>]),
    ) -> Result<Option<DrawnOcclusion>, DrawError> {
        let side_max = gpu.device.limits().max_texture_dimension_2d;
        let planned = shown.iter().zip(covered).map(|((view, visible), pictures)| {
            let rectangle = around(visible.rectangle, pictures);
            view.ambient_occlusion.map(|_| GuardedRegion::of_occlusion(view, rectangle))
        });
        let planned: Vec<_> = planned.collect();
        let depths = planned.iter().map(|of| (of.map(|[_, depths]| depths), Vec::new()));
        let groups = RegionGroup::of_frame(depths, side_max);
        if groups.is_empty() {
            self.age();
            return Ok(None);
        }
        let mut regions: Vec<_> = planned.iter().map(|of| of.map(|[own, _]| own)).collect();
        let map_sides = pack(regions.iter_mut().flatten(), side_max).ok_or_else(|| {
            let reason = format!("its ambient occlusion does not fit into {side_max} texels");
            DrawError::View { index: 0, reason }
        })?;
        let depth_sides = groups.iter().fold([1, 1], |[width, height], group| {
            [width.max(group.sides[0]), height.max(group.sides[1])]
        });
        let held = self.textures.take();
        let textures = OcclusionTextures::new(gpu, held, [depth_sides, map_sides]);
        let textures = &*self.textures.insert(textures);
        self.unused_frames = 0;
        let uniforms = self.uniforms.write(gpu, &uniform_bytes(gpu, (shown, &regions), &groups));
        let pass = self.pass.get_or_insert_with(|| AmbientOcclusionPass::new(gpu));
        let stride = uniform_stride(gpu, size_of::<OcclusionUniform>()) as u32;
        let mut all = Vec::with_capacity(shown.len());
        for group in &groups {
            let of = (shown, group);
            let drawn = frames.draw_depths(gpu, casters, scene, of, textures)?;
            let DrawnDepths { mut encoder, touched } = drawn;
            let found = touched.into_iter().filter_map(|(view, touched)| {
                let (own, depths) = (regions[view]?, group.regions[view - group.views.start]?);
                Some((own.texels_at(&depths, touched)?, view as u32 * stride))
            });
            let (is_first, found) = (all.is_empty(), found.collect::<Vec<_>>());
            pass.encode_search(gpu, &mut encoder, (textures, uniforms), (&found, is_first));
            frames.timer.end(&mut encoder, FramePass::AmbientOcclusion);
            Submission::new(gpu, encoder);
            all.extend(found);
        }
        let descriptor = wgpu::CommandEncoderDescriptor { label: Some("ambient_occlusion") };
        let mut encoder = gpu.device.create_command_encoder(&descriptor);
        frames.timer.begin(&mut encoder);
        pass.encode_smoothed(gpu, &mut encoder, (textures, uniforms), &all);
        frames.timer.end(&mut encoder, FramePass::AmbientOcclusion);
        Submission::new(gpu, encoder);
        Ok(Some(DrawnOcclusion { map: textures.map.clone(), regions }))
    }
}

impl DrawnOcclusion {
    /// The binding of the frame itself.
    pub fn binding(&self, shown: &[ShownView]) -> OcclusionBinding {
        let place = |((view, _), own): (&ShownView, &Option<_>)| {
            own.map_or_else(OcclusionPlace::default, |own| OcclusionPlace::new(view, &own, None))
        };
        let places = shown.iter().zip(&self.regions).map(place).collect();
        OcclusionBinding { map: self.map.clone(), places }
    }

    /// The binding of so many pictures that have none.
    pub fn binding_of_none(&self, pictures: usize) -> OcclusionBinding {
        let places = vec![OcclusionPlace::default(); pictures];
        OcclusionBinding { map: self.map.clone(), places }
    }

    /// Returns that of some of the views.
    pub fn of_views(&self, views: Range<usize>) -> Self {
        Self { map: self.map.clone(), regions: self.regions[views].to_vec() }
    }

    /// Returns that of so many views that have none.
    pub fn of_none(&self, views: usize) -> Self {
        Self { map: self.map.clone(), regions: vec![None; views] }
    }

    /// The binding of pictures of these views; those that are not covered have no ambient
    /// occlusion.
    pub fn binding_of(
        &self,
        shown: &[ShownView],
        pictures: &[Vec<GuardedRegion>],
        is_covered: impl Fn(&GuardedRegion) -> bool,
    ) -> OcclusionBinding {
        let is_covered = &is_covered;
        let of_views = shown.iter().zip(&self.regions).zip(pictures);
        let places = of_views.flat_map(|(((view, _), own), pictures)| {
            pictures.iter().map(move |of| match own {
                Some(own) if is_covered(of) => OcclusionPlace::new(view, own, Some(of)),
                _ => OcclusionPlace::default(),
            })
        });
        OcclusionBinding { map: self.map.clone(), places: places.collect() }
    }
}

/// The rectangle of the canvas around what a view shows and its pictures.
fn around(rectangle: [u32; 4], pictures: &[GuardedRegion]) -> [i64; 4] {
    let pictures = pictures.iter().map(GuardedRegion::rectangle);
    pictures.fold(rectangle.map(i64::from), |a, b| {
        let corner = [0, 1].map(|at| a[at].min(b[at]));
        let side = [0, 1].map(|at| (a[at] + a[at + 2]).max(b[at] + b[at + 2]) - corner[at]);
        [corner[0], corner[1], side[0], side[1]]
    })
}

impl FrameResources {
    /// Draws the maps of all views that have ambient occlusion, for what they show and for these
    /// pictures of them; `None` if no view has any.
    ///
    /// # Errors
    /// More is shown than is held for one frame, or the GPU failed.
    pub(super) fn draw_occlusion(
        &mut self,
        gpu: &Gpu,
        casters: &CasterPass,
        scene: &GpuScene,
        of: (&[ShownView], &[Vec<GuardedRegion>]),
    ) -> Result<Option<DrawnOcclusion>, DrawError> {
        let mut maps = std::mem::take(&mut self.occlusion);
        let drawn = maps.draw(self, gpu, casters, scene, of);
        self.occlusion = maps;
        drawn
    }

    /// Draws the depths of a group of views.
    fn draw_depths(
        &mut self,
        gpu: &Gpu,
        casters: &CasterPass,
        scene: &GpuScene,
        (shown, group): (&[ShownView], &RegionGroup),
        textures: &OcclusionTextures,
    ) -> Result<DrawnDepths, DrawError> {
        let of_group = group.views.clone().zip(&group.regions);
        let views = of_group.filter_map(|(index, of)| Some((index, of.as_ref()?)));
        let views: Vec<_> = views.map(|(index, of)| (index, of.view(&shown[index].0))).collect();
        self.clear_lists();
        let mut lists = Vec::with_capacity(views.len());
        for (index, view) in &views {
            let Some(rectangle) = view.rectangle(group.sides) else {
                lists.push(DrawList { rectangle: [0, 0, 1, 1], ..DrawList::default() });
                continue;
            };
            let mut visible = VisibleItems::new(scene, view, rectangle);
            visible.items.retain(|&item| {
                let key = &scene.layout.keys[scene.batch_of(item).pipeline as usize];
                CasterPass::draws(key, Sides::Shown)
            });
            let (scratch, records) = (&mut self.scratch, &mut self.records);
            lists.push(DrawList::new(scene, view, (&visible, &visible.items), scratch, records));
            check_records(gpu, records.len())
                .map_err(|reason| DrawError::View { index: *index, reason })?;
        }
        let timer = self.timer.clone();
        let pipelines = casters.pipelines(&scene.layout.keys, Sides::Shown);
        let bindings = FrameBindings { pipelines, ..FrameBindings::default() };
        let touched =
            views.iter().zip(&lists).filter_map(|((view, _), list)| Some((*view, list.touched?)));
        let touched = touched.collect();
        let views = views.iter().map(|(_, view)| view).collect();
        let context = self.context(gpu, bindings, scene, views, &lists);
        let descriptor = wgpu::CommandEncoderDescriptor { label: Some("ambient_occlusion") };
        let mut encoder = gpu.device.create_command_encoder(&descriptor);
        timer.begin(&mut encoder);
        let mut pass = textures.begin_depths(&mut encoder);
        for view in 0..lists.len() {
            context.draw(&mut pass, view, ListPart::Opaque);
        }
        drop(pass);
        Ok(DrawnDepths { encoder, touched })
    }
}

/// The uniforms of all views, each at an offset.
fn uniform_bytes(
    gpu: &Gpu,
    (shown, own): (&[ShownView], &[Option<GuardedRegion>]),
    groups: &[RegionGroup],
) -> Vec<u8> {
    let stride = uniform_stride(gpu, size_of::<OcclusionUniform>());
    let mut bytes = vec![0; stride * shown.len().max(1)];
    for (index, depths) in groups.iter().flat_map(|of| of.views.clone().zip(&of.regions)) {
        if let (Some(depths), Some(own)) = (depths, &own[index]) {
            let uniform = OcclusionUniform::new(&shown[index].0, [own, depths]);
            let at = index * stride;
            bytes[at..at + size_of_val(&uniform)].copy_from_slice(bytemuck::bytes_of(&uniform));
        }
    }
    bytes
}
