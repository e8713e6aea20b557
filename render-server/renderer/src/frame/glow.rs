//! The picture whose light spreads, drawn before the frame that it glows over.

use polyptych_scene::{GLOW_OCTAVES, Glow, ToneMapper};

use super::FrameResources;
use super::begun_frame::ShownView;
use super::behind::{BehindPictures, DrawnWith};
use super::frame_buffer::FrameBuffer;
use crate::DrawError;
use crate::behind_region::{BehindRegion, LEVELS, pack};
use crate::bindings::uniform_stride;
use crate::gpu::Gpu;
use crate::pass::glow::{GlowPass, GlowUniform, SpreadPart};
use crate::scene::GpuScene;
use crate::target::Target;
use crate::view::ViewDesc;

/// Maximum number of texels of all pictures of a frame: 500 MB with four samples each. A channel of
/// 4K has 1.6 million, and each further view at least 0.3 million.
const TEXELS_MAX: u64 = 8 << 20;

/// What glow needs from frame to frame; nothing of it before there is any.
#[derive(Debug)]
pub(super) struct GlowPictures {
    pass: Option<GlowPass>,
    pictures: BehindPictures,
    uniforms: FrameBuffer,
    /// The views of the last frame were too many to glow.
    is_too_large: bool,
}

impl Default for GlowPictures {
    fn default() -> Self {
        let uniforms = FrameBuffer::new("frame/glow", wgpu::BufferUsages::UNIFORM);
        Self { pass: None, pictures: BehindPictures::default(), uniforms, is_too_large: false }
    }
}

/// The light that spread, and for each view the rectangle that it shows and its uniform.
#[derive(Debug)]
pub(super) struct SpreadLight {
    picture: wgpu::TextureView,
    views: Vec<([u32; 4], GlowUniform)>,
}

impl GlowPictures {
    /// Returns the sides of a frame's picture, and logs once that there is no room for one: a
    /// channel without glow is better than none.
    fn room(&mut self, sides: Option<[u32; 2]>) -> Option<[u32; 2]> {
        let was_too_large = std::mem::replace(&mut self.is_too_large, sides.is_none());
        if sides.is_none() && !was_too_large {
            tracing::warn!("too many views to glow: they are shown without; show fewer views");
        }
        sides
    }
}

impl FrameResources {
    /// Draws the light that spreads over all views with glow; `None` if there are none, or more
    /// than [`TEXELS_MAX`] hold.
    ///
    /// # Errors
    /// More is shown than is held for one frame, or the GPU failed.
    pub(super) fn draw_glow(
        &mut self,
        gpu: &Gpu,
        with: &DrawnWith<'_>,
        (scene, target): (&GpuScene, &Target),
        shown: &[ShownView],
    ) -> Result<Option<SpreadLight>, DrawError> {
        let region = |(view, visible): &ShownView| {
            let glows = view.glow.is_some() && !view.is_parallel();
            Vec::from_iter(glows.then(|| BehindRegion::of_glow(view, visible.rectangle)))
        };
        let mut regions: Vec<Vec<BehindRegion>> = shown.iter().map(region).collect();
        if regions.iter().all(Vec::is_empty) {
            self.glow.pictures.age();
            return Ok(None);
        }
        let side_max = gpu.device.limits().max_texture_dimension_2d;
        let texels =
            regions.iter().flatten().map(|of| u64::from(of.size[0]) * u64::from(of.size[1]));
        let is_small = texels.sum::<u64>() <= TEXELS_MAX;
        let sides = pack(regions.iter_mut().flatten(), side_max).filter(|_| is_small);
        let Some(sides) = self.glow.room(sides) else { return Ok(None) };
        let texture = self.glow.pictures.texture(gpu, (sides, target.samples()));
        // What is behind glass needs pictures of its own, which this one is drawn without.
        let is_drawn = |item| {
            let batch = scene.batch_of(item);
            !scene.layout.keys[batch.pipeline as usize].transmits()
        };
        let (of, onto) = ((shown, &*regions), (&texture, sides));
        let mut encoder = self.draw_pictures(gpu, with, (scene, target), of, onto, is_drawn)?;
        let GlowPictures { pass, pictures, .. } = &mut self.glow;
        let pass = pass.get_or_insert_with(|| GlowPass::new(gpu));
        pass.encode_light(&mut encoder, &texture, sides);
        let seen = shown.iter().zip(&regions);
        let parts: Vec<_> = seen.clone().filter_map(|(of, region)| part(&of.0, region)).collect();
        let size = texture.size();
        let views = seen.map(|(of, region)| (of.1.rectangle, uniform(&of.0, region, size)));
        let views = views.collect();
        let picture = pictures.finish(gpu, encoder, texture, sides, |encoder, texture| {
            pass.encode_spread(encoder, texture, &parts);
        });
        Ok(Some(SpreadLight { picture, views }))
    }

    /// Fills the display target with the sky, and with the views and the light that spread.
    pub(super) fn encode_glow(
        &mut self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        onto: (&Target, wgpu::Color, ToneMapper),
        spread: &SpreadLight,
    ) {
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
    }
}

/// The part of the picture that a view glows with.
fn part(view: &ViewDesc, region: &[BehindRegion]) -> Option<SpreadPart> {
    let (glow, region) = (view.glow?, region.first()?);
    let [[x, y], [width, height]] = [region.place, region.size];
    let stays = stays(glow, region.texel_rad(view));
    Some(SpreadPart { rectangle: [x, y, width, height], stays })
}

/// The uniform of a view; one without glow has a strength of 0.
fn uniform(view: &ViewDesc, region: &[BehindRegion], size: [u32; 2]) -> GlowUniform {
    let size = size.map(|side| side as f32);
    let (Some(glow), Some(region)) = (&view.glow, region.first()) else {
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
