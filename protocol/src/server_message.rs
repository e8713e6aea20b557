//! Reports of a render server on its control connection.

use polyptych_scene::PassTimes;
use polyptych_text::text_of_peer;
use polyptych_wall::ChannelId;
use serde::{Deserialize, Serialize};

use crate::ids::{Digest, Epoch, FrameId, Revision};
use crate::luminance::FrameLuminance;
use crate::navigation::Navigation;

/// One message from a render server to the manager.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum ServerMessage {
    /// It could draw this revision at once.
    Prepared(Prepared),
    /// It cannot draw this revision.
    PrepareFailed {
        /// The manager's epoch.
        epoch: Epoch,
        /// The revision.
        revision: Revision,
        /// The reason.
        #[serde(deserialize_with = "text_of_peer")]
        reason: String,
    },
    /// A channel has drawn a frame into its own target; nothing is shown yet.
    Drawn(FrameRendered),
    /// A channel could not draw a frame.
    DrawFailed {
        /// The channel.
        channel: ChannelId,
        /// The frame.
        frame: FrameId,
        /// The reason.
        #[serde(deserialize_with = "text_of_peer")]
        reason: String,
    },
    /// A channel has shown a frame.
    Shown(FramePresented),
    /// A sign of life, and the first timestamp of a clock estimate.
    Ping(Ping),
    /// The mouse over a window moves the wall's camera.
    Navigate(Navigation),
    /// The server ends the connection, and why.
    Goodbye {
        /// For the log and the channel's status.
        #[serde(deserialize_with = "text_of_peer")]
        reason: String,
    },
    /// A channel's picture does not fit the monitor that it fills, or fits again.
    Display {
        /// The channel.
        channel: ChannelId,
        /// A sentence for the operator, which names sizes and remedy; `None` if all is well.
        #[serde(deserialize_with = "text_of_peer")]
        warning: Option<String>,
    },
    /// The server's GPU was lost with all that it had prepared. Until it is sent the shown state
    /// anew it draws nothing.
    StateLost {
        /// The failure of the GPU.
        reason: String,
    },
    /// An object store of the wall file fails, or works again. The server goes on without it.
    Storage {
        /// A sentence for the operator, which names store, reason and remedy; `None` if all is
        /// well.
        #[serde(deserialize_with = "text_of_peer")]
        warning: Option<String>,
    },
    /// The brightness of a frame that was to be metered.
    Luminance(FrameLuminance),
}

/// A revision is ready.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Prepared {
    /// The manager's epoch.
    pub epoch: Epoch,
    /// The revision.
    pub revision: Revision,
    /// The digest of the state at that revision; equal on all servers.
    pub digest: Digest,
    /// The renderer features that the scene needs.
    #[serde(deserialize_with = "text_of_peer")]
    pub features: Vec<String>,
    /// Bytes of the scene's meshes and textures on the GPU.
    pub scene_bytes: u64,
    /// `None` if all of the scene is on the GPU. Else the distance in units of the world by which
    /// each place that it is seen from may move before another part of it serves better.
    pub detail_reach: Option<f64>,
}

/// A channel has drawn a frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameRendered {
    /// The manager's epoch.
    pub epoch: Epoch,
    /// The frame.
    pub frame: FrameId,
    /// The channel.
    pub channel: ChannelId,
    /// The state that was drawn.
    pub revision: Revision,
    /// The digest of that state.
    pub digest: Digest,
    /// From the frame command's turn on the render thread to the GPU's completion.
    pub draw_us: u32,
    /// Drawn, each instance counted.
    pub triangles: u64,
    /// Calls that drew them.
    pub draw_calls: u32,
    /// The largest error of what was drawn or left out, as a fraction of the bound in force: 0 to
    /// 1, or more where the wall's budget of GPU memory holds too little detail. In pixels if the
    /// bound in force is 0.
    pub error_fraction: f32,
    /// Primitives in their places that were left out because others hide them.
    pub draws_occluded: u32,
    /// It was drawn in another way for comparison, and took longer than most for it perhaps.
    pub is_trial: bool,
    /// How long the GPU took for each pass; most frames do not tell.
    pub passes: PassTimes,
}

/// A channel has shown a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FramePresented {
    /// The manager's epoch.
    pub epoch: Epoch,
    /// The frame.
    pub frame: FrameId,
    /// The channel.
    pub channel: ChannelId,
    /// The instant of the present call, in microseconds of manager time as the server knows it.
    pub at_us: u64,
    /// The maximum error of that time: half of the best round trip that the estimate rests on.
    pub clock_error_us: u32,
    /// The swap stated an instant that had passed, or that the server could not tell since it does
    /// not know the manager's clock yet: it presented at once.
    pub is_unscheduled: bool,
}

/// A sign of life.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Ping {
    /// The server's own clock; comes back in the pong.
    pub sent_us: u64,
    /// Resident memory of the process, in bytes; 0 where the system does not tell.
    pub memory_bytes: u64,
}
