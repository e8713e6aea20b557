//! Baked light of materials against Lambert's law in f64.

use std::f64::consts::PI;
use std::sync::Arc;

use glam::{Affine2, DAffine3, DVec3, Vec2, Vec3};
use polyptych_scene::{
    AmbientOcclusion, BakedLight, Clearcoat, Material, MaterialExtensions, Scene, TextureFormat,
    TextureRef, ToneMapper,
};

use super::environment::uniform;
use super::extensions::{coat_albedo, with};
use super::furnace::{color_of, color_of_mesh, material};
use super::harness::{MeshFixture, SceneFixture, gpu, look};
use super::pixel_light::lights;
use crate::albedo::tests::integrated;
use crate::{Environment, GpuScene, ViewDesc};

/// Texels of the quarters of a light map: upper left, upper right, lower left and lower right.
const QUARTERS: [[u8; 4]; 4] =
    [[255, 0, 0, 255], [40, 200, 90, 255], [120, 60, 240, 255], [9, 9, 9, 255]];
const UPPER_RIGHT: usize = 1;
const LOWER_LEFT: usize = 2;

/// Largest difference from the formula: a half float has eleven bits.
const TOLERANCE: f64 = 1e-3;

fn quarters(stage: &mut SceneFixture) -> u32 {
    let texel = |u, v| QUARTERS[usize::from(u > 0.5) + 2 * usize::from(v > 0.5)];
    stage.picture((64, TextureFormat::Rgba8Linear), texel)
}

fn baked(of: Material, texture: u32, uv_set: u8, intensity: f32, offset: Vec2) -> Material {
    let uv_transform = Affine2::from_translation(offset);
    let texture = Some(TextureRef { texture, uv_set, uv_transform });
    let baked_light = Some(BakedLight { intensity, texture });
    with(of, MaterialExtensions { baked_light, ..MaterialExtensions::default() })
}

/// The material with a light map whose upper right quarter is in the middle of a plate.
fn plate(stage: &mut SceneFixture, of: Material, intensity: f32) -> Material {
    let texture = quarters(stage);
    baked(of, texture, 0, intensity, Vec2::new(0.25, -0.25))
}

fn color(quarter: usize) -> DVec3 {
    let [r, g, b, _] = QUARTERS[quarter].map(|byte| f64::from(byte) / 255.0);
    DVec3::new(r, g, b)
}

fn check(got: DVec3, wanted: DVec3, name: &str) {
    let off = (got - wanted).abs().max_element();
    assert!(off < TOLERANCE * wanted.max_element().max(0.1), "{got}, not {wanted}: {name}");
}

#[test]
fn a_matt_surface_reflects_its_albedo_of_the_texels_by_either_set_of_coordinates() {
    for (base, roughness, intensity, mu) in
        [(1.0, 1.0, 1.0f32, 1.0), (0.8, 0.3, 3.5, 0.6), (0.25, 0.0, 9.0, 0.2)]
    {
        for (uv_set, offset, quarter) in [
            (1, Vec2::ZERO, LOWER_LEFT),
            (1, Vec2::new(0.5, -0.5), UPPER_RIGHT),
            (0, Vec2::new(0.25, -0.25), UPPER_RIGHT),
        ] {
            let mut stage = SceneFixture::new();
            let texture = quarters(&mut stage);
            let of = baked(material(base, 0.0, roughness), texture, uv_set, intensity, offset);
            let of = stage.material(of);
            let mut card = MeshFixture::rectangle(50.0, 50.0);
            card.second_uvs = vec![[0.25, 0.75]; 4];
            let got = color_of_mesh(stage, (&card, of), mu, (0.0, None), &[]);
            let wanted = color(quarter) * (base / PI * f64::from(intensity));
            check(got, wanted, &format!("{base} {roughness} {intensity} {mu}: {uv_set} {offset}"));
        }
    }
}

#[test]
fn metal_reflects_no_baked_light() {
    for metallic in [0.0, 0.5, 1.0] {
        let mut stage = SceneFixture::new();
        let of = plate(&mut stage, material(0.9, metallic, 0.5), 2.0);
        let got = color_of((stage, of), 0.7, (0.0, None), &[]);
        let wanted = color(UPPER_RIGHT) * (0.9 * (1.0 - metallic) * 2.0 / PI);
        check(got, wanted, &format!("metal {metallic}"));
    }
}

#[test]
fn vertices_without_coordinates_have_the_corner_and_no_texture_is_no_light() {
    let mut stage = SceneFixture::new();
    let texture = quarters(&mut stage);
    let of = baked(material(0.5, 0.0, 0.5), texture, 1, 1.0, Vec2::ZERO);
    let mut none = of.clone();
    none.extensions.as_mut().expect("some").baked_light.as_mut().expect("some").texture = None;
    let got = color_of((stage, of), 0.7, (0.0, None), &[]);
    check(got, color(0) * 0.5 / PI, "the corner, as of other textures");
    check(color_of((SceneFixture::new(), none), 0.7, (0.0, None), &[]), DVec3::ZERO, "no texture");
}

#[test]
fn one_image_is_a_colour_in_srgb_and_light_that_is_linear() {
    let mut stage = SceneFixture::new();
    let texels = [230u8, 188, 90];
    let texel = |_, _| [texels[0], texels[1], texels[2], 255];
    let as_color = stage.picture((4, TextureFormat::Rgba8Srgb), texel);
    let as_light = stage.picture((4, TextureFormat::Rgba8Linear), texel);
    let at = |texture| TextureRef { texture, uv_set: 0, uv_transform: Affine2::IDENTITY };
    let mut of = baked(material(1.0, 0.0, 1.0), as_light, 0, 2.5, Vec2::ZERO);
    of.base_color_texture = Some(at(as_color));
    let got = color_of((stage, of), 0.8, (0.0, None), &[]);
    let wanted = texels.map(|byte| {
        let value = f64::from(byte) / 255.0;
        ((value + 0.055) / 1.055).powf(2.4) * value * 2.5 / PI
    });
    // Drivers decode sRGB to some nine bits.
    let off = (got / DVec3::from(wanted) - 1.0).abs().max_element();
    assert!(off < 0.01, "{got}, not {wanted:?}");
}

#[test]
fn the_occlusion_of_the_material_and_its_coat_dim_baked_light() {
    let mut stage = SceneFixture::new();
    let occlusion = stage.grey(4, |_, _| 0.4);
    let mut of = plate(&mut stage, material(0.9, 0.0, 0.5), 2.0);
    of.occlusion_texture =
        Some(TextureRef { texture: occlusion, uv_set: 0, uv_transform: Affine2::IDENTITY });
    of.occlusion_strength = 0.5;
    let whole = color(UPPER_RIGHT) * (0.9 * 2.0 / PI);
    check(color_of((stage, of), 0.7, (0.0, None), &[]), whole * 0.7, "occluded");

    let mut stage = SceneFixture::new();
    let mut of = plate(&mut stage, material(0.9, 0.0, 0.5), 2.0);
    let coat = Clearcoat { factor: 0.8, roughness: 0.3, ..Clearcoat::default() };
    of.extensions.as_mut().expect("some").clearcoat = Some(coat);
    let passed = 1.0 - 0.8 * coat_albedo(0.3, 0.3).0;
    let got = color_of((stage, of), 0.3, (0.0, None), &[]) / whole;
    assert!((got / passed - 1.0).abs().max_element() < 0.01, "{got}, not {passed}: coated");
}

#[test]
fn suns_and_environments_add_to_baked_light_but_not_the_sky_of_ours() {
    let shown = |base: f64, sky: f64, around: Option<f64>, sun: f64| {
        let mut stage = SceneFixture::new();
        let of = plate(&mut stage, material(base, 0.0, 0.6), 1.5);
        let map = |of| Arc::new(Environment::new(gpu(), &uniform([of; 3])));
        color_of((stage, of), 0.7, (sky, around.map(map)), &[(DVec3::Z, sun)])
    };
    // What the layer mirrors is that of black, too.
    let matt = |sky, around, sun| shown(0.6, sky, around, sun) - shown(0.0, sky, around, sun);
    let own = color(UPPER_RIGHT) * (0.6 * 1.5 / PI);
    check(matt(0.0, None, 0.0), own, "alone");
    check(matt(0.5, None, 0.0), own, "under the sky");
    assert!(shown(0.0, 0.5, None, 0.0).min_element() > 0.01, "the sky is mirrored");
    let [e, b] = integrated(0.7, 0.6);
    let layer = (0.04 * e + 0.96 * b) * (1.0 + 0.04 * (1.0 / e - 1.0));
    let more = matt(0.0, Some(0.4), 0.0) - own;
    assert!((more / (0.6 * (1.0 - layer) * 0.4) - 1.0).abs().max_element() < 0.02, "{more}");
    let more = matt(0.0, None, 0.8) - own;
    assert!((more / (0.6 * 0.96 * 0.8 / PI) - 1.0).abs().max_element() < 0.02, "{more}");
}

/// A corner of two cards, one upright behind the other, without light but this material's.
fn corner(of: impl Fn(&mut SceneFixture) -> Material, change: impl Fn(&mut Scene)) -> GpuScene {
    let mut stage = SceneFixture::new();
    (stage.desc.sky, stage.ground) = (Vec3::ZERO, Some(Vec3::ZERO));
    let of = of(&mut stage);
    let of = stage.material(of);
    let card = stage.mesh(&MeshFixture::rectangle(4.0, 4.0), Some(of));
    stage.node(card, DAffine3::from_translation(DVec3::Y * 4.0));
    let flat = DAffine3::from_rotation_x(-std::f64::consts::FRAC_PI_2);
    stage.node(card, DAffine3::from_translation(DVec3::Z * 4.0) * flat);
    change(&mut stage.desc);
    if stage.desc.sky != Vec3::ZERO {
        stage.ground = Some(stage.desc.sky);
    }
    stage.build()
}

fn view() -> ViewDesc {
    let seen = look(DVec3::new(0.5, 1.5, 4.0), DVec3::new(0.5, 0.8, 0.0), [40, 30]);
    ViewDesc { tone: ToneMapper::None, ..seen }
}

fn even(stage: &mut SceneFixture) -> Material {
    let texture = stage.grey(4, |_, _| 0.6);
    baked(material(0.8, 0.0, 1.0), texture, 0, 1.0, Vec2::ZERO)
}

#[test]
fn exposure_scales_baked_light() {
    let scene = corner(even, |_| ());
    for exposure in [0.25, 1.0, 3.0] {
        let shown = lights(&scene, 1, &ViewDesc { exposure, ..view() });
        let wanted = 0.6 * 0.8 / PI * f64::from(exposure);
        for got in shown {
            assert!((got / wanted - 1.0).abs() < 0.002, "{got}, not {wanted}: {exposure}");
        }
    }
}

#[test]
fn ambient_occlusion_of_a_view_leaves_baked_light() {
    let occluded = ViewDesc { ambient_occlusion: Some(AmbientOcclusion { radius: 1.0 }), ..view() };
    let scene = corner(even, |_| ());
    assert_eq!(lights(&scene, 1, &occluded), lights(&scene, 1, &view()));
    let plain = corner(|_| material(0.8, 0.0, 1.0), |desc| desc.sky = Vec3::splat(0.5));
    assert_ne!(lights(&plain, 1, &occluded), lights(&plain, 1, &view()), "it occludes");
}

#[test]
fn the_default_sun_does_not_shine_beside_baked_light() {
    let is_sunny = |scene: &GpuScene| lights(scene, 1, &view()).iter().all(|light| *light > 0.3);
    let plain = |desc: &mut Scene| {
        desc.materials.push(material(0.8, 0.0, 1.0));
        desc.meshes[0].primitives[0].material = Some(1);
    };
    let unlit = |stage: &mut SceneFixture| Material { unlit: true, ..even(stage) };
    assert!(is_sunny(&corner(unlit, plain)), "what is unlit has no light");
    assert_eq!(lights(&corner(even, plain), 1, &view()), [0.0; 40 * 30], "beside other materials");
}
