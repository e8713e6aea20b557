//! Copies of a state file that are kept beside it, where a manager does not go on with all of it:
//! each is whole, and none is written over another.
//!
//! ```text
//! wall.state  ->  wall.state.old, wall.state.old-2, wall.state.old-3 …
//! ```

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use super::StateFile;

/// Maximum number of copies of a state file: more of them tell a person nothing.
const COPIES_MAX: u32 = 64;

/// The extension of the first copy.
const EXTENSION: &str = "old";

/// The reason why no copy of a state file was kept.
#[derive(Debug, thiserror::Error)]
pub(crate) enum KeepError {
    /// All names of copies are taken, from this path on.
    #[error("{COPIES_MAX} copies are there, from {} on; move some", .0.display())]
    Full(PathBuf),
    /// The file cannot be copied.
    #[error(transparent)]
    Io(#[from] io::Error),
}

impl StateFile {
    /// Keeps the file as it is under a name of its own. Returns that path; if such a copy is there
    /// already, that of this one.
    ///
    /// # Errors
    /// [`KeepError`]; no copy is written over then.
    pub fn keep_copy(&self) -> Result<PathBuf, KeepError> {
        let paths = || (1..=COPIES_MAX).map(|number| copy_path(&self.path, number));
        // A manager that fails again and again fills no disk.
        if let Some(kept) = paths().find(|path| is_same(&self.path, path).unwrap_or(false)) {
            return Ok(kept);
        }
        let folder = self.folder();
        let mut copy = tempfile::Builder::new().prefix(".state-").tempfile_in(folder)?;
        io::copy(&mut File::open(&self.path)?, copy.as_file_mut())?;
        copy.as_file().sync_all()?;
        for path in paths() {
            match copy.persist_noclobber(&path) {
                Ok(_) => {
                    // The name is in the folder.
                    File::open(folder)?.sync_all()?;
                    return Ok(path);
                }
                Err(taken) if taken.error.kind() == ErrorKind::AlreadyExists => copy = taken.file,
                Err(failed) => return Err(failed.error.into()),
            }
        }
        Err(KeepError::Full(copy_path(&self.path, 1)))
    }
}

/// Returns the state file that this path names or, if it names a copy, of which that is one.
pub(crate) fn original(path: &Path) -> PathBuf {
    let extension = path.extension().and_then(OsStr::to_str);
    let number = extension.and_then(|extension| extension.strip_prefix(EXTENSION));
    let is_copy = number.is_some_and(|number| {
        let number = number.strip_prefix('-').map(str::parse::<u32>);
        extension == Some(EXTENSION) || number.is_some_and(|number| number.is_ok())
    });
    if is_copy { path.with_extension("") } else { path.to_owned() }
}

fn copy_path(path: &Path, number: u32) -> PathBuf {
    match number {
        1 => path.with_added_extension(EXTENSION),
        _ => path.with_added_extension(format!("{EXTENSION}-{number}")),
    }
}

/// Returns whether two files have the same content.
fn is_same(one: &Path, other: &Path) -> io::Result<bool> {
    Ok(fs::metadata(one)?.len() == fs::metadata(other)?.len() && fs::read(one)? == fs::read(other)?)
}

#[cfg(test)]
mod tests {
    use polyptych_wall::Wall;

    use super::*;

    #[test]
    fn copies_are_whole_and_never_written_over() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("wall.state");
        let state = StateFile::new(path.clone(), &Wall::new("w", vec![], vec![]));
        // Something else may have the name of a copy.
        let expected = ["wall.state.old", "wall.state.old-3"].map(|name| folder.path().join(name));
        fs::create_dir(folder.path().join("wall.state.old-2")).expect("made");
        for (content, copy) in ["first", "second"].into_iter().zip(&expected) {
            fs::write(&path, content).expect("written");
            for _ in 0..2 {
                assert_eq!(&state.keep_copy().expect("kept"), copy);
            }
            assert_eq!(fs::read_to_string(copy).expect("read"), content);
            assert_eq!(fs::read_to_string(&path).expect("still there"), content);
        }
        assert_eq!(fs::read_to_string(&expected[0]).expect("read"), "first");
        assert_eq!(fs::read_dir(folder.path()).expect("listed").count(), 4, "and nothing else");
        for copy in &expected {
            assert_eq!(original(copy), path);
        }
        for name in ["wall.state", "wall", "wall.older", "wall.old-x", "wall.old-"] {
            assert_eq!(original(Path::new(name)), Path::new(name));
        }
    }

    #[test]
    fn a_copy_that_cannot_be_kept_leaves_the_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("wall.state");
        let state = StateFile::new(path.clone(), &Wall::new("w", vec![], vec![]));
        fs::write(&path, "only one").expect("written");
        for number in 1..=COPIES_MAX {
            fs::write(copy_path(&path, number), number.to_string()).expect("written");
        }
        let error = state.keep_copy().expect_err("no name is free");
        assert!(matches!(error, KeepError::Full(_)), "{error:?}");
        let error = error.to_string();
        assert!(error.contains("64 copies") && error.contains("wall.state.old on"), "{error}");
        assert_eq!(fs::read_to_string(&path).expect("read"), "only one");
        let files = fs::read_dir(folder.path()).expect("listed").count();
        assert_eq!(files, COPIES_MAX as usize + 1, "nothing half done");
        fs::remove_file(&path).expect("removed");
        let error = state.keep_copy().expect_err("there is nothing to copy");
        assert!(matches!(error, KeepError::Io(_)), "{error:?}");
    }
}
