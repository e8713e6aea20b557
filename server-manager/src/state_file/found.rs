//! The file that a manager finds at its start. Only if there is none did the wall keep no state: a
//! file that cannot be read is not written over.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Read};
use std::path::PathBuf;

use polyptych_files::blob::BlobHash;
use polyptych_files::storage_fault::{self, RETRY_PAUSE, RETRY_TIME_MAX};
use tokio::time::Instant;

use super::{MAGIC, MAGIC_OF_ALL, MEMORY_BYTES_MAX, Saved, StateFile, VALUES_BYTES_MAX};
use crate::lease::LeaseFileError;

/// The content of the path of a state file.
#[derive(Debug, PartialEq)]
pub(crate) enum Found {
    /// No file: the wall begins without a state.
    Nothing,
    /// A state.
    Saved(Box<Saved>),
    /// A file of a manager that is of no use, with the reason. A copy of it is kept.
    Damaged(String),
}

/// The reason why a state file must not be written.
#[derive(Debug, thiserror::Error)]
pub(crate) enum LoadError {
    /// It is another program's file, a folder, a pipe or a device.
    #[error("{}: {what}, not a state file of a manager; name another or remove it", path.display())]
    Foreign {
        /// The path.
        path: PathBuf,
        /// What is there.
        what: &'static str,
    },
    /// The system does not give its content.
    #[error(
        "the state file {} cannot be read: {source}; mount its storage and let this user read it, \
         or name another file",
        path.display()
    )]
    Unreadable {
        /// The path.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// A manager has written it, and it is not there.
    #[error(
        "the state file {0} is missing, though a manager of this wall has written it; mount its \
         storage or put it back; to begin without a state, end all managers of this wall and \
         remove {0}.lease"
    )]
    Missing(String),
    /// The lease beside it cannot be read, which says whether it was written.
    #[error(transparent)]
    Lease(#[from] LeaseFileError),
}

impl LoadError {
    /// Returns whether another attempt may find the file.
    fn may_pass(&self) -> bool {
        match self {
            Self::Foreign { .. } => false,
            // The target of a link may be on storage that is not mounted yet.
            Self::Unreadable { source, .. } => {
                source.kind() == ErrorKind::NotFound || storage_fault::may_pass(source)
            }
            Self::Missing(_) | Self::Lease(_) => true,
        }
    }
}

impl StateFile {
    /// Reads the file at the start of a manager. One that cannot be read is tried again for a
    /// while, unless only a person can help. If there is none, [`save`](Self::save) writes over
    /// none that appears later.
    ///
    /// # Errors
    /// [`LoadError`] of the last attempt.
    pub async fn load(&mut self) -> Result<Found, LoadError> {
        let found = load_patiently(|| self.load_once()).await?;
        self.expects_none = matches!(found, Found::Nothing);
        Ok(found)
    }

    fn load_once(&self) -> Result<Found, LoadError> {
        let found = self.look()?;
        if let (Found::Nothing, Some(lead)) = (&found, &self.fence)
            && lead.has_written_state()?
        {
            return Err(LoadError::Missing(self.path.display().to_string()));
        }
        Ok(found)
    }

    fn look(&self) -> Result<Found, LoadError> {
        let path = &self.path;
        let foreign = |what| LoadError::Foreign { path: path.clone(), what };
        let unreadable = |source| LoadError::Unreadable { path: path.clone(), source };
        match fs::symlink_metadata(path) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Found::Nothing),
            Err(error) => return Err(unreadable(error)),
            Ok(_) => {}
        }
        // A link that leads to nothing may lead to storage that is not mounted.
        let facts = fs::metadata(path).map_err(unreadable)?;
        if facts.is_dir() {
            return Err(foreign("a folder"));
        }
        // Opening a pipe waits for its writer.
        if !facts.is_file() {
            return Err(foreign("a pipe or a device"));
        }
        let file = File::open(path).map_err(unreadable)?;
        let mut bytes = Vec::new();
        file.take(MEMORY_BYTES_MAX + 1).read_to_end(&mut bytes).map_err(unreadable)?;
        // One that was torn before it was whole is ours, too.
        if !MAGIC_OF_ALL.starts_with(&bytes[..bytes.len().min(MAGIC_OF_ALL.len())]) {
            return Err(foreign("another file"));
        }
        Ok(match decode(&bytes) {
            Ok(saved) => Found::Saved(Box::new(saved)),
            Err(reason) => Found::Damaged(reason),
        })
    }
}

async fn load_patiently(
    mut load_once: impl FnMut() -> Result<Found, LoadError>,
) -> Result<Found, LoadError> {
    let until = Instant::now() + RETRY_TIME_MAX;
    let mut is_told = false;
    loop {
        match load_once() {
            Err(error) if error.may_pass() && Instant::now() < until => {
                if !std::mem::replace(&mut is_told, true) {
                    tracing::warn!(%error, "cannot load the state yet; trying again");
                }
            }
            loaded => return loaded,
        }
        tokio::time::sleep(RETRY_PAUSE).await;
    }
}

/// The content of these bytes of a state file.
///
/// # Errors
/// The reason why they are of no use.
pub(super) fn decode(bytes: &[u8]) -> Result<Saved, String> {
    if bytes.len() as u64 > MEMORY_BYTES_MAX {
        return Err(format!("it has more than {MEMORY_BYTES_MAX} bytes"));
    }
    let is_other = bytes.starts_with(&MAGIC_OF_ALL) && bytes.len() >= MAGIC.len();
    let whole = bytes.strip_prefix(&MAGIC).and_then(|bytes| bytes.split_at_checked(32));
    let Some((hash, saved)) = whole else {
        let is_other = is_other && !bytes.starts_with(&MAGIC);
        let reason = if is_other { "another version has written it" } else { "it is cut short" };
        return Err(reason.to_owned());
    };
    if BlobHash::of(saved).0 != hash {
        return Err("it was damaged".to_owned());
    }
    let decoded = polyptych_codec::decode_within::<_, VALUES_BYTES_MAX>(saved);
    let (wall, memory) = decoded.map_err(|error| error.to_string())?;
    Ok(Saved { wall, memory })
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;
    use std::os::unix::fs::symlink;
    use std::path::Path;

    use polyptych_core::PersistentState;
    use polyptych_wall::Wall;

    use super::*;
    use crate::leadership::{Leadership, Release, Waited};
    use crate::lease::{LEASE_TIME_MIN, LeaseFile};

    /// Numbers of errors of Linux that come and go: EIO, EMFILE, ESTALE.
    const PASSING: [i32; 3] = [5, 24, 116];

    fn wall() -> Wall {
        Wall::new("w", vec![], vec![])
    }

    fn state_at(path: &Path) -> StateFile {
        StateFile::new(path.to_owned(), &wall())
    }

    fn unreadable(source: io::Error) -> LoadError {
        LoadError::Unreadable { path: "wall.state".into(), source }
    }

    #[test]
    fn only_a_missing_file_is_no_state() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        fs::write(at("file"), "").expect("written");
        symlink("loop", at("loop")).expect("linked");
        symlink("unmounted/wall.state", at("link")).expect("linked");
        for name in ["none", "none/deeper"] {
            let found = state_at(&at(name)).look().expect("nothing is there");
            assert_eq!(found, Found::Nothing, "{name}");
        }
        for (name, may_pass) in [("file/below", false), ("loop", true), ("link", true)] {
            let error = state_at(&at(name)).look().expect_err(name);
            assert!(matches!(error, LoadError::Unreadable { .. }), "{error}");
            assert_eq!(error.may_pass(), may_pass, "{error}");
            let (said, path) = (error.to_string(), at(name).display().to_string());
            assert!(said.contains(&path) && said.contains("mount its storage"), "{said}");
        }
        let error = state_at(folder.path()).look().expect_err("a folder");
        assert!(matches!(error, LoadError::Foreign { what: "a folder", .. }), "{error}");
        assert!(!error.may_pass());
    }

    #[tokio::test(start_paused = true)]
    async fn tries_again_what_may_pass_and_nothing_else() {
        let tried = Cell::new(0_usize);
        let load_once = || {
            let number = PASSING.get(tried.replace(tried.get() + 1));
            let error = number.map(|number| io::Error::from_raw_os_error(*number));
            error.map_or(Ok(Found::Nothing), |error| Err(unreadable(error)))
        };
        let found = load_patiently(load_once).await.expect("it is back");
        assert_eq!((found, tried.get()), (Found::Nothing, PASSING.len() + 1));

        let tried = Cell::new(0);
        let refuse = |kind: ErrorKind| {
            tried.set(tried.get() + 1);
            Err(unreadable(kind.into()))
        };
        let refused = load_patiently(|| refuse(ErrorKind::PermissionDenied)).await;
        assert!(refused.is_err() && tried.get() == 1, "{refused:?} after {}", tried.get());

        let start = Instant::now();
        let refused = load_patiently(|| refuse(ErrorKind::TimedOut)).await;
        assert!(refused.is_err_and(|error| error.to_string().contains("wall.state")));
        assert!(tried.get() > 10 && start.elapsed() < 2 * RETRY_TIME_MAX);
    }

    async fn lead(path: &Path, name: &str) -> Leadership {
        let file = LeaseFile::beside(path);
        match Leadership::wait(file, name.into(), LEASE_TIME_MIN, |_| {}).await {
            Ok(Waited::Leads(leadership)) => leadership,
            other => panic!("{other:?}"),
        }
    }

    #[tokio::test]
    async fn a_standby_does_not_begin_without_the_state_that_a_leader_has_written() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("wall.state");
        let first = lead(&path, "first").await;
        let state = state_at(&path).with_fence(Some(first.clone()));
        assert_eq!(state.load_once().expect("a new wall"), Found::Nothing);
        first.release(Release::Ended);
        let second = lead(&path, "second").await;
        let mut state = state_at(&path).with_fence(Some(second.clone()));
        assert_eq!(state.load_once().expect("none was written"), Found::Nothing);
        state.save(&PersistentState::of_wall(&wall()), true).expect("saved");
        second.release(Release::Ended);
        let third = lead(&path, "third").await;
        let state = state_at(&path).with_fence(Some(third.clone()));
        assert!(matches!(state.load_once(), Ok(Found::Saved(_))));
        fs::remove_file(&path).expect("removed");
        let error = state.load_once().expect_err("it was written");
        assert!(error.may_pass() && error.to_string().contains("wall.state.lease"), "{error}");
    }
}
