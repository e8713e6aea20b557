//! Several targets on their way at once: their pictures are those of one after the other.

use glam::{DVec3, Vec4};
use polyptych_scene::{AlphaMode, Material};

use super::harness::{differences, gpu, look, matt};
use super::occlusion::behind_a_wall;
use crate::{DrawStats, GpuScene, OcclusionCulling, Renderer, Target, ViewDesc, read_pixels};

const SIZES: [[u32; 2]; 4] = [[160, 96], [64, 64], [96, 160], [32, 8]];

/// Draws rounds of views, one for each target, and returns all pictures with their numbers.
fn pictures(
    scene: &GpuScene,
    (samples, when): (u32, OcclusionCulling),
    rounds: &[[ViewDesc; 4]],
    is_together: bool,
) -> Vec<(Vec<[u8; 4]>, DrawStats)> {
    let mut renderer = Renderer::new(gpu(), samples).unwrap();
    renderer.set_occlusion(when);
    renderer.prepare(gpu(), scene);
    let is_linear = scene.has_transparency();
    let mut targets = SIZES.map(|size| Target::new(gpu(), size, samples, is_linear).unwrap());
    let mut all = Vec::new();
    for views in rounds {
        let mut stats = Vec::new();
        if is_together {
            let each = || views.iter().map(std::slice::from_ref);
            let begun: Vec<_> = each()
                .zip(&mut targets)
                .map(|(views, target)| renderer.begin(gpu(), scene, target, views).unwrap())
                .collect();
            let submitted: Vec<_> = begun
                .into_iter()
                .zip(&mut targets)
                .map(|(begun, target)| renderer.submit(gpu(), scene, target, begun).unwrap())
                .collect();
            for (frame, target) in submitted.into_iter().zip(&mut targets) {
                stats.push(renderer.finish(gpu(), target, frame).unwrap());
            }
        } else {
            for (view, target) in views.iter().zip(&mut targets) {
                let views = std::slice::from_ref(view);
                stats.push(renderer.draw(gpu(), scene, target, views).unwrap());
            }
        }
        for (stats, target) in stats.into_iter().zip(&targets) {
            let pixels = read_pixels(gpu(), target).unwrap();
            all.push((pixels.as_chunks::<4>().0.to_vec(), stats));
        }
    }
    all
}

#[test]
fn targets_drawn_together_are_bit_equal_to_those_drawn_one_by_one() {
    let glass = Material {
        alpha_mode: AlphaMode::Blend,
        base_color: Vec4::new(0.5, 0.6, 0.7, 0.5),
        ..matt(0.5, 0.6, 0.7)
    };
    // Few items, then many, then none: the shared buffers grow while frames read them.
    let sky = DVec3::new(0.0, 90.0, 0.1);
    let places = [DVec3::Z * 3.0, DVec3::new(0.0, 6.0, 3.0), sky, DVec3::new(5.0, 0.5, 2.0)];
    let view = |place: DVec3, size| {
        let at = if place == sky { DVec3::Y * 200.0 } else { DVec3::Z * -3.0 };
        look(place, at, size)
    };
    let rounds: Vec<[ViewDesc; 4]> = (0..4)
        .map(|turn| std::array::from_fn(|at| view(places[(at + 2 + turn) % 4], SIZES[at])))
        .collect();
    for material in [matt(0.5, 0.5, 0.5), glass] {
        let scene = behind_a_wall(material);
        for samples in [1, 4] {
            for when in [OcclusionCulling::Never, OcclusionCulling::Always] {
                let with = pictures(&scene, (samples, when), &rounds, true);
                let without = pictures(&scene, (samples, when), &rounds, false);
                for (frame, (with, without)) in with.iter().zip(&without).enumerate() {
                    let told = format!("frame {frame}, {samples} samples, {when:?}");
                    assert_eq!(differences(&with.0, &without.0), [0; 3], "{told}");
                    let counts = |stats: &DrawStats| (stats.triangles, stats.occluded);
                    assert_eq!(counts(&with.1), counts(&without.1), "{told}");
                }
                assert!(with.iter().any(|(_, stats)| stats.triangles > 1000), "something is seen");
            }
        }
    }
}
