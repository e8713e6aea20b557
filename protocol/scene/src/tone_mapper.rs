//! Tone mapping: from exposed light to what displays show.

use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// A curve from exposed scene light, 0 and more, to display light, 0 to 1.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize,
)]
pub enum ToneMapper {
    /// Khronos PBR Neutral: colours of materials stay as they are up to 0.8, and only what is
    /// brighter is compressed.
    #[default]
    Neutral,
    /// A fit of the ACES reference rendering, as films look: K. Narkowicz, "ACES Filmic Tone
    /// Mapping Curve" (2015).
    Aces,
    /// None: what is brighter than 1 is white. For measurements and light that was mapped before.
    None,
}

impl ToneMapper {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Neutral, Self::Aces, Self::None];

    /// Returns its name, which [`FromStr`] reads.
    pub fn name(self) -> &'static str {
        match self {
            Self::Neutral => "neutral",
            Self::Aces => "aces",
            Self::None => "none",
        }
    }

    /// Returns its number in shaders.
    pub fn number(self) -> f64 {
        match self {
            Self::Neutral => 0.0,
            Self::Aces => 1.0,
            Self::None => 2.0,
        }
    }
}

impl FromStr for ToneMapper {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let is_it = |tone: &Self| tone.name() == text;
        let found = Self::ALL.into_iter().find(is_it);
        found.ok_or_else(|| format!("{text:?} is no tone mapper; use neutral, aces or none"))
    }
}
