//! Colours without light: displays show them as they are, whatever is drawn around them.

use glam::{DAffine3, DVec3, Vec3, Vec4};
use polyptych_scene::{
    AlphaMode, Material, MaterialExtensions, Specular, ToneMapper, Transmission,
};
use polyptych_wall::StereoPacking;

use super::extensions::with;
use super::harness::{MeshFixture, SceneFixture, draw_sampled, gpu, look, matt, pixel};
use crate::tone::{linear_from_srgb, tone_map};
use crate::{
    AtlasViewDesc, Correction, CorrectionDesc, EyeAtlas, GpuScene, ImageEncoding, Renderer, Target,
    ViewDesc, read_picture,
};

/// Sixteen rectangles of eight pixels along each side.
const SIZE: [u32; 2] = [128, 128];
const SIDE: u32 = 16;

fn flat(rgb: [u8; 3], alpha: f32) -> Material {
    let [r, g, b] = rgb.map(|code| linear_from_srgb(code) as f32);
    Material {
        base_color: Vec4::new(r, g, b, alpha),
        unlit: true,
        alpha_mode: if alpha < 1.0 { AlphaMode::Blend } else { AlphaMode::Opaque },
        ..Material::default()
    }
}

/// All 256 codes in each of three orders: greys, then pairs that are saturated and bright.
fn colors(variant: u8) -> impl Iterator<Item = [u8; 3]> {
    (0..=255u8).map(move |code| match variant {
        0 => [code; 3],
        1 => [code, 255 - code, 0],
        _ => [255, 0, code],
    })
}

/// Rectangles of all these colours over the whole picture; `mode` is that of the colours.
fn stage_of_cards(variant: u8, mode: AlphaMode) -> SceneFixture {
    let mut stage = SceneFixture::new();
    for (index, color) in (0..).zip(colors(variant)) {
        let material = Material { alpha_mode: mode, ..flat(color, 1.0) };
        let material = stage.material(material);
        let mesh = stage.mesh(&MeshFixture::rectangle(0.5, 0.5), Some(material));
        let (x, y) = (f64::from(index % SIDE) - 7.5, 7.5 - f64::from(index / SIDE));
        stage.node(mesh, DAffine3::from_translation(DVec3::new(x, y, 0.0)));
    }
    stage
}

/// The same as a scene. `is_blended` adds a pane behind them, so that it is drawn into the float
/// target.
fn cards(variant: u8, is_blended: bool, mode: AlphaMode) -> GpuScene {
    let mut stage = stage_of_cards(variant, mode);
    if is_blended {
        let pane = stage.material(flat([200, 10, 10], 0.5));
        let mesh = stage.mesh(&MeshFixture::rectangle(60.0, 60.0), Some(pane));
        // Its centre is farther from the eye than any card's.
        stage.node(mesh, DAffine3::from_translation(DVec3::Z * -40.0));
    }
    stage.build()
}

/// Exactly the cards.
fn view(exposure: f32) -> ViewDesc {
    let distance = 8.0 * 3f64.sqrt();
    ViewDesc { exposure, ..look(DVec3::Z * distance, DVec3::ZERO, SIZE) }
}

/// Maximum difference from the colours, of every pixel that only one rectangle covers.
#[track_caller]
fn assert_colors(name: &str, pixels: &[[u8; 4]], variant: u8, levels_max: u8) {
    for (index, color) in (0..).zip(colors(variant)) {
        for (dx, dy) in [(1, 1), (4, 4), (6, 6), (1, 6)] {
            let at = [index % SIDE * 8 + dx, index / SIDE * 8 + dy];
            let got = pixel(pixels, SIZE, at[0], at[1]);
            let most = got.iter().zip(color).map(|(a, b)| a.abs_diff(b)).max();
            assert!(most <= Some(levels_max), "{name}: {got:?} instead of {color:?}");
            assert_eq!(got[3], 255, "{name}: alpha of {color:?}");
        }
    }
}

#[test]
fn every_code_of_an_unlit_colour_stays_in_every_pass() {
    for variant in 0..3 {
        for (is_blended, mode) in [
            (false, AlphaMode::Opaque),
            (false, AlphaMode::Mask(0.5)),
            (true, AlphaMode::Opaque),
            (true, AlphaMode::Blend),
        ] {
            let scene = cards(variant, is_blended, mode);
            for (samples, exposure) in [(1, 1.0), (1, 0.0), (1, 1e-6), (1, 1e30), (4, 0.25)] {
                let name = format!("{variant} {is_blended} {mode:?} ×{samples} at {exposure}");
                let (pixels, _) = draw_sampled(&scene, SIZE, samples, &[view(exposure)]);
                assert_colors(&name, &pixels, variant, 0);
            }
        }
    }
}

/// Glass that neither reflects nor blurs.
fn clear_glass() -> Material {
    let extensions = MaterialExtensions {
        specular: Some(Specular { factor: 0.0, ..Specular::default() }),
        transmission: Some(Transmission { factor: 1.0, texture: None }),
        ..MaterialExtensions::default()
    };
    with(Material { roughness: 0.0, ..matt(1.0, 1.0, 1.0) }, extensions)
}

#[test]
fn every_code_of_an_unlit_colour_stays_behind_clear_glass() {
    for variant in 0..3 {
        for mode in [AlphaMode::Opaque, AlphaMode::Mask(0.5)] {
            let mut stage = stage_of_cards(variant, mode);
            let glass = stage.material(clear_glass());
            let mesh = stage.mesh(&MeshFixture::rectangle(20.0, 20.0), Some(glass));
            stage.node(mesh, DAffine3::from_translation(DVec3::Z));
            let scene = stage.build();
            for (samples, exposure, tone) in [
                (1, 1.0, ToneMapper::Neutral),
                (1, 1.0, ToneMapper::Aces),
                (1, 0.0, ToneMapper::Aces),
                (4, 50.0, ToneMapper::Neutral),
            ] {
                let name = format!("{variant} {mode:?} ×{samples} at {exposure} by {tone:?}");
                let view = ViewDesc { tone, ..view(exposure) };
                let (pixels, _) = draw_sampled(&scene, SIZE, samples, &[view]);
                assert_colors(&name, &pixels, variant, 0);
            }
        }
    }
}

#[test]
fn light_of_glass_before_unlit_colours_is_mapped_as_light() {
    for (light, exposure) in [(0.3, 1.0), (0.9, 1.0), (0.6, 8.0)] {
        let glass = Material { emissive: Vec3::splat(light), ..clear_glass() };
        let mapped = tone_map(ToneMapper::Neutral, Vec3::splat(light * exposure)).x;
        let before_black = pane_over_card(flat([0; 3], 1.0), glass.clone(), exposure);
        assert!(before_black.abs_diff(code(mapped)) <= 1, "{before_black}, {light} × {exposure}");
        // Before a colour it adds to that, and stays within white.
        let grey = flat([120; 3], 1.0);
        let before_grey = pane_over_card(grey, glass, exposure);
        assert!(before_grey >= before_black.max(120), "{before_grey}, {light} × {exposure}");
        let lit = pane_over_card(glowing(light), clear_glass(), exposure);
        assert!(lit.abs_diff(code(mapped)) <= 1, "{lit}, {light} × {exposure}");
    }
}

/// The scene through a correction, with both eyes in the middle.
fn corrected(scene: &GpuScene, packing: StereoPacking, exposure: f32) -> Vec<[u8; 4]> {
    let mut renderer = Renderer::new(gpu(), 1).unwrap();
    renderer.prepare_for(gpu(), scene, ImageEncoding::Light);
    let mut source =
        Target::with_encoding(gpu(), SIZE, 1, scene.has_transparency(), ImageEncoding::Light)
            .unwrap();
    renderer.draw(gpu(), scene, &mut source, &[view(exposure)]).unwrap();
    let desc = CorrectionDesc { packing, ..CorrectionDesc::identity(SIZE) };
    let plane = AtlasViewDesc {
        eye_in_display: DVec3::ZERO,
        clip_from_eye: glam::DMat4::IDENTITY,
        rect: [0, 0, SIZE[0], SIZE[1]],
    };
    let eye = EyeAtlas { planes: vec![plane], triangles: None };
    let eyes = vec![eye; packing.eyes()];
    let mut correction = Correction::new(gpu(), desc).unwrap();
    let picture = correction.picture(gpu());
    correction.draw(gpu(), &source, &eyes, [1, 1], &picture).unwrap();
    read_picture(gpu(), &picture).unwrap().as_chunks::<4>().0.to_vec()
}

#[test]
fn every_code_of_an_unlit_colour_stays_on_corrected_channels() {
    for packing in [StereoPacking::None, StereoPacking::Anaglyph] {
        for (is_blended, mode) in
            [(false, AlphaMode::Opaque), (true, AlphaMode::Opaque), (true, AlphaMode::Blend)]
        {
            for variant in 0..3 {
                let pixels = corrected(&cards(variant, is_blended, mode), packing, 3.0);
                let name = format!("{packing:?} {variant} {is_blended} {mode:?}");
                assert_colors(&name, &pixels, variant, 0);
            }
        }
    }
}

/// The code of linear display light.
fn code(light: f32) -> u8 {
    let curved =
        if light <= 0.0031308 { light * 12.92 } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 };
    (curved.clamp(0.0, 1.0) * 255.0).round() as u8
}

/// A pane of half coverage over a card, each without light or glowing by so much.
fn pane_over_card(card: Material, pane: Material, exposure: f32) -> u8 {
    let mut stage = SceneFixture::new();
    stage.desc.sky = Vec3::ZERO;
    stage.light(
        polyptych_scene::Light {
            kind: polyptych_scene::LightKind::Directional,
            color: Vec3::ZERO,
            intensity: 0.0,
            range: None,
        },
        DAffine3::IDENTITY,
    );
    for (material, z) in [(card, 0.0), (pane, 0.5)] {
        let material = stage.material(material);
        let mesh = stage.mesh(&MeshFixture::rectangle(3.0, 3.0), Some(material));
        stage.node(mesh, DAffine3::from_translation(DVec3::Z * z));
    }
    let view = ViewDesc { exposure, ..look(DVec3::Z * 3.0, DVec3::ZERO, [8, 8]) };
    let (pixels, _) = draw_sampled(&stage.build(), [8, 8], 1, &[view]);
    pixel(&pixels, [8, 8], 4, 4)[0]
}

fn glowing(light: f32) -> Material {
    Material { emissive: Vec3::splat(light), ..matt(0.0, 0.0, 0.0) }
}

fn half(material: &Material) -> Material {
    let base_color = material.base_color.truncate().extend(0.5);
    Material { base_color, alpha_mode: AlphaMode::Blend, ..material.clone() }
}

#[test]
fn blending_with_unlit_colours_mixes_what_each_shows() {
    let [dark, bright] = [60, 220].map(|code| (flat([code; 3], 1.0), linear_from_srgb(code)));
    // Both unlit: linear light is mixed, and nothing is mapped.
    let mixed = code(f64::midpoint(dark.1, bright.1) as f32);
    for exposure in [0.0, 1.0, 50.0] {
        let got = pane_over_card(dark.0.clone(), half(&bright.0), exposure);
        assert!(got.abs_diff(mixed) <= 1, "{got} instead of {mixed} at {exposure}");
    }
    // One lit: half of what either shows alone. This is exact where the mapper only shifts light,
    // and 0.02 too dark in front of black.
    for (light, exposure, levels_max) in
        [(0.3, 1.0, 1), (0.15, 2.0, 1), (0.6, 1.0, 1), (0.0, 1.0, 5), (0.6, 0.0, 5)]
    {
        let exposed = light * exposure;
        let shown =
            f32::midpoint(bright.1 as f32, tone_map(ToneMapper::Neutral, Vec3::splat(exposed)).x);
        let over = pane_over_card(glowing(light), half(&bright.0), exposure);
        let under = pane_over_card(bright.0.clone(), half(&glowing(light)), exposure);
        for got in [over, under] {
            let wanted = code(shown);
            assert!(got.abs_diff(wanted) <= levels_max, "{got} instead of {wanted}");
        }
    }
    // Light beyond white stays within white and what is nearer.
    let over = pane_over_card(glowing(50.0), half(&dark.0), 1.0);
    assert!(over >= code(0.5), "{over}");
}

#[test]
fn edges_between_unlit_and_lit_surfaces_lie_between_both() {
    for is_blended in [false, true] {
        let mut stage = SceneFixture::new();
        stage.desc.sky = Vec3::splat(0.5);
        let card = stage.material(flat([40; 3], 1.0));
        let mesh = stage.mesh(&MeshFixture::rectangle(1.0, 1.0), Some(card));
        stage.node(mesh, DAffine3::from_rotation_z(0.3));
        if is_blended {
            let pane = stage.material(flat([40; 3], 0.5));
            let mesh = stage.mesh(&MeshFixture::rectangle(0.2, 0.2), Some(pane));
            stage.node(mesh, DAffine3::from_translation(DVec3::Z * 0.1));
        }
        let view = look(DVec3::Z * 4.0, DVec3::ZERO, [64, 64]);
        let (pixels, _) = draw_sampled(&stage.build(), [64, 64], 4, &[view]);
        let sky = pixels[0][0];
        let greys: std::collections::BTreeSet<u8> = pixels.iter().map(|p| p[0]).collect();
        assert!(greys.len() > 3, "no edge is smooth: {greys:?}");
        assert_eq!(greys.first(), Some(&40), "{greys:?}");
        assert_eq!(greys.last(), Some(&sky), "{greys:?}");
    }
}
