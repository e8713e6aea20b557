//! Bytes that went to the servers and came from them.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Counted where they pass; clones count together.
#[derive(Clone, Debug, Default)]
pub(crate) struct Traffic(Arc<Counters>);

#[derive(Debug, Default)]
struct Counters {
    control_sent: AtomicU64,
    control_received: AtomicU64,
    bulk_sent: AtomicU64,
    bulk_received: AtomicU64,
}

impl Traffic {
    pub fn control_sent(&self, bytes: usize) {
        self.0.control_sent.fetch_add(bytes as u64, Ordering::Relaxed);
    }

    pub fn control_received(&self, bytes: usize) {
        self.0.control_received.fetch_add(bytes as u64, Ordering::Relaxed);
    }

    pub fn bulk_sent(&self, bytes: usize) {
        self.0.bulk_sent.fetch_add(bytes as u64, Ordering::Relaxed);
    }

    pub fn bulk_received(&self, bytes: usize) {
        self.0.bulk_received.fetch_add(bytes as u64, Ordering::Relaxed);
    }

    /// Connection, direction and bytes so far.
    pub fn totals(&self) -> [(&'static str, &'static str, u64); 4] {
        let read = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        [
            ("control", "sent", read(&self.0.control_sent)),
            ("control", "received", read(&self.0.control_received)),
            ("bulk", "sent", read(&self.0.bulk_sent)),
            ("bulk", "received", read(&self.0.bulk_received)),
        ]
    }
}
