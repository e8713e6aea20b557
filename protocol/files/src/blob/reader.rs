//! A blob read piece by piece: a sender over a slow link holds only a piece of it.

use std::fs::{self, File};
use std::io::Read;
use std::path::PathBuf;

use bytes::Bytes;

use super::CHUNK_BYTES_MAX;
use super::blob_store::BlobError;
use super::{BlobHash, BlobHasher};

/// An open blob, hashed as it is read.
#[derive(Debug)]
pub struct BlobReader {
    path: PathBuf,
    file: File,
    hash: BlobHash,
    total: u64,
    read: u64,
    hasher: BlobHasher,
    /// `true` if a damaged file is removed.
    removes: bool,
}

impl BlobReader {
    pub(super) fn new(path: PathBuf, file: File, hash: BlobHash, total: u64) -> Self {
        Self { path, file, hash, total, read: 0, hasher: BlobHasher::default(), removes: true }
    }

    /// The same, of a file that others write, which is never removed.
    pub(super) fn of_others(self) -> Self {
        Self { removes: false, ..self }
    }

    /// Its name.
    pub fn hash(&self) -> BlobHash {
        self.hash
    }

    /// Its size in bytes.
    pub fn total(&self) -> u64 {
        self.total
    }

    /// Reads and hashes the pieces before `offset`, which a peer has already. Its next piece
    /// begins there, if it is a multiple of [`CHUNK_BYTES_MAX`] below the blob's size.
    ///
    /// # Errors
    /// [`BlobError`] as of [`Self::next_piece`].
    pub fn skip_to(&mut self, offset: u64) -> Result<(), BlobError> {
        while self.read < offset && self.next_piece()?.is_some() {}
        Ok(())
    }

    /// Returns how many bytes were read.
    pub fn position(&self) -> u64 {
        self.read
    }

    /// Returns the bytes of the next piece, at most [`CHUNK_BYTES_MAX`]; 0 at the end.
    pub fn next_length(&self) -> usize {
        (self.total - self.read).min(CHUNK_BYTES_MAX as u64) as usize
    }

    /// The next piece, of [`Self::next_length`] bytes, and its offset; `None` at the end.
    ///
    /// The last piece is only given where all of them together hash to the blob's name.
    ///
    /// # Errors
    /// [`BlobError`] where the file can't be read or was damaged; a damaged one is removed.
    pub fn next_piece(&mut self) -> Result<Option<(u64, Bytes)>, BlobError> {
        let (offset, length) = (self.read, self.next_length());
        // An empty blob has no piece, as on the wire.
        if length == 0 {
            return Ok(None);
        }
        let mut bytes = vec![0; length];
        self.read_piece(&mut bytes)?;
        Ok(Some((offset, Bytes::from(bytes))))
    }

    /// Reads the next piece into room of [`Self::next_length`] bytes; see [`Self::next_piece`].
    ///
    /// # Errors
    /// [`BlobError`] as of [`Self::next_piece`].
    pub fn read_piece(&mut self, room: &mut [u8]) -> Result<(), BlobError> {
        let read = self.file.read_exact(room);
        read.map_err(|source| BlobError::Io { path: self.path.clone(), source })?;
        self.hasher.update(room);
        self.read += room.len() as u64;
        if self.read == self.total && self.hasher.finish() != self.hash {
            // Found again it would be sent again, and refused again.
            if self.removes {
                drop(fs::remove_file(&self.path));
            }
            return Err(BlobError::Damaged { path: self.path.clone() });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::blob::BlobStore;

    #[test]
    fn pieces_make_the_whole_and_damage_is_seen_before_the_last_one() {
        let root = tempfile::tempdir().expect("a temporary folder");
        let folder = BlobStore::new(root.path());
        let whole: Vec<u8> = (0..CHUNK_BYTES_MAX * 2 + 7).map(|n| (n / 251) as u8).collect();
        let hash = folder.write(&whole).expect("written");
        let mut reader = folder.open(hash).expect("opened").expect("there");
        let mut joined = Vec::new();
        while let Some((offset, piece)) = reader.next_piece().expect("read") {
            assert_eq!(offset, joined.len() as u64);
            joined.extend_from_slice(&piece);
        }
        assert!(joined == whole && reader.total() == whole.len() as u64);

        let mut reader = folder.open(hash).expect("opened").expect("there");
        reader.skip_to(CHUNK_BYTES_MAX as u64).expect("read");
        let (offset, piece) = reader.next_piece().expect("read").expect("the second");
        assert_eq!(offset, CHUNK_BYTES_MAX as u64);
        assert_eq!(piece, whole[CHUNK_BYTES_MAX..2 * CHUNK_BYTES_MAX]);
        reader.skip_to(u64::MAX).expect("read");
        assert_eq!(reader.position(), reader.total());

        let mut damaged = whole;
        damaged[5] ^= 1;
        fs::write(folder.path_of(hash), damaged).expect("overwritten");
        let mut reader = folder.open(hash).expect("opened").expect("there");
        assert!(reader.next_piece().is_ok() && reader.next_piece().is_ok());
        assert!(matches!(reader.next_piece(), Err(BlobError::Damaged { .. })));
        assert!(folder.open(hash).expect("gone").is_none());
    }

    #[test]
    fn nothing_is_removed_from_a_folder_that_others_write() {
        let root = tempfile::tempdir().expect("a temporary folder");
        let hash = BlobStore::new(root.path()).write(b"whole").expect("written");
        let folder = BlobStore::foreign(root.path());
        let path = folder.path_of(hash);
        // It is being copied there.
        for begun in [&b""[..], b"who"] {
            fs::write(&path, begun).expect("written");
            assert!(folder.read(hash).is_err());
            assert!(
                folder.open(hash).and_then(|reader| reader.expect("there").next_piece()).is_err()
            );
            assert!(path.is_file());
        }
        fs::write(&path, b"whole").expect("written");
        assert_eq!(folder.read(hash).expect("read").as_deref(), Some(&b"whole"[..]));
    }
}
