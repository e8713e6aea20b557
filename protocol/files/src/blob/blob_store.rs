//! A folder of blobs: what the baker writes, servers cache and a shared disk holds.
//!
//! ```text
//! FOLDER/3f/3fa1...    64 hexadecimal digits; the bytes hash to the name
//! ```
//!
//! A file appears whole or not at all, so several processes may share a folder.

use std::path::{Path, PathBuf};
use std::{fs, io};

use bytes::Bytes;

use super::BlobReader;
use super::temporary::{Abandoned, place, remove_abandoned};
use crate::blob::{BLOB_BYTES_MAX, BlobHash};

/// The reason why a blob could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum BlobError {
    /// The file system says so.
    #[error("{path}: {source}")]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// The bytes are not what the name says; the file was removed.
    #[error("{path} was damaged: its bytes don't hash to its name")]
    Damaged {
        /// The file.
        path: PathBuf,
    },
    /// Larger than any blob.
    #[error("{path} has {bytes} bytes, where a blob has at most {BLOB_BYTES_MAX}")]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Its size.
        bytes: u64,
    },
}

/// A folder of blobs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BlobStore {
    root: PathBuf,
    /// `true` where others write: what looks damaged may be a file that is still being copied.
    is_foreign: bool,
}

impl BlobStore {
    /// The folder at `root`, which need not exist yet.
    pub fn new(root: impl Into<PathBuf>) -> Self {
        Self { root: root.into(), is_foreign: false }
    }

    /// A folder that others write, and from which nothing is removed.
    pub fn foreign(root: impl Into<PathBuf>) -> Self {
        Self { root: root.into(), is_foreign: true }
    }

    fn remove_damaged(&self, path: &Path) {
        if !self.is_foreign {
            drop(fs::remove_file(path));
        }
    }

    /// Returns the store's folder.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Returns the path of the blob of this name, whether or not it is there.
    pub fn path_of(&self, hash: BlobHash) -> PathBuf {
        let name = hash.to_string();
        self.root.join(&name[..2]).join(&name)
    }

    /// Returns whether a file of this name is there; its bytes are checked by [`BlobStore::read`].
    pub fn contains(&self, hash: BlobHash) -> bool {
        self.path_of(hash).is_file()
    }

    /// The blob of this name, checked, or `None` where the folder has none.
    ///
    /// # Errors
    /// [`BlobError`] where the file can't be read or was damaged.
    pub fn read(&self, hash: BlobHash) -> Result<Option<Bytes>, BlobError> {
        let path = self.path_of(hash);
        let bytes = match fs::metadata(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(source) => return Err(BlobError::Io { path, source }),
            Ok(facts) if facts.len() > BLOB_BYTES_MAX => {
                return Err(BlobError::TooLarge { path, bytes: facts.len() });
            }
            Ok(_) => fs::read(&path),
        };
        let bytes = match bytes {
            Ok(bytes) => bytes,
            Err(source) => return Err(BlobError::Io { path, source }),
        };
        if BlobHash::of(&bytes) == hash {
            return Ok(Some(Bytes::from(bytes)));
        }
        // A damaged file would be found again and again; without it the blob is fetched anew.
        self.remove_damaged(&path);
        Err(BlobError::Damaged { path })
    }

    /// Opens the blob of this name to be read piece by piece, or gives `None` where the folder has
    /// none.
    ///
    /// # Errors
    /// [`BlobError`] where the file can't be opened or is larger than any blob.
    pub fn open(&self, hash: BlobHash) -> Result<Option<BlobReader>, BlobError> {
        let path = self.path_of(hash);
        let opened = fs::File::open(&path).and_then(|file| Ok((file.metadata()?.len(), file)));
        match opened {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(source) => Err(BlobError::Io { path, source }),
            Ok((bytes, _)) if bytes > BLOB_BYTES_MAX => Err(BlobError::TooLarge { path, bytes }),
            // No blob is empty: a disk was full, or lost power.
            Ok((0, _)) => {
                self.remove_damaged(&path);
                Err(BlobError::Damaged { path })
            }
            Ok((total, file)) => {
                let reader = BlobReader::new(path, file, hash, total);
                Ok(Some(if self.is_foreign { reader.of_others() } else { reader }))
            }
        }
    }

    /// Returns whether the blob of this name is there, has this many bytes, and is whole. One that
    /// is damaged is removed, so that it is written anew.
    pub fn verify(&self, hash: BlobHash, bytes: u64) -> bool {
        let Ok(Some(mut reader)) = self.open(hash) else { return false };
        if reader.total() != bytes {
            self.remove_damaged(&self.path_of(hash));
            return false;
        }
        loop {
            match reader.next_piece() {
                Ok(Some(_)) => {}
                Ok(None) => return true,
                Err(_) => return false,
            }
        }
    }

    /// Writes these bytes, unless they are there already and whole, and gives their name.
    ///
    /// # Errors
    /// [`BlobError::Io`] where the folder or the file can't be written.
    pub fn write(&self, bytes: &[u8]) -> Result<BlobHash, BlobError> {
        let hash = BlobHash::of(bytes);
        let path = self.path_of(hash);
        if self.verify(hash, bytes.len() as u64) {
            return Ok(hash);
        }
        let folder = path.parent().unwrap_or(&self.root);
        let placed = fs::create_dir_all(folder).and_then(|()| place(folder, &path, bytes));
        placed.map(|()| hash).map_err(|source| BlobError::Io { path, source })
    }
}

impl BlobStore {
    /// Removes the files that killed processes left; blobs and files of others stay.
    pub fn remove_abandoned(&self) -> Abandoned {
        let mut removed = Abandoned::default();
        let Ok(folders) = fs::read_dir(&self.root) else { return removed };
        for folder in folders.flatten() {
            let Abandoned { files, bytes } = remove_abandoned(&folder.path());
            removed.files += files;
            removed.bytes += bytes;
        }
        removed
    }

    /// Removes the blobs that were written longest ago, until the rest takes at most `bytes_max`
    /// bytes. Gives how many were removed; files that are not blobs stay.
    ///
    /// # Errors
    /// [`BlobError::Io`] where the folder can't be read. A file that can't be removed is passed
    /// over: another process may have been faster.
    pub fn evict(&self, bytes_max: u64) -> Result<usize, BlobError> {
        let io_error = |source| BlobError::Io { path: self.root.clone(), source };
        let mut blobs = Vec::new();
        let folders = match fs::read_dir(&self.root) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(0),
            folders => folders.map_err(io_error)?,
        };
        for folder in folders {
            let Ok(files) = fs::read_dir(folder.map_err(io_error)?.path()) else { continue };
            for file in files.filter_map(Result::ok) {
                let name = file.file_name();
                let is_blob = name.to_str().is_some_and(|n| BlobHash::from_hex(n).is_some());
                if let (true, Ok(facts)) = (is_blob, file.metadata())
                    && let Ok(written) = facts.modified()
                {
                    blobs.push((written, file.path(), facts.len()));
                }
            }
        }
        blobs.sort_unstable();
        let mut bytes: u64 = blobs.iter().map(|(_, _, bytes)| bytes).sum();
        let mut removed = 0;
        for (_, path, length) in blobs {
            if bytes <= bytes_max {
                break;
            }
            removed += usize::from(fs::remove_file(path).is_ok());
            bytes -= length;
        }
        Ok(removed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_folder_loses_its_oldest_blobs_and_nothing_else() {
        let root = tempfile::tempdir().expect("a temporary folder");
        let folder = BlobStore::new(root.path());
        assert_eq!(folder.evict(0).expect("empty"), 0);
        let hashes: Vec<_> = (0..4u8)
            .map(|n| {
                let hash = folder.write(&[n; 100]).expect("written");
                let age = std::time::Duration::from_secs(u64::from(n));
                let file = fs::File::options().write(true).open(folder.path_of(hash));
                let written = std::time::SystemTime::UNIX_EPOCH + age;
                file.expect("opened").set_modified(written).expect("dated");
                hash
            })
            .collect();
        fs::write(root.path().join("aa.txt"), "mine").expect("written");
        assert_eq!(folder.evict(250).expect("trimmed"), 2);
        let left: Vec<bool> = hashes.iter().map(|&hash| folder.contains(hash)).collect();
        assert_eq!(left, [false, false, true, true]);
        assert!(root.path().join("aa.txt").exists());
    }

    #[test]
    fn a_blob_comes_back_and_a_damaged_one_does_not() {
        let root = tempfile::tempdir().expect("a temporary folder");
        let folder = BlobStore::new(root.path());
        let hash = folder.write(b"harbour").expect("written");
        assert_eq!(folder.read(hash).expect("read").as_deref(), Some(&b"harbour"[..]));

        fs::write(folder.path_of(hash), b"harbxur").expect("overwritten");
        assert!(matches!(folder.read(hash), Err(BlobError::Damaged { .. })));
        assert!(folder.read(hash).expect("gone").is_none());
    }

    #[test]
    fn writing_mends_a_blob_that_was_damaged_in_any_way() {
        let root = tempfile::tempdir().expect("a temporary folder");
        let folder = BlobStore::new(root.path());
        let bytes = b"harbour";
        let hash = folder.write(bytes).expect("written");
        for damaged in [&b"harbxur"[..], b"harb", b"", b"harbours"] {
            fs::write(folder.path_of(hash), damaged).expect("overwritten");
            assert!(!folder.verify(hash, 7), "{damaged:?}");
            assert!(!folder.contains(hash), "{damaged:?} is found again and again");
            fs::write(folder.path_of(hash), damaged).expect("overwritten");
            folder.write(bytes).expect("mended");
            assert!(folder.verify(hash, 7), "{damaged:?}");
        }
        fs::remove_file(folder.path_of(hash)).expect("removed");
        assert!(!folder.verify(hash, 7));
        folder.write(bytes).expect("mended");
        assert!(folder.verify(hash, 7) && !folder.verify(hash, 8));
    }
}
