//! Requests that this process ends.

use std::future::Future;
use std::io;

use rustix::process::{Signal, set_parent_process_death_signal};
use tokio::signal::unix::{SignalKind, signal};

/// Calls `on_request` on a thread of its own whenever this process is asked to end: by Ctrl-C,
/// SIGTERM, the end of its terminal (SIGHUP, unless `nohup` has started it) or, `with_parent`, the
/// end of its parent. Requests count from the moment this returns. The end of a terminal is no
/// repetition of another request: it comes twice, from the shell and the kernel, or behind SIGTERM.
pub(crate) fn watch_shutdown_signals(
    with_parent: bool,
    mut on_request: impl FnMut() + Send + 'static,
) -> io::Result<()> {
    if with_parent {
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
    let mut parent = with_parent.then(parent_end).transpose()?;
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
pub(crate) fn shutdown_signal(with_parent: bool) -> io::Result<impl Future<Output = ()>> {
    let (ask, asked) = tokio::sync::oneshot::channel::<()>();
    let mut ask = Some(ask);
    watch_shutdown_signals(with_parent, move || drop(ask.take()))?;
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

/// Ready when the process that holds the other end of our standard input has ended.
fn parent_end() -> io::Result<tokio::sync::oneshot::Receiver<()>> {
    let (gone, is_gone) = tokio::sync::oneshot::channel();
    let watch = move || {
        let _ = io::copy(&mut io::stdin(), &mut io::sink());
        drop(gone);
    };
    std::thread::Builder::new().name("parent".into()).spawn(watch)?;
    Ok(is_gone)
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

    use rustix::process::{Signal, getpid, kill_process};

    use super::*;

    /// A listener that is not there yet when the call returns would let the signal end this test.
    #[test]
    fn a_signal_counts_as_soon_as_the_call_returns() {
        let (asked, is_asked) = mpsc::sync_channel(4);
        let hangup = (!is_hangup_ignored()).then_some(Signal::HUP);
        watch_shutdown_signals(false, move || _ = asked.send(())).expect("listeners");
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

    #[test]
    fn a_hangup_that_is_ignored_is_read_from_the_mask_of_signals() {
        let status = |mask| format!("Name:\tpolyptych\nSigBlk:\t1\nSigIgn:\t{mask}\nSigCgt:\t1\n");
        assert!(ignores_hangup(&status("0000000000001001")));
        assert!(!ignores_hangup(&status("0000000000001000")));
        assert!(!ignores_hangup("Name:\tpolyptych\n"));
    }
}
