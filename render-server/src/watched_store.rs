//! An object store and how it has behaved: one that fails is told once, and left alone for a while.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use bytes::Bytes;
use polyptych_files::blob::{BLOB_BYTES_MAX, BlobHash};
use polyptych_object_store::{FaultKind, RemoteStore, StoreFault};

/// First and longest time for which a store that failed is not asked: a preparation of a thousand
/// blobs meets a dead store once, and one that was restarted is found again within minutes.
const STORE_RETRY_FIRST: Duration = Duration::from_secs(5);
const STORE_RETRY_LONGEST: Duration = Duration::from_mins(5);

/// Damaged objects in a row after which the whole store is taken to be damaged.
const DAMAGED_MAX: u32 = 8;

/// Whole objects in a row, after a damaged one was told, which end its warning: the store was
/// mended, or the object is not asked for any more.
const WHOLE_MIN: u32 = 8;

/// The outcome of asking stores.
#[derive(Debug)]
pub(crate) enum Fetched {
    /// The blob, checked.
    Blob(Bytes),
    /// It is larger than was allowed before its turn.
    TooLarge,
    /// No store has it, or works.
    Nowhere,
}

/// A store, or the reason why it can never be asked.
#[derive(Debug)]
pub(crate) struct WatchedStore {
    store: Option<RemoteStore>,
    health: Mutex<Health>,
}

/// The behaviour of a store so far.
#[derive(Debug, Default)]
struct Health {
    /// Failures since it last gave an answer.
    failures: u32,
    /// The time from which it may be asked again, if it failed.
    retry_at: Option<Instant>,
    /// Damaged objects since the last whole one.
    damaged: u32,
    /// Whole objects since the last damaged one and since it was told, up to [`WHOLE_MIN`].
    whole: u32,
    /// `true` if the damage was told.
    is_told: bool,
    /// Why it is not asked.
    unusable: Option<String>,
    /// The first damaged object.
    damage: Option<String>,
}

impl WatchedStore {
    /// A store that was not asked yet.
    pub fn of(store: RemoteStore) -> Self {
        Self { store: Some(store), health: Mutex::default() }
    }

    /// A store that can't be asked, which is logged.
    pub fn unusable(reason: &str) -> Self {
        tracing::warn!(reason, "an object store is not used");
        let health = Health { unusable: Some(reason.to_owned()), ..Health::default() };
        Self { store: None, health: Mutex::new(health) }
    }

    fn health(&self) -> MutexGuard<'_, Health> {
        self.health.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns whether the store may be asked now.
    pub fn is_usable(&self) -> bool {
        let now = Instant::now();
        self.store.is_some() && self.health().retry_at.is_none_or(|at| at <= now)
    }

    /// Tells what an operator should know of the store, if anything.
    pub fn tell_warning(&self) -> Option<String> {
        let mut health = self.health();
        let warning = health.unusable.clone().or_else(|| health.damage.clone());
        if health.damage.is_some() && !health.is_told {
            (health.is_told, health.whole) = (true, 0);
        }
        warning
    }

    /// Asks the store for a blob of at most `bytes_max` bytes, if it may be asked now.
    pub async fn fetch(&self, hash: BlobHash, bytes_max: u64) -> Fetched {
        let Some(store) = self.store.as_ref().filter(|_| self.is_usable()) else {
            return Fetched::Nowhere;
        };
        match store.fetch(hash, bytes_max).await {
            Ok(found) => {
                self.note_answer(store, found.is_some());
                found.map_or(Fetched::Nowhere, Fetched::Blob)
            }
            Err(fault) if fault.kind == FaultKind::TooLarge && bytes_max < BLOB_BYTES_MAX => {
                Fetched::TooLarge
            }
            Err(fault) => {
                self.note_fault(&fault);
                Fetched::Nowhere
            }
        }
    }

    fn note_answer(&self, store: &RemoteStore, is_whole: bool) {
        let works_again = self.health().note_answer(is_whole);
        if works_again {
            tracing::info!(store = %store.url(), "the object store works again");
        }
    }

    fn note_fault(&self, fault: &StoreFault) {
        let mut health = self.health();
        let is_new = if fault.kind == FaultKind::Unusable {
            // Others that were under way fail for the same reason.
            if health.retry_at.is_some_and(|at| at > Instant::now()) {
                return;
            }
            health.rest();
            health.unusable.replace(fault.to_string()).is_none()
        } else {
            (health.damaged, health.whole, health.is_told) = (health.damaged + 1, 0, false);
            if health.damaged >= DAMAGED_MAX {
                health.damaged = 0;
                health.rest();
            }
            let is_first = health.damage.is_none();
            health.damage.get_or_insert_with(|| fault.to_string());
            is_first
        };
        drop(health);
        let StoreFault { url: store, reason, fix, .. } = fault;
        if is_new {
            tracing::warn!(%store, reason, fix, "blobs come from elsewhere than this object store");
        } else {
            tracing::debug!(%store, reason, "the object store fails still");
        }
    }
}

impl Health {
    /// Counts an answer: a whole object, or none of this name. Returns whether there is no warning
    /// any more.
    fn note_answer(&mut self, is_whole: bool) -> bool {
        if is_whole {
            self.damaged = 0;
            self.whole = (self.whole + 1).min(WHOLE_MIN);
        }
        self.retry_at = None;
        self.failures = 0;
        let is_over = self.is_told && self.whole == WHOLE_MIN;
        let is_mended = is_over && self.damage.take().is_some();
        self.unusable.take().is_some() || is_mended
    }

    /// Leaves the store alone, longer after each failure.
    fn rest(&mut self) {
        let wait = STORE_RETRY_FIRST * 2u32.pow(self.failures.min(8));
        self.failures += 1;
        self.retry_at = Some(Instant::now() + wait.min(STORE_RETRY_LONGEST));
    }
}

#[cfg(test)]
mod tests {
    use polyptych_files::blob::StoreUrl;

    use super::*;

    #[test]
    fn a_store_that_gives_whole_objects_again_has_no_warning_any_more() {
        let watched = WatchedStore { store: None, health: Mutex::default() };
        let url = StoreUrl::from_text("http://127.0.0.1:1/blobs").expect("a URL");
        let url = url.expect("of a store");
        let damaged = || StoreFault {
            url: url.clone(),
            kind: FaultKind::DamagedBlob,
            reason: "blob aa has other bytes than its name says".to_owned(),
            fix: "upload it again".to_owned(),
        };
        watched.note_fault(&damaged());
        for _ in 0..2 * WHOLE_MIN {
            assert!(!watched.health().note_answer(true), "nobody was told yet");
        }
        assert!(watched.tell_warning().is_some_and(|warning| warning.contains("other bytes")));
        for _ in 1..WHOLE_MIN {
            assert!(!watched.health().note_answer(true));
        }
        watched.note_fault(&damaged());
        for answers in 1..WHOLE_MIN {
            assert!(watched.tell_warning().is_some(), "after {answers} answers");
            // That it has no object of some name says nothing of the others.
            assert!(!watched.health().note_answer(false));
            assert!(!watched.health().note_answer(true));
        }
        assert!(watched.health().note_answer(true));
        assert_eq!(watched.tell_warning(), None);
        watched.note_fault(&damaged());
        assert!(watched.tell_warning().is_some(), "another one is news");
    }
}
