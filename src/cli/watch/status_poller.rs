//! Where the watched status comes from: a thread that asks, and connects again for ever.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use polyptych_client::WallStatus;
use polyptych_client::blocking::Client;
use polyptych_protocol::limits::MANAGER_SILENCE_MAX;

use super::rates::Rates;
use super::table::{Trouble, WatchModel};
use crate::cli::{ManagerAddress, one_line};

/// Between two questions: four times a second follows a wall well and costs it nothing.
const ASK_PERIOD: Duration = Duration::from_millis(250);

/// Between two tries to connect.
const RETRY_PERIOD: Duration = Duration::from_millis(500);

/// What was learned last.
#[derive(Clone, Debug, Default)]
pub(super) struct Latest {
    /// Raised with every answer and every failure.
    pub number: u64,
    pub manager: String,
    /// The last answer, also where the manager has gone since.
    pub status: Option<WallStatus>,
    pub rates: Rates,
    /// Why there is no newer answer.
    pub trouble: Option<Outage>,
    /// The time since which an answer is waited for.
    asked: Option<Instant>,
}

/// Since when there is no answer, and why.
#[derive(Clone, Debug)]
pub(super) struct Outage {
    since: Instant,
    since_utc_s: u64,
    pub reason: String,
}

impl Outage {
    fn begun(since: Instant, reason: String) -> Self {
        let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let since_utc_s = since_1970.saturating_sub(since.elapsed()).as_secs();
        Self { since, since_utc_s, reason }
    }
}

impl Latest {
    /// Returns what is known at this time: a manager that says nothing for
    /// [`MANAGER_SILENCE_MAX`] hangs, though its answer is waited for much longer.
    fn at(mut self, now: Instant) -> Self {
        let silent_since =
            self.asked.filter(|asked| now.saturating_duration_since(*asked) >= MANAGER_SILENCE_MAX);
        if let Some(since) = silent_since.filter(|_| self.trouble.is_none()) {
            self.trouble = Some(Outage::begun(since, "it does not answer".to_owned()));
        }
        self
    }

    pub fn view(&self) -> WatchModel<'_> {
        let trouble = self.trouble.as_ref().map(|gone| Trouble {
            manager: &self.manager,
            reason: &gone.reason,
            since_utc_s: gone.since_utc_s,
            seconds: gone.since.elapsed().as_secs(),
        });
        WatchModel { status: self.status.as_ref(), rates: &self.rates, trouble }
    }
}

/// The thread's results. It ends with the process.
#[derive(Debug)]
pub(in crate::cli) struct StatusPoller(Arc<Mutex<Latest>>);

impl StatusPoller {
    pub(in crate::cli) fn start(manager: &ManagerAddress) -> std::io::Result<Self> {
        let latest = Latest { manager: manager.manager.clone(), ..Latest::default() };
        let shared = Arc::new(Mutex::new(latest));
        let (source, manager) = (Self(Arc::clone(&shared)), manager.clone());
        let work = move || {
            let began = Instant::now();
            let mut client = None;
            loop {
                lock(&shared).asked = Some(Instant::now());
                let asked = ask(&manager, &mut client);
                let wait = if asked.is_ok() { ASK_PERIOD } else { RETRY_PERIOD };
                note(&shared, began, asked);
                std::thread::sleep(wait);
            }
        };
        std::thread::Builder::new().name("status".into()).spawn(work)?;
        Ok(source)
    }

    /// Returns the last answer if there is no newer trouble, and that trouble.
    pub(in crate::cli) fn known(&self) -> (Option<WallStatus>, Option<String>) {
        let Latest { status, trouble, .. } = self.latest();
        let trouble = trouble.map(|outage| outage.reason);
        (status.filter(|_| trouble.is_none()), trouble)
    }

    pub(super) fn latest(&self) -> Latest {
        let latest = lock(&self.0).clone();
        latest.at(Instant::now())
    }
}

fn lock(shared: &Mutex<Latest>) -> MutexGuard<'_, Latest> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

fn ask(manager: &ManagerAddress, client: &mut Option<Client>) -> anyhow::Result<WallStatus> {
    let connected = match client.take() {
        Some(connected) => connected,
        None => manager.connect()?,
    };
    let status = connected.status()?;
    // Only what has answered is asked again.
    *client = Some(connected);
    Ok(status)
}

fn note(shared: &Mutex<Latest>, began: Instant, asked: anyhow::Result<WallStatus>) {
    let mut latest = lock(shared).clone().at(Instant::now());
    let asked_at = latest.asked.take().unwrap_or_else(Instant::now);
    latest.number += 1;
    match asked {
        Ok(status) => {
            if latest.trouble.take().is_some() {
                // What happened meanwhile is no rate.
                latest.rates = Rates::default();
            }
            latest.rates.add(began.elapsed().as_secs_f64(), &status);
            latest.status = Some(status);
        }
        Err(error) => {
            let begun = || Outage::begun(asked_at, String::new());
            latest.trouble.get_or_insert_with(begun).reason = one_line(&error);
        }
    }
    *lock(shared) = latest;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_manager_that_does_not_answer_for_some_seconds_hangs() {
        let asked = Instant::now();
        let latest = Latest { asked: Some(asked), ..Latest::default() };
        let almost = MANAGER_SILENCE_MAX.saturating_sub(Duration::from_millis(1));
        assert!(latest.clone().at(asked + almost).trouble.is_none());
        let hung = latest.clone().at(asked + MANAGER_SILENCE_MAX).trouble.expect("trouble");
        assert_eq!((hung.since, &*hung.reason), (asked, "it does not answer"));
        // Why it was lost before tells more.
        let trouble = Some(Outage::begun(asked, "it was killed".to_owned()));
        let lost = Latest { trouble, ..latest }.at(asked + MANAGER_SILENCE_MAX);
        assert_eq!(lost.trouble.expect("trouble").reason, "it was killed");
        let idle = Latest::default().at(asked + 2 * MANAGER_SILENCE_MAX);
        assert!(idle.trouble.is_none(), "nothing was asked");
    }
}
