//! What displays show, beside the wall's picture itself.

use serde::{Deserialize, Serialize};

/// What every display of the wall shows. A frame carries it, so that all displays change with
/// the same frame and a server that joins has it with its first one. Channels draw and answer in
/// every mode, and captures are of what is drawn: a mode is a matter of displays only.
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
    /// What it showed when the mode began.
    Freeze,
}

impl OutputMode {
    /// As commands and JSON call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Normal => "normal",
            Self::Identify => "identify",
            Self::Blank => "blank",
            Self::Freeze => "freeze",
        }
    }
}
