//! From a [`Wall`] back to a wall file.

use glam::{DVec3, UVec2};

use super::document::{
    ChannelSection, DeadlineSection, Document, HiddenSection, NetworkSection, ProjectionChoice,
    ScreenSection, StorageSection, TilesSection, WallSection,
};
use crate::limits::SHARED_CANVAS_SIDE_MAX;
use crate::wall::tiling::{Rect, gaps};
use crate::wall::{Bezel, Channel, Projection, Screen, Wall};

/// The wall file of a checked wall: [`parse`](super::parse) gives an equal wall back.
///
/// Screens come by corners and channels by hand, gaps between them as hidden; a screen with a
/// [`Bezel`] comes as tiles. All channels of a screen get the projection of its first.
///
/// # Panics
/// Never for a wall that was parsed. A wall whose rectangles leave `u32` may.
pub fn to_toml(wall: &Wall) -> String {
    let document = Document {
        wall: WallSection {
            name: wall.name.clone(),
            eye: wall.eye.to_array(),
            near: wall.near_m,
            samples: wall.samples,
        },
        deadline: DeadlineSection {
            factor: wall.deadline.factor,
            min_ms: wall.deadline.min_ms,
            max_ms: wall.deadline.max_ms,
        },
        network: NetworkSection { listen: wall.listen.clone(), heartbeat_ms: wall.heartbeat_ms },
        storage: StorageSection { stores: wall.stores.clone(), scenes: wall.scenes.clone() },
        screen: (0u16..).zip(&wall.screens).map(|(at, screen)| section(wall, at, screen)).collect(),
    };
    toml::to_string(&document).expect("sections are tables of texts, numbers and lists")
}

fn section(wall: &Wall, at: u16, screen: &Screen) -> ScreenSection {
    let channels: Vec<&Channel> = wall.channels.iter().filter(|c| c.screen == at).collect();
    let corner = |point: DVec3| Some(point.to_array());
    let fits = screen.canvas.max_element() <= SHARED_CANVAS_SIDE_MAX;
    let projection = match channels.first().map(|channel| channel.projection) {
        // What is the default anyway is not written.
        Some(Projection::Own) if fits => Some(ProjectionChoice::Own),
        _ => None,
    };
    let place = ScreenSection {
        name: screen.name.clone(),
        lower_left: screen.plane().and_then(|plane| corner(plane.lower_left)),
        lower_right: screen.plane().and_then(|plane| corner(plane.lower_right)),
        upper_left: screen.plane().and_then(|plane| corner(plane.upper_left)),
        projection,
        ..ScreenSection::default()
    };
    match screen.bezel {
        Some(bezel) => ScreenSection { tiles: tiles(&channels, bezel), ..place },
        None => ScreenSection {
            pixels: Some(screen.canvas.to_array()),
            hidden: hidden(screen.canvas, &channels),
            channel: channels.into_iter().map(by_hand).collect(),
            ..place
        },
    }
}

fn by_hand(channel: &Channel) -> ChannelSection {
    ChannelSection {
        name: channel.name.clone(),
        origin: channel.origin.to_array(),
        pixels: channel.size.to_array(),
        server: (channel.server != channel.name).then(|| channel.server.clone()),
    }
}

fn hidden(canvas: UVec2, channels: &[&Channel]) -> Vec<HiddenSection> {
    let rects: Vec<Rect> =
        channels.iter().map(|c| Rect { origin: c.origin, size: c.size }).collect();
    let section =
        |gap: Rect| HiddenSection { origin: gap.origin.to_array(), pixels: gap.size.to_array() };
    gaps(canvas, &rects).into_iter().map(section).collect()
}

fn tiles(channels: &[&Channel], bezel: Bezel) -> Option<TilesSection> {
    let columns = channels.iter().filter(|channel| channel.origin.y == 0).count();
    Some(TilesSection {
        columns: columns as u32,
        rows: channels.len().checked_div(columns)? as u32,
        pixels: channels.first()?.size.to_array(),
        bezel: bezel.asked_m.to_array(),
        names: channels.iter().map(|channel| channel.name.clone()).collect(),
        servers: channels.iter().map(|channel| channel.server.clone()).collect(),
    })
}
