//! The lease record as a file on shared storage, which is read and written under a lock.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::thread::park_timeout;
use std::time::{Duration, Instant};

use polyptych_files::storage_fault;

use super::LeaseRecord;

/// Maximum time to wait for the lock: it is held for one read and one write.
const LOCK_TIME_MAX: Duration = Duration::from_millis(500);

/// Pause between two attempts to get the lock.
const LOCK_PAUSE: Duration = Duration::from_millis(2);

/// Size of a record in bytes, with spaces behind it, and maximum size of one that is read; a
/// holder's name is short.
const RECORD_BYTES_MAX: u64 = 4 << 10;

/// The file of a lease, and a file beside it for the lock, which is never replaced.
#[derive(Clone, Debug)]
pub struct LeaseFile {
    path: PathBuf,
    lock: PathBuf,
}

/// The reason why a lease could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum LeaseFileError {
    /// The storage failed.
    #[error("the lease file {} cannot be used: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// Another process has held the lock for too long; one that was stopped within a write does.
    #[error(
        "{} was locked by another manager for {} ms; end that process if it has been stopped",
        .0.display(), LOCK_TIME_MAX.as_millis()
    )]
    Locked(PathBuf),
    /// The file holds something else.
    #[error("{} is not a lease file: {reason}; end all managers of this wall and remove it",
        path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
}

impl LeaseFileError {
    /// Returns whether another look may succeed.
    pub fn may_pass(&self) -> bool {
        match self {
            Self::Io { source, .. } => storage_fault::may_pass(source),
            Self::Locked(_) => true,
            Self::Damaged { .. } => false,
        }
    }
}

impl LeaseFile {
    /// The lease of the wall with this state file: `FILE.lease` beside it.
    pub fn beside(state: &Path) -> Self {
        let path = state.with_added_extension("lease");
        let lock = path.with_added_extension("lock");
        Self { path, lock }
    }

    /// Calls `work` with the record, `None` if there is no file, while no other process does; if
    /// it returns a record, that is written before the next process reads.
    ///
    /// # Errors
    /// [`LeaseFileError`]; nothing was written then, or `work` did not run.
    pub fn locked<T>(
        &self,
        work: impl FnOnce(Option<&LeaseRecord>) -> (Option<LeaseRecord>, T),
    ) -> Result<T, LeaseFileError> {
        let _lock = self.take_lock()?;
        let found = self.read()?;
        let (record, done) = work(found.as_ref());
        if let Some(record) = record {
            // A term that was seen must never be given again, a power cut or not.
            let is_new_term = found.is_none_or(|found| found.term != record.term);
            self.write(&record, is_new_term).map_err(|source| self.failed(source))?;
        }
        Ok(done)
    }

    fn take_lock(&self) -> Result<File, LeaseFileError> {
        let mut options = OpenOptions::new();
        let options = options.read(true).write(true).create(true).truncate(false);
        let file = options.open(&self.lock).map_err(|source| self.failed(source))?;
        let until = Instant::now() + LOCK_TIME_MAX;
        loop {
            match file.try_lock() {
                Ok(()) => return Ok(file),
                Err(TryLockError::WouldBlock) if Instant::now() < until => park_timeout(LOCK_PAUSE),
                Err(TryLockError::WouldBlock) => {
                    return Err(LeaseFileError::Locked(self.lock.clone()));
                }
                Err(TryLockError::Error(source)) => return Err(self.failed(source)),
            }
        }
    }

    fn read(&self) -> Result<Option<LeaseRecord>, LeaseFileError> {
        let bytes = match fs::metadata(&self.path) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            Err(source) => return Err(self.failed(source)),
            Ok(facts) if !facts.is_file() || facts.len() > RECORD_BYTES_MAX => {
                return Err(self.damaged("it is too large, or no file".to_owned()));
            }
            Ok(_) => fs::read(&self.path).map_err(|source| self.failed(source))?,
        };
        serde_json::from_slice(&bytes).map(Some).map_err(|error| self.damaged(error.to_string()))
    }

    /// Writes over the record that is there, in one sector: neither a power cut nor a full disk
    /// leaves a file without one.
    fn write(&self, record: &LeaseRecord, is_durable: bool) -> io::Result<()> {
        let mut bytes = serde_json::to_vec(record)?;
        // What JSON has behind it is of no account.
        bytes.resize(bytes.len().max(RECORD_BYTES_MAX as usize), b' ');
        let mut file = match OpenOptions::new().write(true).open(&self.path) {
            Err(error) if error.kind() == ErrorKind::NotFound => return self.create(&bytes),
            opened => opened?,
        };
        file.write_all(&bytes)?;
        if is_durable { file.sync_all() } else { Ok(()) }
    }

    fn create(&self, bytes: &[u8]) -> io::Result<()> {
        // Always the same name: only the holder of the lock writes.
        let new = self.path.with_added_extension("new");
        let mut file = File::create(&new)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        fs::rename(&new, &self.path)?;
        let folder = self.path.parent().filter(|folder| !folder.as_os_str().is_empty());
        File::open(folder.unwrap_or(Path::new(".")))?.sync_all()
    }

    pub(crate) fn failed(&self, source: io::Error) -> LeaseFileError {
        LeaseFileError::Io { path: self.path.clone(), source }
    }

    fn damaged(&self, reason: String) -> LeaseFileError {
        LeaseFileError::Damaged { path: self.path.clone(), reason }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(term: u64) -> LeaseRecord {
        let holder = "a".to_owned();
        let (is_released, is_stopped, has_state) = (false, false, false);
        LeaseRecord { term, renewal: 0, holder, lease_ms: 1000, is_released, is_stopped, has_state }
    }

    #[test]
    fn keeps_a_record_and_excludes_others_meanwhile() {
        let folder = tempfile::tempdir().expect("a folder");
        let lease = LeaseFile::beside(&folder.path().join("wall.state"));
        let other = lease.clone();
        let locked = lease.locked(|found| {
            assert_eq!(found, None);
            let refused = other.locked(|_| (None, ()));
            assert!(matches!(refused, Err(LeaseFileError::Locked(_))), "{refused:?}");
            (Some(record(7)), ())
        });
        locked.expect("written");
        let found = lease.locked(|found| (None, found.cloned())).expect("read");
        assert_eq!(found, Some(record(7)));
    }

    #[test]
    fn refuses_a_damaged_record_and_leaves_it() {
        let folder = tempfile::tempdir().expect("a folder");
        let lease = LeaseFile::beside(&folder.path().join("wall.state"));
        for bytes in ["", "{\"term\":1", "[1,2]"] {
            fs::write(&lease.path, bytes).expect("written");
            let refused = lease.locked(|_| (Some(record(1)), ())).expect_err("damaged");
            assert!(refused.to_string().contains("remove it"), "{refused}");
            assert_eq!(fs::read_to_string(&lease.path).expect("read"), bytes);
        }
    }
}
