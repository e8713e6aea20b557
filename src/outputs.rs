//! Files and folders that a command writes, with errors that name them.

use std::path::Path;

use anyhow::{Context, bail};
use polyptych_files::output_file::{self, OutputFile};

/// Checks that a picture or a report can be written at this path, before the work that makes it.
pub(crate) fn check(path: &Path) -> anyhow::Result<()> {
    output_file::check(path).with_context(|| cannot_write(path))
}

/// Checks that a source can be written at this path. A source that exists may have been edited by
/// a person, and is only replaced with `force`; pictures and reports are replaced without it.
pub(crate) fn check_source(path: &Path, force: bool) -> anyhow::Result<()> {
    let is_there = std::fs::symlink_metadata(path).is_ok_and(|m| m.is_file() || m.is_symlink());
    if is_there && !force {
        bail!("{} is there already; --force writes over it", path.display());
    }
    check(path)
}

/// Writes a file that appears whole or not at all.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    output_file::write(path, bytes).with_context(|| cannot_write(path))
}

/// Begins a file that is written in parts, and appears whole or not at all.
pub(crate) fn create(path: &Path) -> anyhow::Result<OutputFile> {
    OutputFile::create(path).with_context(|| cannot_write(path))
}

/// Puts a file that was written in parts in its place.
pub(crate) fn finish(path: &Path, file: OutputFile) -> anyhow::Result<()> {
    file.finish().with_context(|| cannot_write(path))
}

/// Makes the folder for several files; one that exists is used.
pub(crate) fn make_folder(path: &Path) -> anyhow::Result<()> {
    output_file::make_folder(path).with_context(|| format!("cannot make {}", path.display()))
}

fn cannot_write(path: &Path) -> String {
    format!("cannot write {}", path.display())
}
