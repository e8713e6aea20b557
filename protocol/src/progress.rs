//! The progress of opening or exporting a scene.

use std::fmt;

use polyptych_text::text_of_peer;
use serde::{Deserialize, Serialize};

/// A step of opening a scene, in the order in which they come, or the one step of an export.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OpenStage {
    /// It waits until others have been baked or prepared.
    Waiting,
    /// The baker reads the file and writes its blobs.
    Baking,
    /// Servers fetch blobs and get ready to draw.
    Preparing,
    /// The manager writes the file of an export.
    Exporting,
}

/// The progress of opening or exporting a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct OpenProgress {
    /// The present step.
    pub stage: OpenStage,
    /// The completed part of that step in percent: 0 to 100. It never falls within a step.
    pub percent: u8,
}

impl OpenProgress {
    /// The progress of a request that was just made.
    pub const NONE: Self = Self { stage: OpenStage::Waiting, percent: 0 };

    /// The progress where `done` of `total` parts of a step are done.
    pub fn of_parts(stage: OpenStage, done: usize, total: usize) -> Self {
        let percent = done.min(total) * 100 / total.max(1);
        Self { stage, percent: u8::try_from(percent).unwrap_or(100) }
    }
}

impl fmt::Display for OpenProgress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.stage {
            OpenStage::Waiting => f.write_str("waiting for its turn"),
            OpenStage::Baking => write!(f, "baking {} %", self.percent),
            OpenStage::Preparing => write!(f, "preparing {} %", self.percent),
            OpenStage::Exporting => write!(f, "exporting {} %", self.percent),
        }
    }
}

/// A scene that is being opened.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Opening {
    /// The scene's name: the file's stem, at most [`polyptych_wall::limits::NAME_BYTES_MAX`] bytes.
    #[serde(deserialize_with = "text_of_peer")]
    pub scene: String,
    /// The progress so far.
    pub progress: OpenProgress,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_as_a_step_and_a_percentage() {
        let of = |done, total| OpenProgress::of_parts(OpenStage::Preparing, done, total);
        assert_eq!(of(1, 4).to_string(), "preparing 25 %");
        assert_eq!((of(9, 4).percent, of(0, 0).percent), (100, 0));
        assert_eq!(OpenProgress::NONE.to_string(), "waiting for its turn");
    }
}
