//! The state of trackers, wands and pads.

use polyptych_text::text_of_peer;
use serde::{Deserialize, Serialize};

use crate::feedback::Quantiles;

/// A device of the wall file as it stands, as its bridge reports it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DeviceStatus {
    /// The device's name in the wall file.
    #[serde(deserialize_with = "text_of_peer")]
    pub name: String,
    /// The state of its readings.
    pub state: DeviceState,
    /// The time for which it has been in that state, in milliseconds.
    pub since_ms: u64,
    /// The reason for its state, if it is not live.
    #[serde(deserialize_with = "text_of_peer")]
    pub reason: Option<String>,
    /// Readings in the last second.
    pub rate_hz: f64,
    /// Readings that were ignored because they are damaged, out of order or out of range.
    pub refused: u64,
    /// Time from the arrival of a reading to the swap of the first frame that uses it, in
    /// milliseconds, of the last readings that moved the head. It includes the way of that frame's
    /// feedback back to the bridge.
    pub latency_ms: Quantiles,
}

/// The state of a device's readings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DeviceState {
    /// No reading has come yet.
    Waiting,
    /// Readings come.
    Live,
    /// Readings came, and come no more.
    Lost,
}

impl DeviceState {
    /// Returns the state's name, in lower case, as it stands in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Waiting => "waiting",
            Self::Live => "live",
            Self::Lost => "lost",
        }
    }
}

impl DeviceStatus {
    /// A device of this name of which no reading has come, for this reason.
    pub fn waiting(name: &str, reason: &str) -> Self {
        Self {
            name: name.to_owned(),
            state: DeviceState::Waiting,
            since_ms: 0,
            reason: Some(reason.to_owned()),
            rate_hz: 0.0,
            refused: 0,
            latency_ms: Quantiles::default(),
        }
    }
}
