//! Light and colour: what materials, lamps and the last step to the display do.

use glam::{Affine2, DAffine3, DVec3, Vec3, Vec4};
use polyptych_scene::{AlphaMode, Light, LightKind, Material, TextureRef, ToneMapper};

use super::harness::{MeshFixture, SceneFixture, draw, draw_sampled, gpu, look, matt, pixel};
use crate::{GpuScene, PresentPass, Target, ViewDesc, idle, read_picture, read_pixels};

const SIZE: [u32; 2] = [64, 64];

fn flat(color: Vec4) -> Material {
    Material { base_color: color, unlit: true, ..Material::default() }
}

/// A wall of 2 × 2 m at z = 0, under the lamps, without ambient light.
fn wall(material: Material, lamps: &[(Light, DVec3)]) -> GpuScene {
    let mut stage = SceneFixture::new();
    stage.desc.sky = Vec3::ZERO;
    let material = stage.material(material);
    let mesh = stage.mesh(&MeshFixture::rectangle(1.0, 1.0), Some(material));
    stage.node(mesh, DAffine3::IDENTITY);
    for (lamp, place) in lamps {
        stage.light(lamp.clone(), DAffine3::from_translation(*place));
    }
    stage.build()
}

fn middle(scene: &GpuScene) -> [u8; 4] {
    let view = look(DVec3::Z * 3.0, DVec3::ZERO, SIZE);
    pixel(&draw(scene, SIZE, &view), SIZE, 32, 32)
}

fn lamp(kind: LightKind, intensity: f32, range: Option<f32>) -> Light {
    Light { kind, color: Vec3::ONE, intensity, range }
}

/// Returns the display's code for a grey of this linear light.
fn shown(light: f32) -> u8 {
    let v = crate::tone::tone_map(ToneMapper::Neutral, Vec3::splat(light)).x;
    let curved = if v <= 0.0031308 { v * 12.92 } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    (curved * 255.0).round() as u8
}

fn assert_grey(got: [u8; 4], light: f32) {
    let wanted = shown(light);
    assert!(got[..3].iter().all(|c| c.abs_diff(wanted) <= 1), "{got:?} instead of {wanted}");
}

/// The glTF BRDF at normal incidence and view, over π: Lambert under Fresnel, and the highlight.
fn brdf_head_on(base: f32, roughness: f32) -> f32 {
    let a2 = roughness.powi(4);
    let specular = 0.5 * a2 / (a2 * a2 * 2.0);
    (base * 0.96 + 0.04 * specular) / std::f32::consts::PI
}

#[test]
fn emitted_greys_go_through_the_curve() {
    for light in [0.02, 0.2, 0.5, 1.0, 4.0] {
        let glowing = Material { emissive: Vec3::splat(light), ..matt(0.0, 0.0, 0.0) };
        let dark = lamp(LightKind::Directional, 0.0, None);
        assert_grey(middle(&wall(glowing, &[(dark, DVec3::ZERO)])), light);
    }
}

#[test]
fn lux_and_candela_match_the_formula() {
    for roughness in [0.5, 1.0] {
        let material = Material { roughness, ..matt(0.5, 0.5, 0.5) };
        let wanted = brdf_head_on(0.5, roughness);
        let sun = lamp(LightKind::Directional, 1.5, None);
        assert_grey(middle(&wall(material.clone(), &[(sun.clone(), DVec3::ZERO)])), 1.5 * wanted);
        let point = lamp(LightKind::Point, 6.0, None);
        let at = |z: f64| DVec3::Z * z;
        assert_grey(middle(&wall(material.clone(), &[(point, at(2.0))])), 6.0 / 4.0 * wanted);
        // More suns than the uniforms hold: the rest are looked up.
        let five = vec![(lamp(LightKind::Directional, 0.3, None), DVec3::ZERO); 5];
        assert_grey(middle(&wall(material, &five)), 1.5 * wanted);
    }
}

#[test]
fn lamps_end_at_their_range_and_cone() {
    let white = matt(0.8, 0.8, 0.8);
    let light = |kind, range| {
        middle(&wall(white.clone(), &[(lamp(kind, 4.0, range), DVec3::new(0.0, 0.0, 1.0))]))
    };
    assert_eq!(light(LightKind::Point, Some(0.99))[0], 0, "beyond the range");
    let windowed = brdf_head_on(0.8, 1.0) * 4.0 * (1.0 - 1.0 / 16.0);
    assert_grey(light(LightKind::Point, Some(2.0)), windowed);
    let spot = LightKind::Spot { inner_rad: 0.2, outer_rad: 0.4 };
    assert_grey(light(spot, None), brdf_head_on(0.8, 1.0) * 4.0);
    let scene = wall(white.clone(), &[(lamp(spot, 4.0, None), DVec3::Z)]);
    let view = look(DVec3::Z * 3.0, DVec3::ZERO, SIZE);
    let beside = pixel(&draw(&scene, SIZE, &view), SIZE, 32 + 12, 32);
    assert_eq!(beside[0], 0, "outside the cone");
}

#[test]
fn each_item_loops_over_the_lamps_that_reach_it() {
    let mut stage = SceneFixture::new();
    let mesh = stage.mesh(&MeshFixture::rectangle(0.4, 0.4), None);
    for x in 0..4 {
        let place = DAffine3::from_translation(DVec3::X * f64::from(x * 10));
        stage.node(mesh, place);
        stage.light(lamp(LightKind::Point, 1.0, Some(3.0)), place);
    }
    stage.light(lamp(LightKind::Point, 1.0, None), DAffine3::IDENTITY);
    let scene = stage.build();
    let counts: Vec<u32> = scene.layout.items.iter().map(|item| item.lamps[1]).collect();
    assert_eq!(counts, [2; 4]);
}

#[test]
fn masks_cut_and_double_sides_turn() {
    let mut stage = SceneFixture::new();
    let cut = stage.material(Material {
        alpha_mode: AlphaMode::Mask(0.5),
        ..flat(Vec4::new(1.0, 1.0, 1.0, 0.4))
    });
    let both = stage.material(Material { double_sided: true, ..matt(1.0, 1.0, 1.0) });
    let one = stage.material(matt(1.0, 1.0, 1.0));
    let meshes = [cut, both, one].map(|m| stage.mesh(&MeshFixture::rectangle(1.0, 1.0), Some(m)));
    for (mesh, x) in meshes.into_iter().zip([-3.0, 0.0, 3.0]) {
        stage.node(mesh, DAffine3::from_translation(DVec3::X * x));
    }
    let scene = stage.build();
    let size = [192, 64];
    let front = draw(&scene, size, &look(DVec3::Z * 4.0, DVec3::ZERO, size));
    let back = draw(&scene, size, &look(DVec3::Z * -4.0, DVec3::ZERO, size));
    let sky = front[0];
    assert_eq!(pixel(&front, size, 55, 32), sky, "the mask cuts");
    assert_ne!(pixel(&front, size, 96, 32), sky);
    assert_ne!(pixel(&front, size, 137, 32), sky);
    assert_ne!(pixel(&back, size, 96, 32), sky, "both sides show");
    assert_eq!(pixel(&back, size, 55, 32), sky, "one side shows");
}

#[test]
fn metals_are_not_black_without_lamps_in_sight() {
    let mut stage = SceneFixture::new();
    let metal = stage.material(Material { roughness: 0.2, ..Material::default() });
    let sphere = stage.mesh(&MeshFixture::sphere(24), Some(metal));
    stage.node(sphere, DAffine3::IDENTITY);
    let pixels = draw(&stage.build(), SIZE, &look(DVec3::Z * 2.5, DVec3::ZERO, SIZE));
    assert!(pixels.iter().all(|p| p[0] > 40 && p[2] > 40), "something is black");
}

#[test]
fn the_sky_is_one_colour_whoever_fills_it() {
    for sky in [Vec3::new(0.3, 0.4, 0.5), Vec3::new(0.011, 0.2, 3.7), Vec3::splat(0.0501)] {
        let mut stage = SceneFixture::new();
        stage.desc.sky = sky;
        let pane = stage.material(Material {
            alpha_mode: AlphaMode::Blend,
            ..flat(Vec4::new(1.0, 0.2, 0.2, 0.5))
        });
        let mesh =
            stage.mesh(&MeshFixture::triangle([Vec3::ZERO, Vec3::X, Vec3::Y], Vec3::Z), Some(pane));
        stage.node(mesh, DAffine3::IDENTITY);
        let scene = stage.build();
        let view = look(DVec3::Z * 3.0, DVec3::ZERO, SIZE);
        for samples in [1, 4] {
            let views = [ViewDesc { exposure: 1.3, ..view.clone() }];
            let (pixels, _) = draw_sampled(&scene, SIZE, samples, &views);
            // Within the box around the triangle, but not on it; and far away from it.
            assert_eq!(pixel(&pixels, SIZE, 49, 16), pixel(&pixels, SIZE, 0, 63), "{sky}");
            assert_ne!(pixel(&pixels, SIZE, 35, 29), pixel(&pixels, SIZE, 0, 63));
        }
    }
}

#[test]
fn uv_transforms_and_missing_coordinates_are_applied() {
    let mut stage = SceneFixture::new();
    let texture = stage.checkers(64, true);
    let transform = Affine2::from_scale_angle_translation(
        glam::Vec2::splat(1e-3),
        0.0,
        glam::Vec2::splat(0.19),
    );
    let used = |uv_set, uv_transform| Some(TextureRef { texture, uv_set, uv_transform });
    let scaled = Material { base_color_texture: used(0, transform), ..flat(Vec4::ONE) };
    let missing = Material { base_color_texture: used(1, transform), ..flat(Vec4::ONE) };
    for (index, material) in [scaled, missing].into_iter().enumerate() {
        let material = stage.material(material);
        let mesh = stage.mesh(&MeshFixture::rectangle(1.0, 1.0), Some(material));
        stage.node(mesh, DAffine3::from_translation(DVec3::X * (index as f64 * 2.0 - 1.0)));
    }
    let pixels = draw(&stage.build(), SIZE, &look(DVec3::Z * 3.0, DVec3::ZERO, SIZE));
    let (left, right) = (pixel(&pixels, SIZE, 20, 32), pixel(&pixels, SIZE, 44, 32));
    assert_eq!(left, right);
    assert!(left[2] > left[0], "the dark square (1, 1): {left:?}");
}

/// Fills a target with all codes of grey, and copies it to surfaces.
#[test]
fn output_keeps_every_code() {
    let size = [16, 16];
    let target = Target::new(gpu(), size, 1, false).unwrap();
    let codes: Vec<u8> = (0..=255u8).flat_map(|c| [c, 255 - c, c / 2, 255]).collect();
    let layout =
        wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(64), rows_per_image: None };
    let extent = wgpu::Extent3d { width: 16, height: 16, depth_or_array_layers: 1 };
    gpu().queue.write_texture(target.display().as_image_copy(), &codes, layout, extent);
    for format in [wgpu::TextureFormat::Rgba8UnormSrgb, wgpu::TextureFormat::Rgba8Unorm] {
        let surface = Target::new(gpu(), size, 1, false).unwrap();
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
        PresentPass::new(gpu(), format).draw(gpu(), Some(target.picture()), &[], &view, size);
        let mut encoder =
            gpu().device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let display = surface.display().as_image_copy();
        encoder.copy_texture_to_texture(texture.as_image_copy(), display, extent);
        gpu().queue.submit([encoder.finish()]);
        assert_eq!(read_pixels(gpu(), &surface).unwrap(), codes, "{format:?}");
    }
    assert_eq!(gpu().take_error(), None);
}

#[test]
fn the_idle_picture_arrives() {
    let lines = ["front-left".to_owned()];
    let picture = idle::picture(gpu(), [200, 100], &lines);
    let pixels = read_picture(gpu(), &picture).unwrap();
    assert_eq!(pixels, idle::image([200, 100], &lines).into_raw());
}
