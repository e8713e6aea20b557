//! The edges of shadows.

use serde::{Deserialize, Serialize};

/// The edges of the shadows that lights cast.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum ShadowFilter {
    /// No shadows.
    Off,
    /// One texel of a map for each pixel: edges are as jagged as the maps.
    Hard,
    /// Percentage-closer filtering over three texels: Reeves, Salesin and Cook, "Rendering
    /// Antialiased Shadows with Depth Maps" (1987).
    #[default]
    Soft,
    /// Penumbras as wide as those of a sun of 0.533° and of lamps of a radius of 5 cm: sharp where
    /// a shadow begins, softer away from what casts it.
    ContactHardening,
}
