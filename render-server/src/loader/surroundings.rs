//! The surroundings of scenes, found and decoded before a state needs it.

use std::sync::Arc;

use polyptych_files::blob::BlobHash;
use polyptych_protocol::state_log::Replica;
use polyptych_scene::EnvironmentMap;

use super::{Loader, LoaderLink, ReadyScene};

/// The surroundings of scenes, decoded here and not between frames.
#[derive(Clone, Debug)]
pub(crate) struct LoadedEnvironment {
    pub blob: BlobHash,
    pub map: Arc<EnvironmentMap>,
}

impl Loader {
    /// Returns the wall's surroundings, or else those that the scene brings along: those of before
    /// where they surround scenes still.
    pub(super) fn load_environment(
        &self,
        replica: &Replica,
        scene: Option<&ReadyScene>,
        line: &LoaderLink,
    ) -> Result<Option<LoadedEnvironment>, String> {
        let of_wall = replica.environment.as_ref().map(|of| (&of.name, of.blob));
        let of_scene = || scene.and_then(|of| Some((&of.base.name, of.base.surroundings?)));
        let Some((name, blob)) = of_wall.or_else(of_scene) else { return Ok(None) };
        if let Some(ready) = self.ready_environment.as_ref().filter(|ready| ready.blob == blob) {
            return Ok(Some(ready.clone()));
        }
        let about = |reason| format!("environment {name}: {reason}");
        let bytes = self.blob(blob, line).map_err(about)?;
        let map = EnvironmentMap::decode(&bytes).map_err(about)?;
        Ok(Some(LoadedEnvironment { blob, map: Arc::new(map) }))
    }
}
