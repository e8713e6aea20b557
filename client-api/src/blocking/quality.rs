//! Light, and the bounds of error and rate, for programs without tokio.

use polyptych_protocol::environment::EnvironmentSource;
use polyptych_protocol::quality_bounds::QualityBounds;
use polyptych_scene::{AmbientOcclusion, DepthOfField, Fog, Glow, ToneMapper};

use super::{Client, wait};
use crate::error::ClientError;

impl Client {
    /// Blocking version of [`crate::Client::set_exposure`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn set_exposure(&self, exposure: f32) -> Result<(), ClientError> {
        wait(self.inner.set_exposure(exposure))
    }

    /// Blocking version of [`crate::Client::set_automatic_exposure`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn set_automatic_exposure(&self) -> Result<(), ClientError> {
        wait(self.inner.set_automatic_exposure())
    }

    /// Blocking version of [`crate::Client::set_environment`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn set_environment(&self, environment: EnvironmentSource) -> Result<(), ClientError> {
        wait(self.inner.set_environment(environment))
    }

    /// Blocking version of [`crate::Client::set_tone`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn set_tone(&self, tone: ToneMapper) -> Result<(), ClientError> {
        wait(self.inner.set_tone(tone))
    }

    /// Blocking version of [`crate::Client::set_fog`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn set_fog(&self, fog: Option<Fog>) -> Result<(), ClientError> {
        wait(self.inner.set_fog(fog))
    }

    /// Blocking version of [`crate::Client::set_glow`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn set_glow(&self, glow: Option<Glow>) -> Result<(), ClientError> {
        wait(self.inner.set_glow(glow))
    }

    /// Blocking version of [`crate::Client::set_ambient_occlusion`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn set_ambient_occlusion(
        &self,
        occlusion: Option<AmbientOcclusion>,
    ) -> Result<(), ClientError> {
        wait(self.inner.set_ambient_occlusion(occlusion))
    }

    /// Blocking version of [`crate::Client::set_depth_of_field`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn set_depth_of_field(&self, of: Option<DepthOfField>) -> Result<(), ClientError> {
        wait(self.inner.set_depth_of_field(of))
    }

    /// Blocking version of [`crate::Client::set_bounds`].
    ///
    /// # Errors
    /// [`ClientError`].
    pub fn set_bounds(&self, bounds: QualityBounds) -> Result<(), ClientError> {
        wait(self.inner.set_bounds(bounds))
    }
}
