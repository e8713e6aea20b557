//! Pictures of fewer pixels.

use std::num::NonZeroU32;

use polyptych_wall::color::linear_from_srgb;

use super::harness::*;
use crate::{OutputTexture, Renderer, read_picture};

#[test]
fn each_pixel_has_the_mean_light_of_a_square() {
    let mut renderer = Renderer::new(gpu(), 1).expect("a renderer");
    let code = |at: u32| (at.wrapping_mul(2_654_435_761) >> 11) as u8;
    for (size, side) in [([16, 12], 4), ([17, 13], 4), ([5, 3], 8), ([9, 7], 1), ([6, 5], u32::MAX)]
    {
        let [width, height]: [u32; 2] = size;
        let rgba: Vec<u8> =
            (0..4 * width * height).map(|at| if at % 4 == 3 { 255 } else { code(at) }).collect();
        let picture = OutputTexture::of_pixels(gpu(), size, &rgba);
        let side_of = NonZeroU32::new(side).expect("squares");
        let reduced = renderer.reduce(gpu(), &picture, side_of);
        assert_eq!(reduced.size(), size.map(|pixels| pixels.div_ceil(side)));
        let found = read_picture(gpu(), &reduced).expect("a picture");
        let across = reduced.size()[0];
        for (at, pixel) in (0..).zip(found.chunks_exact(4)) {
            let (left, top) = (at % across * side, at / across * side);
            let end = |from: u32, all: u32| from.saturating_add(side).min(all);
            let (right, bottom) = (end(left, width), end(top, height));
            let places = (top..bottom).flat_map(|y| (left..right).map(move |x| y * width + x));
            let places: Vec<u32> = places.collect();
            for channel in 0..3 {
                let light = |at: &u32| {
                    linear_from_srgb(f64::from(rgba[(4 * at + channel) as usize]) / 255.0)
                };
                let mean = places.iter().map(light).sum::<f64>() / places.len() as f64;
                let off = linear_from_srgb(f64::from(pixel[channel as usize]) / 255.0) - mean;
                // A code is at most 0.009 of all light wide.
                assert!(off.abs() < 0.006, "{size:?}, {side}: pixel {at} is off by {off}");
            }
        }
    }
}
