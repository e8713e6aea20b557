//! From a [`Wall`] back to a wall file.

mod adjustment;
mod device;

use std::collections::BTreeMap;

use glam::{DVec3, UVec2};
use polyptych_wall::limits::SHARED_CANVAS_SIDE_MAX;
use polyptych_wall::projector::Projector;
use polyptych_wall::surface::{Cylinder, Sphere};
use polyptych_wall::{Bezel, Channel, ChannelKind, FrustumMode, Screen, Surface, Wall};

use super::document::{
    AdjustSection, BlendSection, BudgetSection, ChannelSection, CylinderSection, DeadlineSection,
    Document, HiddenSection, NetworkSection, ProjectionChoice, ProjectorSection, Rotation,
    ScreenSection, SphereSection, StorageSection, SyncSection, TilesSection, WallSection,
};
use super::rotation::{degrees, written};
use crate::coverage::{eyes, is_plain_tile, is_seen_by};
use crate::tiling::{Rect, gaps, overlap};

/// The wall file of a checked wall: [`parse`](super::parse) gives an equal wall back. It has no
/// [`Launch`](super::Launch), which is no part of the wall.
///
/// Planar screens come by corners and channels by hand, gaps between them as hidden; a screen with
/// a [`Bezel`] comes as tiles. All tiles of a screen get the projection of its first. Angles that
/// no number of degrees gives exactly are off by a rounding; angles of a wall file never are.
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
            eye_separation: wall.eye_separation_m,
            stereo: wall.stereo.mode,
            stereo_error: wall.stereo.error_max_px,
            dither: wall.dither,
            shadows: wall.shadows,
        },
        deadline: DeadlineSection {
            factor: wall.deadline.factor,
            min_ms: wall.deadline.min_ms,
            max_ms: wall.deadline.max_ms,
        },
        sync: SyncSection {
            pipeline_depth: wall.sync.pipeline_depth,
            swap_lead_ms: wall.sync.swap_lead_ms,
        },
        network: NetworkSection { listen: wall.listen.clone(), heartbeat_ms: wall.heartbeat_ms },
        storage: StorageSection { stores: wall.stores.clone(), scenes: wall.scenes.clone() },
        budget: BudgetSection { gpu_mib: wall.budget.gpu_mib, host_mib: wall.budget.host_mib },
        blend: BlendSection { exponent: wall.blend.exponent, leak: wall.blend.leak },
        screen: (0u16..).zip(&wall.screens).map(|(at, screen)| section(wall, at, screen)).collect(),
        channel: wall.channels.iter().filter_map(|c| adjusted(wall, c)).collect(),
        // How a wall is started is no part of it.
        launch: None,
        server: BTreeMap::new(),
        device: wall.devices.iter().map(device::section).collect(),
    };
    toml::to_string(&document).expect("sections are tables of texts, numbers and lists")
}

fn adjusted(wall: &Wall, channel: &Channel) -> Option<(String, AdjustSection)> {
    Some((channel.name.clone(), adjustment::section(wall, channel)?))
}

fn section(wall: &Wall, at: u16, screen: &Screen) -> ScreenSection {
    let channels: Vec<&Channel> = wall.channels.iter().filter(|c| c.screen == at).collect();
    let fits = screen.canvas.max_element() <= SHARED_CANVAS_SIDE_MAX;
    let tile = channels.iter().find(|channel| channel.cover == ChannelKind::Tile);
    let projection = match tile.map(|channel| channel.projection) {
        // What is the default anyway is not written.
        Some(FrustumMode::Own) if fits => Some(ProjectionChoice::Own),
        _ => None,
    };
    let place = ScreenSection { projection, ..place(wall, screen) };
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

/// The screen's name, and where it stands.
fn place(wall: &Wall, screen: &Screen) -> ScreenSection {
    let section = ScreenSection { name: screen.name.clone(), ..ScreenSection::default() };
    let corner = |point: DVec3| Some(point.to_array());
    match &screen.surface {
        Surface::Plane(plane) => ScreenSection {
            lower_left: corner(plane.lower_left),
            lower_right: corner(plane.lower_right),
            upper_left: corner(plane.upper_left),
            ..section
        },
        Surface::Cylinder(cylinder) => {
            let Cylinder { center, rotation, radius_m, azimuth_rad, height_m } = *cylinder;
            let cylinder = CylinderSection {
                center: center.to_array(),
                radius: radius_m,
                degrees: azimuth_rad.map(degrees),
                height: height_m,
                rotation: written(rotation),
            };
            ScreenSection { cylinder: Some(cylinder), ..section }
        }
        Surface::Sphere(sphere) => {
            let Sphere { center, rotation, radius_m, azimuth_rad, elevation_rad } = *sphere;
            let sphere = SphereSection {
                center: center.to_array(),
                radius: radius_m,
                azimuth: azimuth_rad.map(degrees),
                elevation: elevation_rad.map(degrees),
                rotation: written(rotation),
            };
            ScreenSection { sphere: Some(sphere), ..section }
        }
        Surface::Mesh(file) => {
            let mesh = wall.files.get(usize::from(*file)).map(|file| file.path.clone());
            ScreenSection { mesh, ..section }
        }
    }
}

fn thrown(cover: &ChannelKind) -> Option<ProjectorSection> {
    let ChannelKind::Projector(projector) = cover else { return None };
    let Projector { position, rotation, tangents } = **projector;
    Some(ProjectorSection {
        position: position.to_array(),
        look_at: None,
        // Where it looks must be said, even where it is not turned.
        rotation: written(rotation).or(Some(Rotation::Angles([0.0; 3]))),
        degrees: None,
        tangents: Some(tangents),
        shift: None,
    })
}

fn by_hand(channel: &Channel) -> ChannelSection {
    ChannelSection {
        name: channel.name.clone(),
        origin: Some(channel.origin.to_array()),
        pixels: channel.size.to_array(),
        projector: thrown(&channel.cover),
        server: (channel.server != channel.name).then(|| channel.server.clone()),
    }
}

/// The gaps that must be said to be meant: those that some eye sees between plain tiles.
fn hidden(canvas: UVec2, channels: &[&Channel]) -> Vec<HiddenSection> {
    let section =
        |gap: Rect| HiddenSection { origin: gap.origin.to_array(), pixels: gap.size.to_array() };
    let rect = |channel: &&Channel| Rect { origin: channel.origin, size: channel.size };
    let tiles: Vec<Rect> = channels.iter().filter(|c| is_plain_tile(c)).map(rect).collect();
    let is_tiled = |eye| {
        let mut seen = channels.iter().filter(|channel| is_seen_by(channel, eye)).peekable();
        let rects: Vec<Rect> = seen.clone().map(rect).collect();
        seen.peek().is_some() && seen.all(|c| is_plain_tile(c)) && overlap(&rects).is_none()
    };
    if !eyes(channels.iter().copied()).iter().any(|eye| is_tiled(*eye)) {
        return Vec::new();
    }
    gaps(canvas, &tiles).into_iter().map(section).collect()
}

fn tiles(channels: &[&Channel], bezel: Bezel) -> Option<TilesSection> {
    let columns = channels.iter().filter(|channel| channel.origin.y == 0).count();
    Some(TilesSection {
        columns: columns as u32,
        rows: channels.len().checked_div(columns)? as u32,
        pixels: channels.first()?.size.to_array(),
        bezel: bezel.asked_m.to_array(),
        overlap: [0, 0],
        names: channels.iter().map(|channel| channel.name.clone()).collect(),
        servers: channels.iter().map(|channel| channel.server.clone()).collect(),
    })
}
