//! What clients learn of frames and channels.

use serde::{Deserialize, Serialize};

use crate::display::DisplayMode;
use crate::ids::{Digest, Epoch, FrameId, Revision};
use crate::pattern::Pattern;

/// Where a channel stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ChannelState {
    /// No server drives it.
    Lost,
    /// A server has claimed it and has not been told the state yet.
    Joining,
    /// Its server gets ready to draw the present revision.
    Preparing,
    /// It could draw; the next frame takes it in.
    Ready,
    /// Frames wait for it.
    Live,
    /// It missed a deadline; frames don't wait for it until it has caught up.
    Late,
}

/// What a frame became.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Feedback {
    /// The frame.
    pub frame: FrameId,
    /// Scene time in seconds.
    pub time_s: f64,
    /// The state that it shows.
    pub revision: Revision,
    /// From the frame command to the swap command.
    pub frame_us: u64,
    /// What of that the slowest channel did not draw: network, waiting, deciding.
    pub barrier_us: u64,
    /// One for each channel of the wall, in the wall's order.
    pub channels: Vec<ChannelFeedback>,
}

/// What a channel did for a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChannelFeedback {
    /// The channel's name.
    pub name: String,
    /// When the frame was swapped.
    pub state: ChannelState,
    /// For how long it had been in that state.
    pub since_ms: u64,
    /// Why it is not live, where there is a reason.
    pub reason: Option<String>,
    /// The last present call that is known, in microseconds of manager time: that of an earlier
    /// frame, since nobody waits for it.
    pub shown_at_us: Option<u64>,
    /// Its own drawing time; `None` where it had not drawn when the frame was swapped.
    pub draw_us: Option<u32>,
    /// Each instance counted.
    pub triangles: u64,
    /// Calls that drew them.
    pub draw_calls: u32,
    /// Of its present calls, as it was about a second ago at most.
    pub skew: Skew,
}

/// How far the present calls of a channel lie behind those of the first channel of the same
/// frame, over the wall's last frames; in microseconds of manager time.
///
/// *Present-call skew*: a display may show a frame up to one refresh later. Two estimates of the
/// manager's clock stand behind a number, so that it may be off by both of their errors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Skew {
    /// Frames that were compared.
    pub frames: u32,
    /// Half are below.
    pub p50_us: u32,
    /// 99 of 100 are below.
    pub p99_us: u32,
    /// The largest.
    pub max_us: u32,
    /// How far off the server's estimate of the manager's clock may be; `None` before the first
    /// present call that it has dated.
    pub clock_error_us: Option<u32>,
}

/// The wall as it stands.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WallStatus {
    /// The wall's name.
    pub wall: String,
    /// This life of the manager.
    pub epoch: Epoch,
    /// Changes so far.
    pub revision: Revision,
    /// Of the state at that revision.
    pub digest: Digest,
    /// The last frame that was swapped.
    pub frame: FrameId,
    /// The open scene's name.
    pub scene: Option<String>,
    /// Present length of the frame deadline.
    pub deadline_ms: f64,
    /// What all displays show.
    pub displays: DisplayMode,
    /// What channels draw instead of the scene.
    pub pattern: Option<Pattern>,
    /// One for each channel of the wall, in the wall's order.
    pub channels: Vec<ChannelStatus>,
    /// Connected clients, by name.
    pub clients: Vec<String>,
    /// What a person should know, such as adapters that differ.
    pub warnings: Vec<String>,
}

/// A channel as it stands.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChannelStatus {
    /// The channel's name.
    pub name: String,
    /// Where it stands.
    pub state: ChannelState,
    /// For how long.
    pub since_ms: u64,
    /// Why, where there is a reason.
    pub reason: Option<String>,
    /// The server's process id.
    pub pid: Option<u32>,
    /// The server's address.
    pub address: Option<String>,
    /// What the server draws with.
    pub adapter: Option<String>,
    /// The last frame that it showed.
    pub frame: FrameId,
    /// The revision that it is ready for.
    pub revision: Revision,
    /// Times that it missed a deadline.
    pub late: u64,
    /// Its drawing time of the last frame that it drew in time, in microseconds.
    pub draw_us: Option<u32>,
    /// Of its present calls.
    pub skew: Skew,
    /// Resident memory of its server's process, in bytes.
    pub memory_bytes: u64,
}

/// What the frames took since the statistics were last reset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Statistics {
    /// Frames swapped.
    pub frames: u64,
    /// From the first to the last swap.
    pub seconds: f64,
    /// From frame command to swap command, in milliseconds.
    pub frame_ms: Spread,
    /// The slowest waited-for channel's own drawing time, in milliseconds.
    pub draw_ms: Spread,
    /// What of a frame the slowest channel did not draw, in microseconds.
    pub barrier_us: Spread,
    /// From the first to the last channel's present call of a frame, in microseconds.
    pub swap_skew_us: Spread,
    /// Deadlines missed, over all channels.
    pub late: u64,
    /// Of the last frame, over all channels.
    pub triangles: u64,
    /// Of the last frame, over all channels.
    pub draw_calls: u64,
    /// Control bytes in both directions for one frame, over all channels.
    pub bytes_per_frame: f64,
    /// What the open scene needs of the renderer.
    pub features: Vec<String>,
    /// One for each channel of the wall, in the wall's order.
    pub channels: Vec<ChannelStatistics>,
}

/// What the frames took on one channel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChannelStatistics {
    /// The channel's name.
    pub name: String,
    /// At the time of asking.
    pub state: ChannelState,
    /// Frames shown.
    pub frames: u64,
    /// From frame command to the arrival of its report, in milliseconds.
    pub frame_ms: Spread,
    /// Its own drawing time, in milliseconds.
    pub draw_ms: Spread,
    /// Its present call after the first channel's of the same frame, in microseconds.
    pub swap_skew_us: Spread,
    /// How far off its clock estimate may be, in microseconds.
    pub clock_error_us: u32,
    /// The longest time between two shown frames.
    pub longest_gap_ms: f64,
    /// Deadlines missed.
    pub late: u64,
    /// Of its last frame.
    pub triangles: u64,
    /// Of its last frame.
    pub draw_calls: u64,
    /// What its server draws with.
    pub adapter: Option<String>,
    /// Resident memory of its server's process, in bytes.
    pub memory_bytes: u64,
}

/// Where a set of measurements lies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// How many.
    pub count: u64,
    /// Half are below.
    pub p50: f64,
    /// 95 of 100 are below.
    pub p95: f64,
    /// 99 of 100 are below.
    pub p99: f64,
    /// The largest.
    pub max: f64,
}

impl Spread {
    /// Where these values lie: the quantile q is the least value that q of all do not exceed.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Self {
        let mut sorted: Vec<f64> = values.into_iter().collect();
        sorted.sort_by(f64::total_cmp);
        let at = |share: f64| {
            let rank = (share * sorted.len() as f64).ceil() as usize;
            sorted.get(rank.saturating_sub(1)).copied().unwrap_or(0.0)
        };
        let (count, max) = (sorted.len() as u64, sorted.last().copied().unwrap_or(0.0));
        Self { count, p50: at(0.5), p95: at(0.95), p99: at(0.99), max }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_values_that_were_measured() {
        let spread = Spread::of((1..=100).rev().map(f64::from));
        let expected = Spread { count: 100, p50: 50.0, p95: 95.0, p99: 99.0, max: 100.0 };
        assert_eq!(spread, expected);
        assert_eq!(Spread::of([]), Spread::default());
        assert_eq!(Spread::of([7.0]).p50, 7.0);
    }
}
