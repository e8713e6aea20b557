//! `report.json`: what a simulated wall did.

use polyptych_client::Statistics;
use serde::Serialize;

/// The whole report. Times say their unit; spreads are over the frames of the run.
#[derive(Debug, Serialize)]
pub(crate) struct Report {
    /// The wall's name.
    pub wall: String,
    /// The scene's name.
    pub scene: String,
    /// What the channels were drawn with, each adapter once.
    pub adapter: String,
    /// Times that a server was started again.
    pub restarts: u64,
    /// Channels of which the last picture is missing, with the reason.
    pub missing: Vec<(String, String)>,
    /// What the manager measured, for the wall and for each channel.
    #[serde(flatten)]
    pub statistics: Statistics,
}

impl Report {
    pub fn new(wall: &str, scene: &str, statistics: Statistics) -> Self {
        let mut adapters: Vec<String> = Vec::new();
        for adapter in statistics.channels.iter().filter_map(|c| c.adapter.clone()) {
            if !adapters.contains(&adapter) {
                adapters.push(adapter);
            }
        }
        Self {
            wall: wall.to_owned(),
            scene: scene.to_owned(),
            adapter: adapters.join(", "),
            restarts: 0,
            missing: Vec::new(),
            statistics,
        }
    }
}
