//! The pace of a wall that draws by itself.

use serde::{Deserialize, Serialize};

/// The rate at which the wall draws by itself.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Pacing {
    /// The rate of the slowest live channel.
    Free,
    /// This number of frames per second, if the wall can.
    Rate(f64),
}
