//! Keeps two managers from one state file: each would write over what the other remembers.
//!
//! Storage that fails for a moment is tried again, as the file is when it is loaded.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use polyptych_files::{output_file, storage_fault};

/// Maximum bytes of a lock file that are read: a process id.
const PID_BYTES_MAX: u64 = 32;

/// A lock that is held until this is dropped, or the process ends in whatever way.
#[derive(Debug)]
pub(crate) struct StateLock {
    #[expect(dead_code, reason = "the lock ends when the file is closed")]
    file: Option<File>,
}

impl StateLock {
    /// Takes the lock of a state file: of `FILE.lock` beside it, since the state file itself is
    /// replaced with each change. The lock file stays; only the lock on it counts.
    ///
    /// # Errors
    /// Another manager holds it, with its process id; or a state file cannot be there.
    pub fn take(state: &Path) -> anyhow::Result<Self> {
        Self::lock(state, false)
    }

    /// Takes the lock of a state file that managers share, of which one leads by a lease. None of
    /// them runs beside a manager that has the file alone.
    ///
    /// # Errors
    /// Those of [`take`](Self::take).
    pub fn share(state: &Path) -> anyhow::Result<Self> {
        Self::lock(state, true)
    }

    fn lock(state: &Path, is_shared: bool) -> anyhow::Result<Self> {
        let named = || format!("--state {}", state.display());
        patiently(state, || check_place(state)).with_context(named)?;
        let path = lock_path(state);
        let locked = || format!("cannot lock {}; name another file with --state", path.display());
        let mut file = patiently(&path, || open(&path)).with_context(locked)?;
        match if is_shared { file.try_lock_shared() } else { file.try_lock() } {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let holder = holder(&mut file);
                bail!(
                    "{}: {holder} keeps its state there (it holds {}); end it, name another \
                     file with --state, or give both --standby",
                    state.display(),
                    path.display()
                );
            }
            Err(TryLockError::Error(error)) => {
                let path = path.display();
                tracing::warn!(%path, %error, "cannot lock; take care that no other manager runs");
                return Ok(Self { file: None });
            }
        }
        // For the message above only: what matters is the lock.
        let _ = write_pid(&mut file);
        Ok(Self { file: Some(file) })
    }
}

/// Returns the path of the state file itself: its lock and its lease stand beside it, not beside a
/// link to it, which saving would replace. One that is not there has the path that was given.
///
/// # Errors
/// The path cannot be followed, after several attempts unless only a person can help.
pub(crate) fn resolve(state: &Path) -> io::Result<PathBuf> {
    patiently(state, || match state.canonicalize() {
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(state.to_owned()),
        found => found,
    })
}

/// Tries again what fails on storage that may be back in a moment.
fn patiently<T>(path: &Path, attempt: impl FnMut() -> io::Result<T>) -> io::Result<T> {
    storage_fault::retry(attempt, |error| {
        tracing::warn!(path = %path.display(), %error, "cannot use the state yet; trying again");
    })
}

/// Checks that a state file is there or can be; makes its folder.
fn check_place(state: &Path) -> io::Result<()> {
    if state.symlink_metadata().is_ok() {
        output_file::check(state)?;
    }
    match state.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        Some(folder) => output_file::make_folder(folder),
        None => Ok(()),
    }
}

/// Opens a lock file, which is made if it is not there.
fn open(path: &Path) -> io::Result<File> {
    if path.symlink_metadata().is_ok() {
        output_file::check(path)?;
    }
    OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path)
}

fn lock_path(state: &Path) -> PathBuf {
    state.with_added_extension("lock")
}

/// Returns who holds a lock, in words.
fn holder(file: &mut File) -> String {
    let mut text = String::new();
    let read = file.take(PID_BYTES_MAX).read_to_string(&mut text);
    let pid = read.ok().and_then(|_| text.trim().parse::<u32>().ok());
    pid.map_or_else(|| "another manager".to_owned(), |pid| format!("the manager of process {pid}"))
}

fn write_pid(file: &mut File) -> io::Result<()> {
    file.set_len(0)?;
    file.seek(SeekFrom::Start(0))?;
    writeln!(file, "{}", std::process::id())
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::os::unix::fs::symlink;

    use super::*;

    #[test]
    fn a_state_file_has_one_manager_at_a_time() {
        let folder = tempfile::tempdir().expect("a folder");
        let state = folder.path().join("new/wall.state");
        let held = StateLock::take(&state).expect("nobody has it");
        let refused = format!("{:#}", StateLock::take(&state).expect_err("held"));
        let pid = std::process::id().to_string();
        for part in [&*pid, "wall.state.lock", "--state"] {
            assert!(refused.contains(part), "{part}: {refused}");
        }
        drop(held);
        let shared = [0, 1].map(|_| StateLock::share(&state).expect("shared"));
        StateLock::take(&state).expect_err("two have it");
        drop(shared);
        // What a killed process left is no obstacle.
        fs::write(lock_path(&state), "not a number").expect("written");
        StateLock::take(&state).expect("free again");
    }

    #[test]
    fn resolves_links_and_files_that_are_not_there() {
        let folder = tempfile::tempdir().expect("a folder");
        let folder = folder.path().canonicalize().expect("followed");
        let at = |name: &str| folder.join(name);
        fs::write(at("wall.state"), "").expect("written");
        symlink("wall.state", at("link")).expect("linked");
        symlink("unmounted/wall.state", at("dangling")).expect("linked");
        for (name, file) in [
            ("wall.state", "wall.state"),
            ("link", "wall.state"),
            ("none/wall.state", "none/wall.state"),
            ("dangling", "dangling"),
        ] {
            assert_eq!(resolve(&at(name)).expect(name), at(file));
        }
        let error = resolve(&at("wall.state/below")).expect_err("not a folder");
        assert_eq!(error.kind(), ErrorKind::NotADirectory);
    }

    #[test]
    fn tries_storage_again_that_fails_for_a_moment() {
        let mut tried = 0;
        let attempt = || {
            tried += 1;
            // ESTALE of Linux.
            if tried == 1 { Err(io::Error::from_raw_os_error(116)) } else { Ok(tried) }
        };
        assert_eq!(patiently(Path::new("wall.state"), attempt).expect("it is back"), 2);
    }

    #[test]
    fn refuses_a_state_file_that_is_none() {
        let folder = tempfile::tempdir().expect("a folder");
        let beside_folder = folder.path().join("wall.state");
        fs::create_dir(lock_path(&beside_folder)).expect("made");
        let odd = ["/dev/null", "/dev/null/state", "/proc/wall.state"].map(PathBuf::from);
        for path in odd.into_iter().chain([folder.path().to_owned(), beside_folder]) {
            let refused = format!("{:#}", StateLock::take(&path).expect_err("no file"));
            assert!(refused.contains("--state"), "{refused}");
        }
    }
}
