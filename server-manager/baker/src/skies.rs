//! Skies: backgrounds that stand for what is far away, such as a dome with a picture of clouds.
//!
//! They cast no shadow, for the sun is behind them, and maps of shadows need no room for them:
//! texels would be metres wide where a house is to have a shadow. They are found in the bake, where
//! meshes stand in their file: all servers know the same ones, whatever was moved since.

use glam::Vec3;
use polyptych_scene::{AlphaMode, Material, Scene};

use super::backgrounds::Overview;

/// Minimum ratio of the longest side of a dome's box to that of the box of all else, if light falls
/// on it: no hall is so large.
const LIT_RATIO_MIN: f64 = 64.0;

/// Sets which nodes are skies ([`polyptych_scene::Node::is_sky`]): backgrounds that are unlit, and
/// shells that glow and take no light, are blended, or far larger than any hall. Copies are none.
pub(super) fn find(scene: &mut Scene, overview: &Overview) {
    for &index in &overview.backgrounds {
        let node = &scene.nodes[index as usize];
        let Some(mesh) = node.mesh.filter(|_| node.instances.is_empty()) else { continue };
        let is_far = |ratio: &f64| *ratio >= LIT_RATIO_MIN || all(scene, mesh, is_of_sky);
        let is_shell_of_sky = overview.shells.get(&index).is_some_and(is_far);
        let is_sky = is_shell_of_sky || all(scene, mesh, |material| material.unlit);
        scene.nodes[index as usize].is_sky = is_sky;
    }
}

/// Returns whether a mesh has only materials of a kind.
fn all(scene: &Scene, mesh: u32, is_such: impl Fn(&Material) -> bool) -> bool {
    scene.meshes[mesh as usize].primitives.iter().all(|primitive| {
        let material = primitive.material.and_then(|of| scene.materials.get(of as usize));
        material.is_some_and(&is_such)
    })
}

/// Returns whether a material shows its own light alone, or lets light through. One that glows and
/// is lit as well may be a hall whose windows are a picture of what glows.
fn is_of_sky(material: &Material) -> bool {
    let is_black = material.base_color.truncate() == Vec3::ZERO;
    let is_emission = is_black && material.emissive != Vec3::ZERO;
    material.unlit || is_emission || material.alpha_mode == AlphaMode::Blend
}
