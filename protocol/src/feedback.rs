//! Feedback to clients about frames and channels.

use std::collections::BTreeMap;
use std::fmt;

use polyptych_scene::{FramePass, NodeId, provisional_asset_index};
use polyptych_text::text_of_peer;
use serde::{Deserialize, Serialize};

use crate::device_status::DeviceStatus;
use crate::ids::{Digest, Epoch, FrameId, Revision};
use crate::leader_status::LeaderStatus;
use crate::presentation::Presentation;
use crate::progress::Opening;
use crate::quality_bounds::DrawnDetail;
pub use crate::quantiles::Quantiles;
use crate::screen_rest::RestStatus;
use crate::transaction::AssetNumbers;

/// The state of a channel.
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

impl ChannelState {
    /// The state's name, in lower case, as it stands in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Lost => "lost",
            Self::Joining => "joining",
            Self::Preparing => "preparing",
            Self::Ready => "ready",
            Self::Live => "live",
            Self::Late => "late",
        }
    }
}

impl fmt::Display for ChannelState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The displays that showed a frame; see [`FrameFeedback::shown`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Shown {
    /// Every channel of the wall.
    ByAll,
    /// At least one channel, but not every one.
    BySome,
    /// No channel of the wall.
    ByNone,
}

/// The outcome of a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameFeedback {
    /// The frame.
    pub frame: FrameId,
    /// Scene time in seconds.
    pub time_s: f64,
    /// The state that it shows.
    pub revision: Revision,
    /// From the frame command to the swap command. A frame that is sent ahead waits for the swap of
    /// the one before, too.
    pub frame_us: u64,
    /// The part of that time in which the slowest channel did not draw: network, waiting, deciding.
    pub barrier_us: u64,
    /// Times that the mouse over a window has moved the wall's camera since the manager started. A
    /// client that sets a camera of its own with every frame stops doing so once this grows.
    pub navigations: u64,
    /// The level of detail that it was drawn with.
    pub detail: DrawnDetail,
    /// One for each channel of the wall, in the wall's order.
    pub channels: Vec<ChannelFeedback>,
}

impl FrameFeedback {
    /// Returns which displays showed the frame. A frame is done even if no display showed it: a
    /// wall without servers makes frames too, which are [`Shown::ByNone`].
    pub fn shown(&self) -> Shown {
        match (self.shown_channels().next(), self.missing_channels().next()) {
            (None, _) => Shown::ByNone,
            (Some(_), None) => Shown::ByAll,
            (Some(_), Some(_)) => Shown::BySome,
        }
    }

    /// Returns whether every channel of the wall showed the frame.
    pub fn is_complete(&self) -> bool {
        self.shown() == Shown::ByAll
    }

    /// Returns the channels that showed the frame, in the wall's order.
    pub fn shown_channels(&self) -> impl Iterator<Item = &ChannelFeedback> {
        self.channels.iter().filter(|channel| channel.has_shown())
    }

    /// Returns the channels that did not show the frame, in the wall's order. Their state and
    /// reason say why.
    pub fn missing_channels(&self) -> impl Iterator<Item = &ChannelFeedback> {
        self.channels.iter().filter(|channel| !channel.has_shown())
    }
}

/// A channel's part in a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChannelFeedback {
    /// The channel's name.
    #[serde(deserialize_with = "text_of_peer")]
    pub name: String,
    /// The state at the time of the frame's swap.
    pub state: ChannelState,
    /// For how long it had been in that state.
    pub since_ms: u64,
    /// The reason why it is not live, if there is one.
    #[serde(deserialize_with = "text_of_peer")]
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
    /// The skew of its present calls, at most about a second old.
    pub skew: Skew,
}

impl ChannelFeedback {
    /// Returns whether the channel had drawn the frame when it was swapped, and so was among those
    /// that were told to show it. A channel that is lost, joining or preparing cannot; one that is
    /// late may show the frame after the others.
    pub fn has_shown(&self) -> bool {
        self.draw_us.is_some() && matches!(self.state, ChannelState::Live | ChannelState::Late)
    }
}

/// The delay of a channel's present calls after those of the first channel of the same frame, over
/// the wall's last frames; in microseconds of manager time.
///
/// *Present-call skew*: a display may show a frame up to one refresh later. Each value rests on two
/// estimates of the manager's clock, so that it may be off by both of their errors.
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
    /// The maximum error of the server's estimate of the manager's clock; `None` before the first
    /// present call that it has dated.
    pub clock_error_us: Option<u32>,
}

/// The wall as it stands.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WallStatus {
    /// The wall's name.
    #[serde(deserialize_with = "text_of_peer")]
    pub wall: String,
    /// This life of the manager.
    pub epoch: Epoch,
    /// Changes so far.
    pub revision: Revision,
    /// The digest of the state at that revision.
    pub digest: Digest,
    /// The last frame that was swapped.
    pub frame: FrameId,
    /// The open scene's name.
    #[serde(deserialize_with = "text_of_peer")]
    pub scene: Option<String>,
    /// Present length of the frame deadline.
    pub deadline_ms: f64,
    /// The error bound of the next frame in pixels of the wall: the one that is asked for, or what
    /// the rate bound makes of it.
    pub error_in_force_px: f64,
    /// The presentation of the next frame.
    pub presentation: Presentation,
    /// One for each channel of the wall, in the wall's order.
    pub channels: Vec<ChannelStatus>,
    /// Connected clients, by name.
    #[serde(deserialize_with = "text_of_peer")]
    pub clients: Vec<String>,
    /// Warnings for a person, such as adapters that differ.
    #[serde(deserialize_with = "text_of_peer")]
    pub warnings: Vec<String>,
    /// Parts of the open scene that are not drawn, or not as its file has them; see
    /// [`polyptych_scene::Scene::notes`].
    #[serde(deserialize_with = "text_of_peer")]
    pub notes: Vec<String>,
    /// Scenes that are being opened, the oldest request first.
    pub opening: Vec<Opening>,
    /// Resident memory of the manager, in bytes; 0 if its system does not tell.
    pub memory_bytes: u64,
    /// The pixels along each side that the next frame is drawn with, as a share of the wall's: 0.25
    /// to 1, and 1 without a rate bound.
    pub resolution_scale: f64,
    /// The name of what surrounds scenes, if not their own sky.
    #[serde(default)]
    #[serde(deserialize_with = "text_of_peer")]
    pub environment: Option<String>,
    /// The rules by which displays go dark by themselves, and whether they are.
    #[serde(default)]
    pub rest: RestStatus,
    /// The trackers, wands and pads of the wall file, in its order.
    #[serde(default)]
    pub devices: Vec<DeviceStatus>,
    /// The manager that answers, if several share the wall.
    #[serde(default)]
    pub leader: Option<LeaderStatus>,
}

/// A channel as it stands.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChannelStatus {
    /// The channel's name.
    #[serde(deserialize_with = "text_of_peer")]
    pub name: String,
    /// The channel's state.
    pub state: ChannelState,
    /// The time that it has been in that state.
    pub since_ms: u64,
    /// The reason for the state, if there is one.
    #[serde(deserialize_with = "text_of_peer")]
    pub reason: Option<String>,
    /// The server's process id.
    pub pid: Option<u32>,
    /// The server's address.
    #[serde(deserialize_with = "text_of_peer")]
    pub address: Option<String>,
    /// The name of the server's graphics adapter.
    #[serde(deserialize_with = "text_of_peer")]
    pub adapter: Option<String>,
    /// The last frame that it showed.
    pub frame: FrameId,
    /// The revision that it is ready for.
    pub revision: Revision,
    /// Times that it missed a deadline.
    pub late: u64,
    /// Its drawing time of the last frame that it drew in time, in microseconds.
    pub draw_us: Option<u32>,
    /// The skew of its present calls.
    pub skew: Skew,
    /// Resident memory of its server's process, in bytes.
    pub memory_bytes: u64,
    /// Textures and meshes of the scene that its server holds on the GPU, in bytes.
    pub scene_bytes: u64,
}

/// Measurements of the frames since the statistics were last reset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Statistics {
    /// Frames swapped.
    pub frames: u64,
    /// Frames that every channel of the wall had drawn when they were swapped: those that all
    /// displays show together.
    pub complete: u64,
    /// Frames that were sent while another one was on its way: none without a pipeline.
    pub ahead: u64,
    /// From the beginning of the first frame to the swap of the last one.
    pub seconds: f64,
    /// From frame command to swap command, in milliseconds; of frames whose deadline passed, that
    /// long. Frames that waited for no channel are left out.
    pub frame_ms: Quantiles,
    /// The slowest waited-for channel's own drawing time, in milliseconds, of frames that at least
    /// one of these had drawn when they were swapped.
    pub draw_ms: Quantiles,
    /// The part of a frame in which the slowest channel did not draw, in microseconds.
    pub barrier_us: Quantiles,
    /// From the first to the last channel's present call of a frame, in microseconds.
    pub swap_skew_us: Quantiles,
    /// Deadlines missed, over all channels.
    pub late: u64,
    /// Triangles of the last frame, over all channels.
    pub triangles: u64,
    /// Draw calls of the last frame, over all channels.
    pub draw_calls: u64,
    /// The sum of those of all channels.
    pub draws_occluded: u64,
    /// The error bound that is asked for, in pixels of the wall.
    pub error_bound_px: f64,
    /// The error bounds in force, in pixels of the wall.
    pub error_in_force_px: Quantiles,
    /// The largest error of what any channel drew or left out, in pixels of the wall.
    pub largest_error_px: f64,
    /// Bytes of the scene's meshes and textures on the GPU of the server that has most of them.
    pub gpu_bytes: u64,
    /// The channel that limited most frames: see [`DrawnDetail::limiting_channel`].
    #[serde(deserialize_with = "text_of_peer")]
    pub limiting_channel: Option<String>,
    /// Control bytes in both directions for one frame, over all channels.
    pub bytes_per_frame: f64,
    /// The renderer features that the open scene needs.
    #[serde(deserialize_with = "text_of_peer")]
    pub features: Vec<String>,
    /// One for each channel of the wall, in the wall's order.
    pub channels: Vec<ChannelStatistics>,
    /// The pixels that were drawn along each side, as a share of the wall's.
    pub resolution_scale: ResolutionScales,
}

/// The resolutions of frames, as shares of the wall's pixels along each side: 0.25 to 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ResolutionScales {
    /// Half of the frames had this one or less.
    pub p50: f64,
    /// The lowest one.
    pub min: f64,
}

impl ResolutionScales {
    /// All of the wall's pixels in every frame.
    pub const FULL: Self = Self { p50: 1.0, min: 1.0 };
}

/// Measurements of the frames on one channel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChannelStatistics {
    /// The channel's name.
    #[serde(deserialize_with = "text_of_peer")]
    pub name: String,
    /// The state at the time of the request.
    pub state: ChannelState,
    /// Frames shown.
    pub frames: u64,
    /// From frame command to the arrival of its report, in milliseconds; late reports too.
    pub frame_ms: Quantiles,
    /// Its own drawing time, in milliseconds.
    pub draw_ms: Quantiles,
    /// Its present call after the first channel's of the same frame, in microseconds.
    pub swap_skew_us: Quantiles,
    /// The maximum error of its clock estimate, in microseconds.
    pub clock_error_us: u32,
    /// The longest time between two shown frames.
    pub longest_gap_ms: f64,
    /// Frames that it did not present at the instant that their swap stated: this had passed, or
    /// its server did not know the manager's clock yet.
    pub unscheduled: u64,
    /// Deadlines missed.
    pub late: u64,
    /// Triangles of its last frame.
    pub triangles: u64,
    /// Draw calls of its last frame.
    pub draw_calls: u64,
    /// The most primitives in their places that it left out of a frame because others hide them. It
    /// does so where that makes frames faster, which it tries now and then.
    pub draws_occluded: u64,
    /// The mean microseconds that its server's GPU takes for each pass of a frame, by the frames
    /// that were measured: one in eight. Empty where none was, or the adapter has no timestamps.
    pub passes_us: BTreeMap<FramePass, u64>,
    /// The name of its server's graphics adapter.
    #[serde(deserialize_with = "text_of_peer")]
    pub adapter: Option<String>,
    /// Resident memory of its server's process, in bytes.
    pub memory_bytes: u64,
}

/// The outcome of a tuning.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tuned {
    /// The state that has it.
    pub revision: Revision,
    /// Frames that were begun from the request to the first one with it, that one among them.
    pub frames: u64,
    /// The outcome of the first frame with it: the displays that show it, and those that do not.
    pub feedback: FrameFeedback,
}

/// The outcome of a transaction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Edited {
    /// The state that has it.
    pub revision: Revision,
    /// The nodes that it made, in the order of their creations.
    pub created: Vec<NodeId>,
    /// The numbers of the assets that it brought, if it did.
    pub assets: Option<AssetNumbers>,
    /// Frames that were begun from the request to the first one with it, that one among them.
    pub frames: u64,
    /// The outcome of the first frame with it: the displays that show it, and those that do not.
    pub feedback: FrameFeedback,
    /// Parts of the file of its assets that are not drawn, or not as there; see
    /// [`polyptych_scene::Scene::notes`].
    #[serde(deserialize_with = "text_of_peer")]
    pub notes: Vec<String>,
}

impl Edited {
    /// The node that a provisional number of the transaction stands for, or the node itself.
    pub fn node(&self, node: NodeId) -> Option<NodeId> {
        let Some(index) = node.provisional_index() else { return Some(node) };
        usize::try_from(index).ok().and_then(|index| self.created.get(index)).copied()
    }

    /// The number of the mesh that a provisional one of the transaction stands for, or the mesh
    /// itself.
    pub fn mesh(&self, mesh: u32) -> Option<u32> {
        let Some(index) = provisional_asset_index(mesh) else { return Some(mesh) };
        self.assets.map(|numbers| numbers.first_mesh + index)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn feedback(channels: &[(ChannelState, Option<u32>)]) -> FrameFeedback {
        let channel = |(state, draw_us): &(ChannelState, Option<u32>)| ChannelFeedback {
            name: format!("{state}-{}", draw_us.is_some()),
            state: *state,
            since_ms: 1,
            reason: None,
            shown_at_us: None,
            draw_us: *draw_us,
            triangles: 0,
            draw_calls: 0,
            skew: Skew::default(),
        };
        FrameFeedback {
            frame: FrameId(1),
            time_s: 0.0,
            revision: Revision(1),
            frame_us: 1,
            barrier_us: 0,
            navigations: 0,
            detail: DrawnDetail::default(),
            channels: channels.iter().map(channel).collect(),
        }
    }

    #[test]
    fn a_frame_counts_as_shown_only_where_it_was_drawn_by_a_channel_that_takes_part() {
        use ChannelState::{Joining, Late, Live, Lost, Preparing};
        for (channels, shown) in [
            (&[(Live, Some(1)), (Live, Some(2))][..], Shown::ByAll),
            // Drawn in time by one that is catching up.
            (&[(Live, Some(1)), (Late, Some(2))], Shown::ByAll),
            (&[(Live, Some(1)), (Late, None)], Shown::BySome),
            (&[(Live, Some(1)), (Lost, None)], Shown::BySome),
            // It had drawn, and was gone before the swap.
            (&[(Live, Some(1)), (Lost, Some(1))], Shown::BySome),
            (&[(Joining, None), (Preparing, Some(1))], Shown::ByNone),
            (&[], Shown::ByNone),
        ] {
            let feedback = feedback(channels);
            assert_eq!(feedback.shown(), shown, "{channels:?}");
            assert_eq!(feedback.is_complete(), shown == Shown::ByAll, "{channels:?}");
            let split = (feedback.shown_channels().count(), feedback.missing_channels().count());
            assert_eq!(split.0 + split.1, channels.len(), "{channels:?}");
        }
        let some = feedback(&[(Live, Some(1)), (Lost, None)]);
        assert_eq!(some.missing_channels().map(|c| c.name.as_str()).next(), Some("lost-false"));
    }
}
