//! The bytes of buffers. Those of files stay there, and are read part by part as they are needed: a
//! large scene has more of them than a bake may have memory.

use std::borrow::Cow;
use std::sync::Arc;

use super::error::BakeError;
use super::source_file::SourceFile;

/// The bytes of a buffer.
#[derive(Debug)]
pub(super) enum Buffer {
    /// Those of a `data:` URI, or what was unpacked.
    Memory(Vec<u8>),
    /// A part of a file.
    File {
        /// Several buffers may name one.
        file: Arc<SourceFile>,
        /// The place of the first byte in the file.
        first: u64,
        length: u64,
    },
}

impl Buffer {
    /// A buffer without bytes.
    pub(super) const EMPTY: Self = Self::Memory(Vec::new());

    /// Returns the number of bytes.
    pub(super) fn length(&self) -> u64 {
        match self {
            Self::Memory(bytes) => bytes.len() as u64,
            Self::File { length, .. } => *length,
        }
    }

    /// Returns the place of all of its bytes.
    pub(super) fn span(&self) -> ByteSpan<'_> {
        ByteSpan { buffer: self, first: 0, length: self.length() }
    }
}

impl From<Arc<SourceFile>> for Buffer {
    fn from(file: Arc<SourceFile>) -> Self {
        let length = file.length;
        Self::File { file, first: 0, length }
    }
}

/// Bytes of a buffer, none of which is beyond its end.
#[derive(Clone, Copy, Debug)]
pub(super) struct ByteSpan<'a> {
    buffer: &'a Buffer,
    first: u64,
    /// The number of bytes.
    pub length: u64,
}

impl<'a> ByteSpan<'a> {
    /// Returns the place of some of these bytes, given with the first one and the length; `None` if
    /// some are beyond the last.
    pub(super) fn part(self, first: u64, length: u64) -> Option<Self> {
        let end = first.checked_add(length)?;
        (end <= self.length).then(|| Self { first: self.first + first, length, ..self })
    }

    /// Returns the place of the first ones, at most so many, and that of the others.
    pub(super) fn split(self, length: u64) -> (Self, Self) {
        let length = length.min(self.length);
        let rest = self.length - length;
        (Self { length, ..self }, Self { first: self.first + length, length: rest, ..self })
    }

    /// Reads all of these bytes.
    ///
    /// # Errors
    /// Those of [`SourceFile::bytes`].
    pub(super) fn bytes(self, place: &str) -> Result<Cow<'a, [u8]>, BakeError> {
        match self.buffer {
            Buffer::Memory(bytes) => {
                let first = self.first as usize;
                Ok(Cow::Borrowed(&bytes[first..first + self.length as usize]))
            }
            Buffer::File { file, first, .. } => {
                file.bytes(first + self.first, self.length, place).map(Cow::Owned)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use super::super::source_file::SourceFiles;
    use super::*;

    #[test]
    fn parts_are_within_their_span_in_memory_and_in_a_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.bin");
        std::fs::write(&path, b"..0123456789..").expect("written");
        let (files, none) = (SourceFiles::default(), AtomicBool::new(false));
        let file = SourceFile::open(&files, &path, 100, "file", &none).expect("opened").0;
        let file = Buffer::File { file: Arc::new(file), first: 2, length: 10 };
        for buffer in [Buffer::Memory(b"0123456789".to_vec()), file] {
            let part = buffer.span().part(2, 6).expect("within");
            assert_eq!(*part.bytes("a").expect("read"), b"234567"[..]);
            let part_of_part = part.part(1, 3).expect("within");
            assert_eq!(*part_of_part.bytes("a").expect("read"), b"345"[..]);
            assert!(part.part(4, 3).is_none() && part.part(u64::MAX, 2).is_none());
            assert_eq!(part.part(6, 0).map(|of| of.length), Some(0));
            let (first, others) = part.split(4);
            assert_eq!(*first.bytes("a").expect("read"), b"2345"[..]);
            assert_eq!(*others.bytes("a").expect("read"), b"67"[..]);
            assert_eq!(others.split(9).1.length, 0);
        }
        assert_eq!(Buffer::EMPTY.length(), 0);
    }
}
