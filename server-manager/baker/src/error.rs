//! Why a scene could not be baked.

use std::io;
use std::path::{Path, PathBuf};

use polyptych_files::blob::BlobError;

/// Why a scene could not be baked. A message names the file, the place in it, what is wrong and
/// what would be right.
#[derive(Debug, thiserror::Error)]
pub enum BakeError {
    /// The source, or a file that it names, is not what it should be.
    #[error("{}: {place}: {what}; {right}", .file.display())]
    Source {
        /// The scene file.
        file: PathBuf,
        /// The place in it, as a JSON path like `accessors[3]`, or `file`.
        place: String,
        /// The error there.
        what: String,
        /// The right value, range or file.
        right: String,
    },
    /// The file system says so.
    #[error("{}: file: {source}; it must be readable here", .path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// The store can't be read or written.
    #[error("store: {0}; the folder must be writable and have room")]
    Store(#[from] BlobError),
    /// Someone asked to stop. What was written so far is whole and will be reused.
    #[error("the bake was cancelled")]
    Cancelled,
}

impl BakeError {
    /// A fault of the source whose file [`BakeError::about`] fills in.
    pub(super) fn at(
        place: impl Into<String>,
        what: impl Into<String>,
        right: impl Into<String>,
    ) -> Self {
        Self::Source {
            file: PathBuf::new(),
            place: one_line(place.into()),
            what: one_line(what.into()),
            right: right.into(),
        }
    }

    /// An index that points behind the end of a list.
    pub(super) fn beyond(place: impl Into<String>, list: &str, index: u64, len: usize) -> Self {
        let what = format!("{list}[{index}] is not there, the file has {len}");
        let right = match len {
            0 => format!("{list} with that many elements would be right"),
            _ => format!("an index below {len} would be right"),
        };
        Self::at(place, what, right)
    }

    /// The fault and its remedy, without the place.
    pub(super) fn reason(&self) -> String {
        match self {
            Self::Source { right, .. } => format!("{}; {right}", self.fault()),
            _ => self.fault(),
        }
    }

    /// The fault alone, without place and remedy.
    pub(super) fn fault(&self) -> String {
        match self {
            Self::Source { what, .. } => what.clone(),
            other => one_line(other.to_string()),
        }
    }

    /// A file or folder that can't be used.
    pub(super) fn io(path: &Path, source: io::Error) -> Self {
        Self::Io { path: path.to_path_buf(), source }
    }

    /// The same, naming the part of the file that `place` is in.
    pub(super) fn within(self, part: &str) -> Self {
        match self {
            Self::Source { file, place, what, right } => {
                Self::Source { file, place: format!("{part} {place}"), what, right }
            }
            other => other,
        }
    }

    /// The same, naming the scene file.
    pub(super) fn about(self, scene: &Path) -> Self {
        match self {
            Self::Source { place, what, right, .. } => {
                Self::Source { file: scene.to_path_buf(), place, what, right }
            }
            other => other,
        }
    }
}

/// Names in a file may hold anything, and decoders of images write reasons of several lines.
fn one_line(text: String) -> String {
    if text.contains(char::is_control) { text.replace(char::is_control, " ") } else { text }
}
