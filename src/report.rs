//! `report.json`: what a simulated wall did.

use polyptych_client::{ChannelStatistics, Spread, Statistics};
use serde::Serialize;

/// The whole report. Times say their unit; spreads are over the frames of the run.
#[derive(Debug, Serialize)]
pub(crate) struct Report {
    /// The wall's name.
    pub wall: String,
    /// The scene's name.
    pub scene: String,
    /// Frames swapped.
    pub frames: u64,
    /// From the first to the last swap.
    pub seconds: f64,
    /// From the frame command to the swap command.
    pub frame_ms: Spread,
    /// The slowest channel's own drawing time.
    pub draw_ms: Spread,
    /// What of a frame the slowest channel did not draw.
    pub barrier_us: Spread,
    /// From the first to the last channel's present call of a frame.
    pub swap_skew_us: Spread,
    /// Deadlines missed, over all channels.
    pub late: u64,
    /// Of the last frame, over all channels.
    pub triangles: u64,
    /// Of the last frame, over all channels.
    pub draw_calls: u64,
    /// Control bytes in both directions for one frame, over all channels.
    pub bytes_per_frame: f64,
    /// What the channels were drawn with, each adapter once.
    pub adapter: String,
    /// What the scene needed of the renderer.
    pub features: Vec<String>,
    /// Times that a server was started again.
    pub restarts: u64,
    /// Channels of which the last picture is missing, with the reason.
    pub missing: Vec<(String, String)>,
    /// One for each channel, in the wall's order.
    pub channels: Vec<ChannelStatistics>,
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
            frames: statistics.frames,
            seconds: statistics.seconds,
            frame_ms: statistics.frame_ms,
            draw_ms: statistics.draw_ms,
            barrier_us: statistics.barrier_us,
            swap_skew_us: statistics.swap_skew_us,
            late: statistics.late,
            triangles: statistics.triangles,
            draw_calls: statistics.draw_calls,
            bytes_per_frame: statistics.wire_bytes_per_frame,
            adapter: adapters.join(", "),
            features: statistics.features,
            restarts: 0,
            missing: Vec::new(),
            channels: statistics.channels,
        }
    }
}
