//! A snapshot of the core, for its observers.

use polyptych_protocol::feedback::WallStatus;

use super::change::CHANGES_MAX;
use super::counters::Counters;
use super::{Cluster, FRAME_ORDERS_MAX, Micros};

/// The wall as it stands, and its totals.
#[derive(Clone, Debug, PartialEq)]
pub struct Snapshot {
    /// The status in the form that clients get.
    pub status: WallStatus,
    /// Since the manager started.
    pub totals: Counters,
    /// Times that each channel lost its server, in the wall's order.
    pub lost: Vec<u64>,
    /// Connected servers by name, and the resident memory of each in bytes.
    pub servers: Vec<(String, u64)>,
    /// Frames that the busiest client waits for, and the most that one may.
    pub orders: (usize, usize),
    /// Changes of the scene that wait for their turn, and the most that may.
    pub changes: (usize, usize),
}

impl Cluster {
    /// For one who watches: some microseconds of copying, so not for every frame.
    pub fn snapshot(&self, now: Micros) -> Snapshot {
        let orders_of = |client| self.orders.iter().filter(|o| o.job.client == client).count();
        Snapshot {
            status: self.status(now),
            totals: self.gathered.totals().clone(),
            lost: self.registry.channels().map(|(_, channel)| channel.lost).collect(),
            servers: self
                .registry
                .servers()
                .map(|(_, server)| (server.name.clone(), server.memory_bytes))
                .collect(),
            orders: (
                self.clients.keys().map(|&client| orders_of(client)).max().unwrap_or(0),
                FRAME_ORDERS_MAX,
            ),
            changes: (self.changes.waiting(), CHANGES_MAX),
        }
    }
}
