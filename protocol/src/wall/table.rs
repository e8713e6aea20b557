//! What `polyptych check` says about a wall: who shows what, how large, how sharp.

mod text;
mod warnings;

use glam::{DVec2, DVec3, UVec2};
use serde::Serialize;

use super::coverage::{self, Coverage, Footprint, Patch, is_plain};
use super::pixels::PixelMap;
use super::{Channel, Cover, EyeOf, Projection, Screen, Surface, Wall, extent};

/// Places of a channel, across and down, of which it is counted how many miss the screen.
const SPILL_SIDE: u32 = 64;

/// A wall in numbers. Displays as text with units; serialises for `--json`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WallTable {
    /// The wall's name.
    pub name: String,
    /// Pixels of all channels together.
    pub pixels_total: u64,
    /// Samples per pixel.
    pub samples: u32,
    /// Where the eye stands, in metres of display space.
    pub eye_m: [f64; 3],
    /// The near plane's distance from the eye in metres.
    pub near_m: f64,
    /// In the order of the wall file.
    pub screens: Vec<ScreenRow>,
    /// In the order of the wall file.
    pub channels: Vec<ChannelRow>,
    /// What works, but will not look its best.
    pub warnings: Vec<String>,
}

/// A screen in numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ScreenRow {
    /// The screen's name.
    pub name: String,
    /// `plane`, `cylinder`, `sphere` or `mesh`.
    pub surface: &'static str,
    /// Width and height in metres along the surface, bezels included; 0 for a mesh.
    pub size_m: [f64; 2],
    /// Width and height of the canvas in pixels, bezels included.
    pub pixels: [u32; 2],
    /// From the eye to the screen's plane in metres; to the nearest place of a curved screen.
    pub eye_distance_m: f64,
    /// The gaps between tiles, where the wall file asks for such.
    pub bezel: Option<BezelRow>,
    /// What channels cover, for each eye; nothing where only files know.
    pub coverage: Vec<CoverageRow>,
}

/// How the channels of a screen cover it, for one eye.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CoverageRow {
    /// `center`, `left` or `right`.
    pub eye: EyeOf,
    /// The share of the canvas that a channel shows.
    pub covered: f64,
    /// Most channels that show one place.
    pub layers_max: u32,
    /// Whether light is shared: then what is not covered was not hidden on purpose.
    pub blends: bool,
    /// Parts that no channel shows, the largest first.
    pub uncovered: Vec<PatchRow>,
    /// Channels that show the same.
    pub overlaps: Vec<OverlapRow>,
    /// How far apart the places are that were looked at, in pixels; 0 where all were counted.
    pub step_px: [f64; 2],
}

/// A part of a canvas.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PatchRow {
    /// The upper left of the rectangle around it, in pixels of the canvas.
    pub origin: [f64; 2],
    /// That rectangle's width and height in pixels.
    pub pixels: [f64; 2],
    /// The same in metres along the surface.
    pub size_m: [f64; 2],
    /// How many pixels the part has.
    pub area: f64,
}

/// Two channels that show the same.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OverlapRow {
    /// Their names.
    pub channels: [String; 2],
    /// What both show.
    pub patch: PatchRow,
    /// Whether they share their light there.
    pub is_blended: bool,
}

/// How a bezel was rounded.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct BezelRow {
    /// What the wall file asks for, across and down, in metres.
    pub asked_m: [f64; 2],
    /// The even numbers of pixels nearest to it.
    pub pixels: [u32; 2],
    /// What these are in metres.
    pub in_force_m: [f64; 2],
}

/// A channel in numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ChannelRow {
    /// The channel's name.
    pub name: String,
    /// The name of its screen.
    pub screen: String,
    /// The server that drives it.
    pub server: String,
    /// Width and height.
    pub pixels: [u32; 2],
    /// The upper left pixel on the screen's canvas.
    pub origin: [u32; 2],
    /// Width and height in metres.
    pub size_m: [f64; 2],
    /// The angles between the middles of opposite edges as seen from the eye, across and down.
    pub degrees: [f64; 2],
    /// At the channel's centre, across or down, whichever is fewer. An eye with full sight tells
    /// about 60 apart.
    pub pixels_per_degree: f64,
    /// How it gets its frustum: `shared` or `own`; `warp` where its pixels are no even grid on a
    /// plane.
    pub projection: &'static str,
    /// `tile`, `projector` or `map`.
    pub cover: &'static str,
    /// For whose eye it is: `center`, `left` or `right`.
    pub eye: EyeOf,
    /// How many pixels of the flat pictures that are drawn go into one of the display, at least
    /// and at most, as this eye sees it. Of a tile of a plane, 1 and 1.
    pub sampling: [f64; 2],
    /// The share of its pixels that miss the screen.
    pub spill: f64,
}

impl WallTable {
    /// The numbers of a wall, from its own eye.
    pub fn of(wall: &Wall) -> Self {
        let screens: Vec<ScreenRow> =
            (0..wall.screens.len()).map(|index| screen_row(wall, index)).collect();
        let channels: Vec<ChannelRow> =
            wall.channels.iter().map(|channel| channel_row(wall, channel)).collect();
        Self {
            name: wall.name.clone(),
            pixels_total: wall.channels.iter().map(|c| area(c.size)).sum(),
            samples: wall.samples,
            eye_m: wall.eye.to_array(),
            near_m: wall.near_m,
            warnings: warnings::warnings(wall, &screens, &channels),
            screens,
            channels,
        }
    }
}

fn area(size: UVec2) -> u64 {
    u64::from(size.x) * u64::from(size.y)
}

fn pitch_m(screen: &Screen) -> DVec2 {
    screen.size_m() / screen.canvas.as_dvec2()
}

fn screen_row(wall: &Wall, index: usize) -> ScreenRow {
    let screen = &wall.screens[index];
    let surface = match screen.surface {
        Surface::Plane(_) => "plane",
        Surface::Cylinder(_) => "cylinder",
        Surface::Sphere(_) => "sphere",
        Surface::Mesh(_) => "mesh",
    };
    let coverage = coverage::coverage(wall, index);
    ScreenRow {
        name: screen.name.clone(),
        surface,
        size_m: screen.size_m().to_array(),
        pixels: screen.canvas.to_array(),
        eye_distance_m: match screen.frustum(wall.eye) {
            Some(seen) => seen.distance_m,
            None => nearest_m(screen, wall.eye),
        },
        bezel: screen.bezel.map(|bezel| BezelRow {
            asked_m: bezel.asked_m.to_array(),
            pixels: bezel.pixels.to_array(),
            in_force_m: (bezel.pixels.as_dvec2() * pitch_m(screen)).to_array(),
        }),
        coverage: coverage.iter().map(|of_eye| coverage_row(wall, index, of_eye)).collect(),
    }
}

/// The least distance to a curved screen, at a grid of its places.
fn nearest_m(screen: &Screen, eye: DVec3) -> f64 {
    let at = |step: u32| f64::from(step) / f64::from(SPILL_SIDE);
    let places =
        (0..=SPILL_SIDE).flat_map(|y| (0..=SPILL_SIDE).map(move |x| DVec2::new(at(x), at(y))));
    let points = places.filter_map(|place| screen.surface.display_from_uv(place));
    points.map(|point| point.distance(eye)).min_by(f64::total_cmp).unwrap_or(f64::NAN)
}

fn coverage_row(wall: &Wall, index: usize, coverage: &Coverage) -> CoverageRow {
    let screen = &wall.screens[index];
    let open: f64 = coverage.holes.iter().map(|hole| hole.area).sum();
    let on_screen = |channel: &&Channel| usize::from(channel.screen) == index;
    let is_tiled =
        coverage.overlaps.is_empty() && wall.channels.iter().filter(on_screen).all(is_plain);
    let name = |index: usize| wall.channels[index].name.clone();
    CoverageRow {
        eye: coverage.eye,
        covered: 1.0 - open / area(screen.canvas) as f64,
        layers_max: coverage.layers_max,
        blends: !is_tiled,
        uncovered: coverage.holes.iter().map(|hole| patch_row(screen, wall.eye, *hole)).collect(),
        overlaps: coverage
            .overlaps
            .iter()
            .map(|overlap| OverlapRow {
                channels: overlap.channels.map(name),
                patch: patch_row(screen, wall.eye, overlap.patch),
                is_blended: overlap.is_blended,
            })
            .collect(),
        step_px: coverage.step_px.to_array(),
    }
}

fn patch_row(screen: &Screen, eye: DVec3, patch: Patch) -> PatchRow {
    let Patch { origin, size, area } = patch;
    let middle = origin + size / 2.0;
    let along = |axis: DVec2| {
        let place = |t: f64| screen.display_from_canvas(middle + axis * size * (t - 0.5));
        extent::of_line(eye, place)[0]
    };
    PatchRow {
        origin: origin.to_array(),
        pixels: size.to_array(),
        size_m: [along(DVec2::X), along(DVec2::Y)],
        area,
    }
}

fn channel_row(wall: &Wall, channel: &Channel) -> ChannelRow {
    let screen = wall.screen_of(channel);
    let size = channel.size.as_dvec2();
    let map = PixelMap::new(channel, screen);
    let over = |step: DVec2| {
        let place = |t: f64| map.as_ref()?.display_from_pixel(size / 2.0 + step * (t - 0.5));
        extent::of_line(wall.eye, place)
    };
    let (across, down) = (over(DVec2::X * size), over(DVec2::Y * size));
    let degrees_per_pixel = over(DVec2::X)[1].max(over(DVec2::Y)[1]);
    let is_even = is_plain(channel) && screen.plane().is_some();
    ChannelRow {
        name: channel.name.clone(),
        screen: screen.name.clone(),
        server: channel.server.clone(),
        pixels: channel.size.to_array(),
        origin: channel.origin.to_array(),
        size_m: [across[0], down[0]],
        degrees: [across[1], down[1]],
        pixels_per_degree: 1.0 / degrees_per_pixel,
        projection: match channel.projection {
            _ if !is_even => "warp",
            Projection::Shared => "shared",
            Projection::Own => "own",
        },
        cover: match channel.cover {
            Cover::Tile => "tile",
            Cover::Projector(_) => "projector",
            Cover::Map => "map",
        },
        eye: channel.adjustment.eye,
        sampling: if is_even { [1.0; 2] } else { extent::sampling(wall, channel) },
        spill: spill(channel, screen),
    }
}

/// The share of a projector's pixels that miss the screen; of others, whose pixels lie on it by
/// what they are, none.
fn spill(channel: &Channel, screen: &Screen) -> f64 {
    let is_file = screen.display_from_canvas(DVec2::ZERO).is_none();
    if !matches!(channel.cover, Cover::Projector(_)) || is_file {
        return 0.0;
    }
    let print = Footprint::new(channel, screen);
    let at = |step: u32| (f64::from(step) + 0.5) / f64::from(SPILL_SIDE);
    let places =
        (0..SPILL_SIDE).flat_map(|y| (0..SPILL_SIDE).map(move |x| DVec2::new(at(x), at(y))));
    let missed = places.filter(|place| !print.lands(*place)).count();
    missed as f64 / f64::from(SPILL_SIDE * SPILL_SIDE)
}

#[cfg(test)]
mod tests;
