//! The pictures whose light spreads, and the frame that it glows over.

use polyptych_scene::{FramePass, GLOW_OCTAVES, Glow, ToneMapper};

use super::FrameResources;
use super::begun_frame::ShownView;
use super::behind::{BehindPictures, DrawnWith, PicturesOf, glass_region};
use super::frame_buffer::FrameBuffer;
use super::submission::Submission;
use crate::DrawError;
use crate::bindings::uniform_stride;
use crate::gpu::Gpu;
use crate::guarded_region::{GuardedRegion, LEVELS};
use crate::pass::glow::{GlowPass, GlowUniform, SpreadPart};
use crate::region_group::{GlassRegion, RegionGroup};
use crate::scene::GpuScene;
use crate::target::Target;
use crate::view::ViewDesc;

/// What glow needs from frame to frame; nothing of it before there is any.
#[derive(Debug)]
pub(super) struct GlowPictures {
    pass: Option<GlowPass>,
    pictures: BehindPictures,
    uniforms: FrameBuffer,
}

impl Default for GlowPictures {
    fn default() -> Self {
        let uniforms = FrameBuffer::new("frame/glow", wgpu::BufferUsages::UNIFORM);
        Self { pass: None, pictures: BehindPictures::default(), uniforms }
    }
}

/// The light that spread, and for each view the rectangle that it shows and its uniform.
#[derive(Debug)]
pub(super) struct SpreadLight {
    picture: wgpu::TextureView,
    views: Vec<([u32; 4], GlowUniform)>,
}

/// The region of each view that glows.
fn regions(scene: &GpuScene, shown: &[ShownView]) -> impl Iterator<Item = GlassRegion> {
    shown.iter().map(move |(view, visible)| {
        let glows = view.glow.is_some() && !view.is_parallel();
        let region = glows.then(|| GuardedRegion::of_glow(view, visible.rectangle));
        glass_region(scene, view, region)
    })
}

/// The glow of a frame whose first group is drawn.
#[derive(Debug)]
pub(super) struct BegunGlow {
    groups: Vec<RegionGroup>,
    /// `None` if no view glows.
    pub first: Option<SpreadLight>,
}

impl FrameResources {
    /// Draws the light that spreads over the first group of views. Others share its texture, and
    /// come after the frame: see [`Self::finish_glow`].
    ///
    /// # Errors
    /// More is shown than is held for one frame, or the GPU failed.
    pub(super) fn begin_glow(
        &mut self,
        gpu: &Gpu,
        with: &DrawnWith<'_>,
        of: (&GpuScene, &Target),
        shown: &[ShownView],
    ) -> Result<BegunGlow, DrawError> {
        let side_max = gpu.device.limits().max_texture_dimension_2d;
        let groups = RegionGroup::of_frame(regions(of.0, shown), side_max);
        let first = groups.first().map(|group| self.draw_glow(gpu, with, of, shown, group));
        if first.is_none() {
            self.glow.pictures.age();
        }
        Ok(BegunGlow { first: first.transpose()?, groups })
    }

    /// Draws the light that spreads over all groups but the first, and maps their views to the
    /// display target. Returns the last work for the GPU, if there was any.
    ///
    /// # Errors
    /// More is shown than is held for one frame, or the GPU failed.
    pub(super) fn finish_glow(
        &mut self,
        gpu: &Gpu,
        with: &DrawnWith<'_>,
        (scene, target): (&GpuScene, &Target),
        shown: &[ShownView],
        (tone, begun): (ToneMapper, &BegunGlow),
    ) -> Result<Option<Submission>, DrawError> {
        let mut last = None;
        for group in begun.groups.iter().skip(1) {
            let spread = self.draw_glow(gpu, with, (scene, target), shown, group)?;
            let descriptor = wgpu::CommandEncoderDescriptor { label: Some("glow") };
            let mut encoder = gpu.device.create_command_encoder(&descriptor);
            self.encode_glow(gpu, &mut encoder, (target, None, tone), &spread);
            last = Some(Submission::new(gpu, encoder));
        }
        Ok(last)
    }

    /// Draws the light that spreads over a group of views.
    fn draw_glow(
        &mut self,
        gpu: &Gpu,
        with: &DrawnWith<'_>,
        (scene, target): (&GpuScene, &Target),
        shown: &[ShownView],
        group: &RegionGroup,
    ) -> Result<SpreadLight, DrawError> {
        let (shown, sides) = (&shown[group.views.clone()], group.sides);
        let texture = self.glow.pictures.texture(gpu, (sides, target.samples()));
        let regions: Vec<_> = group.regions.iter().map(|of| Vec::from_iter(*of)).collect();
        let shadows = with.shadows.get(group.views.clone()).unwrap_or_default();
        let with = DrawnWith { shadows, ..*with };
        let behind = self.draw_behind_pictures(gpu, &with, (scene, target), (shown, group))?;
        let occlusion = with.occlusion.map(|drawn| drawn.binding_of_none(shown.len()));
        let of = PicturesOf { shown, regions: &regions, occlusion, behind };
        let onto = (&texture.target, sides);
        let mut encoder = self.draw_pictures(gpu, &with, (scene, target), of, onto, |_| true)?;
        let timer = self.timer.clone();
        let GlowPictures { pass, pictures, .. } = &mut self.glow;
        let pass = pass.get_or_insert_with(|| GlowPass::new(gpu));
        pass.encode_light(&mut encoder, &texture, sides);
        let seen = shown.iter().zip(&group.regions);
        let parts: Vec<_> = seen.clone().filter_map(|(of, region)| part(&of.0, *region)).collect();
        let size = texture.size();
        let views = seen.map(|(of, region)| (of.1.rectangle, uniform(&of.0, *region, size)));
        let views = views.collect();
        let picture = pictures.finish(gpu, encoder, texture, sides, |encoder, texture| {
            pass.encode_spread(encoder, texture, &parts);
            timer.end(encoder, FramePass::Glow);
        });
        Ok(SpreadLight { picture, views })
    }

    /// Maps views and the light that spread to the display target; where there is a sky, all of it
    /// is filled with that first.
    pub(super) fn encode_glow(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        onto: (&Target, Option<wgpu::Color>, ToneMapper),
        spread: &SpreadLight,
    ) {
        let timer = self.timer.clone();
        timer.begin(encoder);
        let GlowPictures { pass, uniforms, .. } = &mut self.glow;
        let stride = uniform_stride(gpu, size_of::<GlowUniform>());
        let mut bytes = vec![0; stride * spread.views.len().max(1)];
        for (slot, (_, uniform)) in bytes.chunks_exact_mut(stride).zip(&spread.views) {
            slot[..size_of::<GlowUniform>()].copy_from_slice(bytemuck::bytes_of(uniform));
        }
        let offsets = (0u32..).map(|index| index * stride as u32);
        let rectangles = spread.views.iter().map(|(rectangle, _)| *rectangle);
        let views: Vec<_> = rectangles.zip(offsets).collect();
        let with = (&spread.picture, uniforms.write(gpu, &bytes));
        if let Some(pass) = pass {
            pass.encode_onto(gpu, encoder, onto, with, &views);
        }
        timer.end(encoder, FramePass::ToneMapping);
    }
}

/// The part of the picture that a view glows with.
fn part(view: &ViewDesc, region: Option<GuardedRegion>) -> Option<SpreadPart> {
    let (glow, region) = (view.glow?, region?);
    let [[x, y], [width, height]] = [region.place, region.size];
    let stays = stays(glow, region.texel_rad(view));
    Some(SpreadPart { rectangle: [x, y, width, height], stays })
}

/// The uniform of a view; one without glow has a strength of 0.
fn uniform(view: &ViewDesc, region: Option<GuardedRegion>, size: [u32; 2]) -> GlowUniform {
    let size = size.map(|side| side as f32);
    let (Some(glow), Some(region)) = (&view.glow, region) else {
        return GlowUniform { size, ..GlowUniform::default() };
    };
    GlowUniform {
        corner: region.corner.map(|at| at as f32),
        place: region.place.map(|at| at as f32),
        size,
        texels_per_pixel: 1.0 / (1u32 << region.scale) as f32,
        strength: glow.strength,
    }
}

/// Returns by level the share of it that stays where the next wider level is laid over it.
///
/// A level spreads light over about the width of its texels, 2^level of the finest. It takes the
/// octave up from there, as far as it is among those of the glow; what is narrower than the finest
/// level goes to that, and what is wider than the widest to that one.
fn stays(glow: Glow, texel_rad: f64) -> [f64; LEVELS as usize + 1] {
    let widest = (f64::from(glow.width_degrees).to_radians() / texel_rad).log2();
    let narrowest = widest - GLOW_OCTAVES;
    let mut stays = [1.0; LEVELS as usize + 1];
    // The share of all light that this level and those below it spread.
    let mut below = 0.0;
    for (level, stays) in (0..LEVELS).zip(&mut stays) {
        let end = (f64::from(level) + 1.0).clamp(narrowest, widest);
        let share = (end - narrowest) / GLOW_OCTAVES - below;
        let left = 1.0 - below;
        *stays = if left > 1e-9 { share / left } else { 1.0 };
        below += share;
    }
    stays
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The share of light that each level spreads.
    fn shares(stays: [f64; LEVELS as usize + 1]) -> Vec<f64> {
        let mut left = 1.0;
        let share = |stays: f64| {
            let share = left * stays;
            left -= share;
            share
        };
        stays.into_iter().map(share).collect()
    }

    #[test]
    fn all_octaves_spread_as_much_light_and_none_is_lost() {
        // The widest is 32 texels, of level 5: the five octaves begin with a texel.
        let glow = Glow { strength: 0.5, width_degrees: 3.2 };
        let found = shares(stays(glow, 0.1_f64.to_radians()));
        for (share, wanted) in found.iter().zip([0.2, 0.2, 0.2, 0.2, 0.2, 0.0, 0.0]) {
            assert!((share - wanted).abs() < 1e-6, "{found:?}");
        }
        for (width_degrees, texel_deg) in [(0.1, 0.2), (7.0, 0.01), (7.0, 0.12), (1.0, 0.1)] {
            let glow = Glow { strength: 0.5, width_degrees };
            let found = shares(stays(glow, f64::to_radians(texel_deg)));
            assert!((found.iter().sum::<f64>() - 1.0).abs() < 1e-9, "{found:?}");
            assert!(found.iter().all(|share| *share >= 0.0), "{found:?}");
        }
    }
}
