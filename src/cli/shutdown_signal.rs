//! Requests that this process ends.

use std::future::Future;
use std::io;
use std::os::fd::AsFd;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::{Errno, read};
use rustix::process::{Signal, set_parent_process_death_signal};
use tokio::signal::unix::{SignalKind, signal};

/// Maximum time between two signs of life of a parent that sends any. `polyptych up` sends one
/// every 5 s to other machines.
pub(crate) const SILENCE_MAX: Duration = Duration::from_secs(20);

/// Ready when the parent of this process has ended, or counts as gone.
pub(crate) type ParentEnd = tokio::sync::oneshot::Receiver<()>;

/// Calls `on_request` on a thread of its own whenever this process is asked to end: by Ctrl-C,
/// SIGTERM, the end of its terminal (SIGHUP, unless `nohup` has started it) or the end of its
/// `parent`. Requests count from the moment this returns. The end of a terminal is no
/// repetition of another request: it comes twice, from the shell and the kernel, or behind SIGTERM.
pub(crate) fn watch_shutdown_signals(
    mut parent: Option<ParentEnd>,
    mut on_request: impl FnMut() + Send + 'static,
) -> io::Result<()> {
    if parent.is_some() {
        // A child that was stopped reads nothing: it goes on when its parent ends, and then ends.
        let continued = set_parent_process_death_signal(Some(Signal::CONT));
        if let Err(error) = continued {
            tracing::debug!(%error, "a stopped child will not notice the end of its parent");
        }
    }
    let runtime = tokio::runtime::Builder::new_current_thread().enable_io().build()?;
    // Listeners exist before this returns: until then a signal ends the process on the spot, and
    // whoever reads that the process is ready may send one at once.
    let (mut interrupt, mut terminate, mut hangup) = {
        let _entered = runtime.enter();
        let hangup = (!is_hangup_ignored()).then(|| signal(SignalKind::hangup())).transpose()?;
        (signal(SignalKind::interrupt())?, signal(SignalKind::terminate())?, hangup)
    };
    let watch = async move {
        let mut is_asked = false;
        loop {
            let parent_ends = async {
                match parent.as_mut() {
                    Some(ends) => _ = ends.await,
                    None => std::future::pending().await,
                }
            };
            let hangs_up = async {
                match hangup.as_mut() {
                    Some(hangup) => _ = hangup.recv().await,
                    None => std::future::pending().await,
                }
            };
            tokio::select! {
                biased;
                _ = interrupt.recv() => {}
                _ = terminate.recv() => {}
                () = hangs_up => {
                    if is_asked {
                        continue;
                    }
                }
                () = parent_ends => parent = None,
            }
            is_asked = true;
            on_request();
        }
    };
    let watcher = std::thread::Builder::new().name("signals".into());
    watcher.spawn(move || runtime.block_on(watch)).map(drop)
}

/// Returns a future that is ready at the first request that [`watch_shutdown_signals`] reports.
pub(crate) fn shutdown_signal(parent: Option<ParentEnd>) -> io::Result<impl Future<Output = ()>> {
    let (ask, asked) = tokio::sync::oneshot::channel::<()>();
    let mut ask = Some(ask);
    watch_shutdown_signals(parent, move || drop(ask.take()))?;
    Ok(async { _ = asked.await })
}

/// Returns whether this process was started with SIGHUP ignored, as `nohup` does. A listener would
/// take that away from it.
fn is_hangup_ignored() -> bool {
    std::fs::read_to_string("/proc/self/status").is_ok_and(|status| ignores_hangup(&status))
}

/// Returns whether SIGHUP, the first signal, is ignored by the process of this `/proc/PID/status`.
fn ignores_hangup(status: &str) -> bool {
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    mask.is_some_and(|mask| mask & 1 == 1)
}

/// Watches the process that holds the other end of our standard input, which nothing else reads.
pub(crate) fn parent_end() -> io::Result<ParentEnd> {
    watch_input(io::stdin(), SILENCE_MAX, || {})
}

/// Calls `on_end`, on a thread of its own, once an input has ended, or was silent for `silence`
/// after a sign of life; then the result is ready. A network that breaks ends no connection for
/// hours. A parent that sends nothing at all is one whose input ends with it.
pub(crate) fn watch_input(
    input: impl AsFd + Send + 'static,
    silence: Duration,
    on_end: impl FnOnce() + Send + 'static,
) -> io::Result<ParentEnd> {
    let (gone, is_gone) = tokio::sync::oneshot::channel();
    let watch = move || {
        await_end(&input, silence);
        on_end();
        drop(gone);
    };
    std::thread::Builder::new().name("parent".into()).spawn(watch)?;
    Ok(is_gone)
}

/// Returns once an input has ended, or was silent for `silence` after its first byte.
fn await_end(input: &impl AsFd, silence: Duration) {
    let silence = Timespec::try_from(silence).ok();
    let mut limit = None;
    loop {
        // Bytes that came while this process was stopped count, however late they are read.
        let come = match poll(&mut [PollFd::new(input, PollFlags::IN)], limit.as_ref()) {
            Ok(0) => return,
            Ok(_) => read(input, &mut [0_u8; 64]),
            Err(error) => Err(error),
        };
        match come {
            Err(Errno::INTR | Errno::AGAIN) => {}
            // What cannot be read has ended, too.
            Ok(0) | Err(_) => return,
            Ok(_) => limit = silence,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;
    use std::sync::mpsc;

    use rustix::process::{Signal, getpid, kill_process};

    use super::*;

    /// A listener that is not there yet when the call returns would let the signal end this test.
    #[test]
    fn a_signal_counts_as_soon_as_the_call_returns() {
        let (asked, is_asked) = mpsc::sync_channel(4);
        let hangup = (!is_hangup_ignored()).then_some(Signal::HUP);
        watch_shutdown_signals(None, move || _ = asked.send(())).expect("listeners");
        for signal in hangup.into_iter().chain([Signal::TERM, Signal::INT, Signal::TERM]) {
            kill_process(getpid(), signal).expect("sent");
            is_asked.recv().expect("a call for each signal");
            // Once more for the same terminal: this one does not count.
            if let Some(hangup) = hangup {
                kill_process(getpid(), hangup).expect("sent");
            }
        }
        kill_process(getpid(), Signal::INT).expect("sent");
        is_asked.recv().expect("a call");
        assert!(is_asked.try_recv().is_err(), "a hangup counted as a repetition");
    }

    /// The network between both breaks: the input stays open.
    #[test]
    fn a_parent_that_falls_silent_after_a_sign_of_life_counts_as_gone() {
        let watch = |input: io::PipeReader| {
            let (tell, is_told) = mpsc::sync_channel(1);
            let ends = watch_input(input, Duration::ZERO, move || _ = tell.send(()));
            (ends.expect("a thread"), is_told)
        };
        let (input, _silent_parent) = io::pipe().expect("a pipe");
        let (_, is_told_of_silent) = watch(input);
        let (input, mut parent) = io::pipe().expect("a pipe");
        parent.write_all(b"\n").expect("written");
        let (ends, is_told) = watch(input);
        is_told.recv_timeout(Duration::from_mins(1)).expect("gone, though its side is open");
        ends.blocking_recv().expect_err("nothing is said, and nobody is there to say it");
        assert!(is_told_of_silent.try_recv().is_err(), "one that never sends anything is there");
    }

    #[test]
    fn a_hangup_that_is_ignored_is_read_from_the_mask_of_signals() {
        let status = |mask| format!("Name:\tpolyptych\nSigBlk:\t1\nSigIgn:\t{mask}\nSigCgt:\t1\n");
        assert!(ignores_hangup(&status("0000000000001001")));
        assert!(!ignores_hangup(&status("0000000000001000")));
        assert!(!ignores_hangup("Name:\tpolyptych\n"));
    }
}
