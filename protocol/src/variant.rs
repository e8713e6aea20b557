//! Variants of the open scene: looks that can be chosen while it is shown.

use polyptych_text::text_of_peer;
use serde::{Deserialize, Serialize};

/// The variants of a scene.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct VariantList {
    /// Their names in the file, in the order of their numbers; one may be empty or stand twice.
    #[serde(deserialize_with = "text_of_peer")]
    pub names: Vec<String>,
    /// The index of the one that is chosen; `None` for the materials that parts have without one.
    pub chosen: Option<u32>,
}
