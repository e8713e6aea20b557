//! A connection that ends if its peer takes nothing for too long, or says nothing.

use std::io;
use std::pin::Pin;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::time::{Instant, Sleep};

/// Time for a last look once a limit is over. A process that stood still, as one in the background
/// or in a debugger, sees its timers before what has come meanwhile.
const LAST_LOOK_TIME: Duration = Duration::from_millis(250);

/// A stream whose writes fail once the peer has read nothing for a while. A peer that stops reading
/// holds what waits for it no longer than that; one that reads slowly may take its time. Reads may
/// have such a limit too, where the peer sends something now and then.
#[derive(Debug)]
pub struct StallLimit<S> {
    stream: S,
    writes: WaitLimit,
    /// `None` if the peer may be silent.
    reads: Option<WaitLimit>,
}

/// A limit of the time that one direction of a stream may wait.
#[derive(Debug)]
struct WaitLimit {
    limit: Duration,
    /// Runs while the direction waits.
    timer: Pin<Box<Sleep>>,
    is_waiting: bool,
    is_last_look: bool,
}

impl WaitLimit {
    fn new(limit: Duration) -> Self {
        let timer = Box::pin(tokio::time::sleep(limit));
        Self { limit, timer, is_waiting: false, is_last_look: false }
    }

    /// Passes on the outcome of an operation, and fails it if it has waited for too long. `done`
    /// says what the peer would have done.
    fn apply<T>(
        &mut self,
        context: &mut Context<'_>,
        outcome: Poll<io::Result<T>>,
        done: &str,
    ) -> Poll<io::Result<T>> {
        if outcome.is_ready() {
            self.is_waiting = false;
            return outcome;
        }
        if !std::mem::replace(&mut self.is_waiting, true) {
            self.timer.as_mut().reset(Instant::now() + self.limit);
            self.is_last_look = false;
        }
        ready!(self.timer.as_mut().poll(context));
        if !std::mem::replace(&mut self.is_last_look, true) {
            self.timer.as_mut().reset(Instant::now() + LAST_LOOK_TIME);
            ready!(self.timer.as_mut().poll(context));
        }
        let reason = format!("it has {done} nothing for {} s", self.limit.as_secs());
        Poll::Ready(Err(io::Error::new(io::ErrorKind::TimedOut, reason)))
    }
}

impl<S> StallLimit<S> {
    /// Limits the time that one write to this stream may wait. Call it within a tokio runtime,
    /// which has the clock.
    pub fn new(stream: S, limit: Duration) -> Self {
        Self { stream, writes: WaitLimit::new(limit), reads: None }
    }

    /// Limits the time that one read may wait too, from now on; in a tokio runtime as well. Time in
    /// which nobody reads does not count, so that a slow reader takes no peer for silent.
    pub fn limit_silence(&mut self, limit: Duration) {
        self.reads = Some(WaitLimit::new(limit));
    }

    fn limit_write<T>(
        &mut self,
        context: &mut Context<'_>,
        written: Poll<io::Result<T>>,
    ) -> Poll<io::Result<T>> {
        self.writes.apply(context, written, "read")
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for StallLimit<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let read = Pin::new(&mut self.stream).poll_read(context, buffer);
        match &mut self.reads {
            Some(reads) => reads.apply(context, read, "sent"),
            None => read,
        }
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for StallLimit<S> {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write(context, bytes);
        self.limit_write(context, written)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let flushed = Pin::new(&mut self.stream).poll_flush(context);
        self.limit_write(context, flushed)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let ended = Pin::new(&mut self.stream).poll_shutdown(context);
        self.limit_write(context, ended)
    }
}

#[cfg(test)]
mod tests {
    use tokio::io::{AsyncReadExt, AsyncWriteExt};

    use super::*;

    const LIMIT: Duration = Duration::from_secs(10);

    /// A stream whose peer takes nothing.
    struct Deaf;

    impl AsyncWrite for Deaf {
        fn poll_write(
            self: Pin<&mut Self>,
            _context: &mut Context<'_>,
            _bytes: &[u8],
        ) -> Poll<io::Result<usize>> {
            Poll::Pending
        }

        fn poll_flush(self: Pin<&mut Self>, _context: &mut Context<'_>) -> Poll<io::Result<()>> {
            Poll::Pending
        }

        fn poll_shutdown(self: Pin<&mut Self>, _context: &mut Context<'_>) -> Poll<io::Result<()>> {
            Poll::Pending
        }
    }

    /// Checks that an operation has failed since the peer took nothing for as long as the limit.
    #[track_caller]
    fn check_stalled(done: io::Result<()>, begun: Instant) {
        let error = done.expect_err("nobody reads");
        assert_eq!(error.kind(), io::ErrorKind::TimedOut);
        assert_eq!(error.to_string(), "it has read nothing for 10 s");
        let waited = begun.elapsed();
        assert!((LIMIT..LIMIT + 2 * LAST_LOOK_TIME).contains(&waited), "{waited:?}");
    }

    #[tokio::test(start_paused = true)]
    async fn a_peer_that_takes_nothing_ends_whatever_waits_for_it() {
        let deaf = || (StallLimit::new(Deaf, LIMIT), Instant::now());
        let (mut stream, begun) = deaf();
        check_stalled(stream.write_all(&[1]).await, begun);
        let (mut stream, begun) = deaf();
        check_stalled(stream.flush().await, begun);
        let (mut stream, begun) = deaf();
        check_stalled(stream.shutdown().await, begun);

        // One that is slow is waited for, and time in which nothing is written does not count.
        let (ours, mut theirs) = tokio::io::duplex(1);
        let mut stream = StallLimit::new(ours, LIMIT);
        let slow = async {
            for _ in 0..3 {
                tokio::time::advance(LIMIT * 9 / 10).await;
                theirs.read_exact(&mut [0]).await.expect("read");
            }
        };
        let (written, ()) = tokio::join!(stream.write_all(&[1; 4]), slow);
        written.expect("it takes one byte after the other");
        tokio::time::advance(2 * LIMIT).await;
        let begun = Instant::now();
        check_stalled(stream.write_all(&[2]).await, begun);
    }
}
