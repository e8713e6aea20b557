//! The manager that leads a wall which several managers share.

use polyptych_text::text_of_peer;
use serde::{Deserialize, Serialize};

use crate::ids::Term;

/// The manager that leads, as its lease has it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LeaderStatus {
    /// The number of times that the lease was taken, up to this manager.
    pub term: Term,
    /// The manager's address, process and machine, for people.
    #[serde(deserialize_with = "text_of_peer")]
    pub holder: String,
}
