//! Where the watched status comes from: a thread that asks, and connects again for ever.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use polyptych_client::WallStatus;
use polyptych_client::blocking::Client;

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
}

/// Since when there is no answer, and why.
#[derive(Clone, Debug)]
pub(super) struct Outage {
    since: Instant,
    since_utc_s: u64,
    pub reason: String,
}

impl Latest {
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
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
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
    let mut latest = shared.lock().unwrap_or_else(PoisonError::into_inner);
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
            let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
            let gone = latest.trouble.get_or_insert_with(|| Outage {
                since: Instant::now(),
                since_utc_s: since_1970.as_secs(),
                reason: String::new(),
            });
            gone.reason = one_line(&error);
        }
    }
}
