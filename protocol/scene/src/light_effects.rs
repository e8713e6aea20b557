//! The effects of light that frames have or do not have.

use serde::{Deserialize, Serialize};

/// The effects of light that need more than numbers: other pipelines draw them, which are made
/// before the first frame that has them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LightEffects {
    /// Views look through [`Fog`](crate::Fog).
    pub fog: bool,
    /// Light spreads around what is bright, as [`Glow`](crate::Glow) has it.
    pub glow: bool,
    /// Corners and gaps get less of the light from all around; see
    /// [`AmbientOcclusion`](crate::AmbientOcclusion).
    pub ambient_occlusion: bool,
}
