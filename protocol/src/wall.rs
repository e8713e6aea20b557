//! The wall: screens in display space, and the channels that tile them.
//!
//! These types are what travels and what is drawn from; they hold only what was checked. A wall
//! file is read, checked and turned into them by [`mod@file`].

pub mod file;
pub mod frustum;
pub mod table;
mod tiling;

use glam::{DVec2, DVec3, UVec2};
use serde::{Deserialize, Serialize};

use crate::ids::ChannelId;
use crate::limits::{CANVAS_SIDE_MAX, CHANNEL_SIDE_MAX, CHANNELS_MAX, SCREENS_MAX};

/// The whole display system that one wall file describes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Wall {
    /// What to call it.
    pub name: String,
    /// Surfaces, in the order of the file.
    pub screens: Vec<Screen>,
    /// Output images; a [`ChannelId`] is an index into this list.
    pub channels: Vec<Channel>,
    /// Where the viewer's eye stands, in metres of display space.
    pub eye: DVec3,
    /// Distance of the near plane from the eye, in metres of display space; the same for all
    /// channels, so that depth agrees.
    pub near_m: f64,
    /// Samples per pixel: 1 or 4.
    pub samples: u32,
    /// How long a frame waits for a channel.
    pub deadline: DeadlineRule,
    /// A peer that is silent this long is lost.
    pub heartbeat_ms: u32,
    /// Where the manager listens.
    pub listen: String,
    /// Folders in which servers look for blobs before they ask the manager.
    pub stores: Vec<String>,
    /// Folders from which scenes may be opened.
    pub scenes: Vec<String>,
}

/// A planar rectangle in display space, in metres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Screen {
    /// Unique within the wall.
    pub name: String,
    /// As the viewer sees it.
    pub lower_left: DVec3,
    /// As the viewer sees it.
    pub lower_right: DVec3,
    /// As the viewer sees it.
    pub upper_left: DVec3,
    /// Pixels of the whole screen, those hidden behind bezels included.
    pub canvas: UVec2,
    /// The gaps between its tiles, where the wall file asked for such.
    pub bezel: Option<Bezel>,
}

/// Gaps between the tiles of a screen, behind which the picture goes on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Bezel {
    /// What the wall file asked for, across and down, in metres.
    pub asked_m: DVec2,
    /// What is in force: the nearest even numbers of pixels.
    pub pixels: UVec2,
}

/// One output image: a rectangle of a screen's canvas.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Channel {
    /// Unique within the wall.
    pub name: String,
    /// An index into [`Wall::screens`].
    pub screen: u16,
    /// Its upper left pixel, from the upper left of the screen's canvas.
    pub origin: UVec2,
    /// Its size in pixels.
    pub size: UVec2,
    /// The server that drives it; several channels may name the same.
    pub server: String,
    /// How it is projected; fixed by the wall file, never by what one server can do.
    pub projection: Projection,
}

/// How a tile of a planar screen gets its frustum.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Projection {
    /// The screen's matrix, with a viewport shifted by whole pixels: tiles of one screen compute
    /// identical clip positions.
    Shared,
    /// A sub-frustum of its own, computed in f64: for canvases beyond what a viewport can span.
    Own,
}

/// How long a frame waits: `factor` × the wall's median draw time, within bounds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DeadlineRule {
    /// Times the median draw time.
    pub factor: f64,
    /// Never shorter than this.
    pub min_ms: u32,
    /// Never longer than this.
    pub max_ms: u32,
}

impl Wall {
    /// What is wrong with a wall that came over the wire, if anything: an index that points
    /// nowhere, a size beyond the limits, a number that is none. A wall file is checked for more.
    pub fn fault(&self) -> Option<String> {
        if self.channels.len() > CHANNELS_MAX || self.screens.len() > SCREENS_MAX {
            return Some("the wall has more channels or screens than any may have".into());
        }
        if self.samples != 1 && self.samples != 4 {
            return Some(format!("{} samples per pixel, where 1 or 4 can be", self.samples));
        }
        if !(self.near_m.is_finite() && self.near_m > 0.0 && self.eye.is_finite()) {
            return Some("the eye or the near plane is not finite".into());
        }
        let is_large = |screen: &&Screen| screen.canvas.max_element() > CANVAS_SIDE_MAX;
        if let Some(screen) = self.screens.iter().find(is_large) {
            return Some(format!("screen {} is longer than {CANVAS_SIDE_MAX} pixels", screen.name));
        }
        let is_bad = |channel: &&Channel| {
            let Some(screen) = self.screens.get(usize::from(channel.screen)) else { return true };
            let end = channel.origin.saturating_add(channel.size);
            channel.size.min_element() == 0
                || channel.size.max_element() > CHANNEL_SIDE_MAX
                || end.cmpgt(screen.canvas).any()
        };
        let bad = self.channels.iter().find(is_bad);
        bad.map(|channel| format!("channel {} does not lie on its screen", channel.name))
    }

    /// The channel of this id.
    pub fn channel(&self, id: ChannelId) -> Option<&Channel> {
        self.channels.get(usize::from(id.0))
    }

    /// The channel of this name, with its id.
    pub fn channel_named(&self, name: &str) -> Option<(ChannelId, &Channel)> {
        let index = self.channels.iter().position(|channel| channel.name == name)?;
        Some((ChannelId(u16::try_from(index).ok()?), &self.channels[index]))
    }

    /// The ids of all channels, in the order of the file.
    pub fn channel_ids(&self) -> impl Iterator<Item = ChannelId> + use<> {
        (0..u16::try_from(self.channels.len()).unwrap_or(u16::MAX)).map(ChannelId)
    }

    /// The screen that a channel lies on.
    pub fn screen_of(&self, channel: &Channel) -> &Screen {
        &self.screens[usize::from(channel.screen)]
    }
}
