//! The surroundings of scenes, found and decoded before a state needs it.

use std::sync::Arc;

use polyptych_files::blob::BlobHash;
use polyptych_protocol::environment::Environment;
use polyptych_scene::EnvironmentMap;

use super::{Loader, LoaderLink};

/// The surroundings of scenes, decoded here and not between frames.
#[derive(Clone, Debug)]
pub(crate) struct LoadedEnvironment {
    pub blob: BlobHash,
    pub map: Arc<EnvironmentMap>,
}

impl Loader {
    /// Returns those of before where they surround scenes still.
    pub(super) fn load_environment(
        &self,
        of: &Environment,
        line: &LoaderLink,
    ) -> Result<LoadedEnvironment, String> {
        if let Some(ready) = self.ready_environment.as_ref().filter(|ready| ready.blob == of.blob) {
            return Ok(ready.clone());
        }
        let about = |reason| format!("environment {}: {reason}", of.name);
        let bytes = self.blob(of.blob, line).map_err(about)?;
        let map = EnvironmentMap::decode(&bytes).map_err(about)?;
        Ok(LoadedEnvironment { blob: of.blob, map: Arc::new(map) })
    }
}
