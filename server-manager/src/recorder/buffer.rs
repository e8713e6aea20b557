//! Records that are not on the disk yet. The core's thread never waits for the disk.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use super::ring::PIECE_HEAD_BYTES;

/// Written together; more at a time is not faster.
const PIECE_BYTES: usize = 64 << 10;

/// Most that waits for a slow disk: ten seconds of 64 channels at 60 frames per second. Beyond it
/// inputs are left out, and a new segment begins once there is room again. The state with which a
/// segment begins takes no part of it, and neither does an input that is larger by itself.
const BUFFER_BYTES_MAX: usize = 8 << 20;

/// Room that is left for what one input brings, before a segment counts as full.
const SEGMENT_MARGIN: u64 = 256 << 10;

/// Room that is left behind an input for the core's decision on it, which takes a hundred bytes.
const DECISION_BYTES_MAX: u64 = 4 << 10;

/// Records of one segment that are written together.
#[derive(Debug)]
pub(super) struct RecordBatch {
    pub segment: u64,
    pub body: Vec<u8>,
}

/// Shared by the core's thread, which fills it, and the recorder's, which empties it.
#[derive(Debug)]
pub(super) struct Buffer {
    segment_bytes_max: u64,
    state: Mutex<State>,
    filled: Condvar,
}

#[derive(Debug)]
struct State {
    pieces: VecDeque<RecordBatch>,
    bytes: usize,
    /// Of these the bytes of states and of other large records, which take no room from others.
    large_bytes: usize,
    segment: u64,
    /// Bytes of the present segment, heads included.
    segment_bytes: u64,
    /// `true` if a record was left out since the segment began.
    has_lost: bool,
    /// The record that is being added; kept for its memory.
    record: Vec<u8>,
    is_closed: bool,
    /// Why nothing more can be written.
    failure: Option<String>,
}

impl Buffer {
    /// An empty one; the first segment has this number, and none is longer than this.
    pub fn new(next_segment: u64, segment_bytes_max: u64) -> Self {
        let state = State {
            pieces: VecDeque::new(),
            bytes: 0,
            large_bytes: 0,
            segment: next_segment.wrapping_sub(1),
            segment_bytes: 0,
            has_lost: false,
            record: Vec::new(),
            is_closed: false,
            failure: None,
        };
        Self { segment_bytes_max, state: Mutex::new(state), filled: Condvar::new() }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns `None` if no new segment should begin yet; otherwise whether nothing was left out
    /// before it.
    pub fn wants_segment(&self) -> Option<bool> {
        let state = self.lock();
        if state.failure.is_some() {
            return None;
        }
        if state.has_lost {
            return (state.bytes < BUFFER_BYTES_MAX / 2).then_some(false);
        }
        (state.segment_bytes + SEGMENT_MARGIN > self.segment_bytes_max).then_some(true)
    }

    /// Begins a new segment, to which all that follows belongs.
    pub fn begin_segment(&self) {
        let mut state = self.lock();
        state.segment = state.segment.wrapping_add(1);
        state.segment_bytes = 0;
        state.has_lost = false;
    }

    /// Adds the record that `write` writes, or leaves it out where there is no room.
    pub fn append(&self, write: impl FnOnce(&mut Vec<u8>)) {
        self.add(write, None);
    }

    /// Adds the input that `write` writes, as [`append`](Self::append) does. Returns `false`, and
    /// adds nothing, if the present segment has no room for it and the decision on it: it belongs
    /// into a new one then.
    pub fn append_input(&self, write: impl FnOnce(&mut Vec<u8>)) -> bool {
        self.add(write, Some(DECISION_BYTES_MAX))
    }

    /// Adds a record, or leaves it out. Returns `false` if the present segment has no room for it
    /// and so many bytes more, where that is asked.
    fn add(&self, write: impl FnOnce(&mut Vec<u8>), room_behind: Option<u64>) -> bool {
        let state = &mut *self.lock();
        if state.failure.is_some() || state.has_lost {
            return true;
        }
        state.record.clear();
        write(&mut state.record);
        let bytes = state.record.len();
        let segment_bytes = state.segment_bytes + (PIECE_HEAD_BYTES + bytes) as u64;
        let is_state = state.segment_bytes == 0;
        if is_state && bytes as u64 + SEGMENT_MARGIN > self.segment_bytes_max {
            let mib = bytes >> 20;
            state.failure = Some(format!(
                "nothing is recorded: the state of this wall takes {mib} MiB, more than a part of \
                 a recording"
            ));
            return true;
        }
        let others = state.bytes - state.large_bytes;
        // One that is larger than the buffer takes no part of it.
        let is_large = is_state || bytes > BUFFER_BYTES_MAX;
        let is_slow = !is_large && others + bytes > BUFFER_BYTES_MAX;
        let is_full = |room| segment_bytes + room > self.segment_bytes_max;
        if !is_slow && room_behind.is_some_and(is_full) {
            return false;
        }
        if is_slow || is_full(0) {
            let reason = if is_slow { "the disk is too slow" } else { "a part is full" };
            tracing::warn!(reason, bytes, "the recording has a gap here");
            state.has_lost = true;
            return true;
        }
        state.bytes += bytes;
        state.large_bytes += if is_large { bytes } else { 0 };
        state.segment_bytes += bytes as u64;
        let segment = state.segment;
        let fits =
            |p: &&mut RecordBatch| p.segment == segment && p.body.len() + bytes <= PIECE_BYTES;
        if let Some(piece) = state.pieces.back_mut().filter(fits) {
            piece.body.extend_from_slice(&state.record);
        } else {
            let mut body = Vec::with_capacity(PIECE_BYTES.max(bytes));
            body.extend_from_slice(&state.record);
            state.segment_bytes += PIECE_HEAD_BYTES as u64;
            state.pieces.push_back(RecordBatch { segment, body });
            // A whole piece waits.
            if state.pieces.len() > 1 || is_large {
                self.filled.notify_one();
            }
        }
        true
    }

    /// Waits for a whole piece or the period, and takes what is there; `None` at the end.
    pub fn take(&self, period: Duration) -> Option<VecDeque<RecordBatch>> {
        let is_idle = |state: &mut State| {
            state.pieces.len() < 2 && state.large_bytes == 0 && !state.is_closed
        };
        let waited = self.filled.wait_timeout_while(self.lock(), period, is_idle);
        let (mut state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        if state.is_closed && state.pieces.is_empty() {
            return None;
        }
        (state.bytes, state.large_bytes) = (0, 0);
        Some(std::mem::take(&mut state.pieces))
    }

    /// Nothing more comes.
    pub fn close(&self) {
        self.lock().is_closed = true;
        self.filled.notify_one();
    }

    /// Nothing more can be written, for this reason.
    pub fn give_up(&self, failure: String) {
        let mut state = self.lock();
        state.failure = Some(failure);
        state.pieces.clear();
    }

    /// Why nothing more can be written, if so.
    pub fn failure(&self) -> Option<String> {
        self.lock().failure.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_disk_that_does_not_follow_makes_a_gap_and_a_new_segment() {
        let buffer = Buffer::new(7, 32 << 20);
        buffer.begin_segment();
        let record = vec![1; 60_000];
        let record = |bytes: &mut Vec<u8>| bytes.extend_from_slice(&record);
        let mut kept = 0;
        while buffer.wants_segment().is_none() && kept < 1000 {
            buffer.append(record);
            if buffer.lock().has_lost {
                break;
            }
            kept += 1;
        }
        // The first one is the state with which the segment begins.
        assert_eq!(kept, 1 + BUFFER_BYTES_MAX / 60_000);
        assert_eq!(buffer.wants_segment(), None, "there is no room for its beginning yet");
        let taken = buffer.take(Duration::ZERO).expect("pieces");
        assert!(taken.iter().all(|piece| piece.segment == 7));
        assert_eq!(taken.len(), kept);
        assert_eq!(buffer.wants_segment(), Some(false));
        buffer.begin_segment();
        buffer.append(record);
        assert_eq!(buffer.take(Duration::ZERO).expect("a piece")[0].segment, 8);
        buffer.close();
        assert!(buffer.take(Duration::ZERO).is_none());
    }

    #[test]
    fn a_state_may_be_larger_than_the_buffer_but_not_than_a_segment() {
        let buffer = Buffer::new(0, 32 << 20);
        buffer.begin_segment();
        buffer.append(|bytes| bytes.resize(BUFFER_BYTES_MAX + 1, 1));
        assert_eq!((buffer.wants_segment(), buffer.failure()), (None, None));
        buffer.append(|bytes| bytes.push(1));
        assert_eq!(buffer.wants_segment(), None, "the inputs behind it are kept, too");
        let pieces = buffer.take(Duration::ZERO).expect("pieces");
        let bytes: usize = pieces.iter().map(|piece| piece.body.len()).sum();
        assert_eq!(BUFFER_BYTES_MAX + 2, bytes);

        // So may an input, behind others and before others.
        for bytes in [1, BUFFER_BYTES_MAX + 1, 1] {
            buffer.append(|record| record.resize(bytes, 1));
        }
        assert_eq!(buffer.wants_segment(), None, "nothing is lost");
        assert_eq!(buffer.take(Duration::ZERO).expect("pieces").len(), 3);

        buffer.begin_segment();
        buffer.append(|bytes| bytes.resize(32 << 20, 1));
        assert!(buffer.failure().is_some_and(|failure| failure.contains("takes 32 MiB")));
        assert_eq!(buffer.wants_segment(), None, "nobody is asked for it again");
        assert!(buffer.take(Duration::ZERO).expect("none").is_empty());
    }

    #[test]
    fn a_full_segment_is_followed_by_another() {
        let buffer = Buffer::new(0, 32 << 20);
        buffer.begin_segment();
        let record = vec![1; 60_000];
        while buffer.wants_segment().is_none() {
            buffer.append(|bytes| bytes.extend_from_slice(&record));
            buffer.take(Duration::ZERO);
        }
        assert_eq!(buffer.wants_segment(), Some(true));
        assert!(buffer.lock().segment_bytes <= 32 << 20);
    }
}
