//! The lease as one manager holds it: waited for, renewed on a thread of its own, and asked before
//! each command whether it still holds.

use std::io;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::thread::{Builder, park_timeout};
use std::time::{Duration, Instant, SystemTime};

use polyptych_files::storage_fault::RETRY_TIME_MAX;
use polyptych_protocol::command::Goodbye;
use polyptych_protocol::ids::Term;
use polyptych_protocol::leader_status::LeaderStatus;
use tokio_util::sync::CancellationToken;

use crate::lease::{ClockReading, Contender, LeaseFile, LeaseFileError, LeaseRecord};

/// Maximum time between two looks of a manager that waits: its supervisor hears from it as often.
const LOOK_PERIOD_MAX: Duration = Duration::from_millis(500);

/// The lead of one manager over its wall; clones share it.
#[derive(Clone, Debug)]
pub struct Leadership {
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    file: LeaseFile,
    holder: String,
    term: Term,
    period: Duration,
    /// The start of this manager's clock.
    started: Instant,
    /// Locked while the record is renewed.
    contender: Mutex<Contender>,
    /// The end of the lease, as the last renewal has it. Locked for no longer than to copy it.
    valid_until: Mutex<ClockReading>,
    is_released: AtomicBool,
    /// Number of times that [`Leadership::fenced`] has begun or ended: odd while it runs.
    fence_steps: AtomicU64,
    lost: CancellationToken,
    lost_reason: OnceLock<String>,
}

/// The way in which waiting for a lease has ended.
#[derive(Debug)]
pub enum Waited {
    /// This manager leads.
    Leads(Leadership),
    /// A client stopped the wall while another manager led it.
    Stopped,
}

/// The reason for which a leader gives its lease up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Release {
    /// This process ends: the next manager may lead at once.
    Ended,
    /// The wall was stopped: managers that wait end too.
    Stopped,
}

impl Leadership {
    /// Waits until this manager holds the lease, or another one that held it has stopped the wall.
    /// Dropping the future gives up. `on_look` is called with each record that is found, several
    /// times a second.
    ///
    /// # Errors
    /// The first look fails for good, or for [`RETRY_TIME_MAX`]; later ones are tried again, and
    /// logged.
    pub async fn wait(
        file: LeaseFile,
        holder: String,
        lease_time: Duration,
        mut on_look: impl FnMut(Option<&LeaseRecord>),
    ) -> Result<Waited, LeaseFileError> {
        let started = Instant::now();
        let mut contender = Contender::new(holder.clone(), lease_time);
        let mut last_fault = None;
        let (mut is_first, mut was_led) = (true, false);
        loop {
            let looked = file.locked(|found| {
                on_look(found);
                let is_led = found.is_some_and(|found| !found.is_released);
                if was_led && found.is_some_and(|found| found.is_stopped) {
                    return (None, (true, contender.clone()));
                }
                was_led |= is_led;
                let mut next = contender.clone();
                let record = next.step(read_clocks(started), found);
                (record, (false, next))
            });
            match looked {
                Ok((true, _)) => return Ok(Waited::Stopped),
                Ok((false, next)) => (contender, is_first) = (next, false),
                Err(error)
                    if is_first && !(error.may_pass() && started.elapsed() < RETRY_TIME_MAX) =>
                {
                    return Err(error);
                }
                Err(error) => {
                    let fault = error.to_string();
                    if last_fault.as_ref() != Some(&fault) {
                        tracing::warn!(%error, "cannot look at the lease; trying again");
                        last_fault = Some(fault);
                    }
                }
            }
            if let Some((term, until)) = contender.term().zip(contender.valid_until()) {
                let leads = Self::start(file.clone(), holder, Term(term), contender, started);
                leads.shared.set_valid_until(until);
                return leads.renew_on_thread().map(Waited::Leads).map_err(|s| file.failed(s));
            }
            tokio::time::sleep(contender.period().min(LOOK_PERIOD_MAX)).await;
        }
    }

    fn start(
        file: LeaseFile,
        holder: String,
        term: Term,
        contender: Contender,
        started: Instant,
    ) -> Self {
        let period = contender.period();
        let shared = Shared {
            file,
            holder,
            term,
            period,
            started,
            contender: Mutex::new(contender),
            valid_until: Mutex::default(),
            is_released: AtomicBool::new(false),
            fence_steps: AtomicU64::new(0),
            lost: CancellationToken::new(),
            lost_reason: OnceLock::new(),
        };
        Self { shared: Arc::new(shared) }
    }

    fn renew_on_thread(self) -> io::Result<Self> {
        let shared = Arc::clone(&self.shared);
        let renew = move || {
            let mut last_fault = None;
            while !shared.is_over() {
                park_timeout(shared.period);
                let fence_step = shared.fence_step();
                let fault = shared.renew().err().map(|error| error.to_string());
                if let Some(fault) =
                    fault.as_ref().filter(|fault| last_fault.as_ref() != Some(*fault))
                {
                    tracing::warn!(fault, "cannot renew the lease; trying again");
                }
                if let Some(fault) = fault.as_ref().filter(|_| !shared.is_valid()) {
                    shared.lose_if_free(fence_step, fault);
                }
                last_fault = fault;
            }
        };
        Builder::new().name("lease".into()).spawn(renew)?;
        Ok(self)
    }

    /// The number of this lead: greater than that of every manager that led before.
    pub fn term(&self) -> Term {
        self.shared.term
    }

    /// Returns this lead as clients see it.
    pub fn status(&self) -> LeaderStatus {
        LeaderStatus { term: self.shared.term, holder: self.shared.holder.clone() }
    }

    /// Returns whether this manager may command now. A lease that has run out is renewed first,
    /// unless another manager has it: a process that was stopped for a while, or whose machine
    /// slept, goes on, or never commands again.
    pub fn is_held(&self) -> bool {
        let shared = &self.shared;
        if shared.is_over() {
            return false;
        }
        if shared.is_valid() {
            return true;
        }
        let fence_step = shared.fence_step();
        if let Err(error) = shared.renew() {
            shared.lose_if_free(fence_step, &error.to_string());
        }
        shared.is_valid() && !shared.is_over()
    }

    /// Puts the state file in its place by `work`, while no other manager can take the lease; the
    /// record says from then on that there is one.
    ///
    /// # Errors
    /// This manager leads no more, the lease cannot be read or written, or `work` fails.
    pub fn fenced<T>(&self, work: impl FnOnce() -> io::Result<T>) -> io::Result<T> {
        let shared = &self.shared;
        // Before the lock is taken: storage may stall as the record is read, too.
        shared.fence_steps.fetch_add(1, Ordering::SeqCst);
        let done = shared.file.locked(|found| {
            let ours = found.filter(|f| f.term == shared.term.0 && !f.is_released);
            let Some(ours) = ours else {
                let reason = shared.lose(led_by(found));
                return (None, Err(io::Error::other(reason)));
            };
            let done = work();
            let is_first = done.is_ok() && !ours.has_state;
            (is_first.then(|| LeaseRecord { has_state: true, ..ours.clone() }), done)
        });
        // Not before: the record that there is a state is written under the lock, too.
        shared.fence_steps.fetch_add(1, Ordering::SeqCst);
        done.map_err(io::Error::other)?
    }

    /// Returns whether a leader of this wall has written its state file, this one or one before.
    ///
    /// # Errors
    /// The lease cannot be read.
    pub fn has_written_state(&self) -> Result<bool, LeaseFileError> {
        self.shared.file.locked(|found| (None, found.is_some_and(|found| found.has_state)))
    }

    /// Ready once this manager leads no more; never if it gives the lease up itself.
    pub async fn lost(&self) {
        self.shared.lost.cancelled().await;
    }

    /// Returns the reason why this manager leads no more, if it has lost its lease.
    pub fn lost_reason(&self) -> Option<&str> {
        self.shared.lost_reason.get().map(String::as_str)
    }

    /// Gives the lease up as a manager ends that has said this goodbye.
    pub fn release_after(&self, goodbye: &Goodbye) {
        self.release(match goodbye {
            Goodbye::Stopped | Goodbye::StoppedWithServers => Release::Stopped,
            Goodbye::Ended | Goodbye::Closed { .. } => Release::Ended,
        });
    }

    /// Gives the lease up; nothing is commanded any more.
    pub fn release(&self, release: Release) {
        let shared = &self.shared;
        let mut contender = shared.contender.lock().unwrap_or_else(PoisonError::into_inner);
        shared.is_released.store(true, Ordering::Relaxed);
        let released = shared.file.locked(|found| {
            let record = contender.release(found);
            let is_stopped = release == Release::Stopped;
            (record.map(|record| LeaseRecord { is_stopped, ..record }), ())
        });
        if let Err(error) = released {
            tracing::warn!(%error, "cannot give up the lease; the next manager waits for its end");
        }
    }
}

/// Ready when `shutdown` is, or once this manager leads no more.
pub(crate) async fn until_lost(
    leadership: Option<&Leadership>,
    shutdown: impl Future<Output = ()>,
) {
    let lost = async {
        match leadership {
            Some(leadership) => leadership.lost().await,
            None => std::future::pending().await,
        }
    };
    tokio::select! {
        () = shutdown => {}
        () = lost => {}
    }
}

impl Shared {
    fn is_valid(&self) -> bool {
        let until = *self.valid_until.lock().unwrap_or_else(PoisonError::into_inner);
        read_clocks(self.started).is_before(until)
    }

    fn set_valid_until(&self, until: ClockReading) {
        *self.valid_until.lock().unwrap_or_else(PoisonError::into_inner) = until;
    }

    fn is_over(&self) -> bool {
        self.lost.is_cancelled() || self.is_released.load(Ordering::Relaxed)
    }

    /// Renews the lease; finds out if it is lost.
    fn renew(&self) -> Result<(), LeaseFileError> {
        let mut contender = self.contender.lock().unwrap_or_else(PoisonError::into_inner);
        if self.is_over() {
            return Ok(());
        }
        let (next, reason) = self.file.locked(|found| {
            let mut next = contender.clone();
            let record = next.step(read_clocks(self.started), found);
            let reason = record.is_none().then(|| led_by(found));
            (record, (next, reason))
        })?;
        *contender = next;
        match (contender.valid_until(), reason) {
            (Some(until), None) => self.set_valid_until(until),
            (_, reason) => drop(self.lose(reason.unwrap_or_default())),
        }
        Ok(())
    }

    fn fence_step(&self) -> u64 {
        self.fence_steps.load(Ordering::SeqCst)
    }

    /// Leads no more, as the lease could not be renewed in time; unless this manager itself held
    /// the lock, or waited for it, at any time since `fence_step` was read before the renewal. A
    /// lease that has run out commands nothing before a later renewal finds it not taken.
    fn lose_if_free(&self, fence_step: u64, fault: &str) {
        if fence_step.is_multiple_of(2) && self.fence_step() == fence_step {
            self.lose(format!("the lease could not be renewed in time: {fault}"));
        }
    }

    /// Never commands again; returns the first reason.
    fn lose(&self, reason: String) -> String {
        let reason = self.lost_reason.get_or_init(|| reason).clone();
        self.lost.cancel();
        reason
    }
}

/// Reads the clocks of this machine. If it sleeps between the two, the second one says so.
fn read_clocks(started: Instant) -> ClockReading {
    let awake = started.elapsed();
    let of_day = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
    // Without a battery a machine may be in 1970.
    ClockReading { awake, of_day: of_day.unwrap_or_default() }
}

/// Returns the reason for which a lease is lost whose file has this record.
fn led_by(found: Option<&LeaseRecord>) -> String {
    match found {
        Some(found) => format!("{} leads the wall now, with term {}", found.holder, found.term),
        None => "the lease file was removed".to_owned(),
    }
}

#[cfg(test)]
mod tests;
