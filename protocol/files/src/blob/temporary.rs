//! Files under way: written under a name of their own, and put into place when they are whole.
//!
//! A process that is killed leaves such a file behind. Its writer holds a lock on it, which ends
//! with the process, so that a file without a lock can be told from one that is being written.

use std::fs::{self, File};
use std::io::{self, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use tempfile::NamedTempFile;

/// The start and the end of the names of unfinished files; no other file is ever removed.
const PREFIX: &str = ".polyptych-";
const SUFFIX: &str = ".part";

/// Maximum number of names to try: a process that removes abandoned files may take one away before
/// its writer has locked it.
const TRIES_MAX: usize = 8;

/// Files that were removed since no process was writing them any more.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Abandoned {
    /// The number of files.
    pub files: u64,
    /// Their size in all, in bytes.
    pub bytes: u64,
}

/// Writes a file into `folder` that appears at `path`, in the same file system, whole or not at
/// all.
///
/// # Errors
/// The system's reason; nothing is left behind then.
pub fn place(folder: &Path, path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = begin(folder)?;
    file.write_all(bytes)?;
    file.persist(path).map_err(|error| error.error)?;
    Ok(())
}

fn begin(folder: &Path) -> io::Result<NamedTempFile> {
    for _ in 0..TRIES_MAX {
        let mut builder = tempfile::Builder::new();
        // Others may read them, as the umask allows: servers in a shared folder, web servers.
        builder.permissions(fs::Permissions::from_mode(0o644));
        let file = builder.prefix(PREFIX).suffix(SUFFIX).tempfile_in(folder)?;
        // A file system without locks has no abandoned files that could be told, and none is
        // removed from it.
        let is_taken = matches!(file.as_file().try_lock(), Err(fs::TryLockError::WouldBlock));
        if !is_taken && file.path().exists() {
            return Ok(file);
        }
    }
    Err(io::Error::other("files under way are taken away; is another program at work there?"))
}

/// Removes the files that killed processes left in this folder, not in those below it. A folder
/// that is not there has none.
pub fn remove_abandoned(folder: &Path) -> Abandoned {
    let mut removed = Abandoned::default();
    let Ok(entries) = fs::read_dir(folder) else { return removed };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let is_ours = name.to_str().is_some_and(|n| n.starts_with(PREFIX) && n.ends_with(SUFFIX));
        if !is_ours || !entry.file_type().is_ok_and(|kind| kind.is_file()) {
            continue;
        }
        let Ok(file) = File::options().write(true).open(entry.path()) else { continue };
        if file.try_lock().is_ok()
            && let Ok(facts) = file.metadata()
            && fs::remove_file(entry.path()).is_ok()
        {
            removed.files += 1;
            removed.bytes += facts.len();
        }
    }
    removed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn removes_what_killed_processes_left_and_nothing_else() {
        let root = tempfile::tempdir().expect("a temporary folder");
        let at = |name: &str| root.path().join(name);
        // What is left of a process that was killed: its file, without its lock.
        fs::write(at(".polyptych-dead.part"), [0; 100]).expect("written");
        fs::write(at(".polyptych-short.part"), "").expect("written");
        for other in ["mine.part", ".polyptych-notes", ".tmpAbCdEf"] {
            fs::write(at(other), "mine").expect("written");
        }
        fs::create_dir(at(".polyptych-folder.part")).expect("made");
        let mut living = begin(root.path()).expect("begun");
        living.write_all(b"half").expect("written");
        let removed = remove_abandoned(root.path());
        assert_eq!(removed, Abandoned { files: 2, bytes: 100 });
        assert_eq!(remove_abandoned(root.path()), Abandoned::default());
        let left = fs::read_dir(root.path()).expect("read").count();
        assert_eq!(left, 5, "three files, a folder, and one that is being written");
        living.persist(at("whole")).expect("put into place");
        // Of a folder that others read, as far as the umask lets them.
        let mode = |name: &str| fs::metadata(at(name)).expect("facts").permissions().mode() & 0o777;
        assert_eq!(mode("whole"), mode("mine.part"));
        assert_eq!(fs::read(at("whole")).expect("read"), b"half");
        assert_eq!(remove_abandoned(&at("nowhere")), Abandoned::default());
    }
}
