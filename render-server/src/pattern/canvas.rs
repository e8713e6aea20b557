//! Patterns that lie on the canvas of a screen.
//!
//! Lines are as wide as two pixels of the canvas and lie around their number, so that a plain
//! tile shows them without grey: line 64 is the last pixel before place 64 and the first after it.
//! Elsewhere a pixel has the share of light that the line covers of it.

use std::collections::BTreeMap;

use glam::{DVec2, DVec3, IVec2};
use image::{GrayImage, RgbaImage};
use polyptych_renderer::rasterize;
use polyptych_wall::{Screen, Wall};

use super::pixel_positions::{PixelPosition, PixelPositions};
use super::{BLACK, code};

/// In pixels of the canvas.
const LINE_WIDTH: f64 = 2.0;

/// Lines that are not numbered have this share of the light of those that are.
const MINOR_LIGHT: f64 = 0.2;

/// Every so many lines one is bright.
const MINOR_PER_MAJOR: f64 = 4.0;

/// Numbers are so many pixels of the canvas apart, at least: as wide as the longest.
const NUMBER_SPACING: f64 = 128.0;

/// Circles around the foot of the eye.
const RINGS: f64 = 4.0;

/// Pixels of the canvas between two lines: a power of two, of which the shortest side of the
/// screen's channels has 16 to 32, so that all of them show the same.
pub(super) fn line_spacing(wall: &Wall, screen: &Screen) -> f64 {
    let on_it = |channel: &&polyptych_wall::Channel| {
        wall.screens.get(usize::from(channel.screen)).is_some_and(|of| of.name == screen.name)
    };
    let sides = wall.channels.iter().filter(on_it).map(|channel| channel.size.min_element());
    let shortest = sides.min().unwrap_or(1);
    f64::from((shortest / 16).max(1).ilog2().max(3)).exp2()
}

pub(super) fn grid(wall: &Wall, screen: &Screen, places: &PixelPositions<'_>) -> RgbaImage {
    let minor = line_spacing(wall, screen);
    let major = minor * MINOR_PER_MAJOR;
    let numbers = GridLabels::new(major, screen.canvas.as_dvec2(), places);
    places.paint(
        |_| (),
        |(), place| {
            let Some(place) = place else { return BLACK };
            let lines = |step: f64| {
                let x = share_of_line(place.at.x, place.extent.x, step);
                let y = share_of_line(place.at.y, place.extent.y, step);
                x.max(y)
            };
            let light = (lines(minor) * MINOR_LIGHT).max(lines(major));
            let number = numbers.ink(place.at);
            if light == 0.0 && number == 0.0 {
                return BLACK;
            }
            // Numbers are yellow, so that they are told from lines.
            let [line, both] = [light, light.max(number)].map(code);
            [both, both, line]
        },
    )
}

pub(super) fn checker(wall: &Wall, screen: &Screen, places: &PixelPositions<'_>) -> RgbaImage {
    let side = line_spacing(wall, screen) * 2.0;
    places.paint(
        |_| (),
        |(), place| {
            let Some(PixelPosition { at, extent }) = place else { return BLACK };
            let sign = |at: f64, extent: f64| mean_of_squares(at / side, extent / side);
            let light = 0.5 + 0.5 * sign(at.x, extent.x) * sign(at.y, extent.y);
            [code(light); 3]
        },
    )
}

pub(super) fn crosshair(
    wall: &Wall,
    screen: &Screen,
    places: &PixelPositions<'_>,
    eye: DVec3,
) -> RgbaImage {
    let ring = line_spacing(wall, screen) * MINOR_PER_MAJOR;
    let foot = screen.canvas_from_display(eye);
    places.paint(
        |_| (),
        |(), place| {
            let Some((PixelPosition { at, extent }, foot)) = place.zip(foot) else { return BLACK };
            let from = at - foot;
            let lines = share(from.x, extent.x).max(share(from.y, extent.y));
            let radius = from.length();
            let is_ring = radius > ring * 0.5 && radius < ring * (RINGS + 0.5);
            let around = (extent.x + extent.y) * 0.5;
            let rings = if is_ring { share_of_line(radius, around, ring) } else { 0.0 };
            if lines == 0.0 && rings == 0.0 {
                return BLACK;
            }
            [code(lines), code(lines.max(rings)), code(lines)]
        },
    )
}

/// Returns the fraction of a pixel that lines at all multiples of `step` cover, 0 to 1.
fn share_of_line(at: f64, extent: f64, step: f64) -> f64 {
    share(at - (at / step).round() * step, extent)
}

/// Returns the fraction of a pixel that the line at 0 covers, 0 to 1.
fn share(at: f64, extent: f64) -> f64 {
    let low = (at - extent * 0.5).max(-LINE_WIDTH * 0.5);
    let high = (at + extent * 0.5).min(LINE_WIDTH * 0.5);
    ((high - low) / extent).clamp(0.0, 1.0)
}

/// The mean over a pixel of what is 1 from 0 to 1, −1 from 1 to 2, and so on.
fn mean_of_squares(at: f64, extent: f64) -> f64 {
    // Its integral from 0 is a triangle.
    let integral = |x: f64| 1.0 - (x.rem_euclid(2.0) - 1.0).abs();
    (integral(at + extent * 0.5) - integral(at - extent * 0.5)) / extent
}

/// The numbers of the canvas's pixels beside crossings of lines, on the canvas themselves.
struct GridLabels {
    step: f64,
    offset: DVec2,
    scale: f64,
    inks: BTreeMap<(i32, i32), GrayImage>,
}

impl GridLabels {
    fn new(major: f64, canvas: DVec2, places: &PixelPositions<'_>) -> Self {
        let step = major * (NUMBER_SPACING / major).ceil().max(1.0);
        let scale = (step / 512.0).floor().max(1.0);
        let offset = DVec2::splat(LINE_WIDTH + 2.0);
        let mut inks = BTreeMap::new();
        if let Some((low, high)) = places.bounds() {
            // A projector that grazes a plane lights it up to anywhere. Around a dome, places may
            // be a turn away.
            let near = |at: DVec2| at.clamp(-canvas, 2.0 * canvas);
            let cell = |at: DVec2| (near(at) / step).floor().as_ivec2();
            let (first, last) = (cell(low - step), cell(high + step));
            for row in first.y..=last.y {
                for column in first.x..=last.x {
                    let at = IVec2::new(column, row).as_dvec2() * step;
                    inks.insert((column, row), rasterize(&format!("{},{}", at.x, at.y)));
                }
            }
        }
        Self { step, offset, scale, inks }
    }

    /// 0 to 1, at a place of the canvas.
    fn ink(&self, at: DVec2) -> f64 {
        let cell = ((at - self.offset) / self.step).floor();
        let from = (at - self.offset - cell * self.step) / self.scale - 0.5;
        let Some(image) = self.inks.get(&(cell.x as i32, cell.y as i32)) else { return 0.0 };
        let size = DVec2::new(f64::from(image.width()), f64::from(image.height()));
        if from.cmpge(size).any() {
            return 0.0;
        }
        let (low, t) = (from.floor(), from - from.floor());
        let of = |x: f64, y: f64| {
            let pixel = (x >= 0.0 && y >= 0.0)
                .then(|| image.get_pixel_checked(x as u32, y as u32))
                .flatten();
            pixel.map_or(0.0, |pixel| f64::from(pixel.0[0]) / 255.0)
        };
        let upper = of(low.x, low.y) * (1.0 - t.x) + of(low.x + 1.0, low.y) * t.x;
        let lower = of(low.x, low.y + 1.0) * (1.0 - t.x) + of(low.x + 1.0, low.y + 1.0) * t.x;
        upper * (1.0 - t.y) + lower * t.y
    }
}
