//! Records what the core is told, so that an incident can be replayed.
//!
//! ```text
//! core thread: Record -> piece in memory (a lock, a copy)
//! recorder thread, ten times a second: pieces -> the ring's file
//! ```
//!
//! An input is noted before the core hears it: what made a manager fall is there to be read. The
//! file is a ring of segments, each of which begins with all that the core knew, so that the
//! last minutes can be replayed however long the manager ran; and one file holds the lives of
//! several managers, since an incident often ends one.

mod buffer;
pub mod effect_digest;
pub mod ring;
#[cfg(test)]
mod tests;

use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use buffer::{Buffer, RecordBatch};
use effect_digest::EffectDigest;
use polyptych_core::{Checkpoint, CheckpointOf, Cluster, Input, Micros, PersistentState};
use polyptych_protocol::ids::Epoch;
use polyptych_scene::SceneOutline;
use polyptych_wall::Wall;
use ring::{Ring, RingError};
use serde::{Deserialize, Serialize};

/// Longest that an input waits in memory: what a killed manager loses of its recording.
const FLUSH_PERIOD: Duration = Duration::from_millis(100);

/// Maximum time that the end of a manager waits for the disk to take another piece.
const END_TIME_MAX: Duration = Duration::from_secs(3);

/// One thing that a recording says.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub enum Record<C = Checkpoint, I = Input> {
    /// A segment begins.
    Begin(Segment<C>),
    /// The core is told something.
    Input {
        /// The time that it is told.
        now: Micros,
        /// What.
        input: I,
    },
    /// The core's decision on the last input. Without this record it decided nothing.
    Decided(EffectDigest),
    /// The manager ended in order.
    End,
}

/// The head of a segment.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Segment<C = Checkpoint> {
    /// The program's version.
    pub program: String,
    /// The life of the manager.
    pub epoch: Epoch,
    /// The start of the manager, when its time is 0, in microseconds since 1970, UTC.
    pub started_unix_us: u64,
    /// `true` if every input since the segment before is in that one.
    pub is_contiguous: bool,
    /// The state of the core when the segment began.
    pub beginning: InitialState<C>,
}

/// The state of a core before the first input.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub enum InitialState<C = Checkpoint> {
    /// It was new.
    Fresh(Box<ClusterConfig>),
    /// It had been told something before.
    Checkpoint(C),
}

/// The parts of which a new core is made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ClusterConfig {
    /// The wall.
    pub wall: Wall,
    /// The life of the manager.
    pub epoch: Epoch,
    /// The state that the manager before had persisted, if any.
    pub memory: Option<PersistentState>,
    /// The outline of its scene, which is needed to edit it.
    pub outline: Option<Arc<SceneOutline>>,
    /// `true` if the mouse over its windows moves the camera.
    #[serde(default)]
    pub is_navigable: bool,
}

impl ClusterConfig {
    /// The core.
    pub fn to_cluster(&self) -> Cluster {
        let mut cluster = match &self.memory {
            Some(memory) => Cluster::restore(self.wall.clone(), self.epoch, memory),
            None => Cluster::new(self.wall.clone(), self.epoch),
        };
        cluster.set_outline(self.outline.clone());
        cluster.set_navigable(self.is_navigable);
        cluster
    }
}

impl InitialState {
    /// The core.
    pub fn into_cluster(self) -> Cluster {
        match self {
            Self::Fresh(fresh) => fresh.to_cluster(),
            Self::Checkpoint(checkpoint) => checkpoint.into_cluster(),
        }
    }
}

type RecordRef<'a> = Record<CheckpointOf<'a>, &'a Input>;

/// Writes a recording. Dropping it writes what is left, unless the disk takes nothing any more.
#[derive(Debug)]
pub struct Recorder {
    buffer: Arc<Buffer>,
    /// Has something for pieces that were written, and is disconnected as their thread ends, if
    /// there is one.
    written: Option<Receiver<()>>,
    epoch: Option<Epoch>,
    started_unix_us: u64,
}

impl Recorder {
    /// Goes on in this file, which is made where it is not there.
    ///
    /// # Errors
    /// [`RingError`]: it holds something else, or another manager records there.
    pub fn open(path: &Path) -> Result<Self, RingError> {
        Self::write_to(Ring::open(path)?, path)
    }

    /// A recorder that writes nothing, for a wall that goes on though its recording cannot be
    /// opened; the wall's status gives the reason.
    pub fn without_file(reason: &RingError) -> Self {
        let buffer = Buffer::new(0, 0);
        buffer.give_up(format!("nothing is recorded: {reason}"));
        Self { buffer: Arc::new(buffer), written: None, epoch: None, started_unix_us: 0 }
    }

    fn write_to(mut ring: Ring, path: &Path) -> Result<Self, RingError> {
        let buffer = Buffer::new(ring.next_segment(), ring.segment_bytes());
        let write = move |piece: &RecordBatch| ring.write(piece.segment, &piece.body);
        let failed = |source| RingError::Io { path: path.to_owned(), source };
        Self::start(buffer, path, write).map_err(failed)
    }

    fn start(
        buffer: Buffer,
        path: &Path,
        mut write: impl FnMut(&RecordBatch) -> io::Result<()> + Send + 'static,
    ) -> io::Result<Self> {
        let buffer = Arc::new(buffer);
        let (shared, name) = (Arc::clone(&buffer), path.display().to_string());
        let (tell, written) = sync_channel(1);
        let work = move || {
            let write_and_tell = |piece: &RecordBatch| {
                write(piece)?;
                // One that nobody has looked at says as much.
                let _ = tell.try_send(());
                Ok(())
            };
            write_all(write_and_tell, &shared, &name);
        };
        // It is not joined: a frozen disk may hold it for ever.
        std::thread::Builder::new().name("recorder".into()).spawn(work)?;
        Ok(Self { buffer, written: Some(written), epoch: None, started_unix_us: 0 })
    }

    /// A life of the manager begins.
    pub(crate) fn begin(&mut self, fresh: ClusterConfig) {
        self.epoch = Some(fresh.epoch);
        let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        self.started_unix_us = since_1970.as_micros() as u64;
        let beginning: InitialState<CheckpointOf<'_>> = InitialState::Fresh(Box::new(fresh));
        self.segment(false, beginning);
    }

    /// The core is about to be told something.
    pub(crate) fn input(&mut self, cluster: &Cluster, now: Micros, input: &Input) {
        let record: RecordRef<'_> = Record::Input { now, input };
        let is_contiguous = match self.buffer.wants_segment() {
            Some(is_contiguous) => is_contiguous,
            None if self.buffer.append_input(|bytes| append(&record, bytes)) => return,
            // A large one, of which nothing is lost: it follows the state with which the next
            // segment begins.
            None => true,
        };
        self.segment(is_contiguous, InitialState::Checkpoint(cluster.checkpoint()));
        self.note(&record);
    }

    /// Records the core's decision on the last input.
    pub(crate) fn decided(&mut self, decision: EffectDigest) {
        self.note(&Record::Decided(decision));
    }

    /// Returns a warning for an operator if the recording has failed.
    pub(crate) fn warning(&self) -> Option<String> {
        self.buffer.failure()
    }

    fn segment(&mut self, is_contiguous: bool, beginning: InitialState<CheckpointOf<'_>>) {
        let Some(epoch) = self.epoch else { return };
        self.buffer.begin_segment();
        let program = env!("CARGO_PKG_VERSION").to_owned();
        let started_unix_us = self.started_unix_us;
        let segment = Segment { program, epoch, started_unix_us, is_contiguous, beginning };
        self.note(&Record::Begin(segment));
    }

    fn note(&self, record: &RecordRef<'_>) {
        self.buffer.append(|bytes| append(record, bytes));
    }
}

fn append(record: &RecordRef<'_>, bytes: &mut Vec<u8>) {
    polyptych_codec::append_framed(record, bytes);
}

impl Drop for Recorder {
    fn drop(&mut self) {
        // A recording without an end says that the manager did not end in order.
        if !std::thread::panicking() {
            self.note(&Record::End);
        }
        self.buffer.close();
        let Some(written) = &self.written else { return };
        // What else went wrong was logged.
        loop {
            match written.recv_timeout(END_TIME_MAX) {
                Ok(()) => {}
                Err(RecvTimeoutError::Disconnected) => return,
                Err(RecvTimeoutError::Timeout) => break,
            }
        }
        tracing::warn!("the disk of the recording does not answer; its end may be missing");
    }
}

/// Empties the buffer into the file until the recorder is dropped or the disk fails.
fn write_all(mut write: impl FnMut(&RecordBatch) -> io::Result<()>, buffer: &Buffer, path: &str) {
    while let Some(pieces) = buffer.take(FLUSH_PERIOD) {
        let written = pieces.iter().try_for_each(&mut write);
        if let Err(error) = written {
            // The wall goes on: it was never there for its recording.
            tracing::error!(path, %error, "the recording breaks off here");
            buffer.give_up(format!("the recording {path} breaks off: {error}"));
            return;
        }
    }
}
