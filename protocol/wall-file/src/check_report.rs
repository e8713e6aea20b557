//! The report of `polyptych check` about a wall: the part that each channel shows, its size and
//! sharpness.
//!
//! No number in it is NaN or infinite. Unknown numbers are `None`: the text has a dash there, and
//! JSON leaves the key out.

mod angular_size;
mod blend_row;
mod channel_row;
mod crossing;
mod device_row;
mod lit_part;
mod plausibility;
mod text;
mod warnings;

use glam::{DVec2, DVec3, UVec2};
use polyptych_wall::calibration_maps::CalibrationMaps;
use polyptych_wall::wall_geometry::{ResolvedWall, ScreenGeometry};
use polyptych_wall::{Channel, Eye, Screen, StereoPacking, Surface, Wall};
use serde::Serialize;

use crate::coverage::{self, Coverage, Region, is_plain_tile};

pub use blend_row::BlendRow;
pub use channel_row::{ChannelRow, ProjectorRow};
pub use device_row::DeviceRow;

/// Places of a curved screen, across and down, of which the one nearest to the eye is taken.
const NEAREST_SIDE: u32 = 64;

/// A wall in numbers. Displays as text with units; serialises for `--json`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CheckReport {
    /// The wall's name.
    pub name: String,
    /// Pixels of all displays together, both eyes' where they are packed.
    pub pixels_total: u64,
    /// Samples per pixel.
    pub samples: u32,
    /// The position of the eye, in metres of display space.
    pub eye_m: [f64; 3],
    /// The way in which the wall shows depth.
    pub stereo: Stereo,
    /// From the left eye to the right one, in metres.
    pub eye_separation_m: f64,
    /// The near plane's distance from the eye in metres.
    pub near_m: f64,
    /// In the order of the wall file.
    pub screens: Vec<ScreenRow>,
    /// In the order of the wall file.
    pub channels: Vec<ChannelRow>,
    /// The places with the worst blends, screen by screen; none if channels share no light.
    pub blends: Vec<BlendRow>,
    /// Trackers, wands and pads, in the order of the wall file; left out if there are none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub devices: Vec<DeviceRow>,
    /// Warnings about what works, but will not look its best.
    pub warnings: Vec<String>,
}

/// The way in which a wall shows depth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Stereo {
    /// One picture for both eyes.
    None,
    /// Some channels are for the left eye, some for the right one.
    Passive,
    /// The pictures of both eyes share a display.
    Packed,
    /// Some channels are for one eye, others are packed.
    Mixed,
}

/// A screen in numbers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ScreenRow {
    /// The screen's name.
    pub name: String,
    /// `plane`, `cylinder`, `sphere` or `mesh`.
    pub surface: &'static str,
    /// Width and height in metres along the surface, bezels included; of a mesh, along the middle
    /// of its canvas.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub size_m: Option<[f64; 2]>,
    /// Width and height of the canvas in pixels, bezels included.
    pub pixels: [u32; 2],
    /// Width and height of one pixel of the canvas in metres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pitch_m: Option<[f64; 2]>,
    /// From the eye to the screen's plane in metres; to the nearest place of a curved screen.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub eye_distance_m: Option<f64>,
    /// The gaps between tiles, if the wall file asks for such.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bezel: Option<BezelRow>,
    /// The parts that channels cover, for each eye; empty if that needs calibration files that were
    /// not read.
    pub coverage: Vec<CoverageRow>,
}

/// The coverage of a screen by its channels, for one eye.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CoverageRow {
    /// `center`, `left` or `right`.
    pub eye: Eye,
    /// The share of the canvas that a channel shows.
    pub covered: f64,
    /// Maximum number of channels that show one place.
    pub layers_max: u32,
    /// `true` if light is shared: then the uncovered parts were not hidden on purpose.
    pub blends: bool,
    /// Number of pixels that no channel shows, all parts together.
    pub uncovered_pixels: f64,
    /// Parts that no channel shows, the largest first.
    pub uncovered: Vec<RegionRow>,
    /// Channels that show the same.
    pub overlaps: Vec<OverlapRow>,
    /// The spacing of the places that were looked at, in pixels; 0 if all were counted.
    pub step_px: [f64; 2],
}

/// A part of a canvas.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RegionRow {
    /// The upper left of the rectangle around it, in pixels of the canvas.
    pub origin: [f64; 2],
    /// That rectangle's width and height in pixels.
    pub pixels: [f64; 2],
    /// That rectangle's width and height in metres along the surface.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub size_m: Option<[f64; 2]>,
    /// Number of pixels of the part itself, which may be fewer than the rectangle has.
    pub area: f64,
    /// The part itself in square metres; only of planes and cylinders, whose pixels are equal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub area_m2: Option<f64>,
}

/// Two channels that show the same.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OverlapRow {
    /// Their names.
    pub channels: [String; 2],
    /// The part that both show.
    pub patch: RegionRow,
    /// `true` if they share their light there.
    pub is_blended: bool,
}

/// A bezel before and after rounding.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct BezelRow {
    /// The gap that the wall file asks for, across and down, in metres.
    pub asked_m: [f64; 2],
    /// The even numbers of pixels nearest to it.
    pub pixels: [u32; 2],
    /// The size of these pixels in metres.
    pub in_force_m: [f64; 2],
}

impl CheckReport {
    /// The numbers of a wall, from its own eye, as far as the geometry of its files says.
    pub fn from_wall<'a>(of: impl Into<ResolvedWall<'a>>) -> Self {
        Self::with_files(of.into(), &CalibrationMaps::default())
    }

    /// The numbers of a wall, from its own eye, with what its calibration files say.
    pub fn with_files(of: ResolvedWall<'_>, maps: &CalibrationMaps) -> Self {
        let wall = of.wall;
        let screens: Vec<ScreenRow> =
            (0..wall.screens.len()).map(|index| screen_row(of, index)).collect();
        let channels: Vec<ChannelRow> =
            wall.channels.iter().map(|channel| ChannelRow::new(of, maps, channel)).collect();
        Self {
            name: wall.name.clone(),
            pixels_total: wall.channels.iter().map(|c| area(c.display_size())).sum(),
            samples: wall.samples,
            eye_m: wall.eye.to_array(),
            stereo: stereo(wall),
            eye_separation_m: wall.eye_separation_m,
            near_m: wall.near_m,
            devices: wall.devices.iter().map(DeviceRow::new).collect(),
            warnings: warnings::warnings(wall, &screens, &channels),
            screens,
            channels,
            blends: blend_row::worst(of, maps),
        }
    }
}

fn area(size: UVec2) -> u64 {
    u64::from(size.x) * u64::from(size.y)
}

fn stereo(wall: &Wall) -> Stereo {
    let adjustments = || wall.channels.iter().map(|channel| &channel.adjustment);
    let is_packed = adjustments().any(|of| of.packing != StereoPacking::None);
    let is_passive = adjustments().any(|of| of.eye != Eye::Center);
    match (is_passive, is_packed) {
        (false, false) => Stereo::None,
        (true, false) => Stereo::Passive,
        (false, true) => Stereo::Packed,
        (true, true) => Stereo::Mixed,
    }
}

fn pitch_m(screen: &Screen) -> DVec2 {
    screen.size_m() / screen.canvas.as_dvec2()
}

/// Both numbers, if they are finite.
fn finite<const N: usize>(numbers: [f64; N]) -> Option<[f64; N]> {
    numbers.iter().all(|number| number.is_finite()).then_some(numbers)
}

fn screen_row(of: ResolvedWall<'_>, index: usize) -> ScreenRow {
    let wall = of.wall;
    let screen = &wall.screens[index];
    let surface = match screen.surface {
        Surface::Plane(_) => "plane",
        Surface::Cylinder(_) => "cylinder",
        Surface::Sphere(_) => "sphere",
        Surface::Mesh(_) => "mesh",
    };
    let ground = of.shapes.screen(screen);
    let size_m = match screen.surface {
        Surface::Mesh(_) => mesh_size_m(ground, wall.eye),
        _ => finite(screen.size_m().to_array()),
    };
    let coverage = coverage::coverage(of, index);
    ScreenRow {
        name: screen.name.clone(),
        surface,
        size_m,
        pixels: screen.canvas.to_array(),
        pitch_m: size_m
            .and_then(|size| finite((DVec2::from(size) / screen.canvas.as_dvec2()).to_array())),
        eye_distance_m: match screen.frustum(wall.eye) {
            Some(seen) => Some(seen.distance_m).filter(|distance| distance.is_finite()),
            None => nearest_m(ground, wall.eye),
        },
        bezel: screen.bezel.map(|bezel| BezelRow {
            asked_m: bezel.asked_m.to_array(),
            pixels: bezel.pixels.to_array(),
            in_force_m: (bezel.pixels.as_dvec2() * pitch_m(screen)).to_array(),
        }),
        coverage: coverage.iter().map(|of_eye| coverage_row(of, index, of_eye)).collect(),
    }
}

/// Width and height of a mesh along the middle of its canvas.
fn mesh_size_m(ground: ScreenGeometry<'_>, eye: DVec3) -> Option<[f64; 2]> {
    let canvas = ground.screen.canvas.as_dvec2();
    let along = |axis: DVec2| {
        let place = |t: f64| ground.display_from_canvas(canvas * (0.5 + axis * (t - 0.5)));
        angular_size::line_length_and_angle(eye, place).map(|line| line.metres)
    };
    Some([along(DVec2::X)?, along(DVec2::Y)?])
}

/// The least distance to a curved screen, at a grid of its places.
fn nearest_m(ground: ScreenGeometry<'_>, eye: DVec3) -> Option<f64> {
    let at = |step: u32| f64::from(step) / f64::from(NEAREST_SIDE);
    let places =
        (0..=NEAREST_SIDE).flat_map(|y| (0..=NEAREST_SIDE).map(move |x| DVec2::new(at(x), at(y))));
    let canvas = ground.screen.canvas.as_dvec2();
    let points = places.filter_map(|place| ground.display_from_canvas(place * canvas));
    let distances = points.map(|point| point.distance(eye)).filter(|distance| distance.is_finite());
    distances.min_by(f64::total_cmp)
}

fn coverage_row(of: ResolvedWall<'_>, index: usize, coverage: &Coverage) -> CoverageRow {
    let wall = of.wall;
    let screen = &wall.screens[index];
    let open: f64 = coverage.holes.iter().map(|hole| hole.area).sum();
    let on_screen = |channel: &&Channel| usize::from(channel.screen) == index;
    let is_tiled =
        coverage.overlaps.is_empty() && wall.channels.iter().filter(on_screen).all(is_plain_tile);
    let name = |index: usize| wall.channels[index].name.clone();
    let ground = of.shapes.screen(screen);
    CoverageRow {
        eye: coverage.eye,
        covered: 1.0 - open / area(screen.canvas) as f64,
        layers_max: coverage.layers_max,
        blends: !is_tiled,
        uncovered_pixels: open,
        uncovered: coverage.holes.iter().map(|hole| patch_row(ground, wall.eye, *hole)).collect(),
        overlaps: coverage
            .overlaps
            .iter()
            .map(|overlap| OverlapRow {
                channels: overlap.channels.map(name),
                patch: patch_row(ground, wall.eye, overlap.patch),
                is_blended: overlap.is_blended,
            })
            .collect(),
        step_px: coverage.step_px.to_array(),
    }
}

fn patch_row(ground: ScreenGeometry<'_>, eye: DVec3, patch: Region) -> RegionRow {
    let Region { origin, size, area } = patch;
    let middle = origin + size / 2.0;
    let along = |axis: DVec2| {
        let place = |t: f64| ground.display_from_canvas(middle + axis * size * (t - 0.5));
        angular_size::line_length_and_angle(eye, place).map(|line| line.metres)
    };
    let is_even = matches!(ground.screen.surface, Surface::Plane(_) | Surface::Cylinder(_));
    let pixel_m2 = pitch_m(ground.screen).element_product();
    RegionRow {
        origin: origin.to_array(),
        pixels: size.to_array(),
        size_m: along(DVec2::X).zip(along(DVec2::Y)).map(|(across, down)| [across, down]),
        area,
        area_m2: Some(area * pixel_m2).filter(|area| is_even && area.is_finite()),
    }
}

#[cfg(test)]
mod tests;
