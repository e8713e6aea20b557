//! Depth of field: as many eyes in the place of a lens see it, the same angle on all displays, and
//! without a seam.

use glam::{DAffine3, DQuat, DVec3, Vec3};
use polyptych_scene::{
    AmbientOcclusion, DepthOfField, Material, MaterialExtensions, ToneMapper, Transmission,
};

use super::harness::{
    MeshFixture, SceneFixture, differences, draw, draw_sampled, gpu, look, matt, pixel,
};
use super::pixel_light::lights;
use crate::readback::read_pixels;
use crate::target::Target;
use crate::{GpuScene, Renderer, ViewDesc};

/// 60° are 520 pixels: a texel of the picture is a pixel.
const CANVAS: [u32; 2] = [780, 520];
/// Cards are drawn sharp here.
const FOCUS: f32 = 10.0;

fn glowing(light: f32) -> Material {
    Material { emissive: Vec3::splat(light), ..matt(0.0, 0.0, 0.0) }
}

/// Cards before black: the middle of each, its half sides, and its material.
fn cards(of: &[(DVec3, [f32; 2], Material)]) -> GpuScene {
    let mut stage = SceneFixture::new();
    (stage.desc.sky, stage.ground) = (Vec3::ZERO, Some(Vec3::ZERO));
    for (at, [width, height], material) in of {
        let material = stage.material(material.clone());
        let card = stage.mesh(&MeshFixture::rectangle(*width, *height), Some(material));
        stage.node(card, DAffine3::from_translation(*at));
    }
    stage.build()
}

/// Rows of cards of many lights in the plane at a distance.
fn grid(distance: f64, step: f64) -> Vec<(DVec3, [f32; 2], Material)> {
    let places = (-5..=5).flat_map(|y| (-8..=8).map(move |x| (x, y)));
    let card = |(x, y): (i32, i32)| {
        let at = DVec3::new(f64::from(x) * step, f64::from(y) * step, -distance);
        let light = 0.1 + 0.15 * f32::from(((x * 7 + y * 3).rem_euclid(6)) as u8);
        (at, [step as f32 * 0.3; 2], glowing(light))
    };
    places.map(card).collect()
}

fn lens(aperture: f32) -> DepthOfField {
    DepthOfField { focus: FOCUS, aperture }
}

/// From the origin along −z.
fn view(depth_of_field: Option<DepthOfField>) -> ViewDesc {
    let seen = look(DVec3::ZERO, DVec3::NEG_Z, CANVAS);
    ViewDesc { depth_of_field, tone: ToneMapper::None, ..seen }
}

/// What eyes all over a lens see: each sees the plane of the focus where the middle one does.
fn through_lens(scene: &GpuScene, lens: DepthOfField, eyes: u32) -> Vec<f64> {
    let mut sum = vec![0.0; (CANVAS[0] * CANVAS[1]) as usize];
    for eye in 0..eyes {
        let turn = f64::from(eye) * std::f64::consts::PI * (3.0 - 5f64.sqrt());
        let part = ((f64::from(eye) + 0.5) / f64::from(eyes)).sqrt();
        let offset =
            DVec3::new(turn.cos(), turn.sin(), 0.0) * part * f64::from(lens.aperture) / 2.0;
        let mut moved = view(None);
        moved.eye_in_world += offset;
        let scale = moved.clip_from_view.x_axis.x * offset.x;
        moved.clip_from_view.z_axis.x -= scale / f64::from(lens.focus);
        let scale = moved.clip_from_view.y_axis.y * offset.y;
        moved.clip_from_view.z_axis.y -= scale / f64::from(lens.focus);
        for (sum, light) in sum.iter_mut().zip(lights(scene, 4, &moved)) {
            *sum += light / f64::from(eyes);
        }
    }
    sum
}

/// The mean difference, and that which 99 % do not reach, in the middle of the canvas: there the
/// plane of the focus is as far as the sphere.
fn errors(found: &[f64], wanted: &[f64]) -> [f64; 2] {
    let pixels = (0u32..).zip(found.iter().zip(wanted));
    let middle = pixels.filter(|(at, _)| {
        let [x, y] = [at % CANVAS[0], at / CANVAS[0]];
        (240..540).contains(&x) && (160..360).contains(&y)
    });
    let mut all: Vec<f64> = middle.map(|(_, (a, b))| (a - b).abs()).collect();
    all.sort_by(f64::total_cmp);
    [all.iter().sum::<f64>() / all.len() as f64, all[all.len() * 99 / 100]]
}

#[test]
fn eyes_all_over_the_lens_see_as_much() {
    let card =
        |z: f64, x: f64, side: [f32; 2], light: f32| (DVec3::new(x, 0.2, z), side, glowing(light));
    let far = || grid(60.0, 5.0);
    let sharp = card(-10.0, -1.2, [1.2, 1.5], 0.9);
    let near = card(-4.0, 0.9, [0.5, 0.9], 0.7);
    let before_far: Vec<_> = far().into_iter().chain([sharp.clone()]).collect();
    let over_sharp: Vec<_> = grid(10.0, 0.9).into_iter().chain([near.clone()]).collect();
    let all: Vec<_> = far().into_iter().chain([sharp, near]).collect();
    for (name, of) in [
        ("far", far()),
        ("sharp before far", before_far),
        ("near before sharp", over_sharp),
        ("all", all),
    ] {
        let scene = cards(&of);
        for aperture in [0.1, 0.3] {
            let lens = DepthOfField { focus: FOCUS, aperture };
            let wanted = through_lens(&scene, lens, 64);
            let found = errors(&lights(&scene, 4, &view(Some(lens))), &wanted);
            let sharp = errors(&lights(&scene, 4, &view(None)), &wanted);
            println!("{name}, aperture {aperture}: {found:.4?}, without any {sharp:.4?}");
            // Edges in focus have 4 samples here, and those of 64 eyes there: 0.003.
            assert!(found[0] < 0.4 * sharp[0] + 0.003, "{name}: {found:?} of {sharp:?}");
        }
    }
}

/// The light around a point in a scene of one far light, and how wide it is: its standard
/// deviation in radians along two directions at right angles.
fn disc(toward: DVec3, depth_of_field: Option<DepthOfField>) -> (f64, [f64; 2]) {
    let mut stage = SceneFixture::new();
    (stage.desc.sky, stage.ground) = (Vec3::ZERO, Some(Vec3::ZERO));
    let material = stage.material(glowing(1.0));
    let card = stage.mesh(&MeshFixture::rectangle(1.0, 1.0), Some(material));
    let turn = DQuat::from_rotation_arc(DVec3::Z, -toward.normalize());
    stage.node(card, DAffine3::from_rotation_translation(turn, toward.normalize() * 200.0));
    let scene = stage.build();
    let seen = view(depth_of_field);
    let light = lights(&scene, 4, &seen);
    let [right, up] = {
        let toward = toward.normalize();
        // Radially, as seen in the picture, and across that.
        let right = toward.cross(DVec3::Z).normalize();
        [right, toward.cross(right)]
    };
    let (mut sum, mut squares) = (0.0, [0.0; 2]);
    for (at, light) in (0u32..).zip(&light) {
        let [x, y] = [at % CANVAS[0], at / CANVAS[0]].map(|at| f64::from(at) + 0.5);
        let across = (x / f64::from(CANVAS[0]) * 2.0 - 1.0) / seen.clip_from_view.x_axis.x;
        let along = (1.0 - y / f64::from(CANVAS[1]) * 2.0) / seen.clip_from_view.y_axis.y;
        let ray = DVec3::new(across, along, -1.0);
        // The solid angle of a pixel falls with the cube of the ray's length.
        let weight = light / ray.length().powi(3);
        let ray = ray.normalize();
        sum += weight;
        squares[0] += weight * ray.dot(right).powi(2);
        squares[1] += weight * ray.dot(up).powi(2);
    }
    (sum, squares.map(|of| (of / sum).sqrt()))
}

#[test]
fn a_far_light_is_a_disc_of_the_same_angle_wherever_it_is_seen() {
    let aperture = 0.4;
    // A disc's deviation is half of its radius, the card's own 0.58 of its half side.
    let radius = 0.5 * f64::from(aperture) * (0.1 - 1.0 / 200.0);
    let wanted = ((radius / 2.0).powi(2) + (1.0f64 / 200.0).powi(2) / 3.0).sqrt();
    for toward in
        [DVec3::new(0.01, 0.0, -1.0), DVec3::new(0.65, 0.0, -1.0), DVec3::new(-0.5, 0.4, -1.0)]
    {
        let (plain, _) = disc(toward, None);
        let (light, width) = disc(toward, Some(lens(aperture)));
        println!("{toward}: {light:.5} of {plain:.5}, {width:.5?} wide of {wanted:.5}");
        assert!((light / plain - 1.0).abs() < 0.1, "{light} of {plain}");
        assert!(width.iter().all(|of| (of / wanted - 1.0).abs() < 0.1), "{width:?} of {wanted}");
    }
}

#[test]
fn what_is_in_focus_and_a_lens_without_width_keep_every_pixel() {
    // On a sphere around the eye.
    let turned = |x: f64| DQuat::from_rotation_y(x) * DVec3::NEG_Z * f64::from(FOCUS);
    let of = [-0.4, -0.1, 0.2].map(|x| (turned(x), [0.2, 0.6], glowing(0.6)));
    let scene = cards(&of);
    let plain = draw(&scene, CANVAS, &view(None));
    assert_eq!(differences(&draw(&scene, CANVAS, &view(Some(lens(0.05)))), &plain)[1], 0);
    let far = cards(&grid(60.0, 5.0));
    let plain = draw(&far, CANVAS, &view(None));
    assert_eq!(differences(&draw(&far, CANVAS, &view(Some(lens(1e-4)))), &plain)[1], 0);
    assert!(differences(&draw(&far, CANVAS, &view(Some(lens(0.2)))), &plain)[2] > 10_000);
}

#[test]
fn tiles_agree_with_one_camera_where_discs_cross_borders() {
    let beside = (DVec3::new(-2.45, 0.5, -4.0), [0.3, 0.8], glowing(0.9));
    let across = (DVec3::new(0.1, 0.1, -4.0), [0.3, 0.4], glowing(0.5));
    let of: Vec<_> = grid(60.0, 5.0).into_iter().chain([beside, across]).collect();
    let scene = cards(&of);
    let blurred = view(Some(lens(0.4)));
    for samples in [1, 4] {
        let whole = draw_sampled(&scene, CANVAS, samples, std::slice::from_ref(&blurred)).0;
        let mut total = [0; 3];
        for [x, y, width, height] in
            [[0, 0, 391, 253], [391, 0, 389, 253], [0, 253, 391, 267], [391, 253, 389, 267]]
        {
            let viewport = [-f64::from(x), -f64::from(y), 780.0, 520.0];
            let tile = ViewDesc { viewport, ..blurred.clone() };
            let tile = draw_sampled(&scene, [width, height], samples, &[tile]).0;
            let places = (y..y + height).flat_map(|row| (x..x + width).map(move |at| (at, row)));
            let wanted: Vec<_> =
                places.map(|(column, row)| pixel(&whole, CANVAS, column, row)).collect();
            for (sum, count) in total.iter_mut().zip(differences(&tile, &wanted)) {
                *sum += count;
            }
        }
        println!("depth of field ×{samples}: {total:?} of {}", whole.len());
        // 159 by a software driver; 1,052 by an H200, which filters with fractions of 1/256.
        assert!(total[0] * 200 <= whole.len() && total[1] == 0, "{total:?}");
    }
}

#[test]
fn glass_and_unlit_colours_are_blurred_as_what_they_are() {
    let clear = Transmission { factor: 1.0, texture: None };
    let extensions = MaterialExtensions { transmission: Some(clear), ..Default::default() };
    let extensions = Some(Box::new(extensions));
    // Red glass before a light.
    let glass = Material { extensions, ..matt(1.0, 0.0, 0.0) };
    let lamp = (DVec3::new(0.0, 0.0, -40.0), [30.0, 30.0], glowing(0.5));
    let pane = (DVec3::new(0.0, 0.0, -4.0), [0.6, 0.6], glass);
    let scene = cards(&[lamp, pane]);
    let at = |of| pixel(&draw(&scene, CANVAS, &view(of)), CANVAS, 390, 260);
    let [sharp, blurred] = [at(None), at(Some(lens(0.3)))];
    assert!(sharp[0] > 4 * sharp[1].max(10), "{sharp:?}");
    assert!(sharp.iter().zip(blurred).all(|(a, b)| a.abs_diff(b) <= 2), "{sharp:?}, {blurred:?}");
    // The tone mapper never shows this colour.
    let unlit = Material { unlit: true, ..matt(1.0, 0.0, 0.0) };
    let scene = cards(&[(DVec3::new(0.0, 0.0, -40.0), [9.0, 9.0], unlit)]);
    let neutral = ViewDesc { tone: ToneMapper::Neutral, ..view(Some(lens(0.3))) };
    let shown = draw(&scene, CANVAS, &neutral);
    assert_eq!(pixel(&shown, CANVAS, 390, 260)[..3], [255, 0, 0]);
    let edges = (0..CANVAS[0]).filter(|x| (1..254).contains(&pixel(&shown, CANVAS, *x, 260)[0]));
    assert!(edges.count() > 8, "its edge is sharp");
}

#[test]
fn blurred_corners_are_as_dark_as_sharp_ones() {
    let mut stage = SceneFixture::new();
    (stage.desc.sky, stage.ground) = (Vec3::ONE, Some(Vec3::ONE));
    let material = stage.material(matt(0.7, 0.7, 0.7));
    let wall = stage.mesh(&MeshFixture::rectangle(8.0, 8.0), Some(material));
    for turn in [-0.8, 0.8] {
        let turn = DQuat::from_rotation_y(turn);
        let at = DVec3::new(0.0, 0.0, -20.0) - turn * DVec3::X * (turn.y.signum() * 8.0);
        stage.node(wall, DAffine3::from_rotation_translation(turn, at));
    }
    let scene = stage.build();
    let occluded = ViewDesc {
        ambient_occlusion: Some(AmbientOcclusion { radius: 2.0 }),
        ..view(Some(lens(0.3)))
    };
    let sum = |view: &ViewDesc| lights(&scene, 1, view).iter().sum::<f64>();
    let sharp = sum(&ViewDesc { depth_of_field: None, ..occluded.clone() });
    let plain = sum(&ViewDesc { ambient_occlusion: None, ..occluded.clone() });
    let found = sum(&occluded);
    println!("{found} of {sharp}, {plain} without occlusion");
    assert!(plain > 1.003 * sharp, "{plain}, {sharp}");
    assert!((found / sharp - 1.0).abs() < 0.1 * (plain / sharp - 1.0), "{found} of {sharp}");
}

#[test]
fn views_of_any_number_are_blurred_as_one_is() {
    let scene = cards(&grid(60.0, 5.0));
    let part = |at: u32| ViewDesc {
        scissor: Some([at % 10 * 78, at / 10 * 52, 78, 52]),
        ..view(Some(lens(0.3)))
    };
    let views: Vec<ViewDesc> = (0..100).map(part).collect();
    let wanted = draw_sampled(&scene, CANVAS, 4, &[view(Some(lens(0.3)))]).0;
    let found = draw_sampled(&scene, CANVAS, 4, &views).0;
    let [differing, more, _] = differences(&found, &wanted);
    // None by a software driver; 18,199 by an H200, which filters with fractions of 1/256.
    assert!(differing * 20 <= wanted.len() && more == 0, "{differing}, {more}");
}

#[test]
fn plans_are_sharp_and_numbers_that_no_lens_has_are_refused() {
    let scene = cards(&grid(60.0, 5.0));
    let mut renderer = Renderer::new(gpu(), 1).unwrap();
    renderer.prepare(gpu(), &scene);
    let mut target = Target::new(gpu(), CANVAS, 1, true).unwrap();
    let wrong = view(Some(lens(0.0)));
    let error = renderer.draw(gpu(), &scene, &mut target, &[wrong]).unwrap_err();
    assert!(error.to_string().contains("aperture"), "{error}");
    let mut flat = view(Some(lens(0.3)));
    flat.clip_from_view = glam::DMat4::from_scale(DVec3::new(0.02, 0.03, -0.01));
    renderer.draw(gpu(), &scene, &mut target, std::slice::from_ref(&flat)).unwrap();
    assert!(!renderer.frames.has_discs());
    let shown = read_pixels(gpu(), &target).unwrap();
    let plain = draw(&scene, CANVAS, &ViewDesc { depth_of_field: None, ..flat });
    assert_eq!(differences(shown.as_chunks::<4>().0, &plain)[1], 0);
    // Without it nothing is made, and what was blurred is sharp again.
    renderer.draw(gpu(), &scene, &mut target, &[view(Some(lens(0.3)))]).unwrap();
    renderer.draw(gpu(), &scene, &mut target, &[view(None)]).unwrap();
    let shown = read_pixels(gpu(), &target).unwrap();
    let plain = draw(&scene, CANVAS, &view(None));
    assert_eq!(differences(shown.as_chunks::<4>().0, &plain)[1], 0);
}
