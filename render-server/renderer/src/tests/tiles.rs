//! A wall's tiles against the picture of one camera, as tabled in the design of walls.

use glam::{Affine2, DAffine3, DQuat, DVec3, Vec3};
use polyptych_scene::{
    AlphaMode, Anisotropy, DiffuseTransmission, Iridescence, Light, LightKind, Material,
    MaterialExtensions, TextureRef,
};

use super::harness::{
    MeshFixture, SceneFixture, differences, draw, draw_sampled, look, matt, pixel,
};
use crate::{GpuScene, ViewDesc};

const CANVAS: [u32; 2] = [384, 256];
const TILE: [u32; 2] = [192, 128];

/// Textured spheres on a textured floor that passes behind the eye, and a pane.
fn scene(place: DVec3, alpha_mode: AlphaMode) -> GpuScene {
    let mut stage = SceneFixture::new();
    let texture = stage.checkers(64, true);
    let normals = stage.checkers(64, false);
    let with = |texture| TextureRef { texture, uv_set: 0, uv_transform: Affine2::IDENTITY };
    let checkered = stage.material(Material {
        base_color_texture: Some(with(texture)),
        normal_texture: Some(with(normals)),
        roughness: 0.4,
        ..matt(1.0, 1.0, 1.0)
    });
    let pane = stage.material(Material {
        base_color: glam::Vec4::new(0.9, 0.3, 0.2, 0.4),
        double_sided: true,
        alpha_mode,
        ..matt(1.0, 1.0, 1.0)
    });
    let sphere = stage.mesh(&MeshFixture::sphere(24), Some(checkered));
    let floor = stage.mesh(&MeshFixture::rectangle(60.0, 60.0), Some(checkered));
    let glass = stage.mesh(&MeshFixture::rectangle(1.0, 1.0), Some(pane));
    let flat = DAffine3::from_rotation_x(-std::f64::consts::FRAC_PI_2);
    let at = |offset: DVec3| DAffine3::from_translation(place + offset);
    stage.node(floor, at(-DVec3::Y) * flat);
    for x in -1..=1 {
        stage.node(sphere, at(DVec3::new(f64::from(x) * 2.2, 0.0, -3.0)));
    }
    stage.node(glass, at(DVec3::new(0.4, 0.2, -1.0)));
    stage.build()
}

fn crop(whole: &[[u8; 4]], [x, y]: [u32; 2]) -> Vec<[u8; 4]> {
    (0..TILE[1])
        .flat_map(|row| (0..TILE[0]).map(move |column| (x + column, y + row)))
        .map(|(x, y)| pixel(whole, CANVAS, x, y))
        .collect()
}

fn tiles() -> [[u32; 2]; 4] {
    [[0, 0], [192, 0], [0, 128], [192, 128]]
}

fn view(place: DVec3) -> ViewDesc {
    look(place + DVec3::new(0.3, 0.6, 1.5), place + DVec3::new(0.0, 0.0, -3.0), CANVAS)
}

/// Brushed, iridescent and translucent balls over a floor, lit from before and behind.
fn extended_scene() -> GpuScene {
    let mut stage = SceneFixture::new();
    let normals = stage.checkers(64, false);
    let normals = TextureRef { texture: normals, uv_set: 0, uv_transform: Affine2::IDENTITY };
    let brushed = MaterialExtensions {
        anisotropy: Some(Anisotropy { strength: 0.8, rotation_rad: 0.4, texture: None }),
        ..MaterialExtensions::default()
    };
    let filmy = MaterialExtensions {
        iridescence: Some(Iridescence { factor: 1.0, ior: 1.6, ..Iridescence::default() }),
        ..MaterialExtensions::default()
    };
    let translucent = MaterialExtensions {
        diffuse_transmission: Some(DiffuseTransmission {
            factor: 0.7,
            color: Vec3::new(0.9, 0.6, 0.2),
            ..DiffuseTransmission::default()
        }),
        ..MaterialExtensions::default()
    };
    for (x, of, metallic) in [(-1.0, brushed, 1.0), (0.0, filmy, 0.5), (1.0, translucent, 0.0)] {
        let material = stage.material(Material {
            normal_texture: Some(normals),
            normal_scale: 0.3,
            roughness: 0.4,
            metallic,
            extensions: Some(Box::new(of)),
            ..matt(0.9, 0.8, 0.7)
        });
        let ball = stage.mesh(&MeshFixture::sphere(24), Some(material));
        stage.node(ball, DAffine3::from_translation(DVec3::new(x * 2.2, 0.0, -3.0)));
    }
    let floor = stage.material(matt(0.5, 0.5, 0.5));
    let floor = stage.mesh(&MeshFixture::rectangle(60.0, 60.0), Some(floor));
    let flat = DAffine3::from_rotation_x(-std::f64::consts::FRAC_PI_2);
    stage.node(floor, DAffine3::from_translation(-DVec3::Y) * flat);
    for (toward, intensity) in
        [(DVec3::new(0.4, 0.7, 0.6), 2.0), (DVec3::new(-0.3, 0.5, -0.8), 2.0)]
    {
        let kind = LightKind::Directional;
        let light = Light { kind, color: Vec3::ONE, intensity, range: None };
        let along = DQuat::from_rotation_arc(DVec3::NEG_Z, -toward.normalize());
        stage.light(light, DAffine3::from_quat(along));
    }
    stage.build()
}

fn check_tiles(alpha_mode: AlphaMode, samples: u32) {
    let name = format!("{alpha_mode:?}");
    check_tiles_of(&scene(DVec3::ZERO, alpha_mode), &name, samples);
}

fn check_tiles_of(scene: &GpuScene, name: &str, samples: u32) {
    let view = view(DVec3::ZERO);
    let whole = draw_sampled(scene, CANVAS, samples, std::slice::from_ref(&view)).0;
    let mut total = [0; 3];
    for [x, y] in tiles() {
        let shifted = ViewDesc {
            viewport: [-f64::from(x), -f64::from(y), f64::from(CANVAS[0]), f64::from(CANVAS[1])],
            ..view.clone()
        };
        let tile = draw_sampled(scene, TILE, samples, &[shifted]).0;
        for (sum, count) in total.iter_mut().zip(differences(&tile, &crop(&whole, [x, y]))) {
            *sum += count;
        }
        let oracle = ViewDesc { scissor: Some([x, y, TILE[0], TILE[1]]), ..view.clone() };
        let oracle = draw_sampled(scene, CANVAS, samples, &[oracle]).0;
        let counts = differences(&crop(&oracle, [x, y]), &crop(&whole, [x, y]));
        assert_eq!(counts, [0; 3], "the scissor oracle differs at {x}, {y}");
    }
    let pixels = whole.len();
    println!("{name} ×{samples}: {total:?} of {pixels}");
    assert!(total[0] * 200 <= pixels, "{} of {pixels} differ: more than 0.5 %", total[0]);
    assert!(total[1] * 10_000 <= pixels, "{} of {pixels} differ by more than 1", total[1]);
}

#[test]
fn shifted_viewports_agree_with_one_camera() {
    check_tiles(AlphaMode::Opaque, 1);
}

#[test]
fn shifted_viewports_agree_where_the_scene_blends() {
    check_tiles(AlphaMode::Blend, 1);
}

#[test]
fn shifted_viewports_agree_with_four_samples() {
    check_tiles(AlphaMode::Opaque, 4);
    check_tiles(AlphaMode::Blend, 4);
}

#[test]
fn shifted_viewports_agree_where_materials_have_extensions() {
    check_tiles_of(&extended_scene(), "extended", 1);
    check_tiles_of(&extended_scene(), "extended", 4);
}

#[test]
fn several_views_share_one_target() {
    let (scene, view) = (scene(DVec3::ZERO, AlphaMode::Blend), view(DVec3::ZERO));
    let whole = draw(&scene, CANVAS, &view);
    let halves = [[0, 0, 192, 256], [192, 0, 192, 256]]
        .map(|scissor| ViewDesc { scissor: Some(scissor), ..view.clone() });
    let (both, stats) = draw_sampled(&scene, CANVAS, 1, &halves);
    assert_eq!(differences(&both, &whole), [0; 3]);
    assert!(stats.draw_calls >= 6, "{stats:?}");
}

#[test]
fn a_channel_of_one_pixel_shows_its_pixel() {
    let (scene, view) = (scene(DVec3::ZERO, AlphaMode::Blend), view(DVec3::ZERO));
    let whole = draw(&scene, CANVAS, &view);
    for [x, y] in [[0, 0], [100, 60], [200, 140], [382, 254]] {
        let viewport = [-f64::from(x), -f64::from(y), f64::from(CANVAS[0]), f64::from(CANVAS[1])];
        let one = draw(&scene, [1, 1], &ViewDesc { viewport, ..view.clone() });
        let most = one[0].iter().zip(pixel(&whole, CANVAS, x, y)).map(|(a, b)| a.abs_diff(b)).max();
        assert!(most <= Some(2), "pixel {x}, {y}: {most:?} levels off");
    }
}

#[test]
fn a_scene_far_from_the_origin_looks_the_same() {
    let near = draw(&scene(DVec3::ZERO, AlphaMode::Opaque), CANVAS, &view(DVec3::ZERO));
    let place = DVec3::new(1e7, -2.5e6, 0.75e7);
    let far = draw(&scene(place, AlphaMode::Opaque), CANVAS, &view(place));
    let [_, more_than_1, more_than_8] = differences(&near, &far);
    println!("1e7 m: {:?}", differences(&near, &far));
    assert!(more_than_1 * 1000 <= near.len(), "{more_than_1} differ by more than 1 level");
    assert!(more_than_8 * 10_000 <= near.len(), "{more_than_8} differ by more than 8 levels");
}

#[test]
fn a_triangle_through_all_channels_and_behind_the_eye_has_no_gap() {
    let mut stage = SceneFixture::new();
    let red = stage.material(Material { unlit: true, ..matt(1.0, 0.0, 0.0) });
    let corners = [
        Vec3::new(-500.0, -1.0, -500.0),
        Vec3::new(0.0, -1.0, 400.0),
        Vec3::new(500.0, -1.0, -500.0),
    ];
    let mesh = stage.mesh(&MeshFixture::triangle(corners, Vec3::Y), Some(red));
    stage.node(mesh, DAffine3::IDENTITY);
    let scene = stage.build();
    let view = look(DVec3::new(0.0, 0.0, 1.0), DVec3::new(0.0, -0.3, 0.0), CANVAS);
    let whole = draw(&scene, CANVAS, &view);
    for x in 0..CANVAS[0] {
        let [r, g, b, _] = pixel(&whole, CANVAS, x, 255);
        assert!(r > 200 && g < 60 && b < 60, "bottom at {x}: {r} {g} {b}");
    }
    for [x, y] in tiles() {
        let viewport = [-f64::from(x), -f64::from(y), f64::from(CANVAS[0]), f64::from(CANVAS[1])];
        let tile = draw(&scene, TILE, &ViewDesc { viewport, ..view.clone() });
        assert!(differences(&tile, &crop(&whole, [x, y]))[0] <= 4, "tile at {x}, {y}");
    }
}
