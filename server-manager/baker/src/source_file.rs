//! Files that a scene names: what is needed of a large one is read when it is, so that no more of
//! it is in memory.

use std::fs::{self, File, Metadata};
use std::io::{self, ErrorKind, Read};
use std::os::unix::fs::{FileExt, MetadataExt};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::SystemTime;

use polyptych_files::blob::{BlobHash, BlobHasher};

use super::check;
use super::error::BakeError;

/// Bytes read at a time, between two looks at the cancel flag.
pub(super) const READ_BYTES: usize = 1 << 20;

/// Files of a scene that stay open: a process may have some hundred.
const OPEN_MAX: usize = 64;

/// The files of one scene, with the first failure to read one of them.
///
/// Parts that cannot be read are left out of a scene with a note; that must not hide a failure of
/// the disk, or a file that changed, as if the scene itself were at fault.
#[derive(Clone, Debug, Default)]
pub(super) struct SourceFiles {
    failure: Arc<Mutex<Option<BakeError>>>,
    /// The number of those that were kept open.
    open: Arc<AtomicUsize>,
}

impl SourceFiles {
    /// Fails if a read of one of the files did.
    ///
    /// # Errors
    /// That of the first read that failed since the last call.
    pub(super) fn check(&self) -> Result<(), BakeError> {
        let failure = self.failure.lock().unwrap_or_else(PoisonError::into_inner).take();
        failure.map_or(Ok(()), Err)
    }

    fn keep(&self, error: BakeError) {
        let mut failure = self.failure.lock().unwrap_or_else(PoisonError::into_inner);
        failure.get_or_insert(error);
    }
}

/// A file that is read again and again, and must stay as it is meanwhile.
///
/// The first files of a scene stay open: what takes their names later is not read. As a scene may
/// name more files than a process may have open, others are opened for each read.
#[derive(Debug)]
pub(super) struct SourceFile {
    path: PathBuf,
    /// The size in bytes.
    pub length: u64,
    facts: FileFacts,
    /// The open file; `None` for one that is opened for each read.
    file: Option<File>,
    files: SourceFiles,
}

/// By what a file is known again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct FileFacts {
    device: u64,
    inode: u64,
    length: u64,
    /// The time of the last change; `None` if the file system does not keep it.
    modified: Option<SystemTime>,
}

impl From<&Metadata> for FileFacts {
    fn from(of: &Metadata) -> Self {
        let (device, inode, length) = (of.dev(), of.ino(), of.len());
        Self { device, inode, length, modified: of.modified().ok() }
    }
}

impl SourceFile {
    /// Hashes a plain file of at most `bytes_max` bytes.
    ///
    /// # Errors
    /// It is not a plain file, is larger, or cannot be read; [`BakeError::Cancelled`].
    pub(super) fn open(
        files: &SourceFiles,
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
        let facts = FileFacts::from(&facts);
        let stays_open = files.open.fetch_add(1, Ordering::Relaxed) < OPEN_MAX;
        let (path, file) = (path.to_path_buf(), stays_open.then_some(file));
        let (length, files) = (facts.length, files.clone());
        Ok((Self { path, length, facts, file, files }, hasher.finish()))
    }

    /// Reads bytes, given with the first one and the length. [`SourceFiles::check`] knows of a
    /// failure too.
    ///
    /// # Errors
    /// They cannot be read, or the file has changed since it was hashed.
    pub(super) fn bytes(&self, first: u64, length: u64, place: &str) -> Result<Vec<u8>, BakeError> {
        match self.read(first, length) {
            Ok(Some(bytes)) => Ok(bytes),
            Ok(None) => {
                let changed = || {
                    let what = format!("{} changed while it was read", self.path.display());
                    BakeError::at(place, what, "a file that rests would be right")
                };
                self.files.keep(changed());
                Err(changed())
            }
            Err(error) => {
                let copy = io::Error::new(error.kind(), error.to_string());
                self.files.keep(BakeError::io(&self.path, copy));
                Err(BakeError::io(&self.path, error))
            }
        }
    }

    /// Reads bytes; `None` if the file has changed, or is another one.
    fn read(&self, first: u64, length: u64) -> io::Result<Option<Vec<u8>>> {
        if let Some(file) = &self.file {
            return self.read_from(file, first, length);
        }
        // Another file is not even opened: it may be a pipe, which would never end.
        if FileFacts::from(&fs::metadata(&self.path)?) != self.facts {
            return Ok(None);
        }
        self.read_from(&File::open(&self.path)?, first, length)
    }

    fn read_from(&self, file: &File, first: u64, length: u64) -> io::Result<Option<Vec<u8>>> {
        let is_same = || file.metadata().map(|facts| FileFacts::from(&facts) == self.facts);
        if !is_same()? {
            return Ok(None);
        }
        let mut bytes = vec![0; length as usize];
        match file.read_exact_at(&mut bytes, first) {
            Err(error) if error.kind() == ErrorKind::UnexpectedEof => return Ok(None),
            read => read?,
        }
        // Behind the read: what was written before is known by now.
        Ok(is_same()?.then_some(bytes))
    }
}

fn open(path: &Path, bytes_max: u64, place: &str) -> Result<(File, Metadata), BakeError> {
    let cannot = |error| BakeError::io(path, error);
    let check = |facts: &Metadata| {
        if !facts.is_file() {
            let what = format!("{} is not a file", path.display());
            return Err(BakeError::at(place, what, "a plain file would be right"));
        }
        if facts.len() > bytes_max {
            let what = format!("{} has {} bytes", path.display(), facts.len());
            return Err(BakeError::at(place, what, format!("at most {bytes_max} can be read")));
        }
        Ok(())
    };
    // Before it is opened, since opening a pipe may never end.
    check(&fs::metadata(path).map_err(cannot)?)?;
    let file = File::open(path).map_err(cannot)?;
    let facts = file.metadata().map_err(cannot)?;
    check(&facts)?;
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
        SourceFile::open(&SourceFiles::default(), path, 100, "file", &AtomicBool::new(false))
            .expect("opened")
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
        let error = SourceFile::open(&SourceFiles::default(), &path, 9, "file", &none);
        let error = error.expect_err("larger").to_string();
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
        let kept = file.files.check().expect_err("who asks later knows too").to_string();
        assert!(kept.contains("a.bin changed while it was read"), "{kept}");
        file.files.check().expect("nothing was read since");
        fs::write(&path, b"0123").expect("shortened");
        assert!(refusal().contains("buffers[0]") && refusal().contains("changed"), "{}", refusal());
        // Other bytes of the same length, at another time.
        fs::write(&path, b"9876543210").expect("written");
        let written = File::options().write(true).open(&path).expect("opened");
        written.set_modified(SystemTime::UNIX_EPOCH).expect("dated");
        assert!(refusal().contains("changed"), "{}", refusal());
    }

    #[test]
    fn never_reads_a_file_that_takes_the_place_of_another() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.bin");
        for is_kept_open in [true, false] {
            fs::write(&path, b"0123456789").expect("written");
            let files = SourceFiles::default();
            if !is_kept_open {
                files.open.store(OPEN_MAX, Ordering::Relaxed);
            }
            let none = AtomicBool::new(false);
            let (file, _) = SourceFile::open(&files, &path, 100, "file", &none).expect("opened");
            assert_eq!(file.file.is_some(), is_kept_open);
            // Another of the same length and time, as someone with bad intent would make it.
            let other = folder.path().join("b.bin");
            fs::write(&other, b"9876543210").expect("written");
            let written = File::options().write(true).open(&other).expect("opened");
            written.set_modified(file.facts.modified.expect("a time")).expect("dated");
            fs::remove_file(&path).expect("removed");
            std::os::unix::fs::symlink(&other, &path).expect("linked");
            let read = file.bytes(0, 10, "file");
            if is_kept_open {
                assert_eq!(read.expect("read"), b"0123456789");
            } else {
                let error = read.expect_err("another").to_string();
                assert!(error.contains("changed"), "{error}");
            }
            fs::remove_file(&path).expect("removed");
        }
    }
}
