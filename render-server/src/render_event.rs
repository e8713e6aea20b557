//! The results of drawing, as messages for the manager.

use bytes::Bytes;
use polyptych_protocol::command::Frame;
use polyptych_protocol::ids::{Epoch, FrameId};
use polyptych_protocol::luminance::FrameLuminance;
use polyptych_protocol::server_message::{FramePresented, FrameRendered, ServerMessage};
use polyptych_renderer::DrawStats;
use polyptych_wall::ChannelId;

use crate::clock::Clock;
use crate::loader::LoadedState;

/// A picture that goes to the manager over the bulk connection: sRGB RGBA8, rows from the top.
#[derive(Clone, Debug)]
pub(crate) struct CapturedImage {
    pub channel: ChannelId,
    pub frame: FrameId,
    pub width: u32,
    pub height: u32,
    pub bytes: Bytes,
}

/// A message of the render thread to the network thread.
#[derive(Debug)]
pub(crate) enum RenderEvent {
    Status(ServerMessage),
    Picture(CapturedImage),
}

pub(crate) fn drawn(
    frame: &Frame,
    channel: ChannelId,
    state: &LoadedState,
    stats: &DrawStats,
    draw_us: u64,
) -> RenderEvent {
    RenderEvent::Status(ServerMessage::Drawn(FrameRendered {
        epoch: frame.epoch,
        frame: frame.frame,
        channel,
        revision: state.replica.revision,
        digest: state.digest,
        draw_us: u32::try_from(draw_us).unwrap_or(u32::MAX),
        triangles: stats.triangles,
        draw_calls: stats.draw_calls,
        error_fraction: stats.error_share,
        draws_occluded: stats.occluded,
        is_trial: stats.is_trial,
        passes: stats.passes,
    }))
}

pub(crate) fn shown(
    epoch: Epoch,
    frame: FrameId,
    channel: ChannelId,
    clock: &Clock,
    is_unscheduled: bool,
) -> RenderEvent {
    RenderEvent::Status(ServerMessage::Shown(FramePresented {
        epoch,
        frame,
        channel,
        at_us: clock.manager_us(),
        clock_error_us: clock.error_us(),
        is_unscheduled,
    }))
}

pub(crate) fn luminance(frame: &Frame, channel: ChannelId, counts: Vec<u32>) -> RenderEvent {
    let (epoch, frame) = (frame.epoch, frame.frame);
    RenderEvent::Status(ServerMessage::Luminance(FrameLuminance { epoch, frame, channel, counts }))
}

pub(crate) fn draw_failed(frame: FrameId, channel: ChannelId, reason: String) -> RenderEvent {
    RenderEvent::Status(ServerMessage::DrawFailed { channel, frame, reason })
}

/// Creates the warning about a channel's display; `None`: its display is in order again.
pub(crate) fn display(channel: ChannelId, warning: Option<String>) -> RenderEvent {
    RenderEvent::Status(ServerMessage::Display { channel, warning })
}
