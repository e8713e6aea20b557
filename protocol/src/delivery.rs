//! The order in which the requests of a client are begun.

use serde::{Deserialize, Serialize};

/// Maximum number of queued requests of one client that wait. Further ones are refused.
pub const QUEUED_REQUESTS_MAX: usize = 256;

/// The condition for beginning a request.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Delivery {
    /// In its turn, behind the immediate ones that the client has sent before.
    #[default]
    Immediate,
    /// Begun when no immediate request of the client waits for its turn and the previous queued
    /// request has its answer. Waiting requests are dropped when the client's connection ends.
    Queued {
        /// The highest is next; equal ones in the order in which they were sent.
        priority: u8,
    },
}
