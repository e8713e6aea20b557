//! The files of others that a wall file names, each once, in the order in which it names them.

use polyptych_wall::limits::PATH_BYTES_MAX;
use polyptych_wall::{CalibrationFile, CalibrationFileKind};

use super::error::WallFileError;
use super::source::SourceText;

/// Those that were named so far.
#[derive(Default)]
pub(super) struct Files(Vec<CalibrationFile>);

impl Files {
    /// The index of the file that this key names; nothing is read from it here.
    pub fn index(
        &mut self,
        source: &SourceText<'_>,
        key: &str,
        path: &str,
        kind: CalibrationFileKind,
    ) -> Result<u16, WallFileError> {
        if path.is_empty() || path.contains('\0') || path.len() > PATH_BYTES_MAX {
            let what = format!("{:?} is no file", path.chars().take(80).collect::<String>());
            let remedy = "write the path of a file, from the wall file's folder";
            return Err(source.error(key, what, remedy));
        }
        let known = self.0.iter().position(|file| file.path == path && file.kind == kind);
        let index = known.unwrap_or_else(|| {
            self.0.push(CalibrationFile {
                path: path.to_owned(),
                kind,
                blob: None,
                is_for_one_eye: false,
                front: Vec::new(),
            });
            self.0.len() - 1
        });
        // Screens and channels are counted, and each names three at most.
        u16::try_from(index).map_err(|_| source.error(key, "too many files", "name fewer"))
    }

    /// All of them.
    pub fn into_list(self) -> Vec<CalibrationFile> {
        self.0
    }
}
