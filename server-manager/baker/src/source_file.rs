//! Files that a scene names: what is needed of a large one is read when it is, so that no more of
//! it is in memory.

use std::fs::{self, File, Metadata};
use std::io::{ErrorKind, Read};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::SystemTime;

use polyptych_files::blob::{BlobHash, BlobHasher};

use super::check;
use super::error::BakeError;

/// Bytes read at a time, between two looks at the cancel flag.
pub(super) const READ_BYTES: usize = 1 << 20;

/// A file that is read again and again, and must stay as it is meanwhile.
///
/// It is opened for each read: a scene may name more files than a process may have open.
#[derive(Clone, Debug)]
pub(super) struct SourceFile {
    path: PathBuf,
    /// The size in bytes.
    pub length: u64,
    /// The time of the last change; `None` if the file system does not keep it.
    modified: Option<SystemTime>,
}

impl SourceFile {
    /// Hashes a plain file of at most `bytes_max` bytes.
    ///
    /// # Errors
    /// It is not a plain file, is larger, or cannot be read; [`BakeError::Cancelled`].
    pub(super) fn open(
        path: &Path,
        bytes_max: u64,
        place: &str,
        cancel: &AtomicBool,
    ) -> Result<(Self, BlobHash), BakeError> {
        let (mut file, facts) = open(path, bytes_max, place)?;
        let mut hasher = BlobHasher::default();
        let mut part = vec![0; READ_BYTES];
        loop {
            check(cancel)?;
            match file.read(&mut part).map_err(|error| BakeError::io(path, error))? {
                0 => break,
                count => hasher.update(&part[..count]),
            }
        }
        let (length, modified) = (facts.len(), facts.modified().ok());
        Ok((Self { path: path.to_path_buf(), length, modified }, hasher.finish()))
    }

    /// Reads bytes, given with the first one and the length.
    ///
    /// # Errors
    /// They cannot be read, or the file has changed since it was hashed.
    pub(super) fn bytes(&self, first: u64, length: u64, place: &str) -> Result<Vec<u8>, BakeError> {
        let cannot = |error| BakeError::io(&self.path, error);
        let changed = || {
            let what = format!("{} changed while it was read", self.path.display());
            BakeError::at(place, what, "a file that rests would be right")
        };
        let file = File::open(&self.path).map_err(cannot)?;
        let mut bytes = vec![0; length as usize];
        file.read_exact_at(&mut bytes, first).map_err(|error| match error.kind() {
            ErrorKind::UnexpectedEof => changed(),
            _ => cannot(error),
        })?;
        // Behind the read: what was written before is known by now.
        let facts = file.metadata().map_err(cannot)?;
        let is_same = facts.len() == self.length && facts.modified().ok() == self.modified;
        if is_same { Ok(bytes) } else { Err(changed()) }
    }
}

fn open(path: &Path, bytes_max: u64, place: &str) -> Result<(File, Metadata), BakeError> {
    let facts = fs::metadata(path).map_err(|error| BakeError::io(path, error))?;
    if !facts.is_file() {
        let what = format!("{} is not a file", path.display());
        return Err(BakeError::at(place, what, "a plain file would be right"));
    }
    if facts.len() > bytes_max {
        let what = format!("{} has {} bytes", path.display(), facts.len());
        return Err(BakeError::at(place, what, format!("at most {bytes_max} can be read")));
    }
    let file = File::open(path).map_err(|error| BakeError::io(path, error))?;
    Ok((file, facts))
}

/// Reads all of a plain file of at most `bytes_max` bytes.
///
/// # Errors
/// It is not a plain file, is larger, or cannot be read; [`BakeError::Cancelled`].
pub(super) fn read(
    path: &Path,
    bytes_max: u64,
    place: &str,
    cancel: &AtomicBool,
) -> Result<Vec<u8>, BakeError> {
    let (mut file, facts) = open(path, bytes_max, place)?;
    let mut bytes = Vec::with_capacity(usize::try_from(facts.len()).unwrap_or(0));
    loop {
        check(cancel)?;
        let left = facts.len().saturating_sub(bytes.len() as u64);
        let mut part = (&mut file).take(left.min(READ_BYTES as u64));
        if part.read_to_end(&mut bytes).map_err(|error| BakeError::io(path, error))? == 0 {
            return Ok(bytes);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn opened(path: &Path) -> (SourceFile, BlobHash) {
        SourceFile::open(path, 100, "file", &AtomicBool::new(false)).expect("opened")
    }

    #[test]
    fn reads_parts_of_a_file_as_it_was_hashed() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.bin");
        fs::write(&path, b"0123456789").expect("written");
        let (file, hash) = opened(&path);
        assert_eq!((file.length, hash), (10, BlobHash::of(b"0123456789")));
        assert_eq!(file.bytes(3, 4, "file").expect("read"), b"3456");
        assert_eq!(file.bytes(10, 0, "file").expect("read"), b"");
        let none = AtomicBool::new(false);
        let error = SourceFile::open(&path, 9, "file", &none).expect_err("larger").to_string();
        assert!(error.contains("has 10 bytes") && error.contains("at most 9"), "{error}");
    }

    #[test]
    fn refuses_a_file_that_has_changed() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.bin");
        fs::write(&path, b"0123456789").expect("written");
        let (file, _) = opened(&path);
        let refusal = || file.bytes(0, 8, "buffers[0]").expect_err("changed").to_string();
        fs::write(&path, b"01234567").expect("shortened");
        assert!(refusal().contains("a.bin changed while it was read"), "{}", refusal());
        fs::write(&path, b"0123").expect("shortened");
        assert!(refusal().contains("buffers[0]") && refusal().contains("changed"), "{}", refusal());
        // Other bytes of the same length, at another time.
        fs::write(&path, b"9876543210").expect("written");
        let written = File::options().write(true).open(&path).expect("opened");
        written.set_modified(SystemTime::UNIX_EPOCH).expect("dated");
        assert!(refusal().contains("changed"), "{}", refusal());
    }
}
