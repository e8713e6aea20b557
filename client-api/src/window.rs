//! The window of a wall: the rectangle in front of its eye that a scene is fitted to.

use glam::{DMat3, DVec2, DVec3};
use polyptych_wall::{ChannelKind, Screen, Surface, Wall};

/// Share of the rectangle around several screens of one plane that they must cover to count as
/// one screen: bezels between them are allowed, gaps are not.
const COVERED_MIN: f64 = 0.9;

/// Tangent of 75°: a curved screen that goes on beyond it surrounds the eye.
const SURROUNDING: f64 = 3.73;

/// Tangent of half of the angle that is used of a screen that surrounds the eye: 77° in all.
const SURROUNDING_USED: f64 = 0.8;

/// Points on each side of a rectangle that are tried on a curved screen.
const SIDE_POINTS: u32 = 32;

/// Halvings of an interval: as far as f64 can tell.
const HALVINGS: u32 = 50;

/// A rectangle on a plane in front of the eye.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Window {
    /// Display space from the window's axes: right, up, and from the plane towards the eye.
    pub axes: DMat3,
    /// Distance of the plane from the eye, in metres.
    pub distance_m: f64,
    /// Tangents of the left and the lower edge, from the foot of the eye on the plane.
    pub min: DVec2,
    /// Tangents of the right and the upper edge.
    pub max: DVec2,
}

impl Window {
    /// The window of the screen in front of the eye.
    pub(crate) fn of_wall(wall: &Wall) -> Self {
        let straight_ahead = Self {
            axes: DMat3::IDENTITY,
            distance_m: 1.0,
            min: DVec2::splat(-0.5),
            max: DVec2::splat(0.5),
        };
        let Some((front, middle)) = front_screen(wall) else { return straight_ahead };
        let window = match front.surface {
            Surface::Plane(_) => Self::of_plane(wall, front),
            _ => Self::of_curved(wall, front, middle),
        };
        window.unwrap_or(straight_ahead)
    }

    fn of_plane(wall: &Wall, front: &Screen) -> Option<Self> {
        let corners = lit_corners(wall, front)?;
        let right = (corners[1] - corners[0]).try_normalize()?;
        let up = (corners[2] - corners[0]).reject_from_normalized(right).try_normalize()?;
        let backward = right.cross(up);
        let distance_m = backward.dot(wall.eye - corners[0]);
        let axes = DMat3::from_cols(right, up, backward);
        let mut window = Self { axes, distance_m, min: DVec2::MAX, max: DVec2::MIN };
        if distance_m.is_nan() || distance_m <= 0.0 {
            return None;
        }
        window.include(&corners, wall.eye);
        let joined = window.joined(wall);
        Some(if joined.is_finite() { joined } else { window })
    }

    /// Grows until these points of the plane are within.
    fn include(&mut self, points: &[DVec3], eye: DVec3) {
        for point in points {
            let at = self.axes.transpose() * (*point - eye);
            let tangent = at.truncate() / self.distance_m;
            (self.min, self.max) = (self.min.min(tangent), self.max.max(tangent));
        }
    }

    /// The rectangle around all screens that lie in this plane, if they cover it.
    fn joined(&self, wall: &Wall) -> Self {
        let area = |window: &Self| (window.max - window.min).element_product();
        let (mut joined, mut covered) = (*self, 0.0);
        for screen in &wall.screens {
            let Some(corners) = screen.plane().and_then(|_| lit_corners(wall, screen)) else {
                continue;
            };
            let depth = |point: &DVec3| self.axes.z_axis.dot(wall.eye - *point);
            let is_in_plane = |point: &DVec3| {
                (depth(point) - self.distance_m).abs() < 1e-6 * self.distance_m.max(1.0)
            };
            if corners.iter().all(is_in_plane) {
                let mut one = Self { min: DVec2::MAX, max: DVec2::MIN, ..*self };
                one.include(&corners, wall.eye);
                covered += area(&one);
                joined.include(&corners, wall.eye);
            }
        }
        if covered >= COVERED_MIN * area(&joined) { joined } else { *self }
    }

    fn is_finite(&self) -> bool {
        self.min.is_finite() && self.max.is_finite()
    }

    /// A rectangle on the plane through the middle of a curved screen, such that each ray through
    /// its edges meets the screen.
    fn of_curved(wall: &Wall, screen: &Screen, middle: DVec3) -> Option<Self> {
        let canvas = screen.canvas.as_dvec2();
        let above = screen.display_from_canvas(canvas * DVec2::new(0.5, 0.49))?;
        let below = screen.display_from_canvas(canvas * DVec2::new(0.5, 0.51))?;
        let distance_m = (middle - wall.eye).length();
        let backward = (wall.eye - middle).try_normalize()?;
        let up = (above - below).reject_from_normalized(backward).try_normalize()?;
        let right = up.cross(backward);
        let shows = |tangent: DVec2| {
            let ray = right * tangent.x + up * tangent.y - backward;
            let point = screen.surface.hit(wall.eye, ray);
            let uv = point.and_then(|point| screen.surface.uv_from_display(point));
            uv.is_some_and(|uv| is_within(uv.x) && is_within(uv.y))
        };
        let reach = |side: DVec2| match reach(|t| shows(side * t)) {
            far if far >= SURROUNDING => SURROUNDING_USED,
            near => near,
        };
        let min = -DVec2::new(reach(DVec2::NEG_X), reach(DVec2::NEG_Y));
        let max = DVec2::new(reach(DVec2::X), reach(DVec2::Y));
        let is_shown = |share: f64| {
            let (min, max) = (min * share, max * share);
            (0..=SIDE_POINTS).all(|i| {
                let at = min + (max - min) * (f64::from(i) / f64::from(SIDE_POINTS));
                let vertical = shows(DVec2::new(min.x, at.y)) && shows(DVec2::new(max.x, at.y));
                vertical && shows(DVec2::new(at.x, min.y)) && shows(DVec2::new(at.x, max.y))
            })
        };
        let share = if is_shown(1.0) { 1.0 } else { last(0.0, 1.0, is_shown) };
        let window = Self {
            axes: DMat3::from_cols(right, up, backward),
            distance_m,
            min: min * share,
            max: max * share,
        };
        (window.is_finite() && (window.max - window.min).min_element() > 0.0).then_some(window)
    }
}

/// Returns whether a coordinate of the canvas lies on it, its edges included.
fn is_within(coordinate: f64) -> bool {
    (-1e-9..=1.0 + 1e-9).contains(&coordinate)
}

/// Returns the distance to which a screen goes on from its middle without a gap, at most
/// [`SURROUNDING`].
fn reach(shows: impl Fn(f64) -> bool) -> f64 {
    const STEPS: u32 = 64;
    let step = SURROUNDING / f64::from(STEPS);
    let missed = (1..=STEPS).map(|i| f64::from(i) * step).find(|&t| !shows(t));
    missed.map_or(SURROUNDING, |missed| last(missed - step, missed, shows))
}

/// The last number from `low` on for which the test holds; it does not for `high`.
pub(crate) fn last(mut low: f64, mut high: f64, test: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..HALVINGS {
        let middle = f64::midpoint(low, high);
        if test(middle) { low = middle } else { high = middle }
    }
    low
}

/// The screen that stands most in front of the eye (towards −Z; the first of equal ones), and the
/// middle of its canvas in display space. `None` where all screens stand in files.
pub(crate) fn front_screen(wall: &Wall) -> Option<(&Screen, DVec3)> {
    let mut front = None;
    let mut most_ahead = f64::NEG_INFINITY;
    for screen in &wall.screens {
        let Some(middle) = screen.display_from_canvas(screen.canvas.as_dvec2() / 2.0) else {
            continue;
        };
        let ahead = (middle - wall.eye).try_normalize().map_or(0.0, |toward| -toward.z);
        // Two screens side by side are equally far ahead but for rounding.
        if ahead > most_ahead + 1e-9 {
            most_ahead = ahead;
            front = Some((screen, middle));
        }
    }
    front
}

/// The lower left, lower right, upper left and upper right corner of what is lit of a planar
/// screen: all its tiles, or the whole canvas where channels are no tiles.
fn lit_corners(wall: &Wall, screen: &Screen) -> Option<[DVec3; 4]> {
    let is_here = |index: u16| {
        wall.screens.get(usize::from(index)).is_some_and(|other| std::ptr::eq(other, screen))
    };
    let channels = || wall.channels.iter().filter(|channel| is_here(channel.screen));
    let (mut min, mut max) = (DVec2::ZERO, screen.canvas.as_dvec2());
    if channels().next().is_some() && channels().all(|channel| channel.cover == ChannelKind::Tile) {
        let ends = channels().map(|c| (c.origin.as_dvec2(), (c.origin + c.size).as_dvec2()));
        (min, max) = ends.fold((max, min), |(min, max), (a, b)| (min.min(a), max.max(b)));
    }
    let at = |x: f64, y: f64| screen.display_from_canvas(DVec2::new(x, y));
    Some([at(min.x, max.y)?, at(max.x, max.y)?, at(min.x, min.y)?, at(max.x, min.y)?])
}
