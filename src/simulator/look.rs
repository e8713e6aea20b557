//! How a run shows its scene: surroundings, tone, fog, glow, ambient occlusion, depth of field and
//! exposure.

use std::path::{Path, PathBuf};

use polyptych_client::blocking::Client;
use polyptych_client::{
    AmbientOcclusion, ClientError, DepthOfField, EnvironmentSource, Fog, Glow, ToneMapper,
};

/// The exposure of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Brightness {
    /// By what the wall shows.
    Automatic,
    /// All light is multiplied by this.
    Factor(f32),
}

/// How a run shows its scene; what is `None` stays as it is when a scene was opened.
#[derive(Clone, Debug, Default)]
pub(crate) struct Look {
    pub environment: Option<EnvironmentSource>,
    pub tone: Option<ToneMapper>,
    pub fog: Option<Fog>,
    pub glow: Option<Glow>,
    pub ambient_occlusion: Option<AmbientOcclusion>,
    pub depth_of_field: Option<DepthOfField>,
    pub exposure: Option<Brightness>,
}

impl Look {
    /// Returns the folder that a manager must be allowed to read for it.
    pub fn folder(&self) -> Option<PathBuf> {
        let Some(EnvironmentSource::File { path }) = &self.environment else { return None };
        Some(Path::new(path).parent().unwrap_or(Path::new("/")).to_owned())
    }

    /// Shows the open scene so.
    ///
    /// # Errors
    /// The manager refuses a part of it.
    pub fn apply(&self, client: &Client) -> Result<(), ClientError> {
        if let Some(environment) = &self.environment {
            client.set_environment(environment.clone())?;
        }
        if let Some(tone) = self.tone {
            client.set_tone(tone)?;
        }
        if self.fog.is_some() {
            client.set_fog(self.fog)?;
        }
        if self.glow.is_some() {
            client.set_glow(self.glow)?;
        }
        if self.ambient_occlusion.is_some() {
            client.set_ambient_occlusion(self.ambient_occlusion)?;
        }
        if self.depth_of_field.is_some() {
            client.set_depth_of_field(self.depth_of_field)?;
        }
        match self.exposure {
            Some(Brightness::Factor(factor)) => client.set_exposure(factor),
            Some(Brightness::Automatic) => client.set_automatic_exposure(),
            None => Ok(()),
        }
    }
}
