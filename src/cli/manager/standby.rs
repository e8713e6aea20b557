//! A manager that shares its wall with others: one leads by a lease, the others wait.

use std::fs;
use std::net::SocketAddr;
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::bail;
use polyptych_manager::leadership::{Leadership, Release, Waited};
use polyptych_manager::lease::{LEASE_TIME_MAX, LEASE_TIME_MIN, LeaseFile, LeaseRecord};
use polyptych_protocol::service_notifier::ServiceNotifier;

/// A lease time in seconds, as an argument.
pub(super) fn lease_time(text: &str) -> Result<Duration, String> {
    let time = super::super::seconds(text)?;
    if (LEASE_TIME_MIN..=LEASE_TIME_MAX).contains(&time) {
        return Ok(time);
    }
    let [min, max] = [LEASE_TIME_MIN, LEASE_TIME_MAX].map(|limit| limit.as_secs_f64());
    Err(format!("{text} is not from {min} to {max} seconds"))
}

/// What a manager that waits tells its log and its supervisor.
struct Watch<'a> {
    notifier: Option<&'a ServiceNotifier>,
    /// The term and the holder that were told last.
    told: Option<(u64, String)>,
    /// The last record that was not the one before, and when it was found.
    last: Option<(LeaseRecord, Instant)>,
    sign_due: Instant,
}

impl Watch<'_> {
    fn look(&mut self, found: Option<&LeaseRecord>) {
        let now = Instant::now();
        if found.is_none() && self.told.take().is_some() {
            tracing::warn!(
                "waiting: the lease file is not there any more; mount its storage, or start all \
                 managers of this wall anew"
            );
        }
        if let Some(found) = found.filter(|found| self.last.as_ref().is_none_or(|l| l.0 != **found))
        {
            self.last = Some((found.clone(), now));
        }
        if let Some(led) = found.filter(|found| !found.is_released) {
            let leader = (led.term, led.holder.clone());
            if self.told.as_ref() != Some(&leader) {
                tracing::info!("waiting: {} holds the lease, with term {}", leader.1, leader.0);
                if let Some(notifier) = self.notifier {
                    notifier.status(&format!("standby of {}", leader.1));
                }
                self.told = Some(leader);
            }
        }
        if let Some(notifier) = self.notifier.filter(|_| now >= self.sign_due) {
            // It does what it is there for: a supervisor must not take it for one that hangs.
            notifier.ready();
            notifier.alive();
            self.sign_due = now + notifier.period();
        }
    }

    fn took_over(&self, term: u64) {
        match &self.last {
            Some((last, _)) if last.is_released => {
                tracing::info!(term, "took over from {}, which has ended", last.holder);
            }
            Some((last, at)) => {
                let ms = at.elapsed().as_millis();
                let holder = &last.holder;
                tracing::info!(term, "took over after {ms} ms without a sign of {holder}");
            }
            None => tracing::info!(term, "took the lease, which no manager has held before"),
        }
    }
}

/// Waits until this manager leads the wall whose state is in this file; `None` if it was told to
/// end before, or the wall was stopped.
pub(super) fn wait(
    runtime: &tokio::runtime::Runtime,
    state: &Path,
    address: SocketAddr,
    lease_time: Duration,
    notifier: Option<&ServiceNotifier>,
    is_asked_to_end: impl Future<Output = ()>,
) -> anyhow::Result<Option<Leadership>> {
    if address.port() == 0 {
        bail!("--standby needs a port that servers and clients know; give --listen HOST:PORT");
    }
    // Where it has none, the process is name enough.
    let host = fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let (host, pid) = (host.trim(), std::process::id());
    let holder = format!("{address} (process {pid} of {host})");
    let mut watch = Watch { notifier, told: None, last: None, sign_due: Instant::now() };
    let look = |found: Option<&LeaseRecord>| watch.look(found);
    let file = LeaseFile::beside(state);
    let waiting = Leadership::wait(file, holder, lease_time, look);
    let waited = runtime.block_on(async {
        tokio::select! {
            waited = waiting => waited.map(Some),
            () = is_asked_to_end => Ok(None),
        }
    })?;
    let leadership = match waited {
        Some(Waited::Leads(leadership)) => leadership,
        Some(Waited::Stopped) => {
            tracing::info!("a client stopped the wall; this standby ends");
            return Ok(None);
        }
        None => return Ok(None),
    };
    watch.took_over(leadership.term().0);
    Ok(Some(leadership))
}

/// Gives the lease up where a manager that leads could not begin, since another manager of the wall
/// may do better; returns what came.
pub(super) fn or_release<T, E>(
    leadership: Option<&Leadership>,
    begun: Result<T, E>,
) -> Result<T, E> {
    // A lost one is another manager's, or its storage does not answer.
    let held = leadership.filter(|of| begun.is_err() && of.lost_reason().is_none());
    if let Some(held) = held {
        held.release(Release::Ended);
    }
    begun
}
