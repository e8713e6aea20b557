//! Commands of the manager to a render server, on the control connection.

use std::num::NonZeroU32;

use polyptych_scene::ClipTime;
use polyptych_text::text_of_peer;
use serde::{Deserialize, Serialize};

use crate::ids::{Epoch, FrameId, Revision};
use crate::presentation::Presentation;
use crate::quality_bounds::DetailBound;
use crate::state_log::Operation;

/// One message from the manager to a render server.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[expect(clippy::large_enum_variant, reason = "one at a time, and most of them are frames")]
pub enum Command {
    /// Get ready to show a newer state.
    Prepare(Prepare),
    /// Draw this frame.
    Frame(Frame),
    /// Show a frame that was drawn.
    Swap(Swap),
    /// The answer to a [`crate::server_message::ServerMessage::Ping`].
    Pong(Pong),
    /// The manager ends the connection.
    Goodbye(Goodbye),
}

/// The reason why a manager ends a connection.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
pub enum Goodbye {
    /// A client stopped the wall. Servers show so on their displays and wait for another manager.
    #[error("a client stopped the manager")]
    Stopped,
    /// A client stopped the wall and its servers: a server that is told so ends.
    #[error("a client stopped the manager and its servers")]
    StoppedWithServers,
    /// The manager's process was asked to end, by Ctrl-C, SIGTERM or its parent. It is often
    /// started again, so displays keep their last frame.
    #[error("the manager was ended")]
    Ended,
    /// The manager goes on without this peer.
    #[error("{reason}")]
    Closed {
        /// The fault of the peer, or the peer that took its place.
        #[serde(deserialize_with = "text_of_peer")]
        reason: String,
    },
}

impl Goodbye {
    /// The goodbye to a single peer, for this reason.
    pub fn closed(reason: impl Into<String>) -> Self {
        Self::Closed { reason: reason.into() }
    }
}

/// Operations to apply; the server answers [`crate::server_message::ServerMessage::Prepared`]
/// once it could draw the new state at once.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Prepare {
    /// The epoch of the manager that the revisions belong to.
    pub epoch: Epoch,
    /// The revision that the operations begin from; `None` where they are a whole snapshot.
    pub base: Option<Revision>,
    /// The revision that they lead to.
    pub revision: Revision,
    /// The revision that frames name now. Later ones that were prepared before are named by none:
    /// they were refused, or are prepared anew.
    pub shown: Revision,
    /// In order.
    pub operations: Vec<Operation>,
}

/// A frame: all that a picture depends on, beside the state of the revision it names.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Frame {
    /// The manager's epoch.
    pub epoch: Epoch,
    /// Its number.
    pub frame: FrameId,
    /// Scene time in seconds; the only clock that a picture may depend on.
    pub time_s: f64,
    /// The state to draw.
    pub revision: Revision,
    /// The camera, the head, and how the scene is shown.
    pub presentation: Presentation,
    /// Every server sends the picture of this frame over its bulk connection, once drawn: with the
    /// mean light of squares of so many pixels along each side, 1 for all pixels. `None` if none
    /// is wanted.
    pub capture: Option<NonZeroU32>,
    /// The error up to which coarser levels of detail are drawn.
    pub detail: DetailBound,
    /// The clips that move the scene, as they stand in this frame.
    pub clips: Vec<ClipTime>,
    /// `true` if servers measure the brightness of the picture once it is shown.
    #[serde(default)]
    pub is_metered: bool,
}

/// Show the frame, unless it is too late.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Swap {
    /// The manager's epoch.
    pub epoch: Epoch,
    /// The frame that all live channels have drawn.
    pub frame: FrameId,
    /// In microseconds of manager time: a server that wakes later must not show it.
    pub not_after_us: u64,
    /// The instant at which all servers present it, in microseconds of manager time; `None`: at
    /// once.
    pub present_at_us: Option<u64>,
}

/// Three of the four timestamps from which a server estimates the manager's clock (RFC 5905 §8);
/// the fourth is the arrival of this message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Pong {
    /// The ping's own time, in the server's clock.
    pub sent_us: u64,
    /// The arrival of the ping, in manager time.
    pub received_us: u64,
    /// The departure of this message, in manager time.
    pub answered_us: u64,
}
