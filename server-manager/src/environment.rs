//! Surroundings that a client asks for: has them baked by a child process, as scenes are.

use std::path::{Path, PathBuf};

use glam::DVec3;
use polyptych_files::blob::{BlobHash, BlobStore};
use polyptych_protocol::environment::{Environment, EnvironmentSource};
use polyptych_scene::{AssetManifests, LightKind, Scene, SceneEdits};
use polyptych_wall::limits::PATH_BYTES_MAX;

use crate::import::{self, Baker};

/// Bakes what surrounds scenes. Returns it, and what of it is not shown as it is there. `shown` is
/// the open scene's manifest with what was changed of it.
///
/// # Errors
/// The reason why it cannot be baked, and what would be right.
pub(crate) async fn bake(
    source: EnvironmentSource,
    roots: &[PathBuf],
    baker: &Baker,
    shown: Option<(BlobHash, SceneEdits)>,
) -> Result<(Environment, Option<String>), String> {
    match source {
        EnvironmentSource::File { path } => {
            if path.is_empty() || path.len() > PATH_BYTES_MAX {
                return Err(format!("an environment's path has 1 to {PATH_BYTES_MAX} bytes"));
            }
            let file = import::resolve(&path, roots)?;
            let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let options = ["--as", "environment"];
            let (blob, warning) = import::bake_blob(&file, baker, &options).await?;
            Ok((Environment { name, blob }, warning))
        }
        EnvironmentSource::Sky => {
            let store = BlobStore::new(baker.store.join("blobs"));
            let find = move || shown.and_then(|(manifest, edits)| sun(&store, manifest, &edits));
            let sun = tokio::task::spawn_blocking(find).await;
            let mut options = vec!["--as".to_owned(), "sky".to_owned()];
            if let Some(DVec3 { x, y, z }) = sun.map_err(|error| error.to_string())? {
                options.push(format!("--sun={x},{y},{z}"));
            }
            let options: Vec<&str> = options.iter().map(String::as_str).collect();
            let (blob, warning) = import::bake_blob(Path::new("sky"), baker, &options).await?;
            Ok((Environment { name: "sky".into(), blob }, warning))
        }
        EnvironmentSource::None | EnvironmentSource::Baked(_) => {
            Err("an environment is a Radiance .hdr file, or the sky".into())
        }
    }
}

/// The direction towards the first directional light of a scene, if it can be read and has one.
fn sun(store: &BlobStore, manifest: BlobHash, edits: &SceneEdits) -> Option<DVec3> {
    let base = import::read_scene(store, manifest).ok()?;
    let mut added = AssetManifests::new();
    for asset in edits.asset_manifests() {
        added.insert(asset, import::read_scene(store, asset).ok()?.into());
    }
    let (scene, _) = edits.apply_to(&base, &added);
    first_sun(&scene)
}

fn first_sun(scene: &Scene) -> Option<DVec3> {
    let world = scene.world_from_nodes();
    let is_sun = |light: u32| {
        let light = scene.lights.get(light as usize);
        light.is_some_and(|light| light.kind == LightKind::Directional && light.intensity > 0.0)
    };
    let mut lit = scene.nodes.iter().zip(world);
    let (_, place) = lit.find(|(node, _)| node.light.is_some_and(is_sun))?;
    // It shines along −Z of its node.
    place.transform_vector3(DVec3::Z).try_normalize()
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DQuat, Vec3};
    use polyptych_scene::{Light, Node};

    use super::*;

    #[test]
    fn the_first_directional_light_is_the_sun() {
        let light = |kind, intensity| Light { kind, color: Vec3::ONE, intensity, range: None };
        let node = |light, local| Node { light: Some(light), local, ..Node::default() };
        let down = DQuat::from_rotation_arc(DVec3::NEG_Z, DVec3::new(0.6, -0.8, 0.0));
        let mut scene = Scene {
            lights: vec![
                light(LightKind::Point, 5.0),
                light(LightKind::Directional, 0.0),
                light(LightKind::Directional, 3.0),
            ],
            nodes: vec![
                node(0, DAffine3::IDENTITY),
                node(1, DAffine3::IDENTITY),
                node(
                    2,
                    DAffine3::from_scale_rotation_translation(DVec3::splat(7.0), down, DVec3::ONE),
                ),
            ],
            ..Scene::default()
        };
        let sun = first_sun(&scene).expect("a sun");
        assert!((sun - DVec3::new(-0.6, 0.8, 0.0)).length() < 1e-12, "{sun}");
        scene.nodes.pop();
        assert_eq!(first_sun(&scene), None);
    }
}
