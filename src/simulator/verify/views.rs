//! Markers in views of their own: a camera's picture on each screen, as on a sheet of paper.

use std::path::Path;

use glam::{DMat2, DVec2, DVec3};
use polyptych_client::blocking::Client;
use polyptych_client::{Camera, Capture};
use polyptych_wall::limits::VIEWS_MAX;
use polyptych_wall::view::{Area, View, ViewProjection};
use polyptych_wall::wall_geometry::ResolvedWall;
use polyptych_wall::{Screen, Surface};

use super::geometry::{self, ChannelView, HALF_PX, picture_of, worst};
use super::light::{self, Drawn};
use super::marker::{self, LuminanceImage, Marker, Ray, Reading};
use super::verification_report::{Bound, VerificationReport};
use crate::outputs;

/// What is measured.
const WHAT: &str = "points in views of their own";

/// Maximum distance of a point of a view from where f64 places it, in pixels.
const ERROR_MAX_PX: f64 = 0.05;

/// From the lower to the upper edge of a view's picture, in radians.
const FIELD_RAD: f64 = 0.5;

/// A view is no wider than this many heights: it shows what a lens does.
const ASPECT_MAX: f64 = 2.0;

/// Distance between cameras, and of each from the wall's own, in metres: none sees the markers of
/// another one.
const APART_M: f64 = 1e4;

/// Markers across and down, and half a marker's side by the side of the view at most.
const COUNT: u32 = 3;
const HALF_SHARE: f64 = 0.1;

/// Distance of markers from their camera, in nearest distances that are drawn, and the minimum in
/// metres.
const DISTANCE: (f64, f64) = (10.0, 4.0);

/// Places of a channel, across and down, from which a marker is looked for: where the canvas comes
/// around to itself, one finds it and another one does not.
const STARTS: u32 = 5;

/// A camera's picture on a screen.
struct Laid {
    screen: u16,
    camera: DVec3,
    /// Its upper left and its size, in pixels of the canvas.
    low: DVec2,
    size: DVec2,
    /// Width and height of the picture, one metre before the camera.
    picture_m: DVec2,
    markers: Vec<Marker>,
}

/// Proves where channels show points of views with cameras of their own, one on each screen.
///
/// # Errors
/// A scene could not be written, or not be drawn.
pub(super) fn prove(
    client: &Client,
    (shaped, drawn): (ResolvedWall<'_>, Drawn<'_>),
    folder: &Path,
    table: &mut VerificationReport,
    keep: impl FnOnce(&Capture) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let wall = shaped.wall;
    let seen = geometry::channels(shaped);
    let is_shown = |at: u16| seen.iter().any(|of| wall.channels[usize::from(of.id.0)].screen == at);
    let screens = (0..).zip(&wall.screens).filter(|(at, _)| is_shown(*at));
    let mut laid = Vec::new();
    for (at, screen) in screens {
        let one = Laid::new(at, screen, wall.near_m);
        // The wall's own view is one, too.
        let fault = if laid.len() + 1 < VIEWS_MAX {
            drawn.wall.check_views(&[one.view()]).err().map(|error| error.to_string())
        } else {
            Some(format!("a wall has {VIEWS_MAX} views at most"))
        };
        match fault {
            Some(fault) => {
                table.add_unmeasured(format!("{WHAT} on screen {}", screen.name), None, fault);
            }
            None => laid.push(one),
        }
    }
    if laid.is_empty() {
        return Ok(());
    }
    let markers: Vec<Marker> = laid.iter().flat_map(|laid| laid.markers.clone()).collect();
    let place = folder.join("markers-views");
    outputs::make_folder(&place)?;
    for (name, bytes) in marker::files(&markers, DVec3::ZERO)? {
        outputs::write(&place.join(name), &bytes)?;
    }
    client.open_scene(place.join(marker::SCENE_NAME).display().to_string())?;
    client.set_camera(Camera::IDENTITY)?;
    client.set_views(laid.iter().map(Laid::view).collect())?;
    client.render_frame_at(None, Some(0.0))?;
    let capture = client.capture()?;
    client.clear_views()?;
    keep(&capture)?;
    let mut errors = Vec::new();
    for channel in &seen {
        let picture = picture_of(&capture, channel.name)?;
        let light = light::of(drawn, wall, (channel.id, channel.of), picture)?;
        let screen = wall.channels[usize::from(channel.id.0)].screen;
        for laid in laid.iter().filter(|laid| laid.screen == screen) {
            errors.extend(laid.errors(channel, &light));
        }
    }
    let target = Some(Bound::AtMost(ERROR_MAX_PX));
    if errors.is_empty() {
        let why = "no channel shows the whole of a marker with enough light";
        table.add_unmeasured(WHAT, None, why);
        return Ok(());
    }
    let count = errors.len();
    let (error, place) = worst(errors.into_iter());
    table.add(WHAT, error, "px", target, format!("{place} ({count} readings)"));
    Ok(())
}

impl Laid {
    fn new(index: u16, screen: &Screen, near_m: f64) -> Self {
        let canvas = screen.canvas.as_dvec2();
        let high = (canvas.y / 2.0).max(1.0);
        let size = DVec2::new((canvas.x / 2.0).min(high * ASPECT_MAX).max(1.0), high).floor();
        let low = ((canvas - size) / 2.0).floor();
        let size_m = size_m(screen, low + size / 2.0, size);
        let height = 2.0 * (FIELD_RAD / 2.0).tan();
        let picture_m = DVec2::new(size_m.x / size_m.y, 1.0) * height;
        let camera = DVec3::new(APART_M * f64::from(index + 1), 0.0, 0.0);
        let mut laid = Self { screen: index, camera, low, size, picture_m, markers: Vec::new() };
        let distance = (near_m * DISTANCE.0).max(DISTANCE.1);
        let half = HALF_PX.min(size.min_element() * HALF_SHARE);
        let side = picture_m / size * half * distance;
        for at in 0..COUNT * COUNT {
            let share = DVec2::new(f64::from(at % COUNT), f64::from(at / COUNT)) + 0.5;
            let (eye, ray) = laid.ray(share / f64::from(COUNT));
            let center = eye + ray * distance;
            laid.markers.push(Marker::new(center, DVec3::X * side.x, DVec3::Y * side.y));
        }
        laid
    }

    /// Returns the ray through a place of the picture, from (0, 0) at its upper left to (1, 1).
    fn ray(&self, place: DVec2) -> Ray {
        let at = DVec2::new(place.x - 0.5, 0.5 - place.y) * self.picture_m;
        (self.camera, at.extend(-1.0))
    }

    fn view(&self) -> View {
        let [x, y, width, height] =
            [self.low.x, self.low.y, self.size.x, self.size.y].map(|number| number as u32);
        let area = Area::Screen { screen: self.screen, rect: [x, y, width, height] };
        let camera = Camera { position: self.camera, ..Camera::IDENTITY };
        let projection = ViewProjection::Perspective { fov_y_rad: FIELD_RAD };
        View { area, projection, ..View::of_wall(camera) }
    }

    /// Returns the error in pixels of each marker that a channel shows whole, NaN for a missing
    /// one, with the name of the channel.
    fn errors(&self, channel: &ChannelView<'_>, light: &LuminanceImage) -> Vec<(f64, String)> {
        let sight = |pixel: DVec2| {
            let canvas = channel.map.canvas_from_pixel(pixel)?;
            Some(self.ray((canvas - self.low) / self.size))
        };
        let side = light.size.as_dvec2();
        let mut errors = Vec::new();
        for marker in &self.markers {
            let starts = (0..STARTS * STARTS).map(|at| {
                let share = DVec2::new(f64::from(at % STARTS), f64::from(at / STARTS)) + 0.5;
                side * share / f64::from(STARTS)
            });
            let found = starts
                .filter_map(|from| marker.seen_at(sight, DVec3::ZERO, (light.size, from)))
                .find_map(|pixel| Some((pixel, marker.half_px(sight, pixel)?)));
            let Some((pixel, half)) = found else { continue };
            let inset = DVec2::splat(half * 1.5);
            if pixel.cmplt(inset).any() || pixel.cmpgt(side - inset).any() {
                continue;
            }
            let error = match marker.read(sight, light, DVec3::ZERO, (pixel, half)) {
                Reading::Off(error) => error.length(),
                Reading::Unclear => continue,
                Reading::Missing => f64::NAN,
            };
            errors.push((error, channel.label()));
        }
        errors
    }
}

impl Marker {
    /// Half its side in pixels around one that shows its middle: the longer one.
    fn half_px(&self, sight: impl Fn(DVec2) -> Option<Ray>, pixel: DVec2) -> Option<f64> {
        let slope = |by: DVec2| {
            let at = |pixel| self.place(sight(pixel)?, DVec3::ZERO);
            Some((at(pixel + by)? - at(pixel - by)?) / 2.0)
        };
        let pixels = DMat2::from_cols(slope(DVec2::X)?, slope(DVec2::Y)?).inverse();
        let half = pixels.x_axis.length().max(pixels.y_axis.length());
        half.is_finite().then_some(half)
    }
}

/// Width and height of a part of a canvas as it lies on its screen, by differences around its
/// middle; in pixels where the screen stands in a file.
fn size_m(screen: &Screen, middle: DVec2, size: DVec2) -> DVec2 {
    if matches!(screen.surface, Surface::Mesh(_)) {
        return size;
    }
    let span = |step: DVec2| {
        let (a, b) =
            (screen.display_from_canvas(middle - step), screen.display_from_canvas(middle + step));
        a.zip(b).map_or(1.0, |(a, b)| a.distance(b) / (2.0 * step.length()))
    };
    DVec2::new(span(DVec2::X * 1e-3), span(DVec2::Y * 1e-3)) * size
}
