//! Glow: no light is lost, it falls as it is to, unlit colours stay, and no tile has a seam.

use glam::{DAffine3, DVec3, Vec3};
use polyptych_scene::{
    AlphaMode, Glow, Material, MaterialExtensions, Specular, ToneMapper, Transmission,
};

use super::harness::{
    MeshFixture, SceneFixture, differences, draw, draw_sampled, gpu, look, matt, pixel,
};
use super::pixel_light::lights;
use crate::readback::read_pixels;
use crate::target::Target;
use crate::{GpuScene, Renderer, ViewDesc};

/// 60° are 600 pixels: two pixels a texel of the picture that spreads.
const CANVAS: [u32; 2] = [900, 600];

fn glowing(light: f32) -> Material {
    Material { emissive: Vec3::splat(light), ..matt(0.0, 0.0, 0.0) }
}

/// Cards of a side in the plane z = 0, each at a place and of a material; dark all around.
fn cards(of: &[([f64; 2], f32, Material)]) -> GpuScene {
    fixture(of).build()
}

fn fixture(of: &[([f64; 2], f32, Material)]) -> SceneFixture {
    let mut stage = SceneFixture::new();
    (stage.desc.sky, stage.ground) = (Vec3::ZERO, Some(Vec3::ZERO));
    for ([x, y], side, material) in of {
        let material = stage.material(material.clone());
        let card = stage.mesh(&MeshFixture::rectangle(*side, *side), Some(material));
        stage.node(card, DAffine3::from_translation(DVec3::new(*x, *y, 0.0)));
    }
    stage
}

/// From 10 away: 60 pixels are about 1.15.
fn view(glow: Option<Glow>) -> ViewDesc {
    ViewDesc { glow, tone: ToneMapper::None, ..look(DVec3::Z * 10.0, DVec3::ZERO, CANVAS) }
}

#[test]
fn no_light_is_lost_and_each_octave_of_angle_has_as_much() {
    let scene = cards(&[([0.0, 0.0], 0.03, glowing(1.0))]);
    let plain: f64 = lights(&scene, 1, &view(None)).iter().sum();
    // 4° are about 36 pixels: all of it is within 300 pixels of the middle.
    let glow = Glow { strength: 1.0, width_degrees: 4.0 };
    let spread = lights(&scene, 1, &view(Some(glow)));
    let sum: f64 = spread.iter().sum();
    println!("{plain} of light is {sum} after it spread");
    assert!((sum / plain - 1.0).abs() < 0.01, "{plain} became {sum}");
    let within = |radius: f64| -> f64 {
        let places = (0u32..).zip(&spread);
        let inside = places.filter(|(at, _)| {
            let (x, y) = (f64::from(at % 900) - 449.5, f64::from(at / 900) - 299.5);
            x.hypot(y) <= radius
        });
        inside.map(|(_, light)| light).sum::<f64>() / sum
    };
    let found: Vec<f64> = [2.25, 4.5, 9.0, 18.0, 36.0, 72.0].map(within).to_vec();
    println!("within 2.25, 4.5 ... 72 pixels: {found:.3?}");
    // Levels are no sharp rings: what is outside of the widest octave is what they smear.
    let octaves: Vec<f64> = found[..4].windows(2).map(|pair| pair[1] - pair[0]).collect();
    assert!(octaves.iter().all(|share| (0.12..0.3).contains(share)), "{octaves:?}");
    assert!((0.8..0.95).contains(&found[3]) && found[5] > 0.99, "{found:?}");
    let half: f64 = lights(&scene, 1, &view(Some(Glow { strength: 0.5, ..glow }))).iter().sum();
    assert!((half / plain - 1.0).abs() < 0.01, "{plain} became {half}");
}

#[test]
fn unlit_colours_neither_glow_nor_are_shone_over() {
    let unlit = Material { unlit: true, ..matt(1.0, 1.0, 1.0) };
    let grey = Material { unlit: true, ..matt(0.2, 0.2, 0.2) };
    let scene = cards(&[([0.0, 0.0], 2.0, unlit.clone())]);
    let glow = Some(Glow { strength: 0.5, width_degrees: 5.0 });
    assert_eq!(draw(&scene, CANVAS, &view(glow)), draw(&scene, CANVAS, &view(None)));
    // Beside a lamp the grey stays, where a lit card of the same colour gets brighter.
    let lamp = ([-2.0, 0.0], 1.0, glowing(40.0));
    let middle = |of: Material| {
        let scene = cards(&[lamp.clone(), ([0.0, 0.0], 0.8, of)]);
        pixel(&draw(&scene, CANVAS, &view(glow)), CANVAS, 450, 300)
    };
    let alone = |of: Material| {
        pixel(&draw(&cards(&[([0.0, 0.0], 0.8, of)]), CANVAS, &view(None)), CANVAS, 450, 300)
    };
    assert_eq!(middle(grey.clone()), alone(grey));
    assert!(middle(matt(0.0, 0.0, 0.0))[0] > alone(matt(0.0, 0.0, 0.0))[0] + 8);
}

#[test]
fn what_glass_lets_through_glows_and_nothing_else() {
    let transmission = Some(Transmission { factor: 1.0, texture: None });
    let specular = Some(Specular { factor: 0.0, ..Specular::default() });
    let extensions = MaterialExtensions { transmission, specular, ..MaterialExtensions::default() };
    let pane = |color: f32| Material {
        extensions: Some(Box::new(extensions.clone())),
        ..matt(color, color, color)
    };
    let lamp = || ([0.0, 0.0], 0.5, glowing(0.5));
    let glow = view(Some(Glow { strength: 0.5, width_degrees: 5.0 }));
    // Before the lamp, which it covers.
    let near = |of: Material| {
        let mut stage = fixture(&[lamp()]);
        let of = stage.material(of);
        let card = stage.mesh(&MeshFixture::rectangle(4.0, 4.0), Some(of));
        stage.node(card, DAffine3::from_translation(DVec3::Z));
        lights(&stage.build(), 1, &glow).iter().sum::<f64>()
    };
    let open: f64 = lights(&cards(&[lamp()]), 1, &glow).iter().sum();
    let [dark, clear] = [0.0, 1.0].map(|color| near(pane(color)));
    println!("{open} of light, {dark} behind dark glass, {clear} behind clear glass");
    assert!(dark < open * 1e-3, "{dark} behind dark glass");
    assert!((clear / open - 1.0).abs() < 0.02, "{clear} behind clear glass, {open} without");
}

#[test]
fn what_blends_glows_and_a_scene_that_blends_glows_as_one_that_does_not() {
    let glow = Some(Glow::new(0.3));
    let pane = Material { alpha_mode: AlphaMode::Blend, ..glowing(30.0) };
    let near = |scene: &GpuScene| pixel(&draw(scene, CANVAS, &view(glow)), CANVAS, 450, 350);
    let [clear, blended] =
        [glowing(30.0), pane.clone()].map(|of| near(&cards(&[([0.0, 0.0], 0.5, of)])));
    assert!(clear[0] > 30, "{clear:?}");
    assert!(clear.iter().zip(blended).all(|(a, b)| a.abs_diff(b) <= 1), "{clear:?}, {blended:?}");
    let lamp = ([0.5, 0.3], 0.4, glowing(12.0));
    let plain = draw(&cards(std::slice::from_ref(&lamp)), CANVAS, &view(glow));
    let beside = cards(&[lamp, ([500.0, 0.0], 1.0, pane)]);
    let [_, more, _] = differences(&draw(&beside, CANVAS, &view(glow)), &plain);
    assert_eq!(more, 0, "{more} pixels differ by more than a code");
}

#[test]
fn tiles_agree_with_one_camera_where_lamps_are_beside_them() {
    // Of several sizes, at odd places, and one that no tile shows.
    let lamps = [([0.2, 0.1], 0.3), ([-3.1, 2.2], 0.05), ([4.4, -3.0], 0.6), ([0.0, 6.2], 0.7)];
    let of = lamps.map(|(at, side)| (at, side, glowing(25.0)));
    let scene = cards(&of);
    let glow = Some(Glow { strength: 0.4, width_degrees: 6.0 });
    let beyond = pixel(&draw(&scene, CANVAS, &view(glow)), CANVAS, 450, 0);
    assert!(beyond[0] > 8, "nothing glows at the border: {beyond:?}");
    for samples in [1, 4] {
        let whole = draw_sampled(&scene, CANVAS, samples, &[view(glow)]).0;
        let mut total = [0; 3];
        // Borders at odd pixels, with lamps on both sides.
        for [x, y, width, height] in
            [[0, 0, 451, 283], [451, 0, 449, 283], [0, 283, 451, 317], [451, 283, 449, 317]]
        {
            let viewport = [-f64::from(x), -f64::from(y), 900.0, 600.0];
            let tile = ViewDesc { viewport, ..view(glow) };
            let tile = draw_sampled(&scene, [width, height], samples, &[tile]).0;
            let rows = y..y + height;
            let places = rows.flat_map(|row| (x..x + width).map(move |column| (column, row)));
            let wanted: Vec<_> =
                places.map(|(column, row)| pixel(&whole, CANVAS, column, row)).collect();
            for (sum, count) in total.iter_mut().zip(differences(&tile, &wanted)) {
                *sum += count;
            }
        }
        println!("glow ×{samples}: {total:?} of {}", whole.len());
        // None does; with a guard band of 8 texels it is 1,700, by a code or two each.
        assert!(total[0] * 10_000 <= whole.len() && total[2] == 0, "{total:?}");
    }
}

#[test]
fn views_of_any_number_glow_as_one_does() {
    let scene = cards(&[([0.2, 0.3], 0.5, glowing(9.0))]);
    // Each has a picture of 0.3 million texels: 100 take four textures after each other.
    let part = |at: u32| ViewDesc {
        scissor: Some([at % 10 * 90, at / 10 * 60, 90, 60]),
        ..view(Some(Glow::new(0.5)))
    };
    let views: Vec<ViewDesc> = (0..100).map(part).collect();
    for samples in [1, 4] {
        let wanted = draw_sampled(&scene, CANVAS, samples, &[view(Some(Glow::new(0.5)))]).0;
        let found = draw_sampled(&scene, CANVAS, samples, &views).0;
        let [differing, more, _] = differences(&found, &wanted);
        // None by a software driver; 300 by an H200, which filters with fractions of 1/256.
        assert!(differing * 1_000 <= wanted.len() && more == 0, "{differing}, {more}");
    }
}

#[test]
fn a_channel_whose_views_are_all_hidden_is_drawn_with_glow_too() {
    let scene = cards(&[([0.0, 0.0], 0.5, glowing(9.0))]);
    let mut renderer = Renderer::new(gpu(), 1).unwrap();
    renderer.prepare(gpu(), &scene);
    let mut target = Target::new(gpu(), CANVAS, 1, true).unwrap();
    renderer.draw(gpu(), &scene, &mut target, &[]).unwrap();
    let shown = read_pixels(gpu(), &target).unwrap();
    assert!(shown.as_chunks::<4>().0.iter().all(|pixel| pixel[..3] == [0; 3]));
}

#[test]
fn plans_do_not_glow_and_numbers_that_no_glow_has_are_refused() {
    let scene = cards(&[([0.0, 0.0], 0.5, glowing(9.0))]);
    let mut renderer = Renderer::new(gpu(), 1).unwrap();
    renderer.prepare(gpu(), &scene);
    let mut target = Target::new(gpu(), CANVAS, 1, true).unwrap();
    let wrong = view(Some(Glow { strength: 2.0, width_degrees: 4.0 }));
    let error = renderer.draw(gpu(), &scene, &mut target, &[wrong]).unwrap_err();
    assert!(error.to_string().contains("strength"), "{error}");
    let mut flat = view(Some(Glow::new(1.0)));
    flat.clip_from_view = glam::DMat4::from_scale(DVec3::new(0.2, 0.3, -0.1));
    assert!(flat.is_parallel());
    renderer.draw(gpu(), &scene, &mut target, std::slice::from_ref(&flat)).unwrap();
    let shown = read_pixels(gpu(), &target).unwrap();
    let plain = draw(&scene, CANVAS, &ViewDesc { glow: None, ..flat });
    assert_eq!(differences(shown.as_chunks::<4>().0, &plain)[1], 0);
}
