//! Errors of a wall file, with their places.

use std::fmt;
use std::path::{Path, PathBuf};

/// One thing that is wrong with a wall file. Displays as
/// `FILE:LINE:COLUMN: KEY: what is wrong; what would be right`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WallFileError {
    pub(super) path: PathBuf,
    pub(super) line: u32,
    pub(super) column: u32,
    pub(super) key: String,
    pub(super) what: String,
    pub(super) remedy: String,
}

impl WallFileError {
    /// The wall file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The line, counted from 1; 0 where the file could not be read at all.
    pub fn line(&self) -> u32 {
        self.line
    }

    /// The column in characters, counted from 1; 0 where the file could not be read at all.
    pub fn column(&self) -> u32 {
        self.column
    }

    /// The key, such as `screen[0].tiles.columns` (lists count from 0); of a missing key, where it
    /// should be. Empty where the file could not be read, or a line is no TOML and has no key.
    pub fn key(&self) -> &str {
        &self.key
    }

    /// Returns the fault.
    pub fn what(&self) -> &str {
        &self.what
    }

    /// Returns the fix.
    pub fn remedy(&self) -> &str {
        &self.remedy
    }
}

impl fmt::Display for WallFileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:", self.path.display())?;
        if self.line > 0 {
            write!(f, "{}:{}:", self.line, self.column)?;
        }
        if !self.key.is_empty() {
            write!(f, " {}:", self.key)?;
        }
        write!(f, " {}; {}", self.what, self.remedy)
    }
}

impl std::error::Error for WallFileError {}
