//! The light of pixels, as displays have it.

use super::harness::gpu;
use crate::output_texture::ImageEncoding;
use crate::readback::read_pixels;
use crate::target::Target;
use crate::tone::f16_from_bits;
use crate::{GpuScene, Renderer, ViewDesc};

/// The green light of each pixel of a view's canvas, as displays have it.
pub fn lights(scene: &GpuScene, samples: u32, view: &ViewDesc) -> Vec<f64> {
    let content = ImageEncoding::Light;
    let mut renderer = Renderer::new(gpu(), samples).unwrap();
    renderer.prepare_for(gpu(), scene, content);
    let size = [view.viewport[2] as u32, view.viewport[3] as u32];
    let is_linear = scene.needs_light(view.effects());
    let mut target = Target::with_encoding(gpu(), size, samples, is_linear, content).unwrap();
    renderer.draw(gpu(), scene, &mut target, std::slice::from_ref(view)).unwrap();
    let bytes = read_pixels(gpu(), &target).unwrap();
    let green = |pixel: &[u8; 8]| f16_from_bits(u16::from_le_bytes([pixel[2], pixel[3]]));
    bytes.as_chunks::<8>().0.iter().map(green).collect()
}
