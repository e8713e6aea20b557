//! From light to codes: what is done to a picture's light and places, against f64.

use std::sync::Arc;

use glam::{DAffine3, DMat3, DMat4, DVec3, Vec3};
use polyptych_scene::{AlphaMode, Material};
use polyptych_wall::warp_mesh::{WarpMesh, WarpVertex};
use polyptych_wall::{Orientation, StereoPacking, TransferFunction};

use super::harness::{MeshFixture, SceneFixture, differences, draw_sampled, gpu, look, matt};
use crate::readback::read_raw;
use crate::tone::f16_from_bits;
use crate::{
    AtlasViewDesc, BlendMapDesc, Correction, CorrectionDesc, CorrectionError, EyeAtlas, GpuScene,
    ImageEncoding, OutputTexture, PresentPass, Renderer, Target, ViewDesc, read_picture,
    read_pixels,
};

const SIZE: [u32; 2] = [96, 64];

/// Spheres of three colours on a light ground, from dark to bright.
fn scene(alpha_mode: AlphaMode) -> GpuScene {
    let mut stage = SceneFixture::new();
    for (x, color) in [(-1.5, [0.9, 0.1, 0.05]), (0.0, [0.2, 0.8, 0.1]), (1.5, [0.1, 0.2, 0.9])] {
        let [r, g, b] = color;
        let color = Material { alpha_mode, ..matt(r, g, b) };
        let material = stage.material(color);
        let mesh = stage.mesh(&MeshFixture::sphere(12), Some(material));
        stage.node(mesh, DAffine3::from_translation(DVec3::new(x, 0.2 * x, -2.0)));
    }
    let white = stage.material(Material { unlit: true, ..matt(1.0, 1.0, 1.0) });
    let card = stage.mesh(&MeshFixture::rectangle(0.3, 0.2), Some(white));
    stage.node(card, DAffine3::from_translation(DVec3::new(-0.4, 0.9, -1.0)));
    stage.build()
}

fn view() -> ViewDesc {
    look(DVec3::new(0.2, 0.1, 1.8), DVec3::new(0.0, 0.1, -2.0), SIZE)
}

/// The views' light, side by side.
fn light(scene: &GpuScene, samples: u32, views: &[ViewDesc]) -> Target {
    let mut renderer = Renderer::new(gpu(), samples).unwrap();
    renderer.prepare_for(gpu(), scene, ImageEncoding::Light);
    let size = [SIZE[0] * views.len() as u32, SIZE[1]];
    let mut target =
        Target::with_encoding(gpu(), size, samples, scene.has_transparency(), ImageEncoding::Light)
            .unwrap();
    let views: Vec<ViewDesc> = (0..)
        .zip(views)
        .map(|(slot, view)| ViewDesc {
            viewport: [f64::from(slot * SIZE[0]), 0.0, f64::from(SIZE[0]), f64::from(SIZE[1])],
            scissor: Some([slot * SIZE[0], 0, SIZE[0], SIZE[1]]),
            ..view.clone()
        })
        .collect();
    renderer.draw(gpu(), scene, &mut target, &views).unwrap();
    target
}

/// Returns the light of a target's pixels, as the shader reads it.
fn linear(target: &Target) -> Vec<DVec3> {
    let bytes = read_pixels(gpu(), target).unwrap();
    let half = |at: &[u8]| f16_from_bits(u16::from_le_bytes([at[0], at[1]]));
    bytes.chunks(8).map(|p| DVec3::new(half(p), half(&p[2..]), half(&p[4..]))).collect()
}

/// Eyes whose pictures stand side by side in the source.
fn eyes(count: u32) -> Vec<EyeAtlas> {
    let eye = |slot: u32| {
        let rect = [slot * SIZE[0], 0, SIZE[0], SIZE[1]];
        let eye_in_display = DVec3::ZERO;
        let plane = AtlasViewDesc { eye_in_display, clip_from_eye: DMat4::IDENTITY, rect };
        EyeAtlas { planes: vec![plane], triangles: None }
    };
    (0..count).map(eye).collect()
}

fn corrected(source: &Target, desc: CorrectionDesc) -> Vec<[u8; 4]> {
    let eyes = eyes(desc.packing.eyes() as u32);
    let mut correction = Correction::new(gpu(), desc).unwrap();
    let picture = correction.picture(gpu());
    correction.draw(gpu(), source, &eyes, [1, 1], &picture).unwrap();
    let bytes = read_picture(gpu(), &picture).unwrap();
    bytes.as_chunks::<4>().0.to_vec()
}

fn identity() -> CorrectionDesc {
    CorrectionDesc::identity(SIZE)
}

#[test]
fn a_correction_of_nothing_changes_no_code_by_more_than_one() {
    for (alpha_mode, samples) in
        [(AlphaMode::Opaque, 1), (AlphaMode::Blend, 1), (AlphaMode::Opaque, 4)]
    {
        let scene = scene(alpha_mode);
        let plain = draw_sampled(&scene, SIZE, samples, &[view()]).0;
        let corrected = corrected(&light(&scene, samples, &[view()]), identity());
        let [some, more_than_1, _] = differences(&plain, &corrected);
        println!("{alpha_mode:?} ×{samples}: {some} of {} differ", plain.len());
        assert_eq!(more_than_1, 0, "{alpha_mode:?} ×{samples}");
        // Half floats are off by up to 0.03 codes, in each of three colours.
        assert!(some * 8 <= plain.len(), "{alpha_mode:?} ×{samples}: {some} differ");
    }
}

/// The pixel of the upright picture that a display's pixel shows, by the words of [`Orientation`].
fn upright(turn: Orientation, is_mirrored: bool, x: u32, y: u32) -> usize {
    let [width, height] = SIZE;
    let (u, v) = match turn {
        Orientation::None => (x, y),
        // The display's top is at the viewer's left: its rows run upwards.
        Orientation::Left => (y, height - 1 - x),
        Orientation::Right => (width - 1 - y, x),
        Orientation::Half => (width - 1 - x, height - 1 - y),
    };
    let u = if is_mirrored { width - 1 - u } else { u };
    (v * width + u) as usize
}

#[test]
fn turns_and_mirrors_are_exact() {
    let source = light(&scene(AlphaMode::Opaque), 1, &[view()]);
    let plain = corrected(&source, identity());
    for turn in [Orientation::None, Orientation::Left, Orientation::Right, Orientation::Half] {
        for is_mirrored in [false, true] {
            let desc = CorrectionDesc { turn, is_mirrored, ..identity() };
            let [width, height] = desc.display_size();
            let turned = corrected(&source, desc);
            let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
            let wanted: Vec<_> =
                places.map(|(x, y)| plain[upright(turn, is_mirrored, x, y)]).collect();
            assert!(turned == wanted, "{turn:?}, mirrored: {is_mirrored}");
        }
    }
}

#[test]
fn both_eyes_are_packed_exactly() {
    let left = view();
    let right = ViewDesc { eye_in_world: left.eye_in_world + DVec3::X * 0.5, ..left.clone() };
    let scene = scene(AlphaMode::Opaque);
    let source = light(&scene, 1, &[left.clone(), right.clone()]);
    let [left, right] = [left, right].map(|eye| corrected(&light(&scene, 1, &[eye]), identity()));
    assert!(differences(&left, &right)[2] > 100, "the eyes see different pictures");
    let packed = |packing| corrected(&source, CorrectionDesc { packing, ..identity() });
    let width = SIZE[0] as usize;
    let beside = packed(StereoPacking::SideBySide);
    for (row, both) in beside.chunks(2 * width).enumerate() {
        assert!(both[..width] == left[row * width..][..width], "left, row {row}");
        assert!(both[width..] == right[row * width..][..width], "right, row {row}");
    }
    assert!(packed(StereoPacking::TopBottom) == [left.clone(), right.clone()].concat());
    for ((l, r), both) in left.iter().zip(&right).zip(packed(StereoPacking::Anaglyph)) {
        assert_eq!(both[..3], [l[0], r[1], r[2]]);
    }
    // A display that hangs upside down takes the eyes apart as it always does.
    let turned =
        CorrectionDesc { packing: StereoPacking::TopBottom, turn: Orientation::Half, ..identity() };
    let wanted = left.iter().rev().chain(right.iter().rev());
    assert!(corrected(&source, turned).iter().eq(wanted));
}

/// Display codes, 0 to 255, of the light by the words of [`CorrectionDesc`].
fn reference(desc: &CorrectionDesc, light: DVec3, pixel: usize) -> DVec3 {
    let mut light = (desc.color * light).clamp(DVec3::ZERO, DVec3::ONE);
    if let Some(map) = &desc.light_map {
        let [factor, addend] = map.texels[pixel].map(|texel| f64::from(texel) / 65535.0);
        light = light * factor * map.multiply + map.add * addend;
    }
    let code = |at: usize| match &desc.curve {
        TransferFunction::Srgb if light[at] <= 0.0031308 => light[at] * 12.92,
        TransferFunction::Srgb => 1.055 * light[at].powf(1.0 / 2.4) - 0.055,
        TransferFunction::Gamma(gamma) => light[at].powf(1.0 / gamma[at]),
        TransferFunction::Measured(points) => {
            // By bisection of the piecewise linear curve.
            let last = points.len() - 1;
            let of = |code: f64| {
                let below = ((code * last as f64) as usize).min(last - 1);
                let part = code * last as f64 - below as f64;
                points[below][at] + (points[below + 1][at] - points[below][at]) * part
            };
            let halve = |(low, high): (f64, f64), _| {
                let middle = f64::midpoint(low, high);
                if of(middle) < light[at] { (middle, high) } else { (low, middle) }
            };
            (0..60).fold((0.0, 1.0), halve).0
        }
    };
    DVec3::new(code(0), code(1), code(2)).clamp(DVec3::ZERO, DVec3::ONE) * 255.0
}

#[test]
fn light_becomes_codes_as_said() {
    let source = light(&scene(AlphaMode::Opaque), 1, &[view()]);
    let linear = linear(&source);
    let count = linear.len();
    let weights: Vec<[f64; 2]> =
        (0..count).map(|at| [(at % 96) as f64 / 95.0, (at / 96) as f64 / 64.0]).collect();
    let light_map = Some(Arc::new(BlendMapDesc::new(&weights, DVec3::new(0.01, 0.008, 0.012))));
    let color = DMat3::from_cols_array(&[0.9, 0.05, 0.0, 0.08, 1.1, -0.02, 0.02, 0.1, 0.8]);
    let measured = (0..=1023).map(|code| {
        let code = f64::from(code) / 1023.0;
        DVec3::new(code.powf(2.6), code.powf(1.8), code * code * (3.0 - 2.0 * code))
    });
    let curves = [
        TransferFunction::Srgb,
        TransferFunction::Gamma(DVec3::new(1.8, 2.2, 2.6)),
        TransferFunction::Measured(measured.collect()),
    ];
    for curve in curves {
        for (color, light_map) in [(DMat3::IDENTITY, None), (color, light_map.clone())] {
            let desc = CorrectionDesc { color, light_map, curve: curve.clone(), ..identity() };
            let codes = corrected(&source, desc.clone());
            let mut most = 0f64;
            for (at, (code, light)) in codes.iter().zip(&linear).enumerate() {
                let code = DVec3::new(code[0].into(), code[1].into(), code[2].into());
                let off = (code - reference(&desc, *light, at)).abs().max_element();
                most = most.max(off);
            }
            let name = format!("{:.12}", format!("{curve:?}"));
            println!("{name}: off by {most:.3} codes, {} before rounding", most - 0.5);
            // Half a code is rounding. A software driver adds 0.03, an H200 0.06.
            assert!(most <= 0.57, "{name}: off by {most} codes");
        }
    }
}

/// A light map of ramps around a part whose pixels all have the same weights; with `specks` one
/// texel in each 8 × 8 differs, so that no part of it is even.
fn map_with_even_part(is_tinted: bool, specks: bool) -> BlendMapDesc {
    let texel = |layer: u16, x: u32, y: u32| {
        let ramp = |at: u32, low: u32, high: u32| {
            f64::from(low.saturating_sub(at).max(at.saturating_sub(high))) / 40.0
        };
        let away = ramp(x, 21, 74) + ramp(y, 9, 49);
        let factor = (1.0 - away).max(0.0) * 50_000.0 + f64::from(layer) * 1000.0;
        let speck = u16::from(specks && x % 8 == 3 && y % 8 == 5);
        [factor as u16 + 10_000 * speck, 3000 + 500 * layer + (away * 9000.0) as u16]
    };
    let layers = if is_tinted { 3 } else { 1 };
    let places = (0..layers)
        .flat_map(|layer| (0..SIZE[1]).flat_map(move |y| (0..SIZE[0]).map(move |x| (layer, x, y))));
    let texels = places.map(|(layer, x, y)| texel(layer, x, y)).collect();
    BlendMapDesc { texels, multiply: 1.0, add: DVec3::new(0.1, 0.2, 0.15) }
}

#[test]
fn pixels_with_even_weights_are_as_those_of_a_map() {
    let source = light(&scene(AlphaMode::Opaque), 1, &[view(), view()]);
    for turn in [Orientation::None, Orientation::Left, Orientation::Right, Orientation::Half] {
        for (is_mirrored, packing, is_tinted) in [
            (false, StereoPacking::None, false),
            (true, StereoPacking::SideBySide, true),
            (false, StereoPacking::TopBottom, false),
            (true, StereoPacking::Anaglyph, true),
        ] {
            let draw = |specks| {
                let light_map = Some(Arc::new(map_with_even_part(is_tinted, specks)));
                let dither = Some(3);
                let desc =
                    CorrectionDesc { turn, is_mirrored, packing, light_map, dither, ..identity() };
                corrected(&source, desc)
            };
            let (even, specked) = (draw(false), draw(true));
            let [differ, by_more_than_one, _] = differences(&even, &specked);
            let pictures = even.len() / (SIZE[0] * SIZE[1]) as usize;
            let specks = pictures * (SIZE[0] * SIZE[1] / 64) as usize;
            let case = format!("{turn:?}, mirrored: {is_mirrored}, {packing:?}: {differ}");
            // Of two programs one may round a code up and the other one down.
            assert!(by_more_than_one <= specks, "{case}, {by_more_than_one} by more than one");
            assert!((specks / 2..=specks + 8).contains(&differ), "{case} of {specks}");
        }
    }
}

#[test]
fn blend_weights_keep_their_sum() {
    let weights: Vec<f64> = (0..=4096).map(|step| f64::from(step) / 4096.0).collect();
    let map = |weights: Vec<f64>| {
        let pixels: Vec<_> = weights.iter().map(|weight| [*weight, 0.0]).collect();
        BlendMapDesc::new(&pixels, DVec3::ZERO)
    };
    let (up, down) =
        (map(weights.clone()), map(weights.iter().map(|weight| 1.0 - weight).collect()));
    let value =
        |map: &BlendMapDesc, at: usize| f64::from(map.texels[at][0]) / 65535.0 * map.multiply;
    let off = (0..weights.len()).map(|at| (value(&up, at) + value(&down, at) - 1.0).abs());
    let most = off.fold(0.0, f64::max);
    assert!(most <= 1.0 / 4096.0 / 8.0, "{most}");
}

/// A picture of nothing but sky.
fn grey(level: f32) -> Target {
    let mut stage = SceneFixture::new();
    stage.desc.sky = Vec3::splat(level);
    light(&stage.build(), 1, &[view()])
}

#[test]
fn dither_has_the_right_mean_and_is_another_on_every_channel() {
    let source = grey(0.2);
    let exact = reference(&identity(), linear(&source)[0], 0);
    let dithered = |id| corrected(&source, CorrectionDesc { dither: Some(id), ..identity() });
    let (a, b) = (dithered(1), dithered(2));
    assert!(a == dithered(1), "the same in every frame");
    let count = a.len() as f64;
    for picture in [&a, &b] {
        for at in 0..3 {
            let mean = picture.iter().map(|pixel| f64::from(pixel[at])).sum::<f64>() / count;
            let spread = picture
                .iter()
                .map(|p| f64::from(p[at]))
                .fold([255.0, 0.0], |s, code| [f64::min(s[0], code), f64::max(s[1], code)]);
            println!("mean {mean:.4} of {:.4}, from {spread:?}", exact[at]);
            // Four deviations of the mean of as many roundings.
            assert!((mean - exact[at]).abs() <= 4.0 * 0.5 / count.sqrt(), "{mean}, {exact}");
            assert!(spread[1] - spread[0] <= 1.0, "{spread:?}");
        }
    }
    // Whatever two channels have in common would add up where they overlap.
    let part = exact.x.fract();
    let noise = |picture: &[[u8; 4]]| -> Vec<f64> {
        picture.iter().map(|p| f64::from(p[0]) - exact.x.floor() - part).collect()
    };
    let (na, nb) = (noise(&a), noise(&b));
    let product: f64 = na.iter().zip(&nb).map(|(a, b)| a * b).sum::<f64>() / count;
    let shifted: f64 = na.iter().zip(&na[1..]).map(|(a, b)| a * b).sum::<f64>() / count;
    let variance = part * (1.0 - part);
    for correlation in [product / variance, shifted / variance] {
        assert!(correlation.abs() < 4.0 / count.sqrt(), "{correlation}");
    }
}

#[test]
fn fine_codes_are_four_times_as_fine_and_keep_their_mean() {
    let source = grey(0.2);
    let light = linear(&source)[0];
    let exact = reference(&identity(), light, 0) / 255.0;
    let draw = |dither| {
        let desc = CorrectionDesc { is_fine: true, dither, ..identity() };
        let mut correction = Correction::new(gpu(), desc).unwrap();
        let picture = correction.picture(gpu());
        correction.draw(gpu(), &source, &eyes(1), [1, 1], &picture).unwrap();
        picture
    };
    let exact_pixel = draw(None);
    // As a surface of ten bits takes it, and one of eight that encodes what it is given.
    let shown = |picture: &OutputTexture, content: ImageEncoding| {
        let surface = OutputTexture::new(gpu(), SIZE, content);
        let mut output = PresentPass::new(gpu(), surface.texture().format());
        output.draw(gpu(), Some(picture), &[], surface.view(), SIZE);
        read_raw(gpu(), &surface).unwrap()
    };
    let fine = |pixel: &[u8]| {
        let bits = u32::from_le_bytes(pixel.try_into().unwrap());
        DVec3::from([0, 10, 20].map(|at| f64::from(bits >> at & 1023)))
    };
    for pixel in shown(&exact_pixel, ImageEncoding::FineCodes).chunks(4) {
        assert!(
            (fine(pixel) - exact * 1023.0).abs().max_element() <= 0.51,
            "{} of {}",
            fine(pixel),
            exact * 1023.0
        );
    }
    for pixel in shown(&exact_pixel, ImageEncoding::Srgb).chunks(4) {
        let code = DVec3::from([0, 1, 2].map(|at| f64::from(pixel[at])));
        assert!((code - exact * 255.0).abs().max_element() <= 0.64, "{code}");
    }
    let rounded = read_picture(gpu(), &exact_pixel).unwrap();
    for pixel in rounded.chunks(4) {
        let code = DVec3::from([0, 1, 2].map(|at| f64::from(pixel[at])));
        assert!((code - exact * 255.0).abs().max_element() <= 0.64 && pixel[3] == 255, "{code}");
    }
    let dithered = shown(&draw(Some(3)), ImageEncoding::FineCodes);
    let count = dithered.len() as f64 / 4.0;
    let codes: Vec<DVec3> = dithered.chunks(4).map(fine).collect();
    let mean = codes.iter().sum::<DVec3>() / count;
    assert!((mean - exact * 1023.0).abs().max_element() <= 4.0 * 0.5 / count.sqrt(), "{mean}");
    let spread = |at: usize| {
        let of = codes.iter().map(|code| code[at]);
        of.clone().fold(0.0, f64::max) - of.fold(1023.0, f64::min)
    };
    assert!((0..3).all(|at| spread(at) == 1.0), "the noise is one fine code wide");
}

#[test]
fn what_cannot_be_corrected_is_refused() {
    let refused = |desc| Correction::new(gpu(), desc).map(|_| ()).unwrap_err().to_string();
    let desc = CorrectionDesc { upright: [0, 5], ..identity() };
    assert!(refused(desc).contains("0 × 5 pixels"));
    let light_map = Some(Arc::new(BlendMapDesc::new(&[[1.0, 0.0]; 7], DVec3::ZERO)));
    assert!(refused(CorrectionDesc { light_map, ..identity() }).contains("7 texels"));
    let color = DMat3::from_diagonal(DVec3::NAN);
    assert!(refused(CorrectionDesc { color, ..identity() }).contains("matrix"));
    let falling = vec![DVec3::ZERO, DVec3::ONE, DVec3::splat(0.5), DVec3::ONE];
    for curve in [TransferFunction::Gamma(DVec3::ZERO), TransferFunction::Measured(falling)] {
        assert!(refused(CorrectionDesc { curve, ..identity() }).contains("colours"));
    }
    let vertices = |x: f64, z: f64| {
        let pixels = [[0.0, 0.0], [x, 0.0], [0.0, 9.0]];
        pixels.map(|pixel| WarpVertex { pixel: pixel.into(), point: DVec3::NEG_Z * z }).to_vec()
    };
    for (vertices, triangle, why) in [
        (vertices(200.0, 1.0), [0, 1, 2], "pixel (200, 0)"),
        (vertices(9.0, f64::NAN), [0, 1, 2], "NaN"),
        (vertices(9.0, 1.0), [0, 1, 3], "beyond the 3 points"),
    ] {
        let warp = Some(Arc::new(WarpMesh { vertices, triangles: vec![triangle] }));
        let said = refused(CorrectionDesc { warp, ..identity() });
        assert!(said.contains(why), "{said}");
    }
    let empty = Some(Arc::new(WarpMesh::default()));
    assert!(refused(CorrectionDesc { warp: empty, ..identity() }).contains("no triangle"));
    let mut correction = Correction::new(gpu(), identity()).unwrap();
    let picture = correction.picture(gpu());
    let plain = Target::new(gpu(), SIZE, 1, false).unwrap();
    let source = grey(0.5);
    let mut draw = |source, eyes: &[EyeAtlas], onto| {
        let drawn = correction.draw(gpu(), source, eyes, [1, 1], onto);
        matches!(drawn, Err(CorrectionError::Source(_)))
    };
    assert!(draw(&plain, &eyes(1), &picture), "no light");
    assert!(draw(&source, &eyes(2), &picture), "two eyes");
    assert!(draw(&source, &eyes(2)[1..], &picture), "a plane outside");
    assert!(draw(&source, &eyes(1), plain.picture()), "another picture");
    assert!(!draw(&source, &eyes(1), &picture), "and as it should be");
    assert_eq!(gpu().take_error(), None);
}
