//! Meshes that share buffers, and draws whose arguments a GPU reads: no picture depends on either.

use glam::{DAffine3, DVec3, Vec4};
use polyptych_scene::{AlphaMode, Material, NodeTraits};

use super::harness::*;
use crate::{Gpu, ViewDesc};

const SIZE: [u32; 2] = [192, 128];

/// More batches than are drawn nearest first, of some materials, some of them blended or cut out.
const MESHES: u32 = 400;

fn crowd() -> SceneFixture {
    let mut stage = SceneFixture::new();
    let glass = Material {
        base_color: Vec4::new(0.2, 0.4, 0.9, 0.5),
        alpha_mode: AlphaMode::Blend,
        double_sided: true,
        ..Material::default()
    };
    let cut = Material { alpha_mode: AlphaMode::Mask(0.5), ..matt(0.9, 0.8, 0.1) };
    let materials = [matt(0.8, 0.2, 0.1), matt(0.1, 0.7, 0.2), glass, cut];
    let materials = materials.map(|material| stage.material(material));
    let mut seed = 7_u64;
    let mut random = move || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) as f64 / f64::from(1 << 30) - 1.0
    };
    for at in 0..MESHES {
        // Meshes of 16 and of 32 bits an index, of different sizes.
        let shape = if at % 50 == 0 {
            MeshFixture::sphere(12 + at / 50)
        } else {
            let side = 0.2 + 0.3 * f64::from(at) / f64::from(MESHES);
            MeshFixture::rectangle(side as f32, 0.3)
        };
        let mesh = stage.mesh(&shape, Some(materials[at as usize % 4]));
        for _ in 0..2 {
            let place = DVec3::new(random() * 6.0, random() * 4.0, random() * 6.0 - 4.0);
            stage.node(mesh, DAffine3::from_translation(place));
        }
    }
    stage
}

#[test]
fn no_picture_depends_on_how_draws_are_given_to_the_gpu() {
    let stage = crowd();
    let traits = NodeTraits::of_file(stage.desc.nodes.len());
    let view = look(DVec3::new(1.0, 2.0, 9.0), DVec3::ZERO, SIZE);
    let halves: Vec<ViewDesc> = [0, SIZE[0] / 2]
        .map(|x| ViewDesc { scissor: Some([x, 0, SIZE[0] / 2, SIZE[1]]), ..view.clone() })
        .into();
    let scene = stage.build();
    let (wanted, stats) = draw_sampled(&scene, SIZE, 1, std::slice::from_ref(&view));
    assert!(drawn(&wanted) > 9_000 && stats.draw_calls > MESHES, "{stats:?}");
    let apart = stage.build_on(gpu(), &traits, crate::SceneBuilder::in_separate_buffers);
    let plain = Gpu::plain().expect("a GPU");
    assert!(!plain.draws_indirectly());
    let on_plain = stage.build_on(&plain, &traits, |builder| builder);
    for (name, gpu, scene) in
        [("shared", gpu(), &scene), ("apart", gpu(), &apart), ("plain", &plain, &on_plain)]
    {
        for views in [std::slice::from_ref(&view), &halves] {
            let (found, _) = draw_on(gpu, scene, SIZE, 1, views);
            assert!(found == wanted, "{name}: {:?}", differences(&found, &wanted));
        }
    }
}
