//! Channels: the output images of a wall.

use std::fmt;

use glam::UVec2;
use serde::{Deserialize, Serialize};

use super::channel_calibration::ChannelCalibration;
use super::projector::Projector;
use crate::limits::NAME_BYTES_MAX;

/// A channel, by its place in the wall's list of channels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct ChannelId(pub u16);

impl fmt::Display for ChannelId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// One output image, drawn upright as the viewer sees it; a display that is turned, mirrored or
/// packed for two eyes gets it so ([`ChannelCalibration`]).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Channel {
    /// Unique within the wall.
    pub name: String,
    /// An index into [`Wall::screens`](super::Wall::screens).
    pub screen: u16,
    /// Its upper left pixel, from the upper left of the screen's canvas. Where it is no tile:
    /// where its window stands among those of the screen.
    pub origin: UVec2,
    /// Its size in pixels.
    pub size: UVec2,
    /// The server that drives it; several channels may name the same.
    pub server: String,
    /// The monitor of the server's machine that it fills in full screen, by the X server's name
    /// for it; `None`: the next one that no other channel of the server takes.
    pub monitor: Option<String>,
    /// The mode of its frustum; fixed by the wall file, never by what one server can do.
    pub projection: FrustumMode,
    /// The part of the screen that it covers.
    pub cover: ChannelKind,
    /// The corrections of its picture for its display.
    pub adjustment: ChannelCalibration,
}

/// The part of its screen that a channel covers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum ChannelKind {
    /// The pixels of the canvas from `origin`, one to one.
    Tile,
    /// The area that a projector lights.
    Projector(Box<Projector>),
    /// The area that the channel's warp file gives ([`ChannelCalibration::warp`]).
    Map,
}

/// The way in which a tile of a planar screen gets its frustum.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum FrustumMode {
    /// The screen's matrix, with a viewport shifted by whole pixels: tiles of one screen compute
    /// identical clip positions.
    Shared,
    /// A sub-frustum of its own, computed in f64: for canvases beyond what a viewport can span.
    Own,
}

impl ChannelKind {
    pub(super) fn fault(&self) -> Option<String> {
        match self {
            Self::Tile | Self::Map => None,
            Self::Projector(projector) => projector.fault(),
        }
    }
}

/// Returns whether a text can be the name of a monitor: 1 to [`NAME_BYTES_MAX`] bytes, no control
/// characters.
pub fn is_monitor_name(text: &str) -> bool {
    (1..=NAME_BYTES_MAX).contains(&text.len()) && !text.chars().any(char::is_control)
}

impl Channel {
    /// A plain tile of a screen, driven by a server of its own name.
    pub fn tile(name: &str, screen: u16, origin: UVec2, size: UVec2) -> Self {
        Self {
            name: name.to_owned(),
            screen,
            origin,
            size,
            server: name.to_owned(),
            monitor: None,
            projection: FrustumMode::Shared,
            cover: ChannelKind::Tile,
            adjustment: ChannelCalibration::default(),
        }
    }

    /// Width and height of the display's own picture: turned, and with both eyes where packed.
    pub fn display_size(&self) -> UVec2 {
        self.adjustment.display_size(self.size)
    }
}
