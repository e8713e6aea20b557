//! A channel in numbers.

use glam::{DVec2, DVec3};
use polyptych_wall::calibration_maps::CalibrationMaps;
use polyptych_wall::channel_mapping::ChannelMapping;
use polyptych_wall::projector::Projector;
use polyptych_wall::wall_geometry::ResolvedWall;
use polyptych_wall::{Channel, ChannelKind, Eye, FrustumMode, Orientation, StereoPacking, Surface};
use serde::Serialize;

use super::lit_part::LitPart;
use crate::check_report::angular_size;
use crate::coverage::{Footprint, is_plain_tile};

/// A channel in numbers. Unknown numbers are `None`, and left out of JSON; `unknown` says why.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ChannelRow {
    /// The channel's name.
    pub name: String,
    /// The name of its screen.
    pub screen: String,
    /// The server that drives it.
    pub server: String,
    /// `tile`: its pixels lie on the surface. `projector`: light is thrown by a pose. `map`: a
    /// warp file says where its pixels lie.
    pub cover: &'static str,
    /// The pose of its projector, if it has one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub projector: Option<ProjectorRow>,
    /// Its warp file, as the wall file names it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub warp: Option<String>,
    /// Width and height of the upright picture that an eye gets.
    pub pixels: [u32; 2],
    /// Width and height of the picture that its display gets: turned, and with both eyes in it.
    pub output_pixels: [u32; 2],
    /// For whose eye it is: `center`, `left` or `right`. With a packing it is for both.
    pub eye: Eye,
    /// The layout of both eyes' pictures on its display: `none`, `side-by-side`, `top-bottom` or
    /// `anaglyph`.
    pub packing: StereoPacking,
    /// The orientation of its display: `none`, or the side of the viewer at which its upper side
    /// is, `left` or `right`, or `half` for upside down.
    pub turn: Orientation,
    /// `true` if left and right are exchanged, before it is turned.
    pub mirror: bool,
    /// The upper left pixel on the screen's canvas.
    pub origin: [u32; 2],
    /// The share of its pixels whose light misses the screen, 0 to 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spill: Option<f64>,
    /// Width and height in metres of the part that is on the screen, through its middle.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub size_m: Option<[f64; 2]>,
    /// The angles of the same lines as seen from the eye, across and down.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub degrees: Option<[f64; 2]>,
    /// In the middle of that part, across or down, whichever is fewer. An eye with full sight
    /// tells about 60 apart.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pixels_per_degree: Option<f64>,
    /// The minimum and maximum number of pixels of the flat pictures that are drawn for one pixel
    /// of the channel, as this eye sees it. A tile of a plane has 1 and 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sampling: Option<[f64; 2]>,
    /// With omnidirectional stereo, the number of flat pictures for each eye.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stereo_planes: Option<usize>,
    /// With omnidirectional stereo, by how many pixels points on the screen or behind it are off
    /// at most for each eye, since each flat picture has one eye.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stereo_error_px: Option<f64>,
    /// The mode of its frustum: `shared` or `own`; `warp` if its pixels are no even grid on a
    /// plane.
    pub projection: &'static str,
    /// The reason why numbers are left out, if any are.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unknown: Option<String>,
}

/// A projector in numbers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ProjectorRow {
    /// Position of its lens, in metres of display space.
    pub position_m: [f64; 3],
    /// Its distance from a screen at a right angle by the width of the picture there.
    pub throw_ratio: f64,
    /// Lens shift, right and up, in widths and heights of its picture.
    pub shift: [f64; 2],
    /// `true` if it stands behind the screen, so that its light is seen through it.
    pub is_rear: bool,
    /// From its lens to the middle of what it lights, in metres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub distance_m: Option<f64>,
}

impl ChannelRow {
    /// The numbers of a channel.
    pub(super) fn new(of: ResolvedWall<'_>, maps: &CalibrationMaps, channel: &Channel) -> Self {
        let screen = of.wall.screen_of(channel);
        let adjustment = &channel.adjustment;
        let is_around = of.wall.is_omnidirectional(channel);
        let is_even = is_plain_tile(channel) && screen.plane().is_some() && !is_around;
        let file = adjustment.warp.and_then(|file| of.wall.files.get(usize::from(file)));
        let mut row = Self {
            name: channel.name.clone(),
            screen: screen.name.clone(),
            server: channel.server.clone(),
            cover: match channel.cover {
                ChannelKind::Tile => "tile",
                ChannelKind::Projector(_) => "projector",
                ChannelKind::Map => "map",
            },
            projector: match &channel.cover {
                ChannelKind::Projector(projector) => ProjectorRow::new(projector),
                ChannelKind::Tile | ChannelKind::Map => None,
            },
            warp: file.map(|file| file.path.clone()),
            pixels: channel.size.to_array(),
            output_pixels: channel.display_size().to_array(),
            eye: adjustment.eye,
            packing: adjustment.packing,
            turn: adjustment.turn,
            mirror: adjustment.mirror,
            origin: channel.origin.to_array(),
            spill: None,
            size_m: None,
            degrees: None,
            pixels_per_degree: None,
            sampling: is_even.then_some([1.0; 2]),
            stereo_planes: None,
            stereo_error_px: None,
            projection: match channel.projection {
                _ if !is_even => "warp",
                FrustumMode::Shared => "shared",
                FrustumMode::Own => "own",
            },
            unknown: None,
        };
        row.unknown = row.measure(of, maps, channel).err();
        row
    }

    /// Fills in what depends on where the pixels lie; an error is why that is not known.
    fn measure(
        &mut self,
        of: ResolvedWall<'_>,
        maps: &CalibrationMaps,
        channel: &Channel,
    ) -> Result<(), String> {
        let screen = of.wall.screen_of(channel);
        let print = Footprint::shaped(channel, screen, of.shapes);
        let Some(map) = print.map().filter(|_| print.is_known()) else {
            return Err("its calibration files were not read".to_owned());
        };
        let is_mesh = matches!(screen.surface, Surface::Mesh(_));
        let (size, canvas) = (channel.size.as_dvec2(), screen.canvas.as_dvec2());
        let lit = if is_plain_tile(channel) && !is_mesh {
            Some(LitPart::whole(size))
        } else {
            LitPart::new(&print, size, canvas)
        };
        self.spill = Some(lit.map_or(1.0, |lit| 1.0 - lit.share));
        let Some(lit) = lit else {
            return Err(format!("its picture lights nothing of screen {}", screen.name));
        };
        let over = |axis: DVec2| {
            let beside = lit.middle * (1.0 - axis);
            let (from, to) = (beside + lit.low * axis, beside + lit.high * axis);
            // The middle is looked at in the middle, so that something of the line is lit.
            let at = |t: f64| match t * 2.0 {
                t if t < 1.0 => from.lerp(lit.middle, t),
                t => lit.middle.lerp(to, t - 1.0),
            };
            let place = |t: f64| print.lit_point(at(t));
            angular_size::line_length_and_angle(of.wall.eye, place)
        };
        if let (Some(across), Some(down)) = (over(DVec2::X), over(DVec2::Y)) {
            self.size_m = Some([across.metres, down.metres]);
            self.degrees = Some([across.degrees, down.degrees]);
        }
        let step = degrees_per_pixel(map, of.wall.eye, lit.middle);
        self.pixels_per_degree = step.map(|step| 1.0 / step).filter(|count| count.is_finite());
        if let Some(projector) = &mut self.projector {
            let lens = DVec3::from(projector.position_m);
            projector.is_rear = map.is_rear();
            projector.distance_m = print.lit_point(lit.middle).map(|point| point.distance(lens));
        }
        if self.sampling.is_none() {
            let plan =
                angular_size::plan(of, maps, channel, map).map_err(|error| error.to_string())?;
            self.sampling = Some([plan.density_min, plan.density_max]);
            if !plan.triangles.is_empty() {
                self.stereo_planes = Some(plan.triangles.len());
                self.stereo_error_px = Some(plan.stereo_error_px);
            }
        }
        Ok(())
    }
}

impl ProjectorRow {
    fn new(projector: &Projector) -> Option<Self> {
        let [left, right, bottom, top] = projector.tangents;
        let (width, height) = (right - left, top - bottom);
        let shift = [f64::midpoint(left, right) / width, f64::midpoint(bottom, top) / height];
        let throw_ratio = 1.0 / width;
        let is_finite = [throw_ratio, shift[0], shift[1]].iter().all(|number| number.is_finite());
        let position_m = projector.position.to_array();
        is_finite.then_some(Self {
            position_m,
            throw_ratio,
            shift,
            is_rear: false,
            distance_m: None,
        })
    }
}

/// A pixel's angle is taken over a half of it, or a half of that, and so on: as many times.
const HALVES_MAX: i32 = 10;

/// The larger one of the angles that a pixel at this place spans across and down.
fn degrees_per_pixel(map: &ChannelMapping<'_>, eye: DVec3, at: DVec2) -> Option<f64> {
    let over = |step: DVec2| {
        let point = |t: f64| map.display_from_pixel(at + step * t);
        let middle = point(0.0);
        // What is lit may be less than a pixel wide.
        let halves = (1..=HALVES_MAX).map(|n| 0.5f64.powi(n));
        let mut spans = halves.filter_map(|half| match (point(-half), point(half)) {
            (Some(from), Some(to)) => Some((from, to, 2.0 * half)),
            (Some(from), None) => Some((from, middle?, half)),
            (None, Some(to)) => Some((middle?, to, half)),
            (None, None) => None,
        });
        let (from, to, length) = spans.next()?;
        Some(angular_size::angle(from - eye, to - eye).to_degrees() / length)
    };
    let step = over(DVec2::X)?.max(over(DVec2::Y)?);
    (step.is_finite() && step > 0.0).then_some(step)
}
