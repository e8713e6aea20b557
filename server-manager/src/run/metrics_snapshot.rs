//! The event loop's answer to a request for metrics.

use tokio::sync::mpsc;

use super::EventLoop;
use crate::metrics::{MetricsSnapshot, Queue};
use crate::session::{EVENTS_MAX, OUTBOX_MESSAGES_MAX};

impl EventLoop {
    /// The wall, the queues and the bytes so far.
    pub(super) fn metrics_snapshot(&self) -> MetricsSnapshot {
        let snapshot = self.cluster.snapshot(self.now());
        let servers = self.servers.values().map(|link| waiting_in(&link.outbox)).max();
        let clients = self.clients.values().map(|seat| waiting_in(&seat.link.outbox)).max();
        let queue = |name, length, limit| Queue { name, length, limit };
        let queues = vec![
            queue("events", waiting_in(&self.events), EVENTS_MAX),
            queue("server_outbox", servers.unwrap_or(0), OUTBOX_MESSAGES_MAX),
            queue("client_outbox", clients.unwrap_or(0), OUTBOX_MESSAGES_MAX),
            queue("orders", snapshot.orders.0, snapshot.orders.1),
            queue("changes", snapshot.changes.0, snapshot.changes.1),
        ];
        MetricsSnapshot { snapshot, queues, bytes: self.traffic.totals() }
    }
}

fn waiting_in<T>(queue: &mpsc::Sender<T>) -> usize {
    queue.max_capacity() - queue.capacity()
}
