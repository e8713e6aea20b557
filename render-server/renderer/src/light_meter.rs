//! The light of a picture: what is shown, before exposure and tone mapping.

use super::gpu::Gpu;
use super::output_texture::ImageEncoding;
use super::readback::read_texture;
use super::scene::GpuScene;
use super::target::Target;
use super::tone::f16_from_bits;
use super::view::ViewDesc;
use super::{DrawError, Renderer};

/// Luminance of linear RGB (ITU-R BT.709).
const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// Alpha of a pixel that shows nothing unlit, up to the rounding of samples and blending.
const WHOLE: f64 = 0.999;

/// Bytes of a pixel of a float target: four half floats.
const PIXEL_BYTES: usize = 8;

impl Renderer {
    /// Draws views of the scene into a picture of this size in pixels and returns the luminance of
    /// each of its pixels that shows light of the scene, in the scene's units: where nothing is
    /// drawn, or unlit surfaces, there is none. Light of more than 16 stops above the white of the
    /// first view's exposure counts as that. Pipelines that are missing for it are made first: see
    /// [`super::PipelineNeeds::metering`].
    ///
    /// # Errors
    /// Those of [`Self::draw`].
    pub fn luminances(
        &mut self,
        gpu: &Gpu,
        scene: &GpuScene,
        size: [u32; 2],
        views: &[ViewDesc],
    ) -> Result<Vec<f32>, DrawError> {
        let content = ImageEncoding::Srgb;
        let mut target = Target::with_encoding(gpu, size, self.samples, true, content)
            .map_err(|error| DrawError::View { index: 0, reason: error.to_string() })?;
        let begun = self.frames.begin(gpu, None, scene, &mut target, views)?.of_light();
        let variant = begun.variant(scene, &target);
        self.pipelines.surfaces.prepare(gpu, &scene.layout.keys, variant);
        let with = (&self.pipelines, None, &mut self.shadows);
        let submitted = self.frames.submit(gpu, with, scene, &mut target, begun)?;
        self.frames.finish(gpu, &mut target, submitted)?;
        let Some(light) = target.linear() else { return Err(DrawError::Target) };
        let bytes = read_texture(gpu, light.texture())
            .map_err(|error| DrawError::Gpu(error.to_string()))?;
        let exposure = views.first().map_or(1.0, |view| f64::from(view.exposure));
        let pixels = bytes.chunks_exact(PIXEL_BYTES).filter_map(|pixel| {
            let half =
                |i: usize| f16_from_bits(u16::from_le_bytes([pixel[2 * i], pixel[2 * i + 1]]));
            let light: f64 = (0..3).map(|i| LUMINANCE[i] * half(i)).sum();
            // Alpha is the part that is the scene's light: the colours of unlit surfaces have no
            // unit.
            (half(3) >= WHOLE && light > 0.0).then_some((light / exposure) as f32)
        });
        Ok(pixels.filter(|light| light.is_finite()).collect())
    }
}
