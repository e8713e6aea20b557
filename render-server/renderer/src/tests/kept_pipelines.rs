//! Pipelines that stay from one scene to the next.

use glam::DAffine3;
use polyptych_scene::{AlphaMode, LightEffects, Material};

use super::harness::{MeshFixture, SceneFixture, gpu, matt};
use crate::{GpuScene, ImageEncoding, PipelineNeeds, Renderer};

/// A panel of each of these materials.
fn scene(materials: &[Material]) -> GpuScene {
    let mut stage = SceneFixture::new();
    for material in materials {
        let material = stage.material(material.clone());
        let mesh = stage.mesh(&MeshFixture::rectangle(1.0, 1.0), Some(material));
        stage.node(mesh, DAffine3::IDENTITY);
    }
    stage.build()
}

#[test]
fn pipelines_are_given_back_with_the_last_scene_that_needs_them() {
    let gpu = gpu();
    let (plain, other) =
        (matt(0.5, 0.5, 0.5), Material { double_sided: true, ..matt(0.5, 0.5, 0.5) });
    let masked = Material { alpha_mode: AlphaMode::Mask(0.5), ..matt(0.5, 0.5, 0.5) };
    let [first, second] = [&[plain.clone(), masked][..], &[plain.clone(), other]].map(scene);
    let shared = scene(&[plain]);
    let fog = LightEffects { fog: true, ..LightEffects::NONE };
    let needs = |scene: &GpuScene, effects| PipelineNeeds::new(scene, ImageEncoding::Srgb, effects);
    let mut renderer = Renderer::new(gpu, 1).expect("a renderer");
    for scene in [&first, &second] {
        renderer.prepare_with(gpu, scene, &needs(scene, fog));
        renderer.prepare(gpu, scene);
    }
    let meets = |renderer: &Renderer, scene: &GpuScene| {
        [LightEffects::NONE, fog].map(|effects| renderer.pipelines().meet(&needs(scene, effects)))
    };
    renderer.retain_pipelines([&first, &second].into_iter());
    assert_eq!([&first, &second].map(|of| meets(&renderer, of)), [[true; 2]; 2]);
    renderer.retain_pipelines([&second].into_iter());
    assert_eq!(meets(&renderer, &first), [false; 2], "it is closed");
    assert_eq!(meets(&renderer, &second), [true; 2], "with all effects that frames have had");
    renderer.retain_pipelines([&shared].into_iter());
    assert_eq!((meets(&renderer, &second), meets(&renderer, &shared)), ([false; 2], [true; 2]));
    // What was given back is made again.
    renderer.prepare(gpu, &first);
    assert_eq!(meets(&renderer, &first), [true, false]);
}
