//! The log's own thread: no other thread ever waits for standard error.
//!
//! A pipe that nobody reads and a terminal after Ctrl-S take no more bytes. Lines then wait in a
//! bounded queue; those that do not fit are dropped and counted, and the count is logged as soon
//! as standard error takes lines again.

use std::collections::VecDeque;
use std::io::{self, Write};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::Builder;
use std::time::{Duration, Instant};

/// Maximum bytes of lines that wait: a minute of a busy manager, and little memory.
pub(super) const QUEUE_BYTES_MAX: usize = 256 * 1024;

/// Maximum bytes of last words that wait beyond [`QUEUE_BYTES_MAX`]: why a process ends is never
/// dropped for the sake of what it said before.
const LAST_WORDS_BYTES_MAX: usize = 64 * 1024;

/// Maximum bytes that wait where something is drawn on a terminal: a few pictures of a bar.
const DRAWING_BYTES_MAX: usize = 4 * 1024;

/// Formats the count of dropped lines as a line of the log.
type DroppedLine = fn(u64) -> String;

/// Lines on their way to the thread that writes them.
#[derive(Clone, Debug)]
pub(super) struct Queue(Arc<Shared>);

#[derive(Debug)]
struct Shared {
    waiting: Mutex<Waiting>,
    changed: Condvar,
    dropped_line: DroppedLine,
}

#[derive(Debug, Default)]
struct Waiting {
    lines: VecDeque<Vec<u8>>,
    bytes: usize,
    dropped: u64,
    /// The thread is between taking lines and having written them.
    is_writing: bool,
}

impl Queue {
    /// Starts the thread that writes to `out`.
    ///
    /// # Errors
    /// The system gives no thread.
    pub fn start(out: impl Write + Send + 'static, dropped_line: DroppedLine) -> io::Result<Self> {
        let queue = Self(Arc::new(Shared {
            waiting: Mutex::default(),
            changed: Condvar::new(),
            dropped_line,
        }));
        let written = queue.clone();
        Builder::new().name("log".into()).spawn(move || written.write_all(out))?;
        Ok(queue)
    }

    /// Takes a line, or counts it as dropped if the queue is full. Never waits for the writer.
    pub fn push(&self, line: &[u8]) {
        self.push_within(line, QUEUE_BYTES_MAX);
    }

    /// Takes a line that says why the process ends, also if the queue is full.
    pub fn push_last_words(&self, line: &[u8]) {
        self.push_within(line, QUEUE_BYTES_MAX + LAST_WORDS_BYTES_MAX);
    }

    /// Takes what is soon drawn anew; if much waits already it is forgotten, and not counted.
    pub fn push_drawing(&self, bytes: &[u8]) {
        drop(self.try_push(bytes, DRAWING_BYTES_MAX));
    }

    fn push_within(&self, line: &[u8], bytes_max: usize) {
        if let Err(mut waiting) = self.try_push(line, bytes_max) {
            waiting.dropped += 1;
        }
    }

    /// Takes a line if no more than `bytes_max` wait then; else returns the lock.
    fn try_push(&self, line: &[u8], bytes_max: usize) -> Result<(), MutexGuard<'_, Waiting>> {
        let mut waiting = self.lock();
        if waiting.bytes + line.len() > bytes_max {
            return Err(waiting);
        }
        waiting.bytes += line.len();
        waiting.lines.push_back(line.to_vec());
        drop(waiting);
        self.0.changed.notify_all();
        Ok(())
    }

    /// Waits until all lines are written, or for `time_max`. Returns whether they are.
    pub fn flush(&self, time_max: Duration) -> bool {
        let end = Instant::now() + time_max;
        let mut waiting = self.lock();
        while waiting.is_writing || !waiting.lines.is_empty() {
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return false;
            }
            let waited = self.0.changed.wait_timeout(waiting, left);
            waiting = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
        true
    }

    fn lock(&self) -> MutexGuard<'_, Waiting> {
        self.0.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The thread: writes line after line, for as long as the process lives.
    fn write_all(&self, mut out: impl Write) {
        loop {
            let (line, dropped) = self.next();
            // Where standard error is closed, there is nobody to tell.
            let _ = out.write_all(&line);
            if dropped > 0 {
                let _ = out.write_all((self.0.dropped_line)(dropped).as_bytes());
            }
            let _ = out.flush();
            self.lock().is_writing = false;
            self.0.changed.notify_all();
        }
    }

    /// Waits for a line. Returns it, and the number of lines that were dropped behind it if no
    /// other line waits.
    fn next(&self) -> (Vec<u8>, u64) {
        let mut waiting = self.lock();
        loop {
            if let Some(line) = waiting.lines.pop_front() {
                waiting.bytes -= line.len();
                waiting.is_writing = true;
                let is_last = waiting.lines.is_empty();
                let dropped = if is_last { std::mem::take(&mut waiting.dropped) } else { 0 };
                return (line, dropped);
            }
            waiting = self.0.changed.wait(waiting).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

    use super::*;

    const LIMIT: Duration = Duration::from_secs(20);

    /// Standard error that takes a line only when it is allowed to.
    struct Stuck {
        allowed: Receiver<()>,
        written: Arc<Mutex<Vec<u8>>>,
    }

    impl Write for Stuck {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            // At the end of the test it takes everything.
            let _ = self.allowed.recv();
            self.written.lock().expect("not poisoned").extend(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    fn stuck() -> (Queue, SyncSender<()>, Arc<Mutex<Vec<u8>>>) {
        let (allow, allowed) = sync_channel(1024);
        let written = Arc::<Mutex<Vec<u8>>>::default();
        let out = Stuck { allowed, written: Arc::clone(&written) };
        let queue = Queue::start(out, |count| format!("{count} dropped\n")).expect("a thread");
        (queue, allow, written)
    }

    #[test]
    fn drops_and_counts_lines_while_nobody_reads_and_says_the_count_later() {
        let (queue, allow, written) = stuck();
        let line = [&[b'x'; 1023][..], b"\n"].concat();
        let begin = Instant::now();
        for _ in 0..1000 {
            queue.push(&line);
        }
        queue.push_last_words(b"the reason\n");
        assert!(begin.elapsed() < LIMIT, "nothing waits");
        assert!(!queue.flush(Duration::from_millis(10)), "nothing is written");
        assert!(queue.lock().bytes <= QUEUE_BYTES_MAX + LAST_WORDS_BYTES_MAX);
        drop(allow);
        assert!(queue.flush(LIMIT), "all is written");
        let text = String::from_utf8(written.lock().expect("not poisoned").clone()).expect("text");
        let lines: Vec<&str> = text.lines().collect();
        let kept = lines.iter().filter(|line| line.starts_with('x')).count();
        let last = lines.len() - 1;
        assert_eq!(lines[last], format!("{} dropped", 1000 - kept));
        assert_eq!(lines[last - 1], "the reason");
        assert!((256..1000).contains(&kept), "{kept}");
    }

    #[test]
    fn writes_lines_in_order_and_says_nothing_of_dropped_ones_if_there_are_none() {
        let (queue, allow, written) = stuck();
        drop(allow);
        for number in 0..100 {
            queue.push(format!("{number}\n").as_bytes());
        }
        assert!(queue.flush(LIMIT));
        let text = String::from_utf8(written.lock().expect("not poisoned").clone()).expect("text");
        let numbers: Vec<u32> = text.lines().map(|line| line.parse().expect("a number")).collect();
        assert_eq!(numbers, (0..100).collect::<Vec<_>>());
    }
}
