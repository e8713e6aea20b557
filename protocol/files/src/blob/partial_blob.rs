//! The beginning of a large blob whose transfer was broken off: the rest is all that is sent again.
//!
//! ```text
//! FOLDER/partial/3fa1....part    the first bytes, in the order in which they came
//! ```
//!
//! Nothing says that they are right; the whole is hashed when it is complete.

use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use super::{Abandoned, BlobHash, BlobStore, CHUNK_BYTES_MAX};

/// The folder of beginnings, and how their names end.
const FOLDER: &str = "partial";
const SUFFIX: &str = ".part";

/// Longest time for which a beginning is kept: the scene is another one by then.
const PARTIAL_TIME_MAX: Duration = Duration::from_hours(7 * 24);

/// Bytes of all beginnings that are kept: two of the largest blobs.
const PARTIAL_BYTES_MAX: u64 = 4 << 30;

/// A beginning that this process writes; others leave it alone until it is dropped.
#[derive(Debug)]
pub struct PartialBlob {
    path: PathBuf,
    /// Locked.
    file: File,
}

impl PartialBlob {
    /// Opens the beginning of this blob, and makes an empty one if there is none and `is_new`.
    /// Returns it with its bytes, whose number is a multiple of [`CHUNK_BYTES_MAX`]; `None` if
    /// there is none, or another process writes it.
    ///
    /// # Errors
    /// The system's reason; the transfer goes on without.
    pub fn open(
        store: &BlobStore,
        hash: BlobHash,
        is_new: bool,
    ) -> io::Result<Option<(Self, Vec<u8>)>> {
        let folder = store.root().join(FOLDER);
        let path = folder.join(format!("{hash}{SUFFIX}"));
        if is_new {
            fs::create_dir_all(&folder)?;
        }
        let opened = File::options().read(true).append(true).create(is_new).open(&path);
        let mut file = match opened {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            opened => opened?,
        };
        if file.try_lock().is_err() || !is_still_there(&file, &path) {
            return Ok(None);
        }
        let whole = file.metadata()?.len() / CHUNK_BYTES_MAX as u64 * CHUNK_BYTES_MAX as u64;
        file.set_len(whole)?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes)?;
        Ok(Some((Self { path, file }, bytes)))
    }

    /// Keeps the bytes that follow.
    ///
    /// # Errors
    /// The system's reason.
    pub fn append(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.file.write_all(bytes)
    }

    /// Puts the blob, whose bytes are complete and were checked, into its place.
    ///
    /// # Errors
    /// The system's reason.
    pub fn place(self, store: &BlobStore, hash: BlobHash) -> io::Result<()> {
        let path = store.path_of(hash);
        fs::create_dir_all(path.parent().unwrap_or(store.root()))?;
        fs::rename(&self.path, path)
    }

    /// Removes the beginning, which is of no use.
    pub fn discard(self) {
        // One that cannot be removed is found damaged again, and bounded by its age.
        let _ = fs::remove_file(&self.path);
    }
}

/// Returns whether the file that was opened is the one of this path. Another process may have put
/// it into its place, whole, before it was locked here.
#[cfg(unix)]
fn is_still_there(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let number = |facts: io::Result<fs::Metadata>| facts.ok().map(|of| (of.dev(), of.ino()));
    number(file.metadata()).is_some_and(|of| number(fs::metadata(path)) == Some(of))
}

/// A file that is open cannot be moved there.
#[cfg(not(unix))]
fn is_still_there(_: &File, _: &Path) -> bool {
    true
}

impl BlobStore {
    /// Removes beginnings of blobs that are older than a week, and the oldest ones beyond 4 GiB.
    /// Those that another process writes stay.
    pub fn remove_old_partials(&self) -> Abandoned {
        let mut removed = Abandoned::default();
        let Ok(entries) = fs::read_dir(self.root().join(FOLDER)) else { return removed };
        let mut partials: Vec<(SystemTime, u64, PathBuf)> = entries
            .flatten()
            .filter(|entry| entry.file_name().to_string_lossy().ends_with(SUFFIX))
            .filter_map(|entry| {
                let facts = entry.metadata().ok().filter(fs::Metadata::is_file)?;
                Some((facts.modified().ok()?, facts.len(), entry.path()))
            })
            .collect();
        partials.sort_unstable_by(|a, b| b.cmp(a));
        let mut kept = 0;
        for (written, bytes, path) in partials {
            // A clock that was set back makes files of the future: they are young.
            let age = written.elapsed().unwrap_or_default();
            if age <= PARTIAL_TIME_MAX && kept + bytes <= PARTIAL_BYTES_MAX {
                kept += bytes;
                continue;
            }
            let Ok(file) = File::options().write(true).open(&path) else { continue };
            if file.try_lock().is_ok() && fs::remove_file(&path).is_ok() {
                removed.files += 1;
                removed.bytes += bytes;
            }
        }
        removed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PIECE: usize = CHUNK_BYTES_MAX;

    fn store() -> (tempfile::TempDir, BlobStore) {
        let root = tempfile::tempdir().expect("a temporary folder");
        let store = BlobStore::new(root.path());
        (root, store)
    }

    #[test]
    fn a_beginning_is_found_again_in_whole_pieces_and_becomes_the_blob() {
        let (_root, store) = store();
        let whole: Vec<u8> = (0..PIECE * 2 + 9).map(|n| (n / 97) as u8).collect();
        let hash = BlobHash::of(&whole);
        assert!(PartialBlob::open(&store, hash, false).expect("looked").is_none());
        let (mut partial, before) = PartialBlob::open(&store, hash, true).unwrap().expect("mine");
        assert!(before.is_empty());
        partial.append(&whole[..PIECE + 5]).expect("kept");
        let other = PartialBlob::open(&store, hash, true).expect("looked");
        assert!(other.is_none(), "another process writes it");
        drop(partial);
        let (mut partial, before) = PartialBlob::open(&store, hash, false).unwrap().expect("there");
        assert_eq!(before, whole[..PIECE]);
        partial.append(&whole[PIECE..]).expect("kept");
        partial.place(&store, hash).expect("placed");
        assert_eq!(store.read(hash).expect("read").as_deref(), Some(&whole[..]));
        assert!(PartialBlob::open(&store, hash, false).expect("looked").is_none());
    }

    #[cfg(unix)]
    #[test]
    fn a_beginning_that_another_process_has_put_into_its_place_is_not_written_to() {
        let (_root, store) = store();
        let whole = vec![7; PIECE];
        let hash = BlobHash::of(&whole);
        let (mut first, _) = PartialBlob::open(&store, hash, true).unwrap().expect("mine");
        first.append(&whole).expect("kept");
        // A second process opens it, and locks it once the first is done.
        let path = first.path.clone();
        let late = File::options().read(true).append(true).open(&path).expect("opened");
        assert!(is_still_there(&late, &path));
        first.place(&store, hash).expect("placed");
        late.try_lock().expect("nobody holds it");
        assert!(!is_still_there(&late, &path), "it is a blob of the store now");
        // A new beginning is a file of its own, and is put over the same bytes.
        let (mut third, before) = PartialBlob::open(&store, hash, true).unwrap().expect("mine");
        assert!(before.is_empty() && !is_still_there(&late, &path));
        third.append(&whole).expect("kept");
        third.place(&store, hash).expect("placed again");
        assert_eq!(store.read(hash).expect("read").as_deref(), Some(&whole[..]));
        assert!(!path.exists());
    }

    #[test]
    fn old_beginnings_and_those_beyond_the_bound_are_removed() {
        let (_root, store) = store();
        let day = Duration::from_hours(24);
        let sizes = [(0, 1 << 30), (1, 2 << 30), (2, 2 << 30), (3, 1 << 30), (8, 1)];
        let hashes = sizes.map(|(days, bytes)| {
            let hash = BlobHash([days as u8; 32]);
            let (partial, _) = PartialBlob::open(&store, hash, true).unwrap().expect("mine");
            partial.file.set_len(bytes).expect("sparse");
            partial.file.set_modified(SystemTime::now() - day * days).expect("dated");
            hash
        });
        let removed = store.remove_old_partials();
        assert_eq!(removed, Abandoned { files: 2, bytes: (2 << 30) + 1 });
        let left =
            hashes.map(|hash| store.root().join(FOLDER).join(format!("{hash}{SUFFIX}")).exists());
        assert_eq!(left, [true, true, false, true, false]);
        assert_eq!(store.remove_old_partials(), Abandoned::default());
    }
}
