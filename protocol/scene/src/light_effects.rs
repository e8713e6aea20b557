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
    /// What is nearer or farther than a distance is blurred; see
    /// [`DepthOfField`](crate::DepthOfField).
    pub depth_of_field: bool,
}

impl LightEffects {
    /// Light and its shadows alone.
    pub const NONE: Self =
        Self { fog: false, glow: false, ambient_occlusion: false, depth_of_field: false };

    /// Returns whether pixels get light of others, as scenes have it before tone mapping.
    pub fn mixes_light(self) -> bool {
        self.glow || self.depth_of_field
    }
}
