//! When a request is begun, beside the others of its client.

use serde::{Deserialize, Serialize};

/// Maximum number of queued requests of one client that wait. Further ones are refused.
pub const QUEUED_REQUESTS_MAX: usize = 256;

/// When a request is begun.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Delivery {
    /// In its turn, behind the immediate ones that the client has sent before.
    #[default]
    Immediate,
    /// When no immediate request of the client waits for its turn, and the queued one before it
    /// has its answer. Those that wait are dropped when the client's connection ends.
    Queued {
        /// The highest is next; equal ones in the order in which they were sent.
        priority: u8,
    },
}
