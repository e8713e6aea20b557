//! Files and folders that a command writes, with errors that name them.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use polyptych_files::output_file::{self, OutputFile};

/// Extensions of files that a person may have written, or that cannot be made again.
const SOURCES: [&str; 10] =
    ["toml", "gltf", "glb", "bin", "hdr", "pfm", "rec", "incident", "py", "rs"];

/// Checks that a picture or a report can be written at this path, before the work that makes it.
/// A source that exists is no place for one.
pub(crate) fn check(path: &Path) -> anyhow::Result<()> {
    let is_named = |of: &OsStr| SOURCES.iter().any(|name| of.eq_ignore_ascii_case(name));
    let is_source = path.extension().is_some_and(is_named);
    if is_source && path.exists() {
        let file = path.display();
        bail!("{file} is a source, which a picture or report would replace; name another file");
    }
    check_writable(path)
}

fn check_writable(path: &Path) -> anyhow::Result<()> {
    output_file::check(path).with_context(|| cannot_write(path))
}

/// Checks that a source can be written at this path. A source that exists may have been edited by
/// a person, and is only replaced with `force`; pictures and reports are replaced without it.
pub(crate) fn check_source(path: &Path, force: bool) -> anyhow::Result<()> {
    let is_there = std::fs::symlink_metadata(path).is_ok_and(|m| m.is_file() || m.is_symlink());
    if is_there && !force {
        bail!("{} is there already; --force writes over it", path.display());
    }
    check_writable(path)
}

/// Checks that a file that is made of these others can be written at this path, as
/// [`check_source`]; it replaces none of those, not even with `force`.
pub(crate) fn check_made(path: &Path, force: bool, inputs: &[PathBuf]) -> anyhow::Result<()> {
    if let Ok(target) = path.canonicalize()
        && inputs.iter().any(|input| input.canonicalize().is_ok_and(|input| input == target))
    {
        bail!("{} is a file that it is made of; name another folder", path.display());
    }
    check_source(path, force)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_replaces_pictures_and_no_source() {
        let folder = tempfile::tempdir().expect("a folder");
        let [wall, picture, new] =
            ["wall.toml", "wall.svg", "new.toml"].map(|name| folder.path().join(name));
        std::fs::write(&wall, "[wall]").expect("written");
        std::fs::write(&picture, "<svg/>").expect("written");
        let error = check(&wall).expect_err("it is a wall file").to_string();
        assert!(error.contains("wall.toml is a source"), "{error}");
        check(&picture).expect("pictures are replaced");
        check(&new).expect("nothing is lost");
        check_source(&wall, true).expect("it was asked for");
    }

    #[test]
    fn a_source_is_known_however_its_extension_is_written() {
        let folder = tempfile::tempdir().expect("a folder");
        for (name, is_source) in
            [("town.GLB", true), ("sky.hdr", true), ("warp.Pfm", true), ("wall.PNG", false)]
        {
            let path = folder.path().join(name);
            check(&path).unwrap_or_else(|error| panic!("{name} is new: {error}"));
            std::fs::write(&path, b"made by hand").expect("written");
            assert_eq!(check(&path).is_err(), is_source, "{name}");
        }
    }
}
