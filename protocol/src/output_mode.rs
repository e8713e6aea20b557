//! The content of displays, beside the wall's picture itself.

use serde::{Deserialize, Serialize};

/// The content that every display of the wall shows. A frame carries it, so that all displays
/// change with the same frame and a server that joins gets it with its first one. Channels draw and
/// answer in every mode, and captures contain the drawn picture: a mode affects only displays.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum OutputMode {
    /// The wall's picture.
    #[default]
    Normal,
    /// The wall's picture, and over it what the display is: channel, server, address, pixels and
    /// adapter.
    Identify,
    /// Black.
    Blank,
    /// The picture that the display showed when the mode began.
    Freeze,
}

impl OutputMode {
    /// Returns the mode's name in commands and JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Normal => "normal",
            Self::Identify => "identify",
            Self::Blank => "blank",
            Self::Freeze => "freeze",
        }
    }
}
