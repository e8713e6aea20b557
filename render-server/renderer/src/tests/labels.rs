//! Words over pictures: where they should be, and nothing else touched.

use super::harness::gpu;
use crate::output_texture::{ImageEncoding, OutputTexture};
use crate::{Label, LabelPosition, PresentPass, letterbox, read_picture};

/// A picture in which every pixel has its own colour.
fn picture(size: [u32; 2]) -> OutputTexture {
    let pixels = (0..size[0] * size[1]).flat_map(|n| [n as u8, (n >> 8) as u8, (n * 7) as u8, 255]);
    OutputTexture::of_pixels(gpu(), size, &pixels.collect::<Vec<u8>>())
}

fn label(place: LabelPosition, lines: &[&str]) -> Label {
    Label { lines: lines.iter().map(|line| (*line).to_owned()).collect(), place }
}

/// Returns the pixels that a surface of this format shows, as sRGB bytes.
fn shown(
    output: &mut PresentPass,
    format: wgpu::TextureFormat,
    picture: Option<&OutputTexture>,
    labels: &[Label],
    size: [u32; 2],
) -> Vec<[u8; 4]> {
    let extent = wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 };
    let texture = gpu().device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: extent,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    });
    let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
    output.draw(gpu(), picture, labels, &view, size);
    let copy = OutputTexture::new(gpu(), size, ImageEncoding::Srgb);
    let mut encoder =
        gpu().device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    encoder.copy_texture_to_texture(
        texture.as_image_copy(),
        copy.texture().as_image_copy(),
        extent,
    );
    gpu().queue.submit([encoder.finish()]);
    let bytes = read_picture(gpu(), &copy).unwrap();
    assert_eq!(gpu().take_error(), None);
    bytes.as_chunks::<4>().0.to_vec()
}

#[test]
fn a_label_covers_its_panel_and_the_picture_is_untouched_elsewhere() {
    let size = [320, 180];
    let labels = [
        label(LabelPosition::Middle, &["front-1-1", "127.0.0.1:41234", "320 x 180 pixels"]),
        label(LabelPosition::Corner, &["manager lost since 12:03:10 UTC"]),
    ];
    let under = picture(size);
    let before = read_picture(gpu(), &under).unwrap();
    for format in [wgpu::TextureFormat::Rgba8UnormSrgb, wgpu::TextureFormat::Rgba8Unorm] {
        let mut output = PresentPass::new(gpu(), format);
        for labels in [&labels[..], &labels[..1], &labels[1..], &[]] {
            let pixels = shown(&mut output, format, Some(&under), labels, size);
            let mut expected = before.as_chunks::<4>().0.to_vec();
            for label in labels {
                let (image, [left, top]) = label.image(size).unwrap();
                for (x, y, pixel) in image.enumerate_pixels() {
                    expected[((top + y) * size[0] + left + x) as usize] = pixel.0;
                }
            }
            let differing = pixels.iter().zip(&expected).filter(|(a, b)| a != b).count();
            assert_eq!(differing, 0, "{format:?}, {} labels", labels.len());
        }
    }
    assert_eq!(read_picture(gpu(), &under).unwrap(), before, "captures are of this");
}

#[test]
fn without_a_picture_all_is_black() {
    let (format, size) = (wgpu::TextureFormat::Rgba8UnormSrgb, [64, 48]);
    let mut output = PresentPass::new(gpu(), format);
    let under = picture(size);
    assert_ne!(shown(&mut output, format, Some(&under), &[], size)[99], [0, 0, 0, 255]);
    let pixels = shown(&mut output, format, None, &[], size);
    assert!(pixels.iter().all(|pixel| *pixel == [0, 0, 0, 255]));
}

#[test]
fn a_label_is_as_sharp_on_a_display_that_scales_the_picture() {
    let (format, size) = (wgpu::TextureFormat::Rgba8UnormSrgb, [400, 300]);
    let corner = label(LabelPosition::Corner, &["manager lost"]);
    let mut output = PresentPass::new(gpu(), format);
    let under = picture([40, 30]);
    let pixels = shown(&mut output, format, Some(&under), std::slice::from_ref(&corner), size);
    let (image, [left, top]) = corner.image(size).unwrap();
    assert_eq!([left, top + image.height()], [0, 300], "lower left");
    for (x, y, pixel) in image.enumerate_pixels() {
        assert_eq!(pixels[((top + y) * size[0] + left + x) as usize], pixel.0, "{x}, {y}");
    }
}

#[test]
fn a_picture_of_another_size_keeps_its_aspect_ratio_between_black_bars() {
    for (picture, surface, expected) in [
        ([160, 90], [160, 90], [0, 0, 160, 90]),
        ([160, 90], [1024, 768], [0, 96, 1024, 576]),
        ([160, 90], [100, 90], [0, 17, 100, 56]),
        ([90, 160], [1024, 768], [296, 0, 432, 768]),
        ([1, 8192], [8192, 1], [4095, 0, 1, 1]),
        // Rounded by less than a pixel: a preview that was scaled down has no bars.
        ([4096, 512], [683, 85], [0, 0, 683, 85]),
        ([320, 180], [213, 120], [0, 0, 213, 120]),
        ([320, 180], [213, 123], [0, 1, 213, 120]),
        ([0, 0], [0, 0], [0, 0, 1, 1]),
    ] {
        assert_eq!(letterbox(picture, surface), expected, "{picture:?} on {surface:?}");
    }
}

#[test]
fn all_sizes_of_windows_hold_the_whole_picture() {
    for (picture, width, height) in [([1920, 1080], 97, 61), ([1080, 1920], 53, 89)] {
        for surface in (1..40).flat_map(|x| (1..40).map(move |y| [x * width, y * height])) {
            let [x, y, w, h] = letterbox(picture, surface);
            assert!(x + w <= surface[0] && y + h <= surface[1], "{surface:?}");
            assert!(w == surface[0] || h == surface[1], "as large as it fits: {surface:?}");
            let [aspect, due] = [[w, h], picture].map(|[w, h]| f64::from(w) / f64::from(h));
            let slack = 2.0 / f64::from(w.min(h));
            assert!((aspect / due - 1.0).abs() <= slack, "{surface:?}: {aspect}, {due}");
        }
    }
}

#[test]
fn bars_are_black_and_the_picture_fills_the_rest() {
    let format = wgpu::TextureFormat::Rgba8UnormSrgb;
    let mut output = PresentPass::new(gpu(), format);
    let white = OutputTexture::of_pixels(gpu(), [32, 18], &[255; 32 * 18 * 4]);
    for size in [[64, 64], [200, 30], [33, 19], [32, 18]] {
        let pixels = shown(&mut output, format, Some(&white), &[], size);
        let [x, y, width, height] = letterbox([32, 18], size);
        for (n, pixel) in pixels.iter().enumerate() {
            let at = [n as u32 % size[0], n as u32 / size[0]];
            let is_lit = (x..x + width).contains(&at[0]) && (y..y + height).contains(&at[1]);
            assert_eq!(pixel.map(|byte| byte > 0), [is_lit, is_lit, is_lit, true], "{at:?}");
        }
    }
}
