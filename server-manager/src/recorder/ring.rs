//! The file of a recording: a ring of segments, of which the oldest is overwritten.
//!
//! ```text
//! file:   head, 32 B | slot 0 | slot 1 | .. | slot 3          of the same size
//! head:   "PLYPREC\0" | format u16 LE | protocol version u16 LE | 0 | slot bytes u32 LE | zeros
//! slot:   piece | piece | ..            segment n lies in slot n mod 4
//! piece:  length u32 LE | segment u64 LE | check, 8 B | records, length B
//! record: length u32 LE | an encoded Record
//! ```
//!
//! The check is of the segment's number and the records: a piece that was torn, and one that an
//! older segment has left behind, end the segment. Nothing is read beyond what was written whole.

use std::fs::{File, OpenOptions, TryLockError};
use std::io;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

use polyptych_files::output_file;
use polyptych_protocol::limits::PROTOCOL_VERSION;

use super::Record;

/// The version of the layout above. That of the records changes with the protocol and the program.
const FORMAT: u16 = 2;

const MAGIC: [u8; 8] = *b"PLYPREC\0";
const HEAD_BYTES: usize = 32;

/// Bytes before the records of a piece.
pub(super) const PIECE_HEAD_BYTES: usize = 20;

/// Segments in the file: at least three quarters of it can be replayed at any time.
const SLOTS: u64 = 4;

/// Longest segment. With four of them, a wall of 64 channels at 60 frames per second keeps its
/// last four to five minutes, and one of four channels more than an hour.
pub(super) const SEGMENT_BYTES_MAX: u64 = 32 << 20;

/// Maximum memory in bytes that a record's values may claim: what a byte stands for takes eight at
/// most.
pub(crate) const VALUES_BYTES_MAX: usize = 8 * SEGMENT_BYTES_MAX as usize;

/// Why a recording can't be written or read.
#[derive(Debug, thiserror::Error)]
pub enum RingError {
    /// The system's reason.
    #[error("{}: {source}", .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The reason.
        source: io::Error,
    },
    /// Another manager writes it.
    #[error("{}: another manager records there; name another file", .path.display())]
    Busy {
        /// The file.
        path: PathBuf,
    },
    /// It is something else.
    #[error(
        "{}: not a recording; those are made by polyptych manager WALL.toml --record FILE",
        .path.display()
    )]
    Foreign {
        /// The file.
        path: PathBuf,
    },
    /// Another version's.
    #[error(
        "{}: recorded in format {format} of protocol version {protocol}, and this program reads \
         format {FORMAT} of version {PROTOCOL_VERSION}; replay it with the release that wrote it",
        .path.display()
    )]
    Version {
        /// The file.
        path: PathBuf,
        /// Its format.
        format: u16,
        /// Its protocol version.
        protocol: u16,
    },
    /// Records that make no sense, though they were written so.
    #[error(
        "{}: segment {segment} makes no sense to this program ({reason}); replay it with the one \
         that wrote it",
        .path.display()
    )]
    Malformed {
        /// The file.
        path: PathBuf,
        /// The number of the segment.
        segment: u64,
        /// The decoder's reason.
        reason: String,
    },
}

/// A recording's file, open for writing.
#[derive(Debug)]
pub struct Ring {
    file: File,
    next_segment: u64,
    segment_bytes: u64,
    segment: u64,
    offset: u64,
}

impl Ring {
    /// Goes on behind what the file holds. One of another format is set aside first.
    ///
    /// # Errors
    /// [`RingError`].
    pub fn open(path: &Path) -> Result<Self, RingError> {
        Self::open_with(path, SEGMENT_BYTES_MAX)
    }

    /// Opens a file as [`Ring::open`] does; a new file has slots of this size.
    pub(super) fn open_with(path: &Path, segment_bytes: u64) -> Result<Self, RingError> {
        let failed = |source| RingError::Io { path: path.to_owned(), source };
        // Opening a FIFO or a device does something to it.
        if path.symlink_metadata().is_ok() {
            output_file::check(path).map_err(failed)?;
        }
        let open = || {
            let mut options = OpenOptions::new();
            let options = options.read(true).write(true).create(true).truncate(false);
            let file = options.open(path).map_err(failed)?;
            match file.try_lock() {
                Ok(()) => Ok(file),
                Err(TryLockError::WouldBlock) => Err(RingError::Busy { path: path.to_owned() }),
                Err(TryLockError::Error(source)) => Err(failed(source)),
            }
        };
        let mut file = open()?;
        let (mut next_segment, mut segment_bytes) = (0, segment_bytes);
        if file.metadata().map_err(failed)?.len() > 0 {
            match check_head(&file, path) {
                Ok(found) => {
                    segment_bytes = found;
                    let first = |slot| Some(first_piece(&file, slot, found)?.0);
                    let numbers = (0..SLOTS).filter_map(first);
                    // A manager that ended before it was told anything leaves its place to the
                    // next: one that is started again and again would else push all others out.
                    next_segment = numbers.max().map_or(0, |number| {
                        number + u64::from(has_inputs(&file, path, found, number))
                    });
                }
                Err(RingError::Version { .. }) => {
                    let aside = path.with_added_extension("old");
                    std::fs::rename(path, &aside).map_err(failed)?;
                    tracing::warn!(aside = %aside.display(), "an older recording is set aside");
                    file = open()?;
                }
                Err(error) => return Err(error),
            }
        }
        let mut head = [0; HEAD_BYTES];
        head[..8].copy_from_slice(&MAGIC);
        head[8..10].copy_from_slice(&FORMAT.to_le_bytes());
        head[10..12].copy_from_slice(&PROTOCOL_VERSION.to_le_bytes());
        head[16..20].copy_from_slice(&(segment_bytes as u32).to_le_bytes());
        file.write_all_at(&head, 0).map_err(failed)?;
        Ok(Self { file, next_segment, segment_bytes, segment: u64::MAX, offset: 0 })
    }

    /// The number of the segment that is to be written next.
    pub fn next_segment(&self) -> u64 {
        self.next_segment
    }

    /// Longest segment of this file.
    pub(super) fn segment_bytes(&self) -> u64 {
        self.segment_bytes
    }

    /// Writes a piece of a segment.
    ///
    /// # Errors
    /// The system's reason.
    pub fn write(&mut self, segment: u64, records: &[u8]) -> io::Result<()> {
        if segment != self.segment {
            self.segment = segment;
            self.offset = slot_offset(segment % SLOTS, self.segment_bytes);
        }
        let mut piece = Vec::with_capacity(PIECE_HEAD_BYTES + records.len());
        piece.extend_from_slice(&(records.len() as u32).to_le_bytes());
        piece.extend_from_slice(&segment.to_le_bytes());
        piece.extend_from_slice(&check(segment, records));
        piece.extend_from_slice(records);
        self.file.write_all_at(&piece, self.offset)?;
        self.offset += piece.len() as u64;
        Ok(())
    }
}

/// A recording's file, open for reading. It may be written meanwhile.
#[derive(Debug)]
pub struct RingReader {
    path: PathBuf,
    file: File,
    segment_bytes: u64,
    segments: Vec<u64>,
}

/// Returns whether a segment has any input; `true` also if it cannot be read, so that it is kept.
fn has_inputs(file: &File, path: &Path, segment_bytes: u64, segment: u64) -> bool {
    let Ok(file) = file.try_clone() else { return true };
    let path = path.to_owned();
    let reader = RingReader { path, file, segment_bytes, segments: Vec::new() };
    let is_input = |record: &Record| matches!(record, Record::Input { .. });
    reader.read(segment).map_or(true, |records| records.iter().any(is_input))
}

impl RingReader {
    /// Opens a recording.
    ///
    /// # Errors
    /// [`RingError`].
    pub fn open(path: &Path) -> Result<Self, RingError> {
        let failed = |source| RingError::Io { path: path.to_owned(), source };
        let file = File::open(path).map_err(failed)?;
        let segment_bytes = check_head(&file, path)?;
        let first = |slot| Some(first_piece(&file, slot, segment_bytes)?.0);
        let mut segments: Vec<u64> = (0..SLOTS).filter_map(first).collect();
        segments.sort_unstable();
        Ok(Self { path: path.to_owned(), file, segment_bytes, segments })
    }

    /// The numbers of the segments that are there, in order.
    pub fn segments(&self) -> &[u64] {
        &self.segments
    }

    /// Reads all segments in order, and calls `each` with the records of each one; with `None`
    /// for a segment that makes no sense to this program. Returns the number of those.
    ///
    /// # Errors
    /// [`RingError::Malformed`] if no segment makes sense.
    pub fn read_all(&self, mut each: impl FnMut(Option<Vec<Record>>)) -> Result<u64, RingError> {
        let (mut first_error, mut malformed) = (None, 0);
        for &segment in &self.segments {
            match self.read(segment) {
                Ok(records) => each(Some(records)),
                Err(error) => {
                    first_error.get_or_insert(error);
                    malformed += 1;
                    each(None);
                }
            }
        }
        match first_error {
            Some(error) if malformed == self.segments.len() => Err(error),
            _ => Ok(malformed as u64),
        }
    }

    /// All records of a segment that were written whole.
    ///
    /// # Errors
    /// [`RingError::Malformed`] where they are another program's.
    pub fn read(&self, segment: u64) -> Result<Vec<Record>, RingError> {
        let mut offset = slot_offset(segment % SLOTS, self.segment_bytes);
        let (end, mut records) = (offset + self.segment_bytes, Vec::new());
        while let Some((number, body)) = piece_at(&self.file, offset, end) {
            if number != segment {
                break;
            }
            offset += (PIECE_HEAD_BYTES + body.len()) as u64;
            let mut rest = &body[..];
            while let Some((length, after)) = rest.split_first_chunk::<4>() {
                let length = u32::from_le_bytes(*length) as usize;
                let malformed = |reason: String| RingError::Malformed {
                    path: self.path.clone(),
                    segment,
                    reason,
                };
                let (record, after) = after
                    .split_at_checked(length)
                    .ok_or_else(|| malformed("a record is longer than its piece".into()))?;
                records.push(
                    polyptych_codec::decode_within::<_, VALUES_BYTES_MAX>(record)
                        .map_err(|e| malformed(e.to_string()))?,
                );
                rest = after;
            }
        }
        Ok(records)
    }
}

fn slot_offset(slot: u64, segment_bytes: u64) -> u64 {
    HEAD_BYTES as u64 + slot * segment_bytes
}

fn check(segment: u64, records: &[u8]) -> [u8; 8] {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&segment.to_le_bytes()).update(records);
    let mut check = [0; 8];
    check.copy_from_slice(&hasher.finalize().as_bytes()[..8]);
    check
}

/// The size of the slots.
fn check_head(file: &File, path: &Path) -> Result<u64, RingError> {
    let mut head = [0; HEAD_BYTES];
    match file.read_exact_at(&mut head, 0) {
        Ok(()) => {}
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => {
            return Err(RingError::Foreign { path: path.to_owned() });
        }
        Err(source) => return Err(RingError::Io { path: path.to_owned(), source }),
    }
    if head[..8] != MAGIC {
        return Err(RingError::Foreign { path: path.to_owned() });
    }
    let format = u16::from_le_bytes([head[8], head[9]]);
    let protocol = u16::from_le_bytes([head[10], head[11]]);
    if (format, protocol) != (FORMAT, PROTOCOL_VERSION) {
        return Err(RingError::Version { path: path.to_owned(), format, protocol });
    }
    let segment_bytes = u64::from(u32::from_le_bytes([head[16], head[17], head[18], head[19]]));
    if segment_bytes == 0 || segment_bytes > SEGMENT_BYTES_MAX {
        return Err(RingError::Foreign { path: path.to_owned() });
    }
    Ok(segment_bytes)
}

/// The first piece of a slot, where it is whole and lies in its own slot.
fn first_piece(file: &File, slot: u64, segment_bytes: u64) -> Option<(u64, Vec<u8>)> {
    let offset = slot_offset(slot, segment_bytes);
    piece_at(file, offset, offset + segment_bytes).filter(|(number, _)| number % SLOTS == slot)
}

/// The whole piece at this place of a slot that ends at `slot_end`.
fn piece_at(file: &File, offset: u64, slot_end: u64) -> Option<(u64, Vec<u8>)> {
    let mut head = [0; PIECE_HEAD_BYTES];
    file.read_exact_at(&mut head, offset).ok()?;
    let (length, rest) = head.split_first_chunk::<4>()?;
    let (number, expected) = rest.split_first_chunk::<8>()?;
    let (length, number) = (u32::from_le_bytes(*length), u64::from_le_bytes(*number));
    let end = offset + PIECE_HEAD_BYTES as u64 + u64::from(length);
    // Nothing is allocated for a length that cannot be.
    if length == 0 || end > slot_end || file.metadata().ok()?.len() < end {
        return None;
    }
    let mut body = vec![0; length as usize];
    file.read_exact_at(&mut body, offset + PIECE_HEAD_BYTES as u64).ok()?;
    (check(number, &body) == expected).then_some((number, body))
}
