//! Fog: each pixel against the formula in f64, on all kinds of surfaces and behind them, and
//! without a seam.

use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

use glam::{DAffine3, DVec3, Vec3};
use polyptych_scene::{AlphaMode, Fog, Material, ToneMapper};

use super::environment::uniform;
use super::harness::{MeshFixture, SceneFixture, differences, draw, gpu, look, matt, pixel};
use crate::tone::linear_from_srgb;
use crate::{Environment, GpuScene, ViewDesc};

const SIZE: [u32; 2] = [96, 64];
const SKY: Vec3 = Vec3::new(0.5, 0.6, 0.8);
const GROUND: Vec3 = Vec3::new(0.3, 0.2, 0.1);

/// A wall of 60 × 60 in the plane z = 0, matt or of a colour as it is; above all is the sky.
fn wall(is_unlit: bool, has_pane: bool) -> GpuScene {
    let mut stage = SceneFixture::new();
    (stage.desc.sky, stage.ground) = (SKY, Some(GROUND));
    let of = Material { unlit: is_unlit, ..matt(0.5, 0.3, 0.1) };
    let material = stage.material(of);
    let wall = stage.mesh(&MeshFixture::rectangle(30.0, 30.0), Some(material));
    stage.node(wall, DAffine3::IDENTITY);
    if has_pane {
        // Behind the eye: all is drawn into a float target for its sake.
        let pane = Material { alpha_mode: AlphaMode::Blend, ..matt(1.0, 1.0, 1.0) };
        let pane = stage.material(pane);
        let pane = stage.mesh(&MeshFixture::rectangle(1.0, 1.0), Some(pane));
        stage.node(pane, DAffine3::from_translation(DVec3::Z * 500.0));
    }
    stage.build()
}

fn view(eye: DVec3, fog: Option<Fog>) -> ViewDesc {
    let at = DVec3::new(0.0, 20.0, 0.0);
    ViewDesc { fog, tone: ToneMapper::None, ..look(eye, at, SIZE) }
}

/// The point that a pixel's ray meets; the sky is met very far away.
fn met(view: &ViewDesc, [x, y]: [u32; 2]) -> DVec3 {
    // By hand: 60° of field, as `look` has it.
    let half = 30f64.to_radians().tan();
    let up = (1.0 - (f64::from(y) + 0.5) / 32.0) * half;
    let right = ((f64::from(x) + 0.5) / 48.0 - 1.0) * half * 1.5;
    let ray = view.view_from_world.transpose() * DVec3::new(right, up, -1.0);
    let eye = view.eye_in_world;
    let at = eye - ray * (eye.z / ray.z);
    let is_wall = ray.z < 0.0 && at.x.abs() < 30.0 && at.y.abs() < 30.0;
    if is_wall { at } else { eye + ray.normalize() * 1e12 }
}

fn light(pixels: &[[u8; 4]], [x, y]: [u32; 2]) -> DVec3 {
    let [r, g, b, _] = pixel(pixels, SIZE, x, y).map(linear_from_srgb);
    DVec3::new(r, g, b)
}

/// The largest error of a picture, in linear light.
fn error(scene: &GpuScene, eye: DVec3, fog: Fog, around: Vec3) -> f64 {
    let foggy = view(eye, Some(fog));
    let [clear, shown] = [view(eye, None), foggy.clone()].map(|view| draw(scene, SIZE, &view));
    // Light from one direction is scattered into all, which are 4π.
    let suns: DVec3 = scene.suns().iter().map(|sun| sun.irradiance.as_dvec3()).sum();
    let glow = Vec3::from(fog.color).as_dvec3() * (around.as_dvec3() + suns / (4.0 * PI));
    let places = (0..SIZE[0]).step_by(5).flat_map(|x| (0..SIZE[1]).step_by(3).map(move |y| [x, y]));
    let error = |at: [u32; 2]| {
        let passed = fog.passed(eye, met(&foggy, at));
        let wanted = glow.lerp(light(&clear, at), passed);
        (light(&shown, at) - wanted).abs().max_element()
    };
    places.map(error).fold(0.0, f64::max)
}

fn fogs() -> [Fog; 4] {
    [
        Fog::even(120.0),
        Fog { color: [0.9, 0.5, 0.2], ..Fog::even(60.0) },
        // A layer whose upper side the eye sees, and one that lies far below.
        Fog { height: -10.0, half_height: Some(6.0), ..Fog::even(20.0) },
        Fog { height: -4000.0, half_height: Some(20.0), ..Fog::even(1.0) },
    ]
}

#[test]
fn each_pixel_has_the_light_that_passes_and_the_light_of_the_fog() {
    let around = (SKY + GROUND) * 0.5;
    for (is_unlit, has_pane) in [(false, false), (true, false), (false, true), (true, true)] {
        let scene = wall(is_unlit, has_pane);
        for fog in fogs() {
            for eye in [DVec3::new(5.0, 12.0, 40.0), DVec3::new(-3.0, 20.0, 70.0)] {
                let error = error(&scene, eye, fog, around);
                // One code of 255 is 0.009 where it is brightest.
                assert!(error < 0.009, "{error}: unlit {is_unlit}, pane {has_pane}, {fog:?}");
            }
        }
    }
}

#[test]
fn ground_under_a_thin_layer_is_seen_from_any_height() {
    let mut stage = SceneFixture::new();
    (stage.desc.sky, stage.ground) = (SKY, Some(GROUND));
    let material = stage.material(Material { unlit: true, ..matt(0.5, 0.3, 0.1) });
    let ground = stage.mesh(&MeshFixture::rectangle(1e5, 1e5), Some(material));
    stage.node(ground, DAffine3::from_rotation_x(-FRAC_PI_2));
    let scene = stage.build();
    let fog = Fog { half_height: Some(2.0), ..Fog::even(500.0) };
    let glow = ((SKY + GROUND) * 0.5).as_dvec3();
    // At 30 km the density at the eye is e to the power of -10,400.
    for height in [100.0, 20e3, 30e3, 200e3] {
        let (eye, at) = (DVec3::new(0.0, height, height), DVec3::ZERO);
        let clear = ViewDesc { tone: ToneMapper::None, ..look(eye, at, SIZE) };
        let foggy = ViewDesc { fog: Some(fog), ..clear.clone() };
        let [clear, shown] = [clear, foggy].map(|view| draw(&scene, SIZE, &view));
        let middle = [SIZE[0] / 2, SIZE[1] / 2];
        let wanted = glow.lerp(light(&clear, middle), fog.passed(eye, at));
        let error = (light(&shown, middle) - wanted).abs().max_element();
        assert!(error < 0.009, "{error} from {height}");
    }
}

#[test]
fn fog_shines_with_the_light_of_its_surroundings() {
    let around = Vec3::new(0.2, 0.7, 0.4);
    let map = uniform(around.to_array().map(f64::from));
    let scene = wall(false, false).with_environment(Some(Arc::new(Environment::new(gpu(), &map))));
    for fog in fogs() {
        let error = error(&scene, DVec3::new(5.0, 12.0, 40.0), fog, around);
        assert!(error < 0.009, "{error}: {fog:?}");
    }
}

#[test]
fn tiles_show_the_same_fog_and_without_fog_nothing_is_changed() {
    let scene = wall(false, false);
    let eye = DVec3::new(5.0, 12.0, 40.0);
    let clear = draw(&scene, SIZE, &view(eye, None));
    for fog in fogs() {
        let whole = view(eye, Some(fog));
        let expected = draw(&scene, SIZE, &whole);
        assert_ne!(expected, clear);
        for x in [0u32, 48] {
            let viewport = [-f64::from(x), 0.0, f64::from(SIZE[0]), f64::from(SIZE[1])];
            let tile = draw(&scene, [48, 64], &ViewDesc { viewport, ..whole.clone() });
            let rows = expected.chunks_exact(96);
            let of_whole: Vec<_> = rows.flat_map(|row| &row[x as usize..][..48]).copied().collect();
            // Varyings are rounded from where a tile begins: a code may tip over.
            let [differing, above_1, _] = differences(&tile, &of_whole);
            assert_eq!(above_1, 0, "tile at {x}, {fog:?}");
            assert!(
                differing as f64 <= 0.005 * of_whole.len() as f64,
                "{differing} at {x}, {fog:?}"
            );
        }
    }
    assert_eq!(draw(&scene, SIZE, &view(eye, None)), clear);
}
